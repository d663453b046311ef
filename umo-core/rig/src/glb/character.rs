//! A character in a `.glb` or `.vrm` file.

use std::collections::BTreeMap;

use umo_core_pose::rotation::{IDENTITY, Matrix, Quat, matrix_to_quat};
use umo_core_pose::skeleton::JOINT_NAMES;

use super::bind::bind_pose;
use super::document::{Document, Node};
use super::surface::surface;
use super::{Given, Glb, vrm};
use crate::retarget::{Bone, Mapping, Retarget, Rig, SurfacePoint, Volume};

/// Translation, rotation and scale of a node.
pub type Transform = ([f32; 3], Quat, [f32; 3]);

/// Tolerance of a matrix's deviation from a rotation and a scale.
const SHEAR: f64 = 1e-3;

/// A file whose nodes can be animated.
#[derive(Debug)]
pub struct Character {
    document: Document,
    /// In the bind pose.
    rig: Rig,
    /// Nodes whose bind pose differs from the file, with their local transform in it.
    bound: BTreeMap<usize, Transform>,
    /// Spread over its meshes.
    surface: Vec<SurfacePoint>,
}

impl Character {
    /// Reads a file.
    ///
    /// # Errors
    /// The file violates the format, or its skeleton is rejected.
    pub fn read(bytes: &[u8]) -> Result<Self, String> {
        let file = Glb::split(bytes)?;
        let document = Document::parse(file.json)?;
        check_buffer(&document, file.bin)?;
        let rig = rig(&document)?;
        let bound = bind_pose(&document, file.bin, &rig)?;
        let rig = if bound.is_empty() { rig } else { placed(&rig, &bound)? };
        let surface = surface(&document, file.bin, &rig);
        Ok(Self { document, rig, bound, surface })
    }

    /// The nodes as bones, in the bind pose.
    pub fn rig(&self) -> &Rig {
        &self.rig
    }

    /// The file's JSON.
    pub fn document(&self) -> &Document {
        &self.document
    }

    /// Nodes whose bind pose differs from the file, with their local transform in it.
    pub fn bound(&self) -> &BTreeMap<usize, Transform> {
        &self.bound
    }

    /// Returns the space that the character takes up at rest, and the gain with which its arms respect it, as `given`
    /// says; `None` for a character without arms or legs.
    ///
    /// # Errors
    /// `given` names a part of the body that does not exist, or has a factor that is not between 0 and 10.
    pub fn volume(&self, mapping: &Mapping, given: &Given) -> Result<Option<(Volume, f32)>, String> {
        given.volume(Volume::measure(&self.rig, mapping, &self.surface))
    }

    /// Returns the mapping of a VRM file's bone table, and its version; `None` if it is not a VRM file.
    ///
    /// # Errors
    /// The table violates the VRM specification.
    pub fn vrm_bones(&self) -> Result<Option<(Mapping, &'static str)>, String> {
        vrm::bones(&self.document)
    }

    /// Returns the mapping by the file's own table or by names, overridden by `given`, and the naming convention.
    ///
    /// # Errors
    /// The table violates the VRM specification, or names a bone that does not exist.
    pub fn mapping(&self, given: &Given) -> Result<(Mapping, String), String> {
        let (mut mapping, convention) = given.over(self.rig(), self.vrm_bones()?)?;
        let is_found = mapping.entries().iter().any(|(_, bones)| !bones.is_empty());
        if is_found || self.document().skins.iter().any(|skin| !skin.joints.is_empty()) || !self.has_shapes() {
            return Ok((mapping, convention));
        }
        // A face without a skeleton: only its shapes move.
        for joint in JOINT_NAMES {
            mapping.put(joint, &[]).map_err(|error| error.to_string())?;
        }
        Ok((mapping, "no".to_owned()))
    }

    fn has_shapes(&self) -> bool {
        self.document()
            .nodes
            .iter()
            .filter_map(|node| self.document().meshes.get(node.mesh?))
            .any(|mesh| mesh.shapes() > 0)
    }

    /// Returns the values of the bind pose that differ from the file and that the motion does not set: node, path and
    /// value.
    pub fn placed(&self, retarget: &Retarget) -> impl Iterator<Item = (usize, &'static str, Vec<f32>)> {
        self.bound().iter().flat_map(|(&node, &(translation, rotation, scale))| {
            let is_set = [node == retarget.hips(), retarget.is_driven(node), false];
            let values =
                [("translation", translation.to_vec()), ("rotation", rotation.to_vec()), ("scale", scale.to_vec())];
            let left = values.into_iter().zip(is_set).filter(|(_, is_set)| !is_set);
            left.map(move |((path, value), _)| (node, path, value))
        })
    }

    /// Whether it is a VRM file of either version.
    pub fn is_vrm(&self) -> bool {
        vrm::is_vrm(&self.document)
    }
}

/// Checks that the first buffer, to which data is appended, is the one in the file.
fn check_buffer(document: &Document, bin: &[u8]) -> Result<(), String> {
    match document.buffers.first() {
        None => Ok(()),
        Some(first) if first.uri.is_some() => {
            Err("its first buffer is in another file: pack it into the .glb first".to_owned())
        }
        Some(first) if first.byte_length > bin.len() => Err("the file is cut short".to_owned()),
        Some(_) => Ok(()),
    }
}

fn rig(document: &Document) -> Result<Rig, String> {
    let parents = document.parents()?;
    let mut bones = Vec::with_capacity(document.nodes.len());
    for (node, parent) in document.nodes.iter().zip(parents) {
        // Any other matrix becomes a zero scale, which is rejected if bones below it move.
        let (translation, rotation, scale) = transform(node).unwrap_or(([0.0; 3], IDENTITY, [0.0; 3]));
        let name = node.name.clone().unwrap_or_default();
        bones.push(Bone { name, parent, translation, rotation, scale, deforms: false });
    }
    for &joint in document.skins.iter().flat_map(|skin| &skin.joints) {
        let bone = bones.get_mut(joint).ok_or_else(|| format!("a skin's joint: there is no node {joint}"))?;
        bone.deforms = true;
    }
    Rig::new(bones).map_err(|error| error.to_string())
}

/// Returns the rig with these local transforms.
fn placed(rig: &Rig, places: &BTreeMap<usize, Transform>) -> Result<Rig, String> {
    let mut bones = rig.bones().to_vec();
    for (&node, &(translation, rotation, scale)) in places {
        bones[node] = Bone { translation, rotation, scale, ..bones[node].clone() };
    }
    Rig::new(bones).map_err(|error| error.to_string())
}

/// Returns a node's local transform.
///
/// # Errors
/// The matrix is not a product of translation, rotation and scale.
#[expect(clippy::cast_possible_truncation, reason = "bones are kept in f32; what overflows the rig refuses")]
pub fn transform(node: &Node) -> Result<Transform, String> {
    let narrow = |v: [f64; 3]| v.map(|x| x as f32);
    let Some(m) = node.matrix else {
        let rotation = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]).map(|x| x as f32);
        return Ok((narrow(node.translation.unwrap_or([0.0; 3])), rotation, narrow(node.scale.unwrap_or([1.0; 3]))));
    };
    let column = |at: usize| [m[4 * at], m[4 * at + 1], m[4 * at + 2]];
    let [x, y, z] = [column(0), column(1), column(2)];
    let dot = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let length = |v: [f64; 3]| dot(v, v).sqrt();
    let mut scale = [length(x), length(y), length(z)];
    let volume = dot(x, [y[1] * z[2] - y[2] * z[1], y[2] * z[0] - y[0] * z[2], y[0] * z[1] - y[1] * z[0]]);
    let size = scale[0] * scale[1] * scale[2];
    if !(size.is_finite() && size > 0.0) {
        return Err("its matrix has no inverse".to_owned());
    }
    if (1.0 - volume.abs() / size) > SHEAR {
        return Err("its matrix shears".to_owned());
    }
    if volume < 0.0 {
        scale[0] = -scale[0];
    }
    let unit = [(x, scale[0]), (y, scale[1]), (z, scale[2])].map(|(v, scale)| v.map(|a| a / scale));
    let rows: Matrix = std::array::from_fn(|i| std::array::from_fn(|j| unit[j][i] as f32));
    Ok((narrow([m[12], m[13], m[14]]), matrix_to_quat(rows), narrow(scale)))
}
