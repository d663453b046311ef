//! Texture layout of clothes for their relief ([`crate::unwrap`]).
//!
//! Tops and trousers are laid out like the flat cloth that clothes are cut from. The seams are those of real clothes:
//! at the start of sleeves and along their undersides, between front and back at the sides, on the shoulders and
//! along the legs, and in the middle of the trousers. The belt goes around in whole repeats.

use super::{Piece, SIDES, leg_end, sleeve_end, top_ends, trouser_waist};
use crate::Part;
use crate::detail::Detail;
use crate::look::{Look, Top};
use crate::rest::Rest;
use crate::unwrap::{Chart, flatten, repeats};
use crate::vector::{V, add, cross, curve, dot, hypot, mix, ramp, scale, sub, unit};
use std::f32::consts::{PI, TAU};

/// Mean radius of the trunk, and its ratio of width to depth.
const TRUNK: f32 = 0.128;
const FLAT: f32 = 1.45;
/// Approximate mean radius of a limb, for the initial layout of its circumference.
const RADIUS: f32 = 0.055;

type Place<'a> = Box<dyn Fn(usize, V, V) -> [f32; 2] + 'a>;

fn top_detail(look: &Look) -> Detail {
    if look.top == Top::Sweater { Detail::Knit } else { Detail::Weave }
}

/// The top: front, back, left sleeve, right sleeve.
pub(in super::super) fn top(rest: &Rest, look: &Look, piece: &Piece) -> Part {
    let s = rest.size;
    let detail = top_detail(look);
    let mut part = piece.surface();
    let from = piece.plane(0, rest.side("left", "shoulder")[0].abs() - 0.012 * s);
    let middle = |from: V, to: V| piece.plane(2, mix(from, to, 0.5)[2]);
    let of_trunk = middle(rest.at("spine3"), rest.middle("shoulder"));
    let of_sleeve = middle(rest.middle("shoulder"), rest.middle("wrist"));
    let chart_of = |corners: [V; 3]| {
        let all = |sign: f32| corners.iter().all(|p| p[0] * sign >= from);
        let is_back = |middle: f32| usize::from(!corners.iter().all(|p| p[2] >= middle));
        if all(1.0) {
            2 + is_back(of_sleeve)
        } else if all(-1.0) {
            4 + is_back(of_sleeve)
        } else {
            is_back(of_trunk)
        }
    };
    let panels = [0, 1].map(|number| panel(rest, look, &part, number == 1, |corners| chart_of(corners) == number));
    let sleeves = SIDES.iter().zip([2, 4]).flat_map(|(side, first)| {
        let sleeve = Limb::new(["shoulder", "elbow", "wrist"].map(|n| rest.side(side, n)), [0.0, 1.0, 0.0]);
        let halves = [first, first + 1].map(|number| triangles_of(&part, |corners| chart_of(corners) == number));
        let end = sleeve_end(rest, side);
        // Beyond its end, a sleeve is inside the cuff.
        let is_end = |vertex: usize| dot(sub(part.positions[vertex], end), sleeve.axis) > 0.0;
        sleeve.lay_flat(&part, detail, halves, Seams::One, is_end)
    });
    let charts: Vec<_> = panels.into_iter().chain(sleeves).collect();
    part.lay_out(detail, &charts, |_, corners| chart_of(corners));
    part
}

/// The triangles of a top's front or back, laid flat.
fn panel(rest: &Rest, look: &Look, part: &Part, is_back: bool, has: impl Fn([V; 3]) -> bool) -> Chart<Place<'static>> {
    let detail = top_detail(look);
    let repeat = detail.repeat_m();
    let around = trunk(rest, look, detail);
    let own = triangles_of(part, has);
    let mut flat = vec![[0.0; 2]; part.positions.len()];
    for &vertex in own.iter().flatten() {
        let [u, v] = (around.place)(vertex, part.positions[vertex], part.normals[vertex]);
        // On a back, u would wrap in the middle.
        let u = if is_back && u < 0.0 { u + around.period[0] } else { u };
        flat[vertex] = [u * repeat[0], v * repeat[1]];
    }
    let ends = top_ends(rest, look);
    lay_flat(&part.positions, own, |vertex| is_end(part, vertex, &ends, rest.size), &mut flat);
    flat_chart(flat, detail)
}

fn triangles_of(part: &Part, has: impl Fn([V; 3]) -> bool) -> Vec<[usize; 3]> {
    let (triangles, _) = part.indices.as_chunks::<3>();
    let triangles = triangles.iter().map(|corners| corners.map(|i| i as usize));
    triangles.filter(|corners| has(corners.map(|i| part.positions[i]))).collect()
}

/// Whether a vertex closes a solid at one of its ends, inside neck band or hem. `ends` are planes, each as a point
/// and the outward direction.
fn is_end(part: &Part, vertex: usize, ends: &[(V, V)], size: f32) -> bool {
    let (p, n) = (part.positions[vertex], part.normals[vertex]);
    ends.iter().any(|&(point, out)| dot(n, out) > 0.75 && dot(sub(p, point), out) > -0.006 * size)
}

/// Lays triangles flat, except those with all corners on an end: they are not part of the cloth and would distort it.
/// Their vertices are placed at the edge of the adjacent cloth.
fn lay_flat(positions: &[V], triangles: Vec<[usize; 3]>, is_end: impl Fn(usize) -> bool, flat: &mut [[f32; 2]]) {
    let (mut ends, cloth): (Vec<_>, Vec<_>) =
        triangles.into_iter().partition(|corners| corners.iter().all(|&vertex| is_end(vertex)));
    flatten(positions, &cloth, flat);
    let mut is_placed = vec![false; positions.len()];
    cloth.iter().flatten().for_each(|&vertex| is_placed[vertex] = true);
    loop {
        let before = ends.len();
        ends.retain(|corners| {
            let Some(&beside) = corners.iter().find(|&&vertex| is_placed[vertex]) else { return true };
            for &vertex in corners.iter().filter(|&&vertex| vertex != beside) {
                if !is_placed[vertex] {
                    (is_placed[vertex], flat[vertex]) = (true, flat[beside]);
                }
            }
            false
        });
        if ends.len() == before {
            return;
        }
    }
}

/// A chart from `flat`, the vertices' positions on the plane in metres.
fn flat_chart(flat: Vec<[f32; 2]>, detail: Detail) -> Chart<Place<'static>> {
    let repeat = detail.repeat_m();
    let place: Place<'static> =
        Box::new(move |vertex, _, _| [0, 1].map(|axis: usize| flat[vertex][axis] / repeat[axis]));
    Chart { place, period: [f32::INFINITY; 2] }
}

/// The trousers: front and back of the left and the right leg, each up to the waist.
pub(in super::super) fn trousers(rest: &Rest, look: &Look, piece: &Piece) -> Part {
    let mut part = piece.surface();
    let middle = piece.plane(2, mix(rest.middle("hip"), rest.middle("ankle"), 0.5)[2]);
    let chart_of = |corners: [V; 3]| {
        let is_right = corners.iter().any(|p| p[0] < 0.0);
        let is_back = !corners.iter().all(|p| p[2] >= middle);
        2 * usize::from(is_right) + usize::from(is_back)
    };
    let waist = ([0.0, trouser_waist(rest, look), 0.0], [0.0, 1.0, 0.0]);
    let charts: Vec<_> = SIDES
        .iter()
        .zip([0, 2])
        .flat_map(|(side, first)| {
            let leg = Limb::new(["hip", "knee", "ankle"].map(|n| rest.side(side, n)), [1.0, 0.0, 0.0]);
            let halves = [first, first + 1].map(|number| triangles_of(&part, |corners| chart_of(corners) == number));
            let ends = [waist, (leg_end(rest, side), [0.0, -1.0, 0.0])];
            leg.lay_flat(&part, Detail::Twill, halves, Seams::Both, |vertex| is_end(&part, vertex, &ends, rest.size))
        })
        .collect();
    part.lay_out(Detail::Twill, &charts, |_, corners| chart_of(corners));
    part
}

/// The belt, laid out around the trunk.
pub(in super::super) fn belt(rest: &Rest, look: &Look, piece: &Piece) -> Part {
    let mut part = piece.surface();
    part.lay_out(Detail::Leather, &[trunk(rest, look, Detail::Leather)], |_, _| 0);
    part
}

/// The upper of a shoe, seen from above with its sides folded out.
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

/// Chart around the trunk and upwards; over the shoulders, upwards becomes inwards.
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

/// Seams between front and back of a limb's cloth.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Seams {
    /// At half a turn; on the opposite side the cloth is continuous.
    One,
    /// At half a turn and at 0.
    Both,
}

/// Coordinates around and along a limb with a joint in its middle.
struct Limb {
    joints: [V; 3],
    axis: V,
    /// Directions of angle 0 and of a quarter turn.
    quarters: [V; 2],
}

impl Limb {
    /// `from` is a point approximately in the direction of angle 0.
    fn new(joints: [V; 3], from: V) -> Self {
        let axis = unit(sub(joints[2], joints[0]));
        let side = unit(sub(from, scale(axis, dot(from, axis))));
        Self { joints, axis, quarters: [side, cross(axis, side)] }
    }

    /// Half turns around, -1 to 1, and metres along.
    fn at(&self, p: V) -> [f32; 2] {
        let [first, middle, last] = self.joints;
        let (whole, half) = (dot(sub(last, first), self.axis).max(1e-3), dot(sub(middle, first), self.axis).max(1e-3));
        let along = dot(sub(p, first), self.axis);
        let centre = if along < half {
            add(first, scale(sub(middle, first), along / half))
        } else {
            add(middle, scale(sub(last, middle), (along - half) / (whole - half).max(1e-3)))
        };
        let out = sub(p, centre);
        let [x, y] = self.quarters.map(|quarter| dot(out, quarter));
        [y.atan2(x) / PI, along]
    }

    /// Lays front and back of the cloth flat, whose triangles are `halves`, and returns their charts.
    fn lay_flat(
        &self,
        part: &Part,
        detail: Detail,
        halves: [Vec<[usize; 3]>; 2],
        seams: Seams,
        is_end: impl Fn(usize) -> bool,
    ) -> [Chart<Place<'static>>; 2] {
        let count = part.positions.len();
        let turns: Vec<f32> = part.positions.iter().map(|&p| self.at(p)[0]).collect();
        // At a seam, vertices shared by front and back have two positions.
        let of_back =
            |vertex: usize| if seams == Seams::One && turns[vertex].abs() < 0.5 { vertex } else { count + vertex };
        let mut flat = vec![[0.0; 2]; 2 * count];
        let ahead = self.quarters[1][2].signum();
        for (own, is_back) in halves.iter().zip([false, true]) {
            for &vertex in own.iter().flatten() {
                let [turn, along] = self.at(part.positions[vertex]);
                // Each half stays on its side of the seam.
                let side = if is_back { -ahead } else { ahead };
                let turn = if turn * side < -0.5 { turn + 2.0 * side } else { turn };
                flat[if is_back { of_back(vertex) } else { vertex }] = [PI * RADIUS * turn, along];
            }
        }
        let [mut cloth, back] = halves;
        cloth.extend(back.into_iter().map(|corners| corners.map(of_back)));
        lay_flat(&part.positions.repeat(2), cloth, |vertex| is_end(vertex % count), &mut flat);
        let on_back = (0..count).map(|vertex| flat[of_back(vertex)]).collect();
        flat.truncate(count);
        [flat, on_back].map(|flat| flat_chart(flat, detail))
    }
}
