//! The clothed body: top, trousers, shoes and hands, each a separate solid.

use super::Part;
use super::detail::Detail;
use super::field::Join::{Cut, Displace, Union, Within};
use super::field::{Shape, Solid};
use super::look::{Build, Look, Top};
use super::nets::{self, Grid, even_planes, planes};
use super::rest::Rest;
use super::unwrap::{Chart, repeats};
use super::vector::{V, add, cross, curve, dot, hypot, length, mix, ramp, scale, sub, unit};
use std::f32::consts::{PI, TAU};

pub(super) mod charts;

pub(super) const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "pinky"];
const SIDES: [&str; 2] = ["left", "right"];

/// Heights above the pelvis joint, for a body of size 1: hips, pelvis, spine1, spine2, spine3, collars, neck.
const HEIGHTS: [f32; 7] = [-0.085, 0.0, 0.11, 0.24, 0.30, 0.41, 0.50];

/// A curve over those heights, mapped to the heights of this skeleton's joints.
fn trunk_curve(rest: &Rest, points: &[(f32, f32)]) -> Vec<(f32, f32)> {
    let at = [
        rest.middle("hip"),
        rest.at("pelvis"),
        rest.at("spine1"),
        rest.at("spine2"),
        rest.at("spine3"),
        rest.middle("collar"),
        rest.at("neck"),
    ]
    .map(|p| p[1]);
    let height = |y: f32| {
        let next = HEIGHTS.iter().position(|&known| known > y).unwrap_or(6).max(1);
        let share = (y - HEIGHTS[next - 1]) / (HEIGHTS[next] - HEIGHTS[next - 1]);
        at[next - 1] + share * (at[next] - at[next - 1])
    };
    let mut moved: Vec<(f32, f32)> = points.iter().map(|&(y, value)| (height(y), value * rest.size)).collect();
    // A skeleton may have joints at equal or swapped heights, but a curve needs ascending ones.
    for k in 1..moved.len() {
        moved[k].0 = moved[k].0.max(moved[k - 1].0 + 1e-3);
    }
    moved
}

/// A solid and the grid on which it is meshed.
pub(super) struct Piece {
    pub(super) solid: Solid,
    grid: Grid,
}

impl Piece {
    pub(super) fn surface(&self) -> Part {
        nets::surface(&self.solid, &self.grid)
    }

    /// Returns the grid's plane nearest to a coordinate on an axis. A boundary between triangles on either side of a
    /// plane is smooth.
    fn plane(&self, axis: usize, wanted: f32) -> f32 {
        let planes = self.grid.0[axis].iter().copied();
        planes.min_by(|a, b| (a - wanted).abs().total_cmp(&(b - wanted).abs())).unwrap_or(wanted)
    }
}

/// The trunk, wider than the body by `loose(height above the pelvis)` metres.
fn trunk(rest: &Rest, build: &Build, loose: impl Fn(f32) -> f32) -> Shape {
    let looser = |points: &[(f32, f32)]| -> Vec<(f32, f32)> {
        let wide: Vec<(f32, f32)> = points.iter().map(|&(y, value)| (y, value + loose(y))).collect();
        trunk_curve(rest, &wide)
    };
    let pelvis = rest.at("pelvis");
    let mut forward = trunk_curve(rest, build.forward);
    forward.iter_mut().for_each(|point| point.1 += pelvis[2]);
    Shape::Stack { x: pelvis[0], width: looser(build.width), depth: looser(build.depth), forward }
}

/// Ends of sleeves and trouser legs, as shares of forearm and shin, measured from wrist and ankle.
pub(super) const CUFF: f32 = 0.070;
const LEG_CUFF: f32 = 0.012;
/// Depths of their openings, as shares of the same bones.
pub(super) const OPENING: f32 = 0.055;
const LEG_OPENING: f32 = 0.04;

/// Height of the trousers' waist above the pelvis, in metres for a body of size 1.
const WAIST: f32 = 0.048;

/// Ease of the top over the body, by height above the pelvis.
fn top_ease(top: Top, y: f32) -> f32 {
    match top {
        Top::Sweater => 0.0125,
        Top::Shirt => 0.0025 + 0.0085 * ramp(0.05, 0.12, y),
    }
}

/// Ease of the trousers over the body.
fn trouser_ease(top: Top) -> f32 {
    match top {
        Top::Sweater => 0.0,
        Top::Shirt => 0.0095,
    }
}

/// End planes of the top's trunk, below and above, each as a point and the outward direction.
fn top_ends(rest: &Rest, look: &Look) -> [(V, V); 2] {
    let s = rest.size;
    let hem = match look.top {
        Top::Sweater => rest.middle("hip")[1] - 0.020 * s,
        Top::Shirt => rest.at("pelvis")[1] + 0.004 * s,
    };
    let neck = rest.at("neck");
    let crown = [0.0, neck[1] - 0.010 * s, neck[2] + 0.02 * s];
    [([0.0, hem, 0.0], [0.0, -1.0, 0.0]), (crown, [0.0, 0.958, 0.287])]
}

/// The top with its sleeves.
pub(super) fn top(rest: &Rest, look: &Look) -> Piece {
    let (s, build) = (rest.size, look.build);
    let (neck, pelvis) = (rest.at("neck"), rest.at("pelvis"));
    let mut solid = Solid::default().with(trunk(rest, build, |y| top_ease(look.top, y)), Union(0.0));
    for side in SIDES {
        solid = with_chest(solid, rest, build, side);
    }
    let [(hem, _), (crown, facing)] = top_ends(rest, look);
    let hem = hem[1];
    for side in SIDES {
        solid = with_sleeve(solid, rest, build, side);
        if look.top == Top::Sweater {
            // Covers the trousers at the seat and at the side.
            let side_of_hip = add(rest.side(side, "hip"), [0.0, -0.018 * s, -0.002 * s]);
            solid = solid
                .with(Shape::ball(seat(rest, side), 0.079 * s), Union(0.035 * s))
                .with(Shape::ball(side_of_hip, 0.0862 * s), Union(0.018 * s));
        }
    }
    solid = solid
        .with(Shape::Below { point: [0.0, hem, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.010 * s))
        .with(Shape::Below { point: crown, normal: facing }, Within(0.008 * s));
    for (x, y, z, height) in [(0.05, 0.02, 0.09, 0.0024), (-0.08, 0.06, 0.02, 0.0025), (0.09, 0.05, -0.07, 0.0022)] {
        let folds = Shape::Folds {
            centre: [x * s, pelvis[1] + y * s, pelvis[2] + z * s],
            reach: 0.15 * s,
            along: unit([0.35 * x.signum(), 1.0, 0.1]),
            length: 0.062 * s,
            height: height * s,
        };
        solid = solid.with(folds, Displace);
    }
    let wrist = rest.side("left", "wrist");
    let reach = wrist[0].abs().max(0.2 * s) + 0.02 * s;
    let elbow = rest.side("left", "elbow")[0].abs();
    let arms = rest.side("left", "shoulder")[1];
    let x = even_planes(reach, |x| {
        if x < 0.10 * s {
            0.0180 * s
        } else if (x - elbow).abs() < 0.07 * s || x < 0.24 * s {
            0.0140 * s
        } else {
            0.020 * s
        }
    });
    let y = planes(hem - 0.02 * s, crown[1] + 0.05 * s, |y| {
        if (y - arms).abs() < 0.08 * s {
            0.0125 * s
        } else if y < hem + 0.02 * s {
            0.009 * s
        } else {
            0.017 * s
        }
    });
    let z = planes(neck[2] - 0.17 * s, neck[2] + 0.21 * s, |_| 0.0148 * s);
    Piece { solid, grid: Grid([x, y, z]) }
}

/// The ribbed band at the sweater's neck, or the stand of the shirt's collar.
pub(super) fn neck_band(rest: &Rest, look: &Look) -> Part {
    const AROUND: usize = 56;
    let wide = 0.0555 * look.build.neck.max(0.93);
    let tall = if look.top == Top::Sweater { 0.0 } else { 0.010 };
    let profile = [
        (-0.016, 0.0090),
        (-0.004, 0.0052),
        (0.007 + tall, 0.0026),
        (0.0115 + tall, 0.0008),
        (0.0125 + tall, -0.0012),
        (0.0105 + tall, -0.0032),
        (0.004 + tall, -0.0040),
        (-0.010, -0.0034),
        (-0.020, 0.0020),
    ];
    let rib = if look.top == Top::Sweater { 0.0007 } else { 0.0 };
    let detail = if look.top == Top::Sweater { Detail::Knit } else { Detail::Weave };
    swept(rest, wide, AROUND, 0.0, detail, |_, spoke| {
        profile.map(|(up, out)| (up, out + if out > 0.0 && spoke % 2 == 0 { rib } else { 0.0 })).to_vec()
    })
}

/// The flaps of the shirt's collar, open at the front.
pub(super) fn collar(rest: &Rest, look: &Look) -> Part {
    swept(rest, 0.0555 * look.build.neck.max(0.93), 44, 0.16, Detail::StitchedWeave, |ahead, _| {
        // Collar points at the front.
        let point = (-(ahead / 0.42).powi(2)).exp();
        let (low, wide) = (-0.005 - 0.016 * point, 0.0140 + 0.006 * point);
        vec![
            (low, wide),
            (0.5 * low + 0.010, 0.62 * wide + 0.0022),
            (0.0205, 0.0042),
            (0.0235, 0.0014),
            (0.0215, -0.0006),
            (0.0165, 0.0006),
            (0.5 * low + 0.008, 0.62 * wide - 0.0012),
            (low - 0.0012, wide - 0.0022),
        ]
    })
}

/// Triangles of a band of `rows` outlines of `count` vertices; a band that does not close (`rows > around`) has ends.
fn band_triangles(around: usize, rows: usize, count: usize) -> Vec<u32> {
    let at =
        |spoke: usize, k: usize| u32::try_from(spoke % rows * count + k % count).expect("the figure has few vertices");
    let mut indices = Vec::new();
    for spoke in 0..around {
        for k in 0..count {
            indices.extend([at(spoke, k), at(spoke + 1, k), at(spoke + 1, k + 1)]);
            indices.extend([at(spoke, k), at(spoke + 1, k + 1), at(spoke, k + 1)]);
        }
    }
    if rows > around {
        // Bridges outside and inside, whose vertices are paired from both ends.
        for k in 0..count / 2 - 1 {
            let (low, high) = (k, k + 1);
            let (back, front) = (count - 1 - k, count - 2 - k);
            indices.extend([at(0, low), at(0, high), at(0, front), at(0, low), at(0, front), at(0, back)]);
            let end = rows - 1;
            indices.extend([at(end, low), at(end, front), at(end, high)]);
            indices.extend([at(end, low), at(end, back), at(end, front)]);
        }
    }
    indices
}

/// A band around the neck at a distance of `wide` metres. At each angle from the front, a closed outline of heights
/// and distances, which runs upwards on the outside. `gap` is half the angle that is left open at the front.
fn swept(
    rest: &Rest,
    wide: f32,
    around: usize,
    gap: f32,
    detail: Detail,
    outline: impl Fn(f32, usize) -> Vec<(f32, f32)>,
) -> Part {
    let (s, neck) = (rest.size, rest.at("neck"));
    let mut part = Part::default();
    let rows = if gap > 0.0 { around + 1 } else { around };
    let mut count = 0;
    let repeat = detail.repeat_m();
    let across = repeats(TAU * wide * s, repeat[0]);
    // Per vertex: the distance around the neck and along the outline, in repeats.
    let mut places = Vec::new();
    let mut long = Vec::new();
    for spoke in 0..rows {
        let angle = gap + (TAU - 2.0 * gap) * spoke as f32 / around as f32;
        let (sin, cos) = angle.sin_cos();
        let profile = outline(angle.min(TAU - angle) - gap, spoke);
        count = profile.len();
        let mut along = 0.0;
        for (k, &(up, out)) in profile.iter().enumerate() {
            let [before, after] = [profile[(k + count - 1) % count], profile[(k + 1) % count]];
            let z = (wide + out) * cos + 0.003;
            let place = [(wide + out) * sin, up - 0.30 * z + 0.003, z];
            part.positions.push(add(neck, scale(place, s)));
            let facing = [after.0 - before.0, before.1 - after.1];
            part.normals.push(unit([facing[0] * sin, facing[1], facing[0] * cos]));
            places.push([across * angle / TAU, along]);
            along += hypot(after.0 - up, after.1 - out) * s / repeat[1];
        }
        long.push(along);
    }
    part.indices = band_triangles(around, rows, count);
    // The outline wraps on the side facing the neck.
    let charts = [false, true].map(|is_last| {
        let (places, long) = (&places, &long);
        let place = move |vertex: usize, _: V, _: V| {
            let [u, v] = places[vertex];
            [u, if is_last && vertex.is_multiple_of(count) { long[vertex / count] } else { v }]
        };
        Chart { place, period: [across, f32::INFINITY] }
    });
    part.lay_out(detail, &charts, |corners, _| {
        let has = |k: usize| corners.iter().any(|vertex| vertex % count == k);
        usize::from(has(0) && has(count - 1))
    });
    part
}

/// Adds breast or bust, and the shoulder blade.
fn with_chest(solid: Solid, rest: &Rest, build: &Build, side: &str) -> Solid {
    let (s, sign) = (rest.size, if side == "left" { 1.0 } else { -1.0 });
    let [radius, out] = build.chest;
    let spine = rest.at("spine3");
    let middle = 0.5 * (rest.at("spine3")[1] + rest.middle("collar")[1]);
    let low = if out > 0.02 { 0.022 } else { 0.0 };
    let front = curve(build.depth, 0.33) * s + rest.at("pelvis")[2] - 0.008 * s;
    let centre = [spine[0] + sign * 0.066 * s, middle - low * s, front + (out - radius) * s];
    let radii = [radius * 1.18 * s, radius * s, radius * s];
    let blade = [spine[0] + sign * 0.072 * s, middle, rest.at("neck")[2] - 0.052 * s];
    solid
        .with(Shape::Ellipsoid { centre, radii }, Union(0.042 * s))
        .with(Shape::Ellipsoid { centre: blade, radii: [0.045 * s, 0.070 * s, 0.030 * s] }, Union(0.03 * s))
}

/// End of a sleeve, inside the cuff, which is a separate band.
fn sleeve_end(rest: &Rest, side: &str) -> V {
    let [elbow, wrist] = ["elbow", "wrist"].map(|n| rest.side(side, n));
    add(wrist, scale(sub(elbow, wrist), CUFF + 2.6 * OPENING))
}

/// Adds shoulder, sleeve and the sleeve's opening.
fn with_sleeve(solid: Solid, rest: &Rest, build: &Build, side: &str) -> Solid {
    let (s, r) = (rest.size, rest.size * build.arm);
    let [shoulder, elbow, neck] =
        ["shoulder", "elbow", "collar"].map(|n| if n == "collar" { rest.at("neck") } else { rest.side(side, n) });
    let sign = if side == "left" { 1.0 } else { -1.0 };
    let cuff = sleeve_end(rest, side);
    let deltoid = add(shoulder, [-0.014 * sign * s, -0.027 * s, 0.0]);
    let arm = add(shoulder, [0.0, -0.022 * s, 0.0]);
    let inner = add(mix(neck, shoulder, 0.30), [0.0, -0.062 * s, -0.002 * s]);
    let [nape, tip] = [
        add(mix(neck, shoulder, 0.22), [0.0, -0.022 * s, -0.006 * s]),
        add(mix(neck, shoulder, 0.82), [0.0, -0.012 * s, -0.006 * s]),
    ];
    let pit = |ahead: f32| [shoulder[0] - sign * 0.062 * s, shoulder[1] - 0.070 * s, shoulder[2] + ahead * s];
    let onto = |ahead: f32| add(mix(shoulder, elbow, 0.22), [0.0, -0.014 * s, ahead * s]);
    let folds = |centre: V, along: V, length: f32, height: f32, reach: f32| Shape::Folds {
        centre,
        reach: reach * s,
        along: unit(along),
        length: length * s,
        height: height * s,
    };
    solid
        .with(Shape::cone(inner, deltoid, 0.040 * s, build.shoulder * s), Union(0.030 * s))
        .with(Shape::cone(nape, tip, 0.031 * s, 0.0195 * s), Union(0.028 * s))
        .with(tube(arm, elbow, &[0.0400, 0.0455, 0.0470, 0.0455, 0.0430, 0.0410], r), Union(0.030 * s))
        .with(Shape::cone(pit(0.045), onto(0.014), 0.026 * s, 0.024 * r), Union(0.028 * s))
        .with(Shape::cone(pit(-0.040), onto(-0.014), 0.026 * s, 0.024 * r), Union(0.028 * s))
        .with(tube(elbow, cuff, &[0.0410, 0.0430, 0.0425, 0.0405, 0.0380, 0.0358], r), Union(0.016 * s))
        .with(folds(elbow, [sign, 0.25, 0.5], 0.034, 0.0024, 0.085), Displace)
        .with(folds(mix(elbow, cuff, 0.76), [sign, 0.3, -0.3], 0.030, 0.0022, 0.05), Displace)
        .with(
            folds(add(shoulder, [0.02 * sign * s, -0.04 * s, 0.03 * s]), [sign, 0.9, 0.2], 0.036, 0.0022, 0.07),
            Displace,
        )
}

/// The band at the end of a sleeve, open towards the hand.
pub(super) fn cuff(rest: &Rest, look: &Look, side: &str) -> Part {
    let r = rest.size * look.build.arm;
    let [elbow, wrist] = ["elbow", "wrist"].map(|n| rest.side(side, n));
    let bone = sub(elbow, wrist);
    let end = add(wrist, scale(bone, CUFF));
    let (floor, back) = (OPENING, 3.6 * OPENING);
    let profile = [
        (back, 0.0),
        (back, 0.0280),
        (0.93 * back, 0.0362),
        (0.85 * back, 0.0378),
        (0.5 * back, 0.0376),
        (0.010, 0.0366),
        (0.002, 0.0358),
        (0.0, 0.0342),
        (0.002, 0.0326),
        (0.010, 0.0316),
        (0.9 * floor, 0.0306),
        (floor, 0.0290),
        (floor, 0.0),
    ];
    let ribs = if look.top == Top::Sweater { 0.0007 * r } else { 0.0 };
    let detail = if look.top == Top::Sweater { Detail::Knit } else { Detail::StitchedWeave };
    lathe(end, bone, &profile.map(|(along, radius)| (along, radius * r)), ribs, detail)
}

/// The hem of a trouser leg, open towards the shoe.
pub(super) fn leg_hem(rest: &Rest, side: &str) -> Part {
    let s = rest.size;
    let [knee, ankle] = ["knee", "ankle"].map(|n| rest.side(side, n));
    let bone = sub(knee, ankle);
    let end = add(ankle, scale(bone, LEG_CUFF));
    let (floor, back) = (LEG_OPENING, 3.4 * LEG_OPENING);
    let profile = [
        (back, 0.0),
        (back, 0.0430),
        (0.9 * back, 0.0505),
        (0.75 * back, 0.0522),
        (0.4 * back, 0.0526),
        (0.006, 0.0524),
        (0.0008, 0.0516),
        (0.0, 0.0506),
        (0.0008, 0.0496),
        (0.006, 0.0490),
        (0.9 * floor, 0.0484),
        (floor, 0.0470),
        (floor, 0.0),
    ];
    lathe(end, bone, &profile.map(|(along, radius)| (along, radius * s)), 0.0, Detail::Twill)
}

/// Surface of revolution about the line from `origin` along `bone`. The profile holds positions as shares of the
/// bone, with radii; the surface is closed where the radius is 0. `ribs` is the depth of lengthwise grooves.
fn lathe(origin: V, bone: V, profile: &[(f32, f32)], ribs: f32, detail: Detail) -> Part {
    const AROUND: usize = 32;
    let (axis, long) = (unit(bone), length(bone));
    let side = unit(cross([0.0, 0.3, 1.0], axis));
    let up = cross(axis, side);
    let mut part = Part::default();
    let number = |at: usize| u32::try_from(at).expect("the figure has few vertices");
    let mut before: Vec<u32> = Vec::new();
    let repeat = detail.repeat_m();
    let across = repeats(TAU * profile.iter().fold(0.0, |most, point| point.1.max(most)), repeat[0]);
    // Per vertex: the distance around, and along the outline from the rim, in repeats.
    let mut places = Vec::new();
    let way = |k: usize| -> f32 {
        let pairs = profile[..=k].windows(2);
        pairs.map(|pair| hypot((pair[1].0 - pair[0].0) * long, pair[1].1 - pair[0].1)).sum()
    };
    let rim = (0..profile.len()).min_by(|&a, &b| profile[a].0.total_cmp(&profile[b].0)).map_or(0.0, way);
    for (k, &(along, radius)) in profile.iter().enumerate() {
        let [from, to] = [profile[k.saturating_sub(1)], profile[(k + 1).min(profile.len() - 1)]];
        let tangent = [(to.0 - from.0) * long, to.1 - from.1];
        let place = add(origin, scale(axis, along * long));
        let first = part.positions.len();
        let around = if radius == 0.0 { 1 } else { AROUND };
        for spoke in 0..around {
            let (sin, cos) = (TAU * spoke as f32 / AROUND as f32).sin_cos();
            let out = add(scale(side, cos), scale(up, sin));
            let groove = if spoke % 2 == 0 { ribs } else { -ribs };
            // Only the outside is ribbed.
            let radius = if tangent[0] < 0.0 && radius > 0.0 { radius + groove } else { radius };
            part.positions.push(add(place, scale(out, radius)));
            let facing = add(scale(out, -tangent[0]), scale(axis, tangent[1]));
            let pole = scale(axis, if k == 0 { 1.0 } else { -1.0 });
            part.normals.push(unit(if around == 1 { pole } else { facing }));
            places.push([across * spoke as f32 / AROUND as f32, (rim - way(k)) / repeat[1]]);
        }
        let ring: Vec<u32> = (0..AROUND).map(|spoke| number(first + spoke % around)).collect();
        for spoke in 0..if k == 0 { 0 } else { AROUND } {
            let next = (spoke + 1) % AROUND;
            for [a, b, c] in [[before[spoke], ring[spoke], ring[next]], [before[spoke], ring[next], before[next]]] {
                if a != b && b != c && a != c {
                    part.indices.extend([a, b, c]);
                }
            }
        }
        before = ring;
    }
    let place = |vertex: usize, _: V, _: V| places[vertex];
    part.lay_out(detail, &[Chart { place, period: [across, f32::INFINITY] }], |_, _| 0);
    part
}

/// The belt.
pub(super) fn belt(rest: &Rest, look: &Look) -> Piece {
    let (s, pelvis) = (rest.size, rest.at("pelvis"));
    let [top, bottom] = [WAIST - 0.004, WAIST - 0.036].map(|y| pelvis[1] + y * s);
    let edge = |y: f32, up: f32| Shape::Below { point: [0.0, y, 0.0], normal: [0.0, up, 0.0] };
    let solid = Solid::default()
        .with(trunk(rest, look.build, |_| trouser_ease(look.top) + 0.0042), Union(0.0))
        .with(edge(top, 1.0), Within(0.003 * s))
        .with(edge(bottom, -1.0), Within(0.003 * s));
    let wide = curve(look.build.width, WAIST) * s + 0.05 * s;
    let x = even_planes(wide, |_| 0.0135 * s);
    // The round edges need three rows each to be smooth; between them the belt is flat.
    let rows = [-0.010, -0.0045, -0.0015, 0.0015, 0.0045, 0.0100].map(|off| off * s);
    let y: Vec<f32> = rows.iter().map(|off| bottom + off).chain(rows.iter().rev().map(|off| top - off)).collect();
    let z = planes(pelvis[2] - 0.16 * s, pelvis[2] + 0.16 * s, |_| 0.0135 * s);
    Piece { solid, grid: Grid([x, y, z]) }
}

/// The belt's buckle and the shirt's buttons, placed on those solids.
pub(super) fn buttons(rest: &Rest, shirt: &Solid, belt: &Solid) -> (Part, Part) {
    let (s, pelvis, neck) = (rest.size, rest.at("pelvis"), rest.at("neck"));
    let ahead = |solid: &Solid, y: f32| onto(solid, [0.0, y, pelvis[2] + 0.25 * s], [0.0, 0.0, -1.0]);
    let frame = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let mut all = Part::default();
    for step in 0..5_u8 {
        let y = pelvis[1] + (WAIST + 0.03) * s + (neck[1] - pelvis[1] - 0.135 * s) * f32::from(step) / 4.0;
        join(&mut all, pebble(ahead(shirt, y), frame, [0.0055, 0.0055, 0.0022].map(|r| r * s), [4, 10]));
    }
    let waist = pelvis[1] + (WAIST - 0.020) * s;
    (all, pebble(ahead(belt, waist), frame, [0.021, 0.0155, 0.0035].map(|r| r * s), [6, 14]))
}

/// A tube with radii at equal steps.
fn tube(a: V, b: V, radii: &[f32], size: f32) -> Shape {
    let last = (radii.len() - 1) as f32;
    let steps = radii.iter().enumerate().map(|(k, radius)| (k as f32 / last, radius * size));
    Shape::Tube { a, b, radii: steps.collect() }
}

/// Centre of a buttock.
fn seat(rest: &Rest, side: &str) -> V {
    let (s, sign) = (rest.size, if side == "left" { 1.0 } else { -1.0 });
    add(rest.side(side, "hip"), [-0.012 * sign * s, -0.020 * s, -0.046 * s])
}

/// End of a trouser leg, inside the hem, which is a separate band.
fn leg_end(rest: &Rest, side: &str) -> V {
    let [knee, ankle] = ["knee", "ankle"].map(|n| rest.side(side, n));
    add(ankle, scale(sub(knee, ankle), LEG_CUFF + 2.4 * LEG_OPENING))
}

/// Height of the trousers' upper edge, which a belt may cover.
fn trouser_waist(rest: &Rest, look: &Look) -> f32 {
    rest.at("pelvis")[1] + (WAIST - if look.top == Top::Shirt { 0.012 } else { 0.0 }) * rest.size
}

/// Trousers.
pub(super) fn trousers(rest: &Rest, look: &Look) -> Piece {
    let (s, build) = (rest.size, look.build);
    let (hips, waist) = (rest.middle("hip"), trouser_waist(rest, look));
    let mut solid = Solid::default()
        .with(trunk(rest, build, |_| trouser_ease(look.top)), Union(0.0))
        .with(Shape::Below { point: [0.0, hips[1] - 0.020 * s, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.11 * s))
        .with(Shape::Below { point: [0.0, waist, 0.0], normal: [0.0, 1.0, 0.0] }, Within(0.006 * s));
    let mut low = f32::MAX;
    for side in SIDES {
        let sign = if side == "left" { 1.0 } else { -1.0 };
        let [hip, knee] = ["hip", "knee"].map(|n| rest.side(side, n));
        let t = s * build.thigh;
        let top = add(hip, [-0.002 * sign * s, -0.025 * s, -0.004 * s]);
        let cuff = leg_end(rest, side);
        let calf = mix(knee, cuff, 0.32);
        low = low.min(cuff[1]);
        let folds = |centre: V, along: V, length: f32, height: f32, reach: f32| Shape::Folds {
            centre,
            reach: reach * s,
            along: unit(along),
            length: length * s,
            height: height * s,
        };
        solid = solid
            .with(tube(top, knee, &[0.083, 0.0825, 0.0765, 0.0680, 0.0600, 0.0555], t), Union(0.036 * s))
            .with(Shape::ball(seat(rest, side), 0.066 * s), Union(0.035 * s))
            .with(tube(knee, cuff, &[0.0555, 0.0550, 0.0550, 0.0530, 0.0512, 0.0510], s), Union(0.02 * s))
            .with(Shape::ball(add(knee, [0.0, 0.006 * s, 0.024 * s]), 0.036 * s), Union(0.024 * s))
            .with(Shape::ball(add(calf, [0.0, 0.0, -0.022 * s]), 0.038 * s), Union(0.03 * s))
            .with(folds(add(knee, [0.0, 0.0, -0.03 * s]), [0.25 * sign, 1.0, 0.3], 0.052, 0.0022, 0.10), Displace)
            .with(folds(add(cuff, [0.0, 0.075 * s, 0.02 * s]), [0.2 * sign, 1.0, 0.35], 0.046, 0.0034, 0.080), Displace)
            .with(
                folds(add(hip, [-0.02 * sign * s, -0.04 * s, 0.07 * s]), [0.8 * sign, 0.9, 0.0], 0.050, 0.0016, 0.09),
                Displace,
            )
            .with(Shape::Below { point: cuff, normal: [0.0, -1.0, 0.0] }, Within(0.004 * s));
    }
    let wide = hips[0].abs() + 0.24 * s;
    let x = even_planes(wide, |_| 0.0170 * s);
    let y = planes(low - 0.03 * s, waist + 0.03 * s, |y| if y > hips[1] - 0.12 * s { 0.0170 * s } else { 0.0225 * s });
    let z = planes(hips[2] - 0.17 * s, hips[2] + 0.17 * s, |_| 0.0174 * s);
    Piece { solid, grid: Grid([x, y, z]) }
}

/// Height of the floor below the foot joints.
pub(super) fn floor(rest: &Rest) -> f32 {
    SIDES.map(|side| rest.side(side, "foot")[1]).into_iter().fold(f32::MAX, f32::min) - 0.022 * rest.size
}

/// Upper, sole and sock of a shoe.
pub(super) fn shoe(rest: &Rest, side: &str) -> [Piece; 3] {
    let s = rest.size;
    let sign = if side == "left" { 1.0 } else { -1.0 };
    let [ankle, foot, knee] = ["ankle", "foot", "knee"].map(|n| rest.side(side, n));
    let floor = floor(rest);
    let at = |p: V, x: f32, height: f32, ahead: f32| [p[0] + x * sign * s, floor + height * s, p[2] + ahead * s];
    let heel = at(ankle, 0.0, 0.040, -0.026);
    let ball = at(foot, 0.0, 0.034, 0.004);
    let toe = at(foot, -0.006, 0.030, 0.046);
    let mouth = add(ankle, [0.0, 0.004 * s, 0.0]);
    let grid = |low: f32, high: f32, step: [f32; 3]| {
        let x = planes(ankle[0].min(foot[0]) - 0.075 * s, ankle[0].max(foot[0]) + 0.075 * s, |_| step[0] * s);
        let z = planes(ankle[2] - 0.10 * s, foot[2] + 0.145 * s, |_| step[2] * s);
        Grid([x, planes(low, high, |_| step[1] * s), z])
    };
    let upper = Solid::default()
        .with(Shape::cone(heel, ball, 0.0355 * s, 0.0400 * s), Union(0.0))
        .with(Shape::Ellipsoid { centre: toe, radii: [0.0450 * s, 0.0285 * s, 0.0600 * s] }, Union(0.028 * s))
        .with(Shape::cone(mouth, at(mix(ankle, foot, 0.62), 0.0, 0.046, 0.0), 0.0370 * s, 0.0300 * s), Union(0.024 * s))
        .with(Shape::cone(mouth, at(ankle, 0.0, 0.045, -0.012), 0.0385 * s, 0.0370 * s), Union(0.020 * s))
        .with(
            Shape::cone(
                at(mix(ankle, foot, 0.30), 0.0, 0.088, 0.0),
                at(mix(ankle, foot, 0.80), 0.0, 0.062, 0.0),
                0.014 * s,
                0.015 * s,
            ),
            Union(0.012 * s),
        )
        .with(
            Shape::Below { point: add(mouth, [0.0, 0.006 * s, 0.0]), normal: unit([0.0, 1.0, -0.20]) },
            Within(0.004 * s),
        )
        .with(
            Shape::cone(add(mouth, [0.0, -0.012 * s, 0.0]), add(mouth, [0.0, 0.05 * s, 0.0]), 0.0310 * s, 0.0320 * s),
            Cut(0.004 * s),
        )
        .with(Shape::Below { point: [0.0, floor + 0.012 * s, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.004 * s));
    let flat = |p: V| [p[0], floor + 0.012 * s, p[2]];
    let sole = Solid::default()
        .with(Shape::cone(flat(heel), flat(ball), 0.0385 * s, 0.0425 * s), Union(0.0))
        .with(Shape::Ellipsoid { centre: flat(toe), radii: [0.0480 * s, 0.030 * s, 0.0635 * s] }, Union(0.030 * s))
        .with(Shape::Below { point: [0.0, floor + 0.023 * s, 0.0], normal: unit([0.0, 1.0, 0.05]) }, Within(0.004 * s))
        .with(Shape::Below { point: [0.0, floor, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.005 * s));
    let up = add(ankle, scale(sub(knee, ankle), LEG_CUFF + LEG_OPENING + 0.05));
    let sock =
        Solid::default().with(Shape::cone(add(ankle, [0.0, -0.015 * s, 0.0]), up, 0.0285 * s, 0.0310 * s), Union(0.0));
    [
        Piece { solid: upper, grid: grid(floor - 0.01 * s, ankle[1] + 0.06 * s, [0.0105, 0.0085, 0.0125]) },
        Piece { solid: sole, grid: grid(floor - 0.012 * s, floor + 0.045 * s, [0.0125, 0.0060, 0.0140]) },
        Piece { solid: sock, grid: grid(ankle[1] - 0.06 * s, up[1] + 0.05 * s, [0.0145, 0.0160, 0.0145]) },
    ]
}

/// Laces on the upper.
pub(super) fn laces(rest: &Rest, side: &str, upper: &Solid) -> Part {
    let s = rest.size;
    let [ankle, foot] = ["ankle", "foot"].map(|n| rest.side(side, n));
    let mut all = Part::default();
    for share in [0.42_f32, 0.60, 0.78, 0.96] {
        let middle = mix(ankle, foot, share);
        let points: Vec<V> = (-3..=3_i8)
            .map(|k| {
                let x = middle[0] + f32::from(k) * 0.0062 * s;
                let place = onto(upper, [x, ankle[1] + 0.10 * s, middle[2]], [0.0, -1.0, 0.0]);
                add(place, [0.0, if k.abs() == 3 { -0.002 * s } else { 0.0012 * s }, 0.0])
            })
            .collect();
        join(&mut all, cord(&points, 0.0028 * s));
    }
    all
}

/// Radii of the fingers, in the order of [`FINGERS`].
const FINGER_RADII: [f32; 5] = [0.0102, 0.0088, 0.0091, 0.0086, 0.0076];

/// Measures of one hand.
struct Hand<'a> {
    rest: &'a Rest,
    side: &'a str,
    wrist: V,
    /// Start of the forearm, inside the sleeve.
    arm: V,
    /// Scale of lengths.
    s: f32,
    /// Scale of thicknesses.
    r: f32,
}

/// The hand of one side, starting inside the sleeve.
pub(super) fn hand(rest: &Rest, side: &str, build: &Build) -> Piece {
    let (wrist, elbow) = (rest.side(side, "wrist"), rest.side(side, "elbow"));
    let s = hand_size(rest, side);
    let arm = add(wrist, scale(sub(elbow, wrist), CUFF + OPENING + 0.03));
    let hand = Hand { rest, side, wrist, arm, s, r: s * build.hand };
    Piece { solid: hand.webs(hand.fingers(hand.palm())), grid: hand.grid() }
}

impl Hand<'_> {
    fn at(&self, name: &str) -> V {
        self.rest.side(self.side, name)
    }

    fn low(&self, p: V, by: f32) -> V {
        add(p, [0.0, by * self.r, 0.0])
    }

    fn palm(&self) -> Solid {
        let &Self { wrist, arm, s, r, .. } = self;
        let mut palm =
            Solid::default().with(Shape::cone(self.low(arm, 0.0), wrist, 0.0275 * r, 0.0235 * r), Union(0.0));
        for (finger, radius) in FINGERS.iter().zip(FINGER_RADII) {
            let knuckle = self.at(&format!("{finger}1"));
            let (from, to) = match *finger {
                "thumb" => (mix(wrist, knuckle, 0.35), knuckle),
                _ => (self.low(mix(wrist, knuckle, 0.22), -0.002), self.low(mix(wrist, knuckle, 0.93), -0.0015)),
            };
            let (wide, end) = if *finger == "thumb" { (0.0160, 0.0145) } else { (0.0145, radius + 0.0030) };
            palm = palm.with(Shape::cone(from, to, wide * r, end * r), Union(0.013 * s));
        }
        // Ball of the thumb, and edge of the hand.
        let [thumb, index, pinky, middle] = ["thumb1", "index1", "pinky1", "middle1"].map(|name| self.at(name));
        let low = |p: V, by: f32| self.low(p, by);
        let ball = (low(mix(wrist, thumb, 0.55), -0.008), low(mix(thumb, index, 0.35), -0.010));
        let edge = (low(mix(wrist, pinky, 0.25), -0.007), low(mix(wrist, pinky, 0.75), -0.006));
        let hollow = low(mix(wrist, middle, 0.58), -0.0205);
        palm.with(Shape::cone(ball.0, ball.1, 0.0125 * r, 0.0100 * r), Union(0.014 * s))
            .with(Shape::cone(edge.0, edge.1, 0.0115 * r, 0.0100 * r), Union(0.012 * s))
            .with(Shape::Ellipsoid { centre: hollow, radii: [0.024 * r, 0.0075 * r, 0.016 * r] }, Cut(0.012 * s))
    }

    fn fingers(&self, mut palm: Solid) -> Solid {
        let s = self.s;
        for (finger, radius) in FINGERS.iter().zip(FINGER_RADII) {
            let [a, b, c] = [1, 2, 3].map(|bone| self.at(&format!("{finger}{bone}")));
            let tip = self.rest.finger_tip(self.side, finger);
            let r = radius * self.r;
            let (blend, root) = if *finger == "thumb" { (0.012 * s, 1.25) } else { (0.004 * s, 1.06) };
            let shaft = |a, b, radii: &[f32]| {
                let radii: Vec<f32> = radii.iter().map(|x| x * r).collect();
                tube(a, b, &radii, 1.0)
            };
            palm = palm
                .with(shaft(a, b, &[root, 1.02, 0.96, 1.0]), Union(blend))
                .with(shaft(b, c, &[1.02, 0.92, 0.88, 0.93]), Union(0.002 * s))
                .with(shaft(c, tip, &[0.95, 0.93, 0.90, 0.76]), Union(0.002 * s))
                // Knuckles on the back, pads on the front.
                .with(Shape::ball(add(b, [0.0, 0.30 * r, 0.0]), 0.80 * r), Union(0.003 * s))
                .with(Shape::ball(add(mix(c, tip, 0.5), [0.0, -0.22 * r, 0.0]), 0.80 * r), Union(0.003 * s));
            if *finger != "thumb" {
                palm = palm.with(Shape::ball(add(a, [0.0, 0.42 * r, 0.0]), 0.85 * r), Union(0.005 * s));
            }
        }
        palm
    }

    /// Adds the webs between the fingers, and between thumb and index finger.
    fn webs(&self, mut palm: Solid) -> Solid {
        let &Self { wrist, s, r, .. } = self;
        for pair in ["index", "middle", "ring", "pinky"].windows(2) {
            let web = |share: f32| {
                let knuckle = |k: usize| self.at(&format!("{}1", pair[k]));
                let [p, q] = [0, 1].map(|k| mix(knuckle(k), self.at(&format!("{}2", pair[k])), share));
                self.low(mix(p, q, 0.5), -0.002)
            };
            palm = palm.with(Shape::cone(web(-0.45), web(0.22), 0.0085 * r, 0.0050 * r), Union(0.007 * s));
        }
        let [thumb, next, index] = ["thumb1", "thumb2", "index1"].map(|name| self.at(name));
        palm.with(
            Shape::cone(mix(thumb, next, 0.35), mix(wrist, index, 0.80), 0.0075 * r, 0.0085 * r),
            Union(0.016 * s),
        )
    }

    fn grid(&self) -> Grid {
        let &Self { rest, side, wrist, arm, s, .. } = self;
        let ends = FINGERS.iter().flat_map(|f| [self.at(&format!("{f}1")), rest.finger_tip(side, f)]);
        let points: Vec<V> = ends.chain([arm, wrist]).collect();
        let range = |axis: usize, beyond: f32| {
            let low = points.iter().map(|p| p[axis]).fold(f32::MAX, f32::min) - beyond * s;
            let high = points.iter().map(|p| p[axis]).fold(f32::MIN, f32::max) + beyond * s;
            (low, high)
        };
        let (x, y, z) = (range(0, 0.048), range(1, 0.044), range(2, 0.044));
        // Measured from the wrist, so the other hand's planes are mirrored. Denser at the round fingertips.
        let last = self.at("pinky3")[0].abs();
        let step = |x: f32| if x > last - 0.002 * s { 0.0056 * s } else { 0.0076 * s };
        let x = if wrist[0] < 0.0 {
            planes(-x.1, -x.0, step).into_iter().rev().map(|x| -x).collect()
        } else {
            planes(x.0, x.1, step)
        };
        Grid([x, planes(y.0, y.1, |_| 0.0048 * s), planes(z.0, z.1, |_| 0.0048 * s)])
    }
}

/// Size of the hand relative to the one for which the measures are given.
fn hand_size(rest: &Rest, side: &str) -> f32 {
    (rest.between(&format!("{side}_wrist"), &format!("{side}_middle1")) / 0.095).clamp(0.3, 3.0)
}

/// The nail of one finger, placed on the hand.
pub(super) fn nail(rest: &Rest, side: &str, finger: &str, build: &Build, hand: &Solid) -> Part {
    let r = hand_size(rest, side) * build.hand;
    let sign = if side == "left" { 1.0 } else { -1.0 };
    let last = rest.side(side, &format!("{finger}3"));
    let tip = rest.finger_tip(side, finger);
    let along = unit(sub(tip, last));
    // The thumb's nail faces away from the fingers.
    let back = if finger == "thumb" { [-0.55 * sign, 0.80, 0.25] } else { [0.0, 1.0, 0.0] };
    let out = unit(sub(back, scale(along, dot(back, along))));
    let across = cross(out, along);
    let middle = mix(last, tip, 0.70);
    let place = onto(hand, add(middle, scale(out, 0.03 * r)), scale(out, -1.0));
    let (long, wide) = if finger == "thumb" { (0.0068, 0.0058) } else { (0.0058, 0.0046) };
    let tilted = unit(add(along, scale(out, -0.10)));
    let up = cross(tilted, across);
    let up = if dot(up, out) < 0.0 { scale(up, -1.0) } else { up };
    pebble(add(place, scale(out, -0.0006 * r)), [tilted, across, up], [long * r, wide * r, 0.0016 * r], [5, 10])
}

/// Intersection of a ray from outside with a solid.
fn onto(solid: &Solid, from: V, along: V) -> V {
    let mut at = from;
    for _ in 0..80 {
        let field = solid.at(at);
        if field < 1e-4 {
            break;
        }
        at = add(at, scale(along, 0.7 * field));
    }
    at
}

/// An ellipsoid along three axes.
fn pebble(centre: V, axes: [V; 3], radii: V, [rings, around]: [usize; 2]) -> Part {
    let mut part = Part::default();
    let handed = dot(cross(axes[0], axes[1]), axes[2]) > 0.0;
    let push = |part: &mut Part, q: V| {
        let along = |by: V| add(add(scale(axes[0], by[0]), scale(axes[1], by[1])), scale(axes[2], by[2]));
        part.positions.push(add(centre, along(std::array::from_fn(|i| q[i] * radii[i]))));
        part.normals.push(unit(along(std::array::from_fn(|i| q[i] / radii[i].max(1e-9)))));
    };
    push(&mut part, [0.0, 0.0, 1.0]);
    for ring in 1..rings {
        let (out, up) = (PI * ring as f32 / rings as f32).sin_cos();
        for k in 0..around {
            let (sin, cos) = (TAU * k as f32 / around as f32).sin_cos();
            push(&mut part, [out * cos, out * sin, up]);
        }
    }
    push(&mut part, [0.0, 0.0, -1.0]);
    let number = |at: usize| u32::try_from(at).expect("the figure has few vertices");
    let at = |ring: usize, k: usize| number(1 + (ring - 1) * around + k % around);
    let last = number(part.positions.len() - 1);
    let mut triangle = |[a, b, c]: [u32; 3]| part.indices.extend(if handed { [a, b, c] } else { [a, c, b] });
    for k in 0..around {
        triangle([0, at(1, k), at(1, k + 1)]);
        triangle([last, at(rings - 1, k + 1), at(rings - 1, k)]);
        for ring in 1..rings - 1 {
            triangle([at(ring, k), at(ring + 1, k), at(ring + 1, k + 1)]);
            triangle([at(ring, k), at(ring + 1, k + 1), at(ring, k + 1)]);
        }
    }
    part
}

/// A round cord through points, with closed ends.
fn cord(points: &[V], radius: f32) -> Part {
    const AROUND: usize = 6;
    let mut part = Part::default();
    for (k, &place) in points.iter().enumerate() {
        let along = unit(sub(points[(k + 1).min(points.len() - 1)], points[k.saturating_sub(1)]));
        let side = unit(cross([0.0, 0.3, 1.0], along));
        let up = cross(along, side);
        for spoke in 0..AROUND {
            let (sin, cos) = (TAU * spoke as f32 / AROUND as f32).sin_cos();
            let out = add(scale(side, cos), scale(up, sin));
            part.positions.push(add(place, scale(out, radius)));
            part.normals.push(out);
        }
    }
    let number = |at: usize| u32::try_from(at).expect("the figure has few vertices");
    let at = |row: usize, k: usize| number(row * AROUND + k % AROUND);
    for row in 1..points.len() {
        for k in 0..AROUND {
            part.indices.extend([at(row - 1, k), at(row - 1, k + 1), at(row, k + 1)]);
            part.indices.extend([at(row - 1, k), at(row, k + 1), at(row, k)]);
        }
    }
    for k in 1..AROUND - 1 {
        let end = points.len() - 1;
        part.indices.extend([at(0, 0), at(0, k + 1), at(0, k)]);
        part.indices.extend([at(end, 0), at(end, k), at(end, k + 1)]);
    }
    part
}

fn join(all: &mut Part, part: Part) {
    let first = u32::try_from(all.positions.len()).expect("the figure has few vertices");
    all.positions.extend(part.positions);
    all.normals.extend(part.normals);
    all.indices.extend(part.indices.iter().map(|i| i + first));
}
