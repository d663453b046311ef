//! Every golden case (`training/golden/README.md`) through the stage that it names, on every
//! instruction set: floats within [`TOLERANCE`] of what PyTorch computed, codes, units and ids
//! identical.
//!
//! Each test prints a report: stage, output, model, cases, largest relative error.

#[path = "golden_report.rs"]
mod golden_report;

use std::path::{Path, PathBuf};

use golden_report::{Cases, Report};
use serde::Deserialize;
use umo_core::{Compute, LoadError, ModelFile, Part, PerPart, Precision, Sampler, StepError, Team, TextTokenizer};
use umo_core_model::motion::MotionEncoder;
use umo_core_model::weights::Loader;
use umo_core_tools::stage::{self, Inputs, Options, Output, Stage, Values};
use umo_kernels::Isa;
use umo_tests::for_each_isa;

/// Largest difference to the reference, relative to the reference's largest value.
const TOLERANCE: f64 = 2e-4;

/// WebAssembly has only its own thread.
const THREADS: usize = if cfg!(target_family = "wasm") { 1 } else { 2 };

/// The folders of `tests/golden` that hold a model and its cases.
const MODELS: [&str; 7] =
    ["frames_four", "frames_one", "frames_seven", "hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden")
}

fn open(model: &str) -> (ModelFile, Vec<u8>) {
    let folder = folder().join(model);
    let file = ModelFile::open(&folder.join("model.safetensors")).unwrap();
    (file, std::fs::read(folder.join("cases.safetensors")).unwrap())
}

/// The outputs of one case, computed by this project.
fn run(case: &str, bytes: &[u8], loader: &Loader, team: &Team) -> Vec<Output> {
    let prefix = format!("{case}.in.");
    let inputs = Inputs::new(bytes, &prefix).unwrap();
    let name = stage_name(case);
    if name == "vqenc" {
        return encode_motion(bytes, case, loader, team);
    }
    let stage = Stage::from_name(name).unwrap_or_else(|| panic!("{case} names no stage"));
    let target = (stage == Stage::Generate).then(|| inputs.integers("target").unwrap()[0]);
    let target = target.map(|target| usize::try_from(target).unwrap());
    stage::run(stage, loader, team, &inputs, Options { target, sampler: Sampler::GREEDY })
        .unwrap_or_else(|error| panic!("{case}: {error}"))
}

/// The tokenization of motion, which is not a stage of the command line.
fn encode_motion(bytes: &[u8], case: &str, loader: &Loader, team: &Team) -> Vec<Output> {
    let encoder = MotionEncoder::load(loader).unwrap().expect("a model with encoder cases has encoders");
    let cases = Cases::new(bytes);
    let channels = PerPart::from_fn(|part| cases.floats(&format!("{case}.in.channels.{}", part.name())));
    let cx = Compute { isa: loader.isa(), team };
    let (config, channels) = (loader.file().config(), PerPart::from_fn(|part| &*channels[part]));
    let codes = encoder.encode_list(cx, channels).unwrap();
    if !config.is_frames() {
        let paper = encoder.encode(cx, channels).unwrap();
        assert_eq!(codes, Part::ALL.map(|part| paper[part].clone()));
    }
    let parts = config.part_list().into_iter().zip(codes).filter(|(part, _)| !part.is_annotation());
    let output = |(part, codes): (umo_core_model::config::PartSpec, Vec<u16>)| {
        let rows = codes.len() / part.levels;
        let shape = if config.is_frames() { vec![rows, part.levels] } else { vec![rows] };
        let values = Values::Integers(codes.into_iter().map(i64::from).collect());
        Output { name: format!("codes.{}", part.name), shape, values }
    };
    parts.map(output).collect()
}

fn stage_name(case: &str) -> &str {
    case.trim_end_matches(|c: char| c.is_ascii_digit())
}

/// Compares the cases of one model that `wanted` selects, and returns their number.
fn compare(report: &mut Report, model: &str, isa: Isa, precision: Precision, wanted: fn(&str) -> bool) -> usize {
    let (file, bytes) = open(model);
    let cases = Cases::new(&bytes);
    let loader = Loader::new(&file, precision, isa);
    let team = Team::new(THREADS).unwrap();
    let names: Vec<_> = cases.names().into_iter().filter(|case| wanted(stage_name(case))).collect();
    for case in &names {
        let mut outputs = run(case, &bytes, &loader, &team);
        outputs.sort_by(|a, b| a.name.cmp(&b.name));
        let computed: Vec<_> = outputs.iter().map(|output| output.name.clone()).collect();
        assert_eq!(computed, cases.outputs(case), "{model} {case}: every output has its reference");
        for output in &outputs {
            let name = format!("{case}.out.{}", output.name);
            assert_eq!(output.shape, cases.shape(&name), "{model} {name}");
            let error = match &output.values {
                Values::Integers(got) => {
                    assert_eq!(got, &cases.integers(&name), "{model} {name}");
                    None
                }
                Values::Floats(got) => Some(golden_report::error(got, &cases.floats(&name))),
            };
            report.add(stage_name(case), &output.name, model, error);
            assert!(error.is_none_or(|error| error <= TOLERANCE), "{model} {name}: {error:?}");
        }
    }
    names.len()
}

fn every_case_is_the_reference(isa: Isa) {
    let mut report = Report::default();
    for model in MODELS {
        let listed = Cases::new(&open(model).1).listed();
        let ran = compare(&mut report, model, isa, Precision::F32, |_| true);
        assert_eq!(ran, listed, "{model}: cases that ran, of those that its metadata lists");
    }
    for stage in Stage::ALL.map(Stage::name).into_iter().chain(["vqenc"]) {
        assert!(report.has(stage), "no model has a case of {stage}");
    }
    report.print(isa.name());
}

/// Mel features are cheap and determine the language model's input: they stay in full
/// precision.
fn mel_is_the_reference_at_every_precision(isa: Isa) {
    let mut report = Report::default();
    for precision in [Precision::Bf16, Precision::Int8] {
        let ran = MODELS.map(|model| compare(&mut report, model, isa, precision, |stage| stage == "mel"));
        assert!(ran.iter().filter(|&&cases| cases > 0).count() == 5, "five models have mel features");
    }
    report.print(isa.name());
}

for_each_isa!(every_case_is_the_reference, mel_is_the_reference_at_every_precision =>
    every);

#[test]
fn every_golden_model_is_tested() {
    let mut found: Vec<_> = std::fs::read_dir(folder()).unwrap().map(|entry| entry.unwrap().path()).collect();
    found.retain(|path| path.join("cases.safetensors").exists());
    found.sort();
    assert_eq!(found, MODELS.map(|model| folder().join(model)));
}

#[derive(Deserialize)]
struct Texts {
    pieces: usize,
    cases: Vec<Text>,
}

#[derive(Deserialize)]
struct Text {
    text: String,
    ids: Vec<u32>,
}

#[test]
fn text_is_split_as_sentencepiece_splits_it() {
    let texts: Texts =
        serde_json::from_slice(&std::fs::read(folder().join("text").join("cases.json")).unwrap()).unwrap();
    let bytes = std::fs::read(folder().join("text").join("text.model")).unwrap();
    let tokenizer = TextTokenizer::from_bytes(&bytes, texts.pieces).unwrap();
    let mut wrong = 0;
    for Text { text, ids } in &texts.cases {
        let got = tokenizer.split(text);
        if got != *ids {
            eprintln!("{text:?}: expected {ids:?}, got {got:?}");
            wrong += 1;
        }
        match tokenizer.encode(text) {
            Ok(got) => assert_eq!(got, tokenizer.split(text)),
            Err(StepError::TooLong { got, limit, .. }) => assert!(got == ids.len() && got > limit),
            Err(error) => panic!("{text:?}: {error}"),
        }
    }
    println!("golden text: {} texts, {wrong} split otherwise", texts.cases.len());
    assert!(texts.cases.len() > 20 && wrong == 0);
}

#[test]
fn a_model_carries_its_text_tokenizer() {
    let (file, _) = open("mel_k2_arkit");
    let carried = TextTokenizer::load(&file).unwrap().expect("this model has one");
    assert_eq!(carried.encode("a person waves").unwrap(), [9, 101, 4, 79, 36, 145]);
    assert!(TextTokenizer::load(&open("mel_k1_upcycled").0).unwrap().is_none());
    let small = TextTokenizer::from_bytes(&std::fs::read(folder().join("text").join("text.model")).unwrap(), 100);
    let outside = small.unwrap().encode("a person waves");
    assert_eq!(outside, Err(StepError::OutOfRange { what: "token id", got: 101, limit: 100 }));
    let refused = TextTokenizer::from_bytes(b"\xff\xff no model", 100).unwrap_err();
    assert!(matches!(refused, LoadError::Tensor { name, .. } if name == "text.tokenizer"));
}
