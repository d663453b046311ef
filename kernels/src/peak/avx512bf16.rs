//! The peak of pairs of bf16.

use super::avx512vnni::SUMS;
use crate::bf16::avx512bf16::multiply_pairs;
use crate::isa::{Avx512Bf16, entry};
use core::arch::x86_64::{_mm512_castsi512_ps, _mm512_set1_epi32, _mm512_setzero_ps};
use core::hint::black_box;

/// A pair of ones.
const ONES: i32 = 0x3f80_3f80;

entry! {
    /// `vdpbf16ps`.
    pub(super) fn pairs(token: Avx512Bf16, rounds: usize) -> Option<usize> {
        let [x, w] = [(); 2].map(|()| _mm512_castsi512_ps(_mm512_set1_epi32(black_box(ONES))));
        let mut sums = [_mm512_setzero_ps(); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = multiply_pairs(token, x, w, *sum);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 32)
    }
}
