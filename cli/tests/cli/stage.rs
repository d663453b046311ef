//! `umo model stage` on the inputs of golden cases.

use std::collections::HashMap;

use safetensors::SafeTensors;
use safetensors::tensor::{Dtype, TensorView};
use umo_core::ModelFile;
use umo_core_model::weights::layout;

use super::program::{Folder, golden, golden_file, umo};

/// Largest difference to the reference, relative to the reference's largest value.
const TOLERANCE: f32 = 2e-4;

/// Tensors of one case, with the case's name removed.
fn of_case<'a>(cases: &SafeTensors<'a>, prefix: &str) -> HashMap<String, TensorView<'a>> {
    let named = cases.tensors().into_iter();
    named.filter_map(|(name, view)| Some((name.strip_prefix(prefix)?.to_owned(), view))).collect()
}

fn floats(view: &TensorView) -> Vec<f32> {
    view.data().as_chunks().0.iter().map(|v| f32::from_le_bytes(*v)).collect()
}

fn compare(name: &str, got: &TensorView, want: &TensorView) {
    assert_eq!((got.dtype(), got.shape()), (want.dtype(), want.shape()), "{name}");
    if want.dtype() == Dtype::I64 {
        assert_eq!(got.data(), want.data(), "{name}");
        return;
    }
    let (got, want) = (floats(got), floats(want));
    let largest = want.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let error = got.iter().zip(&want).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
    assert!(error <= TOLERANCE * largest, "{name}: {error} of {largest}");
}

/// Runs one case and compares all outputs with the reference.
fn check(model: &str, case: &str, more: &[&str]) {
    check_file(&golden(model), model, case, more);
}

/// As `check`, with the model `file` instead of the reference's model.
fn check_file(file: &str, model: &str, case: &str, more: &[&str]) {
    let folder = Folder::new();
    let bytes = std::fs::read(golden_file(model, "cases.safetensors")).unwrap();
    let cases = SafeTensors::deserialize(&bytes).unwrap();
    let inputs = of_case(&cases, &format!("{case}.in."));
    let (input, output) = (folder.at("in.safetensors"), folder.at("out.safetensors"));
    safetensors::serialize_to_file(&inputs, None, input.as_ref()).unwrap();
    let stage = case.trim_end_matches(|c: char| c.is_ascii_digit());
    let target = inputs.get("target").map(|view| i64::from_le_bytes(view.data().try_into().unwrap()).to_string());
    let mut args = vec!["model", "stage", stage, "--in", &input, "--out", &output];
    args.extend(target.iter().flat_map(|target| ["--target", target, "--greedy"]));
    let ended = umo(&[&args[..], &["--model", file], more].concat()).success();
    let bytes = folder.read("out.safetensors");
    let got = of_case(&SafeTensors::deserialize(&bytes).unwrap(), "");
    let want = of_case(&cases, &format!("{case}.out."));
    assert_eq!(got.len(), want.len());
    for (name, want) in &want {
        compare(&format!("{case}.{name}"), &got[name], want);
        assert!(ended.out.contains(&format!("{name} {:?}", want.shape())), "{}", ended.out);
    }
}

#[test]
fn every_stage_gives_what_the_reference_gives() {
    for case in ["hubert1", "encoder1", "decoder1", "generate0", "interp1", "motion1"] {
        check("hubert_k1_smplx", case, &[]);
    }
    check("mel_k2_arkit", "mel1", &[]);
    for (model, cases) in [
        ("frames_four", ["encoder0", "decoder0", "depth0", "generate0", "interp0", "motion0"]),
        ("frames_seven", ["encoder1", "decoder1", "depth1", "generate1", "interp1", "motion1"]),
    ] {
        cases.into_iter().for_each(|case| check(model, case, &[]));
    }
}

/// A rotated model gives the reference's results for the original model, in both layouts: with gains
/// folded, and tables, layers and heads rotated.
#[test]
fn a_rotated_model_gives_what_the_reference_gives() {
    let folder = Folder::new();
    for (model, cases) in [
        ("hubert_k1_smplx", ["decoder0", "decoder1", "generate0"]),
        ("mel_k1_upcycled", ["decoder0", "decoder1", "generate0"]),
        ("frames_four", ["generate0", "generate1", "generate0"]),
        ("frames_seven", ["generate0", "generate1", "generate1"]),
    ] {
        let (was, rotated) = (golden(model), folder.at("rotated.safetensors"));
        umo(&["model", "quantize", &was, "-o", &rotated, "--weights", "bf16", "--set", "*weight=f32", "--rotate"])
            .success();
        cases.into_iter().for_each(|case| check_file(&rotated, model, case, &["--precision", "f32"]));
        let (was, is) = (ModelFile::open(was.as_ref()).unwrap(), ModelFile::open(rotated.as_ref()).unwrap());
        for spec in layout::specs(was.config(), false) {
            let changed = spec.name.starts_with("lm.") && !spec.name.contains("relative_attention_bias")
                || spec.name.starts_with("depth.");
            let values = |file: &ModelFile| {
                let mut values = vec![0.0; spec.len()];
                file.tensor(&spec.name, &spec.shape).unwrap().read(&mut values).unwrap();
                values
            };
            assert_eq!(values(&was) != values(&is), changed, "{}", spec.name);
        }
    }
}

#[test]
fn a_model_whose_head_is_its_table_is_not_rotated() {
    let folder = Folder::new();
    let out = folder.at("out.safetensors");
    let model = golden("mel_k2_arkit");
    let said = folder.refused(&["model", "quantize", &model, "-o", &out, "--weights", "int8", "--rotate"]);
    assert!(said.contains("`tie_word_embeddings`"), "{said}");
}

#[test]
fn stage_takes_precision_and_isa() {
    check("mel_k2_arkit", "encoder1", &["--isa", "scalar", "--threads", "3", "--precision", "f32"]);
    check("mel_k1_upcycled", "mel0", &["--precision", "int8"]);
}

#[test]
fn a_seed_says_which_codes() {
    let folder = Folder::new();
    let ids: Vec<u8> = (5..40_i64).flat_map(i64::to_le_bytes).collect();
    let tensors = [("input_ids", TensorView::new(Dtype::I64, vec![35], &ids).unwrap())];
    let (input, model) = (folder.at("in.safetensors"), golden("mel_k2_arkit"));
    safetensors::serialize_to_file(tensors, None, input.as_ref()).unwrap();
    let run = |more: &[&str]| {
        let out = folder.at("out.safetensors");
        umo(&[&["model", "stage", "generate", "--model", &model, "--in", &input, "--out", &out], more].concat())
            .success();
        folder.read("out.safetensors")
    };
    assert_eq!(run(&[]), run(&["--seed", "0"]));
    assert_ne!(run(&["--seed", "1"]), run(&["--seed", "2"]));
    assert_eq!(run(&["--greedy"]), run(&["--greedy"]));
}
