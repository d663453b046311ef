//! The clothed body: sweater, trousers, shoes and hands, each a solid of its own.

use super::Part;
use super::field::Join::{Union, Within};
use super::field::{Shape, Solid};
use super::nets::{Grid, even_planes, planes, surface};
use super::rest::Rest;
use super::vector::{V, add, mix, scale, sub};

pub(super) const FINGERS: [&str; 5] = ["thumb", "index", "middle", "ring", "pinky"];
const SIDES: [&str; 2] = ["left", "right"];

/// Heights of a body of size 1 over its pelvis joint: hips, pelvis, spine1, spine2, spine3,
/// collars, neck.
const HEIGHTS: [f32; 7] = [-0.085, 0.0, 0.11, 0.24, 0.30, 0.41, 0.50];

/// A curve over those heights, moved to where this skeleton has them.
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
    // A skeleton may have joints at one height or the other way round; a curve needs its heights in
    // order.
    for k in 1..moved.len() {
        moved[k].0 = moved[k].0.max(moved[k - 1].0 + 1e-3);
    }
    moved
}

/// The trunk, `loose` metres wider than the body.
fn trunk(rest: &Rest, loose: f32) -> Shape {
    let width = [
        (-0.15, 0.150),
        (-0.09, 0.158),
        (0.0, 0.150),
        (0.09, 0.131),
        (0.16, 0.131),
        (0.26, 0.148),
        (0.34, 0.158),
        (0.40, 0.158),
        (0.445, 0.135),
        (0.48, 0.085),
        (0.52, 0.060),
    ];
    let depth = [
        (-0.15, 0.100),
        (-0.09, 0.106),
        (0.0, 0.102),
        (0.10, 0.088),
        (0.20, 0.096),
        (0.29, 0.106),
        (0.36, 0.104),
        (0.42, 0.088),
        (0.47, 0.068),
        (0.52, 0.056),
    ];
    let forward = [(-0.10, -0.012), (0.05, -0.004), (0.20, -0.004), (0.30, 0.0), (0.40, -0.018), (0.52, -0.032)];
    let looser = |points: &[(f32, f32)]| -> Vec<(f32, f32)> {
        trunk_curve(rest, points).into_iter().map(|(y, value)| (y, value + loose)).collect()
    };
    let pelvis = rest.at("pelvis");
    let mut forward = trunk_curve(rest, &forward);
    forward.iter_mut().for_each(|point| point.1 += pelvis[2]);
    Shape::Stack { x: pelvis[0], width: looser(&width), depth: looser(&depth), forward }
}

/// Sweater: trunk and sleeves.
pub(super) fn sweater(rest: &Rest) -> Part {
    let s = rest.size;
    let (hips, neck) = (rest.middle("hip"), rest.at("neck"));
    let mut solid = Solid::default().with(trunk(rest, 0.012 * s), Union(0.0));
    let hem = [0.0, hips[1] - 0.012 * s, 0.0];
    let top = [0.0, neck[1] - 0.008 * s, neck[2] + 0.02 * s];
    solid = solid
        .with(Shape::Below { point: hem, normal: [0.0, -1.0, 0.0] }, Within(0.02 * s))
        .with(Shape::Below { point: top, normal: [0.0, 0.975, 0.22] }, Within(0.03 * s));
    let seam = [neck[0], neck[1] - 0.010 * s, neck[2] - 0.001 * s];
    for side in SIDES {
        let [shoulder, elbow, wrist] = ["shoulder", "elbow", "wrist"].map(|n| rest.side(side, n));
        let cuff = add(wrist, scale(sub(elbow, wrist), 0.05));
        let inner = mix(neck, shoulder, 0.2);
        solid = solid
            .with(Shape::cone(add(inner, [0.0, -0.045 * s, 0.0]), shoulder, 0.046 * s, 0.049 * s), Union(0.05 * s))
            .with(tube(shoulder, elbow, &[0.0525, 0.0525, 0.0490, 0.0455, 0.0440], s), Union(0.07 * s))
            .with(tube(elbow, cuff, &[0.0440, 0.0445, 0.0405, 0.0365, 0.0345], s), Union(0.02 * s));
    }
    solid = solid.with(
        Shape::Ring { centre: seam, radii: [0.0600 * s, 0.0590 * s], slope: -0.22, thick: 0.0095 * s },
        Union(0.004 * s),
    );
    let reach = rest.side("left", "wrist")[0].abs().max(0.2 * s) + 0.06 * s;
    let arms = rest.side("left", "shoulder")[1];
    let x = even_planes(reach, |x| if x < 0.2 * s { 0.019 * s } else { 0.025 * s });
    let y =
        planes(
            hem[1] - 0.03 * s,
            top[1] + 0.09 * s,
            |y| {
                if (y - arms).abs() < 0.085 * s { 0.0135 * s } else { 0.021 * s }
            },
        );
    let z = planes(neck[2] - 0.17 * s, neck[2] + 0.21 * s, |_| 0.0150 * s);
    surface(&solid, &Grid([x, y, z]))
}

/// A tube with radii at equal steps.
fn tube(a: V, b: V, radii: &[f32], size: f32) -> Shape {
    let last = (radii.len() - 1) as f32;
    let steps = radii.iter().enumerate().map(|(k, radius)| (k as f32 / last, radius * size));
    Shape::Tube { a, b, radii: steps.collect() }
}

/// Trousers.
pub(super) fn trousers(rest: &Rest) -> Part {
    let s = rest.size;
    let hips = rest.middle("hip");
    let waist = rest.at("pelvis")[1] + 0.05 * s;
    let mut solid = Solid::default()
        .with(trunk(rest, 0.0), Union(0.0))
        .with(Shape::Below { point: [0.0, hips[1] - 0.055 * s, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.06 * s))
        .with(Shape::Below { point: [0.0, waist, 0.0], normal: [0.0, 1.0, 0.0] }, Within(0.01 * s));
    let mut low = f32::MAX;
    for side in SIDES {
        let [hip, knee, ankle] = ["hip", "knee", "ankle"].map(|n| rest.side(side, n));
        let top = add(hip, [0.0, -0.02 * s, -0.004 * s]);
        let cuff = add(ankle, scale(sub(knee, ankle), 0.06));
        low = low.min(cuff[1]);
        solid = solid
            .with(tube(top, knee, &[0.082, 0.083, 0.076, 0.067, 0.062], s), Union(0.025 * s))
            .with(tube(knee, cuff, &[0.062, 0.063, 0.059, 0.054, 0.052], s), Union(0.02 * s))
            .with(Shape::Below { point: cuff, normal: [0.0, -1.0, 0.0] }, Within(0.012 * s));
    }
    let wide = hips[0].abs() + 0.24 * s;
    let x = even_planes(wide, |_| 0.0165 * s);
    let y = planes(low - 0.05 * s, waist + 0.04 * s, |y| if y > hips[1] - 0.12 * s { 0.019 * s } else { 0.032 * s });
    let z = planes(hips[2] - 0.17 * s, hips[2] + 0.17 * s, |_| 0.0165 * s);
    surface(&solid, &Grid([x, y, z]))
}

/// The height of the floor under the foot joints.
pub(super) fn floor(rest: &Rest) -> f32 {
    SIDES.map(|side| rest.side(side, "foot")[1]).into_iter().fold(f32::MAX, f32::min) - 0.022 * rest.size
}

/// The shoe of one side.
pub(super) fn shoe(rest: &Rest, side: &str) -> Part {
    let s = rest.size;
    let [ankle, foot] = ["ankle", "foot"].map(|n| rest.side(side, n));
    let floor = floor(rest);
    let over = |p: V, height: f32, ahead: f32| [p[0], floor + height * s, p[2] + ahead * s];
    let (heel, ball) = (over(ankle, 0.034, -0.022), over(foot, 0.026, 0.01));
    let toe = [foot[0], floor + 0.022 * s, foot[2] + 0.062 * s];
    let solid = Solid::default()
        .with(Shape::cone(heel, ball, 0.040 * s, 0.041 * s), Union(0.0))
        .with(Shape::cone(ball, toe, 0.043 * s, 0.036 * s), Union(0.02 * s))
        .with(Shape::cone(ankle, over(mix(ankle, foot, 0.55), 0.045, 0.0), 0.044 * s, 0.036 * s), Union(0.03 * s))
        .with(Shape::cone(ankle, add(ankle, [0.0, 0.02 * s, 0.0]), 0.044 * s, 0.042 * s), Union(0.03 * s))
        .with(Shape::Below { point: [0.0, floor, 0.0], normal: [0.0, -1.0, 0.0] }, Within(0.014 * s));
    let x = planes(ankle[0].min(foot[0]) - 0.07 * s, ankle[0].max(foot[0]) + 0.07 * s, |_| 0.0125 * s);
    let y =
        planes(floor - 0.015 * s, ankle[1] + 0.09 * s, |y| if y < floor + 0.03 * s { 0.008 * s } else { 0.013 * s });
    let z = planes(ankle[2] - 0.09 * s, toe[2] + 0.065 * s, |_| 0.015 * s);
    surface(&solid, &Grid([x, y, z]))
}

/// The hand of one side, from within the sleeve.
pub(super) fn hand(rest: &Rest, side: &str) -> Part {
    let at = |name: &str| rest.side(side, name);
    let (wrist, elbow) = (at("wrist"), at("elbow"));
    let s = (rest.between(&format!("{side}_wrist"), &format!("{side}_middle1")) / 0.095).clamp(0.3, 3.0);
    let arm = add(wrist, scale(sub(elbow, wrist), 0.16));
    let mut palm = Solid::default().with(Shape::cone(arm, wrist, 0.029 * s, 0.025 * s), Union(0.0));
    let radii = [0.0105, 0.0092, 0.0094, 0.0088, 0.0078];
    for (finger, radius) in FINGERS.iter().zip(radii) {
        let knuckle = at(&format!("{finger}1"));
        let (from, to) = match *finger {
            "thumb" => (mix(wrist, knuckle, 0.35), knuckle),
            _ => (mix(wrist, knuckle, 0.18), mix(wrist, knuckle, 0.93)),
        };
        let (wide, end) = if *finger == "thumb" { (0.017, 0.0145) } else { (0.0155, radius + 0.0035) };
        palm = palm.with(Shape::cone(from, to, wide * s, end * s), Union(0.016 * s));
    }
    for (finger, radius) in FINGERS.iter().zip(radii) {
        let [a, b, c] = [1, 2, 3].map(|bone| at(&format!("{finger}{bone}")));
        let tip = rest.finger_tip(side, finger);
        let r = radius * s;
        let (blend, root) = if *finger == "thumb" { (0.014 * s, 1.3) } else { (0.005 * s, 1.08) };
        let shaft = |a, b, radii: [f32; 3]| tube(a, b, &radii.map(|x| x * r), 1.0);
        palm = palm
            .with(shaft(a, b, [root, 0.98, 1.0]), Union(blend))
            .with(shaft(b, c, [1.0, 0.90, 0.92]), Union(0.002 * s))
            .with(shaft(c, tip, [0.92, 0.88, 0.74]), Union(0.002 * s));
    }
    let points: Vec<V> =
        FINGERS.iter().flat_map(|f| [at(&format!("{f}1")), rest.finger_tip(side, f)]).chain([arm, wrist]).collect();
    let range = |axis: usize, beyond: f32| {
        let low = points.iter().map(|p| p[axis]).fold(f32::MAX, f32::min) - beyond * s;
        let high = points.iter().map(|p| p[axis]).fold(f32::MIN, f32::max) + beyond * s;
        (low, high)
    };
    let (x, y, z) = (range(0, 0.048), range(1, 0.044), range(2, 0.044));
    // Counted from the wrist, so that the other hand's planes are its mirror image.
    let x = if wrist[0] < 0.0 {
        planes(-x.1, -x.0, |_| 0.0076 * s).into_iter().rev().map(|x| -x).collect()
    } else {
        planes(x.0, x.1, |_| 0.0076 * s)
    };
    surface(&palm, &Grid([x, planes(y.0, y.1, |_| 0.0045 * s), planes(z.0, z.1, |_| 0.0043 * s)]))
}
