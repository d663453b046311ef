//! Maps joints to bones and face channels to blend shapes.

use std::collections::HashMap;
use std::rc::Rc;

use godot::classes::{ArrayMesh, Mesh, MeshInstance3D, Skeleton3D};
use godot::prelude::*;

use umo_core::{Follow, Mapping, RetargetError};

use crate::body::Body;
use crate::ffi::JOINT_COUNT;
use crate::umo::{CHANNELS_AT, Model};

const ANKLES: [usize; 2] = [7, 8];
/// Shoulder and elbow, each with the joint it points to. Arms are corrected from the skeleton's rest pose to umo's
/// T-pose.
const ARMS: [(usize, usize); 4] = [(16, 18), (17, 19), (18, 20), (19, 21)];
const ELBOWS: [usize; 2] = [18, 19];

/// A bone that a joint moves, or that lies between such bones.
struct Bone {
    bone: i32,
    /// The joint that moves it, if its name is known.
    joint: Option<Follow>,
    /// Index of its parent in this list, if the parent is in it.
    parent: Option<usize>,
    /// Its rotation in skeleton space while the body stands in a T-pose.
    rest: Quaternion,
}

/// Joint of the head, and height of the eyes in heights of its bone: an adult's are 8 cm above it.
const HEAD: usize = 15;
const EYES_OF_HEAD: f32 = 1.05;

/// The bones of a skeleton with the joints that move them.
pub(crate) struct Rig {
    skeleton: InstanceId,
    version: u64,
    /// Parents first.
    bones: Vec<Bone>,
    parents: [i32; JOINT_COUNT],
    /// The hips; where umo's origin, on the floor, is in the skeleton; from there to the hips'
    /// parent; a metre of umo's.
    root: Option<(i32, Vector3, Transform3D, f32)>,
    /// Where the eyes are in the skeleton at rest.
    eyes: Option<Vector3>,
    turned: Vec<Quaternion>,
    /// The library's retargeter, where bodies have a volume, and its strength.
    body: Option<Body>,
    volume: f64,
    /// Rotations that it wants of the bones, in skeleton space.
    wanted: Vec<Quaternion>,
    problem: Option<String>,
}

impl Rig {
    /// Maps the bones with known names, however many there are. With a volume above 0 the library's retargeter moves
    /// them, if it can.
    pub(crate) fn new(skeleton: &Gd<Skeleton3D>, model: &Rc<Model>, volume: f64) -> Self {
        let (mapping, problem) =
            names(skeleton).unwrap_or_else(|problem| (Mapping::default(), Some(problem.to_string())));
        let index = |bone: usize| i32::try_from(bone).ok();
        let bone_of: [Option<i32>; JOINT_COUNT] = std::array::from_fn(|joint| mapping.bone(joint).and_then(index));
        let follows = || mapping.follows().filter_map(|follow| Some((index(follow.bone)?, follow)));
        let joint_of: HashMap<i32, Follow> = follows().collect();
        let corrections = corrections(skeleton, model, &bone_of);
        let mut bones: Vec<Bone> = Vec::new();
        let mut places = HashMap::new();
        for (bone, _) in follows() {
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
                let rest = joint.map_or(rest, |follow| corrections[follow.joints[1]] * rest);
                bones.push(Bone { bone, joint, parent, rest });
            }
        }
        let mut problem = problem;
        let mut body = None;
        if volume > 0.0 && problem.is_none() {
            let count = usize::try_from(skeleton.get_bone_count()).unwrap_or_default();
            let mut joints = vec![-1; count];
            for follow in mapping.follows() {
                joints[follow.bone] = i32::try_from(follow.joints[1]).unwrap_or(-1);
            }
            #[expect(clippy::cast_possible_truncation, reason = "at most 1")]
            match Body::new(skeleton, model, joints, volume.min(1.0) as f32) {
                Ok(made) => body = Some(made),
                Err(error) => problem = Some(format!("no volume: {error}")),
            }
        }
        Self {
            skeleton: skeleton.instance_id(),
            version: skeleton.get_version(),
            bones,
            parents: model.parents,
            root: root(skeleton, model, &bone_of),
            eyes: bone_of[HEAD].map(|bone| skeleton.get_bone_global_rest(bone).origin * EYES_OF_HEAD),
            turned: Vec::new(),
            body,
            volume,
            wanted: Vec::new(),
            problem,
        }
    }

    /// The reason why the names form no humanoid, if they do not.
    pub(crate) fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// Where the eyes are in the skeleton at rest, if it has a head.
    pub(crate) fn eyes(&self) -> Option<Vector3> {
        self.eyes
    }

    /// Whether it still describes that skeleton.
    #[expect(clippy::float_cmp, reason = "whether it was changed")]
    pub(crate) fn is_of(&self, skeleton: &Gd<Skeleton3D>, volume: f64) -> bool {
        self.skeleton == skeleton.instance_id() && self.version == skeleton.get_version() && self.volume == volume
    }

    /// Shows a frame. `seconds`: since the last one.
    pub(crate) fn pose(&mut self, skeleton: &mut Gd<Skeleton3D>, seconds: f32, frame: &[f32], moves_root: bool) {
        let hips = self.body.as_mut().and_then(|body| body.pose(seconds, frame).ok());
        let mut body = [Quaternion::default(); JOINT_COUNT];
        for (joint, q) in frame[3..CHANNELS_AT].chunks_exact(4).enumerate() {
            let q = Quaternion::new(q[0], q[1], q[2], q[3]);
            body[joint] = match usize::try_from(self.parents[joint]) {
                Ok(parent) => body[parent] * q,
                Err(_) => q,
            };
        }
        self.turned.clear();
        self.wanted.clear();
        for Bone { bone, joint, parent, rest } in &self.bones {
            let local = usize::try_from(*bone).ok().zip(self.body.as_ref().filter(|_| hips.is_some()));
            let wanted = local.map(|(bone, body)| {
                let turn = Quaternion::new(
                    body.turns[4 * bone],
                    body.turns[4 * bone + 1],
                    body.turns[4 * bone + 2],
                    body.turns[4 * bone + 3],
                );
                parent.map_or_else(Quaternion::default, |parent| self.wanted[parent]) * turn
            });
            self.wanted.extend(wanted);
            let parent = parent.map_or_else(Quaternion::default, |parent| self.turned[parent]);
            let turned = match joint {
                Some(_) if wanted.is_some() => wanted.unwrap_or_default(),
                Some(Follow { joints: [from, to], share, .. }) if *share < 1.0 => {
                    body[*from].slerp(body[*to], *share) * *rest
                }
                Some(follow) => body[follow.joints[1]] * *rest,
                // A bone between joints may be moved by other nodes: its children are still placed as umo computes
                // them.
                None => parent * skeleton.get_bone_pose_rotation(*bone),
            };
            if joint.is_some() {
                skeleton.set_bone_pose_rotation(*bone, (parent.inverse() * turned).normalized());
            }
            self.turned.push(turned.normalized());
        }
        if let (Some((bone, origin, to_parent, metre)), true) = (self.root, moves_root) {
            let place = hips.unwrap_or_else(|| origin + Vector3::new(frame[0], frame[1], frame[2]) * metre);
            skeleton.set_bone_pose_position(bone, to_parent * place);
        }
    }
}

/// Matches the bones' names with the best of umo's tables. Also returns the reason why the matches do not form a
/// humanoid, if so.
fn names(skeleton: &Gd<Skeleton3D>) -> Result<(Mapping, Option<String>), RetargetError> {
    let bones = (0..skeleton.get_bone_count()).map(|bone| {
        let parent = usize::try_from(skeleton.get_bone_parent(bone)).ok();
        // Matching by name does not need the positions of bones.
        umo_core::Bone::new(skeleton.get_bone_name(bone).to_string(), parent, [0.0; 3])
    });
    let rig = umo_core::Rig::new(bones.collect())?;
    let (mapping, _) = Mapping::closest(&rig);
    let problem = mapping.check(&rig).err().map(|problem| problem.to_string());
    Ok((mapping, problem))
}

pub(crate) fn rotation(transform: &Transform3D) -> Quaternion {
    if transform.basis.determinant().abs() < 1e-9 {
        return Quaternion::default();
    }
    transform.basis.orthonormalized().get_quaternion()
}

fn offset(model: &Model, joint: usize) -> Vector3 {
    let [x, y, z] = model.offsets[joint];
    Vector3::new(x, y, z)
}

/// Rotation of each joint's bone from the skeleton's rest to umo's T: arms only, for whose
/// rest artists choose anything from a T to an A; hands and fingers go along.
fn corrections(
    skeleton: &Gd<Skeleton3D>,
    model: &Model,
    bone_of: &[Option<i32>; JOINT_COUNT],
) -> [Quaternion; JOINT_COUNT] {
    let mut corrections = [Quaternion::default(); JOINT_COUNT];
    for (joint, child) in ARMS {
        let (Some(bone), Some(child_bone)) = (bone_of[joint], bone_of[child]) else { continue };
        let place = |bone| skeleton.get_bone_global_rest(bone).origin;
        let (from, to) = (place(child_bone) - place(bone), offset(model, child));
        // Opposite directions have no unique shortest rotation, and no rest pose has its arms turned inside out.
        if from.length() < 1e-6 || to.length() < 1e-6 || from.normalized().dot(to.normalized()) < -0.99 {
            continue;
        }
        let (from, to) = (from.normalized(), to.normalized());
        let axis = from.cross(to);
        corrections[joint] = Quaternion::new(axis.x, axis.y, axis.z, 1.0 + from.dot(to)).normalized();
    }
    for joint in 0..JOINT_COUNT {
        let Ok(parent) = usize::try_from(model.parents[joint]) else { continue };
        let below_elbow = ELBOWS.contains(&parent) || parent > ELBOWS[1] && is_below(model, parent, &ELBOWS);
        if below_elbow {
            corrections[joint] = corrections[parent];
        }
    }
    corrections
}

/// Whether a joint is a descendant of one of `above`.
fn is_below(model: &Model, joint: usize, above: &[usize]) -> bool {
    match usize::try_from(model.parents[joint]) {
        Ok(parent) => above.contains(&parent) || is_below(model, parent, above),
        Err(_) => false,
    }
}

/// Finds the hips, and the scale of this body relative to umo's from the height of the hips over the ankles.
fn root(
    skeleton: &Gd<Skeleton3D>,
    model: &Model,
    bone_of: &[Option<i32>; JOINT_COUNT],
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
    // The floor is at the skeleton's origin, as importers place characters.
    let origin = Vector3::new(rest.x, 0.0, rest.z) + offset(model, 0) * metre;
    Some((hips, origin, to_parent.affine_inverse(), metre))
}

/// A mesh's blend shapes with the channels that move them.
pub(crate) struct Face {
    instance: InstanceId,
    mesh: InstanceId,
    count: i32,
    /// Index of the blend shape and of its channel.
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

/// Normalises a name: `jawOpen`, `JawOpen`, `jaw_open` and `face.jawOpen` are equal, and so are `eyeBlinkLeft` and
/// `eyeBlink_L`.
fn plain(name: &str) -> String {
    let name = name.rsplit('.').next().unwrap_or(name);
    let name = match (name.strip_suffix("_L"), name.strip_suffix("_R")) {
        (Some(stem), _) => format!("{stem}Left"),
        (_, Some(stem)) => format!("{stem}Right"),
        _ => name.into(),
    };
    name.chars().filter(char::is_ascii_alphanumeric).map(|letter| letter.to_ascii_lowercase()).collect()
}
