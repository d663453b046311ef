//! The peak of int8 with AVX-VNNI.

use super::avx2::SUMS;
use crate::isa::{AvxVnni, entry};
use core::arch::x86_64::{_mm256_dpbusd_avx_epi32, _mm256_set1_epi32, _mm256_setzero_si256};
use core::hint::black_box;

entry! {
    /// `vpdpbusd` in registers of 32 bytes.
    pub(super) fn int8(_token: AvxVnni, rounds: usize) -> Option<usize> {
        let (x, w) = (_mm256_set1_epi32(black_box(1)), _mm256_set1_epi32(black_box(2)));
        let mut sums = [_mm256_setzero_si256(); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm256_dpbusd_avx_epi32(*sum, x, w);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 32)
    }
}
