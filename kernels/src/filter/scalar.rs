//! The reference. Its loop runs in independent lanes, so that the vector back-ends are the same
//! function, compiled for their instruction set.

use crate::lanes::{LANES, pairwise};

/// Partial sums: two AVX-512 registers, so that an addition need not wait for the previous one.
pub(crate) const SUMS: usize = 2 * LANES;

#[inline(always)]
pub(super) fn dot(taps: &[f32], samples: &[f32]) -> f32 {
    let mut sums = [0.0; SUMS];
    let ((taps, taps_tail), (samples, samples_tail)) = (taps.as_chunks::<SUMS>(), samples.as_chunks::<SUMS>());
    for (taps, samples) in taps.iter().zip(samples) {
        for (sum, (tap, sample)) in sums.iter_mut().zip(taps.iter().zip(samples)) {
            *sum += tap * sample;
        }
    }
    for (sum, (tap, sample)) in sums.iter_mut().zip(taps_tail.iter().zip(samples_tail)) {
        *sum += tap * sample;
    }
    pairwise(sums)
}
