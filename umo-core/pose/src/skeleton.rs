//! The 55 joints of SMPL-X, and the part that moves each (SPEC 2.7).

use serde::{Deserialize, Serialize};

use super::pose::Pose;
use super::rotation::{IDENTITY, product, rotate};
pub use crate::names::{ARKIT_NAMES, JOINT_NAMES, JOINTS};
use crate::part::Part;

/// Bones: 55 SMPL-X joints.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Skeleton {
    /// Parent of each joint; -1 for the first.
    pub parents: Vec<i32>,
    /// Position of each joint in its parent's frame in the rest pose, metres, Y up.
    pub offsets_m: Vec<[f32; 3]>,
}

/// Index of the jaw, which the face part moves.
pub const JAW: usize = 22;

/// Joints of the upper body, in the order of its channels.
pub const UPPER_JOINTS: [usize; 13] = [3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21];

/// Joints of the lower body, in the order of its channels.
pub const LOWER_JOINTS: [usize; 9] = [0, 1, 2, 4, 5, 7, 8, 10, 11];

/// First of the thirty finger joints, left hand then right.
pub const FIRST_FINGER: usize = 25;

/// Joints whose 6D rotations are the first channels of `part`, in order.
#[inline]
pub fn joints_of(part: Part) -> impl Iterator<Item = usize> {
    let (list, range): (&[usize], _) = match part {
        Part::Face => (&[JAW], 0..0),
        Part::Hands => (&[], FIRST_FINGER..JOINTS),
        Part::Upper => (&UPPER_JOINTS, 0..0),
        Part::Lower => (&LOWER_JOINTS, 0..0),
    };
    list.iter().copied().chain(range)
}

/// Computes the world position of each joint, metres, Y up, by forward kinematics of `pose` on the bones of
/// `skeleton`.
#[inline]
pub fn joint_places(skeleton: &Skeleton, pose: &Pose) -> [[f32; 3]; JOINTS] {
    let mut places = [[0.0; 3]; JOINTS];
    let mut turned = [IDENTITY; JOINTS];
    for (joint, (&parent, &offset)) in skeleton.parents.iter().zip(&skeleton.offsets_m).enumerate() {
        // Only the root has a negative parent, and parents precede their children: the config checks both.
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
