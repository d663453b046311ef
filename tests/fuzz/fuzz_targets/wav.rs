//! Any bytes as a WAV file: an error, or samples that are finite numbers and resample to a finite recording.
#![no_main]

use libfuzzer_sys::fuzz_target;
use umo_cli::wav;
use umo_core::audio::resample;

/// Longest recording that is resampled here, so that one input does not take seconds.
const MOST: usize = 20_000;

fuzz_target!(|data: &[u8]| {
    let Ok(wav) = wav::parse(data) else { return };
    assert!(wav.samples.len() <= data.len());
    assert!(wav.samples.iter().all(|v| v.is_finite()));
    assert!((1..=8).contains(&wav.channels));
    let mono = wav.mono();
    assert_eq!(mono.len(), wav.samples.len() / usize::from(wav.channels));
    let mono = &mono[..mono.len().min(MOST)];
    let Ok(out) = resample::to_rate(mono, wav.sample_rate as usize, 16_000) else { return };
    assert!(out.iter().all(|v| v.is_finite()));
});
