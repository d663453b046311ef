//! What brings a rig's rest pose to the source's: the axes of its world, and a turn for each bone.

use super::{Mapping, RetargetError, Rig};
use crate::motion::rotation::{IDENTITY, Matrix, Quat, axis_angle_to_quat, inverse, matrix_to_quat, product, rotate};
use crate::motion::skeleton::JOINTS;

pub(super) type Vector = [f32; 3];

/// Shorter bones have no direction, relative to the distance between hips and shoulders.
const SHORT: f32 = 1e-4;

/// A body's up is taken as an axis of the file where it is nearer to it than this: people lean.
const UPRIGHT: f32 = 0.85;

/// So is its left: people do not stand exactly ahead.
const AHEAD: f32 = 0.95;

const WRISTS: [usize; 2] = [20, 21];
const ANKLES: [usize; 2] = [7, 8];

pub(super) fn less(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(super) fn dot(a: Vector, b: Vector) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn length(v: Vector) -> f32 {
    let [x, y, z] = v.map(f64::from);
    #[expect(clippy::cast_possible_truncation, reason = "squares are summed in f64, so that none overflows")]
    let length = (x * x + y * y + z * z).sqrt() as f32;
    length
}

/// `v` at length 1, where it is longer than `least`.
pub(super) fn direction(v: Vector, least: f32) -> Option<Vector> {
    let length = length(v);
    (length > least && length.is_finite()).then(|| v.map(|x| x / length))
}

/// `v` without its part along the unit vector `axis`.
pub(super) fn aside(v: Vector, axis: Vector) -> Vector {
    let along = dot(v, axis);
    std::array::from_fn(|i| v[i] - along * axis[i])
}

/// The shortest turn from one unit vector to another; half a turn is about `axis`, or what of it is
/// aside.
pub(super) fn shortest(from: Vector, to: Vector, axis: Vector) -> Quat {
    let side = cross(from, to);
    let sine = length(side);
    let angle = sine.atan2(dot(from, to));
    if sine > 1e-6 {
        return axis_angle_to_quat(side.map(|x| x / sine * angle));
    }
    if angle < 1.0 {
        return IDENTITY;
    }
    let candidates = [axis, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let about = candidates.into_iter().find_map(|axis| direction(aside(axis, from), 0.1));
    about.map_or(IDENTITY, |about| axis_angle_to_quat(about.map(|x| x * std::f32::consts::PI)))
}

/// The rotation whose first axis is `first`, its second as near to `second` as can be.
fn frame(first: Vector, second: Vector) -> Option<Quat> {
    let first = direction(first, 0.0)?;
    let second = direction(aside(second, first), 0.1 * length(second))?;
    Some(of_axes(first, second, cross(first, second)))
}

/// The rotation that turns X, Y and Z to these.
fn of_axes(x: Vector, y: Vector, z: Vector) -> Quat {
    let rows: Matrix = std::array::from_fn(|i| [x[i], y[i], z[i]]);
    matrix_to_quat(rows)
}

/// The part of a rotation about a unit vector, as an angle in radians.
fn twist(q: Quat, axis: Vector) -> f32 {
    let along = dot([q[0], q[1], q[2]], axis);
    2.0 * along.atan2(q[3])
}

/// The nearest axis of the world, where it is as near as `least`, else the vector itself.
fn snapped(v: Vector, least: f32) -> Vector {
    let axis = (0..3).fold(0, |best, i| if v[i].abs() > v[best].abs() { i } else { best });
    if v[axis].abs() < least {
        return v;
    }
    let mut snapped = [0.0; 3];
    snapped[axis] = v[axis].signum();
    snapped
}

/// Turns the source's axes (X to the left, Y up, Z ahead) to those in which the rig stands, and how
/// long a bone must be.
pub(super) fn axes(rig: &Rig, mapping: &Mapping) -> Result<(Quat, f32), RetargetError> {
    let place = |joint: usize| mapping.bone(joint).map(|bone| rig.place(bone));
    let pair = |left: usize, right: usize| place(left).zip(place(right));
    let pairs = [pair(16, 17), pair(1, 2), pair(18, 19), pair(4, 5)];
    if pairs.iter().all(Option::is_none) {
        return head_axes(rig, mapping);
    }
    let left = pairs.into_iter().flatten().fold([0.0; 3], |sum, (l, r)| std::array::from_fn(|i| sum[i] + l[i] - r[i]));
    let middle = |pair: Option<(Vector, Vector)>| pair.map(|(l, r)| std::array::from_fn(|i| 0.5 * (l[i] + r[i])));
    let low = middle(pair(1, 2)).or(place(0)).ok_or(RetargetError::Flat)?;
    let high = middle(pair(16, 17)).or(place(15)).ok_or(RetargetError::Flat)?;
    let size = length(less(high, low));
    let up = snapped(direction(less(high, low), 1e-9).ok_or(RetargetError::Flat)?, UPRIGHT);
    let left = direction(aside(left, up), SHORT * size).ok_or(RetargetError::Flat)?;
    let left = snapped(left, AHEAD);
    // An axis that was snapped is perpendicular to an axis; one that was not may not be.
    let left = direction(aside(left, up), 0.1).ok_or(RetargetError::Flat)?;
    Ok((of_axes(left, up, cross(left, up)), SHORT * size))
}

/// [`axes`] of a head or a bust: what is not seen of it is as the format has it, X left and Y up.
fn head_axes(rig: &Rig, mapping: &Mapping) -> Result<(Quat, f32), RetargetError> {
    let place = |joint: usize| mapping.bone(joint).map(|bone| rig.place(bone));
    let trunk = mapping.bone(0).into_iter().chain(mapping.spine().iter().chain(mapping.neck()).copied());
    let low = trunk.map(|bone| rig.place(bone)).next();
    let neck = low.zip(place(15)).map(|(low, head)| less(head, low)).filter(|&neck| length(neck) > 1e-9);
    let up = neck.and_then(|neck| direction(neck, 1e-9)).map_or([0.0, 1.0, 0.0], |up| snapped(up, UPRIGHT));
    let sides = [(23, 24), (13, 14)].into_iter().find_map(|(left, right)| place(left).zip(place(right)));
    let left = sides.and_then(|(left, right)| direction(less(left, right), 1e-9)).unwrap_or([1.0, 0.0, 0.0]);
    let left = direction(aside(left, up), 0.1).ok_or(RetargetError::Flat)?;
    let left = direction(aside(snapped(left, AHEAD), up), 0.1).ok_or(RetargetError::Flat)?;
    Ok((of_axes(left, up, cross(left, up)), SHORT * neck.map_or(1.0, length)))
}

/// Where the joints of the source are at rest, from its root, in its axes.
pub(super) type Rest = [Vector; JOINTS];

/// The turn of each joint's bone, in the world, from the rig's rest pose to the source's.
pub(super) struct Alignment<'a> {
    pub(super) rig: &'a Rig,
    pub(super) mapping: &'a Mapping,
    pub(super) rest: &'a Rest,
    /// From the source's axes to the rig's.
    pub(super) axes: Quat,
    /// Bones are longer than this.
    pub(super) short: f32,
}

impl Alignment<'_> {
    /// `[55]`. Torso, neck, head, collars, eyes and jaw stay as they are: both bodies are upright
    /// at rest, and how their bones lie within is a matter of anatomy. Limbs and fingers turn until
    /// their directions are the source's.
    pub(super) fn turns(&self) -> [Quat; JOINTS] {
        let mut turns = [IDENTITY; JOINTS];
        for side in 0..2 {
            self.limb(&mut turns, &[1 + side, 4 + side, 7 + side]);
            self.limb(&mut turns, &[16 + side, 18 + side, 20 + side]);
            self.hand(&mut turns, side);
            turns[ANKLES[side]] = self.foot(side);
            turns[ANKLES[side] + 3] = turns[ANKLES[side]];
        }
        turns
    }

    /// Turns each bone but the last, one after the other, as one would pose them: each takes what
    /// hangs on it along.
    fn limb(&self, turns: &mut [Quat; JOINTS], joints: &[usize]) {
        let mut carried = IDENTITY;
        for pair in joints.windows(2) {
            let to = self.source(pair[0], pair[1]);
            let from = self.target(pair[0], Some(pair[1]));
            carried = self.carry(carried, from, to);
            turns[pair[0]] = carried;
        }
        turns[joints[joints.len() - 1]] = carried;
    }

    /// The turn `carried` and then what is left of the way from one direction to another.
    fn carry(&self, carried: Quat, from: Option<Vector>, to: Option<Vector>) -> Quat {
        let Some((from, to)) = from.zip(to) else { return carried };
        let ahead = rotate(self.axes, [0.0, 0.0, 1.0]);
        product(shortest(rotate(carried, from), to, ahead), carried)
    }

    /// The palm lies as the source's does, and the forearm takes half of what that twists the wrist
    /// by.
    fn hand(&self, turns: &mut [Quat; JOINTS], side: usize) {
        let (wrist, elbow) = (WRISTS[side], 18 + side);
        let first = 25 + 15 * side;
        if let Some(turn) = self.palm(wrist, first) {
            if let Some(along) = self.source(elbow, wrist) {
                let twist = twist(product(turn, inverse(turns[elbow])), along);
                // The shorter way round.
                let twist = (twist + std::f32::consts::PI).rem_euclid(std::f32::consts::TAU) - std::f32::consts::PI;
                turns[elbow] = product(axis_angle_to_quat(along.map(|x| 0.5 * twist * x)), turns[elbow]);
            }
            turns[wrist] = turn;
        } else if let Some(middle) = [first + 3, first, first + 9].into_iter().find(|&j| self.mapping.bone(j).is_some())
        {
            turns[wrist] = self.carry(turns[wrist], self.target(wrist, Some(middle)), self.source(wrist, middle));
        }
        for finger in (first..first + 15).step_by(3) {
            let mut carried = turns[wrist];
            for step in 0..3 {
                let joint = finger + step;
                // The last bone of the source goes on as the one before.
                let to = if step < 2 { self.source(joint, joint + 1) } else { self.source(joint - 1, joint) };
                carried = self.carry(carried, self.target(joint, (step < 2).then_some(joint + 1)), to);
                turns[joint] = carried;
            }
        }
    }

    /// From wrist to knuckles, and across those that there are: the outermost two.
    fn palm(&self, wrist: usize, first: usize) -> Option<Quat> {
        let has = |joint: usize| self.mapping.bone(joint).is_some();
        let (index, middle, pinky, ring) = (first, first + 3, first + 6, first + 9);
        let knuckles = || [index, middle, ring, pinky].into_iter().filter(|&joint| has(joint));
        let (near, far) = knuckles().next().zip(knuckles().next_back()).filter(|(near, far)| near != far)?;
        let along = if has(middle) { middle } else { near };
        let source = frame(self.source(wrist, along)?, self.source(far, near)?)?;
        let target = frame(self.target(wrist, Some(along))?, self.target(far, Some(near))?)?;
        Some(product(source, inverse(target)))
    }

    /// Feet stand flat in both rest poses: only where they point to may differ.
    fn foot(&self, side: usize) -> Quat {
        let (ankle, toes) = (ANKLES[side], ANKLES[side] + 3);
        let up = rotate(self.axes, [0.0, 1.0, 0.0]);
        let level = |v: Option<Vector>| v.and_then(|v| direction(aside(v, up), 0.2));
        let from = level(self.target(ankle, Some(toes)));
        match from.zip(level(self.source(ankle, toes))) {
            Some((from, to)) => shortest(from, to, up),
            None => IDENTITY,
        }
    }

    /// The direction from one joint to another of the source at rest, in the rig's axes.
    fn source(&self, from: usize, to: usize) -> Option<Vector> {
        direction(less(self.rest[to], self.rest[from]), 1e-6).map(|v| rotate(self.axes, v))
    }

    /// The direction from a joint's bone to the next one's, or where there is none to the bone's
    /// end.
    fn target(&self, from: usize, to: Option<usize>) -> Option<Vector> {
        let bone = self.mapping.bone(from)?;
        let end = to.and_then(|to| self.mapping.bone(to)).map(|to| self.rig.place(to));
        direction(less(end.or_else(|| self.rig.tip(bone))?, self.rig.place(bone)), self.short)
    }
}
