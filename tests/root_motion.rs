//! Root motion of the default model's stream: the pelvis is at its height from the first frame on, at every target and
//! lookahead.

use std::path::Path;

use umo_core::{Animation, AvatarConfig, Compute, FrameRef, Model, ModelFile, Precision, Sampler, Team};
use umo_kernels::Isa;
use umo_tests::Noise;

/// Largest distance of the pelvis in the first frame from its usual height, metres.
const FIRST_HEIGHT: f32 = 0.01;

const FRAMES: usize = 150;

/// Calls `take` with each frame of the stream.
fn stream(model: &Model, cx: Compute, config: &AvatarConfig, audio: &[f32], mut take: impl FnMut(FrameRef)) {
    let mut animation = Animation::new(model, config).unwrap();
    animation.push_audio(audio).unwrap();
    animation.finish(FRAMES);
    while animation.step(model, cx, &mut take).unwrap() {}
}

/// Calls `check` with the default model and recordings: speech, and noise between two pauses.
fn each(check: impl Fn(&Model, Compute, &str, &[f32])) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let file = ModelFile::open(&root.join("models/umo-people/model.safetensors")).unwrap();
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

/// [`Clip::channels`](umo_core_pose::clip::Clip::channels) writes contacts in the model's order,
/// in which the ankle and foot of a side go together.
#[test]
fn contacts_of_a_side_go_together() {
    each(|model, cx, name, audio| {
        let (mut within, mut across) = (0.0, 0.0);
        for seed in 0..4 {
            let defaults = AvatarConfig::new(model.config());
            let sampler = Sampler { seed, ..defaults.sampler };
            stream(model, cx, &AvatarConfig { sampler, ..defaults }, audio, |frame| {
                let contacts = &frame.channels.lower[umo_core_model::motion::root::FIRST_CONTACT..];
                let apart = |a: usize, b: usize| (contacts[a] - contacts[b]).abs();
                within += apart(0, 1) + apart(2, 3);
                across += apart(0, 2) + apart(1, 3);
            });
        }
        assert!(within < 0.6 * across, "{name}: {within} within a side, {across} between them");
    });
}

/// The pelvis is at its height in the first frame, at every lookahead and some seeds.
fn stands_at_its_height(target: usize) {
    each(|model, cx, name, audio| {
        let defaults = AvatarConfig::new(model.config());
        for lookahead in [0, 1, 2, 3, 4, 9] {
            for seed in 0..2 {
                let sampler = Sampler { seed, ..defaults.sampler };
                let config = AvatarConfig { target, lookahead, sampler, ..defaults.clone() };
                let mut heights = Vec::new();
                stream(model, cx, &config, audio, |frame| heights.push(frame.pose.translation[1]));
                assert_eq!(heights.len(), FRAMES);
                let first = heights[0];
                heights.sort_by(f32::total_cmp);
                let usual = heights[heights.len() / 2];
                let case = format!("{name}, target {target}, lookahead {lookahead}, seed {seed}");
                assert!((first - usual).abs() <= FIRST_HEIGHT, "{case}: starts at {first} m, not at {usual} m");
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
