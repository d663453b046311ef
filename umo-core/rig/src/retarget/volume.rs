//! The space that a body takes up, at rest: trunk and head by their cross-sections, limbs as tapered capsules.

use umo_core_pose::rotation::{Quat, inverse, rotate};

use super::align::{Vector, axes, dot, length, less};
use super::{Mapping, Rig};

/// Cross-sections of a shape, from its lower end up.
pub(super) const RINGS: usize = 12;
/// Radii of a cross-section.
pub(super) const ANGLES: usize = 16;
/// Radii of one side, the middle included.
const SIDE: usize = ANGLES / 2 + 1;

/// Lower and upper end of the trunk's shape, in trunk lengths above the line of the hips.
const TRUNK: [f32; 2] = [-0.15, 1.1];
/// Share of a cross-section's surface that its radii hold; the rest is taken for straps, tufts and stray vertices.
const HELD: f32 = 0.93;
/// The same for limbs and hands.
const HELD_LIMB: f32 = 0.95;
/// Rounds in which cross-sections are widened to hold the corners between their radii.
const CORNERS: usize = 2;
/// Upper bound on a radius, in medians of its cross-section.
const SPIKE: f32 = 2.2;
/// Depth to which a head reaches below its joint, in its height above it.
const HAIR: f32 = 0.4;
/// Least number of measured radii of a shape; with fewer, it is a person's.
const LEAST: usize = 24;

/// Radii of a person, from behind over a side to ahead, in thousandths of the trunk's length: the mean of the figures.
#[rustfmt::skip]
const PEOPLE_TRUNK: [[u16; SIDE]; RINGS] = [
    [196, 231, 291, 312, 320, 316, 284, 216, 195],
    [196, 231, 291, 312, 320, 316, 284, 216, 195],
    [206, 224, 277, 304, 312, 308, 276, 230, 216],
    [193, 203, 245, 276, 287, 285, 264, 226, 217],
    [171, 182, 223, 254, 264, 264, 246, 211, 201],
    [175, 187, 226, 252, 259, 257, 242, 205, 193],
    [188, 201, 241, 268, 275, 273, 254, 214, 202],
    [195, 211, 256, 282, 289, 291, 278, 235, 216],
    [200, 227, 277, 291, 297, 304, 301, 257, 221],
    [200, 229, 287, 383, 388, 366, 294, 246, 214],
    [191, 205, 250, 367, 347, 350, 218, 174, 157],
    [168, 171, 179, 243, 266, 138, 108, 98, 90],
];
#[rustfmt::skip]
const PEOPLE_HEAD: [[u16; SIDE]; RINGS] = [
    [123, 123, 117, 103, 92, 91, 110, 169, 179],
    [124, 122, 117, 106, 102, 116, 146, 182, 187],
    [124, 124, 119, 113, 121, 140, 172, 192, 200],
    [143, 141, 133, 143, 156, 156, 185, 200, 218],
    [168, 163, 155, 169, 160, 164, 187, 196, 218],
    [179, 176, 166, 173, 158, 163, 183, 186, 199],
    [181, 179, 170, 165, 158, 162, 183, 190, 194],
    [179, 176, 168, 158, 156, 163, 179, 189, 192],
    [181, 170, 160, 152, 152, 158, 164, 175, 178],
    [173, 163, 146, 139, 139, 145, 153, 154, 158],
    [154, 143, 121, 119, 119, 124, 137, 142, 143],
    [107, 81, 79, 77, 78, 83, 93, 109, 116],
];
/// Lower end, upper end and middle (ahead of the joint) of a person's head, in trunk lengths from its joint.
const PEOPLE_SKULL: [f32; 3] = [-0.08, 0.355, 0.0];
/// Radii of a person's limbs, in trunk lengths.
const PEOPLE_LIMBS: [[f32; 2]; 4] = [[0.09, 0.1], [0.112, 0.091], [0.078, 0.069], [0.165, 0.133]];
const PEOPLE_PALM: f32 = 0.035;
const PEOPLE_FINGER: f32 = 0.018;

/// Joints at both ends of the limbs: neck, upper arm, forearm, thigh; of the left side.
pub(super) const LIMBS: [(usize, usize); 4] = [(12, 15), (16, 18), (18, 20), (1, 4)];
const NECK: usize = 0;
pub(super) const UPPER_ARM: usize = 1;
pub(super) const FOREARM: usize = 2;
pub(super) const THIGH: usize = 3;

/// A part whose size a mapping file may change.
pub(super) const PARTS: [&str; 9] =
    ["pelvis", "belly", "chest", "neck", "head", "upper_arms", "forearms", "hands", "thighs"];

/// A point of a mesh at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The bone that it follows most.
    pub bone: usize,
    /// Its place in the rig's world, in the rig's unit.
    pub place: [f32; 3],
    /// Area for which it stands.
    pub area: f32,
}

/// Radii about a vertical axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shape {
    /// Origin at rest, in the rig's world.
    pub(super) base: Vector,
    /// Heights of the first and the last cross-section above the origin.
    pub(super) ends: [f32; 2],
    /// `[rings][angles]`
    pub(super) radii: [[f32; ANGLES]; RINGS],
}

/// The space that a character takes up in its rest pose, in the rig's unit.
#[derive(Clone, Debug, PartialEq)]
pub struct Volume {
    /// From the line of the hips to the line of the shoulders.
    pub(super) size: f32,
    pub(super) trunk: Shape,
    pub(super) head: Shape,
    /// Radii at both ends of neck, upper arms, forearms and thighs.
    pub(super) limbs: [[f32; 2]; LIMBS.len()],
    /// Half thickness of palm and fingers.
    pub(super) palm: f32,
    pub(super) finger: f32,
    /// Boxes of the hands' meshes without their fingers.
    pub(super) hands: [Option<Block>; 2],
}

/// A box about a hand at rest, in the rig's world and unit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Block {
    /// From the wrist.
    middle: Vector,
    /// Along the hand and across it.
    axes: [Vector; 2],
    half: [f32; 2],
}

impl Block {
    /// The place within the box and midway through the hand that is nearest to one, both from the wrist.
    pub(super) fn nearest(&self, place: Vector) -> Vector {
        let at = less(place, self.middle);
        let mut nearest = self.middle;
        for (axis, half) in self.axes.iter().zip(self.half) {
            let along = dot(at, *axis).clamp(-half, half);
            nearest = std::array::from_fn(|i| nearest[i] + along * axis[i]);
        }
        nearest
    }
}

/// A point's place about a shape's axis: its ring and angle, as fractions of table entries.
#[derive(Clone, Copy, Debug)]
pub(super) struct Around {
    ring: f32,
    angle: f32,
    /// Height beyond the ends.
    beyond: f32,
}

impl Around {
    /// The same within the ends.
    pub(super) fn level(self) -> Self {
        Self { beyond: 0.0, ..self }
    }
}

impl Shape {
    /// A person's shape.
    fn of_people(base: Vector, ends: [f32; 2], sections: &[[u16; SIDE]; RINGS], size: f32) -> Self {
        let radii =
            sections.map(|row| std::array::from_fn(|angle| 1e-3 * size * f32::from(row[angle.min(ANGLES - angle)])));
        Self { base, ends, radii }
    }

    /// Where a point lies, in this shape's axes: X left, Y up, Z ahead.
    pub(super) fn around(&self, at: Vector) -> Around {
        let [low, high] = self.ends;
        #[expect(clippy::cast_precision_loss, reason = "a dozen")]
        let rings = (RINGS - 1) as f32;
        let ring = (at[1] - low) / (high - low).max(f32::MIN_POSITIVE) * rings;
        let beyond = (low - at[1]).max(at[1] - high).max(0.0);
        Around { ring: ring.clamp(0.0, rings), angle: angle(at), beyond }
    }

    /// Distance of the surface from the axis. Beyond the ends it closes within half of the radius.
    pub(super) fn radius(&self, around: Around) -> f32 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and not negative")]
        let split = |x: f32| (x as usize, x - x.floor());
        let (ring, up) = split(around.ring);
        let (left, on) = split(around.angle);
        let of = |ring: usize| {
            let row = &self.radii[ring.min(RINGS - 1)];
            let (a, b) = (row[left % ANGLES], row[(left + 1) % ANGLES]);
            a + on * (b - a)
        };
        of(ring) + up * (of(ring + 1) - of(ring)) - 2.0 * around.beyond
    }

    /// Height of a place, from 0 at the lower end to 1 at the upper; beyond them outside of that range.
    pub(super) fn share(&self, at: Vector) -> f32 {
        (at[1] - self.ends[0]) / (self.ends[1] - self.ends[0]).max(f32::MIN_POSITIVE)
    }

    /// Radii of the points about the axis; a person's if there are too few.
    fn measure(&mut self, points: &[(Vector, f32)]) {
        let mut bins = vec![Vec::new(); RINGS * ANGLES];
        for &(at, area) in points {
            let around = self.around(at);
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "small and not negative")]
            let near = |x: f32| x.round() as usize;
            if around.beyond < 0.02 * (self.ends[1] - self.ends[0]) {
                bins[near(around.ring) * ANGLES + near(around.angle) % ANGLES].push((around, out(at), area));
            }
        }
        let found: Vec<Option<f32>> = bins.iter().map(|bin| radius(bin)).collect();
        if found.iter().flatten().count() < LEAST {
            return;
        }
        let mut rows = [None; RINGS];
        for (row, found) in rows.iter_mut().zip(found.chunks_exact(ANGLES)) {
            *row = closed(found);
        }
        for ring in 0..RINGS {
            let near = (0..RINGS).filter(|&other| rows[other].is_some()).min_by_key(|&other| other.abs_diff(ring));
            if let Some(row) = near.and_then(|near| rows[near]) {
                self.radii[ring] = row;
            }
        }
        // Corners between radii.
        for _ in 0..CORNERS {
            let mut off = vec![Vec::new(); RINGS * ANGLES];
            for (cell, off) in bins.iter().zip(&mut off) {
                let residual = |&(place, far, area): &(Around, f32, f32)| (far - self.radius(place.level()), area);
                off.extend(cell.iter().map(residual));
            }
            for (radius, off) in self.radii.as_flattened_mut().iter_mut().zip(&mut off) {
                *radius += quantile(off, 0.75).map_or(0.0, |more| more.clamp(0.0, 0.2 * *radius));
            }
        }
    }
}

/// Radius at the middle of a cell, of points `(place, distance from the axis, area)`: that which holds their distances,
/// less the plane through them.
fn radius(cell: &[(Around, f32, f32)]) -> Option<f32> {
    let points: Vec<([f32; 3], f32)> = cell
        .iter()
        .map(|&(at, far, area)| ([at.ring - at.ring.round(), at.angle - at.angle.round(), far], area))
        .collect();
    // Strays do not tilt the plane.
    let middle = quantile(&mut points.iter().map(|(at, area)| (at[2], *area)).collect::<Vec<_>>(), 0.5)?;
    let near = || points.iter().filter(|(at, _)| at[2] <= 1.5 * middle);
    let total: f32 = near().map(|point| point.1).sum();
    let mean = |of: &dyn Fn([f32; 3]) -> f32| near().map(|(at, area)| area * of(*at)).sum::<f32>() / total;
    let middle = [0, 1, 2].map(|axis| mean(&|at| at[axis]));
    let spread = |a: usize, b: usize| mean(&|at| (at[a] - middle[a]) * (at[b] - middle[b]));
    // A cell whose points lie on a line is level across it.
    let [xx, xy, yy] = [spread(0, 0) + 0.01, spread(0, 1), spread(1, 1) + 0.01];
    let (xr, yr, whole) = (spread(0, 2), spread(1, 2), xx * yy - xy * xy);
    let slopes = [(yy * xr - xy * yr) / whole, (xx * yr - xy * xr) / whole];
    let level = |(at, area): &([f32; 3], f32)| (at[2] - slopes[0] * at[0] - slopes[1] * at[1], *area);
    quantile(&mut points.iter().map(level).collect::<Vec<_>>(), HELD)
}

/// A closed cross-section: gaps between measured radii are interpolated, spikes cut.
fn closed(found: &[Option<f32>]) -> Option<[f32; ANGLES]> {
    let known: Vec<usize> = (0..ANGLES).filter(|&angle| found[angle].is_some()).collect();
    if known.len() < 4 {
        return None;
    }
    let mut sorted: Vec<f32> = found.iter().copied().flatten().collect();
    sorted.sort_by(f32::total_cmp);
    let most = SPIKE * sorted[sorted.len() / 2];
    Some(std::array::from_fn(|angle| {
        let step = |by: usize| (0..ANGLES).find(|step| found[(angle + step * by) % ANGLES].is_some()).unwrap_or(0);
        let (after, before) = (step(1), step(ANGLES - 1));
        let at = |step: usize, by: usize| found[(angle + step * by) % ANGLES].unwrap_or_default();
        let (a, b) = (at(before, ANGLES - 1), at(after, 1));
        #[expect(clippy::cast_precision_loss, reason = "at most sixteen")]
        let share = if before + after == 0 { 0.0 } else { before as f32 / (before + after) as f32 };
        (a + share * (b - a)).min(most)
    }))
}

/// Horizontal distance from the axis.
pub(super) fn out(at: Vector) -> f32 {
    (at[0] * at[0] + at[2] * at[2]).sqrt()
}

/// Direction of a point about the axis, from 0 to [`ANGLES`], without a function whose rounding differs between
/// systems: the perimeter of a diamond, from behind over the left.
fn angle(at: Vector) -> f32 {
    let (x, z) = (at[0], at[2]);
    let sum = (x.abs() + z.abs()).max(f32::MIN_POSITIVE);
    let quarter = if x >= 0.0 { 1.0 + z / sum } else { 3.0 - z / sum };
    #[expect(clippy::cast_precision_loss, reason = "sixteen")]
    let angles = ANGLES as f32;
    (quarter * 0.25 * angles).clamp(0.0, angles - 1e-3)
}

/// Value that holds this share of the areas; `None` without any.
fn quantile(values: &mut [(f32, f32)], share: f32) -> Option<f32> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f32 = values.iter().map(|value| value.1).sum();
    let mut held = 0.0;
    for &(value, area) in values.iter() {
        held += area;
        if held >= share * total {
            return Some(value);
        }
    }
    values.last().map(|value| value.0)
}

/// Axes and size of a body at rest.
struct Stature {
    axes: Quat,
    hips: Vector,
    size: f32,
}

impl Stature {
    fn new(rig: &Rig, mapping: &Mapping) -> Option<Self> {
        let (axes, _) = axes(rig, mapping).ok()?;
        let middle = |left: usize, right: usize| -> Option<Vector> {
            let [left, right] = [rig.place(mapping.bone(left)?), rig.place(mapping.bone(right)?)];
            Some(std::array::from_fn(|i| 0.5 * (left[i] + right[i])))
        };
        let (hips, shoulders) = (middle(1, 2)?, middle(16, 17)?);
        let up = rotate(axes, [0.0, 1.0, 0.0]);
        let size = dot(less(shoulders, hips), up);
        // Midway between hips and shoulders, people who lean have their axis.
        let lean = less(shoulders, hips);
        let hips = std::array::from_fn(|i| hips[i] + 0.5 * (lean[i] - size * up[i]));
        (size > 0.0 && size.is_finite()).then_some(Self { axes, hips, size })
    }
}

/// The bone of a limb's end; of the neck, its lowest.
fn end(mapping: &Mapping, joint: usize) -> Option<usize> {
    mapping.bone(joint).or_else(|| (joint == 12).then(|| mapping.neck().first().copied()).flatten())
}

impl Volume {
    /// The space that a person takes up, in proportion to the trunk; `None` for a rig without arms or legs.
    pub fn of_people(rig: &Rig, mapping: &Mapping) -> Option<Self> {
        let Stature { axes, hips, size } = Stature::new(rig, mapping)?;
        let trunk = Shape::of_people(hips, TRUNK.map(|end| end * size), &PEOPLE_TRUNK, size);
        let up = |by: Vector| rotate(axes, by.map(|x| x * size));
        let joint = mapping.bone(15).map_or_else(
            || {
                let above = up([0.0, 1.3, 0.0]);
                std::array::from_fn(|i| hips[i] + above[i])
            },
            |bone| rig.place(bone),
        );
        let [low, high, ahead] = PEOPLE_SKULL;
        let ahead = up([0.0, 0.0, ahead]);
        let base = std::array::from_fn(|i| joint[i] + ahead[i]);
        let head = Shape::of_people(base, [low * size, high * size], &PEOPLE_HEAD, size);
        let limbs = PEOPLE_LIMBS.map(|ends| ends.map(|radius| radius * size));
        Some(Self {
            size,
            trunk,
            head,
            limbs,
            palm: PEOPLE_PALM * size,
            finger: PEOPLE_FINGER * size,
            hands: [None; 2],
        })
    }

    /// The space that a mesh takes up at rest, given points spread over its surface; a part with too few points is a
    /// person's. `None` for a rig without arms or legs.
    pub fn measure(rig: &Rig, mapping: &Mapping, points: &[SurfacePoint]) -> Option<Self> {
        let mut volume = Self::of_people(rig, mapping)?;
        let stature = Stature::new(rig, mapping)?;
        let joints = joints(rig, mapping);
        let back = inverse(stature.axes);
        let usable = |point: &&SurfacePoint| {
            point.bone < rig.len() && point.area > 0.0 && point.place.iter().all(|x| x.is_finite())
        };
        let of = |wanted: &dyn Fn(usize) -> bool, base: Vector| -> Vec<(Vector, f32)> {
            let of_part = points.iter().filter(usable).filter(|point| joints[point.bone].is_some_and(wanted));
            of_part.map(|point| (rotate(back, less(point.place, base)), point.area)).collect()
        };
        let trunk = of(&|joint| matches!(joint, 0 | 3 | 6 | 9 | 13 | 14), volume.trunk.base);
        volume.trunk.measure(&trunk);
        volume.measure_head(&of(&|joint| matches!(joint, 15 | 22..=24), volume.head.base), stature.axes);
        for (limb, &(from, to)) in LIMBS.iter().enumerate() {
            let sides = if limb == NECK { 1 } else { 2 };
            let mut halves = [Vec::new(), Vec::new()];
            for side in 0..sides {
                let (from, to) = (from + side * usize::from(limb != NECK), to + side);
                let Some((a, b)) = end(mapping, from).zip(end(mapping, to)) else { continue };
                let (a, b) = (rig.place(a), rig.place(b));
                let way = less(b, a);
                let whole = dot(way, way).max(f32::MIN_POSITIVE);
                for (at, area) in of(&|joint| joint == from, [0.0; 3]) {
                    let at = less(rotate(stature.axes, at), a);
                    let share = dot(at, way) / whole;
                    let aside = length(std::array::from_fn(|i| at[i] - share * way[i]));
                    if (0.0..=1.0).contains(&share) {
                        halves[usize::from(share > 0.5)].push((aside, area));
                    }
                }
            }
            for (radius, half) in volume.limbs[limb].iter_mut().zip(&mut halves) {
                let found = quantile(half, HELD_LIMB).filter(|_| half.len() >= 8);
                *radius = found.map_or(*radius, |found| found.min(3.0 * *radius));
            }
        }
        volume.measure_hands(rig, mapping, &|joint, base| of(&|of| of == joint, base));
        Some(volume)
    }

    /// Puts the head's shape where its points are.
    fn measure_head(&mut self, points: &[(Vector, f32)], axes: Quat) {
        let along = |axis: usize, share: f32| {
            quantile(&mut points.iter().map(|(at, area)| (at[axis], *area)).collect::<Vec<_>>(), share)
        };
        // Long hair hangs below a head.
        let ends = along(1, 0.02).zip(along(1, 0.99)).map(|(low, high)| (low.max(-HAIR * high), high));
        let Some((low, high)) = ends.filter(|(low, high)| high - low > 0.1 * self.size && points.len() >= LEAST) else {
            return;
        };
        // The middle of its extent: the centre of the surface lies where the vertices are finest, in the face.
        let middle = |axis: usize| along(axis, 0.05).zip(along(axis, 0.95)).map_or(0.0, |(a, b)| 0.5 * (a + b));
        let centre = [middle(0), 0.0, middle(2)];
        let moved: Vec<_> = points.iter().map(|(at, area)| (less(*at, centre), *area)).collect();
        let by = rotate(axes, centre);
        self.head.base = std::array::from_fn(|i| self.head.base[i] + by[i]);
        self.head.ends = [low, high];
        self.head.measure(&moved);
    }

    /// Thickness of palms, along the normal of a hand that a rig holds out, and of fingers.
    fn measure_hands(&mut self, rig: &Rig, mapping: &Mapping, of: &dyn Fn(usize, Vector) -> Vec<(Vector, f32)>) {
        let (mut palms, mut fingers) = (Vec::new(), Vec::new());
        let axes = axes(rig, mapping).map_or(umo_core_pose::rotation::IDENTITY, |(axes, _)| axes);
        for side in 0..2 {
            let Some(wrist) = mapping.bone(20 + side).map(|bone| rig.place(bone)) else { continue };
            let points = of(20 + side, wrist);
            // A palm is thinnest along its normal.
            let normal = thinnest(&points);
            self.hands[side] = normal.and_then(|(normal, middle)| block(&points, normal, middle, axes));
            palms.extend(normal.into_iter().flat_map(|(normal, middle)| {
                points.iter().map(move |(at, area)| (dot(less(*at, middle), normal).abs(), *area))
            }));
            for joint in (25 + 15 * side)..(40 + 15 * side) {
                let Some(bone) = mapping.bone(joint) else { continue };
                let next = ((joint - 25) % 3 < 2).then(|| mapping.bone(joint + 1)).flatten();
                let Some(next) = next.map(|next| rig.place(next)) else { continue };
                let way = less(next, rig.place(bone));
                let along = length(way).max(f32::MIN_POSITIVE);
                // The points are in the body's axes; distances from the line need the same.
                let way = rotate(inverse(axes), way.map(|x| x / along));
                fingers.extend(of(joint, rig.place(bone)).into_iter().map(|(at, area)| {
                    let share = dot(at, way);
                    (length(std::array::from_fn(|i| at[i] - share * way[i])), area)
                }));
            }
        }
        let limit = |found: Option<f32>, old: f32| found.map_or(old, |found| found.clamp(0.3 * old, 4.0 * old));
        let enough = |points: &[(f32, f32)]| points.len() >= 8;
        let palm = if enough(&palms) { quantile(&mut palms, HELD_LIMB) } else { None };
        self.palm = limit(palm, self.palm);
        // Webs and knuckles are wider.
        let finger = if enough(&fingers) { quantile(&mut fingers, 0.5) } else { None };
        self.finger = limit(finger, self.finger * self.palm / (PEOPLE_PALM * self.size));
    }

    /// Multiplies the girth of a part, one of `pelvis`, `belly`, `chest`, `neck`, `head`, `upper_arms`, `forearms`,
    /// `hands` and `thighs`; 0 removes it.
    ///
    /// # Errors
    /// The part is not one of these, or the factor is not between 0 and 10.
    pub fn scale(&mut self, part: &str, factor: f32) -> Result<(), String> {
        if !(0.0..=10.0).contains(&factor) {
            return Err(format!("body part `{part}`: {factor} times is not between 0 and 10"));
        }
        let limb = |limb: &mut [f32; 2]| limb.iter_mut().for_each(|radius| *radius *= factor);
        match part {
            "pelvis" | "belly" | "chest" => {
                let rings = match part {
                    "pelvis" => 0..4,
                    "belly" => 4..8,
                    _ => 8..RINGS,
                };
                self.trunk.radii[rings].as_flattened_mut().iter_mut().for_each(|radius| *radius *= factor);
            }
            "head" => self.head.radii.as_flattened_mut().iter_mut().for_each(|radius| *radius *= factor),
            "neck" => limb(&mut self.limbs[NECK]),
            "upper_arms" => limb(&mut self.limbs[UPPER_ARM]),
            "forearms" => limb(&mut self.limbs[FOREARM]),
            "thighs" => limb(&mut self.limbs[THIGH]),
            "hands" => {
                self.palm *= factor;
                self.finger *= factor;
            }
            _ => return Err(format!("`{part}` is not a body part: expected one of {}", PARTS.join(", "))),
        }
        Ok(())
    }
}

/// The box of a hand's points about its wrist, less its thickness at the sides and the far end.
fn block(points: &[(Vector, f32)], normal: Vector, middle: Vector, axes: Quat) -> Option<Block> {
    let across = |v: Vector| -> Vector { std::array::from_fn(|i| v[i] - dot(v, normal) * normal[i]) };
    let along = super::align::direction(across(middle), 1e-6 * length(middle))?;
    let wide = super::align::cross(normal, along);
    let end = |axis: Vector, share: f32| {
        quantile(&mut points.iter().map(|(at, area)| (dot(*at, axis), *area)).collect::<Vec<_>>(), share)
    };
    let thick = 0.5 * (end(normal, 0.95)? - end(normal, 0.05)?);
    let mut place = [0.0; 3];
    let mut half = [0.0; 2];
    for (axis, half) in [along, wide].into_iter().zip(&mut half) {
        let (low, high) = (end(axis, 0.01)?, end(axis, 0.99)?);
        let centre = 0.5 * (low + high);
        *half = (0.5 * (high - low) - thick).max(0.0);
        place = std::array::from_fn(|i| place[i] + centre * axis[i]);
    }
    let through = dot(middle, normal);
    place = std::array::from_fn(|i| place[i] + through * normal[i]);
    Some(Block { middle: rotate(axes, place), axes: [along, wide].map(|axis| rotate(axes, axis)), half })
}

/// The direction in which points vary least, and their middle; `None` for fewer than eight.
fn thinnest(points: &[(Vector, f32)]) -> Option<(Vector, Vector)> {
    if points.len() < 8 {
        return None;
    }
    let total: f32 = points.iter().map(|(_, area)| area).sum();
    let middle: Vector = std::array::from_fn(|i| points.iter().map(|(at, area)| at[i] * area).sum::<f32>() / total);
    let spread =
        |normal: Vector| -> f32 { points.iter().map(|(at, area)| area * dot(less(*at, middle), normal).powi(2)).sum() };
    // Directions of half a sphere, some 6 degrees apart.
    let tried = (0..400_u16).map(|k| {
        let z = (f32::from(k) + 0.5) / 400.0;
        let (out, turn) = ((1.0 - z * z).sqrt(), 2.399_963 * f32::from(k));
        [out * turn.cos(), out * turn.sin(), z]
    });
    let best = tried.map(|normal| (spread(normal), normal)).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, normal)| (normal, middle))
}

/// The joint whose bone each bone is or hangs on.
fn joints(rig: &Rig, mapping: &Mapping) -> Vec<Option<usize>> {
    let mut joints = vec![None; rig.len()];
    for follow in mapping.follows() {
        joints[follow.bone] = Some(match follow.joints[1] {
            // All bones of a neck are its neck, and all of a spine the trunk.
            9 if mapping.neck().contains(&follow.bone) => 12,
            joint => joint,
        });
    }
    for &bone in rig.order() {
        joints[bone] = joints[bone].or_else(|| rig.bones()[bone].parent.and_then(|parent| joints[parent]));
    }
    joints
}

#[cfg(test)]
mod tests {
    use umo_core_pose::rotation::axis_angle_to_quat;

    use super::*;
    use crate::retarget::Bone;

    /// Bones of a standing figure in a T-pose, as `(name, parent, place relative to the parent)`.
    const BONES: [(&str, Option<usize>, Vector); 15] = [
        ("Hips", None, [0.0, 1.0, 0.0]),
        ("Spine", Some(0), [0.0, 0.2, 0.0]),
        ("Head", Some(1), [0.0, 0.4, 0.0]),
        ("LeftArm", Some(1), [0.2, 0.3, 0.0]),
        ("LeftForeArm", Some(3), [0.3, 0.0, 0.0]),
        ("LeftHand", Some(4), [0.25, 0.0, 0.0]),
        ("RightArm", Some(1), [-0.2, 0.3, 0.0]),
        ("RightForeArm", Some(6), [-0.3, 0.0, 0.0]),
        ("RightHand", Some(7), [-0.25, 0.0, 0.0]),
        ("LeftUpLeg", Some(0), [0.1, -0.05, 0.0]),
        ("LeftLeg", Some(9), [0.0, -0.45, 0.0]),
        ("LeftFoot", Some(10), [0.0, -0.42, 0.0]),
        ("RightUpLeg", Some(0), [-0.1, -0.05, 0.0]),
        ("RightLeg", Some(12), [0.0, -0.45, 0.0]),
        ("RightFoot", Some(13), [0.0, -0.42, 0.0]),
    ];

    fn body(unit: f32, world: Quat) -> (Rig, Mapping) {
        let mut bones: Vec<Bone> =
            BONES.iter().map(|&(name, parent, at)| Bone::new(name, parent, at.map(|x| x * unit))).collect();
        bones[0].translation = rotate(world, bones[0].translation);
        bones[0].rotation = world;
        let rig = Rig::new(bones).unwrap();
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        (rig, mapping)
    }

    /// Points of an elliptic trunk, 0.2 by 0.3, and of a round forearm of 0.06, with strays.
    fn points(unit: f32, world: Quat) -> Vec<SurfacePoint> {
        let point = |bone: usize, at: Vector| {
            let place = rotate(world, at.map(|x| x * unit));
            SurfacePoint { bone, place, area: unit * unit }
        };
        let mut points = Vec::new();
        for turn in 0..64_u8 {
            let (sine, cosine) = (f32::from(turn) * std::f32::consts::TAU / 64.0).sin_cos();
            for height in 0..80_u8 {
                let y = 0.85 + 0.01 * f32::from(height);
                points.push(point(usize::from(y > 1.2), [0.2 * sine, y, 0.3 * cosine]));
            }
            for along in 0..20_u8 {
                points.push(point(4, [0.5 + 0.0125 * f32::from(along), 1.5 + 0.06 * sine, 0.06 * cosine]));
            }
        }
        points.extend((0..100_u8).map(|at| SurfacePoint { area: 0.01, ..point(1, [0.01 * f32::from(at), 1.3, 2.0]) }));
        points.push(point(1, [f32::NAN, 1.3, 0.0]));
        points.push(point(99, [0.0; 3]));
        points
    }

    #[test]
    fn a_meshs_cross_sections_are_found_in_any_unit_and_axes() {
        let quarter = std::f32::consts::FRAC_PI_2;
        for (unit, world) in [(1.0, [0.0; 3]), (100.0, [quarter, 0.0, 0.0]), (1.0, [0.0, 2.0 * quarter, 0.0])] {
            let world = axis_angle_to_quat(world);
            let (rig, mapping) = body(unit, world);
            let volume = Volume::measure(&rig, &mapping, &points(unit, world)).unwrap();
            for ring in &volume.trunk.radii[2..10] {
                for (angle, want) in [(0, 0.3), (4, 0.2), (8, 0.3), (12, 0.2)] {
                    let got = ring[angle] / unit;
                    assert!((got - want).abs() < 0.012, "{unit}, angle {angle}: {got}, not {want}");
                }
            }
            let [elbow, wrist] = volume.limbs[FOREARM].map(|radius| radius / unit);
            assert!((elbow - 0.06).abs() < 1e-3 && (wrist - 0.06).abs() < 1e-3, "{elbow} {wrist}");
            // Parts without points are a person's.
            let people = Volume::of_people(&rig, &mapping).unwrap();
            assert_eq!((volume.limbs[THIGH], &volume.head), (people.limbs[THIGH], &people.head));
        }
    }

    #[test]
    fn corners_of_boxes_are_held_and_round_bodies_do_not_grow() {
        let mut shape = Shape { base: [0.0; 3], ends: [0.0, 1.0], radii: [[0.0; ANGLES]; RINGS] };
        let even = |of: &dyn Fn(f32) -> [f32; 2]| -> Vec<(Vector, f32)> {
            let of = |at: u16| {
                let [x, z] = of(f32::from(at % 400) / 400.0);
                ([x, f32::from(at / 400) / 49.0, z], 1.0)
            };
            (0..20_000).map(of).collect()
        };
        let ellipse = even(&|t| {
            let (sine, cosine) = (t * std::f32::consts::TAU).sin_cos();
            [0.17 * sine, 0.11 * cosine]
        });
        // From corner to corner of a box of 0.42 by 0.28.
        let edges = even(&|t| {
            let (side, along) = ((4.0 * t).floor(), 2.0 * (4.0 * t).fract() - 1.0);
            let sign = if side < 2.0 { 1.0 } else { -1.0 };
            if side % 2.0 == 0.0 { [sign * 0.21, sign * along * 0.14] } else { [sign * along * 0.21, sign * 0.14] }
        });
        for (points, least, most) in [(ellipse, -0.003, 0.006), (edges, -0.03, 0.045)] {
            shape.measure(&points);
            for (at, _) in points {
                let beyond = shape.radius(shape.around(at)) - out(at);
                assert!((least..most).contains(&beyond), "{at:?}: {beyond}");
            }
        }
    }

    #[test]
    fn a_missing_finger_is_nearest_in_the_hands_box() {
        // A palm from 0 to 0.2 along X, 0.08 wide, 0.02 thick.
        let mut points = Vec::new();
        for i in 0..41_u8 {
            for j in 0..17_u8 {
                let (x, z) = (0.005 * f32::from(i), 0.005 * f32::from(j) - 0.04);
                points.extend([0.01, -0.01].map(|y| ([x, y, z], 1.0)));
            }
        }
        let (normal, middle) = thinnest(&points).unwrap();
        let hand = block(&points, normal, middle, umo_core_pose::rotation::IDENTITY).unwrap();
        for (place, want) in [([0.1, 0.3, 0.02], [0.1, 0.0, 0.02]), ([0.5, -0.2, 0.2], [0.19, 0.0, 0.03])] {
            let got = hand.nearest(place);
            assert!(length(less(got, want)) < 0.012, "{got:?}, not {want:?}");
        }
    }

    #[test]
    fn parts_are_scaled_by_name() {
        let (rig, mapping) = body(1.0, umo_core_pose::rotation::IDENTITY);
        let people = Volume::of_people(&rig, &mapping).unwrap();
        for part in PARTS {
            let mut volume = people.clone();
            volume.scale(part, 1.0).unwrap();
            assert_eq!(volume, people);
            volume.scale(part, 2.0).unwrap();
            assert_ne!(volume, people, "{part}");
        }
        let mut volume = people.clone();
        assert!(volume.scale("tail", 1.0).unwrap_err().contains("belly"));
        for wrong in [-1.0, 11.0, f32::NAN] {
            assert!(volume.scale("belly", wrong).is_err());
        }
        assert_eq!(volume, people);
    }

    #[test]
    fn a_rig_without_arms_has_no_volume() {
        let bones = BONES[..3].iter().map(|&(name, parent, at)| Bone::new(name, parent, at));
        let rig = Rig::new(bones.collect()).unwrap();
        assert!(Volume::of_people(&rig, &Mapping::closest(&rig).0).is_none());
    }
}
