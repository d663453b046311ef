//! The way back: a rig's motion as that of the 55 joints.

use super::rig::World;
use super::{CHEST, Driven, Retarget, Scratch};
use crate::error::StepError;
use crate::motion::rotation::{IDENTITY, Quat, inverse, product, slerp};
use crate::motion::skeleton::JOINTS;

/// The joints of the spine that a rig may have no bones for, and how far each is from the pelvis to
/// `spine3`.
const SPINE: [(usize, f32); 2] = [(3, 1.0 / 3.0), (6, 2.0 / 3.0)];

impl Retarget {
    /// The rotation of each joint, relative to its parent, of a rig that is posed: what
    /// [`apply`](Self::apply) with these would make of the rig, as far as the joints have bones.
    /// `rotations` are each bone's in its parent's frame, in the rig's order. A joint without a bone
    /// is at rest, one of the spine between its neighbours. For clips of a character that a host
    /// has, as gestures ([`Gesture`](crate::Gesture)). Never allocates.
    ///
    /// # Errors
    /// [`StepError::Disagree`] where `scratch` or `rotations` is another rig's.
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
