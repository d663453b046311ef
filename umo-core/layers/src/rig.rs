//! Body and face of a model as the layers need them: bones, and the index of each ARKit shape.

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};
pub(super) use umo_core_base::voice::step;
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse, product, rotate};
use umo_core_pose::skeleton::{ARKIT_NAMES, JAW, JOINTS, Skeleton};

/// The left leg's joints below the hip.
const KNEE: usize = 4;
const ANKLE: usize = 7;

/// Head joint.
pub(super) const HEAD: usize = 15;

/// Neck joint.
pub(super) const NECK: usize = 12;

/// Joints of the trunk between pelvis and neck, from below.
pub(super) const SPINE: [usize; 3] = [3, 6, 9];

/// Eye joints, left before right.
pub(super) const EYES: [usize; 2] = [JAW + 1, JAW + 2];

/// One degree in radians.
pub(super) const DEGREE: f32 = std::f32::consts::PI / 180.0;

/// Bones at rest, and the face's channels.
#[derive(Debug)]
pub(crate) struct Rig {
    /// Parent of each joint; the first joint has none and is its own parent.
    pub(crate) parents: [usize; JOINTS],
    /// Position of each joint in its parent's frame at rest, metres.
    pub(crate) offsets: [[f32; 3]; JOINTS],
    /// Index in a frame's face values of each shape of [`ARKIT_NAMES`] that the model has; all `None` with
    /// another kind of face.
    pub(crate) shapes: [Option<usize>; ARKIT_NAMES.len()],
    /// Rest pose of the model.
    pub(crate) rest: Pose,
    /// Rotations of [`ARMS`] with both arms down: as at rest the arm whose wrist is lower, and its mirror's image.
    pub(crate) arms_down: [Quat; ARMS.len()],
    /// Joints from the root to the head.
    head_chain: [usize; JOINTS],
    /// Number of those joints.
    head_chain_len: usize,
    /// Midpoint between the eyes in the head's frame, metres.
    eyes: [f32; 3],
    /// Height of the midpoint between the eyes at rest, metres.
    pub(super) eye_height: f32,
    /// Length of a leg from hip to ankle, metres; at least 0.1.
    pub(super) leg: f32,
}

/// Joints of the arms, the left and the right one of each in turn.
pub(crate) const ARMS: [usize; 8] = [13, 14, 16, 17, 18, 19, 20, 21];
const WRISTS: [usize; 2] = [20, 21];

/// Returns a rotation mirrored between left and right.
pub(super) fn mirrored([x, y, z, w]: Quat) -> Quat {
    [x, -y, -z, w]
}

/// Returns the index of a shape in [`ARKIT_NAMES`].
pub(super) const fn arkit(name: &str) -> usize {
    let mut shape = 0;
    while shape < ARKIT_NAMES.len() {
        if is_equal(ARKIT_NAMES[shape].as_bytes(), name.as_bytes()) {
            return shape;
        }
        shape += 1;
    }
    panic!("not a name of ARKit's")
}

const fn is_equal(a: &[u8], b: &[u8]) -> bool {
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

impl Rig {
    pub(crate) fn new(skeleton: &Skeleton, face: &Face, rest: &Pose) -> Self {
        let is_arkit = face.kind == FaceKind::Arkit;
        let find = |name: &str| face.names.iter().position(|known| known == name);
        let mut rig = Self {
            parents: std::array::from_fn(|joint| usize::try_from(skeleton.parents[joint]).unwrap_or(joint)),
            offsets: std::array::from_fn(|joint| skeleton.offsets_m[joint]),
            shapes: std::array::from_fn(|shape| find(ARKIT_NAMES[shape]).filter(|_| is_arkit)),
            rest: *rest,
            arms_down: [IDENTITY; ARMS.len()],
            head_chain: [HEAD; JOINTS],
            head_chain_len: 1,
            eyes: [0.0; 3],
            eye_height: 0.0,
            leg: 0.0,
        };
        let length = |v: [f32; 3]| v.iter().map(|v| v * v).sum::<f32>().sqrt();
        rig.leg = (length(rig.offsets[KNEE]) + length(rig.offsets[ANKLE])).max(0.1);
        let mut joint = HEAD;
        while rig.parents[joint] < joint {
            joint = rig.parents[joint];
            rig.head_chain[rig.head_chain_len] = joint;
            rig.head_chain_len += 1;
        }
        rig.head_chain[..rig.head_chain_len].reverse();
        let (places, turned) = rig.world(&rig.rest);
        let lower = usize::from(places[WRISTS[1]][1] < places[WRISTS[0]][1]);
        rig.arms_down = std::array::from_fn(|at| {
            let rotation = rig.rest.rotations[ARMS[at - at % 2 + lower]];
            if at % 2 == lower { rotation } else { mirrored(rotation) }
        });
        let between: [f32; 3] = std::array::from_fn(|axis| 0.5 * (places[EYES[0]][axis] + places[EYES[1]][axis]));
        let from_head = std::array::from_fn(|axis| between[axis] - places[HEAD][axis]);
        rig.eyes = rotate(inverse(turned[HEAD]), from_head);
        rig.eye_height = between[1];
        rig
    }

    /// Returns the midpoint between the eyes, metres, and the head's rotation, in the avatar's space.
    pub(super) fn head(&self, pose: &Pose) -> ([f32; 3], Quat) {
        let (mut place, mut turned) = (pose.translation, IDENTITY);
        for &joint in &self.head_chain[..self.head_chain_len] {
            place = add(place, turn_vector(turned, self.offsets[joint]));
            turned = after(turned, pose.rotations[joint]);
        }
        let turned = unit(turned);
        (add(place, turn_vector(turned, self.eyes)), turned)
    }

    /// Returns position (metres) and rotation of each joint in the avatar's space.
    pub(crate) fn world(&self, pose: &Pose) -> ([[f32; 3]; JOINTS], [Quat; JOINTS]) {
        let mut places = [[0.0; 3]; JOINTS];
        let mut turned = [IDENTITY; JOINTS];
        for joint in 0..JOINTS {
            let parent = self.parents[joint];
            let offset = self.offsets[joint];
            if parent == joint {
                places[joint] = add(offset, pose.translation);
                turned[joint] = pose.rotations[joint];
            } else {
                places[joint] = add(places[parent], rotate(turned[parent], offset));
                turned[joint] = product(turned[parent], pose.rotations[joint]);
            }
        }
        (places, turned)
    }

    /// Returns a face value by its index in [`ARKIT_NAMES`]; 0 if the model lacks the shape.
    pub(crate) fn shape(&self, face: &[f32], shape: usize) -> f32 {
        self.shapes[shape].map_or(0.0, |index| face[index])
    }

    /// Sets a face value by its index in [`ARKIT_NAMES`], clamped to 0 to 1; a no-op if the model lacks the
    /// shape.
    pub(crate) fn set_shape(&self, face: &mut [f32], shape: usize, value: f32) {
        if let Some(index) = self.shapes[shape] {
            face[index] = value.clamp(0.0, 1.0);
        }
    }
}

/// Returns the length of a 2-vector. Not `hypot`, which would need glibc 2.35.
pub(crate) fn length_of_two(a: f32, b: f32) -> f32 {
    (a * a + b * b).sqrt()
}

/// Returns the sum of two vectors.
pub(crate) fn add(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|axis| a[axis] + b[axis])
}

// Rotations in f32 for the many small turns of a tick. The functions of `motion::rotation` are exact to
// the last bit and cost several times as much.

/// Returns the rotation `a` after `b`, not normalized.
pub(super) fn after(a: Quat, b: Quat) -> Quat {
    let ([ax, ay, az, aw], [bx, by, bz, bw]) = (a, b);
    [
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    ]
}

/// Normalizes `q`, with `w >= 0`; the identity if it has no direction.
pub(super) fn unit(q: Quat) -> Quat {
    let square: f32 = q.iter().map(|v| v * v).sum();
    if !(square > 1e-12 && square.is_finite()) {
        return IDENTITY;
    }
    let scale = q[3].signum() / square.sqrt();
    q.map(|v| v * scale)
}

/// Interpolates from `a` to `b` by `share`, for rotations that are close together.
pub(super) fn toward(a: Quat, b: Quat, share: f32) -> Quat {
    let dot: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    unit(std::array::from_fn(|i| (1.0 - share) * a[i] + share * sign * b[i]))
}

/// Returns the rotation about `v` by its length in radians.
pub(super) fn turn(v: [f32; 3]) -> Quat {
    let angle = (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt();
    if !angle.is_finite() {
        return IDENTITY;
    }
    let (sin, cos) = (0.5 * angle).sine_cosine();
    let scale = if angle < 1e-4 { 0.5 } else { sin / angle };
    [v[0] * scale, v[1] * scale, v[2] * scale, cos]
}

/// Rotates a joint about its parent's axes; `v` is an axis times an angle in radians.
pub(super) fn turn_in_parent(q: &mut Quat, v: [f32; 3]) {
    *q = unit(after(turn(v), *q));
}

/// Rotates a joint about its own axes; `v` is an axis times an angle in radians.
pub(super) fn turn_in_own(q: &mut Quat, v: [f32; 3]) {
    *q = unit(after(*q, turn(v)));
}

/// Rotates `v` by the unit quaternion `q`.
pub(super) fn turn_vector(q: Quat, v: [f32; 3]) -> [f32; 3] {
    let cross =
        |a: [f32; 3], b: [f32; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let axis = [q[0], q[1], q[2]];
    let twice = cross(axis, v).map(|v| 2.0 * v);
    let more = cross(axis, twice);
    std::array::from_fn(|i| v[i] + q[3] * twice[i] + more[i])
}

/// Returns the angle between two rotations, radians, if it is small; an underestimate if it is not.
pub(super) fn angle_between(a: Quat, b: Quat) -> f32 {
    let [x, y, z, _] = after(inverse(a), b);
    2.0 * (x * x + y * y + z * z).sqrt()
}

/// Smooth step from 0 to 1, at rest at both ends.
pub(super) fn ease(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Two springs one after the other: follows a goal that jumps without a jump of the acceleration.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Soft {
    halfway: Spring,
    end: Spring,
}

impl Soft {
    pub(super) const ZERO: Self = Self::at(0.0);

    /// At rest at `value`.
    pub(super) const fn at(value: f32) -> Self {
        Self { halfway: Spring::at(value), end: Spring::at(value) }
    }

    pub(super) fn value(&self) -> f32 {
        self.end.at
    }

    /// As [`Spring::follow`].
    pub(super) fn follow(&mut self, goal: f32, rate: f32, seconds: f32) {
        self.halfway.follow(goal, rate, seconds);
        self.end.follow(self.halfway.at, rate, seconds);
    }

    /// Whether values and speeds are at most `most`.
    pub(super) fn is_within(&self, most: f32) -> bool {
        self.halfway.is_within(most) && self.end.is_within(most)
    }

    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.halfway.state(pass)?;
        self.end.state(pass)
    }
}

/// Critically damped spring: follows a goal without overshoot.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Spring {
    pub(super) at: f32,
    speed: f32,
}

impl Spring {
    pub(super) const ZERO: Self = Self::at(0.0);

    /// At rest at `value`.
    pub(super) const fn at(value: f32) -> Self {
        Self { at: value, speed: 0.0 }
    }

    /// Moves towards `goal`; `rate` is the spring's frequency in radians a second.
    pub(super) fn follow(&mut self, goal: f32, rate: f32, seconds: f32) {
        let away = self.at - goal;
        let slope = self.speed + rate * away;
        let decay = (-rate * seconds).exponential();
        self.at = goal + (away + slope * seconds) * decay;
        self.speed = (self.speed - rate * slope * seconds) * decay;
    }

    /// Whether value and speed are at most `most`.
    pub(super) fn is_within(&self, most: f32) -> bool {
        self.at.abs() <= most && self.speed.abs() <= most
    }

    /// Saves or loads the spring.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.moderate(std::slice::from_mut(&mut self.at))?;
        pass.moderate(std::slice::from_mut(&mut self.speed))
    }
}

#[cfg(test)]
mod tests {
    use umo_core_pose::rotation::axis_angle_to_quat;

    use super::*;

    fn is_near<const N: usize>(a: [f32; N], b: [f32; N]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6)
    }

    #[test]
    fn quick_rotations_are_those_of_the_motion() {
        for i in 0_u8..80 {
            let v = [0.02, -0.03, 0.01].map(|v| v * f32::from(i));
            let (q, p) = (axis_angle_to_quat(v), axis_angle_to_quat([0.5, 0.2, -0.01 * f32::from(i)]));
            assert!(is_near(turn(v), q));
            assert!(is_near(unit(after(p, q)), product(p, q)));
            assert!(is_near(turn_vector(q, [0.3, -0.2, 0.9]), rotate(q, [0.3, -0.2, 0.9])));
        }
        assert_eq!(unit([0.0; 4]), IDENTITY);
        assert_eq!(unit([f32::NAN; 4]), IDENTITY);
        assert_eq!(turn([f32::INFINITY, 0.0, 0.0]), IDENTITY);
    }

    #[test]
    fn a_spring_arrives_without_overshoot() {
        let mut spring = Spring::default();
        let way: Vec<f32> = (0..60)
            .map(|_| {
                spring.follow(1.0, 12.0, 1.0 / 30.0);
                spring.at
            })
            .collect();
        assert!(way.windows(2).all(|pair| pair[1] >= pair[0]));
        assert!(way[14] > 0.95 && way[59] <= 1.0 + 1e-6, "{way:?}");
    }
}
