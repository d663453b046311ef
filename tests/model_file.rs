//! Truncated, invalid and hostile model files: each is refused with an error that names the
//! fault, and nothing panics or allocates for sizes that the file only claims.

mod model_bytes;

use std::collections::BTreeMap;

use model_bytes::{ModelBytes, Stored, file};
use proptest::prelude::*;
use serde_json::{Value, json};
use umo_core::{
    Animation, AvatarConfig, Compute, Config, LoadError, Model, ModelFile, Part, Precision, StepError, Team,
};
use umo_core_model::lm::text::TOKENIZER;
use umo_core_model::motion::MotionEncoder;
use umo_core_model::weights::Loader;
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};
use umo_kernels::Isa;
use umo_tests::{Noise, cases};

/// One model of each kind of tokenizer, storage and face; the last has encoders and text conditioning.
const NAMES: [&str; 5] = ["mel_k1_upcycled", "hubert_k1_smplx", "hubert_k3_i8", "mel_k2_arkit", "frames_seven"];

/// Three of them that together have every kind of tensor, for tests that load a model per tensor.
const MODELS: [&str; 3] = ["hubert_k3_i8", "mel_k2_arkit", "frames_seven"];

/// Reads everything that any command reads.
fn load(bytes: Vec<u8>) -> Result<Model, LoadError> {
    let file = ModelFile::from_bytes(bytes)?;
    let model = Model::load(&file, Precision::F32, Isa::detect())?;
    MotionEncoder::load(&Loader::new(&file, Precision::F32, Isa::detect()))?;
    Ok(model)
}

/// Text of the error, which must contain `wanted`.
fn refused(bytes: Vec<u8>, wanted: &str) -> String {
    let text = match load(bytes) {
        Ok(_) => panic!("a model that is wrong in `{wanted}` was taken"),
        Err(error) => error.to_string(),
    };
    assert!(text.contains(wanted), "`{wanted}` is not named: {text}");
    assert!(!text.contains('\n') && text.len() < 1000, "one line: {text}");
    text
}

#[test]
fn test_models_load_before_they_are_damaged() {
    for name in NAMES {
        let model = ModelBytes::open(name);
        load(model.bytes()).unwrap_or_else(|error| panic!("{name}: {error}"));
    }
}

#[test]
fn a_file_cut_anywhere_is_refused() {
    let model = ModelBytes::open("mel_k1_upcycled");
    let bytes = model.bytes();
    let header = bytes.len() - model.data().len();
    let cuts = (0..header + 64).chain((header..bytes.len()).step_by(4999)).chain([bytes.len() - 1]);
    for cut in cuts {
        let error = ModelFile::from_bytes(bytes[..cut].to_vec()).unwrap_err().to_string();
        assert!(!error.is_empty() && !error.contains('\n'), "cut at {cut}: {error}");
        assert!(cut < header || error.contains("tensor `"), "cut at {cut}: {error}");
    }
    let longer = [&bytes[..], b"x"].concat();
    assert!(ModelFile::from_bytes(longer).is_err());
}

/// One name of each kind: of names that differ only in numbers, such as layers and experts, the
/// last. A loop reads all of them.
fn kinds<'a>(names: impl IntoIterator<Item = &'a String>) -> Vec<&'a String> {
    let kind = |name: &str| name.replace(|c: char| c.is_ascii_digit(), "");
    names.into_iter().map(|name| (kind(name), name)).collect::<BTreeMap<_, _>>().into_values().collect()
}

/// Tensors of a model, one of each kind.
fn tensor_kinds(model: &ModelBytes) -> impl Iterator<Item = (&String, &Stored)> {
    kinds(model.tensors.keys()).into_iter().map(|name| (name, &model.tensors[name]))
}

/// Whether a model may lack the tensor.
fn optional(name: &str) -> bool {
    name == TOKENIZER
}

#[test]
fn every_tensor_must_be_there() {
    for name in MODELS {
        let model = ModelBytes::open(name);
        for (tensor, _) in tensor_kinds(&model).filter(|(tensor, _)| !optional(tensor)) {
            let mut spoilt = model.clone();
            spoilt.tensors.remove(tensor);
            match load(spoilt.bytes()) {
                Err(error) => assert!(error.to_string().contains(&format!("`{tensor}`")), "{tensor}: {error}"),
                Ok(_) => panic!("{name} was taken without {tensor}"),
            }
        }
    }
}

#[test]
fn every_shape_must_be_the_configs() {
    for name in MODELS {
        let model = ModelBytes::open(name);
        for (place, (tensor, stored)) in tensor_kinds(&model).filter(|(tensor, _)| !optional(tensor)).enumerate() {
            let row = stored.bytes.len() / stored.shape[0];
            let mut longer = stored.clone();
            longer.bytes.extend(stored.bytes[..row].to_vec());
            longer.shape[0] += 1;
            let mut deeper = stored.clone();
            deeper.shape.push(1);
            let mut flat = stored.clone();
            flat.shape = vec![stored.shape.iter().product()];
            let mut empty = stored.clone();
            (empty.shape[0], empty.bytes) = (0, Vec::new());
            let wrong = [longer, deeper, flat, empty].into_iter().filter(|changed| changed.shape != stored.shape);
            let mut spoilt = model.clone();
            spoilt.tensors.insert(tensor.clone(), wrong.cycle().nth(place).unwrap());
            refused(spoilt.bytes(), &format!("`{tensor}`"));
        }
    }
}

#[test]
fn every_type_must_be_one_of_weights() {
    for name in MODELS {
        let model = ModelBytes::open(name);
        for (place, (tensor, stored)) in tensor_kinds(&model).enumerate() {
            let count: usize = stored.shape.iter().product();
            let floats = if tensor == TOKENIZER { vec![("F32", 4), ("I8", 1)] } else { Vec::new() };
            let of_any = [("I64", 8), ("F64", 8), ("BOOL", 1)][place % 3];
            for (dtype, size) in floats.into_iter().chain([of_any]) {
                let mut spoilt = model.clone();
                let changed = spoilt.tensors.get_mut(tensor).unwrap();
                (changed.dtype, changed.bytes) = (dtype.to_owned(), vec![0; count * size]);
                refused(spoilt.bytes(), &format!("`{tensor}`"));
            }
        }
    }
}

/// Bytes of a non-finite value, if the type has one.
fn not_finite(dtype: &str, negative: bool) -> Option<(Vec<u8>, Vec<u8>)> {
    let sign = if negative { f32::NEG_INFINITY } else { f32::INFINITY };
    let of = |value: f32| match dtype {
        "F32" => Some(value.to_le_bytes().to_vec()),
        // The upper half of an f32; an f16 has fewer bits of exponent.
        "BF16" => Some(value.to_le_bytes()[2..].to_vec()),
        "F16" if value.is_nan() => Some(vec![0x01, 0x7e]),
        "F16" => Some(vec![0x00, if value > 0.0 { 0x7c } else { 0xfc }]),
        _ => None,
    };
    of(f32::NAN).zip(of(sign))
}

#[test]
fn every_weight_must_be_finite() {
    let mut noise = Noise::new(11);
    for name in NAMES {
        let model = ModelBytes::open(name);
        let mut count = 0;
        for (tensor, stored) in tensor_kinds(&model) {
            let Some((nan, infinite)) = not_finite(&stored.dtype, noise.below(2) == 0) else { continue };
            let values = stored.bytes.len() / nan.len();
            let (bad, at) = if count % 2 == 0 { (nan, noise.below(values)) } else { (infinite, values - 1) };
            let mut spoilt = model.clone();
            let changed = spoilt.tensors.get_mut(tensor).unwrap();
            changed.bytes[at * bad.len()..(at + 1) * bad.len()].copy_from_slice(&bad);
            let text = refused(spoilt.bytes(), &format!("`{tensor}`"));
            assert!(text.contains("not a finite number"), "{text}");
            count += 1;
        }
        assert!(count > 40, "{name}: {count} tensors of floats");
    }
}

/// Flips bits of the default model, anywhere in its tensors or config: each file is refused as
/// damaged.
#[test]
fn a_flipped_bit_anywhere_is_seen() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/umo-people/model.safetensors");
    let mut bytes = std::fs::read(path).unwrap();
    assert!(ModelFile::from_bytes(bytes.clone()).unwrap().verify().unwrap(), "the default model has a checksum");
    let header = 8 + usize::try_from(u64::from_le_bytes(*bytes.first_chunk().unwrap())).unwrap();
    let config = bytes.windows(10).position(|window| window == b"\"config\":\"").unwrap() + 10;
    let mut noise = Noise::new(21);
    for case in 0..60 {
        // Flipping the last bit of a config's digit gives another digit: valid JSON of another
        // model.
        let digit = |at: &usize| bytes[*at].is_ascii_digit() && bytes[*at] < b'8';
        let (at, bit) = match case % 6 {
            0 => ((config + noise.below(4_000)..).find(digit).unwrap(), 0),
            _ => (header + noise.below(bytes.len() - header), noise.below(8)),
        };
        bytes[at] ^= 1 << bit;
        let error = ModelFile::from_bytes(bytes.clone()).expect_err("a damaged file was read").to_string();
        assert!(at < header || error.contains("it is damaged: its checksum is crc32:"), "byte {at}: {error}");
        bytes[at] ^= 1 << bit;
    }
    // The header has a checksum of its own.
    let sum = bytes.windows(6).position(|window| window == b"crc32:").unwrap();
    bytes[sum + 6] = b'x';
    let error = ModelFile::from_bytes(bytes).expect_err("an invalid checksum was accepted").to_string();
    assert!(error.contains("its header's checksum is crc32:"), "{error}");
}

/// A file with a header checksum, as this project writes it: each byte of the header is changed, whether the JSON
/// stays valid or not, and its length.
#[test]
fn a_changed_header_is_seen() {
    let golden = ModelBytes::open("mel_k1_upcycled");
    let config = ModelFile::from_bytes(golden.bytes()).unwrap().config().clone();
    let tensors: Vec<_> = golden.tensors.iter().map(|(name, stored)| as_bytes(name, stored)).collect();
    let mut out = std::io::Cursor::new(Vec::new());
    writer::write(&mut out, &config, &tensors).unwrap();
    let mut bytes = out.into_inner();
    assert!(ModelFile::from_bytes(bytes.clone()).unwrap().verify().unwrap());
    let end = 8 + usize::try_from(u64::from_le_bytes(*bytes.first_chunk().unwrap())).unwrap();
    let key = b"\"header_checksum\":\"crc32:";
    let place = bytes.windows(key.len()).position(|window| window == key).unwrap();
    for at in (0..end).step_by(7).chain(place..place + key.len() + 8) {
        bytes[at] ^= 1;
        // Without its name the checksum is ignored, and nothing else is damaged.
        let is_name = (place..place + key.len()).contains(&at);
        match ModelFile::from_bytes(bytes.clone()).map_err(|error| error.to_string()) {
            Err(error) if at < 8 || is_name => assert!(!error.is_empty()),
            Err(error) => assert!(error.contains("it is damaged: its header's checksum is"), "byte {at}: {error}"),
            Ok(_) => assert!(is_name, "byte {at}: a damaged header was read"),
        }
        bytes[at] ^= 1;
    }
    // With a space before its value it is not found.
    bytes[place..place + key.len()].copy_from_slice(b"\"header_checksum\": \"crc32");
    let error = ModelFile::from_bytes(bytes).expect_err("an invalid checksum was accepted").to_string();
    assert!(error.contains("`header_checksum`") && error.contains("eight hexadecimal digits"), "{error}");
}

/// A stored tensor as one to be written.
fn as_bytes<'a>(name: &str, stored: &'a Stored) -> NewTensor<'a> {
    let (shape, values) = (vec![stored.bytes.len()], Values::Bytes(&stored.bytes));
    NewTensor { name: name.to_owned(), shape, storage: Storage::Bytes, values }
}

#[test]
fn a_file_without_a_checksum_reads_and_says_that_it_has_none() {
    assert!(!ModelFile::from_bytes(ModelBytes::open("mel_k2_arkit").bytes()).unwrap().verify().unwrap());
}

/// The largest finite value of a type, or nearly.
fn huge(dtype: &str) -> Option<Vec<u8>> {
    match dtype {
        "F32" => Some(3e38_f32.to_le_bytes().to_vec()),
        "BF16" => Some(vec![0x60, 0x7f]),
        "F16" => Some(vec![0xff, 0x7b]),
        _ => None,
    }
}

/// Animates a second; the frames must be finite, and an error must say that the weights are
/// defective.
fn animate(model: &Model) -> Result<(), StepError> {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let config = AvatarConfig { target: 2, ..AvatarConfig::new(model.config()) };
    let mut animation = Animation::new(model, &config).unwrap();
    let mut noise = Noise::new(1);
    let samples: Vec<f32> = (0..model.config().audio.sample_rate).map(|_| noise.float(0.3)).collect();
    animation.push_audio(&samples).unwrap();
    animation.finish(30);
    let mut sound = |frame: umo_core::FrameRef| {
        let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(frame.face);
        assert!(values.into_iter().all(|v| v.is_finite() && v.abs() < 1e4), "a frame that no body has was played");
    };
    while animation.step(model, cx, &mut sound)? {}
    Ok(())
}

#[test]
fn a_huge_weight_is_refused_or_named_by_its_stage() {
    let mut noise = Noise::new(12);
    for precision in [Precision::Stored, Precision::F32] {
        let (mut refused, mut failed, mut played) = (0, 0, 0);
        for name in MODELS {
            let model = ModelBytes::open(name);
            for (tensor, stored) in tensor_kinds(&model) {
                let Some(huge) = huge(&stored.dtype) else { continue };
                let values = stored.bytes.len() / huge.len();
                let mut spoilt = model.clone();
                let changed = spoilt.tensors.get_mut(tensor).unwrap();
                let at = noise.below(values);
                changed.bytes[at * huge.len()..(at + 1) * huge.len()].copy_from_slice(&huge);
                let file = ModelFile::from_bytes(spoilt.bytes()).unwrap();
                match Model::load(&file, precision, Isa::detect()) {
                    Err(error) => {
                        let text = error.to_string();
                        assert!(text.contains("finite") && text.contains(&format!("`{tensor}`")), "{tensor}: {text}");
                        refused += 1;
                    }
                    Ok(model) => match animate(&model) {
                        Ok(()) => played += 1,
                        Err(error @ (StepError::NotFinite(_) | StepError::Implausible(_))) => {
                            assert!(error.to_string().contains("the model's weights are defective"));
                            failed += 1;
                        }
                        Err(error) => panic!("{tensor}: {error}"),
                    },
                }
            }
        }
        // A norm cancels a huge value, and an expert may never be chosen.
        println!("{precision:?}: {refused} refused, {failed} failed with their stage, {played} played");
        assert!(refused > 20 && failed > 20 && played > 20);
    }
}

/// Paths of the leaves that `wanted` selects: `lm.d_model`, `templates.audio_to_motion[0]`.
fn leaves(value: &Value, path: &str, wanted: fn(&Value) -> bool, found: &mut Vec<String>) {
    match value {
        Value::Object(fields) => {
            for (key, value) in fields {
                let dot = if path.is_empty() { "" } else { "." };
                leaves(value, &format!("{path}{dot}{key}"), wanted, found);
            }
        }
        Value::Array(items) => {
            for (i, item) in items.iter().enumerate() {
                leaves(item, &format!("{path}[{i}]"), wanted, found);
            }
        }
        leaf if wanted(leaf) => found.push(path.to_owned()),
        _ => {}
    }
}

fn set(config: &Value, path: &str, value: Value) -> Value {
    let pointer = format!("/{}", path.replace(['.', '['], "/").replace(']', ""));
    let mut config = config.clone();
    *config.pointer_mut(&pointer).expect("a path that was found") = value;
    config
}

/// The bytes of the model with another config.
fn with_config(model: &ModelBytes, header: &serde_json::Map<String, Value>, data: &[u8], config: &Value) -> Vec<u8> {
    let mut header = header.clone();
    let mut metadata = json!(model.metadata);
    metadata["config"] = json!(config.to_string());
    header.insert("__metadata__".to_owned(), metadata);
    file(&Value::Object(header).to_string(), data)
}

/// The key that an error names, without a list index.
fn named(error: &LoadError) -> Option<&str> {
    match error {
        LoadError::Config { key, .. } => Some(key.split('[').next().unwrap_or(key)),
        LoadError::Tensor { name, .. } => Some(name),
        _ => None,
    }
}

/// Whether the error is of the config and names this path or a parent of it.
fn names(error: &LoadError, path: &str) -> bool {
    matches!(error, LoadError::Config { .. }) && named(error).is_some_and(|key| path.starts_with(key))
}

#[test]
fn every_number_of_the_config_is_checked() {
    for name in MODELS {
        let model = ModelBytes::open(name);
        let (header, data) = (model.header(), model.data());
        let mut paths = Vec::new();
        leaves(&model.config, "", Value::is_number, &mut paths);
        // One bone stands for all 55.
        paths.retain(|path| !path.starts_with("skeleton.") || path.contains("[7]"));
        let paths = kinds(&paths);
        assert!(paths.len() > 60, "{name}: {} numbers", paths.len());
        for path in paths {
            let load = |value: Value| load(with_config(&model, &header, &data, &set(&model.config, path, value)));
            for wrong in [json!("x"), json!(null), json!([1]), json!({}), json!(true), json!(1e300), json!(-1.5e300)] {
                let error = load(wrong.clone()).err().unwrap_or_else(|| panic!("{name}: {path} = {wrong} was taken"));
                assert!(names(&error, path), "{name}: {path} = {wrong}: {error}");
            }
            let number = path.starts_with("skeleton.") || path == "sampling.temperature";
            for wrong in [json!(-1), json!(1_u64 << 60), json!(u64::MAX)] {
                match load(wrong.clone()) {
                    Err(error) => assert!(names(&error, path), "{name}: {path} = {wrong}: {error}"),
                    // A bone may point down; a `top_k` above the number of codes keeps all.
                    Ok(_) => assert!(number || path == "sampling.top_k", "{name}: {path} = {wrong} was taken"),
                }
            }
            for other in [0_u64, 1, 255, 65_535, 1 << 20, 1 << 32] {
                match load(json!(other)) {
                    // The error may name the size that disagrees with it, or a tensor of that shape.
                    Err(error) => assert!(named(&error).is_some(), "{name}: {path} = {other}: {error}"),
                    Ok(model) => {
                        drop(Animation::new(&model, &AvatarConfig::new(model.config())).unwrap());
                    }
                }
            }
        }
    }
}

#[test]
fn a_fourier_transform_of_odd_length_is_refused() {
    let model = ModelBytes::open("mel_k2_arkit");
    let (header, data) = (model.header(), model.data());
    for path in ["audio.mel.fft", "mouth.fft"] {
        let error = load(with_config(&model, &header, &data, &set(&model.config, path, json!(513)))).unwrap_err();
        assert!(names(&error, path), "{error}");
        assert!(error.to_string().contains("expected an even number, got 513"), "{error}");
    }
}

#[test]
fn every_key_of_the_config_is_needed_and_known() {
    let model = ModelBytes::open("mel_k2_arkit");
    let (header, data) = (model.header(), model.data());
    let load = |config: &Value| load(with_config(&model, &header, &data, config));
    let objects = [
        "",
        "/audio",
        "/audio/mel",
        "/audio/mel/network",
        "/vocab",
        "/vocab/face",
        "/lm",
        "/interp",
        "/vq",
        "/vq/root",
        "/face",
        "/mouth",
        "/rest",
        "/sampling",
        "/skeleton",
    ];
    for pointer in objects {
        let keys: Vec<String> = model.config.pointer(pointer).unwrap().as_object().unwrap().keys().cloned().collect();
        // Units may come from mel features, and a live mouth is optional.
        for key in keys.into_iter().filter(|key| !["network", "mouth"].contains(&key.as_str())) {
            let mut config = model.config.clone();
            config.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(&key);
            let error = load(&config).err().unwrap_or_else(|| panic!("{pointer}/{key} is not needed")).to_string();
            assert!(error.contains(&key), "{pointer}/{key}: {error}");
        }
        let mut config = model.config.clone();
        config.pointer_mut(pointer).unwrap()["speling"] = json!(1);
        let error = load(&config).err().unwrap_or_else(|| panic!("{pointer}: any key is taken")).to_string();
        assert!(error.contains("speling"), "{error}");
    }
}

#[test]
fn parts_of_layout_frames_are_checked() {
    let model = ModelBytes::open("frames_seven");
    let (header, data) = (model.header(), model.data());
    let refused = |path: &str, value: Value, key: &str| {
        let config = set(&model.config, path, value);
        let error = load(with_config(&model, &header, &data, &config)).err().unwrap_or_else(|| panic!("{path}"));
        let text = error.to_string();
        assert!(text.contains(&format!("config `{key}")), "{path}: {text}");
        text
    };
    let without = |pointer: &str, name: &str, key: &str| {
        let mut config = model.config.clone();
        config.pointer_mut(pointer).unwrap().as_object_mut().unwrap().remove(name);
        let error = load(with_config(&model, &header, &data, &config)).err().unwrap_or_else(|| panic!("{name}"));
        assert!(error.to_string().contains(&format!("config `{key}")), "{name}: {error}");
    };
    let with = |pointer: &str, name: &str, value: Value, key: &str| {
        let mut config = model.config.clone();
        config.pointer_mut(pointer).unwrap().as_object_mut().unwrap().insert(name.to_owned(), value);
        let error = load(with_config(&model, &header, &data, &config)).err().unwrap_or_else(|| panic!("{name}"));
        assert!(error.to_string().contains(&format!("config `{key}")), "{name}: {error}");
    };
    refused("layout", json!("parts"), "depth");
    refused("layout", json!("rows"), "layout");
    refused("parts", json!([]), "parts");
    for name in ["", "Torso", "root", "a-b", "arms"] {
        refused("parts[1].name", json!(name), "parts[");
    }
    for (key, value) in [
        ("codes", json!(257)),
        ("codes", json!(0)),
        ("levels", json!(17)),
        ("levels", json!(0)),
        ("rest", json!([0])),
        ("rest", json!([0, 0, 11])),
        ("width", json!(0)),
        ("layers", json!(0)),
    ] {
        refused(&format!("parts[1].{key}"), value, &format!("parts[1].{key}"));
    }
    assert!(refused("parts[1].channels[0]", json!("tail"), "parts[1].channels").contains("\"tail\""));
    assert!(refused("parts[1].channels[0]", json!("jaw"), "parts[1].channels").contains("several"));
    assert!(refused("parts[1].channels[0]", json!("neck"), "parts[1].channels").contains("second time"));
    assert!(refused("parts[5].channels", json!(["left_index1"]), "parts").contains("no part has the channel"));
    refused("audio.ahead", json!(8), "audio.ahead");
    refused("depth.num_heads", json!(4), "depth.num_heads");
    refused("templates.audio_to_motion[5]", json!("face"), "templates.audio_to_motion[5]");
    without("", "depth", "depth");
    without("/parts/1", "rest", "parts[1]");
    with("/vocab", "face", model.config["vocab"]["audio"].clone(), "vocab.face");
    with("/vq", "face", json!({ "channels": 58, "layers": 1 }), "vq.face");
    with("/vq", "codes", json!(256), "vq.codes");
    with("", "rest", json!({ "face": 0, "hands": 0, "upper": 0, "lower": 0 }), "rest");
    with("/parts/0", "width", json!(3), "parts[0].width");
    with("/parts/1", "sampling", json!({ "temperature": -1, "top_k": 0, "top_p": 1 }), "parts[1].sampling.temperature");
    with("/depth", "body_heard", json!(1), "depth.body_heard");
    // Ten tokens per keyframe, and the horizon's tokens of two keyframes.
    let hearing = ModelBytes::open("frames_four");
    for (token, is_within) in [(29, true), (30, false)] {
        let mut config = hearing.config.clone();
        config["depth"]["body_heard"] = json!(token);
        let loaded = load(with_config(&hearing, &hearing.header(), &hearing.data(), &config));
        let error = loaded.err().map(|error| error.to_string()).unwrap_or_default();
        assert_eq!(error.is_empty(), is_within, "{token}: {error}");
        assert!(is_within || error.contains("config `depth.body_heard`: expected 0 to 29, got 30"), "{error}");
    }
    // Models of the paper's layout lack these keys.
    let paper = ModelBytes::open("mel_k2_arkit");
    let (header, data) = (paper.header(), paper.data());
    for (pointer, name, value) in [("", "depth", model.config["depth"].clone()), ("/audio", "ahead", json!(1))] {
        let mut config = paper.config.clone();
        config.pointer_mut(pointer).unwrap().as_object_mut().unwrap().insert(name.to_owned(), value);
        let error = load(with_config(&paper, &header, &data, &config)).expect_err(name).to_string();
        assert!(error.contains(name), "{error}");
    }
}

/// A golden model of the paper's layout with its four parts as a list.
fn listed(name: &str) -> ModelBytes {
    let mut model = ModelBytes::open(name);
    let config = Config::parse(&model.config.to_string()).unwrap();
    model.config["parts"] = serde_json::to_value(config.part_list()).unwrap();
    for part in Part::ALL {
        model.config["vq"].as_object_mut().unwrap().remove(part.name());
    }
    model.config["vq"].as_object_mut().unwrap().remove("codes");
    model.config.as_object_mut().unwrap().remove("rest");
    model
}

#[test]
fn the_four_parts_may_be_listed() {
    for name in ["mel_k1_upcycled", "hubert_k1_smplx", "hubert_k3_i8", "mel_k2_arkit"] {
        let run = |bytes: Vec<u8>| {
            let file = ModelFile::from_bytes(bytes).unwrap();
            let model = Model::load(&file, Precision::Stored, Isa::detect()).unwrap();
            let team = Team::new(1).unwrap();
            let mut animation = Animation::new(&model, &AvatarConfig::new(model.config())).unwrap();
            animation.push_audio(&(0..20_000).map(|i| 0.3 * (i as f32 * 0.07).sin()).collect::<Vec<_>>()).unwrap();
            animation.finish(30);
            let mut bits = Vec::new();
            let cx = Compute { isa: model.isa(), team: &team };
            let mut take = |frame: umo_core::FrameRef| {
                bits.extend(frame.pose.rotations.as_flattened().iter().chain(frame.face).map(|value| value.to_bits()));
            };
            while animation.step(&model, cx, &mut take).unwrap() {}
            bits
        };
        let plain = run(ModelBytes::open(name).bytes());
        assert_eq!(plain, run(listed(name).bytes()), "{name}");
        // A part's sampling applies: greedy sampling of all parts differs from the seeded draw.
        let mut greedy = listed(name);
        for part in greedy.config["parts"].as_array_mut().unwrap() {
            part["sampling"] = json!({ "temperature": 0, "top_k": 0, "top_p": 1 });
        }
        assert_ne!(plain, run(greedy.bytes()), "{name}");
    }
}

#[test]
fn other_lists_than_the_four_parts_are_refused_in_layout_parts() {
    let model = listed("mel_k2_arkit");
    let (header, data) = (model.header(), model.data());
    let refused = |change: &dyn Fn(&mut Value), key: &str, wanted: &str| {
        let mut config = model.config.clone();
        change(&mut config);
        let error = load(with_config(&model, &header, &data, &config)).err().unwrap_or_else(|| panic!("{key}"));
        let text = error.to_string();
        assert!(text.contains(&format!("config `{key}")) && text.contains(wanted), "{text}");
    };
    refused(&|c| c["parts"].as_array_mut().unwrap().swap(0, 1), "parts", "hands, face, upper, lower");
    refused(
        &|c| {
            c["parts"]
                .as_array_mut()
                .unwrap()
                .push(json!({ "name": "intent", "channels": [], "codes": 3, "levels": 1, "rest": [0] }))
        },
        "parts",
        "lower, intent",
    );
    refused(
        &|c| (c["parts"][2]["levels"], c["parts"][2]["rest"]) = (2.into(), json!([0, 0])),
        "parts[2].levels",
        "frames",
    );
    refused(&|c| c["parts"][1]["codes"] = 200.into(), "parts[1].codes", "200");
    refused(
        &|c| {
            let names = ["face", "hands", "upper", "lower"];
            let parts = c["parts"].as_array_mut().unwrap();
            parts.swap(0, 1);
            parts.iter_mut().zip(names).for_each(|(part, name)| part["name"] = name.into());
        },
        "parts[0].channels",
        "all channels of face",
    );
    refused(&|c| c["vq"]["codes"] = 256.into(), "vq.codes", "without `parts`");
    refused(&|c| c["rest"] = json!({ "face": 0, "hands": 0, "upper": 0, "lower": 0 }), "rest", "without `parts`");
}

#[test]
fn names_and_ids_of_the_config_are_checked() {
    let model = ModelBytes::open("mel_k2_arkit");
    let (header, data) = (model.header(), model.data());
    let refused = |path: &str, value: Value| {
        let config = set(&model.config, path, value);
        let error = load(with_config(&model, &header, &data, &config)).err().unwrap_or_else(|| panic!("{path}"));
        assert!(names(&error, path), "{path}: {error}");
        error.to_string()
    };
    let size = model.config["vocab"]["size"].as_u64().unwrap();
    assert!(refused("templates.audio_to_motion[1]", json!("dance")).contains("dance"));
    assert!(refused("templates.audio_to_motion[1]", json!("face")).contains("face"));
    assert!(refused("templates.text_to_motion[0]", json!(size)).contains(&size.to_string()));
    refused("templates.audio_to_motion", json!([]));
    refused("templates.audio_to_motion", json!(7));
    refused("templates", json!({}));
    for id in
        ["vocab.pad", "vocab.eos", "vocab.decoder_start", "vocab.lower.start", "vocab.audio.end", "vocab.face.mask"]
    {
        assert!(refused(id, json!(size)).contains(&size.to_string()));
    }
    let hubert = set(&model.config, "audio.kind", json!("hubert"));
    let error = load(with_config(&model, &header, &data, &hubert)).expect_err("there is no audio.hubert");
    assert_eq!(named(&error), Some("audio.hubert"));
    for (path, value) in [
        ("audio.kind", json!("wav2vec")),
        ("face.kind", json!("flame")),
        ("face.names", json!(["jawOpen"])),
        ("lm.feed_forward_proj", json!("relu")),
        ("lm.tie_word_embeddings", json!(1)),
        ("rest.hands", json!(256)),
        ("mouth.channels", json!([])),
        ("mouth.channels[1]", json!("jawOpen")),
        ("mouth.channels[1]", json!("jawOpens")),
        ("mouth.dilations", json!(vec![1; 17])),
        ("skeleton.parents[3]", json!(3)),
        ("skeleton.parents", json!([-1])),
        ("audio.token_rate", json!(37)),
    ] {
        refused(path, value);
    }
}

#[test]
fn another_format_or_version_is_refused() {
    let model = ModelBytes::open("mel_k1_upcycled");
    for (key, value) in [("format", Some("gguf")), ("format", None), ("version", Some("2")), ("version", None)] {
        let mut spoilt = model.clone();
        spoilt.metadata.remove(key);
        spoilt.metadata.extend(value.map(|value| (key.to_owned(), value.to_owned())));
        let text = refused(spoilt.bytes(), key);
        assert!(value.is_none_or(|value| text.contains(value)), "{text}");
    }
    for config in [json!("text"), json!([]), json!(null)] {
        let mut spoilt = model.clone();
        spoilt.config = config;
        refused(spoilt.bytes(), "config");
    }
    let mut header = model.header();
    header["__metadata__"] = json!({ "format": "umo", "version": "1" });
    refused(file(&Value::Object(header.clone()).to_string(), &model.data()), "config");
    header["__metadata__"] = json!({ "format": "umo", "version": "1", "config": "{\"name\": " });
    refused(file(&Value::Object(header.clone()).to_string(), &model.data()), "config");
    header.remove("__metadata__");
    refused(file(&Value::Object(header).to_string(), &model.data()), "format");
}

#[test]
fn inconsistent_header_is_refused() {
    let model = ModelBytes::open("mel_k1_upcycled");
    let (header, data) = (model.header(), model.data());
    let bytes = model.bytes();
    for len in [0, 1, 7, bytes.len() as u64, bytes.len() as u64 - 8, 100_000_001, 1 << 60, u64::MAX - 8, u64::MAX] {
        let mut lying = bytes.clone();
        lying[..8].copy_from_slice(&len.to_le_bytes());
        assert!(matches!(load(lying), Err(LoadError::File(_))), "a header of {len} bytes");
    }
    for text in ["", "{", "[]", "null", "{}", "\u{0}", "{\"a\":1}", "{\"__metadata__\":1}"] {
        assert!(load(file(text, &data)).is_err(), "{text:?}");
    }
    assert!(load([&8_u64.to_le_bytes()[..], &[0xff; 8]].concat()).is_err());
    let tensor = "lm.shared.weight";
    let [start, end] = [0, 1].map(|i| header[tensor]["data_offsets"][i].as_u64().unwrap());
    let spoil = |key: &str, value: Value| {
        let mut header = header.clone();
        header[tensor][key] = value;
        file(&Value::Object(header).to_string(), &data)
    };
    // Overlap, gap, out of bounds, reversed, wrong size.
    for offsets in [
        json!([start - 2, end - 2]),
        json!([start + 2, end + 2]),
        json!([start, end + 2]),
        json!([end, start]),
        json!([start, 1_u64 << 60]),
        json!([1_u64 << 60, (1_u64 << 60) + end - start]),
        json!([0, u64::MAX]),
        json!([0, 0]),
        json!([-1, end]),
        json!([start]),
        json!("all"),
        json!(null),
        json!([start, 1e300]),
    ] {
        let text =
            load(spoil("data_offsets", offsets.clone())).err().unwrap_or_else(|| panic!("{offsets}")).to_string();
        assert!(text.contains("tensor `"), "{offsets}: {text}");
    }
    for shape in [
        json!([]),
        json!([1]),
        json!([1_u64 << 60, 1_u64 << 60]),
        json!([1_u64 << 63, 2, 0]),
        json!([u64::MAX]),
        json!([-1, 22]),
        json!("all"),
        json!([0, 22]),
        json!([1.5]),
        json!([1e300]),
    ] {
        refused(spoil("shape", shape), &format!("`{tensor}`"));
    }
    for dtype in [json!("F128"), json!(""), json!(4), json!("F32")] {
        refused(spoil("dtype", dtype), &format!("`{tensor}`"));
    }
}

#[test]
fn sums_of_sizes_that_overflow_are_refused() {
    let eighth = 1_u64 << 60;
    let mut header = ModelBytes::open("mel_k1_upcycled").header();
    header.retain(|name, _| name == "__metadata__");
    for i in 0..16 {
        let end = if i == 15 { u64::MAX } else { (i + 1) * eighth };
        let entry = json!({ "dtype": "U8", "shape": [end - i * eighth], "data_offsets": [i * eighth, end] });
        header.insert(format!("t{i:02}"), entry);
    }
    refused(file(&Value::Object(header).to_string(), &[]), "tensor `t00`");
}

proptest! {
    #![proptest_config(cases(200))]

    #[test]
    fn a_header_with_wrong_bytes_breaks_nothing(at in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 1..6)) {
        let model = ModelBytes::open("mel_k1_upcycled");
        let mut file = model.bytes();
        let at = at.index(file.len() - model.data().len());
        file[at..at + bytes.len()].copy_from_slice(&bytes);
        if let Err(error) = load(file) {
            prop_assert!(!error.to_string().is_empty());
        }
    }

    #[test]
    fn a_text_tokenizer_with_wrong_bytes_breaks_nothing(
        at in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 1..6), text in ".{0,40}",
    ) {
        let model = ModelBytes::open("mel_k2_arkit");
        let mut pieces = model.tensors[TOKENIZER].bytes.clone();
        let at = at.index(pieces.len() - bytes.len());
        pieces[at..at + bytes.len()].copy_from_slice(&bytes);
        if let Ok(tokenizer) = umo_core::TextTokenizer::from_bytes(&pieces, 400) {
            tokenizer.split(&text);
        }
    }
}
