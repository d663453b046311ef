//! Portable instruction sets animate alike: one digest of a recording's frames, on every back-end of every processor.
//! `scripts/test/arm64` and `scripts/test/wasm` run this with the same digest.

use umo_core::{Animation, AvatarConfig, Compute, FrameRef, Model, ModelFile, Precision, Team};
use umo_kernels::Isa;
use umo_tests::pages::root;

/// The frames of [`SAMPLES`] of `assets/hello.wav` by the default model, layers included.
const DIGEST: u64 = 0x5840_542e_5b9c_f594;

/// 1.5 s.
const SAMPLES: usize = 24_000;

/// FNV-1a over the words of all frames.
fn digest(isa: Isa, audio: &[f32], threads: usize) -> u64 {
    let file = ModelFile::open(&root().join("models/umo-people/model.safetensors")).unwrap();
    let model = Model::load(&file, Precision::Stored, isa).unwrap();
    let mut animation = Animation::new(&model, &AvatarConfig::new(model.config())).unwrap();
    animation.push_audio(audio).unwrap();
    animation.finish(animation.frames_of_audio(model.config()));
    let team = Team::new(threads).unwrap();
    let (mut digest, mut frames) = (0xcbf2_9ce4_8422_2325_u64, 0);
    let mut take = |frame: FrameRef| {
        frames += 1;
        let values = frame.pose.rotations.as_flattened().iter().chain(&frame.pose.translation).chain(frame.face);
        for value in values {
            assert!(value.is_finite());
            digest = (digest ^ u64::from(value.to_bits())).wrapping_mul(0x100_0000_01b3);
        }
    };
    while animation.step(&model, Compute { isa, team: &team }, &mut take).unwrap() {}
    assert_eq!(frames, SAMPLES * 30 / 16_000);
    digest
}

#[test]
fn every_portable_back_end_gives_the_same_frames() {
    let mut sound = hound::WavReader::open(root().join("assets/hello.wav")).unwrap();
    let audio: Vec<f32> =
        sound.samples::<i16>().take(SAMPLES).map(|sample| f32::from(sample.unwrap()) / 32_768.0).collect();
    for isa in Isa::available() {
        assert_eq!(digest(isa.portable(), &audio, 1), DIGEST, "portable {}", isa.name());
    }
    if !cfg!(target_family = "wasm") {
        assert_eq!(digest(Isa::detect().portable(), &audio, 2), DIGEST, "two threads");
    }
}
