//! The peak of pairs of bfloat16.

use core::arch::x86_64::{_mm512_castsi512_ps, _mm512_set1_epi32, _mm512_setzero_ps};
use core::hint::black_box;

use super::avx512vnni::SUMS;
use crate::bf16::avx512bf16::multiply_pairs;

/// `vdpbf16ps`.
///
/// # Safety
/// The processor has the feature "avx512bf16".
#[target_feature(enable = "avx512f")]
pub(super) unsafe fn pairs(rounds: usize) -> usize {
    /// 1 and 1.
    const ONES: i32 = 0x3f80_3f80;
    let [x, w] = [(); 2].map(|()| _mm512_castsi512_ps(_mm512_set1_epi32(black_box(ONES))));
    let mut sums = [_mm512_setzero_ps(); SUMS];
    for _ in 0..rounds {
        for sum in &mut sums {
            // SAFETY: by this function's contract.
            *sum = unsafe { multiply_pairs(x, w, *sum) };
        }
    }
    black_box(sums);
    rounds * SUMS * 32
}
