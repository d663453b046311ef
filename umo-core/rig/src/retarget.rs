//! Retargets motion of the 55 joints to another skeleton with its own bones, axes, rest pose and size.
//!
//! | module | contents |
//! |---|---|
//! | [`Rig`], [`Bone`] | the target skeleton, validated |
//! | [`Mapping`] | bone of each joint: found by name, or set by the caller |
//! | `names` | bone names of each naming convention |
//! | `align` | alignment of the two rest poses |
//! | `back` | the inverse: joint rotations from a rig's motion |
//! | `ground` | scale, and height of the hips |
//! | `legs` | inverse kinematics that plants the feet |
//! | [`Volume`] | the space that a body takes up |
//! | `outline` | its lines and sizes |
//! | `space` | arms that stay out of it, and touch where the source's do |
//! | [`face`] | face channels mapped to a character's blendshapes |
//! | [`RetargetError`] | why a skeleton or mapping was rejected |
//!
//! A bone follows its joint in world space, so intermediate bones do not matter, whatever their number. `S` is a
//! source joint's world rotation (identity at rest), `B` the rotation from the source's axes to the rig's, `T` the
//! bone's world rotation at rest, and `C` the rotation that brings the bone's rest direction to the source's:
//!
//! ```text
//! world = B * S * inverse(B) * C * T        local = inverse(parent's world) * world
//! ```
//!
//! The legs are then bent until the feet are where the source's are, to scale (`legs`).
//!
//! A rest direction `d` of the rig becomes `B * S * inverse(B) * C * d`. `C * d` is `B` times the source's direction,
//! so a limb points where the source's does, whatever the rest pose. Spine bones are spread evenly over the source's
//! three: the `k`-th of `n` takes the source's world rotation at `3 k / n` of the way from the pelvis (0) to `spine3`
//! (3). Details: `docs/retarget.md`.

mod align;
mod back;
mod error;
pub mod face;
mod ground;
mod legs;
mod mapping;
mod names;
mod outline;
mod rig;
mod space;
mod volume;

pub use error::RetargetError;
pub use mapping::{Follow, Mapping};
pub use outline::Outline;
pub use rig::{Bone, MAX_BONES, Rig};
pub use volume::{SurfacePoint, Volume};

use align::Alignment;
use ground::Ground;
use legs::Leg;
use rig::World;
use space::{Past, Space, Step, Turned};
use umo_core_base::error::StepError;
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse, product, slerp};
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS, Skeleton};

/// `spine3`, the parent of neck and arms.
const CHEST: usize = 9;

/// Height of the floor below a rig.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[non_exhaustive]
pub enum Floor {
    /// The rest pose stands on the floor.
    #[default]
    AtRest,
    /// At 0, for rigs whose rest pose does not show it, such as those of `.bvh` files.
    AtZero,
    /// At 0, with soles at this height in the rest pose, along up in the rig's unit: for characters whose shoes reach
    /// below the floor.
    Soles(f32),
}

/// Source of a driven bone's rotation.
#[derive(Clone, Copy, Debug)]
struct Driven {
    /// The two joints whose rotations are interpolated.
    joints: [usize; 2],
    /// Interpolation weight of the second joint.
    share: f32,
    /// Rotation applied before the joint's: `inverse(B) * C * T`.
    rest: Quat,
}

/// Retargets poses of a source skeleton to a rig. Immutable while in use, so threads can share it.
#[derive(Clone, Debug)]
pub struct Retarget {
    /// `[bones]`, the rig at rest.
    bones: Vec<Bone>,
    order: Vec<usize>,
    /// `[bones]`
    driven: Vec<Option<Driven>>,
    /// The source's parents and offsets.
    parents: [Option<usize>; JOINTS],
    offsets: [[f32; 3]; JOINTS],
    axes: Quat,
    hips: usize,
    ground: Ground,
    legs: [Option<Leg>; 2],
    space: Option<Box<Space>>,
    /// Reference joint of a head or a bust, which has no body: rotations are taken relative to it.
    base: Option<usize>,
}

/// Scratch memory of one avatar. With a volume, it keeps the arms' corrections of the frame before: each avatar needs its
/// own, and the frames of a motion come in order, 30 a second unless [`set_step`](Self::set_step) says otherwise. New
/// scratch memory begins a new motion, as does a wrist that moves 0.3 m in a 30th of a second.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// `[bones]`, world transforms.
    world: Vec<World>,
    /// Of each arm.
    past: [Past; 2],
    step: Step,
}

impl Scratch {
    /// Sets the time from a frame to the next, in seconds, from 1 ms to 0.2 s (clamped; not a number is a 30th). It may
    /// change before any frame.
    pub fn set_step(&mut self, seconds: f32) {
        let step = Step::new(seconds);
        self.past.iter_mut().for_each(|past| past.pace(self.step, step));
        self.step = step;
    }
}

impl Retarget {
    /// Prepares retargeting from `source`, a skeleton of 55 joints in a T-pose without rest rotations, to `rig`.
    ///
    /// # Errors
    /// [`RetargetError`] as for [`Mapping::check`], or if a driven bone has an unevenly scaled ancestor, the body's
    /// up or left cannot be determined, or `source` is not a valid skeleton.
    pub fn new(source: &Skeleton, rig: &Rig, mapping: &Mapping, floor: Floor) -> Result<Self, RetargetError> {
        mapping.check(rig)?;
        let mapped = (0..JOINTS).filter_map(|joint| mapping.bone(joint));
        mapped
            .chain(mapping.spine().iter().chain(mapping.neck()).copied())
            .try_for_each(|bone| rig.check_scale(bone))?;
        let (parents, offsets) = source_of(source)?;
        let rest = rest(&parents, &offsets);
        let first = rig.order().iter().copied().find(|&bone| mapping.follows().any(|follow| follow.bone == bone));
        let hips = mapping.bone(0).or(first).or(rig.order().first().copied()).ok_or(RetargetError::Flat)?;
        let (axes, short) = align::axes(rig, mapping)?;
        let turns = Alignment { rig, mapping, rest: &rest, axes, short }.turns();
        let mut driven = vec![None; rig.len()];
        for Follow { bone, joints, share } in mapping.follows() {
            let turn = product(turns[joints[1]], rig.rotation(bone));
            driven[bone] = Some(Driven { joints, share, rest: product(inverse(axes), turn) });
        }
        let ground = Ground::new(rig, mapping, &rest, axes, floor)?;
        let legs = [0, 1].map(|side| Leg::new(rig, mapping, &turns, side, &ground, axes, &rest));
        let base = (!mapping.has_body()).then_some(if mapping.spine().is_empty() { CHEST } else { 0 });
        Ok(Self {
            bones: rig.bones().to_vec(),
            order: rig.order().to_vec(),
            driven,
            parents,
            offsets,
            axes,
            hips,
            ground,
            legs,
            space: None,
            base,
        })
    }

    /// Gives the rig a volume: arms then stay out of trunk, head, legs and each other, and touch where the source's
    /// do. `rig` and `mapping` are those of [`new`](Self::new). A gain of 1 is all of it, 0 none: frames are then
    /// those of a rig without a volume. A rig without arms, hands or legs keeps its frames.
    ///
    /// # Errors
    /// [`RetargetError`] as for [`new`](Self::new).
    pub fn set_volume(
        &mut self,
        rig: &Rig,
        mapping: &Mapping,
        volume: &Volume,
        gain: f32,
    ) -> Result<(), RetargetError> {
        self.space = None;
        if !(gain > 0.0 && gain.is_finite()) || rig.len() != self.bones.len() {
            return Ok(());
        }
        let rest = rest(&self.parents, &self.offsets);
        let (axes, short) = align::axes(rig, mapping)?;
        let turns = Alignment { rig, mapping, rest: &rest, axes, short }.turns();
        let people = (0..JOINTS).map(|joint| Bone::new(JOINT_NAMES[joint], self.parents[joint], self.offsets[joint]));
        let people = Rig::new(people.collect())?;
        let (own, _) = Mapping::guess(&people)?;
        let space = Space::new((&people, &own), (rig, mapping), &turns, axes, &rest, volume, gain.min(1.0));
        self.space = space.filter(|_| self.base.is_none()).map(Box::new);
        Ok(())
    }

    /// Returns scratch memory for one avatar.
    pub fn scratch(&self) -> Scratch {
        Scratch { world: vec![World::ORIGIN; self.bones.len()], past: Default::default(), step: Step::default() }
    }

    /// Number of bones of the rig.
    pub fn bones(&self) -> usize {
        self.bones.len()
    }

    /// Index of the bone that carries the body, the only one whose translation changes. For a head without a body it
    /// is the first driven bone, whose translation is constant.
    pub fn hips(&self) -> usize {
        self.hips
    }

    /// Whether a bone follows the source; all others keep their rest rotation. Panics if the index is out of range.
    pub fn is_driven(&self, bone: usize) -> bool {
        self.driven[bone].is_some()
    }

    /// Scale of the rig: leg length in its unit per metre of the source's.
    pub fn scale(&self) -> f32 {
        self.ground.scale
    }

    /// Keeps a bone at rest, for example eyes that blendshapes turn. Panics if the index is out of range.
    pub fn release(&mut self, bone: usize) {
        self.driven[bone] = None;
    }

    /// Writes each bone's local rotation (unit quaternions, in the rig's order) and returns the hips' local
    /// translation in the rig's unit. Does not allocate.
    ///
    /// # Errors
    /// [`StepError::Disagree`] if the length of `scratch` or `rotations` is not that of this rig.
    pub fn apply(&self, scratch: &mut Scratch, pose: &Pose, rotations: &mut [Quat]) -> Result<[f32; 3], StepError> {
        if scratch.world.len() != self.bones.len() || rotations.len() != self.bones.len() {
            return Err(StepError::Disagree("the room for bones is another rig's"));
        }
        let mut source = self.source(pose);
        if let Some(base) = self.base {
            let back = inverse(source[base].rotation);
            source.iter_mut().for_each(|joint| joint.rotation = product(back, joint.rotation));
        }
        let source = source;
        let hips = self.ground.place(self.axes, source[0].place);
        for &at in &self.order {
            let bone = &self.bones[at];
            let above = bone.parent.map_or(World::ORIGIN, |parent| scratch.world[parent]);
            let (world, local) = match &self.driven[at] {
                Some(driven) => {
                    let world = product(self.axes, product(driven.rotation(&source), driven.rest));
                    (world, product(inverse(above.rotation), world))
                }
                None => (product(above.rotation, bone.rotation), bone.rotation),
            };
            rotations[at] = local;
            scratch.world[at] = World {
                place: hips.filter(|_| at == self.hips).unwrap_or_else(|| above.at(bone.translation)),
                rotation: world,
                scale: above.scale * bone.scale[0],
            };
        }
        let Some(hips) = hips else { return Ok(self.bones[self.hips].translation) };
        let lift = self.ground.lift(&source, &scratch.world);
        let lift = self.plant(&source, &scratch.world, lift, rotations);
        if let Some(space) = &self.space {
            let Scratch { world, past, step } = scratch;
            for (side, turned) in space.correct(past, *step, &source, world).into_iter().enumerate() {
                self.clear(space.arm(side), turned, world, rotations);
            }
        }
        let hips = std::array::from_fn(|i| hips[i] + lift * self.ground.up[i]);
        let above = self.bones[self.hips].parent.map_or(World::ORIGIN, |parent| scratch.world[parent]);
        Ok(above.within(hips))
    }

    /// Turns an arm that the body's volume moves. `world` holds all bones before.
    fn clear(&self, arm: Option<[usize; 3]>, turned: Turned, world: &[World], rotations: &mut [Quat]) {
        let (Some([upper, fore]), Some(bones)) = (turned, arm) else { return };
        if bones.iter().any(|&bone| self.driven[bone].is_none()) {
            return;
        }
        // A bone's parent turns with the arm above it; the hand keeps its world rotation.
        let turned = [(IDENTITY, upper), (upper, fore), (fore, IDENTITY)];
        for (bone, (above, own)) in bones.into_iter().zip(turned) {
            let parent = self.bones[bone].parent.map_or(IDENTITY, |parent| world[parent].rotation);
            rotations[bone] = product(inverse(product(above, parent)), product(own, world[bone].rotation));
        }
    }

    /// World transforms of the source's joints.
    fn source(&self, pose: &Pose) -> [World; JOINTS] {
        let mut world = [World::ORIGIN; JOINTS];
        let root = pose.translation.map(|x| if x.is_finite() { x } else { 0.0 });
        world[0].place = std::array::from_fn(|i| self.offsets[0][i] + root[i]);
        world[0].rotation = product(IDENTITY, pose.rotations[0]);
        for joint in 1..JOINTS {
            let above = world[self.parents[joint].unwrap_or(0)];
            world[joint] = World {
                place: above.at(self.offsets[joint]),
                rotation: product(above.rotation, pose.rotations[joint]),
                scale: 1.0,
            };
        }
        world
    }
}

impl Driven {
    fn rotation(&self, source: &[World; JOINTS]) -> Quat {
        let [from, to] = self.joints.map(|joint| source[joint].rotation);
        if self.share < 1.0 { slerp(from, to, self.share) } else { to }
    }
}

/// Returns a bone's name as it is matched, if most names carry a decoration that is stripped because no convention
/// uses it: `left arm` for `Armature|LeftArm.001`. Panics if the index is out of range.
pub fn undecorated(rig: &Rig, bone: usize) -> Option<String> {
    names::undecorated(rig, bone)
}

/// Returns the topmost bone of each further body in the rig: bones with the same names as the mapping's that do not
/// belong to the mapped body.
pub fn other_bodies(rig: &Rig, mapping: &Mapping) -> Vec<usize> {
    mapping.other_bodies(rig, &names::keys(rig))
}

/// Parents (only the first joint has none) and offsets.
type Source = ([Option<usize>; JOINTS], [[f32; 3]; JOINTS]);

fn source_of(skeleton: &Skeleton) -> Result<Source, RetargetError> {
    let Skeleton { parents, offsets_m } = skeleton;
    let offsets: [[f32; 3]; JOINTS] = offsets_m.as_slice().try_into().map_err(|_| RetargetError::Source)?;
    let parents: Vec<_> = parents.iter().map(|&parent| usize::try_from(parent).ok()).collect();
    let parents: [Option<usize>; JOINTS] = parents.try_into().map_err(|_| RetargetError::Source)?;
    let is_tree = parents.iter().enumerate().all(|(joint, parent)| match parent {
        None => joint == 0,
        Some(parent) => *parent < joint,
    });
    match is_tree && offsets.as_flattened().iter().all(|x| x.is_finite()) {
        true => Ok((parents, offsets)),
        false => Err(RetargetError::Source),
    }
}

/// Rest positions of the joints, relative to the root.
fn rest(parents: &[Option<usize>; JOINTS], offsets: &[[f32; 3]; JOINTS]) -> align::Rest {
    let mut rest = [[0.0; 3]; JOINTS];
    for joint in 1..JOINTS {
        let above = rest[parents[joint].unwrap_or(0)];
        rest[joint] = std::array::from_fn(|i| above[i] + offsets[joint][i]);
    }
    rest
}
