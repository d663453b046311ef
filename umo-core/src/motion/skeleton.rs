//! The 55 joints of SMPL-X and which part moves each (SPEC 2.7).

use super::pose::Pose;
use super::rotation::{IDENTITY, product, rotate};
use crate::config::Skeleton;
use crate::part::Part;

/// Number of joints.
pub const JOINTS: usize = 55;

/// Names of the joints, in SMPL-X order.
#[rustfmt::skip]
pub const JOINT_NAMES: [&str; JOINTS] = [
    "pelvis", "left_hip", "right_hip", "spine1", "left_knee", "right_knee", "spine2", "left_ankle", "right_ankle",
    "spine3", "left_foot", "right_foot", "neck", "left_collar", "right_collar", "head", "left_shoulder",
    "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist", "jaw", "left_eye", "right_eye",
    "left_index1", "left_index2", "left_index3", "left_middle1", "left_middle2", "left_middle3", "left_pinky1",
    "left_pinky2", "left_pinky3", "left_ring1", "left_ring2", "left_ring3", "left_thumb1", "left_thumb2", "left_thumb3",
    "right_index1", "right_index2", "right_index3", "right_middle1", "right_middle2", "right_middle3", "right_pinky1",
    "right_pinky2", "right_pinky3", "right_ring1", "right_ring2", "right_ring3", "right_thumb1", "right_thumb2",
    "right_thumb3",
];

/// The jaw, which the face part moves.
pub const JAW: usize = 22;

/// Joints of the upper body, in the order of its channels.
pub const UPPER_JOINTS: [usize; 13] = [3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21];

/// Joints of the lower body, in the order of its channels.
pub const LOWER_JOINTS: [usize; 9] = [0, 1, 2, 4, 5, 7, 8, 10, 11];

/// First of the thirty finger joints, left hand then right.
pub const FIRST_FINGER: usize = 25;

/// Joints whose 6D rotations are the first channels of `part`, in order.
pub fn joints_of(part: Part) -> impl Iterator<Item = usize> {
    let (list, range): (&[usize], _) = match part {
        Part::Face => (&[JAW], 0..0),
        Part::Hands => (&[], FIRST_FINGER..JOINTS),
        Part::Upper => (&UPPER_JOINTS, 0..0),
        Part::Lower => (&LOWER_JOINTS, 0..0),
    };
    list.iter().copied().chain(range)
}

/// Where each joint is in the world, metres, Y up: forward kinematics of `pose` on the bones of `skeleton`.
pub fn joint_places(skeleton: &Skeleton, pose: &Pose) -> [[f32; 3]; JOINTS] {
    let mut places = [[0.0; 3]; JOINTS];
    let mut turned = [IDENTITY; JOINTS];
    for (joint, (&parent, &offset)) in skeleton.parents.iter().zip(&skeleton.offsets_m).enumerate() {
        // Only the root has a parent below 0: the config is checked for that, and for parents that come first.
        let (from, offset, rotation) = match usize::try_from(parent) {
            Ok(parent) => {
                (places[parent], rotate(turned[parent], offset), product(turned[parent], pose.rotations[joint]))
            }
            Err(_) => (pose.translation, offset, pose.rotations[joint]),
        };
        places[joint] = std::array::from_fn(|axis| from[axis] + offset[axis]);
        turned[joint] = rotation;
    }
    places
}

/// The 52 ARKit blendshapes in Apple's order.
#[rustfmt::skip]
pub const ARKIT_NAMES: [&str; 52] = [
    "eyeBlinkLeft", "eyeLookDownLeft", "eyeLookInLeft", "eyeLookOutLeft", "eyeLookUpLeft", "eyeSquintLeft",
    "eyeWideLeft", "eyeBlinkRight", "eyeLookDownRight", "eyeLookInRight", "eyeLookOutRight", "eyeLookUpRight",
    "eyeSquintRight", "eyeWideRight", "jawForward", "jawLeft", "jawRight", "jawOpen", "mouthClose", "mouthFunnel",
    "mouthPucker", "mouthLeft", "mouthRight", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight",
    "mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight", "mouthRollLower", "mouthRollUpper",
    "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft",
    "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp",
    "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft",
    "noseSneerRight", "tongueOut",
];
