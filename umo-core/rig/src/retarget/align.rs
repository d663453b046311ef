//! Aligns a rig's rest pose with the source's: the axes of its world, and a rotation for each bone.

use umo_core_pose::rotation::{IDENTITY, Matrix, Quat, axis_angle_to_quat, inverse, matrix_to_quat, product, rotate};
use umo_core_pose::skeleton::JOINTS;

use super::{Mapping, RetargetError, Rig};

pub(super) type Vector = [f32; 3];

/// Length below which a bone has no direction, relative to the distance between hips and shoulders.
const SHORT: f32 = 1e-4;

/// Cosine above which the body's up snaps to an axis of the file, because people lean.
const UPRIGHT: f32 = 0.85;

/// The same threshold for the body's left, because people do not face exactly forwards.
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

/// Normalises `v`; `None` if it is not longer than `least`.
pub(super) fn direction(v: Vector, least: f32) -> Option<Vector> {
    let length = length(v);
    (length > least && length.is_finite()).then(|| v.map(|x| x / length))
}

/// Component of `v` perpendicular to the unit vector `axis`.
pub(super) fn aside(v: Vector, axis: Vector) -> Vector {
    let along = dot(v, axis);
    std::array::from_fn(|i| v[i] - along * axis[i])
}

/// Shortest rotation from one unit vector to another. A half turn is about the component of `axis` perpendicular to
/// `from`.
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

/// Rotation whose first axis is `first` and whose second is as close to `second` as possible.
fn frame(first: Vector, second: Vector) -> Option<Quat> {
    let first = direction(first, 0.0)?;
    let second = direction(aside(second, first), 0.1 * length(second))?;
    Some(of_axes(first, second, cross(first, second)))
}

/// Rotation that maps X, Y and Z to these axes.
fn of_axes(x: Vector, y: Vector, z: Vector) -> Quat {
    let rows: Matrix = std::array::from_fn(|i| [x[i], y[i], z[i]]);
    matrix_to_quat(rows)
}

/// Twist of a rotation about a unit vector, in radians.
fn twist(q: Quat, axis: Vector) -> f32 {
    let along = dot([q[0], q[1], q[2]], axis);
    2.0 * along.atan2(q[3])
}

/// Nearest axis of the world if its cosine to `v` is at least `least`, else `v`.
fn snapped(v: Vector, least: f32) -> Vector {
    let axis = (0..3).fold(0, |best, i| if v[i].abs() > v[best].abs() { i } else { best });
    if v[axis].abs() < least {
        return v;
    }
    let mut snapped = [0.0; 3];
    snapped[axis] = v[axis].signum();
    snapped
}

/// Returns the rotation from the source's axes (X to the left, Y up, Z ahead) to the rig's, and the minimum length of
/// a bone that has a direction.
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
    // A snapped axis is perpendicular to the other axes; a vector that was not snapped may not be.
    let left = direction(aside(left, up), 0.1).ok_or(RetargetError::Flat)?;
    Ok((of_axes(left, up, cross(left, up)), SHORT * size))
}

/// [`axes`] of a head or a bust: axes that its bones do not show are the format's, X left and Y up.
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

/// Rest positions of the source's joints, relative to its root, in its axes.
pub(super) type Rest = [Vector; JOINTS];

/// Computes each joint's world rotation from the rig's rest pose to the source's.
pub(super) struct Alignment<'a> {
    pub(super) rig: &'a Rig,
    pub(super) mapping: &'a Mapping,
    pub(super) rest: &'a Rest,
    /// From the source's axes to the rig's.
    pub(super) axes: Quat,
    /// Minimum length of a bone that has a direction.
    pub(super) short: f32,
}

impl Alignment<'_> {
    /// `[55]`. Torso, neck, head, collars, eyes and jaw keep their rotations: both bodies are upright at rest, and
    /// the directions of these bones differ by anatomy. Limbs and fingers turn until their directions are the
    /// source's.
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

    /// Aligns each bone but the last, from the root of the limb outwards; each carries its descendants along.
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

    /// `carried`, followed by the remaining rotation from one direction to another.
    fn carry(&self, carried: Quat, from: Option<Vector>, to: Option<Vector>) -> Quat {
        let Some((from, to)) = from.zip(to) else { return carried };
        let ahead = rotate(self.axes, [0.0, 0.0, 1.0]);
        product(shortest(rotate(carried, from), to, ahead), carried)
    }

    /// Aligns the palm with the source's; the forearm takes half of the resulting wrist twist.
    fn hand(&self, turns: &mut [Quat; JOINTS], side: usize) {
        let (wrist, elbow) = (WRISTS[side], 18 + side);
        let first = 25 + 15 * side;
        if let Some(turn) = self.palm(wrist, first) {
            if let Some(along) = self.source(elbow, wrist) {
                let twist = twist(product(turn, inverse(turns[elbow])), along);
                // Wrap to the shorter way round.
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
                // The source's last finger bone continues the direction of the one before it.
                let to = if step < 2 { self.source(joint, joint + 1) } else { self.source(joint - 1, joint) };
                carried = self.carry(carried, self.target(joint, (step < 2).then_some(joint + 1)), to);
                turns[joint] = carried;
            }
        }
    }

    /// Rotation of the palm, from the direction wrist to knuckles and the line across the outermost two mapped
    /// knuckles.
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

    /// Feet stand flat in both rest poses, so only their heading can differ.
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

    /// Direction between two joints of the source at rest, in the rig's axes.
    fn source(&self, from: usize, to: usize) -> Option<Vector> {
        direction(less(self.rest[to], self.rest[from]), 1e-6).map(|v| rotate(self.axes, v))
    }

    /// Direction from a joint's bone to the next joint's or, without a next joint, to the bone's end.
    fn target(&self, from: usize, to: Option<usize>) -> Option<Vector> {
        let bone = self.mapping.bone(from)?;
        let end = to.and_then(|to| self.mapping.bone(to)).map(|to| self.rig.place(to));
        direction(less(end.or_else(|| self.rig.tip(bone))?, self.rig.place(bone)), self.short)
    }
}
