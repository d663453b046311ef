//! The inverse of retargeting: rotations of the 55 joints from a rig's motion.

use umo_core_base::error::StepError;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse, product, slerp};
use umo_core_pose::skeleton::JOINTS;

use super::rig::World;
use super::{CHEST, Driven, Retarget, Scratch};

/// Spine joints for which a rig may have no bones, with their distance along the way from the pelvis to `spine3`.
const SPINE: [(usize, f32); 2] = [(3, 1.0 / 3.0), (6, 2.0 / 3.0)];

impl Retarget {
    /// Returns the local rotation of each joint for a posed rig: the inverse of [`apply`](Self::apply), for joints
    /// that have bones. `rotations` are the bones' local rotations, in the rig's order. A joint without a bone is at
    /// rest; a spine joint without one is interpolated between its neighbours. Used for clips of a host's character,
    /// such as gestures. Does not allocate.
    ///
    /// # Errors
    /// [`StepError::Disagree`] if the length of `scratch` or `rotations` is not that of this rig.
    pub fn joints(&self, scratch: &mut Scratch, rotations: &[Quat]) -> Result<[Quat; JOINTS], StepError> {
        if scratch.world.len() != self.bones.len() || rotations.len() != self.bones.len() {
            return Err(StepError::Disagree("the room for bones is another rig's"));
        }
        let mut world: [Option<Quat>; JOINTS] = [None; JOINTS];
        for &at in &self.order {
            let above = self.bones[at].parent.map_or(IDENTITY, |parent| scratch.world[parent].rotation);
            let rotation = product(above, rotations[at]);
            scratch.world[at] = World { rotation, ..World::ORIGIN };
            if let Some(Driven { joints: [_, joint], share, rest }) = self.driven[at]
                && share >= 1.0
            {
                world[joint] = Some(product(inverse(self.axes), product(rotation, inverse(rest))));
            }
        }
        let (pelvis, chest) = (world[0].unwrap_or(IDENTITY), world[CHEST]);
        for (joint, share) in SPINE {
            let between = chest.map(|chest| slerp(pelvis, chest, share));
            world[joint] = world[joint].or(between);
        }
        let mut placed = [pelvis; JOINTS];
        let mut local = [IDENTITY; JOINTS];
        local[0] = pelvis;
        for joint in 1..JOINTS {
            let above = placed[self.parents[joint].unwrap_or(0)];
            placed[joint] = world[joint].unwrap_or(above);
            local[joint] = product(inverse(above), placed[joint]);
        }
        Ok(local)
    }
}
