//! The peak of int8 with AVX-VNNI.

use core::arch::x86_64::{_mm256_dpbusd_avx_epi32, _mm256_set1_epi32, _mm256_setzero_si256};
use core::hint::black_box;

use super::avx2::SUMS;

/// `vpdpbusd` in registers of 32 bytes.
#[target_feature(enable = "avx2,avxvnni")]
pub(super) fn int8(rounds: usize) -> usize {
    let (x, w) = (_mm256_set1_epi32(black_box(1)), _mm256_set1_epi32(black_box(2)));
    let mut sums = [_mm256_setzero_si256(); SUMS];
    for _ in 0..rounds {
        for sum in &mut sums {
            *sum = _mm256_dpbusd_avx_epi32(*sum, x, w);
        }
    }
    black_box(sums);
    rounds * SUMS * 32
}
