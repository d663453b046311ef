//! Audio tokenizers on streams: results that must be equal, and conditions that must not change a bit.

use std::path::PathBuf;

use umo_core::{Compute, ModelFile, Precision, StepError, Team};
use umo_core_model::audio::{AudioStream, Tokenizer};
use umo_core_model::config::Hubert;
use umo_core_model::weights::writer::{self, NewTensor, Storage, Values};
use umo_core_model::weights::{Loader, layout};
use umo_kernels::{Isa, ShapeError};

const HOP: usize = 320;
const REACH: usize = 80;
const MODELS: [&str; 4] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k2_arkit", "mel_k1_upcycled"];

fn open(model: &str) -> ModelFile {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden").join(model);
    ModelFile::open(&folder.join("model.safetensors")).unwrap()
}

fn load(file: &ModelFile) -> Tokenizer {
    Tokenizer::load(&Loader::new(file, Precision::F32, Isa::detect())).unwrap()
}

/// HuBERT quantized like a base model: layers and two convolutions in int8, the others in
/// bfloat16, for which tiles round the inputs.
fn quantized() -> ModelFile {
    let file = open("hubert_k1_smplx");
    let specs = layout::specs(file.config(), true);
    let tensors = specs.iter().filter(|spec| file.has(&spec.name)).map(|spec| {
        let read = || {
            let mut values = vec![0.0; spec.shape.iter().product()];
            file.tensor(&spec.name, &spec.shape).unwrap().read(&mut values).unwrap();
            Ok(values)
        };
        let storage = match spec.shape.len() {
            2 if spec.name.starts_with("audio.hubert.encoder.layers") => Storage::Int8,
            3 if ["1.conv.weight", "2.conv.weight"].iter().any(|end| spec.name.ends_with(end)) => Storage::Int8,
            3 if spec.name.starts_with("audio.hubert") => Storage::Bf16,
            _ => Storage::F32,
        };
        NewTensor {
            name: spec.name.clone(),
            shape: spec.shape.clone(),
            storage,
            values: Values::Floats(Box::new(read)),
        }
    });
    let mut bytes = Vec::new();
    writer::write(&mut std::io::Cursor::new(&mut bytes), file.config(), &tensors.collect::<Vec<_>>()).unwrap();
    ModelFile::from_bytes(bytes).unwrap()
}

/// Tokenizers of every kind, in float and as [`quantized`].
fn tokenizers() -> impl Iterator<Item = (&'static str, Tokenizer)> {
    let stored = Tokenizer::load(&Loader::new(&quantized(), Precision::Stored, Isa::detect())).unwrap();
    MODELS.into_iter().map(|model| (model, load(&open(model)))).chain([("quantized hubert_k1_smplx", stored)])
}

/// Two drifting tones over noise, with an offset; loudness changes, so that statistics do too.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
fn audio(samples: usize) -> Vec<f32> {
    let mut state = 12345_u32;
    let mut sample = |i: usize| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let noise = f64::from(state >> 8) / f64::from(1 << 24) - 0.5;
        let t = i as f64 / 16000.0;
        let voice = (900.0 * t + 40.0 * (5.0 * t).sin()).sin() + 0.4 * (5100.0 * t).sin();
        (0.02 + 0.25 * (0.2 + t.fract()) * voice + 0.02 * noise) as f32
    };
    (0..samples).map(&mut sample).collect()
}

/// Units and features of one stream after each chunk of `hops` hops.
fn run(
    tokenizer: &Tokenizer,
    threads: usize,
    stream: &mut AudioStream,
    audio: &[f32],
    hops: &[usize],
) -> Vec<(Vec<u32>, Vec<f32>)> {
    let team = Team::new(threads).unwrap();
    let cx = Compute { isa: Isa::detect(), team: &team };
    let mut scratch = tokenizer.scratch(stream.window(), 40);
    let mut units = vec![0; stream.window()];
    let mut start = 0;
    let chunk = |&hops: &usize| {
        let samples = &audio[start..start + hops * HOP];
        tokenizer.advance(cx, stream, &mut scratch, samples, &mut units).unwrap();
        start += samples.len();
        (units.clone(), stream.features().to_vec())
    };
    hops.iter().map(chunk).collect()
}

/// `erf` by its power series, exact to 1e-8 in the range used.
fn erf(x: f64) -> f64 {
    if x.abs() > 4.0 {
        return x.signum();
    }
    let (mut term, mut sum) = (x, x);
    for n in 1..120 {
        term *= -x * x / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    sum * 2.0 / std::f64::consts::PI.sqrt()
}

/// HuBERT up to the projection, in f64, directly from its definition.
struct Definition {
    sizes: Hubert,
    convolutions: Vec<Box<[f32]>>,
    group_norm: [Box<[f32]>; 2],
    norm: [Box<[f32]>; 2],
    projection: [Box<[f32]>; 2],
}

type Rows = Vec<Vec<f64>>;

impl Definition {
    fn load(file: &ModelFile) -> Self {
        let sizes = file.config().audio.hubert.clone().unwrap();
        let loader = Loader::new(file, Precision::F32, Isa::SCALAR);
        let get = |name: String, shape: &[usize]| loader.values(&format!("audio.hubert.{name}"), shape).unwrap();
        let affine = |name: &str, width: usize| ["weight", "bias"].map(|kind| get(format!("{name}.{kind}"), &[width]));
        let mut channels = 1;
        let mut convolutions = Vec::new();
        for (i, (&dim, &kernel)) in sizes.conv_dim.iter().zip(&sizes.conv_kernel).enumerate() {
            let name = format!("feature_extractor.conv_layers.{i}.conv.weight");
            convolutions.push(get(name, &[dim, channels, kernel]));
            channels = dim;
        }
        let hidden = sizes.hidden_size;
        Self {
            convolutions,
            group_norm: affine("feature_extractor.conv_layers.0.layer_norm", sizes.conv_dim[0]),
            norm: affine("feature_projection.layer_norm", channels),
            projection: [
                get("feature_projection.projection.weight".to_owned(), &[hidden, channels]),
                get("feature_projection.projection.bias".to_owned(), &[hidden]),
            ],
            sizes,
        }
    }

    fn convolve(&self, layer: usize, x: &Rows) -> Rows {
        let (kernel, stride) = (self.sizes.conv_kernel[layer], self.sizes.conv_stride[layer]);
        let channels = x[0].len();
        let windows = x.windows(kernel).step_by(stride);
        let output = |window: &[Vec<f64>], weight: &[f32]| -> f64 {
            let at = |(i, &w): (usize, &f32)| window[i % kernel][i / kernel] * f64::from(w);
            weight.iter().enumerate().map(at).sum()
        };
        let weights = &self.convolutions[layer];
        windows.map(|w| weights.chunks_exact(channels * kernel).map(|weight| output(w, weight)).collect()).collect()
    }

    /// Features at the indices `features`, under the statistics of all of `heard`.
    fn features(&self, heard: &[f32], features: std::ops::Range<i64>) -> Rows {
        let count = heard.len() as f64;
        let mean = heard.iter().map(|&v| f64::from(v)).sum::<f64>() / count;
        let variance = heard.iter().map(|&v| (f64::from(v) - mean).powi(2)).sum::<f64>() / count;
        let normalise = |v: f32| match self.sizes.do_normalize {
            true => (f64::from(v) - mean) / (variance + 1e-7).sqrt(),
            false => f64::from(v),
        };
        let wave: Rows = heard.iter().map(|&v| vec![normalise(v)]).collect();
        let first = self.convolve(0, &wave);
        let affine: Vec<[f64; 2]> = (0..first[0].len())
            .map(|c| {
                let mean = first.iter().map(|row| row[c]).sum::<f64>() / first.len() as f64;
                let variance = first.iter().map(|row| (row[c] - mean).powi(2)).sum::<f64>() / first.len() as f64;
                let factor = f64::from(self.group_norm[0][c]) / (variance + 1e-5).sqrt();
                [factor, f64::from(self.group_norm[1][c]) - mean * factor]
            })
            .collect();
        let gelu = |v: f64| v * (1.0 + erf(v / std::f64::consts::SQRT_2)) / 2.0;
        let feature = |j: i64| {
            let start = HOP as i64 * j - REACH as i64;
            let sample = |i: i64| usize::try_from(start + i).map_or(vec![0.0], |i| wave[i].clone());
            let mut x = self.convolve(0, &(0..(HOP + REACH) as i64).map(sample).collect());
            for row in &mut x {
                row.iter_mut().zip(&affine).for_each(|(v, [factor, shift])| *v = gelu(*v * factor + shift));
            }
            for layer in 1..self.convolutions.len() {
                x = self.convolve(layer, &x);
                x.iter_mut().flatten().for_each(|v| *v = gelu(*v));
            }
            assert_eq!(x.len(), 1);
            self.project(&x[0])
        };
        features.map(feature).collect()
    }

    fn project(&self, x: &[f64]) -> Vec<f64> {
        let mean = x.iter().sum::<f64>() / x.len() as f64;
        let variance = x.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / x.len() as f64;
        let deviation = (variance + f64::from(self.sizes.layer_norm_eps)).sqrt();
        let [weight, bias] = &self.norm;
        let affine = |i: usize| (x[i] - mean) / deviation * f64::from(weight[i]) + f64::from(bias[i]);
        let normed: Vec<f64> = (0..x.len()).map(affine).collect();
        let [weight, bias] = &self.projection;
        let output = |(row, &bias): (&[f32], &f32)| {
            row.iter().zip(&normed).map(|(&w, x)| f64::from(w) * x).sum::<f64>() + f64::from(bias)
        };
        weight.chunks_exact(x.len()).zip(bias).map(output).collect()
    }
}

/// Each chunk's features use the statistics up to that chunk's end; silence before the start
/// uses the first chunk's.
#[test]
fn hubert_features_are_those_of_the_definition() {
    for model in ["hubert_k1_smplx", "hubert_k3_i8"] {
        let file = open(model);
        let (tokenizer, definition) = (load(&file), Definition::load(&file));
        let (window, hops) = (15, [1, 7, 4, 9]);
        let audio = audio(21 * HOP);
        let states = run(&tokenizer, 2, &mut tokenizer.stream(window, 9), &audio, &hops);
        let mut expected = definition.features(&audio[..HOP], -(window as i64)..0);
        let (mut end, mut worst) = (0, 0.0_f64);
        for (hops, (_, features)) in hops.iter().zip(&states) {
            let heard = &audio[..(end + hops) * HOP];
            expected.extend(definition.features(heard, end as i64..(end + hops) as i64));
            end += hops;
            let wanted: Vec<f64> = expected[expected.len() - window..].concat();
            let largest = wanted.iter().fold(0.0_f64, |a, v| a.max(v.abs()));
            let error = features.iter().zip(&wanted).fold(0.0_f64, |a, (&x, y)| a.max((f64::from(x) - y).abs()));
            worst = worst.max(error / largest);
        }
        println!("{model} stream: largest error {worst:.2e}");
        assert!(worst < 2e-5, "{model}: error {worst}");
    }
}

/// A stream's mel features and units are those of the clip with the reach's silence before
/// it.
#[test]
fn mel_stream_equals_the_whole_clip() {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: Isa::detect(), team: &team };
    for model in ["mel_k2_arkit", "mel_k1_upcycled"] {
        let file = open(model);
        let tokenizer = load(&file);
        let (audio, width) = (audio(20 * HOP), tokenizer.width());
        let (features, units) = tokenizer.features(cx, &[vec![0.0; REACH], audio.clone()].concat()).unwrap();
        let states = run(&tokenizer, 1, &mut tokenizer.stream(30, 16), &audio, &[3, 1, 16]);
        let (last_units, last_features) = &states[2];
        assert_eq!(last_features[10 * width..], features, "{model}");
        assert_eq!(last_units[10..], units, "{model}");
        let silence = &last_features[..width];
        let floor = file.config().audio.mel.as_ref().unwrap().floor;
        let clip = tokenizer.features(cx, &[0.0; 400]).unwrap();
        assert_eq!(clip.0, silence, "{model}: floor {floor}");
        assert!(last_features[..10 * width].chunks(width).all(|row| row == silence), "{model}");
    }
}

#[test]
fn features_depend_on_chunk_ends_alone() {
    for (model, tokenizer) in tokenizers() {
        let (audio, width) = (audio(30 * HOP), tokenizer.width());
        let whole = run(&tokenizer, 1, &mut tokenizer.stream(30, 30), &audio, &[30]);
        for hops in [vec![25, 5], vec![1, 1, 27, 1], vec![10, 10, 10]] {
            let last = hops[hops.len() - 1] * width;
            let cut = run(&tokenizer, 1, &mut tokenizer.stream(30, 27), &audio, &hops);
            let (cut, whole) = (&cut[hops.len() - 1].1, &whole[0].1);
            assert_eq!(cut[cut.len() - last..], whole[whole.len() - last..], "{model} {hops:?}");
        }
    }
}

#[test]
fn the_same_chunks_give_the_same_bits_on_any_number_of_threads() {
    for (model, tokenizer) in tokenizers() {
        let audio = audio(75 * HOP);
        let mut stream = tokenizer.stream(60, 40);
        let hops = [20, 40, 5, 10];
        let first = run(&tokenizer, 1, &mut stream, &audio, &hops);
        for threads in [1, 2, 3] {
            stream.reset();
            assert!(run(&tokenizer, threads, &mut stream, &audio, &hops) == first, "{model}, {threads} threads");
        }
    }
}

#[test]
fn a_larger_and_used_scratch_changes_nothing() {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: Isa::detect(), team: &team };
    for (model, tokenizer) in tokenizers() {
        let audio = audio(30 * HOP);
        let wanted = run(&tokenizer, 1, &mut tokenizer.stream(12, 10), &audio, &[10])[0].0.clone();
        let (mut scratch, mut units) = (tokenizer.scratch(40, 30), vec![0; 40]);
        tokenizer.advance(cx, &mut tokenizer.stream(40, 30), &mut scratch, &audio, &mut units).unwrap();
        let mut stream = tokenizer.stream(12, 10);
        tokenizer.advance(cx, &mut stream, &mut scratch, &audio[..10 * HOP], &mut units[..12]).unwrap();
        assert_eq!(units[..12], wanted, "{model}");
    }
}

/// Convolutions with rounded inputs and attention with rounded factors, against sums without
/// rounding.
#[test]
fn quantized_features_are_near_on_every_back_end() {
    let (file, audio, team) = (quantized(), audio(60 * HOP), Team::new(2).unwrap());
    let features = |file: &ModelFile, precision, isa| {
        let tokenizer = Tokenizer::load(&Loader::new(file, precision, isa)).unwrap();
        tokenizer.features(Compute { isa, team: &team }, &audio).unwrap().0
    };
    let exact = features(&open("hubert_k1_smplx"), Precision::F32, Isa::SCALAR);
    let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v) * f64::from(v)).sum::<f64>();
    for isa in Isa::available() {
        let got = features(&file, Precision::Stored, isa);
        let mut differences = got.iter().zip(&exact).map(|(got, exact)| got - exact);
        let error = (squares(&mut differences) / squares(&mut exact.iter().copied())).sqrt();
        println!("{}: {:.2} %", isa.name(), 100.0 * error);
        assert!(error < 0.03, "{}: {error}", isa.name());
    }
}

#[test]
fn silence_and_a_constant_give_finite_features() {
    for (model, tokenizer) in tokenizers() {
        for level in [0.0, 0.5] {
            let states = run(&tokenizer, 1, &mut tokenizer.stream(8, 4), &[level; 8 * HOP], &[1, 3, 4]);
            assert!(states.iter().all(|(_, features)| features.iter().all(|v| v.is_finite())), "{model} {level}");
        }
    }
}

#[test]
fn advance_refuses_lengths_that_disagree() {
    let (file, other) = (open("hubert_k1_smplx"), open("mel_k1_upcycled"));
    let (tokenizer, other) = (load(&file), load(&other));
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: Isa::detect(), team: &team };
    let mut stream = tokenizer.stream(5, 2);
    let mut scratch = tokenizer.scratch(5, 2);
    let mut units = [0; 5];
    let mut call =
        |samples: &[f32], units: &mut [u32]| tokenizer.advance(cx, &mut stream, &mut scratch, samples, units);
    assert_eq!(call(&[], &mut units), Err(StepError::Empty("audio sample")));
    let ragged = ShapeError { arg: "samples", want: HOP, got: HOP + 1 };
    assert_eq!(call(&[0.0; HOP + 1], &mut units), Err(StepError::Shape(ragged)));
    let long = StepError::TooLong { what: "audio tokens of one call", got: 3, limit: 2 };
    assert_eq!(call(&[0.0; 3 * HOP], &mut units), Err(long));
    let few = ShapeError { arg: "units", want: 5, got: 4 };
    assert_eq!(call(&[0.0; HOP], &mut units[..4]), Err(StepError::Shape(few)));
    let wide = StepError::TooLong { what: "audio window", got: 6, limit: 5 };
    let mut wider = tokenizer.stream(6, 2);
    assert_eq!(tokenizer.advance(cx, &mut wider, &mut scratch, &[0.0; HOP], &mut [0; 6]), Err(wide));
    let result = other.advance(cx, &mut stream, &mut scratch, &[0.0; HOP], &mut units);
    assert!(matches!(result, Err(StepError::Order(_))), "{result:?}");
}

#[test]
fn features_refuse_less_audio_than_one_feature() {
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: Isa::SCALAR, team: &team };
    for model in ["hubert_k1_smplx", "mel_k1_upcycled"] {
        let tokenizer = Tokenizer::load(&Loader::new(&open(model), Precision::F32, Isa::SCALAR)).unwrap();
        assert_eq!(tokenizer.field(), 400);
        assert_eq!(tokenizer.features(cx, &[0.1; 399]), Err(StepError::Empty("audio feature")));
        assert_eq!(tokenizer.features(cx, &[0.1; 400]).unwrap().1.len(), 1);
    }
}
