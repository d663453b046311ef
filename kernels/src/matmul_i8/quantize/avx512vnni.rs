//! 16 values at a time.

use crate::lanes::LANES;
use crate::lanes::avx512vnni::{first_lanes, load, load_part};
use crate::mat::{Mat, MatMut};
use crate::matmul_i8::scalar::per_unit;
use core::arch::x86_64::*;

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(in crate::matmul_i8) fn quantize_rows(x: Mat<f32>, mut steps: MatMut<i8>, scale: &mut [f32]) {
    for (t, scale) in scale.iter_mut().enumerate() {
        *scale = quantize(x.row(t), steps.row_mut(t));
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn quantize(row: &[f32], steps: &mut [i8]) -> f32 {
    let (chunks, tail) = row.as_chunks::<LANES>();
    let mut max = _mm512_abs_ps(load_part(tail));
    for chunk in chunks {
        max = _mm512_max_ps(max, _mm512_abs_ps(load(chunk)));
    }
    let Some((per_unit, scale)) = per_unit(_mm512_reduce_max_ps(max)) else {
        steps.fill(0);
        return 1.0;
    };
    let factor = _mm512_set1_ps(per_unit);
    let (step_chunks, step_tail) = steps.as_chunks_mut::<LANES>();
    for (chunk, steps) in chunks.iter().zip(step_chunks) {
        store_part(steps, _mm512_mul_ps(load(chunk), factor));
    }
    store_part(step_tail, _mm512_mul_ps(load_part(tail), factor));
    scale
}

/// Rounds to the nearest steps, halves to even, and stores as many of the 16 as `dst` has room for.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn store_part(dst: &mut [i8], values: __m512) {
    let steps = _mm512_cvtepi32_epi8(_mm512_cvtps_epi32(values));
    // SAFETY: the mask selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm_mask_storeu_epi8(dst.as_mut_ptr(), first_lanes(dst.len()), steps) }
}
