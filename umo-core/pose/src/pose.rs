//! The pose of one frame: conversion between the channels of four parts and the rotations of 55 joints with
//! face values.

use super::rotation::{IDENTITY, Quat, axis_angle_to_quat, product, quat_to_six, six_to_quat};
use super::skeleton::{JAW, JOINTS, LOWER_JOINTS, joints_of};
use crate::face::{Face, FaceKind};
use crate::part::{Part, PerPart};

/// Number of channels of the lower body's 6D rotations.
pub const ROTATION_CHANNELS: usize = 6 * LOWER_JOINTS.len();

/// Channel of the velocity along x, m/s; the same in the network's input and output.
pub const VELOCITY_X: usize = ROTATION_CHANNELS;

/// Channel of the height of the pelvis, metres.
pub const HEIGHT: usize = ROTATION_CHANNELS + 1;

/// Channel of the velocity along z, m/s.
pub const VELOCITY_Z: usize = ROTATION_CHANNELS + 2;

/// First channel of foot contact, one per foot joint.
pub const FIRST_CONTACT: usize = ROTATION_CHANNELS + 3;

/// Index of the first face channel after the jaw's 6D rotation.
pub const FIRST_FACE_VALUE: usize = 6;

/// Joint of the left eye; the right eye follows.
const LEFT_EYE: usize = JAW + 1;

/// Sideways rotation of an ARKit eye at 1.0, in radians: 30 degrees.
pub const GAZE_SIDEWAYS: f32 = 30.0 / 180.0 * std::f32::consts::PI;

/// Up or down rotation of an ARKit eye at 1.0, in radians: 25 degrees.
pub const GAZE_UPWARDS: f32 = 25.0 / 180.0 * std::f32::consts::PI;

/// The body at one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Unit quaternion of each joint, relative to its parent, in SMPL-X order.
    pub rotations: [Quat; JOINTS],
    /// Position of the root, metres, Y up.
    pub translation: [f32; 3],
}

impl Pose {
    /// All joints at rest, root at the origin.
    pub const REST: Self = Self { rotations: [IDENTITY; JOINTS], translation: [0.0; 3] };
}

/// Converts channels to poses and face values for the model's type of face.
#[derive(Clone, Debug)]
pub struct Assembly {
    kind: FaceKind,
    values: usize,
    eyes: Option<[EyeChannels; 2]>,
}

/// Face values that rotate one eye.
#[derive(Clone, Copy, Debug)]
struct EyeChannels {
    down: usize,
    inwards: usize,
    outwards: usize,
    up: usize,
    /// 1 if outwards is towards +X (the left eye), -1 if it is towards -X.
    side: f32,
}

impl EyeChannels {
    fn find(names: &[String], eye: &str, side: f32) -> Option<Self> {
        let channel = |way: &str| names.iter().position(|name| *name == format!("eyeLook{way}{eye}"));
        Some(Self {
            down: channel("Down")?,
            inwards: channel("In")?,
            outwards: channel("Out")?,
            up: channel("Up")?,
            side,
        })
    }

    /// Yaw about Y, after pitch about X; the gaze at rest is along +Z.
    fn rotation(&self, values: &[f32]) -> Quat {
        let yaw = self.side * GAZE_SIDEWAYS * (values[self.outwards] - values[self.inwards]);
        let pitch = GAZE_UPWARDS * (values[self.down] - values[self.up]);
        product(axis_angle_to_quat([0.0, yaw, 0.0]), axis_angle_to_quat([pitch, 0.0, 0.0]))
    }
}

impl Assembly {
    /// Creates the conversion for a model's face. With ARKit channels the eyes follow `eyeLook…`; otherwise
    /// they stay at rest.
    #[inline]
    pub fn new(face: &Face) -> Self {
        let eyes = match face.kind {
            FaceKind::SmplxExpression => None,
            FaceKind::Arkit => EyeChannels::find(&face.names, "Left", 1.0)
                .zip(EyeChannels::find(&face.names, "Right", -1.0))
                .map(|(left, right)| [left, right]),
        };
        Self { kind: face.kind, values: face.names.len(), eyes }
    }

    /// Number of face values per frame.
    #[inline]
    pub fn face_values(&self) -> usize {
        self.values
    }

    /// Whether face values are ARKit's, between 0 and 1.
    #[inline]
    pub fn is_arkit(&self) -> bool {
        self.kind == FaceKind::Arkit
    }

    /// Converts one frame's channels to rotations. Joints outside the parts, such as the eyes, are at rest.
    #[inline]
    pub fn rotations(&self, channels: PerPart<&[f32]>) -> [Quat; JOINTS] {
        let mut rotations = [IDENTITY; JOINTS];
        for part in Part::ALL {
            for (joint, &six) in joints_of(part).zip(channels[part].as_chunks().0) {
                rotations[joint] = six_to_quat(six);
            }
        }
        rotations
    }

    /// Converts one frame's face channels to face values: clamps ARKit's to 0 to 1, and copies others. Values
    /// that are not finite become 0.
    #[inline]
    pub fn face(&self, channels: &[f32], values: &mut [f32]) {
        for (value, &channel) in values.iter_mut().zip(&channels[FIRST_FACE_VALUE..]) {
            *value = match self.kind {
                FaceKind::Arkit => finite(channel).clamp(0.0, 1.0),
                FaceKind::SmplxExpression => finite(channel),
            };
        }
    }

    /// Rotates the eyes of `rotations` to the gaze of `values`, if the face has gaze channels.
    #[inline]
    pub fn turn_eyes(&self, values: &[f32], rotations: &mut [Quat; JOINTS]) {
        if let Some(eyes) = &self.eyes {
            for (eye, joint) in eyes.iter().zip(LEFT_EYE..) {
                rotations[joint] = eye.rotation(values);
            }
        }
    }

    /// Writes the 6D rotations of one part's joints to its first channels.
    #[inline]
    pub fn write_rotations(part: Part, rotations: &[Quat; JOINTS], channels: &mut [f32]) {
        for (joint, six) in joints_of(part).zip(channels.as_chunks_mut().0) {
            *six = quat_to_six(rotations[joint]);
        }
    }
}

/// Returns `v`, or 0 if it is not finite: one bad value must not stay in a sum for ever.
#[inline]
pub fn finite(v: f32) -> f32 {
    if v.is_finite() { v } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::rotate;
    use crate::skeleton::ARKIT_NAMES;

    fn arkit() -> Assembly {
        // Reverses Apple's order: the order of the model's list applies.
        let names = ARKIT_NAMES.iter().rev().map(|&name| name.to_owned()).collect();
        Assembly::new(&Face { kind: FaceKind::Arkit, names })
    }

    fn gaze(of: &[(&str, f32)]) -> [[f32; 3]; 2] {
        let assembly = arkit();
        let mut channels = vec![0.0; FIRST_FACE_VALUE + 52];
        for (name, value) in of {
            let place = ARKIT_NAMES.iter().rev().position(|known| known == name).unwrap();
            channels[FIRST_FACE_VALUE + place] = *value;
        }
        let mut values = vec![0.0; 52];
        assembly.face(&channels, &mut values);
        let mut rotations = [IDENTITY; JOINTS];
        assembly.turn_eyes(&values, &mut rotations);
        [rotate(rotations[LEFT_EYE], [0.0, 0.0, 1.0]), rotate(rotations[LEFT_EYE + 1], [0.0, 0.0, 1.0])]
    }

    #[test]
    fn eyes_look_where_the_channels_say() {
        assert_eq!(gaze(&[]), [[0.0, 0.0, 1.0]; 2]);
        // The character's left is +X.
        let [left, right] = gaze(&[("eyeLookOutLeft", 1.0), ("eyeLookInRight", 1.0)]);
        assert!((left[0] - 0.5).abs() < 1e-6 && (right[0] - 0.5).abs() < 1e-6, "{left:?} {right:?}");
        let [left, right] = gaze(&[("eyeLookInLeft", 1.0), ("eyeLookOutRight", 1.0)]);
        assert!((left[0] + 0.5).abs() < 1e-6 && (right[0] + 0.5).abs() < 1e-6, "{left:?} {right:?}");
        let sine = 25.0_f32.to_radians().sin();
        let [left, right] = gaze(&[("eyeLookUpLeft", 1.0), ("eyeLookDownRight", 1.0)]);
        assert!((left[1] - sine).abs() < 1e-6 && (right[1] + sine).abs() < 1e-6, "{left:?} {right:?}");
    }

    #[test]
    fn arkit_values_are_kept_between_0_and_1() {
        let mut values = vec![0.0; 52];
        let mut channels = vec![0.5; 58];
        channels[6] = -3.0;
        channels[7] = 1.5;
        channels[8] = f32::NAN;
        arkit().face(&channels, &mut values);
        assert_eq!(values[..4], [0.0, 1.0, 0.0, 0.5]);
    }
}
