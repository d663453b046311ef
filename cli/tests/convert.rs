//! `umo model convert` as a user runs it, on files with the names that Hugging Face, EMAGE and Language
//! of Motion use.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use half::f16;
use safetensors::Dtype;
use safetensors::tensor::TensorView;
use serde_json::{Value, json};
use tempfile::TempDir;
use umo_core::{Config, ModelFile};
use umo_core_model::weights::layout::{self, Kind};
use umo_core_model::weights::writer::Storage;

const POSITION: &str = "encoder.pos_conv_embed.conv";
const ROUTER: &str = "lm.encoder.block.1.layer.1.moe.router.weight";

type Tensors = BTreeMap<String, (Vec<usize>, Vec<f32>)>;

/// The model with the published files' weights.
fn golden() -> ModelFile {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/hubert_k1_smplx/model.safetensors");
    ModelFile::open(&path).unwrap()
}

fn values(file: &ModelFile, name: &str, shape: &[usize]) -> Vec<f32> {
    let mut values = vec![0.0; shape.iter().product()];
    file.tensor(name, shape).unwrap().read(&mut values).unwrap();
    values
}

/// A folder with published files, and the contents of each.
struct Place {
    folder: TempDir,
    files: BTreeMap<String, Tensors>,
    config: Value,
}

impl Place {
    /// `hubert`, `centroids`, `t5`, `interp`, and `face` to `root`.
    fn new() -> Self {
        let model = golden();
        let mut files: BTreeMap<String, Tensors> = BTreeMap::new();
        for spec in layout::specs(model.config(), false) {
            if let Some((file, name)) = published(&spec.name) {
                files
                    .entry(file)
                    .or_default()
                    .insert(name, (spec.shape.clone(), values(&model, &spec.name, &spec.shape)));
            }
        }
        let hubert = files.get_mut("hubert").unwrap();
        unfold(hubert);
        for (name, len) in [("masked_spec_embed", 20), ("encoder.layers.3.final_layer_norm.bias", 20)] {
            hubert.insert(name.to_owned(), (vec![len], vec![0.5; len]));
        }
        let config = serde_json::to_value(model.config()).unwrap();
        Self { folder: TempDir::new().unwrap(), files, config }
    }

    /// Files for a model of layout `frames`: HuBERT and the parts of a random model, in which
    /// the hands are two parts with the same number of channels.
    fn frames() -> Self {
        let folder = TempDir::new().unwrap();
        let path = folder.path().join("random");
        let args = ["model", "random", "--size", "tiny", "--layout", "frames", "-o"];
        let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
        assert!(command.args(args).arg(&path).output().unwrap().status.success());
        let mut config = serde_json::to_value(ModelFile::open(&path).unwrap().config()).unwrap();
        config.as_object_mut().unwrap().remove("notice");
        config["audio"] = serde_json::to_value(&golden().config().audio).unwrap();
        config["audio"]["ahead"] = 1.into();
        let first = config["vocab"]["audio"]["first"].as_u64().unwrap();
        let (units, end) = (config["audio"]["units"].clone(), first + config["audio"]["units"].as_u64().unwrap());
        config["vocab"]["audio"] =
            json!({ "first": first, "codes": units, "start": end, "end": end + 1, "mask": end + 2 });
        config["vocab"]["size"] = (end + 3).into();
        let parts = config["parts"].as_array_mut().unwrap();
        let hands = parts.iter().position(|part| part["name"] == "hands").unwrap();
        let hands = parts.remove(hands);
        for side in ["left", "right"] {
            let mut hand = hands.clone();
            hand["name"] = format!("hand_{side}").into();
            hand["channels"].as_array_mut().unwrap().retain(|name| name.as_str().unwrap().starts_with(side));
            parts.push(hand);
        }
        let mut files: BTreeMap<String, Tensors> = BTreeMap::new();
        let parsed = Config::parse(&config.to_string()).unwrap();
        for (i, spec) in layout::specs(&parsed, false).into_iter().enumerate() {
            if let Some((file, name)) = published(&spec.name) {
                let values = (0..spec.len()).map(|at| ((at * 37 + i * 101) % 251) as f32 / 256.0 - 0.5).collect();
                files.entry(file).or_default().insert(name, (spec.shape.clone(), values));
            }
        }
        unfold(files.get_mut("hubert").unwrap());
        files.get_mut("t5").unwrap().insert("lm_head.weight".to_owned(), (vec![3, 4], vec![0.0; 12]));
        Self { folder: TempDir::new().unwrap(), files, config }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn tensor(&mut self, file: &str, name: &str) -> &mut (Vec<usize>, Vec<f32>) {
        self.files.get_mut(file).unwrap().get_mut(name).unwrap()
    }

    fn rename(&mut self, file: &str, ours: impl Fn(&str) -> String) {
        let tensors = self.files.get_mut(file).unwrap();
        *tensors = std::mem::take(tensors).into_iter().map(|(name, tensor)| (ours(&name), tensor)).collect();
    }

    /// Writes the files and runs the program with `more` arguments; returns its standard error.
    fn run(&self, more: &[&str], code: i32) -> String {
        for (name, tensors) in &self.files {
            write(&self.path(&format!("{name}.safetensors")), tensors);
        }
        std::fs::write(self.path("config.json"), self.config.to_string()).unwrap();
        let mut args = vec!["model".to_owned(), "convert".to_owned(), "--config".to_owned(), "config.json".to_owned()];
        for name in self.files.keys() {
            let option =
                if matches!(&**name, "hubert" | "centroids" | "t5" | "interp" | "depth") { name } else { "vq" };
            args.extend([format!("--{option}"), format!("{name}.safetensors")]);
        }
        args.extend(["-o", "model"].iter().chain(more).map(|&arg| arg.to_owned()));
        let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
        let Output { status, stderr, .. } = command.args(&args).current_dir(self.folder.path()).output().unwrap();
        let stderr = String::from_utf8(stderr).unwrap();
        assert_eq!(status.code(), Some(code), "umo {args:?}: {stderr}");
        stderr
    }

    fn convert(&self, more: &[&str]) -> ModelFile {
        self.run(more, 0);
        ModelFile::open(&self.path("model")).unwrap()
    }

    /// Asserts a refusal that contains `wanted` and writes nothing.
    fn refused(&self, more: &[&str], wanted: &str) {
        let said = self.run(more, 2);
        assert!(said.contains(wanted), "{said}");
        assert_eq!(said.lines().count(), 1, "{said}");
        let left = std::fs::read_dir(self.folder.path()).unwrap().map(|e| e.unwrap().file_name());
        assert!(left.into_iter().all(|name| name != "model" && !name.to_str().unwrap().ends_with(".part")));
    }
}

/// The file and name of a tensor in the published files; routers, and experts except the first, are
/// not published.
fn published(name: &str) -> Option<(String, String)> {
    let (stage, rest) = name.split_once('.').unwrap();
    Some(match stage {
        "audio" => match rest.split_once('.').unwrap() {
            ("hubert", rest) => ("hubert".to_owned(), rest.to_owned()),
            _ => ("centroids".to_owned(), "cluster_centers_".to_owned()),
        },
        "lm" if rest.contains(".moe.") => {
            let (block, part) = rest.split_once(".moe.experts.0.")?;
            ("t5".to_owned(), format!("{block}.DenseReluDense.{part}"))
        }
        "lm" if rest.starts_with("frames.") => ("depth".to_owned(), name.to_owned()),
        "lm" => ("t5".to_owned(), rest.to_owned()),
        "vq" => {
            let (part, rest) = rest.split_once('.').unwrap();
            (part.to_owned(), rest.to_owned())
        }
        stage => (stage.to_owned(), name.to_owned()),
    })
}

/// The position convolution as an unnormalised direction, twice as long, and its scale.
fn unfold(hubert: &mut Tensors) {
    let (shape, folded) = hubert.remove(&format!("{POSITION}.weight")).unwrap();
    let taps = shape[2];
    let scale = (0..taps).map(|tap| folded.iter().skip(tap).step_by(taps).map(|v| v * v).sum::<f32>().sqrt()).collect();
    let direction = folded.iter().map(|v| 2.0 * v).collect();
    hubert.insert(format!("{POSITION}.parametrizations.weight.original0"), (vec![1, 1, taps], scale));
    hubert.insert(format!("{POSITION}.parametrizations.weight.original1"), (shape, direction));
}

fn write(path: &Path, tensors: &Tensors) {
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let data: Vec<_> = tensors.iter().map(|(name, (shape, values))| (name, shape, bytes(values))).collect();
    let views =
        data.iter().map(|(name, shape, bytes)| (name, TensorView::new(Dtype::F32, shape.to_vec(), bytes).unwrap()));
    safetensors::serialize_to_file(views, None, path).unwrap();
}

#[test]
fn every_tensor_is_renamed_and_every_expert_a_copy() {
    let place = Place::new();
    let (before, after) = (golden(), place.convert(&["--dtype", "f32"]));
    for spec in layout::specs(after.config(), false) {
        let is = values(&after, &spec.name, &spec.shape);
        if spec.kind == Kind::Router {
            assert!(is.iter().all(|v| v.abs() < 0.1) && is.iter().any(|&v| v != is[0]), "{}", spec.name);
            continue;
        }
        let first =
            ["1", "2"].iter().fold(spec.name.clone(), |name, e| name.replace(&format!("experts.{e}"), "experts.0"));
        let was = values(&before, &first, &spec.shape);
        if spec.name.contains("pos_conv_embed.conv.weight") {
            let far = was.iter().zip(&is).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(far < 1e-6, "{far}");
        } else {
            assert_eq!(was, is, "{}", spec.name);
        }
    }
    assert_eq!(after.config(), before.config());
}

#[test]
fn the_model_animates() {
    let place = Place::new();
    place.convert(&["--experts", "2", "--top-k", "2"]);
    let wav = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hello.wav");
    let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
    command.arg("animate").arg(wav).args(["--model", "model", "-o", "out.npz"]);
    assert!(command.current_dir(place.folder.path()).output().unwrap().status.success());
    assert!(std::fs::metadata(place.path("out.npz")).unwrap().len() > 1000);
}

#[test]
fn weights_take_the_type_and_what_decides_stays() {
    let place = Place::new();
    for (name, storage) in [("bf16", Storage::Bf16), ("f16", Storage::F16)] {
        let file = place.convert(&["--dtype", name]);
        for spec in layout::specs(file.config(), false) {
            let weights = matches!(spec.kind, Kind::Product | Kind::Table);
            let wanted = if weights { storage } else { Storage::F32 };
            assert_eq!(file.storage(&spec.name).unwrap(), wanted, "{}", spec.name);
        }
    }
}

#[test]
fn experts_and_seed_are_those_asked_for() {
    let place = Place::new();
    let file = place.convert(&["--experts", "5", "--top-k", "2"]);
    assert_eq!((file.config().lm.experts, file.config().lm.top_k), (5, 2));
    // On Windows an open file cannot be replaced.
    drop(file);
    let routers = ["1", "1", "2"].map(|seed| {
        let file = place.convert(&["--experts", "5", "--dtype", "f32", "--seed", seed]);
        values(&file, ROUTER, &[5, file.config().lm.d_model])
    });
    assert_eq!(routers[0], routers[1]);
    assert_ne!(routers[0], routers[2]);
    place.run(&["--experts", "1", "--top-k", "2"], 2);
}

#[test]
fn new_rows_are_refused_or_the_mean_of_the_old() {
    let mut place = Place::new();
    let (rows, width) = (101, 26);
    for table in ["shared.weight", "lm_head.weight"] {
        let (shape, values) = place.tensor("t5", table);
        shape[0] = rows;
        values.truncate(rows * width);
    }
    place.refused(&[], "101 rows, the config's vocabulary has 1182: `--new-rows mean`");
    let old = place.tensor("t5", "shared.weight").1.clone();
    let said = place.run(&["--new-rows", "mean", "--dtype", "f32"], 0);
    assert!(said.contains("new tokens are not trained"), "{said}");
    let file = ModelFile::open(&place.path("model")).unwrap();
    assert!(file.config().notice.as_ref().unwrap().contains("new tokens"));
    let table = values(&file, "lm.shared.weight", &[1182, width]);
    assert_eq!(table[..rows * width], old);
    for (i, new) in table[rows * width..].iter().enumerate() {
        let mean = old.iter().skip(i % width).step_by(width).sum::<f32>() / 101.0;
        assert!((new - mean).abs() < 1e-5, "{new} {mean}");
    }
}

#[test]
fn more_rows_than_the_vocabulary_has_are_refused() {
    let mut place = Place::new();
    let (shape, values) = place.tensor("t5", "shared.weight");
    shape[0] += 1;
    values.extend([0.0; 26]);
    place.refused(&["--new-rows", "mean"], "`shared.weight`: expected [1182, 26], got [1183, 26]");
}

#[test]
fn old_names_shards_and_a_checkpoint_of_everything_give_the_same() {
    let first = Place::new().convert(&["--dtype", "f32"]);
    let mut place = Place::new();
    place.rename("hubert", |name| {
        let old = name.replace("parametrizations.weight.original0", "weight_g");
        format!("hubert.{}", old.replace("parametrizations.weight.original1", "weight_v"))
    });
    place.rename("t5", |name| format!("lm.language_model.{name}"));
    let mut all = place.files.remove("t5").unwrap();
    for (part, theirs) in
        [("face", "face"), ("hands", "hand"), ("upper", "upper"), ("lower", "lower"), ("root", "global")]
    {
        place.rename(part, |name| format!("vae_{theirs}.{name}"));
        all.extend(place.files.remove(part).unwrap());
    }
    let table = all["lm.language_model.shared.weight"].clone();
    all.insert("lm.language_model.encoder.embed_tokens.weight".to_owned(), table);
    all.insert("smplx.v_template".to_owned(), (vec![1], vec![0.0]));
    // In two shards of one folder, passed both as the T5 and as the codecs.
    std::fs::create_dir(place.path("lom")).unwrap();
    let half = all.split_off(&all.keys().nth(all.len() / 2).unwrap().clone());
    write(&place.path("lom/model-1.safetensors"), &all);
    write(&place.path("lom/model-2.safetensors"), &half);
    let second = place.convert(&["--dtype", "f32", "--t5", "lom", "--vq", "lom"]);
    for spec in layout::specs(first.config(), false) {
        let (a, b) = (values(&first, &spec.name, &spec.shape), values(&second, &spec.name, &spec.shape));
        assert_eq!(a, b, "{}", spec.name);
    }
}

#[test]
fn missing_unknown_and_misshapen_tensors_are_listed_together() {
    let mut place = Place::new();
    let t5 = place.files.get_mut("t5").unwrap();
    t5.remove("encoder.block.0.layer.1.DenseReluDense.wo.weight");
    t5.insert("encoder.adapter.weight".to_owned(), (vec![1], vec![0.0]));
    place.tensor("upper", "decoder.main.2.weight").0 = vec![18, 9, 6];
    let said = place.run(&[], 2);
    for wanted in [
        "tensor `lm.encoder.block.0.layer.1.DenseReluDense.wo.weight`: missing from the sources",
        "t5.safetensors: tensor `encoder.adapter.weight`: the config asks for no such tensor",
        "upper.safetensors: tensor `decoder.main.2.weight`: expected [18, 18, 3], got [18, 9, 6]",
    ] {
        assert_eq!(said.matches(wanted).count(), 1, "{said}");
    }
}

#[test]
fn a_table_that_does_not_repeat_is_refused() {
    let mut place = Place::new();
    let mut table = place.tensor("t5", "shared.weight").clone();
    table.1[7] += 1.0;
    place.files.get_mut("t5").unwrap().insert("decoder.embed_tokens.weight".to_owned(), table);
    place.refused(&[], "`decoder.embed_tokens.weight`: differs from the shared table");
}

#[test]
fn codecs_that_are_there_twice_or_of_no_part_are_refused() {
    let mut place = Place::new();
    let face = place.files["face"].clone();
    place.files.insert("other".to_owned(), face);
    place.refused(&[], "other.safetensors: tensor `decoder.main.0.model.0.bias`: the same is in face.safetensors");
    let last = "decoder.main.6.bias";
    place.files.remove("other");
    *place.tensor("face", last) = (vec![9], vec![0.0; 9]);
    place.refused(&[], "face.safetensors: a codec of 9 channels, where the config has face 16, hands 180");
    place.files.insert("face".to_owned(), BTreeMap::from([("weight".to_owned(), (vec![1], vec![0.0]))]));
    place.refused(&[], "face.safetensors: no motion codec in it");
}

#[test]
fn values_that_are_no_numbers_or_too_large_are_refused() {
    let mut place = Place::new();
    place.tensor("t5", "shared.weight").1[3] = f16::MAX.to_f32() * 2.0;
    place.refused(&["--dtype", "f16"], "tensor `lm.shared.weight`: 131008 is beyond F16");
    place.tensor("t5", "shared.weight").1[3] = f32::NAN;
    place.refused(&[], "t5.safetensors: tensor `shared.weight`: NaN among the values");
}

#[test]
fn files_that_are_not_whole_or_not_safetensors_are_refused() {
    let place = Place::new();
    place.run(&[], 0);
    std::fs::remove_file(place.path("model")).unwrap();
    let bytes = std::fs::read(place.path("root.safetensors")).unwrap();
    std::fs::write(place.path("cut.safetensors"), &bytes[..bytes.len() - 1]).unwrap();
    std::fs::write(place.path("text.safetensors"), "version https://git-lfs.github.com/spec/v1").unwrap();
    std::fs::create_dir(place.path("empty")).unwrap();
    place.refused(&["--vq", "cut.safetensors"], "cut.safetensors: expected");
    place.refused(&["--vq", "text.safetensors"], "text.safetensors: no safetensors file");
    place.refused(&["--vq", "empty"], "empty: no .safetensors in it");
    place.refused(&["--vq", "gone.safetensors"], "gone.safetensors: ");
}

#[test]
fn a_config_that_cannot_be_converted_to_is_refused() {
    let mut place = Place::new();
    let whole = place.config.clone();
    place.config["lm"]["d_model"] = 0.into();
    place.refused(&[], "config.json: config `lm.d_model`");
    place.config = whole;
    place.config["audio"]["kind"] = "mel".into();
    place.config["audio"]["mel"] =
        serde_json::json!({"window": 400, "fft": 512, "bands": 4, "floor": 1e-6, "deltas": 0});
    place.config["audio"].as_object_mut().unwrap().remove("hubert");
    place.refused(&[], "config.json: config `audio.kind`: expected \"hubert\"");
}

#[test]
fn a_model_of_layout_frames_is_converted() {
    let mut place = Place::frames();
    place.refused(&[], "a codec of 90 channels may be of hand_left or hand_right: put the part's name before");
    place.rename("hand_left", |name| format!("hand_left.{name}"));
    place.rename("hand_right", |name| format!("vq.hand_right.{name}"));
    let file = place.convert(&["--dtype", "f32"]);
    assert!(file.config().is_frames() && file.config().codes_per_keyframe() == 16);
    let mut checked = 0;
    for spec in layout::specs(file.config(), false) {
        let folded = spec.name.contains("pos_conv_embed.conv.weight");
        if spec.kind == Kind::Router || spec.name.contains(".experts.") || folded {
            continue;
        }
        let (source, name) = published(&spec.name).unwrap();
        let tensors = &place.files[&source];
        let named = [name.clone(), format!("{source}.{name}"), format!("vq.{source}.{name}")];
        let wanted = named.iter().find_map(|name| tensors.get(name)).unwrap();
        assert_eq!(values(&file, &spec.name, &spec.shape), wanted.1, "{}", spec.name);
        checked += 1;
    }
    assert!(checked > 100, "{checked}");
    // The model animates.
    let wav = Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/hello.wav");
    let mut command = Command::new(env!("CARGO_BIN_EXE_umo"));
    command.arg("animate").arg(wav).args(["--model", "model", "-o", "out.npz"]);
    assert!(command.current_dir(place.folder.path()).output().unwrap().status.success());
    // On Windows an open file cannot be removed.
    drop(file);
    std::fs::remove_file(place.path("model")).unwrap();
    place.files.remove("depth").unwrap();
    let said = place.run(&[], 2);
    assert!(said.contains("tensor `depth.input.weight`: missing from the sources"), "{said}");
    place.files.insert("depth".to_owned(), BTreeMap::from([("weight".to_owned(), (vec![1], vec![0.0]))]));
    place.refused(&[], "depth.safetensors: no depth network in it");
}

#[test]
fn text_vocabulary_is_converted() {
    let place = Place::new();
    std::fs::write(place.path("spiece.model"), b"pieces").unwrap();
    let file = place.convert(&["--tokenizer", "spiece.model"]);
    assert_eq!(file.raw("text.tokenizer").unwrap(), b"pieces");
}
