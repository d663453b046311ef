//! glTF 2.0 files as this program writes them: the joints by their names, one animation with a key for every frame.

use std::collections::HashMap;

use gltf::animation::util::ReadOutputs;
use gltf::{Document, Gltf, Node};
use umo_core::config::{Face, FaceKind, Skeleton};
use umo_core::motion::clip::Clip;
use umo_core::motion::rotation::{IDENTITY, Quat, normalized};
use umo_core::motion::skeleton::{ARKIT_NAMES, JOINT_NAMES, JOINTS};

/// How far a key may be from its frame's time, frames.
const TOLERANCE: f32 = 0.02;

/// The animation in a file's bytes.
pub(crate) fn parse(bytes: &[u8]) -> Result<Clip, String> {
    let Gltf { document, blob } = Gltf::from_slice(bytes).map_err(|error| format!("not a glb file: {error}"))?;
    let blob = blob.ok_or("it has no binary part")?;
    let joints = joints(&document)?;
    let skeleton = skeleton(&document, &joints)?;
    let animation = document.animations().next().ok_or("it has no animation")?;
    let mut tracks = Tracks::default();
    for channel in animation.channels() {
        let reader = channel.reader(|buffer| (buffer.index() == 0).then_some(&*blob));
        let times: Vec<f32> = reader.read_inputs().ok_or("its animation has no times")?.collect();
        tracks.take_times(times)?;
        let node = channel.target().node();
        match (reader.read_outputs().ok_or("its animation has no values")?, joints.get(&node.index())) {
            (ReadOutputs::Rotations(values), Some(&joint)) => {
                tracks.rotations[joint] = values.into_f32().map(normalized).collect();
            }
            (ReadOutputs::Translations(values), Some(0)) => tracks.places = values.collect(),
            (ReadOutputs::MorphTargetWeights(values), None) if tracks.weights.is_empty() => {
                tracks.names = target_names(&node)?;
                tracks.weights = values.into_f32().collect();
            }
            _ => {}
        }
    }
    tracks.clip(skeleton)
}

/// Which of the 55 joints a node is.
fn joints(document: &Document) -> Result<HashMap<usize, usize>, String> {
    let joint = |node: &Node| JOINT_NAMES.iter().position(|&name| Some(name) == node.name());
    let joints: HashMap<usize, usize> =
        document.nodes().filter_map(|node| Some((node.index(), joint(&node)?))).collect();
    match JOINT_NAMES.iter().enumerate().find(|(i, _)| !joints.values().any(|joint| joint == i)) {
        Some((_, name)) => Err(format!("it has no joint `{name}`: expected a file that umo wrote")),
        None if joints.len() > JOINTS => Err("two of its nodes have the name of one joint".to_owned()),
        None => Ok(joints),
    }
}

fn skeleton(document: &Document, joints: &HashMap<usize, usize>) -> Result<Skeleton, String> {
    let mut skeleton = Skeleton { parents: vec![-1; JOINTS], offsets_m: vec![[0.0; 3]; JOINTS] };
    for node in document.nodes() {
        let Some(&joint) = joints.get(&node.index()) else { continue };
        let (offset, rotation, _) = node.transform().decomposed();
        if rotation != IDENTITY {
            return Err(format!("joint `{}` is turned at rest: expected a file that umo wrote", JOINT_NAMES[joint]));
        }
        skeleton.offsets_m[joint] = offset;
        for child in node.children() {
            if let Some(&child) = joints.get(&child.index()) {
                skeleton.parents[child] = i32::try_from(joint).unwrap_or(-1);
            }
        }
    }
    Ok(skeleton)
}

/// Names of a mesh's morph targets.
fn target_names(node: &Node) -> Result<Vec<String>, String> {
    let extras = node.mesh().and_then(|mesh| mesh.extras().clone());
    let extras: serde_json::Value = extras.and_then(|text| serde_json::from_str(text.get()).ok()).unwrap_or_default();
    let names = extras["targetNames"].as_array().map(Vec::as_slice).unwrap_or_default();
    let names = names.iter().map(|name| name.as_str().map(str::to_owned));
    names.collect::<Option<Vec<_>>>().ok_or_else(|| "its morph targets have no names".to_owned())
}

/// What the channels hold.
struct Tracks {
    times: Vec<f32>,
    /// `[JOINTS][frames]`; empty where a joint is at rest.
    rotations: [Vec<Quat>; JOINTS],
    /// Root's places, offset included.
    places: Vec<[f32; 3]>,
    names: Vec<String>,
    /// `[frames, names]`.
    weights: Vec<f32>,
}

impl Default for Tracks {
    fn default() -> Self {
        let rotations = std::array::from_fn(|_| Vec::new());
        Self { times: Vec::new(), rotations, places: Vec::new(), names: Vec::new(), weights: Vec::new() }
    }
}

impl Tracks {
    /// All channels must have the same keys.
    fn take_times(&mut self, times: Vec<f32>) -> Result<(), String> {
        if self.times.is_empty() {
            self.times = times;
        } else if self.times != times {
            return Err("its channels have different keys: expected one for every frame".to_owned());
        }
        Ok(())
    }

    /// Frames a second, from keys that are evenly spaced.
    fn rate(&self) -> Result<f32, String> {
        let (Some(first), Some(last)) = (self.times.first(), self.times.last()) else {
            return Err("its animation has no frames".to_owned());
        };
        if self.times.len() == 1 {
            return Ok(30.0);
        }
        let rate = (self.times.len() - 1) as f32 / (last - first);
        let even = self.times.iter().enumerate().all(|(i, t)| ((t - first) * rate - i as f32).abs() < TOLERANCE);
        match (1.0..=1000.0).contains(&rate) && even {
            true => Ok(if (rate - rate.round()).abs() < 0.01 { rate.round() } else { rate }),
            false => Err("its keys are not one for every frame".to_owned()),
        }
    }

    fn clip(self, skeleton: Skeleton) -> Result<Clip, String> {
        let (frame_rate, frames) = (self.rate()?, self.times.len());
        let wrong = |what: &str| format!("{what} have not one value for every frame");
        if self.rotations.iter().any(|track| !track.is_empty() && track.len() != frames) {
            return Err(wrong("rotations"));
        }
        if !self.places.is_empty() && self.places.len() != frames {
            return Err(wrong("places"));
        }
        if self.weights.len() != frames * self.names.len() {
            return Err(wrong("morph weights"));
        }
        let root = skeleton.offsets_m[0];
        let turn = |frame: usize| std::array::from_fn(|joint| *self.rotations[joint].get(frame).unwrap_or(&IDENTITY));
        let place = |frame: usize| {
            self.places.get(frame).map_or([0.0; 3], |place| std::array::from_fn(|axis| place[axis] - root[axis]))
        };
        let arkit = self.names.iter().any(|name| ARKIT_NAMES.contains(&name.as_str()));
        let kind = if arkit { FaceKind::Arkit } else { FaceKind::SmplxExpression };
        Ok(Clip {
            frame_rate,
            rotations: (0..frames).map(turn).collect(),
            translation: (0..frames).map(place).collect(),
            skeleton,
            face: Face { kind, names: self.names },
            face_values: self.weights,
        })
    }
}
