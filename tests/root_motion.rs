//! The default model's stream at short lookaheads against the longest, which is the whole decode of the same codes:
//! height and path of the pelvis, and turns of the joints, from the first frame on. Its hands in silence.

use std::path::Path;

use umo_core::{Animation, AvatarConfig, Compute, FrameRef, Model, ModelFile, Precision, Sampler, Team};
use umo_kernels::Isa;
use umo_tests::Noise;

/// Lookahead with which decoders see all that they reach.
const WHOLE: usize = 9;
/// Largest distance of the pelvis from the whole decode's height, metres.
const HEIGHT: f32 = 0.008;
/// Largest distance over the ground from the whole decode's path, metres.
const PATH: f32 = 0.04;
/// Mean angle of all joints and frames from the whole decode's, degrees, times keyframes of a chunk.
const TURN: f32 = 2.0;

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
        for seed in 0..2 {
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

/// Angle between two rotations, degrees.
fn angle(a: [f32; 4], b: [f32; 4]) -> f32 {
    let cosine: f32 = a.iter().zip(b).map(|(a, b)| a * b).sum();
    2.0 * cosine.abs().min(1.0).acos().to_degrees()
}

fn is_near_the_whole_decode(target: usize) {
    each(|model, cx, name, audio| {
        let defaults = AvatarConfig::new(model.config());
        let frames = |lookahead| {
            let config = AvatarConfig { target, lookahead, ..defaults.clone() };
            let mut frames = Vec::new();
            stream(model, cx, &config, audio, |frame| {
                frames.push((frame.pose.translation, frame.pose.rotations.to_vec()));
            });
            assert_eq!(frames.len(), FRAMES);
            frames
        };
        let whole = frames(WHOLE);
        for lookahead in [0, 2] {
            let case = format!("{name}, target {target}, lookahead {lookahead}");
            let mut turned = Vec::new();
            for (frame, (streamed, whole)) in frames(lookahead).iter().zip(&whole).enumerate() {
                let ([x, y, z], [to_x, to_y, to_z]) = (streamed.0, whole.0);
                assert!((y - to_y).abs() <= HEIGHT, "{case}, frame {frame}: height {y} m, not {to_y} m");
                let off = (x - to_x).hypot(z - to_z);
                assert!(off <= PATH, "{case}, frame {frame}: {off} m from the path");
                turned.extend(streamed.1.iter().zip(&whole.1).map(|(&a, &b)| angle(a, b)));
            }
            let mean = turned.iter().sum::<f32>() / turned.len() as f32;
            assert!(mean * target as f32 <= TURN, "{case}: joints are off by {mean} degrees");
        }
    });
}

#[test]
fn one_keyframe_a_chunk_is_near_the_whole_decode() {
    is_near_the_whole_decode(1);
}

#[test]
fn two_keyframes_a_chunk_are_near_the_whole_decode() {
    is_near_the_whole_decode(2);
}

#[test]
fn five_keyframes_a_chunk_are_near_the_whole_decode() {
    is_near_the_whole_decode(5);
}

/// Mean turn of shoulders, elbows and wrists in a frame, degrees, after four seconds of silence.
fn turns_in_silence(model: &Model, cx: Compute, voice: &[f32], config: &AvatarConfig) -> f32 {
    const ARMS: std::ops::Range<usize> = 16..22;
    let rate = model.config().audio.sample_rate;
    let mut audio = voice[..2 * rate].to_vec();
    audio.resize(12 * rate, 0.0);
    let mut animation = Animation::new(model, config).unwrap();
    animation.push_audio(&audio).unwrap();
    animation.finish(360);
    let mut poses: Vec<Vec<[f32; 4]>> = Vec::new();
    while animation.step(model, cx, &mut |frame: FrameRef| poses.push(frame.pose.rotations.to_vec())).unwrap() {}
    let still = &poses[6 * 30..11 * 30];
    let turn = |pair: &[Vec<[f32; 4]>]| ARMS.map(|joint| angle(pair[0][joint], pair[1][joint])).sum::<f32>();
    still.windows(2).map(turn).sum::<f32>() / (still.len() - 1) as f32
}

/// Hands rest in silence without a prompt, unless the activity is 1.
#[test]
fn hands_rest_in_silence_without_a_prompt() {
    each(|model, cx, name, voice| {
        if name != "speech" {
            return;
        }
        let defaults = AvatarConfig { horizon: 5, ..AvatarConfig::new(model.config()) };
        let busy = Sampler { activity: 1.0, ..defaults.sampler };
        let text = model.text().unwrap().encode("excited").unwrap();
        let turns = |config: &AvatarConfig| turns_in_silence(model, cx, voice, config);
        let rest = turns(&defaults);
        let (busy, told) =
            (turns(&AvatarConfig { sampler: busy, ..defaults.clone() }), turns(&AvatarConfig { text, ..defaults }));
        assert!(
            busy > 2.0 * rest && told > 2.0 * rest,
            "{rest} in silence, {busy} at activity 1, {told} with a prompt"
        );
    });
}
