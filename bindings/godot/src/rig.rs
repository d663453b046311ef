//! Which joint moves which bone, and which channel which blend shape.

use std::collections::HashMap;

use godot::classes::{ArrayMesh, Mesh, MeshInstance3D, Skeleton3D};
use godot::prelude::*;

use crate::ffi::JOINTS;
use crate::umo::{CHANNELS_AT, Model};

/// The bones of Godot's humanoid profile, in the order of umo's joints.
#[rustfmt::skip]
const HUMANOID: [&str; JOINTS] = [
    "Hips", "LeftUpperLeg", "RightUpperLeg", "Spine", "LeftLowerLeg", "RightLowerLeg", "Chest", "LeftFoot", "RightFoot",
    "UpperChest", "LeftToes", "RightToes", "Neck", "LeftShoulder", "RightShoulder", "Head", "LeftUpperArm",
    "RightUpperArm", "LeftLowerArm", "RightLowerArm", "LeftHand", "RightHand", "Jaw", "LeftEye", "RightEye",
    "LeftIndexProximal", "LeftIndexIntermediate", "LeftIndexDistal", "LeftMiddleProximal", "LeftMiddleIntermediate",
    "LeftMiddleDistal", "LeftLittleProximal", "LeftLittleIntermediate", "LeftLittleDistal", "LeftRingProximal",
    "LeftRingIntermediate", "LeftRingDistal", "LeftThumbMetacarpal", "LeftThumbProximal", "LeftThumbDistal",
    "RightIndexProximal", "RightIndexIntermediate", "RightIndexDistal", "RightMiddleProximal",
    "RightMiddleIntermediate", "RightMiddleDistal", "RightLittleProximal", "RightLittleIntermediate",
    "RightLittleDistal", "RightRingProximal", "RightRingIntermediate", "RightRingDistal", "RightThumbMetacarpal",
    "RightThumbProximal", "RightThumbDistal",
];
const ANKLES: [usize; 2] = [7, 8];
/// Shoulder and elbow, with the joint that each points to: arms are turned from how the skeleton rests to umo's T.
const ARMS: [(usize, usize); 4] = [(16, 18), (17, 19), (18, 20), (19, 21)];
const ELBOWS: [usize; 2] = [18, 19];

/// A bone that a joint moves, or that lies between such bones.
struct Bone {
    bone: i32,
    joint: Option<usize>,
    /// Where its parent is among these.
    parent: Option<usize>,
    /// How it is turned in the skeleton while the body stands in a T.
    rest: Quaternion,
}

/// A skeleton's bones with the joints that move them.
pub(crate) struct Rig {
    skeleton: InstanceId,
    version: u64,
    /// Parents first.
    bones: Vec<Bone>,
    parents: [i32; JOINTS],
    /// The hips; where umo's origin, on the floor, is in the skeleton; from there to the hips' parent; a metre of umo's.
    root: Option<(i32, Vector3, Transform3D, f32)>,
    turned: Vec<Quaternion>,
}

impl Rig {
    pub(crate) fn new(skeleton: &Gd<Skeleton3D>, model: &Model) -> Self {
        let mut bone_of = [None; JOINTS];
        let mut joint_of = HashMap::new();
        for (joint, bone) in bone_of.iter_mut().enumerate() {
            *bone = find_bone(skeleton, model, joint);
            if let Some(bone) = *bone {
                joint_of.insert(bone, joint);
            }
        }
        let corrections = corrections(skeleton, model, &bone_of);
        let mut bones: Vec<Bone> = Vec::new();
        let mut places = HashMap::new();
        for &bone in bone_of.iter().flatten() {
            let mut path = vec![bone];
            while let Some(&last) = path.last()
                && skeleton.get_bone_parent(last) >= 0
            {
                path.push(skeleton.get_bone_parent(last));
            }
            for bone in path.into_iter().rev() {
                if places.contains_key(&bone) {
                    continue;
                }
                places.insert(bone, bones.len());
                let joint = joint_of.get(&bone).copied();
                let parent = places.get(&skeleton.get_bone_parent(bone)).copied();
                let rest = rotation(&skeleton.get_bone_global_rest(bone));
                let rest = joint.map_or(rest, |joint| corrections[joint] * rest);
                bones.push(Bone { bone, joint, parent, rest });
            }
        }
        Self {
            skeleton: skeleton.instance_id(),
            version: skeleton.get_version(),
            bones,
            parents: model.parents,
            root: root(skeleton, model, &bone_of),
            turned: Vec::new(),
        }
    }

    /// Whether it still describes that skeleton.
    pub(crate) fn is_of(&self, skeleton: &Gd<Skeleton3D>) -> bool {
        self.skeleton == skeleton.instance_id() && self.version == skeleton.get_version()
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.bones.is_empty()
    }

    /// Shows a frame.
    pub(crate) fn pose(&mut self, skeleton: &mut Gd<Skeleton3D>, frame: &[f32], moves_root: bool) {
        let mut body = [Quaternion::default(); JOINTS];
        for (joint, q) in frame[3..CHANNELS_AT].chunks_exact(4).enumerate() {
            let q = Quaternion::new(q[0], q[1], q[2], q[3]);
            body[joint] = match usize::try_from(self.parents[joint]) {
                Ok(parent) => body[parent] * q,
                Err(_) => q,
            };
        }
        self.turned.clear();
        for Bone { bone, joint, parent, rest } in &self.bones {
            let parent = parent.map_or_else(Quaternion::default, |parent| self.turned[parent]);
            let turned = match joint {
                Some(joint) => body[*joint] * *rest,
                // Whoever else moves it may: what hangs on it is where umo wants it.
                None => parent * skeleton.get_bone_pose_rotation(*bone),
            };
            if joint.is_some() {
                skeleton.set_bone_pose_rotation(*bone, (parent.inverse() * turned).normalized());
            }
            self.turned.push(turned.normalized());
        }
        if let (Some((bone, origin, to_parent, metre)), true) = (self.root, moves_root) {
            let place = origin + Vector3::new(frame[0], frame[1], frame[2]) * metre;
            skeleton.set_bone_pose_position(bone, to_parent * place);
        }
    }
}

/// umo's own name, SMPL-X's where it differs, or the humanoid profile's. Letter by letter: `left_foot` is SMPL-X's toes, and
/// `LeftFoot` the profile's ankle.
fn find_bone(skeleton: &Gd<Skeleton3D>, model: &Model, joint: usize) -> Option<i32> {
    let name = model.joint_name(u32::try_from(joint).ok()?);
    let names = [&name, &format!("{name}_smplhf"), HUMANOID[joint]];
    names.into_iter().map(|name| skeleton.find_bone(name)).find(|&bone| bone >= 0)
}

fn rotation(transform: &Transform3D) -> Quaternion {
    if transform.basis.determinant().abs() < 1e-9 {
        return Quaternion::default();
    }
    transform.basis.orthonormalized().get_quaternion()
}

fn offset(model: &Model, joint: usize) -> Vector3 {
    let [x, y, z] = model.offsets[joint];
    Vector3::new(x, y, z)
}

/// How far each joint's bone is turned from the skeleton's rest to umo's T: arms only, for whose rest artists choose
/// anything from a T to an A; hands and fingers go along.
fn corrections(skeleton: &Gd<Skeleton3D>, model: &Model, bone_of: &[Option<i32>; JOINTS]) -> [Quaternion; JOINTS] {
    let mut corrections = [Quaternion::default(); JOINTS];
    for (joint, child) in ARMS {
        let (Some(bone), Some(child_bone)) = (bone_of[joint], bone_of[child]) else { continue };
        let place = |bone| skeleton.get_bone_global_rest(bone).origin;
        let (from, to) = (place(child_bone) - place(bone), offset(model, child));
        // Opposite directions have no shortest way, and nobody's arms are turned inside out.
        if from.length() < 1e-6 || to.length() < 1e-6 || from.normalized().dot(to.normalized()) < -0.99 {
            continue;
        }
        let (from, to) = (from.normalized(), to.normalized());
        let axis = from.cross(to);
        corrections[joint] = Quaternion::new(axis.x, axis.y, axis.z, 1.0 + from.dot(to)).normalized();
    }
    for joint in 0..JOINTS {
        let Ok(parent) = usize::try_from(model.parents[joint]) else { continue };
        let below_elbow = ELBOWS.contains(&parent) || parent > ELBOWS[1] && is_below(model, parent, &ELBOWS);
        if below_elbow {
            corrections[joint] = corrections[parent];
        }
    }
    corrections
}

/// Whether a joint hangs on one of `above`, however far.
fn is_below(model: &Model, joint: usize, above: &[usize]) -> bool {
    match usize::try_from(model.parents[joint]) {
        Ok(parent) => above.contains(&parent) || is_below(model, parent, above),
        Err(_) => false,
    }
}

/// The hips, and how large this body is beside umo's, by the height of the hips over the ankles.
fn root(
    skeleton: &Gd<Skeleton3D>,
    model: &Model,
    bone_of: &[Option<i32>; JOINTS],
) -> Option<(i32, Vector3, Transform3D, f32)> {
    let hips = bone_of[0]?;
    let rest = skeleton.get_bone_global_rest(hips).origin;
    let parent = skeleton.get_bone_parent(hips);
    let to_parent = match parent {
        0.. => skeleton.get_bone_global_rest(parent),
        _ => Transform3D::IDENTITY,
    };
    if to_parent.basis.determinant().abs() < 1e-9 {
        return None;
    }
    let heights = ANKLES.into_iter().filter_map(|ankle| {
        let bone = bone_of[ankle]?;
        let (mut height, mut joint) = (0.0, ankle);
        while let Ok(parent) = usize::try_from(model.parents[joint]) {
            height -= model.offsets[joint][1];
            joint = parent;
        }
        Some((rest.y - skeleton.get_bone_global_rest(bone).origin.y) / height)
    });
    let metre = heights.into_iter().find(|metre| metre.is_finite() && *metre > 0.0).unwrap_or(1.0);
    // The floor is where the skeleton's own origin is, as importers lay characters out.
    let origin = Vector3::new(rest.x, 0.0, rest.z) + offset(model, 0) * metre;
    Some((hips, origin, to_parent.affine_inverse(), metre))
}

/// A mesh's blend shapes with the channels that move them.
pub(crate) struct Face {
    instance: InstanceId,
    mesh: InstanceId,
    count: i32,
    /// Blend shape and channel.
    shapes: Vec<(i32, usize)>,
}

impl Face {
    pub(crate) fn new(instance: &Gd<MeshInstance3D>, mesh: &Gd<Mesh>, model: &Model) -> Self {
        let channels: HashMap<String, usize> =
            model.channels.iter().enumerate().map(|(channel, name)| (plain(name), channel)).collect();
        let count = instance.get_blend_shape_count();
        let names = mesh.clone().try_cast::<ArrayMesh>().ok();
        let shapes = (0..count)
            .filter_map(|shape| {
                let name = names.as_ref()?.get_blend_shape_name(shape).to_string();
                Some((shape, *channels.get(&plain(&name))?))
            })
            .collect();
        Self { instance: instance.instance_id(), mesh: mesh.instance_id(), count, shapes }
    }

    /// Whether it still describes that instance with that mesh.
    pub(crate) fn is_of(&self, instance: &Gd<MeshInstance3D>, mesh: &Gd<Mesh>) -> bool {
        self.instance == instance.instance_id()
            && self.mesh == mesh.instance_id()
            && self.count == instance.get_blend_shape_count()
    }

    pub(crate) fn pose(&self, instance: &mut Gd<MeshInstance3D>, frame: &[f32]) {
        for &(shape, channel) in &self.shapes {
            instance.set_blend_shape_value(shape, frame[CHANNELS_AT + channel]);
        }
    }
}

/// `jawOpen`, `JawOpen`, `jaw_open` and `face.jawOpen` are one name, and so are `eyeBlinkLeft` and `eyeBlink_L`.
fn plain(name: &str) -> String {
    let name = name.rsplit('.').next().unwrap_or(name);
    let name = match (name.strip_suffix("_L"), name.strip_suffix("_R")) {
        (Some(stem), _) => format!("{stem}Left"),
        (_, Some(stem)) => format!("{stem}Right"),
        _ => name.into(),
    };
    name.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_lowercase()).collect()
}
