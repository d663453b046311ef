//! `umo model quantize` as a user runs it.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;
use umo_core::{Animation, Compute, Isa, Model, ModelFile, SessionConfig, Team};
use umo_core_model::calibration::Calibration;
use umo_core_model::weights::layout::{self, Kind};
use umo_core_model::weights::writer::Storage;

/// Suffixes of the tensors whose channels are equalised: two that produce them, two that consume them.
const EVENED: [&str; 4] = [".v.weight", ".wi_1.weight", ".o.weight", ".wo.weight"];

struct Place(TempDir);

impl Place {
    /// Makes a folder with a tiny random model of f32 weights, `model`.
    fn new() -> Self {
        let place = Self(TempDir::new().unwrap());
        place.run(&["model", "random", "--size", "tiny", "--store", "f32", "-o", "model"], 0);
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn open(&self, name: &str) -> ModelFile {
        ModelFile::open(&self.path(name)).unwrap()
    }

    /// Runs the program in the folder, and returns its standard error.
    fn run(&self, args: &[&str], code: i32) -> String {
        let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
        let Output { status, stderr, .. } = command.args(args).current_dir(self.0.path()).output().unwrap();
        let stderr = String::from_utf8(stderr).unwrap();
        assert_eq!(status.code(), Some(code), "umo {args:?}: {stderr}");
        stderr
    }

    /// Quantizes `model` to `name` with more arguments.
    fn quantize(&self, name: &str, args: &[&str]) -> ModelFile {
        self.run(&[&["model", "quantize", "model", "-o", name], args].concat(), 0);
        self.open(name)
    }

    /// Files in the folder.
    fn files(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

/// All values of a tensor.
fn values(file: &ModelFile, name: &str, shape: &[usize]) -> Vec<f32> {
    let mut values = vec![0.0; shape.iter().product()];
    file.tensor(name, shape).unwrap().read(&mut values).unwrap();
    values
}

fn speech() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hello.wav").display().to_string()
}

#[test]
fn int8_takes_products_to_half_a_step_and_nothing_else() {
    let place = Place::new();
    let (before, after) = (place.open("model"), place.quantize("small", &["--weights", "int8"]));
    assert!(after.len() < before.len());
    let mut quantized = 0;
    for spec in layout::specs(before.config(), true) {
        let (was, is) = (values(&before, &spec.name, &spec.shape), values(&after, &spec.name, &spec.shape));
        if after.storage(&spec.name).unwrap() != Storage::Int8 {
            assert_eq!(was, is, "{}", spec.name);
            continue;
        }
        quantized += 1;
        assert_eq!(spec.kind, Kind::Product, "{}", spec.name);
        if EVENED.iter().any(|end| {
            ["lm.", "depth."].iter().any(|network| spec.name.starts_with(network)) && spec.name.ends_with(end)
        }) {
            continue;
        }
        for (was, is) in was.chunks_exact(spec.inputs()).zip(is.chunks_exact(spec.inputs())) {
            let step = was.iter().fold(0.0_f32, |a, v| a.max(v.abs())) / 127.0;
            for (was, is) in was.iter().zip(is) {
                assert!((was - is).abs() <= 0.501 * step, "{}: {was} became {is}", spec.name);
            }
        }
    }
    assert!(quantized > 20, "only {quantized} tensors");
    for kept in ["lm.lm_head.weight", "lm.shared.weight", "lm.encoder.block.0.layer.1.moe.router.weight"] {
        assert_eq!(after.storage(kept).unwrap(), Storage::F32, "{kept}");
    }
    assert_eq!(before.raw("text.tokenizer").unwrap(), after.raw("text.tokenizer").unwrap());
}

#[test]
fn of_the_convolutions_of_hubert_the_two_of_most_arithmetic_become_int8() {
    let place = Place::new();
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/hubert_k1_smplx/model.safetensors");
    std::fs::copy(golden, place.path("model")).unwrap();
    let file = place.quantize("small", &["--weights", "int8"]);
    let storage = |name: &str| file.storage(&format!("audio.hubert.{name}.weight")).unwrap();
    let convolutions = file.config().audio.hubert.as_ref().unwrap().conv_dim.len();
    for i in 0..convolutions {
        let wanted = if i == 1 || i == 2 { Storage::Int8 } else { Storage::F32 };
        assert_eq!(storage(&format!("feature_extractor.conv_layers.{i}.conv")), wanted, "convolution {i}");
    }
    assert_eq!(storage("encoder.pos_conv_embed.conv"), Storage::F32);
    assert_eq!(storage("encoder.layers.0.attention.q_proj"), Storage::Int8);
}

#[test]
fn the_root_network_of_layout_frames_stays_as_it_was() {
    let place = Place::new();
    place.run(&["model", "random", "--size", "tiny", "--layout", "frames", "--store", "f32", "-o", "model"], 0);
    for weights in ["int8", "bf16"] {
        let file = place.quantize("small", &["--weights", weights]);
        let of = |stem: &str| {
            let specs = layout::specs(file.config(), true);
            let products = specs.iter().filter(|spec| spec.kind == Kind::Product && spec.name.starts_with(stem));
            products.map(|spec| file.storage(&spec.name).unwrap()).collect::<Vec<_>>()
        };
        assert!(!of("vq.root.").is_empty() && of("vq.root.").iter().all(|&storage| storage == Storage::F32));
        assert!(of("depth.").iter().all(|&storage| storage != Storage::F32), "{weights}");
    }
}

#[test]
fn bf16_rounds_products_alone() {
    let place = Place::new();
    let file = place.quantize("small", &["--weights", "bf16"]);
    for spec in layout::specs(file.config(), true) {
        let wanted = if spec.kind == Kind::Product { Storage::Bf16 } else { Storage::F32 };
        assert_eq!(file.storage(&spec.name).unwrap(), wanted, "{}", spec.name);
    }
}

#[test]
fn the_last_set_counts_then_keep_then_the_default() {
    let place = Place::new();
    let globs = ["--keep", "*.q.weight", "--set", "*.[qk].weight=bf16", "--set", "lm.decoder.*.k.weight=f32"];
    let file = place.quantize("small", &[&["--weights", "int8"], &globs[..]].concat());
    let storage =
        |stack: &str, which: &str| file.storage(&format!("lm.{stack}.block.0.layer.0.SelfAttention.{which}.weight"));
    for (stack, which, wanted) in [
        ("encoder", "q", Storage::Bf16),
        ("encoder", "k", Storage::Bf16),
        ("decoder", "k", Storage::F32),
        ("decoder", "v", Storage::Int8),
    ] {
        assert_eq!(storage(stack, which).unwrap(), wanted, "{stack} {which}");
    }
    let kept = place.quantize("kept", &["--weights", "int8", "--keep", "lm.*"]);
    assert_eq!(kept.storage("lm.encoder.block.0.layer.0.SelfAttention.v.weight").unwrap(), Storage::F32);
    let head = place.quantize("head", &["--weights", "int8", "--set", "lm.lm_head.weight=int8"]);
    assert_eq!(head.storage("lm.lm_head.weight").unwrap(), Storage::Int8);
}

/// Channels between values and the attention's output, and between the halves of a feed-forward,
/// are equalised by powers of two that the consumers undo.
#[test]
fn channels_are_evened_out_without_a_change_of_the_function() {
    let place = Place::new();
    let (before, after) = (place.open("model"), place.quantize("small", &["--weights", "int8"]));
    let specs = layout::specs(before.config(), true);
    let mut factors = 0;
    for generator in specs
        .iter()
        .filter(|s| s.name.starts_with("lm.") && (s.name.ends_with(EVENED[0]) || s.name.ends_with(EVENED[1])))
    {
        let taker = generator.name.replace(EVENED[0], EVENED[2]).replace(EVENED[1], EVENED[3]);
        let ([channels, inputs], [outputs, _]) =
            ([generator.shape[0], generator.shape[1]], [generator.shape[1], generator.shape[0]]);
        let (was, is) =
            (values(&before, &generator.name, &generator.shape), values(&after, &generator.name, &generator.shape));
        let shape = [outputs, channels];
        let (was_taken, is_taken) = (values(&before, &taker, &shape), values(&after, &taker, &shape));
        for channel in 0..channels {
            let range =
                |v: &[f32]| v[channel * inputs..(channel + 1) * inputs].iter().fold(0.0_f32, |a, v| a.max(v.abs()));
            let factor = (range(&is) / range(&was)).log2().round().exp2();
            factors += usize::from(factor != 1.0);
            for row in 0..inputs {
                let at = channel * inputs + row;
                let (want, step) = (was[at] * factor, range(&is) / 127.0);
                assert!((want - is[at]).abs() <= 0.501 * step, "{}: {want} became {}", generator.name, is[at]);
            }
            for output in 0..outputs {
                let row = &is_taken[output * channels..(output + 1) * channels];
                let step = row.iter().fold(0.0_f32, |a, v| a.max(v.abs())) / 127.0;
                let (want, got) = (was_taken[output * channels + channel] / factor, row[channel]);
                assert!((want - got).abs() <= 0.501 * step, "{taker}: {want} became {got}");
            }
        }
    }
    assert!(factors > 3, "random ranges differ, yet only {factors} channels were evened out");
}

/// Without `--precision`, each product is computed in its weights' stored type.
#[test]
fn a_model_is_run_as_it_is_stored() {
    let place = Place::new();
    place.quantize("i8", &["--weights", "int8"]);
    place.quantize("b16", &["--weights", "bf16"]);
    let speech = speech();
    let moves = |model: &str, more: &[&str]| {
        place.run(&[&["animate", &speech, "--model", model, "-o", "out.jsonl"], more].concat(), 0);
        std::fs::read_to_string(place.path("out.jsonl")).unwrap()
    };
    let stored = moves("i8", &[]);
    assert!(stored.lines().count() > 30);
    // Not `assert_eq!`, which would print both animations.
    assert!(stored == moves("i8", &["--precision", "int8"]));
    assert!(stored != moves("i8", &["--precision", "f32"]));
    // Back-ends with tiles split the inputs of bf16 products in two; others widen the weights, as f32
    // does.
    let plain = ["--isa", "scalar"];
    assert!(moves("b16", &plain) == moves("b16", &["--isa", "scalar", "--precision", "f32"]));
    assert!(moves("b16", &[]) == moves("b16", &["--precision", "bf16"]));
    assert!(moves("b16", &[]) != moves("model", &[]));
}

/// Codes of 4 bits in groups: the tensors that `--weights int4` quantizes, their sizes, and the error.
#[test]
fn int4_takes_experts_to_half_the_bytes() {
    let place = Place::new();
    let (before, after) = (place.open("model"), place.quantize("four", &["--weights", "int4"]));
    let (mut quantized, mut int8) = (0, 0);
    for spec in layout::specs(before.config(), true) {
        let storage = after.storage(&spec.name).unwrap();
        int8 += usize::from(storage == Storage::Int8);
        if storage != Storage::Int4 {
            continue;
        }
        assert!(spec.name.starts_with("lm.decoder.") && spec.is_expert(), "{}", spec.name);
        quantized += 1;
        let (was, is) = (values(&before, &spec.name, &spec.shape), values(&after, &spec.name, &spec.shape));
        let (inputs, squares) = (spec.inputs(), |v: &mut dyn Iterator<Item = f32>| v.map(|v| v * v).sum::<f32>());
        if !EVENED.iter().any(|end| spec.name.ends_with(end)) {
            let error = squares(&mut was.iter().zip(&is).map(|(a, b)| a - b)) / squares(&mut was.iter().copied());
            // For uniform values: a step of a sixteenth of the range.
            assert!((0.02..0.085).contains(&error.sqrt()), "{}: {error}", spec.name);
        }
        let tensors = after.tensors();
        let bytes = |name: &str| tensors.iter().find(|(other, ..)| *other == name).map(|(.., bytes)| *bytes).unwrap();
        assert_eq!(bytes(&spec.name), spec.shape[0] * inputs.div_ceil(2));
        assert_eq!(bytes(&format!("{}.multipliers", spec.name)), spec.shape[0] * inputs.div_ceil(32));
        assert_eq!(bytes(&format!("{}.scale", spec.name)), 4 * spec.shape[0]);
    }
    let experts = layout::specs(before.config(), true).iter().filter(|spec| spec.is_expert()).count();
    assert!(2 * quantized == experts && int8 > 20, "{quantized} tensors in int4, {int8} in int8");
}

/// Records the inputs of the float model's products while it animates `speech`, for the tensors `wanted`.
fn recorded(place: &Place, wanted: Vec<String>) -> Calibration {
    let calibration = Calibration::new(wanted);
    let model = Model::load_recording(&place.open("model"), Isa::detect(), &calibration).unwrap();
    let team = Team::new(1).unwrap();
    let avatar = SessionConfig::new(model.config()).avatar;
    let mut animation = Animation::new(&model, &avatar).unwrap();
    let wav = umo_audio_file::read(Path::new(&speech())).unwrap();
    animation.push_audio(&wav.mono()).unwrap();
    animation.finish(60);
    while animation.step(&model, Compute { isa: model.isa(), team: &team }, &mut |_| ()).unwrap() {}
    calibration
}

/// Weights rounded with calibration: only codes differ in the file, and the error of
/// the products, on inputs recorded once more, is smaller.
#[test]
fn calibration_lowers_the_error_of_products() {
    let place = Place::new();
    for layout in ["parts", "frames"] {
        place.run(&["model", "random", "--size", "tiny", "--layout", layout, "--store", "f32", "-o", "model"], 0);
        let weights = ["--weights", "int4", "--set", "lm.*.SelfAttention.q.weight=int4"];
        let plain = place.quantize("plain", &weights);
        let speech = speech();
        let compensated = place.quantize("compensated", &[&weights[..], &["--calibrate", &speech]].concat());
        assert_eq!(plain.len(), compensated.len());
        let before = place.open("model");
        let specs = layout::specs(before.config(), true);
        let quantized = |name: &str| plain.storage(name).unwrap().is_quantized();
        let specs: Vec<_> = specs.iter().filter(|spec| spec.shape.len() == 2 && quantized(&spec.name)).collect();
        let calibration = recorded(&place, specs.iter().map(|spec| spec.name.clone()).collect());
        let (mut int8, mut int4) = ([0.0, 0.0], [0.0, 0.0]);
        for spec in specs {
            assert_eq!(plain.storage(&spec.name).unwrap(), compensated.storage(&spec.name).unwrap());
            if EVENED.iter().any(|end| spec.name.ends_with(end)) {
                continue;
            }
            let k = spec.inputs();
            let was = values(&before, &spec.name, &spec.shape);
            let sums = match plain.storage(&spec.name).unwrap() {
                Storage::Int4 => &mut int4,
                _ => &mut int8,
            };
            for (rows, gram) in calibration.of(&spec.name) {
                let gram = gram.sum().unwrap();
                for (sum, file) in sums.iter_mut().zip([&plain, &compensated]) {
                    let is = values(file, &spec.name, &spec.shape);
                    for row in rows.clone() {
                        let e: Vec<f64> =
                            (row * k..(row + 1) * k).map(|at| f64::from(was[at]) - f64::from(is[at])).collect();
                        *sum += (0..k * k).map(|at| e[at / k] * gram[at] * e[at % k]).sum::<f64>();
                    }
                }
            }
        }
        for ([plain, compensated], what) in [(int8, "int8"), (int4, "int4")] {
            assert!(plain > 0.0 && compensated < 0.9 * plain, "{layout}, {what}: {compensated} of {plain}");
        }
        place.run(&["animate", &speech, "--model", "compensated", "-o", "out.jsonl"], 0);
    }
    let said =
        place.run(&["model", "quantize", "model", "-o", "no", "--weights", "bf16", "--calibrate", "none.wav"], 2);
    assert!(said.contains("no tensor becomes int8 or int4"), "{said}");
    let said =
        place.run(&["model", "quantize", "model", "-o", "no", "--weights", "int8", "--calibrate", "none.wav"], 2);
    assert!(said.contains("none.wav"), "{said}");
    assert!(!place.files().iter().any(|name| name.contains("part") || name == "no"), "{:?}", place.files());
}

/// The int8 model of the same values gives the same frames, on every back-end and in both layouts.
#[test]
fn int4_models_move_alike_everywhere() {
    let place = Place::new();
    let speech = speech();
    for layout in ["parts", "frames"] {
        place.run(&["model", "random", "--size", "tiny", "--layout", layout, "--store", "f32", "-o", "model"], 0);
        let mut args =
            vec!["--weights", "int8", "--set", "lm.*.moe.experts.*=int4", "--set", "lm.*Attention.[qkvo].*=int4"];
        if layout == "frames" {
            args.extend(["--set", "depth.layers.*.attention.*=int4", "--set", "depth.layers.*.feed_forward.*=int4"]);
            args.extend(["--set", "depth.head.*=int4"]);
        }
        place.quantize("four", &args);
        let moves = |more: &[&str]| {
            place.run(&[&["animate", &speech, "--model", "four", "-o", "out.jsonl"], more].concat(), 0);
            std::fs::read_to_string(place.path("out.jsonl")).unwrap()
        };
        let stored = moves(&[]);
        assert!(stored.lines().count() > 30);
        for isa in Isa::available() {
            // f32 parts differ between some back-ends.
            let same = moves(&["--isa", isa.name(), "--precision", "int8"]) == moves(&["--isa", isa.name()]);
            assert!(same, "{layout}: int8 on {}", isa.name());
        }
        // The keys and one expert in int8, the others in int4: computed as int8.
        place.quantize(
            "mixed",
            &[&args[..], &["--set", "lm.*.experts.0.*=int8", "--set", "lm.*.k.weight=int8"]].concat(),
        );
        place.run(&["animate", &speech, "--model", "mixed", "-o", "out.jsonl"], 0);
        assert!(stored != moves(&["--precision", "f32"]), "{layout}");
    }
}

/// The fault of a damaged int4 tensor is named.
#[test]
fn damaged_int4_tensors_are_named() {
    let place = Place::new();
    let name = "lm.decoder.block.0.layer.2.moe.experts.0.wo.weight";
    let file = place.quantize("four", &["--weights", "int8", "--set", &format!("{name}=int4")]);
    let shape = layout::specs(file.config(), true).into_iter().find(|spec| spec.name == name).unwrap().shape;
    let bytes = std::fs::read(place.path("four")).unwrap();
    // Without a checksum, as from other programs, so that the checksum does not reveal the damage.
    let find = |bytes: &[u8], text: &str| bytes.windows(text.len()).position(|w| w == text.as_bytes()).unwrap();
    let replaced = |bytes: &[u8], from: &str, to: &str| {
        assert_eq!(from.len(), to.len());
        let (mut bytes, at) = (bytes.to_vec(), find(bytes, from));
        bytes[at..at + to.len()].copy_from_slice(to.as_bytes());
        bytes
    };
    let bytes = replaced(&bytes, "\"checksum\"", "\"comments\"");
    let bytes = replaced(&bytes, "\"header_checksum\"", "\"header_comments\"");
    let said = |bytes: Vec<u8>| match ModelFile::from_bytes(bytes) {
        Ok(file) => file.tensor(name, &shape).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    };
    let [rows, groups] = [shape[0], shape[1].div_ceil(32)];
    // The first multiplier, located by the tensor's entry.
    let header = 8 + usize::try_from(u64::from_le_bytes(*bytes.first_chunk().unwrap())).unwrap();
    let entry = find(&bytes, &format!("\"{name}.multipliers\""));
    let text = String::from_utf8_lossy(&bytes[entry..header]).into_owned();
    let start = text.split("\"data_offsets\":[").nth(1).unwrap().split(',').next().unwrap();
    let mut large = bytes.clone();
    large[header + start.parse::<usize>().unwrap() + 1] = 16;
    let message = said(large);
    assert!(
        message.contains(&format!("{name}.multipliers")) && message.contains("is 16, not within -15 to 15"),
        "{message}"
    );
    let message = said(replaced(&bytes, &format!("{name}.multipliers"), &format!("{name}.multiplierz")));
    assert!(message.contains("expected F32, F16, BF16 or I8, got U8") || message.contains("expected ["), "{message}");
    let message = said(replaced(&bytes, &format!("{name}.scale"), &format!("{name}.scalf")));
    assert!(message.contains(&format!("`{name}.scale`")) && message.contains("missing"), "{message}");
    let file = ModelFile::from_bytes(bytes).unwrap();
    let message = file.tensor(name, &[rows, shape[1] + 2]).unwrap_err().to_string();
    assert!(message.contains("for int4 codes of"), "{message}");
    assert!(groups > 0 && file.tensor(name, &shape).is_ok());
}

/// Experts share their input, and each computes two products: experts of different types still run.
#[test]
fn uneven_types_are_computed() {
    let place = Place::new();
    for (i, glob) in ["*experts.0.wo*=bf16", "*.wi_0.*=bf16", "*experts.1.wi_1.*=f32", "*.k.weight=bf16", "*.wo.*=f32"]
        .into_iter()
        .enumerate()
    {
        let (name, output) = (format!("model{i}"), format!("out{i}.jsonl"));
        place.quantize(&name, &["--weights", "int8", "--set", glob]);
        place.run(&["animate", &speech(), "--model", &name, "-o", &output], 0);
    }
}

#[test]
fn quantized_models_are_refused() {
    let place = Place::new();
    place.quantize("small", &["--weights", "int8"]);
    place.quantize("four", &["--weights", "int8", "--set", "lm.decoder.block.0.*.wo.*=int4"]);
    let before = place.files();
    for (model, what) in [("small", "is int8 already"), ("four", "is int4 already")] {
        let said =
            place.run(&["model", "quantize", model, "-o", "smaller", "--weights", "int8", "--keep", "audio.*"], 2);
        assert!(said.contains("already"), "{what}: {said}");
    }
    assert_eq!(place.files(), before);
}

#[test]
fn bad_globs_are_refused() {
    let place = Place::new();
    for (args, wanted) in [
        (["--keep", "lm.nothing.*"], "`lm.nothing.*` matches no tensor"),
        (["--keep", "lm.[*"], "--keep lm.[*"),
        (["--set", "lm.*"], "expected GLOB=TYPE"),
        (["--set", "lm.*=int5"], "expected f32, bf16, int8 or int4, got `int5`"),
        (["--set", "*.layer_norm.weight=int8"], "it cannot be int8"),
    ] {
        let said =
            place.run(&[&["model", "quantize", "model", "-o", "small", "--weights", "int8"], &args[..]].concat(), 2);
        assert!(said.contains(wanted), "{args:?}: {said}");
        assert_eq!(place.files(), ["model"], "{args:?}");
    }
}

#[test]
fn a_weight_that_is_no_number_is_named_and_nothing_is_written() {
    let place = Place::new();
    // Tensors are written in the order of their names, so the last bytes are the last value of the
    // last name.
    place.quantize("sorted", &["--weights", "bf16"]);
    let mut bytes = std::fs::read(place.path("sorted")).unwrap();
    let end = bytes.len() - 4;
    bytes[end..].copy_from_slice(&f32::NAN.to_le_bytes());
    // As a file from elsewhere, which has no checksums to see the damage by.
    for (key, other) in [("\"checksum\"", "\"comments\""), ("\"header_checksum\"", "\"header_comments\"")] {
        let at = bytes.windows(key.len()).position(|window| window == key.as_bytes()).unwrap();
        bytes[at..at + key.len()].copy_from_slice(other.as_bytes());
    }
    std::fs::write(place.path("broken"), bytes).unwrap();
    std::fs::write(place.path("small"), "what was here before").unwrap();
    let said = place.run(&["model", "quantize", "broken", "-o", "small", "--weights", "int8"], 2);
    assert!(said.contains("vq.upper.quantizer.embedding.weight") && said.contains("not a finite number"), "{said}");
    assert_eq!(std::fs::read_to_string(place.path("small")).unwrap(), "what was here before");
    assert_eq!(place.files(), ["broken", "model", "small", "sorted"]);
}
