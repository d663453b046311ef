//! One register of 16 lanes.

use super::LANES;
use core::arch::x86_64::*;

/// Bits of the first `len` lanes.
#[inline]
pub(crate) fn first_lanes(len: usize) -> __mmask16 {
    if len >= LANES { !0 } else { (1 << len) - 1 }
}

/// 16 values.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn load(src: &[f32; LANES]) -> __m512 {
    // SAFETY: `src` is 16 readable floats; the load needs no alignment.
    unsafe { _mm512_loadu_ps(src.as_ptr()) }
}

/// The first 16 values, zeros where there are fewer.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn load_part(src: &[f32]) -> __m512 {
    // SAFETY: the mask selects no more lanes than `src` has elements; the others are not read.
    unsafe { _mm512_maskz_loadu_ps(first_lanes(src.len()), src.as_ptr()) }
}

/// 16 values.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn store(dst: &mut [f32; LANES], value: __m512) {
    // SAFETY: `dst` is 16 writable floats; the store needs no alignment.
    unsafe { _mm512_storeu_ps(dst.as_mut_ptr(), value) }
}

/// As many of the 16 values as `dst` has room for.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn store_part(dst: &mut [f32], value: __m512) {
    // SAFETY: the mask selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm512_mask_storeu_ps(dst.as_mut_ptr(), first_lanes(dst.len()), value) }
}

/// The 16 values as an array.
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) fn array(value: __m512) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    store(&mut lanes, value);
    lanes
}
