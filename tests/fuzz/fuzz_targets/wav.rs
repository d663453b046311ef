//! Any bytes as a WAV file: an error, or samples that are finite numbers and resample to a finite
//! recording.
#![no_main]

use libfuzzer_sys::fuzz_target;
use umo_core_model::audio::resample;

/// Longest recording resampled here, so that one input does not take seconds.
const MAX_SAMPLES: usize = 2_000;

/// The model's rate. Filters between rates with a small common divisor are as long as the rate itself and take seconds
/// to plan under a sanitizer; other tests cover them.
const RATE: usize = 16_000;
const MIN_DIVISOR: usize = 50;

fuzz_target!(|data: &[u8]| {
    // Other formats use third-party decoders.
    if data.get(8..12) != Some(b"WAVE") {
        return;
    }
    let Ok(wav) = umo_audio_file::parse(data) else { return };
    assert!(wav.samples.iter().all(|v| v.is_finite()));
    assert!((1..=8).contains(&wav.channels));
    let mono = wav.mono();
    assert_eq!(mono.len(), wav.samples.len() / usize::from(wav.channels));
    let mono = &mono[..mono.len().min(MAX_SAMPLES)];
    let rate = wav.sample_rate as usize;
    if !rate.is_multiple_of(MIN_DIVISOR) {
        return;
    }
    let Ok(out) = resample::to_rate(mono, rate, RATE) else { return };
    assert!(out.iter().all(|v| v.is_finite()));
});
