//! One register of 16 lanes.

use super::LANES;
use crate::bf16::Bf16;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// 16 lanes of f32.
pub(crate) type Register = __m512;

/// Bits of the first `len` lanes.
#[inline]
pub(crate) fn lane_mask(len: usize) -> __mmask16 {
    if len >= LANES { !0 } else { (1 << len) - 1 }
}

/// 16 values.
#[inline]
#[avx512vnni]
pub(crate) fn load(src: &[f32; LANES]) -> __m512 {
    // SAFETY: `src` is 16 readable floats; the load needs no alignment.
    unsafe { _mm512_loadu_ps(src.as_ptr()) }
}

/// The first 16 values, padded with zeros.
#[inline]
#[avx512vnni]
pub(crate) fn load_part(src: &[f32]) -> __m512 {
    // SAFETY: the mask selects no more lanes than `src` has elements; the others are not read.
    unsafe { _mm512_maskz_loadu_ps(lane_mask(src.len()), src.as_ptr()) }
}

/// 16 values of a row from `at` on, padded with zeros. An empty range is not loaded: a masked
/// load from an unmapped address, such as that of an empty slice, takes a hundred cycles even with no
/// lane selected.
#[inline]
#[avx512vnni]
pub(crate) fn load_at(row: &[f32], at: usize) -> Register {
    match row.get(at..) {
        Some(rest) if !rest.is_empty() => load_part(rest),
        _ => zero(),
    }
}

/// Stores 16 values.
#[inline]
#[avx512vnni]
pub(crate) fn store(dst: &mut [f32; LANES], value: __m512) {
    // SAFETY: `dst` is 16 writable floats; the store needs no alignment.
    unsafe { _mm512_storeu_ps(dst.as_mut_ptr(), value) }
}

/// Stores as many of the 16 values as `dst` has room for.
#[inline]
#[avx512vnni]
pub(crate) fn store_part(dst: &mut [f32], value: __m512) {
    // SAFETY: the mask selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm512_mask_storeu_ps(dst.as_mut_ptr(), lane_mask(dst.len()), value) }
}

/// The 16 values as an array.
#[inline]
#[avx512vnni]
pub(crate) fn to_array(value: __m512) -> [f32; LANES] {
    let mut lanes = [0.0; LANES];
    store(&mut lanes, value);
    lanes
}

/// Zeros.
#[inline]
#[avx512vnni]
pub(crate) fn zero() -> Register {
    _mm512_setzero_ps()
}

/// `value` in every lane.
#[inline]
#[avx512vnni]
pub(crate) fn splat(value: f32) -> Register {
    _mm512_set1_ps(value)
}

/// `a + b`.
#[inline]
#[avx512vnni]
pub(crate) fn add(a: Register, b: Register) -> Register {
    _mm512_add_ps(a, b)
}

/// `a - b`.
#[inline]
#[avx512vnni]
pub(crate) fn sub(a: Register, b: Register) -> Register {
    _mm512_sub_ps(a, b)
}

/// `a * b`.
#[inline]
#[avx512vnni]
pub(crate) fn mul(a: Register, b: Register) -> Register {
    _mm512_mul_ps(a, b)
}

/// `a * b + c`, rounded once.
#[inline]
#[avx512vnni]
pub(crate) fn fmadd(a: Register, b: Register, c: Register) -> Register {
    _mm512_fmadd_ps(a, b, c)
}

/// The greater of each two lanes; `b` if one is NaN.
#[inline]
#[avx512vnni]
pub(crate) fn max_lanes(a: Register, b: Register) -> Register {
    _mm512_max_ps(a, b)
}

/// The largest of the 16 values.
#[inline]
#[avx512vnni]
pub(crate) fn reduce_max(value: Register) -> f32 {
    _mm512_reduce_max_ps(value)
}

/// The first `len` lanes of `a`, the others of `b`.
#[inline]
#[avx512vnni]
pub(crate) fn select_first(len: usize, a: Register, b: Register) -> Register {
    _mm512_mask_blend_ps(lane_mask(len), b, a)
}

/// 16 values, widened.
#[inline]
#[avx512vnni]
pub(crate) fn load_bf16(src: &[Bf16; LANES]) -> Register {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    widen(unsafe { _mm256_loadu_si256(src.as_ptr().cast()) })
}

/// The first 16 values, widened, padded with zeros.
#[inline]
#[avx512vnni]
pub(crate) fn load_part_bf16(src: &[Bf16]) -> Register {
    // SAFETY: the mask selects no more lanes than `src` has elements; the others are not read.
    widen(unsafe { _mm256_maskz_loadu_epi16(lane_mask(src.len()), src.as_ptr().cast()) })
}

/// bfloat16 is the upper half of an f32.
#[inline]
#[avx512vnni]
fn widen(words: __m256i) -> Register {
    _mm512_castsi512_ps(_mm512_slli_epi32::<16>(_mm512_cvtepu16_epi32(words)))
}
