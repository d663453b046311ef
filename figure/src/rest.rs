//! Rest positions of the joints, and measures of the body derived from them.

use super::vector::{V, add, distance, length, mix, scale, sub};
use crate::FigureError;
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS, Skeleton};

/// The joints of a skeleton in its rest pose.
pub(super) struct Rest {
    /// `[55]`, metres.
    places: Vec<V>,
    /// Size relative to the body for which this module's measures are given (1.72 m).
    pub(super) size: f32,
    /// Size of the head likewise.
    pub(super) head: f32,
}

/// Index of the joint `name`. Panics if it does not exist.
pub(super) fn joint(name: &str) -> usize {
    JOINT_NAMES.iter().position(|&known| known == name).expect("the names are written in this module")
}

/// Distances from hip joint to neck joint, and from ankle to hip, in metres for a body of size 1.
const TRUNK: f32 = 0.585;
const LEG: f32 = 0.81;
/// Distance between the eyes, in metres for a head of size 1.
const EYES: f32 = 0.064;
/// Size of the figure's head relative to a person's: slightly larger, so that the face is visible from further away.
const LARGER: f32 = 1.05;
/// Range of sizes that a person can have.
const SIZES: (f32, f32) = (0.3, 3.0);

impl Rest {
    /// # Errors
    /// The skeleton does not have the 55 joints, or its offsets are not finite.
    pub(super) fn new(skeleton: &Skeleton) -> Result<Self, FigureError> {
        if skeleton.parents.len() != JOINTS || skeleton.offsets_m.len() != JOINTS {
            return Err(FigureError::Joints { found: skeleton.offsets_m.len().min(skeleton.parents.len()) });
        }
        let mut places: Vec<V> = Vec::with_capacity(JOINTS);
        for (&parent, &offset) in skeleton.parents.iter().zip(&skeleton.offsets_m) {
            let from = usize::try_from(parent).ok().and_then(|parent| places.get(parent)).copied();
            places.push(add(from.unwrap_or_default(), offset));
        }
        if places.as_flattened().iter().any(|x| !x.is_finite()) {
            return Err(FigureError::Offsets);
        }
        let mut rest = Self { places, size: 1.0, head: 1.0 };
        let tall = rest.between("left_hip", "neck") + rest.between("left_hip", "left_ankle");
        rest.size = (tall / (TRUNK + LEG)).clamp(SIZES.0, SIZES.1);
        let eyes = rest.between("left_eye", "right_eye") / EYES;
        // Coincident eyes carry no information about the head's size.
        let head = if eyes > SIZES.0 { (0.5 * (eyes + rest.size)).min(SIZES.1) } else { rest.size };
        rest.head = LARGER * head;
        Ok(rest)
    }

    pub(super) fn at(&self, name: &str) -> V {
        self.places[joint(name)]
    }

    pub(super) fn between(&self, a: &str, b: &str) -> f32 {
        distance(self.at(a), self.at(b))
    }

    /// Position of the joint `name` of one side: `left` or `right`.
    pub(super) fn side(&self, side: &str, name: &str) -> V {
        self.at(&format!("{side}_{name}"))
    }

    /// Midpoint of left and right.
    pub(super) fn middle(&self, name: &str) -> V {
        mix(self.side("left", name), self.side("right", name), 0.5)
    }

    /// Tip of a finger, beyond its last joint.
    pub(super) fn finger_tip(&self, side: &str, finger: &str) -> V {
        let [a, b] = [2, 3].map(|bone| self.side(side, &format!("{finger}{bone}")));
        let along = sub(b, a);
        let size = length(along);
        if size > 1e-4 { add(b, scale(along, 0.85)) } else { b }
    }
}
