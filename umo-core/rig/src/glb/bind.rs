//! Bind pose: the joint transforms when the mesh was bound to its skin.
//!
//! A character may be exported in the middle of an animation: its nodes then hold that pose and not the one in which
//! the mesh was modelled. The skin's inverse bind matrices still define the bind pose, up to one transform from the
//! mesh's space to the scene's that all joints of the skin share and that glTF does not store. It is estimated from
//! the joints that did not move, or else from the nodes around the skin.

use std::collections::BTreeMap;

use crate::retarget::{MAX_BONES, Rig};
use glam::{DMat4, DQuat, DVec3};

use super::accessor::floats;
use super::character::Transform;
use super::document::{Document, Skin};

/// Tolerance within which two transforms of the same joints count as equal: radians, share of the scale, share of the
/// skeleton's extent.
const TOLERANCE: f64 = 0.02;
/// Distance between the nodes and the modelled position, in extents of the skeleton, above which the root joint is
/// assumed to be animated. Up to it, a skin whose joints agree stands where its nodes are.
const MAX_OFFSET: f64 = 0.5;
/// Angle in radians by which the joints must contradict the nodes around a skin to override their orientation.
const MAX_DISAGREEMENT: f64 = std::f64::consts::FRAC_PI_4;

/// A similarity transform: scale, then rotation, then translation.
#[derive(Clone, Copy, Debug)]
struct Similarity {
    scale: f64,
    rotation: DQuat,
    translation: DVec3,
}

impl Similarity {
    const IDENTITY: Self = Self { scale: 1.0, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// Converts a matrix; `None` if it has no inverse. Unequal scales are replaced by their geometric mean.
    fn of(matrix: DMat4) -> Option<Self> {
        let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
        let scale = scale.element_product().abs().cbrt();
        let is_finite = matrix.is_finite() && rotation.is_finite() && scale > 0.0;
        is_finite.then(|| Self { scale, rotation: rotation.normalize(), translation })
    }

    fn matrix(self) -> DMat4 {
        DMat4::from_scale_rotation_translation(DVec3::splat(self.scale), self.rotation, self.translation)
    }

    fn has_scale_of(&self, other: &Self) -> bool {
        (self.scale / other.scale - 1.0).abs() < TOLERANCE
    }

    fn angle(&self, other: &Self) -> f64 {
        self.rotation.angle_between(other.rotation)
    }

    /// Whether both bring a skeleton of this extent to the same place, within [`TOLERANCE`].
    fn is_near(&self, other: &Self, extent: f64) -> bool {
        let apart = self.translation.distance(other.translation);
        self.has_scale_of(other) && self.angle(other) < TOLERANCE && apart < TOLERANCE * extent
    }
}

/// A joint of a skin.
struct Joint {
    node: usize,
    /// Its frame in the mesh's space in the bind pose.
    bound: DMat4,
    /// Transform from there to the node's current frame.
    moved: Similarity,
}

/// Returns the nodes whose bind pose differs from their transform in the file, with their local transform in the bind
/// pose.
///
/// # Errors
/// An accessor of inverse bind matrices violates the format.
pub(super) fn bind_pose(document: &Document, bin: &[u8], rig: &Rig) -> Result<BTreeMap<usize, Transform>, String> {
    let nodes = Nodes::new(document, rig);
    let mut skins: Vec<usize> = (0..document.skins.len()).collect();
    // A stable sort keeps the file's order among equals.
    skins.sort_by_key(|&skin| std::cmp::Reverse(document.skins[skin].joints.len()));
    // `None`: the node's own transform is the bind pose.
    let mut places: BTreeMap<usize, Option<DMat4>> = BTreeMap::new();
    for skin in skins {
        let Some(joints) = nodes.joints(document, bin, &document.skins[skin])? else { continue };
        let frame = nodes.frame(document, skin, &joints);
        for joint in &joints {
            places.entry(joint.node).or_insert_with(|| frame.map(|frame| frame.matrix() * joint.bound));
        }
    }
    Ok(nodes.locals(&places))
}

struct Nodes<'a> {
    rig: &'a Rig,
    /// Node indices, parents first.
    order: Vec<usize>,
    local: Vec<DMat4>,
    global: Vec<DMat4>,
}

impl<'a> Nodes<'a> {
    fn new(document: &Document, rig: &'a Rig) -> Self {
        let bones = rig.bones();
        let local: Vec<_> = bones.iter().map(|bone| matrix((bone.translation, bone.rotation, bone.scale))).collect();
        let mut order: Vec<usize> = (0..bones.len()).filter(|&node| bones[node].parent.is_none()).collect();
        let mut at = 0;
        while let Some(&node) = order.get(at) {
            // The rig was checked for cycles.
            order.extend(&document.nodes[node].children);
            at += 1;
        }
        debug_assert!(order.len() <= MAX_BONES);
        let mut global = local.clone();
        for &node in &order {
            if let Some(parent) = bones[node].parent {
                global[node] = global[parent] * local[node];
            }
        }
        Self { rig, order, local, global }
    }

    fn parent(&self, node: usize) -> Option<usize> {
        self.rig.bones()[node].parent
    }

    /// Returns the joints of a skin; `None` if it has no matrices, which means that the nodes are in the bind pose.
    fn joints(&self, document: &Document, bin: &[u8], skin: &Skin) -> Result<Option<Vec<Joint>>, String> {
        let Some(accessor) = skin.inverse_bind_matrices else { return Ok(None) };
        let values = floats(document, bin, accessor, "MAT4")?;
        let (matrices, _) = values.as_chunks::<16>();
        let mut joints = Vec::with_capacity(skin.joints.len());
        for (&node, matrix) in skin.joints.iter().zip(matrices) {
            let to_joint = DMat4::from_cols_array(&matrix.map(f64::from));
            // A matrix without an inverse carries no information about its joint.
            let moved = Similarity::of(self.global[node] * to_joint);
            if let (Some(moved), Some(_)) = (moved, Similarity::of(to_joint)) {
                joints.push(Joint { node, bound: to_joint.inverse(), moved });
            }
        }
        Ok((!joints.is_empty()).then_some(joints))
    }

    /// Transform from the mesh's space to the scene's in the bind pose; `None` if the nodes are already in the bind
    /// pose.
    fn frame(&self, document: &Document, skin: usize, joints: &[Joint]) -> Option<Similarity> {
        let scale = median(joints.iter().map(|joint| joint.moved.scale));
        let extent = scale * extent(joints);
        let around = self.around(document, skin, joints, scale);
        let angle = |frame: &Similarity| median(joints.iter().map(|joint| joint.moved.angle(frame)));
        let Some((common, agreed)) = common(joints, extent) else {
            let nearest = |frames: Vec<Similarity>| {
                let angles = frames.into_iter().map(|frame| (angle(&frame), frame));
                angles.min_by(|a, b| a.0.total_cmp(&b.0))
            };
            let (said, turned) = (nearest(around)?, nearest(quarter_turns(scale))?);
            return Some(if said.0 < turned.0 + MAX_DISAGREEMENT { said.1 } else { centred(turned.1, joints) });
        };
        let level = |v: DVec3| DVec3::new(v.x, 0.0, v.z);
        let apart = |frame: &Similarity| level(frame.translation).distance(level(common.translation));
        let alike = around.iter().filter(|frame| frame.angle(&common) < TOLERANCE);
        let nearest = alike.min_by(|a, b| apart(a).total_cmp(&apart(b)));
        let far = nearest.filter(|frame| apart(frame) > MAX_OFFSET * extent).map(|frame| Similarity {
            translation: level(frame.translation) + common.translation.with_x(0.0).with_z(0.0),
            ..common
        });
        far.or((agreed < joints.len()).then_some(common))
    }

    /// Candidate frames from the nodes around a skin: the mesh's own, the joints' ancestors, and the scene. Frames
    /// whose scale differs from the skin's are unrelated and left out.
    fn around(&self, document: &Document, skin: usize, joints: &[Joint], scale: f64) -> Vec<Similarity> {
        let meshes = (0..document.nodes.len()).filter(|&node| document.nodes[node].skin == Some(skin));
        let is_joint = |node: usize| document.skins[skin].joints.contains(&node);
        let above = std::iter::successors(joints.first().map(|joint| joint.node), |&node| self.parent(node));
        let above = above.skip_while(|&node| is_joint(node)).take(1);
        let found = meshes.chain(above).filter_map(|node| Similarity::of(self.global[node]));
        let scene = Similarity { scale, ..Similarity::IDENTITY };
        found.chain([Similarity::IDENTITY]).filter(|frame| frame.has_scale_of(&scene)).chain([scene]).collect()
    }

    /// Local transforms of the nodes whose bind pose differs from the file's.
    fn locals(&self, places: &BTreeMap<usize, Option<DMat4>>) -> BTreeMap<usize, Transform> {
        let mut global = self.global.clone();
        let mut found = BTreeMap::new();
        for &node in &self.order {
            let above = self.parent(node).map_or(DMat4::IDENTITY, |parent| global[parent]);
            let place = places.get(&node).copied().flatten();
            let local = place.map(|place| above.inverse() * place);
            // Nothing can be placed below a parent without an inverse.
            let local = local.filter(|local| local.is_finite() && !local.abs_diff_eq(self.local[node], 1e-6));
            global[node] = above * local.unwrap_or(self.local[node]);
            if let Some(local) = local {
                found.insert(node, transform(local));
            }
        }
        found
    }
}

/// The transform that more than half of the joints share, and their number.
fn common(joints: &[Joint], extent: f64) -> Option<(Similarity, usize)> {
    /// Number of joints that are compared with all others.
    const TRIED: usize = 64;
    let count = |tried: &Similarity| joints.iter().filter(|joint| joint.moved.is_near(tried, extent)).count();
    let tried = joints.iter().step_by(joints.len().div_ceil(TRIED)).map(|joint| (joint.moved, count(&joint.moved)));
    tried.max_by_key(|&(_, count)| count).filter(|&(_, count)| 2 * count > joints.len())
}

/// Diagonal of the joints' bounding box, in the mesh's space.
fn extent(joints: &[Joint]) -> f64 {
    let places = || joints.iter().map(|joint| joint.bound.w_axis.truncate());
    let low = places().fold(DVec3::INFINITY, DVec3::min);
    let high = places().fold(DVec3::NEG_INFINITY, DVec3::max);
    low.distance(high)
}

/// The frame, translated so that the joints' mean position is that of their nodes.
fn centred(frame: Similarity, joints: &[Joint]) -> Similarity {
    let apart = joints.iter().map(|joint| {
        let bound = joint.bound.w_axis.truncate();
        joint.moved.matrix().transform_point3(bound) - frame.matrix().transform_point3(bound)
    });
    Similarity { translation: frame.translation + apart.sum::<DVec3>() / joints.len() as f64, ..frame }
}

/// The 24 rotations that map axes to axes, with duplicates.
fn quarter_turns(scale: f64) -> Vec<Similarity> {
    let quarter = |axis: DVec3, turns: usize| DQuat::from_axis_angle(axis, std::f64::consts::FRAC_PI_2 * turns as f64);
    let mut turns = Vec::new();
    for x in 0..4 {
        for y in 0..4 {
            for z in 0..2 {
                let rotation = quarter(DVec3::Y, y) * quarter(DVec3::X, x) * quarter(DVec3::Z, z);
                turns.push(Similarity { scale, rotation, translation: DVec3::ZERO });
            }
        }
    }
    turns
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<_> = values.collect();
    let middle = values.len() / 2;
    *values.select_nth_unstable_by(middle, f64::total_cmp).1
}

fn matrix((translation, rotation, scale): Transform) -> DMat4 {
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    let rotation = DQuat::from_array(rotation.map(f64::from));
    DMat4::from_scale_rotation_translation(vector(scale), rotation, vector(translation))
}

fn transform(matrix: DMat4) -> Transform {
    let (scale, rotation, translation) = matrix.to_scale_rotation_translation();
    (translation.as_vec3().to_array(), rotation.as_quat().to_array(), scale.as_vec3().to_array())
}
