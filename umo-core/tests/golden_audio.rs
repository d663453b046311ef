//! The plain audio tokenizers against Hugging Face's `HubertModel` and torch's Fourier transform.

use std::path::PathBuf;

use safetensors::SafeTensors;
use umo_core::audio::Tokenizer;
use umo_core::weights::Loader;
use umo_core::{Compute, ModelFile, Precision, StepError, Team};
use umo_kernels::Isa;

/// Largest error of a feature, relative to the largest feature.
const TOLERANCE: f32 = 2e-4;

fn golden(name: &str, file: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(name).join(file)
}

fn floats(cases: &SafeTensors, name: &str) -> Vec<f32> {
    let tensor = cases.tensor(name).unwrap();
    tensor.data().as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect()
}

fn integers(cases: &SafeTensors, name: &str) -> Vec<i64> {
    let tensor = cases.tensor(name).unwrap();
    tensor.data().as_chunks().0.iter().map(|v| i64::from_le_bytes(*v)).collect()
}

/// Runs the first `count` cases of one model.
fn compare(model: &str, stage: &str, count: usize) {
    let file = ModelFile::open(&golden(model, "model.safetensors")).unwrap();
    let bytes = std::fs::read(golden(model, "cases.safetensors")).unwrap();
    let cases = SafeTensors::deserialize(&bytes).unwrap();
    let team = Team::new(2).unwrap();
    for precision in [Precision::F32, Precision::Int8] {
        let tokenizer = Tokenizer::load(&Loader::new(&file, precision, Isa::detect())).unwrap();
        for i in 0..count {
            let audio = floats(&cases, &format!("{stage}{i}.in.audio"));
            let wanted = floats(&cases, &format!("{stage}{i}.out.features"));
            let cx = Compute { isa: Isa::detect(), team: &team };
            let (features, units) = tokenizer.features(cx, &audio).unwrap();
            assert_eq!(features.len(), wanted.len(), "{model} {stage}{i}");
            let largest = wanted.iter().fold(0.0_f32, |a, v| a.max(v.abs()));
            let error = features.iter().zip(&wanted).fold(0.0_f32, |a, (x, y)| a.max((x - y).abs())) / largest;
            println!("{model} {stage}{i} {}: largest error {error:.2e}", precision.name());
            assert!(error <= TOLERANCE, "{model} {stage}{i}: error {error}");
            let units: Vec<i64> = units.into_iter().map(i64::from).collect();
            assert_eq!(units, integers(&cases, &format!("{stage}{i}.out.units")), "{model} {stage}{i}");
        }
    }
}

#[test]
fn hubert_with_normalisation_and_an_even_position_kernel() {
    compare("hubert_k1_smplx", "hubert", 3);
}

#[test]
fn hubert_of_int8_weights_with_an_odd_position_kernel() {
    compare("hubert_k3_i8", "hubert", 1);
}

#[test]
fn mel_with_two_orders_of_differences() {
    compare("mel_k2_arkit", "mel", 3);
}

#[test]
fn mel_without_differences() {
    compare("mel_k1_upcycled", "mel", 1);
}

#[test]
fn features_refuse_less_audio_than_one_feature() {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: Isa::SCALAR, team: &team };
    for model in ["hubert_k1_smplx", "mel_k1_upcycled"] {
        let file = ModelFile::open(&golden(model, "model.safetensors")).unwrap();
        let tokenizer = Tokenizer::load(&Loader::new(&file, Precision::F32, Isa::SCALAR)).unwrap();
        assert_eq!(tokenizer.field(), 400);
        assert_eq!(tokenizer.features(cx, &[0.1; 399]), Err(StepError::Empty("audio feature")));
        assert_eq!(tokenizer.features(cx, &[0.1; 400]).unwrap().1.len(), 1);
    }
}
