//! Regression test of the default model's motion: some frames of `assets/hello.wav`, value for
//! value, against `tests/golden/default_motion.json`; and the frames in an installed library's self-test.
//!
//! Codes are sampled from logits that instruction sets round differently, so each instruction set
//! has its own frames. After a change that is meant to change the motion, write the file anew and
//! look at the difference before it is committed:
//!
//! ```sh
//! UMO_RECORD_MOTION=1 cargo test --release -p umo-tests --test default_motion
//! ```

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use umo_core::{Model, ModelFile, Precision};
use umo_kernels::Isa;
use umo_self_test::motion::{self, Motion, Recorded, Records, difference, recorded_name};
use umo_tests::for_each_isa;

/// Instruction sets without a recording of this model.
const NOT_RECORDED: [&str; 1] = ["amx"];
/// Frames that are compared, of about 90.
const FRAMES: [usize; 10] = [0, 1, 5, 14, 15, 29, 44, 45, 61, 80];
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

fn model(isa: Isa) -> Model {
    let file = ModelFile::open(&root().join("models/umo-people/model.safetensors")).unwrap();
    Model::load(&file, Precision::Stored, isa).unwrap()
}

/// Compares the motion of the shipped model on `assets/hello.wav` at its default settings.
fn the_default_model_moves_as_recorded(isa: Isa) {
    let model = model(isa);
    assert_eq!(model.config().audio.sample_rate, 16_000);
    let frames = motion::frames(&model, &samples(&root().join("assets/hello.wav")), &FRAMES).unwrap();
    assert_eq!(frames.iter().map(|frame| frame.frame).collect::<Vec<_>>(), FRAMES, "every frame once");
    let name = recorded_name(isa);
    if std::env::var_os("UMO_RECORD_MOTION").is_some() {
        record(name, frames);
        return;
    }
    let recording: Recording = serde_json::from_slice(&std::fs::read(recording()).unwrap()).unwrap();
    let Some(expected) = recording.get(name) else {
        assert!(NOT_RECORDED.contains(&name), "{name} has no frames in the file");
        eprintln!("SKIPPED: nobody with {name} has recorded the frames of this model");
        return;
    };
    assert_eq!(difference(&frames, expected).map(drop), Ok(()));
}

/// The self-test of an installed library has a file with frames of the default model.
fn the_self_test_knows_the_default_model(isa: Isa) {
    let name = recorded_name(isa);
    let model = model(isa);
    if std::env::var_os("UMO_RECORD_MOTION").is_some() {
        record_for_self_test(&model, motion::of_voice(&model).unwrap());
        return;
    }
    let mut records = motion::records();
    match motion::check(&model, &records).unwrap() {
        Motion::AsRecorded(count, _) => assert_eq!(count, 4),
        Motion::Repeated(_) => assert!(NOT_RECORDED.contains(&name), "no frames for {name}"),
    }
    // A frame that differs from the recorded one is found and named. Once is enough: each check computes all frames.
    if isa != Isa::detect() {
        return;
    }
    let Some(frames) = records.get_mut(&motion::key(&model)).and_then(|of_model| of_model.get_mut(name)) else {
        return;
    };
    frames[2].places[1][0] += 0.001;
    let error = motion::check(&model, &records).unwrap_err();
    assert!(error.starts_with("frame 45, head: "), "{error}");
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

/// Replaces the frames of one model and instruction set in the self-test's file, one line for each.
fn record_for_self_test(model: &Model, mut frames: Vec<Recorded>) {
    static FILE: Mutex<()> = Mutex::new(());
    let _one_at_a_time = FILE.lock().unwrap_or_else(PoisonError::into_inner);
    let path = root().join("self-test/src/motion.json");
    let mut records: Records = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let of_other_weights =
        |key: &String| key.starts_with(&format!("{} ", model.config().name)) && *key != motion::key(model);
    records.retain(|key, _| !of_other_weights(key));
    for value in frames.iter_mut().flat_map(|frame| frame.places.as_flattened_mut().iter_mut().chain(&mut frame.face)) {
        *value = (*value * 1e5).round() / 1e5;
    }
    records.entry(motion::key(model)).or_default().insert(recorded_name(model.isa()).to_owned(), frames);
    let list = |rows: Vec<String>| rows.join(",\n");
    let of_isa = |isa: &str, frames: &[Recorded]| format!("    \"{isa}\": {}", serde_json::to_string(frames).unwrap());
    let of_model = |(key, of_model): (&String, &BTreeMap<String, Vec<Recorded>>)| {
        let rows = of_model.iter().map(|(isa, frames)| of_isa(isa, frames)).collect();
        format!("  \"{key}\": {{\n{}\n  }}", list(rows))
    };
    let text = list(records.iter().map(of_model).collect());
    std::fs::write(path, format!("{{\n{text}\n}}\n")).unwrap();
}

for_each_isa!(the_default_model_moves_as_recorded, the_self_test_knows_the_default_model => every);
