//! 16 values at a time.

use crate::isa::{Avx512Vnni, entry};
use crate::lanes::LANES;
use crate::lanes::avx512vnni::{lane_mask, load, load_part};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

entry! {
    /// The largest absolute value.
    pub(super) fn largest(_token: Avx512Vnni, row: &[f32]) -> f32 {
        let (chunks, tail) = row.as_chunks::<LANES>();
        let mut max = _mm512_abs_ps(load_part(tail));
        for chunk in chunks {
            max = _mm512_max_ps(max, _mm512_abs_ps(load(chunk)));
        }
        _mm512_reduce_max_ps(max)
    }

    pub(super) fn round(_token: Avx512Vnni, row: &[f32], per_unit: f32, codes: &mut [i8]) {
        let factor = _mm512_set1_ps(per_unit);
        let ((chunks, tail), (code_chunks, code_tail)) = (row.as_chunks::<LANES>(), codes.as_chunks_mut::<LANES>());
        for (chunk, codes) in chunks.iter().zip(code_chunks) {
            store_part(codes, _mm512_mul_ps(load(chunk), factor));
        }
        store_part(code_tail, _mm512_mul_ps(load_part(tail), factor));
    }
}

/// Rounds to the nearest codes, ties to even, and stores as many of the 16 as `dst` has room for.
#[inline]
#[avx512vnni]
fn store_part(dst: &mut [i8], values: __m512) {
    let codes = _mm512_cvtepi32_epi8(_mm512_cvtps_epi32(values));
    // SAFETY: the mask selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm_mask_storeu_epi8(dst.as_mut_ptr(), lane_mask(dst.len()), codes) }
}
