//! Decompression of meshes with `KHR_draco_mesh_compression`.

use std::collections::{BTreeMap, BTreeSet};

use draco_core::{DecodeLimits, DecoderBuffer, FaceIndex, Mesh, MeshDecoder, PointAttribute, PointIndex};
use serde::Deserialize;
use serde_json::json;
use umo_core_rig::glb::accessor::view_bytes;
use umo_core_rig::glb::document::{Accessor, Document};
use umo_core_rig::glb::splice::{Members, raw};
use umo_core_rig::glb::{Glb, container};

const NAME: &str = "KHR_draco_mesh_compression";
/// Upper bounds of one mesh: points and faces, and decoded bytes.
const MAX_POINTS: u64 = 1 << 24;
const MAX_BYTES: u64 = 1 << 30;
/// glTF's component type of 32-bit floats.
const FLOAT: u32 = 5126;
/// glTF's buffer view targets.
const VERTICES: u32 = 34962;
const INDICES: u32 = 34963;

/// The part of the JSON that lists the compressed meshes.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Meshes {
    meshes: Vec<Primitives>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Primitives {
    primitives: Vec<Primitive>,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Primitive {
    attributes: BTreeMap<String, usize>,
    indices: Option<usize>,
    extensions: Extensions,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Extensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    draco: Option<Draco>,
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Draco {
    buffer_view: usize,
    /// Attributes, with their ids in the compressed mesh.
    attributes: BTreeMap<String, u32>,
}

/// Returns a `.glb` file with its meshes decompressed; unchanged if none is compressed.
///
/// # Errors
/// If a mesh violates one of the formats.
pub(super) fn decompressed(bytes: Vec<u8>) -> Result<Vec<u8>, String> {
    let file = Glb::split(&bytes)?;
    if !file.json.contains(NAME) {
        return Ok(bytes);
    }
    let meshes: Meshes = serde_json::from_str(file.json).map_err(|error| error.to_string())?;
    let document = Document::parse(file.json)?;
    let mut members = Members::parse(file.json)?;
    let mut made = Made {
        accessors: members
            .list("accessors")?
            .iter()
            .map(|text| Members::parse(text.get()))
            .collect::<Result<_, _>>()?,
        views: members.list("bufferViews")?,
        bin: file.bin.to_vec(),
        done: BTreeSet::new(),
    };
    let mut texts = members.list("meshes")?;
    for (at, (mesh, text)) in meshes.meshes.iter().zip(&mut texts).enumerate() {
        let mut members = Members::parse(text.get())?;
        let mut parts = members.list("primitives")?;
        for (primitive, part) in mesh.primitives.iter().zip(&mut parts) {
            let Some(draco) = &primitive.extensions.draco else { continue };
            let decoded = made.decode(&document, file.bin, primitive, draco);
            decoded.map_err(|problem| format!("mesh {at}: its compressed data: {problem}"))?;
            let mut members = Members::parse(part.get())?;
            members.prune("extensions", &[NAME])?;
            *part = members.into_raw();
        }
        members.set_list("primitives", &parts);
        *text = members.into_raw();
    }
    made.bin.resize(made.bin.len().next_multiple_of(4), 0);
    members.set_list("meshes", &texts);
    members.set_list("accessors", &made.accessors.into_iter().map(Members::into_raw).collect::<Vec<_>>());
    members.set_list("bufferViews", &made.views);
    members.set_list("buffers", &[raw(&json!({ "byteLength": made.bin.len() }))]);
    for list in ["extensionsUsed", "extensionsRequired"] {
        members.prune(list, &[NAME])?;
    }
    container(members.text().into_bytes(), &made.bin, file.more)
}

/// A file under construction.
struct Made {
    accessors: Vec<Members>,
    views: Vec<Box<serde_json::value::RawValue>>,
    bin: Vec<u8>,
    /// Accessors that already have their data; primitives may share accessors.
    done: BTreeSet<usize>,
}

impl Made {
    /// Decodes a primitive and fills its accessors.
    fn decode(&mut self, document: &Document, bin: &[u8], primitive: &Primitive, draco: &Draco) -> Result<(), String> {
        let limits = DecodeLimits::default().with_max_points(MAX_POINTS).with_max_faces(MAX_POINTS);
        let limits = limits.with_max_decoded_bytes(MAX_BYTES);
        let mut mesh = Mesh::new();
        let data = view_bytes(document, bin, draco.buffer_view)?;
        let decoded = MeshDecoder::new().decode(&mut DecoderBuffer::new(data).with_limits(limits), &mut mesh);
        decoded.map_err(|error| error.to_string())?;
        if let Some(at) = primitive.indices {
            self.put(document, at, INDICES, 3 * mesh.num_faces(), &mut |width| indices(&mesh, width))?;
        }
        for (name, &id) in &draco.attributes {
            let Some(&at) = primitive.attributes.get(name) else { continue };
            let attribute = mesh.attribute_by_unique_id(id).ok_or_else(|| format!("it has no attribute {id}"))?;
            let accessor = document.accessors.get(at).ok_or_else(|| format!("accessor {at} is missing"))?;
            let row = row(accessor, attribute).ok_or_else(|| format!("{name} is of another type"))?;
            let count = mesh.num_points();
            self.put(document, at, VERTICES, count, &mut |_| values(attribute, count, row))?;
        }
        Ok(())
    }

    /// Fills an accessor of `count` values. `data` receives the bytes per number; its rows of vertex data are
    /// padded to a multiple of 4 bytes.
    fn put(
        &mut self,
        document: &Document,
        at: usize,
        target: u32,
        count: usize,
        data: &mut dyn FnMut(usize) -> Option<Vec<u8>>,
    ) -> Result<(), String> {
        let accessor = document.accessors.get(at).ok_or_else(|| format!("accessor {at} is missing"))?;
        if !self.done.insert(at) {
            return Ok(());
        }
        if accessor.count != count {
            return Err(format!("{count} values for accessor {at}, which has {}", accessor.count));
        }
        let width = width(accessor.component_type).ok_or_else(|| format!("accessor {at} is of an unknown type"))?;
        let bytes = data(width).ok_or("it is not whole")?;
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({
            "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len(), "target": target,
        });
        if target == VERTICES && count > 0 {
            view["byteStride"] = (bytes.len() / count).into();
        }
        let bounds = (accessor.component_type == FLOAT).then(|| bounds(&bytes, count));
        self.bin.extend(bytes);
        let accessor = &mut self.accessors[at];
        for (name, values) in bounds.into_iter().flatten() {
            if accessor.has(name) {
                accessor.set(name, raw(&json!(values)));
            }
        }
        accessor.set("bufferView", raw(&self.views.len().into()));
        accessor.set("byteOffset", raw(&0.into()));
        self.views.push(raw(&view));
        Ok(())
    }
}

/// Returns minimum and maximum of each component of floats; lossy compression makes them differ
/// from the announced bounds.
fn bounds(bytes: &[u8], count: usize) -> [(&'static str, Vec<f32>); 2] {
    let values: Vec<f32> = bytes.as_chunks().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
    let width = values.len() / count.max(1);
    let of = |most: fn(f32, f32) -> f32| {
        let column = |at: usize| values.iter().skip(at).step_by(width).copied().reduce(most).unwrap_or(0.0);
        (0..width).map(column).collect()
    };
    [("min", of(f32::min)), ("max", of(f32::max))]
}

/// Returns the bytes per number of a glTF component type.
fn width(component_type: u32) -> Option<usize> {
    match component_type {
        5120 | 5121 => Some(1),
        5122 | 5123 => Some(2),
        5125 | 5126 => Some(4),
        _ => None,
    }
}

/// Returns the bytes of a vertex's value, if accessor and attribute have the same type.
fn row(accessor: &Accessor, attribute: &PointAttribute) -> Option<usize> {
    let components = ["SCALAR", "VEC2", "VEC3", "VEC4"].iter().position(|kind| *kind == accessor.kind)? + 1;
    let same = width(accessor.component_type)? == attribute.data_type().byte_length();
    (same && components == usize::from(attribute.num_components()))
        .then(|| components * attribute.data_type().byte_length())
}

/// Returns each point's value: `row` bytes padded to a multiple of 4.
fn values(attribute: &PointAttribute, count: usize, row: usize) -> Option<Vec<u8>> {
    let stride = usize::try_from(attribute.byte_stride()).ok()?;
    let mut out = Vec::with_capacity(count * row.next_multiple_of(4));
    for point in 0..u32::try_from(count).ok()? {
        let start = (attribute.mapped_index(PointIndex(point)).0 as usize).checked_mul(stride)?;
        out.extend(attribute.buffer().data().get(start..start.checked_add(row)?)?);
        out.resize(out.len().next_multiple_of(4), 0);
    }
    Some(out)
}

/// Returns the faces' corners as indices of `width` bytes; `None` if one does not fit.
fn indices(mesh: &Mesh, width: usize) -> Option<Vec<u8>> {
    let corners = (0..u32::try_from(mesh.num_faces()).ok()?).flat_map(|face| mesh.face(FaceIndex(face)));
    let mut out = Vec::with_capacity(3 * width * mesh.num_faces());
    for PointIndex(point) in corners {
        if u64::from(point) >> (8 * width) != 0 {
            return None;
        }
        out.extend(&point.to_le_bytes()[..width]);
    }
    Some(out)
}
