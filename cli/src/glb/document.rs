//! What is read of a glTF file's JSON. Everything else in it is passed over.

use serde::Deserialize;
use serde_json::Value;

/// The file.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Document {
    pub(crate) nodes: Vec<Node>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) skins: Vec<Skin>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<View>,
    pub(crate) buffers: Vec<Buffer>,
    pub(crate) animations: Vec<Animation>,
    pub(crate) extensions: Value,
}

impl Document {
    /// Reads the JSON.
    ///
    /// # Errors
    /// Where in it something is not as the format has it.
    pub(crate) fn parse(json: &str) -> Result<Self, String> {
        let mut text = serde_json::Deserializer::from_str(json);
        serde_path_to_error::deserialize(&mut text)
            .map_err(|error| format!("its JSON at `{}`: {}", error.path(), error.inner()))
    }

    /// Each node's parent.
    ///
    /// # Errors
    /// A child that is not there, or that has two parents.
    pub(crate) fn parents(&self) -> Result<Vec<Option<usize>>, String> {
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

/// A place in the scene. Where `matrix` is given, the three others are not.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
pub(crate) struct Node {
    pub(crate) name: Option<String>,
    pub(crate) children: Vec<usize>,
    pub(crate) matrix: Option<[f64; 16]>,
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f64; 4]>,
    pub(crate) scale: Option<[f64; 3]>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) weights: Option<Vec<f32>>,
}

/// Surfaces with their shapes.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Mesh {
    pub(crate) name: Option<String>,
    pub(crate) primitives: Vec<Primitive>,
    pub(crate) weights: Option<Vec<f32>>,
    pub(crate) extras: Value,
}

impl Mesh {
    /// Number of shapes.
    pub(crate) fn shapes(&self) -> usize {
        self.primitives.first().map_or(0, |primitive| primitive.targets.len())
    }

    /// The names of its shapes, where it has names for all of them.
    pub(crate) fn shape_names(&self) -> Option<Vec<String>> {
        let places = std::iter::once(&self.extras).chain(self.primitives.iter().map(|primitive| &primitive.extras));
        let mut lists = places.filter_map(|extras| {
            let names = extras.get("targetNames")?.as_array()?.iter();
            names.map(|name| name.as_str().map(str::to_owned)).collect::<Option<Vec<_>>>()
        });
        lists.find(|names| !names.is_empty() && names.len() == self.shapes())
    }
}

/// A part of a mesh.
#[derive(Clone, Debug, Default, Deserialize)]
#[serde(default)]
pub(crate) struct Primitive {
    pub(crate) targets: Vec<Value>,
    pub(crate) extras: Value,
}

/// The nodes that a mesh follows.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Skin {
    pub(crate) joints: Vec<usize>,
}

/// A list of numbers.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) kind: String,
    pub(crate) sparse: Option<Value>,
}

/// A part of a buffer.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct View {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    pub(crate) byte_stride: Option<usize>,
}

/// Bytes.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) byte_length: usize,
    pub(crate) uri: Option<String>,
}

/// Values of nodes over time.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Animation {
    pub(crate) name: Option<String>,
    pub(crate) channels: Vec<Channel>,
    pub(crate) samplers: Vec<Sampler>,
}

/// What a sampler's values are.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Channel {
    pub(crate) sampler: usize,
    pub(crate) target: Target,
}

/// A node's transform or weights.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Target {
    pub(crate) node: Option<usize>,
    pub(crate) path: String,
}

/// Times and the values at them.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct Sampler {
    pub(crate) input: usize,
    pub(crate) output: usize,
    pub(crate) interpolation: Option<String>,
}
