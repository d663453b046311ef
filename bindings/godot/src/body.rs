//! The meshes of a skeleton at rest, and poses by the library's retargeter with their volume.

use std::rc::Rc;

use godot::classes::mesh::ArrayType;
use godot::classes::{BoneAttachment3D, MeshInstance3D, Node, Skeleton3D};
use godot::prelude::*;

use crate::ffi::JOINT_COUNT;
use crate::umo::{Character, Model, RestPose};

/// A character that the library's retargeter moves.
pub(crate) struct Body {
    character: Character,
    /// Rotation of each bone in its parent, four values each.
    pub(crate) turns: Vec<f32>,
}

impl Body {
    /// `joints` has the joint of each bone, -1 for none; `gain` is the strength of the volume.
    pub(crate) fn new(
        skeleton: &Gd<Skeleton3D>,
        model: &Rc<Model>,
        joints: Vec<i32>,
        gain: f32,
    ) -> Result<Self, String> {
        let mut rest = RestPose { joints, gain, ..RestPose::default() };
        for bone in 0..skeleton.get_bone_count() {
            let at = skeleton.get_bone_global_rest(bone);
            let turn = crate::rig::rotation(&at);
            rest.parents.push(skeleton.get_bone_parent(bone));
            rest.places.extend([at.origin.x, at.origin.y, at.origin.z]);
            rest.rotations.extend([turn.x, turn.y, turn.z, turn.w]);
        }
        for node in skeleton.find_children_ex("*").type_("MeshInstance3D").owned(false).done().iter_shared() {
            if let Ok(mesh) = node.try_cast::<MeshInstance3D>() {
                add(skeleton, &mesh, &mut rest);
            }
        }
        let turns = vec![0.0; rest.rotations.len()];
        Ok(Self { character: Character::new(model, &rest)?, turns })
    }

    /// Rotates the bones of a frame; also returns where the hips are in the skeleton. `seconds`: since the last frame.
    pub(crate) fn pose(&mut self, seconds: f32, frame: &[f32]) -> Result<Vector3, String> {
        let (translation, rotations) = (&frame[..3], &frame[3..3 + 4 * JOINT_COUNT]);
        let [x, y, z] = self.character.apply(seconds, rotations, translation, &mut self.turns)?;
        Ok(Vector3::new(x, y, z))
    }
}

/// Adds a mesh: skinned, or fixed to a bone by a BoneAttachment3D. Others have no place at rest.
fn add(skeleton: &Gd<Skeleton3D>, instance: &Gd<MeshInstance3D>, rest: &mut RestPose) {
    let Some(mesh) = instance.get_mesh().filter(|_| instance.is_visible()) else { return };
    let skin = instance.get_skin();
    let fixed = attachment(instance);
    for surface in 0..mesh.get_surface_count() {
        let arrays = mesh.surface_get_arrays(surface);
        let array = |which: ArrayType| arrays.get(usize::try_from(which.ord()).unwrap_or_default());
        let Some(points) = array(ArrayType::VERTEX).and_then(|list| list.try_to::<PackedVector3Array>().ok()) else {
            continue;
        };
        let bones = array(ArrayType::BONES).and_then(|list| list.try_to::<PackedInt32Array>().ok());
        let weights = array(ArrayType::WEIGHTS).and_then(|list| list.try_to::<PackedFloat32Array>().ok());
        let first = rest.vertex_bones.len();
        for (at, &point) in points.as_slice().iter().enumerate() {
            let placed = match (&fixed, &skin, &bones, &weights) {
                (Some((bone, to_bone)), ..) => Some((*bone, *to_bone * point, true)),
                (None, Some(skin), Some(bones), Some(weights)) => {
                    // Four or eight weights, each a share of the whole.
                    let count = bones.len() / points.len().max(1);
                    let most = (at * count..(at + 1) * count).max_by(|&a, &b| weights[a].total_cmp(&weights[b]));
                    most.and_then(|most| {
                        let bind = bones[most];
                        let named = || skeleton.find_bone(&skin.get_bind_name(bind).to_string());
                        let bone = Some(skin.get_bind_bone(bind)).filter(|&bone| bone >= 0).unwrap_or_else(named);
                        (bone >= 0).then(|| (bone, skin.get_bind_pose(bind) * point, weights[most] >= 0.5))
                    })
                }
                _ => None,
            };
            let place = placed.map_or(point, |(bone, at, _)| skeleton.get_bone_global_rest(bone) * at);
            rest.vertices.extend([place.x, place.y, place.z]);
            rest.vertex_bones.push(placed.filter(|(.., counts)| *counts).map_or(-1, |(bone, ..)| bone));
        }
        let corner = |index: usize| u32::try_from(first + index).unwrap_or_default();
        match array(ArrayType::INDEX).and_then(|list| list.try_to::<PackedInt32Array>().ok()) {
            Some(list) if !list.is_empty() => {
                rest.indices.extend(list.as_slice().iter().map(|&index| corner(usize::try_from(index).unwrap_or(0))));
            }
            _ => rest.indices.extend((0..points.len() / 3 * 3).map(corner)),
        }
    }
}

/// The bone to which a node is fixed, and the node's place there.
fn attachment(instance: &Gd<MeshInstance3D>) -> Option<(i32, Transform3D)> {
    let mut place = instance.get_transform();
    let mut above = instance.get_parent();
    while let Some(node) = above {
        if let Ok(attachment) = node.clone().try_cast::<BoneAttachment3D>() {
            return Some((attachment.get_bone_idx(), place)).filter(|(bone, _)| *bone >= 0);
        }
        place = node.clone().try_cast::<Node3D>().ok()?.get_transform() * place;
        above = parent(&node);
    }
    None
}

fn parent(node: &Gd<Node>) -> Option<Gd<Node>> {
    node.get_parent().filter(|above| above.clone().try_cast::<Skeleton3D>().is_err())
}
