//! Invariants of the whole pipeline, audio in and poses out, for any weights, tested on the golden
//! models.

mod model_bytes;

use std::sync::LazyLock;

use model_bytes::ModelBytes;
use proptest::prelude::*;
use serde_json::json;
use umo_core::{
    Animation, AvatarConfig, Compute, FrameRef, Model, ModelFile, Part, PerPart, Pose, Precision, Sampler, StepError,
    Team,
};
use umo_core_model::motion::{MotionStream, Smoothing};
use umo_core_model::weights::Loader;
use umo_core_tools::stage::{self, Inputs, Options, Output, Stage, Values};
use umo_kernels::Isa;
use umo_tests::pages::same_bits;
use umo_tests::{Noise, cases};

const NAMES: [&str; 4] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"];
/// Index of a mel model with a text tokenizer, ARKit face, two of five experts.
const ARKIT: usize = 3;
/// All golden models, including layout `frames`.
const ALL: [&str; 6] = [NAMES[0], NAMES[1], NAMES[2], NAMES[3], "frames_four", "frames_seven"];
/// Index of a model of layout `frames`, otherwise like [`ARKIT`].
const FRAMES: usize = 5;

static MODELS: LazyLock<Vec<Model>> =
    LazyLock::new(|| ALL.map(|name| load(&ModelBytes::open(name), Precision::F32, Isa::detect())).into());

fn load(bytes: &ModelBytes, precision: Precision, isa: Isa) -> Model {
    Model::load(&ModelFile::from_bytes(bytes.bytes()).unwrap(), precision, isa).unwrap()
}

/// Output of a stream, as bits.
#[derive(Clone, Debug, Default, PartialEq)]
struct Frames {
    poses: Vec<Pose>,
    face: Vec<u32>,
    channels: PerPart<Vec<u32>>,
}

impl Frames {
    fn take(&mut self, frame: FrameRef) {
        assert_eq!(frame.index, self.poses.len(), "every frame once and in order");
        self.poses.push(*frame.pose);
        self.face.extend(frame.face.iter().map(|v| v.to_bits()));
        for part in Part::ALL {
            self.channels[part].extend(frame.channels[part].iter().map(|v| v.to_bits()));
        }
    }

    fn check(&self, frames: usize) {
        assert_eq!(self.poses.len(), frames);
        let values = self.face.iter().chain(Part::ALL.iter().flat_map(|&part| &self.channels[part]));
        assert!(values.map(|&bits| f32::from_bits(bits)).all(f32::is_finite));
        for pose in &self.poses {
            assert!(pose.translation.iter().all(|v| v.is_finite()));
            for q in &pose.rotations {
                let length: f64 = q.iter().map(|&v| f64::from(v).powi(2)).sum();
                assert!((length - 1.0).abs() < 1e-6, "{q:?} is not a unit quaternion");
            }
        }
    }
}

/// Codes of each part as keyframes, `[T, parts]`.
fn rows(codes: &PerPart<Vec<u16>>) -> Vec<u16> {
    (0..codes.face.len()).flat_map(|keyframe| Part::ALL.map(|part| codes[part][keyframe])).collect()
}

/// Settings of a stream's run.
struct Run<'a> {
    model: &'a Model,
    threads: usize,
    /// Sizes of pushes, repeated in a cycle; empty to push all at once.
    pushes: &'a [usize],
    history: Option<&'a PerPart<Vec<u16>>>,
}

impl<'a> Run<'a> {
    fn of(model: &'a Model) -> Self {
        Self { model, threads: 1, pushes: &[], history: None }
    }

    /// Runs a stream of this audio to its end.
    fn stream(&self, config: AvatarConfig, audio: &[f32]) -> Frames {
        let mut animation = Animation::new(self.model, &config).unwrap();
        if let Some(codes) = self.history {
            animation.avatar_mut().set_history(&rows(codes)).unwrap();
        }
        self.drive(&mut animation, audio)
    }

    fn drive(&self, animation: &mut Animation, audio: &[f32]) -> Frames {
        let team = Team::new(self.threads).unwrap();
        let cx = Compute { isa: self.model.isa(), team: &team };
        let mut frames = Frames::default();
        let mut rest = audio;
        for &size in self.pushes.iter().cycle().take(audio.len()) {
            let (piece, more) = rest.split_at(size.min(rest.len()));
            animation.push_audio(piece).unwrap();
            rest = more;
            while animation.step(self.model, cx, &mut |frame| frames.take(frame)).unwrap() {}
            if rest.is_empty() {
                break;
            }
        }
        animation.push_audio(rest).unwrap();
        animation.finish(animation.frames_of_audio(self.model.config()));
        while animation.step(self.model, cx, &mut |frame| frames.take(frame)).unwrap() {}
        frames
    }
}

/// Tones that drift over noise.
#[expect(clippy::cast_precision_loss, reason = "a few seconds have far fewer than 2^24 samples")]
fn audio(samples: usize, seed: u64) -> Vec<f32> {
    let mut noise = Noise::new(seed);
    let pitch = 500.0 + noise.float(300.0);
    let sample = |i: usize| {
        let t = i as f32 / 16_000.0;
        0.3 * (pitch * t + 30.0 * (4.0 * t).sin()).sin() * (2.0 * t).cos() + noise.float(0.02)
    };
    (0..samples).map(sample).collect()
}

/// The model's defaults, with the first frames early enough for a short recording.
fn defaults(model: &Model) -> AvatarConfig {
    AvatarConfig { target: 2.min(model.config().max_target), ..AvatarConfig::new(model.config()) }
}

fn frames_of(samples: usize) -> usize {
    samples * 30 / 16_000
}

/// Sizes of pushes, at least one of which is not 0.
fn pushes() -> impl Strategy<Value = Vec<usize>> {
    prop_oneof![
        Just(Vec::new()),
        proptest::collection::vec(1_usize..20_000, 1..5),
        Just(vec![160]),
        (0_usize..4, 300_usize..4000).prop_map(|(a, b)| vec![a, b]),
    ]
}

proptest! {
    #![proptest_config(cases(40))]

    #[test]
    fn any_chunk_and_lookahead_give_every_frame_finite(
        which in 0..ALL.len(), target in 1_usize..100, lookahead in 0_usize..100,
        samples in prop_oneof![Just(534_usize), 534..40_000_usize, (1..12_usize).prop_map(|n| n * 3200)],
        seed in any::<u64>(), pushes in pushes(),
    ) {
        let model = &MODELS[which];
        let c = model.config();
        let config = AvatarConfig {
            target: 1 + target % c.max_target,
            lookahead: lookahead % (c.keyframe_stride * c.prefix + 1),
            horizon: target % (c.audio.ahead + 1),
            sampler: Sampler { seed, ..defaults(model).sampler },
            ..defaults(model)
        };
        let run = Run { pushes: &pushes, ..Run::of(model) };
        run.stream(config, &audio(samples, seed)).check(frames_of(samples));
    }

    #[test]
    fn how_audio_is_pushed_does_not_matter(
        which in 0..ALL.len(), samples in 534..30_000_usize, seed in any::<u64>(), pushes in pushes(),
    ) {
        let model = &MODELS[which];
        let audio = audio(samples, seed);
        let whole = Run::of(model).stream(defaults(model), &audio);
        let pieces = Run { pushes: &pushes, ..Run::of(model) }.stream(defaults(model), &audio);
        prop_assert!(whole == pieces);
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    for (name, model) in ALL.iter().zip(&*MODELS) {
        let audio = audio(14_000, 1);
        let one = Run::of(model).stream(defaults(model), &audio);
        for threads in [2, 3, 5] {
            let more = Run { threads, ..Run::of(model) }.stream(defaults(model), &audio);
            assert!(one == more, "{name} on {threads} threads");
        }
    }
}

#[test]
fn a_seed_says_which_motion() {
    for (name, model) in ALL.iter().zip(&*MODELS) {
        let audio = audio(10_000, 2);
        let run = |seed| {
            let sampler = Sampler { seed, ..defaults(model).sampler };
            Run::of(model).stream(AvatarConfig { sampler, ..defaults(model) }, &audio)
        };
        assert!(run(1) == run(1), "{name}");
        assert!(run(1) != run(2), "{name}");
        let greedy = |seed| {
            let sampler = Sampler { seed, ..Sampler::GREEDY };
            Run::of(model).stream(AvatarConfig { sampler, ..defaults(model) }, &audio)
        };
        assert!(greedy(1) == greedy(2), "{name}");
        assert!(greedy(1) != run(1), "{name}");
    }
}

#[test]
fn history_and_text_and_audio_change_what_comes() {
    let mut told_apart = 0;
    for (name, model) in ALL.iter().zip(&*MODELS) {
        let config = || defaults(model);
        let (sound, other) = (audio(10_000, 3), [audio(4000, 4), vec![0.0; 6000]].concat());
        let plain = Run::of(model).stream(config(), &sound);
        let codes = PerPart::from_fn(|part| vec![90 + part as u16, 3, 200, 17]);
        let mut keyframes = Animation::new(model, &config()).unwrap();
        let other_history = if model.config().is_frames() {
            let count = model.config().codes_per_keyframe();
            let codes: Vec<u16> = (0..4 * count).map(|i| u16::try_from(i * 7 % 4).unwrap()).collect();
            keyframes.avatar_mut().set_history(&codes).unwrap();
            Run::of(model).drive(&mut keyframes, &sound)
        } else {
            Run { history: Some(&codes), ..Run::of(model) }.stream(config(), &sound)
        };
        assert!(other_history != plain, "{name}: history");
        // Random centroids may map all sounds to one unit; then the body cannot tell them
        // apart.
        let team = Team::new(1).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        let units = |audio: &[f32]| model.tokenizer().whole_file(cx, audio).unwrap().0;
        let heard = units(&sound) != units(&other);
        told_apart += usize::from(heard);
        assert_eq!(Run::of(model).stream(config(), &other) != plain, heard, "{name}: audio");
    }
    assert!(told_apart >= 3, "{told_apart} models tell sounds apart");
    for which in [ARKIT, FRAMES] {
        let model = &MODELS[which];
        let text = model.text().unwrap().encode("wave with both hands").unwrap();
        let sound = audio(10_000, 3);
        let plain = Run::of(model).stream(defaults(model), &sound);
        assert!(Run::of(model).stream(AvatarConfig { text, ..defaults(model) }, &sound) != plain);
    }
}

/// A strength of 1 is the plain conditional distribution, other strengths change the motion, and
/// without a text guidance has no effect.
#[test]
fn guidance_steers_with_the_text() {
    let model = &MODELS[FRAMES];
    let text = model.text().unwrap().encode("wave with both hands").unwrap();
    let sound = audio(10_000, 3);
    let run = |text: &[u32], guidance: f32, threads: usize| {
        let config = AvatarConfig { text: text.to_vec(), guidance, ..defaults(model) };
        Run { threads, ..Run::of(model) }.stream(config, &sound)
    };
    let once = run(&text, 1.0, 1);
    assert!(run(&text, 1.0 + f32::EPSILON, 1) == once, "the same logits but for their last bits");
    assert!(run(&text, 3.0, 1) != once);
    assert!(run(&text, 3.0, 1) == run(&text, 3.0, 3));
    assert!(run(&[], 3.0, 1) == run(&[], 1.0, 1));
}

/// Vectors pushed piece by piece with a lookahead of the whole reach give the channels of decoding
/// them at once, for any reach and levels of the parts, and any root.
#[test]
fn a_stream_of_vectors_is_the_whole_decode() {
    for which in [FRAMES - 1, FRAMES] {
        let model = &MODELS[which];
        let (motion, team, mut noise) = (model.motion(), Team::new(1).unwrap(), Noise::new(12));
        let cx = Compute { isa: model.isa(), team: &team };
        const FRAMES: usize = 60;
        let mut codes = Vec::new();
        for decoder in motion.decoders() {
            let book = decoder.codebook();
            codes.push(
                (0..FRAMES * book.levels())
                    .map(|_| u16::try_from(noise.below(book.codes())).unwrap())
                    .collect::<Vec<_>>(),
            );
        }
        let whole = motion.decode_list(cx, &codes.iter().map(Vec::as_slice).collect::<Vec<_>>()).unwrap();
        let mut vectors = Vec::new();
        for (decoder, codes) in motion.decoders().iter().zip(&codes) {
            let book = decoder.codebook();
            let mut rows = vec![0.0; FRAMES * book.width()];
            for (codes, row) in codes.chunks(book.levels()).zip(rows.chunks_mut(book.width())) {
                book.vector(codes, row).unwrap();
            }
            vectors.push(rows);
        }
        let lookahead = motion.reach();
        let mut stream = MotionStream::new(motion, 17, lookahead, Smoothing::OFF);
        let mut scratch = motion.scratch(motion.stream_rows(17, lookahead));
        let mut streamed = Frames::default();
        let mut at = 0;
        for count in [1, 17, 3, 0, 5, 17, 17] {
            let piece: Vec<_> = motion
                .decoders()
                .iter()
                .zip(&vectors)
                .map(|(decoder, vectors)| {
                    let width = decoder.codebook().width();
                    &vectors[at * width..(at + count) * width]
                })
                .collect();
            stream.push(cx, motion, &mut scratch, &piece, lookahead, &mut |frame| streamed.take(frame)).unwrap();
            at += count;
        }
        assert_eq!(at, FRAMES);
        stream.finish(cx, motion, &mut scratch, FRAMES, &mut |frame| streamed.take(frame)).unwrap();
        for part in Part::ALL {
            let wanted: Vec<u32> = whole.channels[part].iter().map(|v| v.to_bits()).collect();
            assert!(streamed.channels[part] == wanted, "{}: {}", ALL[which], part.name());
        }
    }
}

/// Audio behind a chunk and within the horizon changes its motion; audio beyond does not.
#[test]
fn a_horizon_hears_so_far_and_no_further() {
    for which in [FRAMES - 1, FRAMES] {
        let model = &MODELS[which];
        let c = model.config();
        // The first chunk has two keyframes, the horizon is one more; each is 3,200 samples.
        let early = |horizon: usize, samples: &[f32]| {
            let config = AvatarConfig { horizon, lookahead: 0, ..defaults(model) };
            let mut frames = Run::of(model).stream(config, samples);
            frames.poses.truncate(c.keyframe_stride + 1);
            frames.poses
        };
        let heard = audio(16_000, 9);
        let changed = |from: usize| {
            let mut samples = heard.clone();
            samples[from..].copy_from_slice(&audio(16_000, 10)[from..].iter().map(|v| 2.0 * v).collect::<Vec<_>>());
            samples
        };
        assert!(early(0, &heard) == early(0, &changed(6_400)), "{}: not heard", c.name);
        assert!(early(1, &heard) == early(1, &changed(9_600)), "{}: beyond the horizon", c.name);
        let heard_ahead = (0..4).any(|i| early(1, &heard) != early(1, &changed(6_400 + 320 * i)));
        assert!(heard_ahead, "{}: within the horizon", c.name);
    }
}

#[test]
fn a_history_of_rest_codes_is_no_history() {
    for model in &*MODELS {
        let sound = audio(7000, 5);
        if model.config().is_frames() {
            let parts = model.config().part_list();
            let codes: Vec<u16> =
                parts.iter().flat_map(|p| &p.rest).map(|&code| u16::try_from(code).unwrap()).collect();
            let mut animation = Animation::new(model, &defaults(model)).unwrap();
            animation.avatar_mut().set_history(&codes).unwrap();
            assert!(Run::of(model).drive(&mut animation, &sound) == Run::of(model).stream(defaults(model), &sound));
            continue;
        }
        let rest = PerPart::from_fn(|part| vec![u16::try_from(model.config().rest[part]).unwrap()]);
        let run = Run { history: Some(&rest), ..Run::of(model) };
        assert!(run.stream(defaults(model), &sound) == Run::of(model).stream(defaults(model), &sound));
    }
}

#[test]
fn text_alone_moves_a_body() {
    for which in [ARKIT, FRAMES] {
        text_alone_moves(&MODELS[which]);
    }
}

fn text_alone_moves(model: &Model) {
    let run = |words: &str| {
        let text = model.text().unwrap().encode(words).unwrap();
        let template = "text_to_motion".to_owned();
        let mut animation = Animation::new(model, &AvatarConfig { template, text, ..defaults(model) }).unwrap();
        animation.finish(50);
        let (team, mut frames) = (Team::new(1).unwrap(), Frames::default());
        let cx = Compute { isa: model.isa(), team: &team };
        while animation.step(model, cx, &mut |frame| frames.take(frame)).unwrap() {}
        frames
    };
    run("a person waves").check(50);
    assert!(run("a person waves") != run("turn left and walk"));
}

#[test]
fn a_stream_of_mel_features_has_the_units_of_the_whole_file() {
    for which in [2, ARKIT, FRAMES - 1, FRAMES] {
        let model = &MODELS[which];
        let team = Team::new(1).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        for samples in [534, 6400, 25_000] {
            let audio = audio(samples, 6);
            let (units, silence) = model.tokenizer().whole_file(cx, &audio).unwrap();
            assert_eq!(units.len(), samples.div_ceil(320));
            let mut animation = Animation::new(model, &defaults(model)).unwrap();
            animation.avatar_mut().use_whole_file_units(units, silence);
            Run::of(model).drive(&mut animation, &audio).check(frames_of(samples));
            assert_eq!(animation.avatar().unit_disagreement(), Some((samples.div_ceil(320), 0)), "{}", ALL[which]);
        }
    }
}

#[test]
fn every_precision_moves_a_body() {
    for name in ALL {
        let bytes = ModelBytes::open(name);
        for precision in [Precision::F32, Precision::Bf16, Precision::Int8] {
            let model = load(&bytes, precision, Isa::detect());
            let run = |threads| Run { threads, ..Run::of(&model) }.stream(defaults(&model), &audio(9000, 7));
            let frames = run(1);
            frames.check(frames_of(9000));
            assert!(frames == run(3), "{name} {precision:?}");
        }
    }
}

/// The codes of `generate` for the model's prompt, greedy.
fn generate(file: &ModelFile, precision: Precision, isa: Isa, ids: &[i64]) -> Vec<Output> {
    let inputs =
        Output { name: "input_ids".to_owned(), shape: vec![ids.len()], values: Values::Integers(ids.to_vec()) };
    let bytes = stage::serialize(&[inputs]).unwrap();
    let options = Options { target: None, sampler: Sampler::GREEDY };
    let team = Team::new(2).unwrap();
    let loader = Loader::new(file, precision, isa);
    stage::run(Stage::Generate, &loader, &team, &Inputs::new(&bytes, "").unwrap(), options).unwrap()
}

fn prompt(file: &ModelFile, seed: u64) -> Vec<i64> {
    let mut noise = Noise::new(seed);
    (0..60).map(|_| i64::try_from(noise.below(file.config().vocab.size)).unwrap()).collect()
}

/// Groups of back-ends whose logits have the same bits, by the table of the specification.
fn groups() -> Vec<Vec<Isa>> {
    let mut rows = same_bits("result").into_iter();
    let (_, groups) = rows.find(|(result, _)| result.starts_with("logits and frames, but")).unwrap();
    groups.into_iter().filter(|group| !group.is_empty()).collect()
}

/// The decoder's logits for fixed ids, `[decoder ids, vocab]`.
fn logits(file: &ModelFile, isa: Isa, ids: &[i64], decoder_ids: &[i64]) -> Vec<f32> {
    let integers = |name: &str, ids: &[i64]| Output {
        name: name.to_owned(),
        shape: vec![ids.len()],
        values: Values::Integers(ids.to_vec()),
    };
    let bytes = stage::serialize(&[integers("input_ids", ids), integers("decoder_input_ids", decoder_ids)]).unwrap();
    let options = Options { target: None, sampler: Sampler::GREEDY };
    let (loader, team) = (Loader::new(file, Precision::Int8, isa), Team::new(1).unwrap());
    let inputs = Inputs::new(&bytes, "").unwrap();
    match stage::run(Stage::Decoder, &loader, &team, &inputs, options).unwrap().remove(0).values {
        Values::Floats(values) => values,
        Values::Integers(_) => panic!("logits are floats"),
    }
}

/// Asserts that the first code in which `left` and `right` differ has nearly equal logits for both codes, on both
/// back-ends: either may be chosen.
fn assert_tie(file: &ModelFile, ids: &[i64], isas: [Isa; 2], left: &[Output], right: &[Output]) {
    let vocab = &file.config().vocab;
    let mut decoder_ids = vec![vocab.decoder_start as i64];
    for (part, (left, right)) in Part::ALL.into_iter().zip(left.iter().zip(right)) {
        let (Values::Integers(left), Values::Integers(right)) = (&left.values, &right.values) else {
            panic!("codes are integers");
        };
        let modality = vocab[part];
        let first = modality.first as i64;
        decoder_ids.push(modality.start as i64);
        for (&a, &b) in left.iter().zip(right) {
            if a == b {
                decoder_ids.push(first + a);
                continue;
            }
            for isa in isas {
                let all = logits(file, isa, ids, &decoder_ids);
                let last = &all[all.len() - vocab.size..];
                let largest = last.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
                let [of_a, of_b] = [a, b].map(|code| last[usize::try_from(first + code).unwrap()]);
                let what = format!("{}, {}: {of_a} and {of_b} of {largest}", isa.name(), part.name());
                assert!((of_a - of_b).abs() <= TOLERANCE * largest, "{what}");
            }
            return;
        }
        decoder_ids.push(modality.end as i64);
    }
    panic!("other codes, none of which differs");
}

/// A quantized input differs by at most one of 127 steps if a sum before it was rounded differently.
const TOLERANCE: f32 = 2.0 / 127.0;

/// Products, norms and the encoder's attention have the same bits on all back-ends. The f32 sums of
/// the router and of the decoder's attention have those of the back-end's group: between two nearly
/// equal logits, groups may choose different codes.
#[test]
fn int8_gives_the_same_codes_on_every_instruction_set() {
    for name in NAMES {
        let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
        for seed in 0..32 {
            let ids = prompt(&file, seed);
            let codes = |isa| generate(&file, Precision::Int8, isa, &ids);
            let wanted = codes(Isa::SCALAR);
            for group in groups() {
                let of_group = codes(group[0]);
                for &isa in &group[1..] {
                    assert!(codes(isa) == of_group, "{name}, {seed}: {} and {}", isa.name(), group[0].name());
                }
                if of_group != wanted {
                    assert_tie(&file, &ids, [Isa::SCALAR, group[0]], &wanted, &of_group);
                }
            }
        }
    }
}

/// Checks the logits of every prompt: codes may differ above only if their logits are nearly
/// equal.
#[test]
fn int8_gives_near_logits_on_every_instruction_set() {
    // In a few rows the router chooses another, nearly equal expert, whose outputs differ.
    const SWITCH: f32 = 0.125;
    let groups = groups();
    for name in NAMES {
        let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
        let (vocab, mut far, mut rows) = (file.config().vocab.size, vec![0; groups.len()], 0);
        for seed in 0..32 {
            let (ids, forced) = (prompt(&file, seed), prompt(&file, seed + 1000));
            let logits = |isa| logits(&file, isa, &ids, &forced[..24]);
            let wanted = logits(Isa::SCALAR);
            let largest = wanted.iter().fold(0.0_f32, |largest, value| largest.max(value.abs()));
            rows += wanted.len() / vocab;
            for (group, far) in groups.iter().zip(&mut far) {
                let of_group = logits(group[0]);
                for &isa in &group[1..] {
                    assert!(logits(isa) == of_group, "{name}, {seed}: {} and {}", isa.name(), group[0].name());
                }
                for (got, wanted) in of_group.chunks(vocab).zip(wanted.chunks(vocab)) {
                    let apart = got.iter().zip(wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                    assert!(apart <= SWITCH * largest, "{}, {name}, {seed}: {apart} of {largest}", group[0].name());
                    *far += usize::from(apart > TOLERANCE * largest);
                }
            }
        }
        for (group, far) in groups.iter().zip(far) {
            assert!(far * 50 <= rows, "{}, {name}: {far} rows of {rows}", group[0].name());
        }
    }
}

/// The same model with only its first expert.
fn dense(upcycled: &ModelBytes) -> ModelBytes {
    let mut dense = upcycled.clone();
    dense.config["lm"]["experts"] = json!(1);
    dense.config["lm"]["top_k"] = json!(1);
    dense.tensors.retain(|name, _| !name.contains(".moe.experts.") || name.contains(".moe.experts.0."));
    for (_, router) in dense.tensors.iter_mut().filter(|(name, _)| name.ends_with(".moe.router.weight")) {
        router.bytes.truncate(router.bytes.len() / router.shape[0]);
        router.shape[0] = 1;
    }
    dense
}

/// Asserts that all experts are equal, which the tests below require.
fn assert_upcycled(model: &ModelBytes) {
    let experts = model.tensors.iter().filter(|(name, _)| name.contains(".moe.experts.0."));
    let mut count = 0;
    for (name, first) in experts {
        for e in 1..4 {
            let other = name.replace(".moe.experts.0.", &format!(".moe.experts.{e}."));
            assert_eq!(model.tensors[&other].bytes, first.bytes, "{other}");
            count += 1;
        }
    }
    assert!(count > 0);
}

#[test]
fn equal_experts_are_the_dense_model_to_the_bit() {
    let upcycled = ModelBytes::open("mel_k1_upcycled");
    assert_upcycled(&upcycled);
    for precision in [Precision::F32, Precision::Bf16, Precision::Int8] {
        let of = |bytes: &ModelBytes| {
            let model = load(bytes, precision, Isa::detect());
            Run::of(&model).stream(AvatarConfig { target: 2, ..defaults(&model) }, &audio(16_000, 8))
        };
        assert!(of(&upcycled) == of(&dense(&upcycled)), "{precision:?}");
    }
}

#[test]
fn top2_of_identical_experts_matches_dense() {
    let upcycled = ModelBytes::open("mel_k1_upcycled");
    let mut both = upcycled.clone();
    both.config["lm"]["top_k"] = json!(2);
    let hidden = |bytes: &ModelBytes| {
        let file = ModelFile::from_bytes(bytes.bytes()).unwrap();
        let ids = prompt(&file, 9);
        let input = Output { name: "input_ids".to_owned(), shape: vec![ids.len()], values: Values::Integers(ids) };
        let input = stage::serialize(&[input]).unwrap();
        let options = Options { target: None, sampler: Sampler::GREEDY };
        let loader = Loader::new(&file, Precision::F32, Isa::detect());
        let inputs = Inputs::new(&input, "").unwrap();
        let outputs = stage::run(Stage::Encoder, &loader, &Team::new(1).unwrap(), &inputs, options).unwrap();
        let Values::Floats(hidden) = outputs.into_iter().next().unwrap().values else { panic!("floats") };
        hidden
    };
    let (one, two) = (hidden(&dense(&upcycled)), hidden(&both));
    let largest = one.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
    let error = one.iter().zip(&two).fold(0.0_f32, |m, (a, b)| m.max((a - b).abs()));
    // Two rounded weights whose sum is 1: a few units in the last place in each of two layers.
    assert!(error <= 1e-5 * largest, "{error} of {largest}");
}

#[test]
fn a_keyframe_on_every_frame_gives_every_frame() {
    let mut bytes = ModelBytes::open("mel_k1_upcycled");
    bytes.config["frame_rate"] = json!(25);
    bytes.config["keyframe_stride"] = json!(1);
    let model = load(&bytes, Precision::F32, Isa::detect());
    for samples in [640, 1280, 2560, 6400, 7000] {
        let run = Run { pushes: &[320], ..Run::of(&model) };
        let config = AvatarConfig { lookahead: 3, ..defaults(&model) };
        let frames = run.stream(config.clone(), &audio(samples, 10));
        frames.check(samples * 25 / 16_000);
        assert!(frames == Run::of(&model).stream(config, &audio(samples, 10)));
    }
}

#[test]
fn a_session_refuses_what_it_was_not_made_for() {
    let model = &MODELS[0];
    let refused = |change: &dyn Fn(&mut AvatarConfig)| {
        let mut config = defaults(model);
        change(&mut config);
        Animation::new(model, &config).unwrap_err().to_string()
    };
    assert!(refused(&|c| c.target = 0).contains("`target`"));
    assert!(refused(&|c| c.target = 7).contains("`target`"));
    assert!(refused(&|c| c.lookahead = 37).contains("`lookahead`"));
    assert!(refused(&|c| c.lookahead = usize::MAX).contains("`lookahead`"));
    assert!(refused(&|c| c.template = "dance".to_owned()).contains("dance"));
    assert!(refused(&|c| c.horizon = 1).contains("`horizon`"));
    assert!(refused(&|c| c.guidance = 1.5).contains("`guidance`"));
    let frames = |change: &dyn Fn(&mut AvatarConfig)| {
        let mut config = defaults(&MODELS[FRAMES]);
        change(&mut config);
        Animation::new(&MODELS[FRAMES], &config).unwrap_err().to_string()
    };
    assert!(frames(&|c| c.horizon = 4).contains("`horizon`: expected 0 to 3"));
    for guidance in [0.5, 3.5, f32::NAN] {
        assert!(frames(&|c| c.guidance = guidance).contains("`guidance`: expected 1 to 3"));
    }
    let mut keyframes = Animation::new(&MODELS[FRAMES], &defaults(&MODELS[FRAMES])).unwrap();
    let count = MODELS[FRAMES].config().codes_per_keyframe();
    assert!(matches!(keyframes.avatar_mut().set_history(&[]), Err(StepError::Empty(_))));
    assert!(matches!(keyframes.avatar_mut().set_history(&vec![0; count + 1]), Err(StepError::Disagree(_))));
    assert!(matches!(keyframes.avatar_mut().set_history(&vec![9; count]), Err(StepError::OutOfRange { .. })));
    // A keyframe of the other layout.
    assert!(matches!(keyframes.avatar_mut().set_history(&[0; 4]), Err(StepError::Disagree(_))));
    // An id outside the texts' range would be a keyframe's.
    let text = vec![u32::try_from(MODELS[FRAMES].config().vocab.size).unwrap()];
    let mut forged = Animation::new(&MODELS[FRAMES], &AvatarConfig { text, ..defaults(&MODELS[FRAMES]) }).unwrap();
    forged.push_audio(&audio(10_000, 1)).unwrap();
    let (isa, team) = (MODELS[FRAMES].isa(), Team::new(1).unwrap());
    let step = forged.step(&MODELS[FRAMES], Compute { isa, team: &team }, &mut |_| ());
    assert!(matches!(step, Ok(false) | Err(StepError::OutOfRange { what: "token id", .. })), "{step:?}");
    let mut animation = Animation::new(model, &defaults(model)).unwrap();
    let codes = |code: u16| PerPart::from_fn(|_| vec![code]);
    let set = |animation: &mut Animation, codes: PerPart<Vec<u16>>| animation.avatar_mut().set_history(&rows(&codes));
    assert!(matches!(set(&mut animation, codes(256)), Err(StepError::OutOfRange { got: 256, .. })));
    assert!(matches!(set(&mut animation, PerPart::default()), Err(StepError::Empty(_))));
    assert_eq!(set(&mut animation, codes(255)), Ok(()));
    animation.finish(1);
    assert!(matches!(animation.push_audio(&[0.0]), Err(StepError::Order(_))));
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    while animation.step(model, cx, &mut |_| ()).unwrap() {}
    assert!(matches!(set(&mut animation, codes(0)), Err(StepError::Order(_))));
}
