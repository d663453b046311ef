//! Two-bone inverse kinematics of a leg, with a given foot orientation.

use umo_core_base::functions::Functions;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse};

use super::rig::{Rig, add, after, length_of_two, turn_vector, unit};

/// Hip, knee, ankle and foot joint of the left and the right leg.
const JOINTS_OF_LEGS: [[usize; 4]; 2] = [[1, 4, 7, 10], [2, 5, 8, 11]];

/// Plausible bone lengths of a leg, metres.
const BONE_LENGTHS: std::ops::RangeInclusive<f32> = 0.05..=2.0;
/// Plausible distances from the ankle forward to the ball of the foot, metres.
const SOLE_LENGTHS: std::ops::RangeInclusive<f32> = 0.02..=0.5;

/// Largest extension as a share of the straight leg's length: the knee never snaps.
const MAX_EXTENSION: f32 = 0.998;

/// Forward bias of the knee, metres: defines the bending plane of a straight leg.
const KNEE_FORWARD_BIAS: f32 = 0.03;

/// Largest rise of the heel, radians.
const MAX_HEEL_RISE: f32 = 0.7;

/// The bones of one leg.
#[derive(Clone, Copy, Debug)]
pub(super) struct Leg {
    pub(super) joints: [usize; 4],
    /// Position of the hip in the pelvis' frame.
    hip: [f32; 3],
    knee: [f32; 3],
    ankle: [f32; 3],
    /// Position of the foot joint, which is the ball of the foot, in the ankle's frame.
    pub(super) ball: [f32; 3],
    thigh: f32,
    shin: f32,
}

/// Positions (metres) and rotations of a leg's joints in the avatar's space.
#[derive(Clone, Copy, Debug)]
pub(super) struct Posed {
    pub(super) hip: [f32; 3],
    knee: [f32; 3],
    ankle: [f32; 3],
    pub(super) ball: [f32; 3],
    /// Rotations of hip, knee and ankle.
    turned: [Quat; 3],
}

impl Posed {
    /// Rotation of the foot.
    pub(super) fn foot(&self) -> Quat {
        self.turned[2]
    }
}

impl Leg {
    /// Creates the left leg (0) or the right leg (1); `None` if the skeleton has no plausible leg.
    pub(crate) fn new(rig: &Rig, side: usize) -> Option<Self> {
        let joints = JOINTS_OF_LEGS[side];
        let parents = [0, joints[0], joints[1], joints[2]];
        if joints.iter().zip(parents).any(|(&joint, parent)| rig.parents[joint] != parent) {
            return None;
        }
        let [hip, knee, ankle, ball] = joints.map(|joint| rig.offsets[joint]);
        let (thigh, shin) = (length(knee), length(ankle));
        let is_leg = BONE_LENGTHS.contains(&thigh) && BONE_LENGTHS.contains(&shin) && SOLE_LENGTHS.contains(&ball[2]);
        let is_down = knee[1] < -0.7 * thigh && ankle[1] < -0.7 * shin && ball[1] < 0.0;
        (is_leg && is_down).then_some(Self { joints, hip, knee, ankle, ball, thigh, shin })
    }

    /// Length of the straight leg from hip to ankle.
    pub(crate) fn length(&self) -> f32 {
        self.thigh + self.shin
    }

    /// Returns the joints of the leg in a pose; `pelvis` is the position of the root joint.
    pub(super) fn posed(&self, pose: &Pose, pelvis: [f32; 3]) -> Posed {
        let root = pose.rotations[0];
        let hip = add(pelvis, turn_vector(root, self.hip));
        let mut turned = [IDENTITY; 3];
        turned[0] = after(root, pose.rotations[self.joints[0]]);
        let knee = add(hip, turn_vector(turned[0], self.knee));
        turned[1] = after(turned[0], pose.rotations[self.joints[1]]);
        let ankle = add(knee, turn_vector(turned[1], self.ankle));
        turned[2] = after(turned[1], pose.rotations[self.joints[2]]);
        Posed { hip, knee, ankle, ball: add(ankle, turn_vector(turned[2], self.ball)), turned }
    }

    /// Returns the ankle position for the ball of the foot at `ball` and the foot rotation `foot`.
    pub(super) fn ankle_over(&self, ball: [f32; 3], foot: Quat) -> [f32; 3] {
        sub(ball, turn_vector(foot, self.ball))
    }

    /// Returns the angle in radians by which the heel must rise over the ball, about the foot's x axis, for
    /// the leg to reach the ankle; 0 if it reaches with a flat foot.
    pub(super) fn heel_rise(&self, hip: [f32; 3], ball: [f32; 3], foot: Quat) -> f32 {
        let most = MAX_EXTENSION * self.length();
        // In the foot's frame the ankle moves on a circle about the ball.
        let to = turn_vector(inverse(foot), sub(hip, ball));
        let from = self.ball.map(|v| -v);
        if length(sub(to, from)) <= most {
            return 0.0;
        }
        let (radius, distance) = (length_of_two(from[1], from[2]), length_of_two(to[1], to[2]));
        let wanted = most * most - (to[0] - from[0]).powi(2);
        let cos = (radius * radius + distance * distance - wanted) / (2.0 * radius * distance).max(1e-9);
        let between = cos.clamp(-1.0, 1.0).arc_cosine();
        let rise = to[2].arc_tangent_over(to[1]) - between - from[2].arc_tangent_over(from[1]);
        rise.clamp(0.0, MAX_HEEL_RISE)
    }

    /// Turns hip, knee and ankle so that the ankle reaches `ankle`, or as near as the leg extends, with the
    /// foot rotation `foot`. The knee stays in its plane.
    pub(super) fn reach(&self, pose: &mut Pose, posed: &Posed, ankle: [f32; 3], foot: Quat) {
        let to = sub(ankle, posed.hip);
        let least = (self.thigh - self.shin).abs() + 0.05 * self.length();
        let distance = length(to).clamp(least, MAX_EXTENSION * self.length());
        let Some(along) = direction(to) else { return };
        let x = (self.thigh.powi(2) - self.shin.powi(2) + distance * distance) / (2.0 * distance);
        let y = (self.thigh * self.thigh - x * x).max(0.0).sqrt();
        let thigh = sub(posed.knee, posed.hip);
        let leg = direction(sub(posed.ankle, posed.hip)).unwrap_or(along);
        let forward = turn_vector(posed.turned[0], [0.0, 0.0, KNEE_FORWARD_BIAS]);
        let pole = without(add(without(thigh, leg), forward), along);
        let Some(pole) = direction(pole) else { return };
        let knee: [f32; 3] = std::array::from_fn(|i| posed.hip[i] + x * along[i] + y * pole[i]);
        let ankle: [f32; 3] = std::array::from_fn(|i| posed.hip[i] + distance * along[i]);
        let first = between(thigh, sub(knee, posed.hip));
        let hip = after(first, posed.turned[0]);
        let carried = after(first, posed.turned[1]);
        let second = between(turn_vector(carried, self.ankle), sub(ankle, knee));
        let shin = after(second, carried);
        let [hip_joint, knee_joint, ankle_joint, _] = self.joints;
        pose.rotations[hip_joint] = unit(after(inverse(pose.rotations[0]), hip));
        pose.rotations[knee_joint] = unit(after(inverse(hip), shin));
        pose.rotations[ankle_joint] = unit(after(inverse(shin), foot));
    }
}

pub(super) fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|i| a[i] - b[i])
}

fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn length(v: [f32; 3]) -> f32 {
    dot(v, v).sqrt()
}

/// Normalizes `v`; `None` if it has no direction.
fn direction(v: [f32; 3]) -> Option<[f32; 3]> {
    let length = length(v);
    (length > 1e-6 && length.is_finite()).then(|| v.map(|v| v / length))
}

/// Returns `v` without its component along the unit vector `axis`.
fn without(v: [f32; 3], axis: [f32; 3]) -> [f32; 3] {
    let along = dot(v, axis);
    std::array::from_fn(|i| v[i] - along * axis[i])
}

/// Returns the shortest rotation from the direction of `a` to that of `b`.
fn between(a: [f32; 3], b: [f32; 3]) -> Quat {
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    unit([cross[0], cross[1], cross[2], length(a) * length(b) + dot(a, b)])
}

#[cfg(test)]
mod tests {
    use super::super::rig::{DEGREE, turn};
    use super::super::trial::{face, skeleton, standing};
    use super::*;

    fn rig() -> Rig {
        Rig::new(&skeleton(), &face(true), &standing())
    }

    #[test]
    fn an_ankle_comes_where_it_is_wanted_and_the_foot_is_turned_so() {
        let rig = rig();
        for side in 0..2 {
            let leg = Leg::new(&rig, side).unwrap();
            for case in 0_u8..60 {
                let amount = f32::from(case) / 60.0;
                let mut pose = standing();
                pose.rotations[0] = turn([0.1 * amount, 0.4 - amount, 0.05]);
                pose.rotations[leg.joints[0]] = turn([-0.5 * amount, 0.1, 0.05]);
                pose.rotations[leg.joints[1]] = turn([0.9 * amount, 0.0, 0.0]);
                let posed = leg.posed(&pose, pose.translation);
                let ankle = add(posed.hip, [0.1 * amount, -0.78 + 0.3 * amount, 0.15 - 0.2 * amount]);
                let foot = turn([0.2, 0.5 - amount, 0.0]);
                leg.reach(&mut pose, &posed, ankle, foot);
                let (places, turned) = rig.world(&pose);
                let off = length(sub(places[leg.joints[2]], ankle));
                assert!(off < 1e-4, "{case}: {off} m from the goal");
                assert!(
                    dot(turn_vector(turned[leg.joints[2]], [0.0, 0.0, 1.0]), turn_vector(foot, [0.0, 0.0, 1.0]))
                        > 0.9999
                );
                // The knee bends forwards from the line between hip and ankle.
                let bend = without(sub(places[leg.joints[1]], posed.hip), direction(sub(ankle, posed.hip)).unwrap());
                assert!(dot(bend, turn_vector(pose.rotations[0], [0.0, 0.0, 1.0])) > 0.0, "{case}: {bend:?}");
            }
        }
    }

    #[test]
    fn a_leg_is_never_quite_straight() {
        let leg = Leg::new(&rig(), 0).unwrap();
        let mut pose = standing();
        let posed = leg.posed(&pose, pose.translation);
        leg.reach(&mut pose, &posed, add(posed.hip, [0.0, -2.0, 0.0]), IDENTITY);
        let after = leg.posed(&pose, pose.translation);
        assert!(length(sub(after.ankle, after.hip)) < 0.9985 * leg.length());
    }

    #[test]
    fn a_heel_rises_as_far_as_the_leg_is_short() {
        let leg = Leg::new(&rig(), 1).unwrap();
        let hip = [-0.08, 0.89, 0.0];
        let mut last = 0.0;
        for raised in 0_u8..10 {
            let ball = [-0.1, 0.02 - 0.005 * f32::from(raised), 0.09];
            let foot = turn([0.0, -10.0 * DEGREE, 0.0]);
            let rise = leg.heel_rise(hip, ball, foot);
            assert!(rise >= last && rise < MAX_HEEL_RISE, "{rise} after {last}");
            last = rise;
            let ankle = leg.ankle_over(ball, after(foot, turn([rise, 0.0, 0.0])));
            let reach = length(sub(ankle, hip));
            assert!(reach <= MAX_EXTENSION * leg.length() + 1e-5, "{reach} m");
            assert!(rise == 0.0 || reach > 0.99 * leg.length(), "no more than needed");
        }
        assert!(last > 0.1, "{last}");
    }

    #[test]
    fn odd_bones_are_no_leg() {
        let mut odd = skeleton();
        odd.offsets_m[4] = [0.0; 3];
        assert!(Leg::new(&Rig::new(&odd, &face(true), &standing()), 0).is_none());
        let mut odd = skeleton();
        odd.offsets_m[8] = [0.0, 0.4, 0.0];
        assert!(Leg::new(&Rig::new(&odd, &face(true), &standing()), 1).is_none());
        assert!(Leg::new(&Rig::new(&odd, &face(true), &standing()), 0).is_some());
    }
}
