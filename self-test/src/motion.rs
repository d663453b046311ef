//! Compares the motion that a model makes of a voice with recorded motion, or with that of a second run.
//!
//! Codes are sampled from logits that instruction sets round differently, so frames are recorded per instruction set.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use umo_core::{Animation, AvatarConfig, Compute, FrameRef, JOINT_NAMES, Model, Team};
use umo_core_pose::skeleton::joint_places;
use umo_kernels::Isa;

use crate::voice;

/// Largest accepted difference, in metres for positions and in units for face channels, which go from 0 to 1. Systems
/// round sines differently.
pub const TOLERANCE: f32 = 2e-4;
/// Joints whose positions are compared: the end of every chain.
pub const JOINTS: [&str; 8] =
    ["pelvis", "head", "left_wrist", "right_wrist", "left_index3", "right_thumb3", "left_foot", "right_foot"];
/// Face channels that are compared.
pub const CHANNELS: [&str; 8] = [
    "jawOpen",
    "mouthClose",
    "mouthSmileLeft",
    "mouthFunnel",
    "mouthPressRight",
    "eyeBlinkLeft",
    "eyeLookInRight",
    "browInnerUp",
];
/// Recorded frames, of the voice's 75.
const FRAMES: [usize; 4] = [1, 14, 45, 61];
/// Duration of the voice in seconds.
const SECONDS: f32 = 2.5;
/// Recorded frames of the models that umo ships.
const RECORDS: &str = include_str!("motion.json");

/// One recorded frame.
#[derive(Clone, Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Recorded {
    /// Index of the frame.
    pub frame: usize,
    /// Positions of [`JOINTS`], in metres.
    pub places: Vec<[f32; 3]>,
    /// Values of [`CHANNELS`].
    pub face: Vec<f32>,
}

/// Recorded frames of models, by [`key`] and instruction set.
pub type Records = BTreeMap<String, BTreeMap<String, Vec<Recorded>>>;

/// Reference that a motion matched.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// Number of recorded frames of this model and instruction set, and the largest difference from them.
    AsRecorded(usize, f32),
    /// No frames are recorded: number of frames of two runs with identical bits, all finite.
    Repeated(usize),
}

/// Key of a model in [`Records`].
pub fn key(model: &Model) -> String {
    format!("{} {:016x}", model.config().name, model.fingerprint())
}

/// Returns the recorded frames that are embedded in this library.
pub fn records() -> Records {
    serde_json::from_str(RECORDS).expect("a test reads them")
}

/// Name under which an instruction set is recorded: products have the same bits on all that share it.
pub fn recorded_name(isa: Isa) -> &'static str {
    match isa.name() {
        _ if isa.is_portable() => "scalar",
        "avxvnni" | "neon" | "neon_dotprod" | "neon_i8mm" => "avx2",
        name => name,
    }
}

/// Compares a model's motion with the recorded one or, without a record, with that of a second run.
///
/// # Errors
/// The first difference, or why the model cannot be run.
pub fn check(model: &Model, records: &Records) -> Result<Motion, String> {
    let recorded = records.get(&key(model)).and_then(|of_model| of_model.get(recorded_name(model.isa())));
    let Some(recorded) = recorded else {
        let [first, second] = [bits(model)?, bits(model)?];
        if first != second {
            return Err("two runs gave different frames".to_owned());
        }
        if first.concat().iter().any(|&bits| !f32::from_bits(bits).is_finite()) {
            return Err("a value is not finite".to_owned());
        }
        return Ok(Motion::Repeated(first.len()));
    };
    Ok(Motion::AsRecorded(recorded.len(), difference(&of_voice(model)?, recorded)?))
}

/// Computes the frames that [`records`] holds, on this machine.
///
/// # Errors
/// As [`frames`].
pub fn of_voice(model: &Model) -> Result<Vec<Recorded>, String> {
    frames(model, &voice::samples(model.config().audio.sample_rate, SECONDS), &FRAMES)
}

/// Computes some frames of a model's motion for a recording at the model's rate, with default settings.
///
/// # Errors
/// The model cannot be run, or lacks a channel of [`CHANNELS`].
pub fn frames(model: &Model, audio: &[f32], wanted: &[usize]) -> Result<Vec<Recorded>, String> {
    let config = model.config();
    let find = |names: &[String], wanted: &str| {
        names.iter().position(|name| name == wanted).ok_or_else(|| format!("the model has no channel {wanted}"))
    };
    let channels = CHANNELS.map(|name| find(&config.face.names, name)).into_iter().collect::<Result<Vec<_>, _>>()?;
    let joints = JOINTS.map(|name| JOINT_NAMES.iter().position(|known| *known == name).expect("a joint's name"));
    let mut frames = Vec::new();
    animate(model, audio, &mut |frame| {
        if wanted.contains(&frame.index) {
            let places = joint_places(&config.skeleton, frame.pose);
            frames.push(Recorded {
                frame: frame.index,
                places: joints.map(|joint| places[joint]).to_vec(),
                face: channels.iter().map(|&channel| frame.face[channel]).collect(),
            });
        }
    })?;
    Ok(frames)
}

/// The bits of every frame of the voice.
fn bits(model: &Model) -> Result<Vec<Vec<u32>>, String> {
    let audio = voice::samples(model.config().audio.sample_rate, SECONDS);
    let mut frames = Vec::new();
    animate(model, &audio, &mut |frame| {
        let pose = frame.pose.rotations.iter().flatten().copied();
        let values = pose.chain(frame.pose.translation).chain(frame.face.iter().copied());
        frames.push(values.map(f32::to_bits).collect());
    })?;
    Ok(frames)
}

fn animate(model: &Model, audio: &[f32], take: &mut dyn FnMut(FrameRef)) -> Result<(), String> {
    let config = model.config();
    let mut animation = Animation::new(model, &AvatarConfig::new(config)).map_err(|error| error.to_string())?;
    animation.push_audio(audio).map_err(|error| error.to_string())?;
    animation.finish(audio.len() * config.frame_rate / config.audio.sample_rate);
    let team = Team::new(1).map_err(|error| error.to_string())?;
    let cx = Compute { isa: model.isa(), team: &team };
    while animation.step(model, cx, &mut *take).map_err(|error| error.to_string())? {}
    Ok(())
}

/// Largest difference between frames and recorded ones.
///
/// # Errors
/// The first difference above [`TOLERANCE`], or missing frames.
pub fn difference(found: &[Recorded], recorded: &[Recorded]) -> Result<f32, String> {
    let number = |frame: &Recorded| frame.frame;
    if !found.iter().map(number).eq(recorded.iter().map(number)) {
        let found: Vec<_> = found.iter().map(number).collect();
        return Err(format!("frames {found:?} came, not those that are recorded"));
    }
    let mut largest = 0.0_f32;
    for (found, recorded) in found.iter().zip(recorded) {
        for (joint, (at, recorded_at)) in JOINTS.iter().zip(found.places.iter().zip(&recorded.places)) {
            let off = (0..3).map(|axis| (at[axis] - recorded_at[axis]).abs()).fold(0.0, larger);
            if off > TOLERANCE || off.is_nan() {
                return Err(format!("frame {}, {joint}: {at:?} m, recorded {recorded_at:?} m", found.frame));
            }
            largest = larger(largest, off);
        }
        for (channel, (value, recorded_value)) in CHANNELS.iter().zip(found.face.iter().zip(&recorded.face)) {
            let off = (value - recorded_value).abs();
            if off > TOLERANCE || off.is_nan() {
                return Err(format!("frame {}, {channel}: {value}, recorded {recorded_value}", found.frame));
            }
            largest = larger(largest, off);
        }
    }
    Ok(largest)
}

/// The larger value; NaN if either is.
fn larger(a: f32, b: f32) -> f32 {
    if b > a || b.is_nan() { b } else { a }
}
