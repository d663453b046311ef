//! Errors due to int8: the numbers of `docs/quantization.md`.
//!
//! ```text
//! quantization errors MODEL               error of weights and products, per kind of tensor, int8 and bf16
//! quantization plant MODEL OUT            the same function with outlier channels in every feed-forward of T5
//! quantization agreement REFERENCE MODEL… hidden states, logits and codes compared with the first model
//! quantization units REFERENCE MODEL… WAV units compared with the first model
//! ```

#![expect(clippy::cast_precision_loss, reason = "counts are far below 2^52")]
#![expect(clippy::cast_possible_truncation, reason = "ids and codes are small, and errors need no f64 to be printed")]

use std::collections::BTreeMap;
use std::error::Error;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;
use std::sync::Arc;

use umo_benches::Random;
use umo_core::{Compute, Config, ModelFile, Part, PerPart, Precision, Sampler, Team};
use umo_core_model::audio::{Tokenizer, resample};
use umo_core_model::lm::decoder::Sequence;
use umo_core_model::lm::generate::{ChunkSampling, Generator, Heads};
use umo_core_model::lm::layout::{Prompt, Template, window_tokens};
use umo_core_model::lm::{Lengths, Lm, LmScratch};
use umo_core_model::weights::Loader;
use umo_core_model::weights::layout::{self, Kind, Spec};
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};
use umo_kernels::quantize::quantize_weight_row;
use umo_kernels::{Bf16, Mat};

type Done = Result<(), Box<dyn Error>>;

/// Number of outlier channels per feed-forward, and their size relative to the others.
const OUTLIERS: usize = 4;
const FACTOR: f32 = 64.0;

fn main() -> Done {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let args: Vec<&str> = args.iter().map(String::as_str).collect();
    match args.as_slice() {
        ["errors", model] => errors(&open(model)?),
        ["plant", model, out] => plant(&open(model)?, out),
        ["agreement", models @ ..] if !models.is_empty() => agreement(models),
        ["units", models @ .., wav] if !models.is_empty() => units(models, wav),
        _ => Err("usage: quantization errors|plant|agreement|units …, see the top of its source".into()),
    }
}

fn open(path: &str) -> Result<ModelFile, String> {
    ModelFile::open(Path::new(path)).map_err(|error| format!("{path}: {error}"))
}

/// Root mean square of `a - b` relative to that of `a`.
fn relative(pairs: impl Iterator<Item = (f64, f64)>) -> f64 {
    let (error, size) = pairs.fold((0.0, 0.0), |(e, s), (a, b)| (e + (a - b) * (a - b), s + a * a));
    (error / f64::max(size, f64::MIN_POSITIVE)).sqrt()
}

/// Squared errors of one kind of tensor, summed over its tensors.
#[derive(Default)]
struct Kinds {
    tensors: usize,
    /// Weights in bf16 and int8, then products with bf16 weights, int8 weights, int8 both, int8
    /// both with outliers.
    errors: [f64; 6],
}

/// Row of the table for a tensor: its name without numbers.
fn kind(name: &str) -> String {
    let words: Vec<&str> = name.split('.').filter(|word| word.parse::<usize>().is_err()).collect();
    words.join(".").replace(".weight", "").replace("layer.", "").replace("block.", "")
}

/// Prints the table of errors per kind of product; a sample of each tensor's rows stands for all.
fn errors(file: &ModelFile) -> Done {
    const ROWS: usize = 48;
    const INPUTS: usize = 16;
    let mut table: BTreeMap<String, Kinds> = BTreeMap::new();
    for (i, spec) in layout::specs(file.config(), true).iter().enumerate() {
        if spec.kind != Kind::Product || !file.has(&spec.name) {
            continue;
        }
        let (tensor, k) = (file.tensor(&spec.name, &spec.shape)?, spec.inputs());
        let mut random = Random::new(i as u64);
        let rows = tensor.rows().min(ROWS);
        let mut exact = vec![0.0; rows * k];
        for (row, values) in exact.chunks_exact_mut(k).enumerate() {
            tensor.read_row(row * tensor.rows() / rows, values)?;
        }
        let bf16: Vec<f32> = exact.iter().map(|&v| Bf16::from_f32(v).to_f32()).collect();
        let int8 = rounded(&exact, k)?;
        let gated = spec.name.ends_with(".wo.weight");
        let x: Vec<f32> = (0..INPUTS * k).map(|_| input(&mut random, gated)).collect();
        let mut planted = x.clone();
        for channel in (0..OUTLIERS).map(|i| (2 * i + 1) * k / (2 * OUTLIERS)) {
            planted.iter_mut().skip(channel).step_by(k).for_each(|v| *v *= FACTOR);
        }
        let y = products(&x, &exact, k);
        let error = |x: &[f32], w: &[f32]| relative(y.iter().copied().zip(products(x, w, k)));
        let weights = |w: &[f32]| relative(exact.iter().zip(w).map(|(&a, &b)| (f64::from(a), f64::from(b))));
        // The weights that read the outliers are smaller by the same factor, so that the product is the same.
        let mut unplanted = exact.clone();
        for channel in (0..OUTLIERS).map(|i| (2 * i + 1) * k / (2 * OUTLIERS)) {
            unplanted.iter_mut().skip(channel).step_by(k).for_each(|v| *v /= FACTOR);
        }
        let found = [
            weights(&bf16),
            weights(&int8),
            error(&x, &bf16),
            error(&x, &int8),
            error(&rounded(&x, k)?, &int8),
            error(&rounded(&planted, k)?, &rounded(&unplanted, k)?),
        ];
        let entry = table.entry(kind(&spec.name)).or_default();
        entry.tensors += 1;
        entry.errors.iter_mut().zip(found).for_each(|(sum, v)| *sum += v * v);
    }
    println!(
        "| tensors | of them | weights bf16 | weights int8 | product, weights bf16 | … int8 | … and input int8 | … with outliers |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for (name, Kinds { tensors, errors }) in table {
        let cells: Vec<String> =
            errors.iter().map(|sum| format!("{:.2} %", 100.0 * (sum / tensors as f64).sqrt())).collect();
        println!("| `{name}` | {tensors} | {} |", cells.join(" | "));
    }
    Ok(())
}

/// A random input of a product: normalised rows, or for the down product of a gated feed-forward, products
/// of two such numbers.
fn input(random: &mut Random, gated: bool) -> f32 {
    if !gated {
        return random.normal();
    }
    let gate = random.normal();
    0.5 * gate * (1.0 + (0.797_884_6 * (gate + 0.044_715 * gate * gate * gate)).tanh()) * random.normal()
}

/// Rows rounded to int8 codes and back.
fn rounded(values: &[f32], k: usize) -> Result<Vec<f32>, Box<dyn Error>> {
    let mut steps = vec![0; k];
    let mut out = Vec::with_capacity(values.len());
    for row in values.chunks_exact(k) {
        let scale = quantize_weight_row(row, &mut steps)?;
        out.extend(steps.iter().map(|&step| f32::from(step) * scale));
    }
    Ok(out)
}

fn products(x: &[f32], w: &[f32], k: usize) -> Vec<f64> {
    let dot = |x: &[f32], w: &[f32]| x.iter().zip(w).map(|(&x, &w)| f64::from(x) * f64::from(w)).sum();
    x.chunks_exact(k).flat_map(|x| w.chunks_exact(k).map(move |w| dot(x, w))).collect()
}

/// Writes a model whose feed-forwards have a few hidden channels [`FACTOR`] times as large, and
/// the weights behind them smaller by the same factor, a power of two, so that in f32 it is the same
/// function.
fn plant(file: &ModelFile, out: &str) -> Done {
    let specs = layout::specs(file.config(), true);
    let tensor = |spec: &Spec| -> Result<NewTensor, Box<dyn Error>> {
        let (name, shape) = (spec.name.clone(), spec.shape.clone());
        let read = move || {
            let io = std::io::Error::other::<umo_core::LoadError>;
            let tensor = file.tensor(&name, &shape).map_err(io)?;
            let mut values = vec![0.0; shape.iter().product()];
            tensor.read(&mut values).map_err(io)?;
            file.release(&tensor);
            planted(&name, &shape, &mut values);
            Ok(values)
        };
        let storage = file.storage(&spec.name)?;
        let values = Values::Floats(Box::new(read));
        Ok(NewTensor { name: spec.name.clone(), shape: spec.shape.clone(), storage, values })
    };
    let mut tensors = specs.iter().filter(|spec| file.has(&spec.name)).map(tensor).collect::<Result<Vec<_>, _>>()?;
    if let Ok(bytes) = file.raw("text.tokenizer") {
        let (name, shape) = ("text.tokenizer".to_owned(), vec![bytes.len()]);
        tensors.push(NewTensor { name, shape, storage: Storage::Bytes, values: Values::Bytes(bytes) });
    }
    writer::write(&mut BufWriter::new(File::create(out)?), file.config(), &tensors)?;
    Ok(())
}

fn planted(name: &str, shape: &[usize], values: &mut [f32]) {
    let channels = |width: usize| (0..OUTLIERS).map(move |i| (2 * i + 1) * width / (2 * OUTLIERS));
    if name.ends_with(".wi_1.weight") {
        for channel in channels(shape[0]) {
            values[channel * shape[1]..(channel + 1) * shape[1]].iter_mut().for_each(|v| *v *= FACTOR);
        }
    } else if name.ends_with(".wo.weight") {
        for channel in channels(shape[1]) {
            values.iter_mut().skip(channel).step_by(shape[1]).for_each(|v| *v /= FACTOR);
        }
    }
}

/// Outputs of one model for the prompts.
#[derive(Clone)]
struct Answers {
    /// Encoder states.
    hidden: Vec<f32>,
    /// Logits under teacher forcing, `[positions, codes]`.
    logits: Vec<f32>,
    /// Codes of greedy decoding.
    codes: Vec<u16>,
}

/// Number of prompts of random units and codes, the same for every model.
const PROMPTS: u64 = 12;

/// Prints the differences of models from the first.
fn agreement(models: &[&str]) -> Done {
    let team = Team::new(2)?;
    println!(
        "| model | bytes | encoder states | logits | likeliest code, forced | codes, free | until the first other |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut reference: Option<Answers> = None;
    for (i, model) in models.iter().enumerate() {
        // The reference in full precision, the others in their stored types.
        let (model, precision) = match model.rsplit_once(':') {
            Some((model, "int8")) => (model, Precision::Int8),
            Some((model, "bf16")) => (model, Precision::Bf16),
            _ => (*model, if i == 0 { Precision::F32 } else { Precision::Stored }),
        };
        let file = open(model)?;
        let loader = Loader::new(&file, precision, umo_benches::isa());
        let config = file.config();
        let answers = answer(&loader, &team)?;
        let name = Path::new(model).file_stem().unwrap_or_default().display();
        let first = reference.get_or_insert_with(|| answers.clone());
        let error = |a: &[f32], b: &[f32]| relative(a.iter().zip(b).map(|(&a, &b)| (f64::from(a), f64::from(b))));
        let rows = |a: &[f32]| a.chunks_exact(config.vq.codes).map(best).collect::<Vec<_>>();
        let (forced, free) = (share(&rows(&first.logits), &rows(&answers.logits)), share(&first.codes, &answers.codes));
        let chunk = answers.codes.len() / PROMPTS as usize;
        let same = first.codes.chunks_exact(chunk).zip(answers.codes.chunks_exact(chunk));
        let until: usize = same.map(|(a, b)| a.iter().zip(b).take_while(|(a, b)| a == b).count()).sum();
        println!(
            "| {name} ({}) | {} | {:.2} % | {:.2} % | {forced:.1} % | {free:.1} % | {:.1} of {chunk} |",
            precision.name(),
            file.len(),
            100.0 * error(&first.hidden, &answers.hidden),
            100.0 * error(&first.logits, &answers.logits),
            until as f64 / PROMPTS as f64,
        );
    }
    Ok(())
}

/// Index of the largest value.
fn best(values: &[f32]) -> usize {
    (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or_default()
}

/// Percentage of equal entries.
fn share<T: PartialEq>(a: &[T], b: &[T]) -> f64 {
    100.0 * a.iter().zip(b).filter(|(a, b)| a == b).count() as f64 / a.len().max(1) as f64
}

fn answer(loader: &Loader, team: &Team) -> Result<Answers, Box<dyn Error>> {
    let (config, cx) = (loader.file().config(), Compute { isa: umo_benches::isa(), team });
    let lengths = Lengths::of(config);
    let lm = Lm::load(loader, lengths)?;
    let mut scratch = LmScratch::new(config, lengths.encoder.max(lengths.decoder));
    let mut sequence = Sequence::new(config, lengths, lm.cross_storage());
    let heads = Arc::new(Heads::load(loader)?);
    let mut generator = Generator::new(config, Arc::clone(&heads));
    let mut answers = Answers { hidden: Vec::new(), logits: Vec::new(), codes: Vec::new() };
    for prompt in 0..PROMPTS {
        let mut random = Random::new(1000 + prompt);
        let ids = prompt_ids(config, &mut random)?;
        let mut hidden = vec![0.0; ids.len() * lm.d_model()];
        lm.encode(cx, &mut scratch, &ids, &[ids.len()], &mut hidden)?;
        let states = Mat::new(&hidden, ids.len(), lm.d_model())?;

        lm.attend_to(cx, &mut scratch, states, &mut sequence)?;
        let (forced, rows) = forced_ids(config, &mut random);
        sequence.set_ids(&forced)?;
        lm.decode(cx, &mut scratch, std::slice::from_mut(&mut sequence))?;
        let mut logits = vec![0.0; config.vq.codes];
        for (part, row) in rows {
            heads.logits(cx, &mut scratch, row, part, &mut logits)?;
            answers.logits.extend_from_slice(&logits);
        }

        let mut codes = vec![0; config.target * Part::ALL.len()];
        let draw = ChunkSampling { sampler: Sampler::GREEDY, chunk: prompt, target: config.target };
        generator.generate(cx, &lm, &mut scratch, states, &mut sequence, draw, &mut codes)?;
        let of = |part: Part| codes.iter().skip(part as usize).step_by(Part::ALL.len());
        Part::ALL.into_iter().for_each(|part| answers.codes.extend(of(part)));
        answers.hidden.append(&mut hidden);
    }
    Ok(answers)
}

/// The encoder's ids of a random window and history.
fn prompt_ids(config: &Config, random: &mut Random) -> Result<Vec<u32>, Box<dyn Error>> {
    let units: Vec<u32> =
        (0..window_tokens(config, config.target)).map(|_| random.below(config.audio.units) as u32).collect();
    let history =
        PerPart::from_fn(|_| (0..config.prefix).map(|_| random.below(config.vq.codes) as u16).collect::<Vec<_>>());
    let rows = (0..config.prefix).flat_map(|keyframe| Part::ALL.map(|part| history[part][keyframe]));
    let history: Vec<u16> = rows.collect();
    let prompt = Prompt { units: &units, history: &history, ..Default::default() };
    let mut ids = vec![0; Lengths::of(config).encoder];
    let len = Template::new(config, "audio_to_motion")?.write(&prompt, &mut ids)?;
    ids.truncate(len);
    Ok(ids)
}

/// Random codes with their markers, and the rows that predict a code.
fn forced_ids(config: &Config, random: &mut Random) -> (Vec<u32>, Vec<(Part, usize)>) {
    let (mut ids, mut rows) = (vec![config.vocab.decoder_start as u32], Vec::new());
    for part in Part::ALL {
        let m = config.vocab[part];
        ids.push(m.start as u32);
        for _ in 0..config.target {
            rows.push((part, ids.len() - 1));
            ids.push((m.first + random.below(m.codes)) as u32);
        }
        ids.push(m.end as u32);
    }
    (ids, rows)
}

/// Prints the number of audio units of a recording that differ from the first model's.
fn units(models: &[&str], wav: &str) -> Done {
    let wav = umo_audio_file::read(Path::new(wav))?;
    let team = Team::new(2)?;
    let mut first: Option<(Vec<f32>, Vec<u32>)> = None;
    println!("| model | features | units |");
    println!("| --- | --- | --- |");
    for model in models {
        let file = open(model)?;
        let tokenizer = Tokenizer::load(&Loader::new(&file, Precision::Stored, umo_benches::isa()))?;
        let samples = resample::to_rate(&wav.mono(), wav.sample_rate as usize, file.config().audio.sample_rate)?;
        let (features, units) = tokenizer.features(Compute { isa: umo_benches::isa(), team: &team }, &samples)?;
        let name = Path::new(model).file_stem().unwrap_or_default().display();
        let (f, u) = first.get_or_insert_with(|| (features.clone(), units.clone()));
        let error = relative(f.iter().zip(&features).map(|(&a, &b)| (f64::from(a), f64::from(b))));
        println!("| {name} | {:.2} % | {:.1} % |", 100.0 * error, share(u, &units));
    }
    Ok(())
}
