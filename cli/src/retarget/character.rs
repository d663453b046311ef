//! A character in a `.glb` file, and the animation added to it. All other contents of the file stay unchanged.

use std::collections::BTreeMap;

use serde_json::json;
use serde_json::value::RawValue;
use umo_core::{Floor, Mapping, Quat, Retarget};
use umo_core_pose::clip::Clip;
use umo_core_rig::glb::document::Document;
use umo_core_rig::glb::splice::{Members, raw};
use umo_core_rig::glb::{self, Faces, Glb, container, transform};
use umo_gltf::keys::Bound;

use super::Motion;
use super::body::Body;

/// Limit of the lift of sunken soles, as a share of the height from hips to head; deeper soles are intended.
const SUNK: f32 = 0.35;
/// glTF's component type of 32-bit floats.
const FLOAT: u32 = 5126;

/// A `.glb` file whose nodes are to be moved.
pub(super) struct Character {
    bytes: Vec<u8>,
    read: glb::Character,
}

impl std::ops::Deref for Character {
    type Target = glb::Character;

    fn deref(&self) -> &glb::Character {
        &self.read
    }
}

impl Character {
    /// Reads a `.glb` file.
    ///
    /// # Errors
    /// If the file violates the format or cannot be moved.
    pub(super) fn read(bytes: Vec<u8>) -> Result<Self, String> {
        Ok(Self { read: glb::Character::read(&bytes)?, bytes })
    }

    /// Returns the floor's position. Soles slightly below the file's floor are lifted onto it, such as shoes
    /// added to a bare foot.
    pub(super) fn floor(&self, mapping: &Mapping) -> Floor {
        let place = |joint: usize| mapping.bone(joint).map(|bone| self.rig().place(bone));
        let Some((low, high)) = place(0).zip(place(15)) else { return Floor::AtRest };
        let [x, y, z]: [f32; 3] = std::array::from_fn(|axis| high[axis] - low[axis]);
        // The distance from hips to head is more than a third of a body.
        let is_near = |soles: &f32| *soles < 0.0 && -soles < SUNK * y;
        let soles = (y > x.abs() + z.abs()).then(|| Body::read(self, false).ok()?.soles(self, mapping)).flatten();
        soles.filter(is_near).map_or(Floor::AtRest, Floor::Soles)
    }

    /// Returns the file's statements on authorship and licence: field and value.
    pub(super) fn rights(&self) -> Vec<(&'static str, String)> {
        let document = self.document();
        let at = |value: &serde_json::Value, path: &str| match value.pointer(path) {
            Some(serde_json::Value::String(text)) if !text.is_empty() => Some(text.clone()),
            Some(serde_json::Value::Array(list)) => {
                let texts: Vec<_> = list.iter().filter_map(serde_json::Value::as_str).collect();
                (!texts.is_empty()).then(|| texts.join(", "))
            }
            _ => None,
        };
        let of_asset = [
            ("by", "/extras/author"),
            ("source", "/extras/source"),
            ("licence", "/extras/license"),
            ("licence", "/copyright"),
        ];
        let of_extensions = [
            ("name", "/VRMC_vrm/meta/name"),
            ("by", "/VRMC_vrm/meta/authors"),
            ("licence", "/VRMC_vrm/meta/licenseUrl"),
            ("licence", "/VRMC_vrm/meta/otherLicenseUrl"),
            ("credit", "/VRMC_vrm/meta/creditNotation"),
            ("name", "/VRM/meta/title"),
            ("by", "/VRM/meta/author"),
            ("licence", "/VRM/meta/licenseName"),
            ("licence", "/VRM/meta/otherLicenseUrl"),
            ("use", "/VRM/meta/commercialUssageName"),
        ];
        let asset = of_asset.into_iter().filter_map(|(field, path)| Some((field, at(&document.asset, path)?)));
        let others =
            of_extensions.into_iter().filter_map(|(field, path)| Some((field, at(&document.extensions, path)?)));
        asset.chain(others).collect()
    }

    /// Returns the file as it was read.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Returns the file as it was read.
    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    /// Returns the file with a new animation, placed first so that players choose it by default. The animation also
    /// puts nodes in the bind pose if the file places them elsewhere and the motion does not drive them.
    ///
    /// # Errors
    /// If the result would exceed the format's size limit, or the JSON violates the format.
    pub(super) fn animated(
        &self,
        retarget: &Retarget,
        motion: &Motion,
        faces: &Faces,
        clip: &Clip,
    ) -> Result<Vec<u8>, String> {
        let file = Glb::split(&self.bytes)?;
        let mut members = Members::parse(file.json)?;
        let start = file.bin.len().next_multiple_of(4);
        let (accessors, views) = (members.list("accessors")?, members.list("bufferViews")?);
        let mut tracks = Tracks { first: accessors.len(), view: views.len(), ..Tracks::default() };
        let all: Vec<usize> = (0..motion.hips.len()).collect();
        let keys = |few: &dyn Fn(Bound) -> Vec<usize>| motion.bound.map_or_else(|| all.clone(), few);
        if motion.bound.is_none() {
            tracks.input(&all, motion.frame_rate);
        }
        let driven = (0..self.rig().len()).filter(|&node| retarget.is_driven(node));
        let mut placed = self.placed(retarget).peekable();
        if placed.peek().is_some() {
            let start = tracks.add(&[0.0], 1, json!({ "min": [0.0], "max": [0.0] }));
            for (node, path, value) in placed {
                tracks.channel(start, node, path, &value, value.len());
            }
        }
        for node in driven.clone() {
            let values: Vec<Quat> = motion.rotations.iter().map(|frame| frame[node]).collect();
            let keys = keys(&|bound| bound.rotations(&values));
            let values = continued(keys.iter().map(|&frame| values[frame]));
            let input = tracks.input(&keys, motion.frame_rate);
            tracks.channel(input, node, "rotation", values.as_flattened(), 4);
        }
        if retarget.is_driven(retarget.hips()) {
            let metres = |place: &[f32; 3]| place.map(|x| x / retarget.scale());
            let keys = keys(&|bound| bound.places(&motion.hips.iter().map(metres).collect::<Vec<_>>()));
            let values: Vec<[f32; 3]> = keys.iter().map(|&frame| motion.hips[frame]).collect();
            let input = tracks.input(&keys, motion.frame_rate);
            tracks.channel(input, retarget.hips(), "translation", values.as_flattened(), 3);
        }
        for track in faces.tracks() {
            let weights: Vec<f32> = all.iter().flat_map(|&frame| track.weights(clip.face(frame))).collect();
            let width = weights.len() / all.len();
            let keys = keys(&|bound| bound.rows(&weights, width, |_| false));
            let weights: Vec<f32> = keys.iter().flat_map(|frame| &weights[frame * width..][..width]).copied().collect();
            let input = tracks.input(&keys, motion.frame_rate);
            tracks.channel(input, track.node(), "weights", &weights, 1);
        }
        let total = start + tracks.bytes.len();
        add(&mut members, "accessors", accessors, &tracks.accessors);
        let view = json!({ "buffer": 0, "byteOffset": start, "byteLength": tracks.bytes.len() });
        add(&mut members, "bufferViews", views, &[view]);
        let name = self.new_name();
        let animation = json!({ "name": name, "channels": tracks.channels, "samplers": tracks.samplers });
        let animations = members.list("animations")?;
        members.set_list("animations", &[vec![raw(&animation)], animations].concat());
        set_length(&mut members, total)?;
        decompose(&mut members, self.document(), driven.chain(self.bound().keys().copied()))?;
        let mut bin = file.bin.to_vec();
        bin.resize(start, 0);
        bin.extend(tracks.bytes);
        container(members.text().into_bytes(), &bin, file.more)
    }

    /// Returns `speech`, with a number if an animation already has that name.
    fn new_name(&self) -> String {
        let taken = |name: &str| self.document().animations.iter().any(|known| known.name.as_deref() == Some(name));
        let numbered = (2..).map(|number| format!("speech {number}"));
        std::iter::once("speech".to_owned()).chain(numbered).find(|name| !taken(name)).unwrap_or_default()
    }
}

/// An animation under construction.
#[derive(Default)]
struct Tracks {
    /// Index of the first new accessor.
    first: usize,
    /// Index of the new buffer view.
    view: usize,
    bytes: Vec<u8>,
    accessors: Vec<serde_json::Value>,
    samplers: Vec<serde_json::Value>,
    channels: Vec<serde_json::Value>,
    /// Accessors of times, by their frames.
    inputs: BTreeMap<Vec<usize>, usize>,
}

impl Tracks {
    /// Returns the accessor of the times of these frames, added once.
    fn input(&mut self, frames: &[usize], frame_rate: f32) -> usize {
        if let Some(&input) = self.inputs.get(frames) {
            return input;
        }
        let times: Vec<f32> = frames.iter().map(|&frame| frame as f32 / frame_rate).collect();
        let input = self.add(&times, 1, json!({ "min": [times.first()], "max": [times.last()] }));
        self.inputs.insert(frames.to_vec(), input);
        input
    }

    /// Adds values of `width` numbers, with `more` members in the accessor; returns the accessor's index.
    fn add(&mut self, values: &[f32], width: usize, more: serde_json::Value) -> usize {
        let kind = ["SCALAR", "", "VEC3", "VEC4"][width - 1];
        let mut accessor = json!({
            "bufferView": self.view, "byteOffset": self.bytes.len(), "componentType": FLOAT,
            "count": values.len() / width, "type": kind,
        });
        if let (Some(accessor), serde_json::Value::Object(more)) = (accessor.as_object_mut(), more) {
            accessor.extend(more);
        }
        self.bytes.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self.accessors.push(accessor);
        self.first + self.accessors.len() - 1
    }

    fn channel(&mut self, input: usize, node: usize, path: &str, values: &[f32], width: usize) {
        let output = self.add(values, width, serde_json::Value::Null);
        self.channels.push(json!({ "sampler": self.samplers.len(), "target": { "node": node, "path": path } }));
        self.samplers.push(json!({ "input": input, "output": output, "interpolation": "LINEAR" }));
    }
}

/// Flips the signs of quaternions so that each is nearest to its predecessor: not every program interpolates
/// along the shorter way.
fn continued(rotations: impl Iterator<Item = Quat>) -> Vec<Quat> {
    let mut before = [0.0, 0.0, 0.0, 1.0];
    let rotations = rotations.map(|q| {
        let dot: f32 = q.iter().zip(before).map(|(a, b)| a * b).sum();
        before = if dot < 0.0 { q.map(|x| -x) } else { q };
        before
    });
    rotations.collect()
}

fn add(members: &mut Members, name: &str, mut elements: Vec<Box<RawValue>>, new: &[serde_json::Value]) {
    elements.extend(new.iter().map(raw));
    members.set_list(name, &elements);
}

/// Sets the first buffer's length to that of the binary chunk.
fn set_length(members: &mut Members, length: usize) -> Result<(), String> {
    let mut buffers = members.list("buffers")?;
    let mut first = match buffers.first() {
        Some(first) => Members::parse(first.get())?,
        None => Members::default(),
    };
    first.set("byteLength", raw(&length.into()));
    let first = first.into_raw();
    match buffers.first_mut() {
        Some(slot) => *slot = first,
        None => buffers.push(first),
    }
    members.set_list("buffers", &buffers);
    Ok(())
}

/// Rewrites the matrices of animated nodes as translation, rotation and scale, which the format requires.
fn decompose(members: &mut Members, document: &Document, driven: impl Iterator<Item = usize>) -> Result<(), String> {
    let matrices: Vec<_> = driven.filter(|&node| document.nodes[node].matrix.is_some()).collect();
    if matrices.is_empty() {
        return Ok(());
    }
    let mut nodes = members.list("nodes")?;
    for at in matrices {
        let (translation, rotation, scale) =
            transform(&document.nodes[at]).map_err(|problem| format!("node {at}: {problem}"))?;
        let mut node = Members::parse(nodes[at].get())?;
        node.remove("matrix");
        node.set("translation", raw(&json!(translation)));
        node.set("rotation", raw(&json!(rotation)));
        node.set("scale", raw(&json!(scale)));
        nodes[at] = node.into_raw();
    }
    members.set_list("nodes", &nodes);
    Ok(())
}
