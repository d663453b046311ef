//! Instruction sets that give the same results: the table in docs/spec.md, section 2.9, row by
//! row.

mod model_bytes;

use model_bytes::ModelBytes;
use umo_core::{Animation, AvatarConfig, Compute, FrameRef, Model, ModelFile, Part, Precision, Sampler, Team};
use umo_core_model::config::{AudioKind, PartSpec};
use umo_core_model::weights::Loader;
use umo_core_tools::stage::{self, Inputs, Options, Output, Stage, Values};
use umo_kernels::Isa;
use umo_tests::Noise;
use umo_tests::pages::{root, same_bits};

const GOLDEN: [&str; 6] =
    ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit", "frames_four", "frames_seven"];
const PRECISIONS: [Precision; 4] = [Precision::Stored, Precision::F32, Precision::Bf16, Precision::Int8];

/// The model whose depth network has int8 layers and bf16 products, with products computed as stored.
const MIXED: (&str, Precision) = ("umo-people", Precision::Stored);

/// The default model, and the models of the golden cases.
fn models() -> Vec<(&'static str, ModelFile)> {
    let default = ModelFile::open(&root().join("models/umo-people/model.safetensors")).unwrap();
    let golden = |name| (name, ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap());
    [("umo-people", default)].into_iter().chain(GOLDEN.map(golden)).collect()
}

/// The golden HuBERT with int8 layers and its position convolution in bf16; in the other models it is int8.
fn bf16_convolution() -> ModelFile {
    let mut model = ModelBytes::open("hubert_k3_i8");
    let stored = model.tensors.get_mut("audio.hubert.encoder.pos_conv_embed.conv.weight").unwrap();
    assert_eq!(stored.dtype, "F32");
    stored.bytes = stored.bytes.chunks_exact(4).flat_map(|value| [value[2], value[3]]).collect();
    stored.dtype = "BF16".to_owned();
    ModelFile::from_bytes(model.bytes()).unwrap()
}

/// Tones over noise, with silence between them.
#[expect(clippy::cast_precision_loss, reason = "a second has far fewer than 2^24 samples")]
fn audio(samples: usize) -> Vec<f32> {
    let mut noise = Noise::new(7);
    let tone = |i: usize| 0.3 * (0.05 * i as f32).sin();
    (0..samples).map(|i| if i % 5000 < 4000 { tone(i) + noise.float(0.05) } else { 0.0 }).collect()
}

/// All outputs in a second of frames.
fn frames(file: &ModelFile, precision: Precision, isa: Isa) -> Vec<u64> {
    let model = Model::load(file, precision, isa).unwrap();
    let mut animation = Animation::new(&model, &AvatarConfig::new(model.config())).unwrap();
    animation.push_audio(&audio(16_000)).unwrap();
    animation.finish(animation.frames_of_audio(model.config()));
    let team = Team::new(1).unwrap();
    let cx = Compute { isa, team: &team };
    let mut bits = vec![];
    let mut take = |frame: FrameRef| {
        bits.extend(frame.pose.rotations.as_flattened().iter().map(|value| u64::from(value.to_bits())));
        bits.extend(frame.pose.translation.iter().map(|value| u64::from(value.to_bits())));
        bits.extend(frame.face.iter().map(|value| u64::from(value.to_bits())));
        bits.extend(Part::ALL.iter().flat_map(|&part| frame.channels[part]).map(|value| u64::from(value.to_bits())));
    };
    while animation.step(&model, cx, &mut take).unwrap() {}
    assert!(bits.len() > 30 * 55 * 4);
    bits
}

/// All outputs of a stage.
fn staged(file: &ModelFile, precision: Precision, isa: Isa, stage: Stage, inputs: &[Output]) -> Vec<u64> {
    let bytes = stage::serialize(inputs).unwrap();
    let team = Team::new(1).unwrap();
    let options = Options { target: None, sampler: Sampler::GREEDY };
    let loader = Loader::new(file, precision, isa);
    let outputs = stage::run(stage, &loader, &team, &Inputs::new(&bytes, "").unwrap(), options).unwrap();
    let bits = |output: Output| match output.values {
        Values::Integers(values) => values.iter().map(|value| value.cast_unsigned()).collect::<Vec<_>>(),
        Values::Floats(values) => values.iter().map(|value| value.to_bits().into()).collect(),
    };
    outputs.into_iter().flat_map(bits).collect()
}

/// The features and units of a model.
fn features(file: &ModelFile, precision: Precision, isa: Isa) -> Vec<u64> {
    let audio = audio(16_000);
    let input = Output { name: "audio".to_owned(), shape: vec![audio.len()], values: Values::Floats(audio) };
    let stage = if file.config().audio.kind == AudioKind::Mel { Stage::Mel } else { Stage::Hubert };
    staged(file, precision, isa, stage, &[input])
}

fn integers(name: String, shape: &[usize], mut next: impl FnMut() -> usize) -> Output {
    let values = (0..shape.iter().product()).map(|_| i64::try_from(next()).unwrap()).collect();
    Output { name, shape: shape.to_vec(), values: Values::Integers(values) }
}

fn floats(name: String, shape: [usize; 2], noise: &mut Noise) -> Output {
    let values = (0..shape[0] * shape[1]).map(|_| noise.float(1.0)).collect();
    Output { name, shape: shape.to_vec(), values: Values::Floats(values) }
}

/// Codes `{group}.{part}` of every part in `count` frames or keyframes.
fn codes_of(file: &ModelFile, group: &str, count: usize) -> Vec<Output> {
    let mut noise = Noise::new(5);
    let codes = |part: PartSpec| {
        let shape = if file.config().is_frames() { vec![count, part.levels] } else { vec![count] };
        integers(format!("{group}.{}", part.name), &shape, || noise.below(part.codes))
    };
    file.config().part_list().into_iter().map(codes).collect()
}

/// Codes of every part.
fn codes(file: &ModelFile) -> Vec<Output> {
    codes_of(file, "codes", 40)
}

/// The decoder's states and the depth network's logits for fixed keyframes, and the vectors between
/// fixed ones.
fn frame_logits(file: &ModelFile, precision: Precision, isa: Isa) -> Vec<u64> {
    let (config, mut noise) = (file.config(), Noise::new(9));
    let ids: Vec<usize> = (0..30).map(|_| noise.below(config.vocab.size)).collect();
    let ids: Vec<usize> = ids.into_iter().chain((0..config.prefix).map(|k| config.vocab.size + k)).collect();
    let mut next = ids.iter().copied();
    let mut inputs = vec![integers("input_ids".to_owned(), &[ids.len()], || next.next().unwrap())];
    inputs.extend(codes_of(file, "history", config.prefix));
    inputs.extend(codes_of(file, "codes", 3));
    let mut bits = staged(file, precision, isa, Stage::Decoder, &inputs);
    let mut inputs = codes_of(file, "codes", 5);
    inputs.push(floats("hidden".to_owned(), [5, config.lm.d_model], &mut noise));
    let depth = config.depth.as_ref().unwrap();
    if depth.before {
        inputs.extend(codes_of(file, "before", 5));
    }
    for (name, token) in [("heard", depth.heard), ("body_heard", depth.body_heard)] {
        inputs.extend(token.map(|_| floats(name.to_owned(), [5, config.lm.d_model], &mut noise)));
    }
    bits.extend(staged(file, precision, isa, Stage::Depth, &inputs));
    let moving = config.part_list().into_iter().filter(|part| !part.is_annotation());
    let mut inputs: Vec<_> =
        moving.map(|part| floats(format!("vectors.{}", part.name), [19, part.width], &mut noise)).collect();
    let mut at = 0;
    inputs.push(integers("known".to_owned(), &[19], || {
        at += 1;
        usize::from(at % 6 == 1)
    }));
    bits.extend(staged(file, precision, isa, Stage::Interp, &inputs));
    bits
}

/// The language model's logits for fixed ids, and the interpolation network's for fixed
/// codes.
fn logits(file: &ModelFile, precision: Precision, isa: Isa) -> Vec<u64> {
    if file.config().is_frames() {
        return frame_logits(file, precision, isa);
    }
    let mut noise = Noise::new(9);
    let mut ids = |name: &str, count| integers(name.to_owned(), &[count], || noise.below(file.config().vocab.size));
    let ids = [ids("input_ids", 90), ids("decoder_input_ids", 12)];
    let mut bits = staged(file, precision, isa, Stage::Decoder, &ids);
    bits.extend(staged(file, precision, isa, Stage::Interp, &codes(file)));
    bits
}

/// The poses of fixed codes, which do not depend on the instruction set.
fn poses(file: &ModelFile, isa: Isa) -> Vec<u64> {
    staged(file, Precision::Int8, isa, Stage::Motion, &codes(file))
}

/// Compares the back-ends of each group with the group's first.
fn compare(what: &str, groups: &[Vec<Isa>], result: impl Fn(Isa) -> Vec<u64>) {
    for group in groups.iter().filter(|group| group.len() > 1) {
        let wanted = result(group[0]);
        for &isa in &group[1..] {
            assert!(result(isa) == wanted, "{what}: {} differs from {}", isa.name(), group[0].name());
        }
    }
}

#[test]
fn results_match_the_same_bits_table() {
    let mut rows = vec![];
    for (result, groups) in same_bits("result") {
        match &*result {
            "poses of given codes, layout `parts`, motion decoders in int8"
            | "poses of given codes, layout `frames`, motion decoders in int8" => {
                let layout = |file: &ModelFile| file.config().is_frames() == result.contains("frames");
                for (name, file) in models().into_iter().filter(|(_, file)| layout(file)) {
                    compare(&format!("{result}: {name}"), &groups, |isa| poses(&file, isa));
                }
            }
            "mel features and units" => {
                let mel = |file: &ModelFile| file.config().audio.kind == AudioKind::Mel;
                for (name, file) in models().into_iter().filter(|(_, file)| mel(file)) {
                    for precision in PRECISIONS {
                        let what = format!("{result}: {name}, {}", precision.name());
                        compare(&what, &groups, |isa| features(&file, precision, isa));
                    }
                }
            }
            "logits and frames, but for the two rows below" => {
                for (name, file) in models() {
                    for precision in PRECISIONS {
                        let what = format!("{result}: {name}, {}", precision.name());
                        if (name, precision) != MIXED {
                            compare(&what, &groups, |isa| logits(&file, precision, isa));
                            compare(&what, &groups, |isa| frames(&file, precision, isa));
                        }
                    }
                }
            }
            "logits and frames, depth network with int8 layers and bf16 products" => {
                let (_, file) = models().into_iter().find(|(name, _)| *name == MIXED.0).unwrap();
                compare(&result, &groups, |isa| logits(&file, MIXED.1, isa));
                compare(&result, &groups, |isa| frames(&file, MIXED.1, isa));
            }
            "features and frames, HuBERT with int8 layers and bf16 convolutions" => {
                let file = bf16_convolution();
                compare(&result, &groups, |isa| features(&file, Precision::Stored, isa));
                compare(&result, &groups, |isa| frames(&file, Precision::Stored, isa));
            }
            _ => panic!("no test of \"{result}\""),
        }
        rows.push(result);
    }
    assert_eq!(rows.len(), 6, "the table has one row for each result: {rows:?}");
}
