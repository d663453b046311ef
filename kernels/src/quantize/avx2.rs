//! 8 values at a time.

use crate::isa::{Avx2, entry};
use crate::lanes::avx2::{self as lanes, HALF, load, load_part};
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

entry! {
    /// The largest absolute value.
    pub(super) fn largest(_token: Avx2, row: &[f32]) -> f32 {
        let (chunks, tail) = row.as_chunks::<HALF>();
        let sign = _mm256_set1_ps(-0.0);
        let mut max = _mm256_andnot_ps(sign, load_part(tail));
        for chunk in chunks {
            max = _mm256_max_ps(max, _mm256_andnot_ps(sign, load(chunk)));
        }
        lanes::reduce_max(max)
    }

    pub(super) fn round(_token: Avx2, row: &[f32], per_unit: f32, codes: &mut [i8]) {
        let factor = _mm256_set1_ps(per_unit);
        let ((chunks, tail), (code_chunks, code_tail)) = (row.as_chunks::<HALF>(), codes.as_chunks_mut::<HALF>());
        for (chunk, codes) in chunks.iter().zip(code_chunks) {
            *codes = rounded(_mm256_mul_ps(load(chunk), factor));
        }
        let last = rounded(_mm256_mul_ps(load_part(tail), factor));
        code_tail.copy_from_slice(&last[..code_tail.len()]);
    }
}

/// The nearest codes, ties to even.
#[inline]
#[avx2]
fn rounded(values: __m256) -> [i8; HALF] {
    let codes = _mm256_cvtps_epi32(values);
    let words = _mm_packs_epi32(_mm256_castsi256_si128(codes), _mm256_extracti128_si256::<1>(codes));
    _mm_cvtsi128_si64(_mm_packs_epi16(words, words)).to_le_bytes().map(|byte| byte.cast_signed())
}
