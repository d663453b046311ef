//! The live mouth on streams: conditions that must not change a bit of it, and its behaviour with any sound.

use std::path::PathBuf;

use proptest::prelude::*;
use umo_core::{ModelFile, Precision};
use umo_core_model::mouth::{Mouth, MouthStream};
use umo_core_model::weights::Loader;
use umo_kernels::Isa;

/// Not a whole number of samples per frame.
const RATE: usize = 16_000;

fn load() -> Mouth {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/mel_k2_arkit/model.safetensors");
    let file = ModelFile::open(&path).unwrap();
    Mouth::load(&Loader::new(&file, Precision::Stored, Isa::detect())).unwrap().expect("this model has one")
}

/// A tone that swells and fades over noise.
fn sound(samples: usize, gain: f32) -> Vec<f32> {
    let mut noise = 1_u32;
    let sample = |i: usize| {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let (t, hiss) = (i as f32 / RATE as f32, (noise >> 8) as f32 / (1 << 24) as f32 - 0.5);
        gain * (0.4 * (t * 9.0).sin().powi(2) * (t * 900.0).sin() + 0.02 * hiss)
    };
    (0..samples).map(sample).collect()
}

/// A frame's index, the bits of its channels, and those of the gate.
type Frame = (u64, Vec<u32>, u32);

/// Frames of the samples, pushed in pieces of these lengths, repeated in a cycle, to the end.
fn run(mouth: &Mouth, stream: &mut MouthStream, mut samples: &[f32], cuts: &[usize]) -> Vec<Frame> {
    let mut frames = Vec::new();
    let mut take = |frame: umo_core_model::mouth::MouthFrame| {
        let bits = frame.channels.iter().map(|value| value.to_bits()).collect();
        frames.push((frame.index, bits, frame.voiced.to_bits()));
    };
    for &cut in cuts.iter().cycle() {
        let (now, rest) = samples.split_at(cut.min(samples.len()));
        stream.push(mouth, Isa::detect(), now, &mut take).unwrap();
        samples = rest;
        if samples.is_empty() {
            break;
        }
    }
    stream.finish(mouth, Isa::detect(), &mut take).unwrap();
    frames
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn cuts_change_no_bit(cuts in prop::collection::vec(1_usize..2000, 1..9), samples in 1_usize..30_000) {
        let (mouth, samples) = (load(), sound(samples, 1.0));
        let whole = run(&mouth, &mut MouthStream::new(&mouth), &samples, &[samples.len()]);
        prop_assert_eq!(whole.len(), samples.len() * 30 / RATE);
        prop_assert!(whole.iter().enumerate().all(|(i, frame)| frame.0 == i as u64));
        let cut = run(&mouth, &mut MouthStream::new(&mouth), &samples, &cuts);
        prop_assert_eq!(whole, cut);
    }
}

#[test]
fn a_stream_that_was_reset_is_a_new_one() {
    let mouth = load();
    let mut stream = MouthStream::new(&mouth);
    let first = run(&mouth, &mut stream, &sound(20_011, 1.0), &[777]);
    assert!(first.iter().any(|frame| frame.1 != first[0].1), "the mouth moves");
    stream.reset(&mouth);
    assert_eq!(run(&mouth, &mut stream, &sound(20_011, 1.0), &[160]), first);
}

/// A frame is output exactly when the samples of its promised latency have been pushed.
#[test]
fn frames_come_after_their_latency() {
    let mouth = load();
    let mut stream = MouthStream::new(&mouth);
    let latency = mouth.latency_samples();
    assert_eq!(latency, 800, "three rows at 60 a second");
    let mut known = Vec::new();
    for (i, &sample) in sound(9000, 1.0).iter().enumerate() {
        stream.push(&mouth, Isa::detect(), &[sample], |frame| known.push((frame.index, i + 1))).unwrap();
    }
    for (i, (index, samples)) in known.into_iter().enumerate() {
        assert_eq!(index, i as u64);
        assert_eq!(samples, i * RATE / 30 + latency, "frame {index}");
    }
}

/// Audio beyond a frame's latency does not change it.
#[test]
fn the_future_changes_nothing() {
    let mouth = load();
    let (mut samples, at) = (sound(16_000, 1.0), 8000);
    let before = run(&mouth, &mut MouthStream::new(&mouth), &samples, &[500]);
    samples[at..].iter_mut().for_each(|sample| *sample = -*sample * 3.0);
    let after = run(&mouth, &mut MouthStream::new(&mouth), &samples, &[500]);
    let same = (at - mouth.latency_samples()) * 30 / RATE + 1;
    assert_eq!(before[..same], after[..same]);
    assert_ne!(before[same..], after[same..]);
}

/// Level control normalises the network's input level: the same sound at any loudness gives the
/// same mouth once the level is known.
#[test]
fn levels_from_minus_50_to_0_decibels_are_one_mouth() {
    let mouth = load();
    let frames = |gain: f32| {
        let mut values = Vec::new();
        let mut stream = MouthStream::new(&mouth);
        stream
            .push(&mouth, Isa::detect(), &sound(160_000, gain), |frame| values.push(frame.channels.to_vec()))
            .unwrap();
        (values.split_off(240).concat(), stream.level_db(&mouth))
    };
    let (loud, full) = frames(1.0);
    for decibels in [-10.0_f32, -30.0, -50.0] {
        let (quiet, level) = frames(10.0_f32.powf(decibels / 20.0));
        let difference = loud.iter().zip(&quiet).map(|(a, b)| (a - b).abs()).sum::<f32>() / loud.len() as f32;
        assert!(difference < 0.01, "{decibels} dB: {difference}");
        assert!((level - full - decibels).abs() < 0.5, "{decibels} dB: {level} dB, and {full} dB at full scale");
    }
}

#[test]
fn what_is_no_sound_is_silence() {
    let mouth = load();
    let mut broken = sound(16_000, 1.0);
    let mut silent = broken.clone();
    for (i, wrong) in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30].into_iter().enumerate() {
        (broken[3000 + i], silent[3000 + i]) = (wrong, 0.0);
    }
    let expected = run(&mouth, &mut MouthStream::new(&mouth), &silent, &[1000]);
    assert_eq!(run(&mouth, &mut MouthStream::new(&mouth), &broken, &[1000]), expected);
}

#[test]
fn the_loudest_sound_gives_channels_in_range() {
    let mouth = load();
    let mut stream = MouthStream::new(&mouth);
    for gain in [1e6, 1e-30, 0.0, 1.0] {
        stream
            .push(&mouth, Isa::detect(), &sound(8000, gain), |frame| {
                assert!(frame.channels.iter().all(|value| (0.0..=1.0).contains(value)), "{:?}", frame.channels);
            })
            .unwrap();
    }
}

#[test]
fn names_of_channels_are_found() {
    let mouth = load();
    // jawOpen, mouthClose, tongueOut, mouthFunnel, jawForward in Apple's order.
    assert_eq!(mouth.channels(), [17, 18, 51, 19, 14]);
}
