//! Inverse kinematics of an arm with its hand at a given place: two bones, a shoulder girdle that
//! follows, and a wrist within its limits.

use std::f32::consts::PI;
use umo_core_base::functions::Functions;

use umo_core_pose::rotation::{
    Matrix, Quat, axis_angle_to_quat, inverse, matrix_to_quat, product, quat_to_axis_angle, rotate,
};
use umo_core_pose::skeleton::FIRST_FINGER;

use super::hand::{self, FINGER_JOINTS, Shape};
use crate::rig::{Rig, add, length_of_two};

/// Largest distance of the wrist from the shoulder, as a share of the arm: the elbow stays slightly bent.
const MAX_REACH: f32 = 0.985;
/// Share of the elbow joint in the forearm's twist; the wrist has the rest.
const ELBOW_TWIST_SHARE: f32 = 0.6;
/// Largest twist of a forearm, radians.
const MAX_TWIST: f32 = 1.75;
/// Largest bend of a wrist, radians.
const MAX_BEND: f32 = 1.2;

pub(crate) type Vec3 = [f32; 3];

/// Target pose of an arm. Directions and positions are outwards, up, forwards relative to the trunk, so
/// that they hold for both arms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ArmTarget {
    /// Position of the wrist relative to the shoulder, in arm lengths.
    pub(crate) hand: Vec3,
    /// Direction of the elbow.
    pub(crate) elbow: Vec3,
    /// Direction of straight fingers.
    pub(crate) fingers: Vec3,
    /// Direction that the palm faces.
    pub(crate) palm: Vec3,
    pub(crate) shape: Shape,
}

/// The joints of an arm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Arm {
    pub(crate) collar: usize,
    pub(crate) shoulder: usize,
    pub(crate) elbow: usize,
    pub(crate) wrist: usize,
    pub(crate) first_finger: usize,
    /// 1 for the left arm, which is towards +X, -1 for the right one.
    pub(crate) side: f32,
}

pub(crate) const LEFT: Arm =
    Arm { collar: 13, shoulder: 16, elbow: 18, wrist: 20, first_finger: FIRST_FINGER, side: 1.0 };
pub(crate) const RIGHT: Arm =
    Arm { collar: 14, shoulder: 17, elbow: 19, wrist: 21, first_finger: FIRST_FINGER + FINGER_JOINTS, side: -1.0 };

/// The rotations of an arm's joints, relative to their parents.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArmPose {
    pub(crate) collar: Quat,
    pub(crate) shoulder: Quat,
    pub(crate) elbow: Quat,
    pub(crate) wrist: Quat,
    pub(crate) fingers: [Quat; FINGER_JOINTS],
}

impl Arm {
    pub(super) fn is_left(self) -> bool {
        self.side > 0.0
    }

    /// Converts a direction between an arm's (outwards, up, forwards) and the trunk's; its own inverse.
    pub(crate) fn sided(self, [out, up, ahead]: Vec3) -> Vec3 {
        [self.side * out, up, ahead]
    }

    /// Length of the arm, metres.
    pub(crate) fn length(self, rig: &Rig) -> f32 {
        length(rig.offsets[self.elbow]) + length(rig.offsets[self.wrist])
    }

    /// Returns the position of the shoulder in the trunk's frame, for a rotation of the girdle.
    fn shoulder_place(self, rig: &Rig, collar: Quat) -> Vec3 {
        add(rig.offsets[self.collar], rotate(collar, rig.offsets[self.shoulder]))
    }

    /// Returns the rotation of the girdle for a hand position: it rises and moves forward with the hand.
    fn girdle(self, [out, up, ahead]: Vec3) -> Quat {
        let rise = 0.30 * ((up + 0.35) / 1.3).clamp(0.0, 1.0);
        let forward = 0.22 * (0.9 * ahead - 0.5 * out - 0.15).clamp(0.0, 1.0);
        axis_angle_to_quat([0.0, -self.side * forward, self.side * rise])
    }

    /// Returns the direction of the index finger of a straight hand at rest.
    pub(super) fn index_at_rest(self, rig: &Rig) -> Vec3 {
        let bones = add(rig.offsets[self.first_finger + 1], rig.offsets[self.first_finger + 2]);
        unit(bones, [self.side, 0.0, 0.0])
    }

    /// Returns the arm pose that brings the hand to `target`, or as near as it reaches. `pointer` is the
    /// direction at rest that `target.fingers` aligns; the hand's own if `None`.
    pub(crate) fn pose(self, rig: &Rig, target: &ArmTarget, pointer: Option<Vec3>) -> ArmPose {
        let out = [self.side, 0.0, 0.0];
        let collar = self.girdle(target.hand);
        let (upper, lower) = (rig.offsets[self.elbow], rig.offsets[self.wrist]);
        let (a, b) = (length(upper), length(lower));
        let at = self.sided(target.hand).map(|v| v * (a + b));
        let way = unit(at, [0.0, -1.0, 0.0]);
        let distance = length(at).clamp((a - b).abs() + 0.1 * b, MAX_REACH * (a + b)).max(1e-6);
        // Direction of the elbow, perpendicular to the line from shoulder to hand.
        let pole = unit(aside(self.sided(target.elbow), way), aside([0.0, -0.6, -0.8], way));
        let pole = unit(pole, [0.0, 0.0, -1.0]);
        let cosine = ((a * a + distance * distance - b * b) / (2.0 * a * distance).max(1e-9)).clamp(-1.0, 1.0);
        let sine = (1.0 - cosine * cosine).sqrt();
        let first: Vec3 = std::array::from_fn(|i| way[i] * cosine + pole[i] * sine);
        let second: Vec3 = std::array::from_fn(|i| way[i] * distance - first[i] * a);
        let second = unit(second, first);
        // At rest, with arms held out, elbows bend forwards.
        let hinge = unit(cross(pole, way), [0.0, 1.0, 0.0]);
        let hinge_at_rest = [0.0, -self.side, 0.0];
        let (rest_upper, rest_lower) = (unit(upper, out), unit(lower, out));
        let shoulder = turn(rest_upper, hinge_at_rest, first, hinge);
        let forearm = turn(rest_lower, hinge_at_rest, second, hinge);
        let fingers_at_rest = pointer.unwrap_or_else(|| unit(rig.offsets[self.first_finger + 3], out));
        let hand = turn(fingers_at_rest, [0.0, -1.0, 0.0], self.sided(target.fingers), self.sided(target.palm));
        let (twist, bend) = twist_and_bend(product(inverse(forearm), hand), rest_lower);
        let forearm = product(forearm, about(rest_lower, ELBOW_TWIST_SHARE * twist));
        let wrist = product(about(rest_lower, (1.0 - ELBOW_TWIST_SHARE) * twist), bend);
        ArmPose {
            collar,
            shoulder: product(inverse(collar), shoulder),
            elbow: product(inverse(shoulder), forearm),
            wrist,
            fingers: hand::joints(&target.shape, self.is_left()),
        }
    }

    /// Returns the arm pose that points at a place in the trunk's frame.
    pub(super) fn pointing(self, rig: &Rig, place: Vec3, shape: &Shape) -> ArmPose {
        let reach = 0.90;
        let whole = self.length(rig).max(1e-6);
        let mut target = ArmTarget {
            hand: [0.0; 3],
            elbow: [0.55, -1.0, -0.35],
            fingers: [0.0, 0.0, 1.0],
            palm: [-0.45, -1.0, 0.0],
            shape: *shape,
        };
        // Iterates, because girdle and hand position depend on each other.
        let mut shoulder = self.shoulder_place(rig, axis_angle_to_quat([0.0; 3]));
        for _ in 0..3 {
            let way = self.within_limits(unit(less(place, shoulder), [0.0, 0.0, 1.0]));
            target.hand = self.sided(way).map(|v| v * reach);
            shoulder = self.shoulder_place(rig, self.girdle(target.hand));
        }
        // Aims from the knuckle of the index finger, which is beside the arm's line.
        let index = self.index_at_rest(rig);
        let mut way = unit(self.sided(target.hand), [0.0, 0.0, 1.0]);
        let wrist = add(shoulder, way.map(|v| v * reach * whole));
        for _ in 0..3 {
            let hand = turn(index, [0.0, -1.0, 0.0], way, self.sided(target.palm));
            let knuckle = add(wrist, rotate(hand, rig.offsets[self.first_finger]));
            way = unit(less(place, knuckle), way);
        }
        target.fingers = self.sided(way);
        self.pose(rig, &target, Some(index))
    }

    /// Limits a direction to the arm's range: not behind the back, not through the chest.
    fn within_limits(self, way: Vec3) -> Vec3 {
        let [out, up, ahead] = self.sided(way);
        let level = length_of_two(out, ahead).max(1e-6);
        let azimuth = out.arc_tangent_over(ahead).clamp(-0.75, 1.95);
        let elevation = up.arc_tangent_over(level).clamp(-1.15, 1.3);
        let level = elevation.cosine();
        self.sided([azimuth.sine() * level, elevation.sine(), azimuth.cosine() * level])
    }
}

/// Splits a hand's rotation into a twist about the forearm's axis and a bend, both limited to the range
/// of a wrist.
fn twist_and_bend(relative: Quat, axis: Vec3) -> (f32, Quat) {
    let [x, y, z, w] = relative;
    let twist = 2.0 * dot([x, y, z], axis).arc_tangent_over(w);
    let twist = if twist > PI { twist - 2.0 * PI } else { twist };
    let bend = quat_to_axis_angle(product(inverse(about(axis, twist)), relative));
    let angle = length(bend);
    let share = if angle > MAX_BEND { MAX_BEND / angle } else { 1.0 };
    (twist.clamp(-MAX_TWIST, MAX_TWIST), axis_angle_to_quat(bend.map(|v| v * share)))
}

pub(super) fn about(axis: Vec3, angle: f32) -> Quat {
    axis_angle_to_quat(axis.map(|v| v * angle))
}

/// Returns the rotation that takes direction `a` to `to`, and the side on which `b` lies to the side on
/// which `side` lies.
fn turn(a: Vec3, b: Vec3, to: Vec3, side: Vec3) -> Quat {
    let (from, to) = (frame(a, b), frame(to, side));
    let matrix: Matrix =
        std::array::from_fn(|row| std::array::from_fn(|column| (0..3).map(|i| to[i][row] * from[i][column]).sum()));
    matrix_to_quat(matrix)
}

/// Returns an orthonormal frame: `a`, the perpendicular towards `b`, and their cross product.
fn frame(a: Vec3, b: Vec3) -> [Vec3; 3] {
    let a = unit(a, [1.0, 0.0, 0.0]);
    let any = if a[1].abs() < 0.8 { [0.0, 1.0, 0.0] } else { [1.0, 0.0, 0.0] };
    let b = unit(aside(b, a), unit(aside(any, a), any));
    [a, b, cross(a, b)]
}

/// Returns `v` without its component along the unit vector `axis`.
fn aside(v: Vec3, axis: Vec3) -> Vec3 {
    let along = dot(v, axis);
    std::array::from_fn(|i| v[i] - along * axis[i])
}

pub(super) fn unit(v: Vec3, otherwise: Vec3) -> Vec3 {
    let length = length(v);
    if length > 1e-5 { v.map(|x| x / length) } else { otherwise }
}

pub(super) fn length(v: Vec3) -> f32 {
    dot(v, v).sqrt()
}

pub(super) fn dot(a: Vec3, b: Vec3) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(super) fn less(a: Vec3, b: Vec3) -> Vec3 {
    std::array::from_fn(|i| a[i] - b[i])
}
