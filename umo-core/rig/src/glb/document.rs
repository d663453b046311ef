//! The parts of a glTF file's JSON that are read. All others are ignored.
#![allow(missing_docs, reason = "fields are named as glTF names them")]

use serde::Deserialize;
use serde_json::Value;

/// The file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Document {
    pub nodes: Vec<Node>,
    pub meshes: Vec<Mesh>,
    pub skins: Vec<Skin>,
    pub accessors: Vec<Accessor>,
    pub buffer_views: Vec<View>,
    pub buffers: Vec<Buffer>,
    pub animations: Vec<Animation>,
    pub extensions: Value,
    pub asset: Value,
}

impl Document {
    /// Reads the JSON.
    ///
    /// # Errors
    /// The path of the value that violates the format.
    pub fn parse(json: &str) -> Result<Self, String> {
        parse(json)
    }

    /// Returns the parent of each node.
    ///
    /// # Errors
    /// A child does not exist or has two parents.
    pub fn parents(&self) -> Result<Vec<Option<usize>>, String> {
        let mut parents = vec![None; self.nodes.len()];
        for (parent, node) in self.nodes.iter().enumerate() {
            for &child in &node.children {
                let slot = parents.get_mut(child).ok_or_else(|| format!("node {parent}: there is no node {child}"))?;
                if slot.replace(parent).is_some() {
                    return Err(format!("node {child} has two parents"));
                }
            }
        }
        Ok(parents)
    }
}

/// Deserialises parts of a file's JSON.
pub(super) fn parse<'a, T: Deserialize<'a>>(json: &'a str) -> Result<T, String> {
    let mut text = serde_json::Deserializer::from_str(json);
    serde_path_to_error::deserialize(&mut text)
        .map_err(|error| format!("its JSON at `{}`: {}", error.path(), error.inner()))
}

/// A node of the scene. If `matrix` is given, the three other transforms are not.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub struct Node {
    pub name: Option<String>,
    pub children: Vec<usize>,
    pub matrix: Option<[f64; 16]>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub mesh: Option<usize>,
    pub skin: Option<usize>,
    pub weights: Option<Vec<f32>>,
    pub extras: Value,
}

/// A mesh and its morph targets.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Mesh {
    pub name: Option<String>,
    pub primitives: Vec<Primitive>,
    pub weights: Option<Vec<f32>>,
    pub extras: Value,
}

impl Mesh {
    /// Number of shapes: the maximum over the primitives, some of which may have none.
    pub fn shapes(&self) -> usize {
        self.primitives.iter().map(|primitive| primitive.targets.len()).max().unwrap_or(0)
    }

    /// Whether all primitives that have shapes have the same number.
    pub fn is_even(&self) -> bool {
        let shapes = self.shapes();
        self.primitives.iter().all(|primitive| [0, shapes].contains(&primitive.targets.len()))
    }

    /// Names of the shapes, if all have one. Some exporters repeat the list for each primitive; it is then returned
    /// once.
    pub fn shape_names(&self) -> Option<Vec<String>> {
        let count = self.shapes();
        self.shape_lists().into_iter().find_map(|mut names| {
            let is_once = !names.is_empty() && count > 0 && names.len() % count == 0;
            let is_found = is_once && names.chunks(count).all(|again| *again == names[..count]);
            names.truncate(count);
            is_found.then_some(names)
        })
    }

    /// All lists of shape names, of any length.
    pub fn shape_lists(&self) -> Vec<Vec<String>> {
        let places = std::iter::once(&self.extras).chain(self.primitives.iter().map(|primitive| &primitive.extras));
        let lists = places.filter_map(|extras| {
            let names = extras.get("targetNames")?.as_array()?.iter();
            names.map(|name| name.as_str().map(str::to_owned)).collect::<Option<Vec<_>>>()
        });
        lists.collect()
    }
}

/// A part of a mesh.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub struct Primitive {
    pub attributes: Value,
    pub indices: Option<Value>,
    pub mode: Option<Value>,
    pub targets: Vec<Value>,
    pub extras: Value,
}

/// The nodes that deform a mesh.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Skin {
    pub joints: Vec<usize>,
    /// Accessor with a matrix per joint, from the mesh's space to the joint's in the bind pose.
    pub inverse_bind_matrices: Option<usize>,
}

/// A typed array in a buffer view.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Accessor {
    pub buffer_view: Option<usize>,
    #[serde(default)]
    pub byte_offset: usize,
    pub component_type: u32,
    #[serde(default)]
    pub normalized: bool,
    pub count: usize,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Value>,
}

/// A range of a buffer.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct View {
    pub buffer: usize,
    #[serde(default)]
    pub byte_offset: usize,
    pub byte_length: usize,
    pub byte_stride: Option<usize>,
}

/// Raw data.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub struct Buffer {
    pub byte_length: usize,
    pub uri: Option<String>,
}

/// Animated values of nodes.
#[derive(Clone, Debug, Deserialize)]
pub struct Animation {
    pub name: Option<String>,
    pub channels: Vec<Channel>,
    pub samplers: Vec<Sampler>,
}

/// Assigns a sampler to a target.
#[derive(Clone, Debug, Deserialize)]
pub struct Channel {
    pub sampler: usize,
    pub target: Target,
}

/// The animated property: a node's transform or its weights.
#[derive(Clone, Debug, Deserialize)]
pub struct Target {
    pub node: Option<usize>,
    pub path: String,
}

/// Keyframe times and values.
#[derive(Clone, Debug, Deserialize)]
pub struct Sampler {
    pub input: usize,
    pub output: usize,
    pub interpolation: Option<String>,
}
