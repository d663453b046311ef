//! Root motion of a stream against the whole decode of the same codes: the pelvis is at its height
//! from the first frame on, at every target and lookahead, and the body follows the whole
//! decode's path.

use std::path::Path;

use umo_core::{Animation, AvatarConfig, Compute, Model, ModelFile, Part, PerPart, Precision, Sampler, Team};
use umo_kernels::Isa;
use umo_tests::Noise;

/// Largest distance of the pelvis from the whole decode's height, metres.
const HEIGHT: f32 = 0.015;
/// Largest distance of the pelvis in the first frame from its usual height, metres.
const FIRST_HEIGHT: f32 = 0.02;
/// Largest distance over the ground from the whole decode's path, metres.
const PATH: f32 = 0.04;

const FRAMES: usize = 150;

/// Translations of the stream, and of the whole decode of its codes.
fn translations(model: &Model, cx: Compute, config: &AvatarConfig, audio: &[f32]) -> [Vec<[f32; 3]>; 2] {
    let mut animation = Animation::new(model, config).unwrap();
    animation.keep_record(model.config());
    animation.push_audio(audio).unwrap();
    animation.finish(FRAMES);
    let (mut streamed, mut codes) = (Vec::new(), PerPart::<Vec<u16>>::default());
    let mut take = |frame: umo_core::FrameRef| streamed.push(frame.pose.translation);
    while animation.step(model, cx, &mut take).unwrap() {
        if let Some(chunk) = animation.chunk() {
            Part::ALL.into_iter().for_each(|part| codes[part].extend_from_slice(chunk.codes[part]));
        }
    }
    assert_eq!(streamed.len(), FRAMES);
    let whole = model.motion().decode(cx, PerPart::from_fn(|part| &*codes[part])).unwrap();
    [streamed, whole.translation]
}

/// Calls `check` with a model of layout `parts`, whose root is decoded with the other channels, and recordings: speech,
/// and noise between two pauses.
fn each(check: impl Fn(&Model, Compute, &str, &[f32])) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let file = ModelFile::open(&root.join("models/umo-small/model.safetensors")).unwrap();
    let model = Model::load(&file, Precision::Stored, Isa::detect()).unwrap();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let samples = FRAMES * model.config().audio.sample_rate / model.config().frame_rate;
    let mut speech: Vec<f32> = hound::WavReader::open(root.join("assets/hello.wav"))
        .unwrap()
        .samples::<i16>()
        .map(|sample| f32::from(sample.unwrap()) / 32_768.0)
        .collect();
    speech.resize(samples, 0.0);
    let mut noise = Noise::new(5);
    let bursts: Vec<f32> = (0..samples)
        .map(
            |i| if (samples / 4..samples / 2).contains(&i) { noise.float(0.3) * (i as f32 * 0.001).sin() } else { 0.0 },
        )
        .collect();
    check(&model, cx, "speech", &speech);
    check(&model, cx, "bursts", &bursts);
}

/// In a live setting, with few keyframes and any lookahead, the first frame stands as high as the
/// rest pose.
#[test]
fn the_first_frame_of_a_live_setting_has_the_height_of_rest() {
    each(|model, cx, name, audio| {
        let defaults = AvatarConfig::new(model.config());
        let codes = Part::ALL.map(|part| vec![u16::try_from(model.config().rest[part]).unwrap(); 30]);
        let [face, hands, upper, lower] = codes.each_ref().map(Vec::as_slice);
        let rest = model.motion().decode(cx, PerPart { face, hands, upper, lower }).unwrap().translation[15][1];
        for target in [1, 2] {
            for lookahead in 0..10 {
                for seed in 0..5 {
                    let sampler = Sampler { seed, ..defaults.sampler };
                    let config = AvatarConfig { target, lookahead, sampler, ..defaults.clone() };
                    let mut animation = Animation::new(model, &config).unwrap();
                    animation.push_audio(&audio[..16_000]).unwrap();
                    let mut heights = Vec::new();
                    while heights.is_empty() {
                        let mut take = |frame: umo_core::FrameRef| heights.push(frame.pose.translation[1]);
                        assert!(animation.step(model, cx, &mut take).unwrap(), "a second has frames");
                    }
                    let first = heights[0];
                    let case = format!("{name}, target {target}, lookahead {lookahead}, seed {seed}");
                    assert!((first - rest).abs() <= FIRST_HEIGHT, "{case}: starts at {first} m, rest is at {rest} m");
                }
            }
        }
    });
}

/// [`Clip::channels`](umo_core_pose::clip::Clip::channels) writes contacts in the model's order,
/// in which the ankle and foot of a side go together.
#[test]
fn contacts_of_a_side_go_together() {
    each(|model, cx, name, audio| {
        let (mut within, mut across) = (0.0, 0.0);
        for seed in 0..8 {
            let defaults = AvatarConfig::new(model.config());
            let sampler = Sampler { seed, ..defaults.sampler };
            let mut animation = Animation::new(model, &AvatarConfig { sampler, ..defaults }).unwrap();
            animation.push_audio(audio).unwrap();
            animation.finish(FRAMES);
            let mut take = |frame: umo_core::FrameRef| {
                let contacts = &frame.channels.lower[umo_core_model::motion::root::FIRST_CONTACT..];
                let apart = |a: usize, b: usize| (contacts[a] - contacts[b]).abs();
                within += apart(0, 1) + apart(2, 3);
                across += apart(0, 2) + apart(1, 3);
            };
            while animation.step(model, cx, &mut take).unwrap() {}
        }
        assert!(within < 0.6 * across, "{name}: {within} within a side, {across} between them");
    });
}

/// The pelvis is at its height from the first frame on, at every lookahead and some seeds.
fn stands_at_its_height(target: usize) {
    each(|model, cx, name, audio| {
        let defaults = AvatarConfig::new(model.config());
        for lookahead in [0, 1, 2, 3, 4, 9] {
            for seed in 0..2 {
                let sampler = Sampler { seed, ..defaults.sampler };
                let config = AvatarConfig { target, lookahead, sampler, ..defaults.clone() };
                let [streamed, whole] = translations(model, cx, &config, audio);
                let case = format!("{name}, target {target}, lookahead {lookahead}, seed {seed}");
                let mut heights: Vec<f32> = whole.iter().map(|place| place[1]).collect();
                heights.sort_by(f32::total_cmp);
                let (first, usual) = (streamed[0][1], heights[heights.len() / 2]);
                assert!((first - usual).abs() <= FIRST_HEIGHT, "{case}: starts at {first} m, not at {usual} m");
                for (frame, (streamed, whole)) in streamed.iter().zip(&whole).enumerate() {
                    let off = (streamed[1] - whole[1]).abs();
                    assert!(off <= HEIGHT, "{case}, frame {frame}: height {} m, not {} m", streamed[1], whole[1]);
                    let off = (streamed[0] - whole[0]).hypot(streamed[2] - whole[2]);
                    assert!(off <= PATH, "{case}, frame {frame}: {streamed:?} is {off} m from {whole:?}");
                }
            }
        }
    });
}

#[test]
fn the_pelvis_stands_at_its_height_from_the_first_frame_of_one_keyframe_a_chunk() {
    stands_at_its_height(1);
}

#[test]
fn the_pelvis_stands_at_its_height_from_the_first_frame_of_two_keyframes_a_chunk() {
    stands_at_its_height(2);
}

#[test]
fn the_pelvis_stands_at_its_height_from_the_first_frame_of_five_keyframes_a_chunk() {
    stands_at_its_height(5);
}
