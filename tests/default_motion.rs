//! The motion of the default model, value for value: a few frames of `assets/hello.wav` beside
//! those that are recorded in `tests/golden/default_motion.json`.
//!
//! Codes are drawn from logits that instruction sets round differently, so each of them has frames
//! of its own. After a change that is meant to change the motion, write the file anew and look at
//! the difference before it is committed:
//!
//! ```sh
//! UMO_RECORD_MOTION=1 cargo test --release -p umo-tests --test default_motion
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use serde::{Deserialize, Serialize};
use umo_core::animation::Animation;
use umo_core::avatar::AvatarConfig;
use umo_core::model::Model;
use umo_core::motion::skeleton::{JOINT_NAMES, joint_places};
use umo_core::{Compute, ModelFile, Precision, Team};
use umo_kernels::Isa;
use umo_tests::for_each_isa;

/// Largest difference: metres of places, and of face channels, which go from 0 to 1.
const TOLERANCE: f32 = 2e-4;
/// Instruction sets that no machine had which recorded this model.
const NOT_RECORDED: [&str; 1] = ["amx"];
/// Frames that are compared, of some 90.
const FRAMES: [usize; 10] = [0, 1, 5, 14, 15, 29, 44, 45, 61, 80];
/// Joints whose places are compared: every chain to its end.
const JOINTS: [&str; 8] =
    ["pelvis", "head", "left_wrist", "right_wrist", "left_index3", "right_thumb3", "left_foot", "right_foot"];
/// Face channels that are compared.
const CHANNELS: [&str; 8] = [
    "jawOpen",
    "mouthClose",
    "mouthSmileLeft",
    "mouthFunnel",
    "mouthPressRight",
    "eyeBlinkLeft",
    "eyeLookInRight",
    "browInnerUp",
];

/// One frame of the recording.
#[derive(Debug, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
struct Recorded {
    frame: usize,
    /// `[joints, 3]`, metres.
    places: Vec<[f32; 3]>,
    /// `[channels]`.
    face: Vec<f32>,
}

/// Frames by instruction set.
type Recording = BTreeMap<String, Vec<Recorded>>;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn recording() -> PathBuf {
    root().join("tests/golden/default_motion.json")
}

/// The samples of a WAV file of 16 bits, one channel and 16 kHz.
fn samples(path: &Path) -> Vec<f32> {
    let mut wav = hound::WavReader::open(path).unwrap();
    assert_eq!((wav.spec().sample_rate, wav.spec().channels, wav.spec().bits_per_sample), (16_000, 1, 16));
    wav.samples::<i16>().map(|sample| f32::from(sample.unwrap()) / 32_768.0).collect()
}

/// What the model makes of `assets/hello.wav` as it is shipped, at its default settings.
fn frames(isa: Isa) -> Vec<Recorded> {
    let file = ModelFile::open(&root().join("models/umo-people/model.safetensors")).unwrap();
    let model = Model::load(&file, Precision::Stored, isa).unwrap();
    let config = model.config();
    let audio = samples(&root().join("assets/hello.wav"));
    assert_eq!(config.audio.sample_rate, 16_000);
    let mut animation = Animation::new(&model, &AvatarConfig::new(config)).unwrap();
    animation.push_audio(&audio).unwrap();
    animation.finish(audio.len() * config.frame_rate / config.audio.sample_rate);
    let team = Team::new(1).unwrap();
    let cx = Compute { isa, team: &team };
    let joints = JOINTS.map(|name| JOINT_NAMES.iter().position(|known| *known == name).unwrap());
    let channels = CHANNELS.map(|name| config.face.names.iter().position(|known| known == name).unwrap());
    let mut frames = Vec::new();
    let mut take = |frame: umo_core::motion::FrameRef| {
        if FRAMES.contains(&frame.index) {
            let places = joint_places(&config.skeleton, frame.pose);
            frames.push(Recorded {
                frame: frame.index,
                places: joints.map(|joint| places[joint]).to_vec(),
                face: channels.map(|channel| frame.face[channel]).to_vec(),
            });
        }
    };
    while animation.step(&model, cx, &mut take).unwrap() {}
    frames
}

/// Instruction sets that are recorded under one name: their products have the same bits.
fn name(isa: Isa) -> &'static str {
    match isa.name() {
        "avxvnni" | "neon" | "neon_dotprod" | "neon_i8mm" => "avx2",
        name => name,
    }
}

fn the_default_model_moves_as_recorded(isa: Isa) {
    let frames = frames(isa);
    assert_eq!(frames.iter().map(|frame| frame.frame).collect::<Vec<_>>(), FRAMES, "every frame once");
    if std::env::var_os("UMO_RECORD_MOTION").is_some() {
        record(name(isa), frames);
        return;
    }
    let recording: Recording = serde_json::from_slice(&std::fs::read(recording()).unwrap()).unwrap();
    let Some(expected) = recording.get(name(isa)) else {
        assert!(NOT_RECORDED.contains(&name(isa)), "{} has no frames in the file", name(isa));
        eprintln!("SKIPPED: nobody with {} has recorded the frames of this model", name(isa));
        return;
    };
    for (found, expected) in frames.iter().zip(expected) {
        assert_eq!((found.frame, found.places.len()), (expected.frame, expected.places.len()));
        let places = JOINTS.iter().zip(found.places.iter().zip(&expected.places));
        for (joint, (found_at, expected_at)) in places {
            let off = (0..3).map(|axis| (found_at[axis] - expected_at[axis]).abs()).fold(0.0, f32::max);
            assert!(off <= TOLERANCE, "frame {}, {joint}: {found_at:?} m, recorded {expected_at:?} m", found.frame);
        }
        for (channel, (value, recorded)) in CHANNELS.iter().zip(found.face.iter().zip(&expected.face)) {
            assert!((value - recorded).abs() <= TOLERANCE, "frame {}, {channel}: {value}, {recorded}", found.frame);
        }
    }
}

/// Replaces the frames of one instruction set in the file.
fn record(name: &str, frames: Vec<Recorded>) {
    static FILE: Mutex<()> = Mutex::new(());
    let _one_at_a_time = FILE.lock().unwrap_or_else(PoisonError::into_inner);
    let mut recording: Recording =
        std::fs::read(recording()).map(|bytes| serde_json::from_slice(&bytes).unwrap()).unwrap_or_default();
    recording.insert(name.to_owned(), frames);
    std::fs::write(self::recording(), serde_json::to_string_pretty(&recording).unwrap() + "\n").unwrap();
}

for_each_isa!(the_default_model_moves_as_recorded => every);
