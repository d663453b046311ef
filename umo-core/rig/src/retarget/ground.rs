//! Scale of the rig, and contact of its feet with the floor.

use umo_core_pose::rotation::{Quat, rotate};
use umo_core_pose::skeleton::JOINTS;

use super::align::{Rest, dot, length, less};
use super::rig::World;
use super::{Floor, Mapping, RetargetError, Rig};

/// Height of the source's lowest foot joint when it stands, in metres: the ball of the foot of SMPL-X.
const SOLE: f32 = 0.02;

/// Ankles and balls of the feet.
const FEET: [usize; 4] = [7, 8, 10, 11];

/// A foot joint and its bone, with their heights in the rest pose.
#[derive(Clone, Copy, Debug)]
struct Foot {
    joint: usize,
    bone: usize,
    /// Metres above the floor.
    joint_height: f32,
    /// Along up, in the rig's unit.
    bone_height: f32,
}

/// Motion of the hips.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    /// The rig's units per metre.
    pub(super) scale: f32,
    /// Height of the source's pelvis when it stands at rest, metres.
    pub(super) standing: f32,
    /// Position of the rig's hips in that pose, in the rig's unit; `None` for a head without hips.
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
        // Lower the rig until its sole is as thick as the source's, to scale.
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

    /// Position of the hips for a source pelvis at `pelvis`: its displacement from the rest pose, scaled.
    pub(super) fn place(&self, axes: Quat, pelvis: [f32; 3]) -> Option<[f32; 3]> {
        let moved = rotate(axes, less(pelvis, [0.0, self.standing, 0.0]));
        self.hips.map(|hips| std::array::from_fn(|i| hips[i] + self.scale * moved[i]))
    }

    /// Correction of the hips' height, in the rig's unit, that makes the rig's lower foot rise above its rest height
    /// as much as the source's, to scale. It is needed because legs of other proportions end at other heights.
    pub(super) fn lift(&self, source: &[World; JOINTS], world: &[World]) -> f32 {
        let least = |height: &dyn Fn(&Foot) -> f32| self.feet.iter().flatten().map(height).reduce(f32::min);
        let wanted = least(&|foot| source[foot.joint].place[1] - foot.joint_height);
        let found = least(&|foot| dot(world[foot.bone].place, self.up) - foot.bone_height);
        wanted.zip(found).map_or(0.0, |(wanted, found)| self.scale * wanted - found)
    }
}

/// Ratio of the rig's leg length to the source's, over the leg bones that are mapped; hips to head without legs.
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
    // A head stays in place, so its size does not matter.
    let scale = if mapping.has_body() { scale } else { 1.0 };
    match scale.is_finite() && scale > 0.0 {
        true => Ok(scale),
        false => Err(RetargetError::Flat),
    }
}
