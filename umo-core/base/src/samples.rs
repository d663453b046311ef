//! Samples of audio: their range, and mixing of channels.

/// Largest magnitude of a valid sample; full scale is 1. Sums over larger samples would overflow.
pub const MAX_AMPLITUDE: f32 = 1e6;

/// Replaces every sample that is NaN, infinite or above [`MAX_AMPLITUDE`] in magnitude by silence, and returns
/// the number of these samples.
#[inline]
pub fn silence_unusable(samples: &mut [f32]) -> usize {
    let mut count = 0;
    // NaN is not contained in any range.
    for sample in samples.iter_mut().filter(|sample| !(-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(*sample)) {
        *sample = 0.0;
        count += 1;
    }
    count
}

/// Writes the mean of each frame's channels. Sums in f64, so that channels near the largest f32 still have a
/// finite sum. Ignores an incomplete last frame.
///
/// # Panics
/// If `channels` is 0, or `mono` is shorter than the number of frames.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
#[inline]
pub fn mix(interleaved: &[f32], channels: usize, mono: &mut [f32]) {
    assert!(channels > 0, "a frame has at least one channel");
    let frames = interleaved.chunks_exact(channels);
    assert!(mono.len() >= frames.len(), "a sample for every frame");
    for (slot, frame) in mono.iter_mut().zip(frames) {
        *slot = (frame.iter().map(|&v| f64::from(v)).sum::<f64>() / channels as f64) as f32;
    }
}
