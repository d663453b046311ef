//! How clothes are laid out for their relief ([`crate::unwrap`]).
//!
//! Fabric runs around limbs in whole repeats, so it has no seam there. Its seams are those of real
//! clothes: where sleeves begin, where a front and a back of cloth that lie flat meet at the sides and
//! on the shoulders, and in the middle of the trousers.

use super::{Piece, SIDES, top_ends};
use crate::Part;
use crate::detail::Detail;
use crate::look::{Look, Top};
use crate::rest::Rest;
use crate::unwrap::{Chart, flatten, repeats};
use crate::vector::{V, add, cross, curve, dot, hypot, length, mix, ramp, scale, sub, unit};
use std::f32::consts::TAU;

/// Mean radius of the trunk, and how much wider it is than deep.
const TRUNK: f32 = 0.128;
const FLAT: f32 = 1.45;
/// Mean radii of sleeves and trouser legs.
const SLEEVE: f32 = 0.0425;
const LEG: f32 = 0.068;

type Place<'a> = Box<dyn Fn(usize, V, V) -> [f32; 2] + 'a>;

fn top_detail(look: &Look) -> Detail {
    if look.top == Top::Sweater { Detail::Knit } else { Detail::Weave }
}

/// The top: front, back, left sleeve, right sleeve.
pub(in super::super) fn top(rest: &Rest, look: &Look, piece: &Piece) -> Part {
    let s = rest.size;
    let detail = top_detail(look);
    let mut part = piece.surface();
    let radius = SLEEVE * s * look.build.arm;
    let sleeves = SIDES.map(|side| limb(["shoulder", "elbow", "wrist"].map(|n| rest.side(side, n)), radius, detail));
    let [left, right] = sleeves;
    // On a plane of the grid the line between two charts is smooth.
    let plane = |axis: usize, wanted: f32| {
        let planes = piece.grid.0[axis].iter().copied();
        planes.min_by(|a, b| (a - wanted).abs().total_cmp(&(b - wanted).abs())).unwrap_or(wanted)
    };
    let from = plane(0, rest.side("left", "shoulder")[0].abs() - 0.012 * s);
    let middle = plane(2, mix(rest.at("spine3"), rest.middle("shoulder"), 0.5)[2]);
    let chart_of = |corners: [V; 3]| {
        let all = |sign: f32| corners.iter().all(|p| p[0] * sign >= from);
        if all(1.0) {
            2
        } else if all(-1.0) {
            3
        } else {
            usize::from(!corners.iter().all(|p| p[2] >= middle))
        }
    };
    let [front, back] = [false, true]
        .map(|is_back| panel(rest, look, &part, is_back, |corners| chart_of(corners) == usize::from(is_back)));
    part.lay_out(detail, &[front, back, left, right], |_, corners| chart_of(corners));
    part
}

/// The triangles of a top's front or back, laid flat.
fn panel(rest: &Rest, look: &Look, part: &Part, is_back: bool, has: impl Fn([V; 3]) -> bool) -> Chart<Place<'static>> {
    let detail = top_detail(look);
    let repeat = detail.repeat_m();
    let around = trunk(rest, look, detail);
    let (triangles, _) = part.indices.as_chunks::<3>();
    let triangles = triangles.iter().map(|corners| corners.map(|i| i as usize));
    let own: Vec<[usize; 3]> = triangles.filter(|corners| has(corners.map(|i| part.positions[i]))).collect();
    let mut flat = vec![[0.0; 2]; part.positions.len()];
    for &vertex in own.iter().flatten() {
        let [u, v] = (around.place)(vertex, part.positions[vertex], part.normals[vertex]);
        // On a back, u would begin again in its middle.
        let u = if is_back && u < 0.0 { u + around.period[0] } else { u };
        flat[vertex] = [u * repeat[0], v * repeat[1]];
    }
    // What closes the solid within neck band and hem is nobody's cloth, and would pull at that around it.
    let ends = top_ends(rest, look);
    let is_end = |vertex: usize| {
        let (p, n) = (part.positions[vertex], part.normals[vertex]);
        ends.iter().any(|&(point, out)| dot(n, out) > 0.75 && dot(sub(p, point), out) > -0.006 * rest.size)
    };
    let cloth: Vec<[usize; 3]> = own.into_iter().filter(|corners| !corners.iter().all(|&i| is_end(i))).collect();
    flatten(&part.positions, &cloth, &mut flat);
    let place: Place<'static> =
        Box::new(move |vertex, _, _| [0, 1].map(|axis: usize| flat[vertex][axis] / repeat[axis]));
    Chart { place, period: [f32::INFINITY; 2] }
}

/// The trousers: left and right.
pub(in super::super) fn trousers(rest: &Rest, piece: &Piece) -> Part {
    let mut part = piece.surface();
    let leg = |side| limb(["hip", "knee", "ankle"].map(|n| rest.side(side, n)), LEG * rest.size, Detail::Twill);
    part.lay_out(Detail::Twill, &SIDES.map(leg), |_, corners| usize::from(corners.iter().any(|p| p[0] < 0.0)));
    part
}

/// The belt, around the trunk.
pub(in super::super) fn belt(rest: &Rest, look: &Look, piece: &Piece) -> Part {
    let mut part = piece.surface();
    part.lay_out(Detail::Leather, &[trunk(rest, look, Detail::Leather)], |_, _| 0);
    part
}

/// The upper of a shoe: seen from above, with its sides folded out.
pub(in super::super) fn shoe(rest: &Rest, side: &str, piece: &Piece) -> Part {
    let mut part = piece.surface();
    let (ankle, repeat) = (rest.side(side, "ankle"), Detail::Leather.repeat_m());
    let place: Place<'_> = Box::new(move |_, p, n| {
        let down = ankle[1] - p[1];
        [(p[0] - ankle[0] + down * n[0]) / repeat[0], (p[2] - ankle[2] + down * n[2]) / repeat[1]]
    });
    part.lay_out(Detail::Leather, &[Chart { place, period: [f32::INFINITY; 2] }], |_, _| 0);
    part
}

/// Around the trunk, and up; over the shoulders up is inwards.
fn trunk(rest: &Rest, look: &Look, detail: Detail) -> Chart<Place<'static>> {
    let s = rest.size;
    let [wide, tall] = detail.repeat_m();
    let around = repeats(TAU * TRUNK * s, wide);
    let (pelvis, neck) = (rest.at("pelvis"), rest.at("neck"));
    let (collar, shoulders) = (rest.middle("collar")[1], (curve(look.build.width, 0.41) + 0.010) * s);
    let place: Place<'static> = Box::new(move |_, p, _| {
        let share = ((p[1] - pelvis[1]) / (neck[1] - pelvis[1]).max(1e-3)).clamp(0.0, 1.0);
        let from = sub(p, mix(pelvis, neck, share));
        let inwards = shoulders - hypot(from[0], FLAT * from[2]);
        let up = p[1] - neck[1] + ramp(collar - 0.02 * s, collar + 0.04 * s, p[1]) * inwards;
        [around * from[0].atan2(FLAT.sqrt() * from[2]) / TAU, -up / tall]
    });
    Chart { place, period: [around, f32::INFINITY] }
}

/// Around a limb with a joint in its middle, and along it.
fn limb([from, middle, to]: [V; 3], radius: f32, detail: Detail) -> Chart<Place<'static>> {
    let [wide, tall] = detail.repeat_m();
    let around = repeats(TAU * radius, wide);
    let axis = unit(sub(to, from));
    let (whole, first) = (length(sub(to, from)).max(1e-3), dot(sub(middle, from), axis));
    let side = unit(cross([0.0, 0.3, 1.0], axis));
    let up = cross(axis, side);
    let place: Place<'static> = Box::new(move |_, p, _| {
        let along = dot(sub(p, from), axis);
        let centre = if along < first {
            add(from, scale(sub(middle, from), along / first.max(1e-3)))
        } else {
            add(middle, scale(sub(to, middle), (along - first) / (whole - first).max(1e-3)))
        };
        let out = sub(p, centre);
        [around * dot(out, up).atan2(dot(out, side)) / TAU, along / tall]
    });
    Chart { place, period: [around, f32::INFINITY] }
}
