//! Size, and feet on the floor.

use super::align::{Rest, dot, length, less};
use super::rig::World;
use super::{Floor, Mapping, RetargetError, Rig};
use crate::motion::rotation::{Quat, rotate};
use crate::motion::skeleton::JOINTS;

/// How far the source's lowest foot joint is above the floor when it stands, metres: the ball of a
/// foot of SMPL-X.
const SOLE: f32 = 0.02;

/// Ankles and balls of the feet.
const FEET: [usize; 4] = [7, 8, 10, 11];

/// A joint of a foot and its bone, with their heights when both stand at rest.
#[derive(Clone, Copy, Debug)]
struct Foot {
    joint: usize,
    bone: usize,
    /// Metres above the floor.
    joint_height: f32,
    /// Along up, in the rig's unit.
    bone_height: f32,
}

/// How the hips move.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    /// The rig's unit for each metre.
    pub(super) scale: f32,
    /// Height of the source's pelvis when it stands at rest, metres.
    pub(super) standing: f32,
    /// Where the hips are then, in the rig's unit; nothing of a head without them.
    hips: Option<[f32; 3]>,
    /// The rig's up.
    pub(super) up: [f32; 3],

    feet: [Option<Foot>; FEET.len()],
}

impl Ground {
    pub(super) fn new(
        rig: &Rig,
        mapping: &Mapping,
        rest: &Rest,
        axes: Quat,
        floor: Floor,
    ) -> Result<Self, RetargetError> {
        let scale = scale(rig, mapping, rest)?;
        let hips = mapping.bone(0).map(|bone| rig.place(bone));
        let standing = SOLE - FEET.map(|joint| rest[joint][1]).into_iter().fold(0.0, f32::min);
        let up = rotate(axes, [0.0, 1.0, 0.0]);
        let height = |bone: usize| dot(rig.place(bone), up);
        let feet = FEET.map(|joint| mapping.bone(joint).map(|bone| (joint, bone)));
        let lowest = feet.iter().flatten().map(|&(_, bone)| height(bone)).reduce(f32::min);
        // Down to where a sole is as thick as the source's, to scale.
        let drop = match floor {
            Floor::AtRest => 0.0,
            Floor::Soles(height) => height,
            Floor::AtZero => {
                let below_hips = hips.map(|hips| dot(hips, up) - scale * (standing - SOLE));
                lowest.or(below_hips).map_or(0.0, |lowest| lowest - scale * SOLE)
            }
        };
        let lowered = |v: [f32; 3]| std::array::from_fn(|i| v[i] - drop * up[i]);
        let foot = |(joint, bone): (usize, usize)| Foot {
            joint,
            bone,
            joint_height: standing + rest[joint][1],
            bone_height: height(bone) - drop,
        };
        Ok(Self { scale, standing, hips: hips.map(lowered), up, feet: feet.map(|pair| pair.map(foot)) })
    }

    /// Where the hips go when the source's pelvis is at `pelvis`: to scale from where both stand.
    pub(super) fn place(&self, axes: Quat, pelvis: [f32; 3]) -> Option<[f32; 3]> {
        let moved = rotate(axes, less(pelvis, [0.0, self.standing, 0.0]));
        self.hips.map(|hips| std::array::from_fn(|i| hips[i] + self.scale * moved[i]))
    }

    /// How much higher the hips must be, in the rig's unit, for its lower foot to be as far above
    /// where it stands at rest as the source's, to scale: legs of other proportions end at other
    /// heights.
    pub(super) fn lift(&self, source: &[World; JOINTS], world: &[World]) -> f32 {
        let least = |height: &dyn Fn(&Foot) -> f32| self.feet.iter().flatten().map(height).reduce(f32::min);
        let wanted = least(&|foot| source[foot.joint].place[1] - foot.joint_height);
        let found = least(&|foot| dot(world[foot.bone].place, self.up) - foot.bone_height);
        wanted.zip(found).map_or(0.0, |(wanted, found)| self.scale * wanted - found)
    }
}

/// The length of the rig's legs over the source's; of what there is of them.
fn scale(rig: &Rig, mapping: &Mapping, rest: &Rest) -> Result<f32, RetargetError> {
    let (mut source, mut target) = (0.0, 0.0);
    for (from, to) in [(1, 4), (4, 7), (2, 5), (5, 8)] {
        if let Some((a, b)) = mapping.bone(from).zip(mapping.bone(to)) {
            source += length(less(rest[from], rest[to]));
            target += length(less(rig.place(a), rig.place(b)));
        }
    }
    if let (0.0, Some((hips, head))) = (source, mapping.bone(0).zip(mapping.bone(15))) {
        source = length(less(rest[0], rest[15]));
        target = length(less(rig.place(hips), rig.place(head)));
    }
    let scale = target / source;
    // A head has no size that matters: it does not move about.
    let scale = if mapping.has_body() { scale } else { 1.0 };
    match scale.is_finite() && scale > 0.0 {
        true => Ok(scale),
        false => Err(RetargetError::Flat),
    }
}
