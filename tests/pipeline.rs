//! What must hold of the whole pipeline, audio in and poses out, whatever the weights: the golden models drive it.

mod model_bytes;

use std::sync::LazyLock;

use model_bytes::ModelBytes;
use proptest::prelude::*;
use serde_json::json;
use umo_core::animation::Animation;
use umo_core::avatar::AvatarConfig;
use umo_core::lm::sampler::Sampler;
use umo_core::model::Model;
use umo_core::motion::{FrameRef, Pose};
use umo_core::stage::{self, Inputs, Options, Output, Stage, Values};
use umo_core::weights::Loader;
use umo_core::{Compute, ModelFile, Part, PerPart, Precision, StepError, Team};
use umo_kernels::Isa;
use umo_tests::{Noise, cases};

const NAMES: [&str; 4] = ["hubert_k1_smplx", "hubert_k3_i8", "mel_k1_upcycled", "mel_k2_arkit"];
/// A mel model with a text tokenizer, ARKit face, two of five experts.
const ARKIT: usize = 3;

static MODELS: LazyLock<Vec<Model>> =
    LazyLock::new(|| NAMES.map(|name| load(&ModelBytes::open(name), Precision::F32, Isa::detect())).into());

fn load(bytes: &ModelBytes, precision: Precision, isa: Isa) -> Model {
    Model::load(&ModelFile::from_bytes(bytes.bytes()).unwrap(), precision, isa).unwrap()
}

/// Everything that a stream put out, as bits.
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
                assert!((length - 1.0).abs() < 1e-6, "{q:?} is no unit quaternion");
            }
        }
    }
}

/// How a stream is run.
struct Run<'a> {
    model: &'a Model,
    threads: usize,
    /// Sizes of pushes, over and over; all at once where there are none.
    pushes: &'a [usize],
    history: Option<&'a PerPart<Vec<u16>>>,
}

impl<'a> Run<'a> {
    fn of(model: &'a Model) -> Self {
        Self { model, threads: 1, pushes: &[], history: None }
    }

    /// A stream of this audio, to its end.
    fn stream(&self, config: AvatarConfig, audio: &[f32]) -> Frames {
        let mut animation = Animation::new(self.model, &config).unwrap();
        if let Some(codes) = self.history {
            animation.avatar_mut().set_history(PerPart::from_fn(|part| &*codes[part])).unwrap();
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

/// The model's defaults, with an answer that comes soon enough for a short recording.
fn defaults(model: &Model) -> AvatarConfig {
    AvatarConfig { target: 2.min(model.config().max_target), ..AvatarConfig::new(model.config()) }
}

fn frames_of(samples: usize) -> usize {
    samples * 30 / 16_000
}

/// Sizes of pushes that add up to something: at least one is not 0.
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
        which in 0..NAMES.len(), target in 1_usize..100, lookahead in 0_usize..100,
        samples in prop_oneof![Just(534_usize), 534..40_000_usize, (1..12_usize).prop_map(|n| n * 3200)],
        seed in any::<u64>(), pushes in pushes(),
    ) {
        let model = &MODELS[which];
        let c = model.config();
        let config = AvatarConfig {
            target: 1 + target % c.max_target,
            lookahead: lookahead % (c.keyframe_stride * c.prefix + 1),
            sampler: Sampler { seed, ..defaults(model).sampler },
            ..defaults(model)
        };
        let run = Run { pushes: &pushes, ..Run::of(model) };
        run.stream(config, &audio(samples, seed)).check(frames_of(samples));
    }

    #[test]
    fn how_audio_is_pushed_does_not_matter(
        which in 0..NAMES.len(), samples in 534..30_000_usize, seed in any::<u64>(), pushes in pushes(),
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
    for (name, model) in NAMES.iter().zip(&*MODELS) {
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
    for (name, model) in NAMES.iter().zip(&*MODELS) {
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
    for (name, model) in NAMES.iter().zip(&*MODELS) {
        let config = || defaults(model);
        let (sound, other) = (audio(10_000, 3), [audio(4000, 4), vec![0.0; 6000]].concat());
        let plain = Run::of(model).stream(config(), &sound);
        let codes = PerPart::from_fn(|part| vec![90 + part as u16, 3, 200, 17]);
        let run = Run { history: Some(&codes), ..Run::of(model) };
        assert!(run.stream(config(), &sound) != plain, "{name}: history");
        // Random centroids may lie so that all sounds have one unit; then the body cannot know them apart.
        let team = Team::new(1).unwrap();
        let cx = Compute { isa: model.isa(), team: &team };
        let units = |audio: &[f32]| model.tokenizer().whole_file(cx, audio).unwrap().0;
        let heard = units(&sound) != units(&other);
        told_apart += usize::from(heard);
        assert_eq!(Run::of(model).stream(config(), &other) != plain, heard, "{name}: audio");
    }
    assert!(told_apart >= 2, "{told_apart} models tell sounds apart");
    let model = &MODELS[ARKIT];
    let text = model.text().unwrap().encode("wave with both hands").unwrap();
    let sound = audio(10_000, 3);
    let plain = Run::of(model).stream(defaults(model), &sound);
    assert!(Run::of(model).stream(AvatarConfig { text, ..defaults(model) }, &sound) != plain);
}

#[test]
fn a_history_of_rest_codes_is_no_history() {
    for model in &*MODELS {
        let rest = PerPart::from_fn(|part| vec![u16::try_from(model.config().rest[part]).unwrap()]);
        let sound = audio(7000, 5);
        let run = Run { history: Some(&rest), ..Run::of(model) };
        assert!(run.stream(defaults(model), &sound) == Run::of(model).stream(defaults(model), &sound));
    }
}

#[test]
fn text_alone_moves_a_body() {
    let model = &MODELS[ARKIT];
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
    for which in [2, ARKIT] {
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
            assert_eq!(animation.avatar().unit_disagreement(), Some((samples.div_ceil(320), 0)), "{}", NAMES[which]);
        }
    }
}

#[test]
fn every_precision_moves_a_body() {
    for name in NAMES {
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

/// The codes of `generate` for a model's own prompt, greedy.
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

/// Products, norms and the encoder's attention have the same bits everywhere. What is left are f32 sums of the router and of the
/// decoder's attention, whose order belongs to the instruction set: where two codes are as good as equal, either may be chosen.
#[test]
fn int8_gives_the_same_codes_on_every_instruction_set() {
    const PROMPTS: u64 = 32;
    for isa in Isa::available() {
        let mut others = Vec::new();
        for name in NAMES {
            let file = ModelFile::from_bytes(ModelBytes::open(name).bytes()).unwrap();
            for seed in 0..PROMPTS {
                let ids = prompt(&file, seed);
                let codes = |isa| generate(&file, Precision::Int8, isa, &ids);
                if codes(isa) != codes(Isa::SCALAR) {
                    others.push((name, seed));
                }
            }
        }
        // One in fifty; where a back-end were wrong, nearly all of them would differ.
        let most = usize::try_from(PROMPTS).unwrap() * NAMES.len() / 50;
        assert!(others.len() <= most, "{}: other codes for {others:?}", isa.name());
    }
}

/// The same model with its first expert alone.
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

/// Experts must be equal for what follows to mean anything.
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
fn equal_experts_of_which_two_are_chosen_say_what_the_dense_model_says() {
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
    // Two weights that add up to 1, rounded: a few units in the last place for each of two layers.
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
    let mut animation = Animation::new(model, &defaults(model)).unwrap();
    let codes = |code: u16| PerPart::from_fn(|_| vec![code]);
    let set = |animation: &mut Animation, codes: PerPart<Vec<u16>>| {
        animation.avatar_mut().set_history(PerPart::from_fn(|part| &*codes[part]))
    };
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
