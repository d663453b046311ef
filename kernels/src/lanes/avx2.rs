//! Registers of 8 lanes; two of them hold the 16.

use super::LANES;
use crate::bf16::Bf16;
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

/// Lanes of one register.
pub(crate) const HALF: usize = 8;

/// 8 lanes of f32.
pub(crate) type Register = __m256;

/// All bits of the first `len` lanes.
#[inline]
#[avx2]
pub(crate) fn lane_mask(len: usize) -> __m256i {
    let len = i32::try_from(len).unwrap_or(i32::MAX);
    _mm256_cmpgt_epi32(_mm256_set1_epi32(len), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
}

/// 8 values.
#[inline]
#[avx2]
pub(crate) fn load(src: &[f32; HALF]) -> __m256 {
    // SAFETY: `src` is 8 readable floats; the load needs no alignment.
    unsafe { _mm256_loadu_ps(src.as_ptr()) }
}

/// The first 8 values, padded with zeros.
#[inline]
#[avx2]
pub(crate) fn load_part(src: &[f32]) -> __m256 {
    let mask = lane_mask(src.len());
    // SAFETY: `mask` selects no more lanes than `src` has elements; the others are not read.
    unsafe { _mm256_maskload_ps(src.as_ptr(), mask) }
}

/// 8 values of a row from `at` on, padded with zeros. An empty range is not loaded: a masked
/// load from an unmapped address, such as that of an empty slice, takes a hundred cycles even with no
/// lane selected.
#[inline]
#[avx2]
pub(crate) fn load_at(row: &[f32], at: usize) -> Register {
    match row.get(at..) {
        Some(rest) if !rest.is_empty() => load_part(rest),
        _ => zero(),
    }
}

/// Stores 8 values.
#[inline]
#[avx2]
pub(crate) fn store(dst: &mut [f32; HALF], value: __m256) {
    // SAFETY: `dst` is 8 writable floats; the store needs no alignment.
    unsafe { _mm256_storeu_ps(dst.as_mut_ptr(), value) }
}

/// Stores as many of the 8 values as `dst` has room for.
#[inline]
#[avx2]
pub(crate) fn store_part(dst: &mut [f32], value: __m256) {
    let mask = lane_mask(dst.len());
    // SAFETY: `mask` selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm256_maskstore_ps(dst.as_mut_ptr(), mask, value) }
}

/// The 8 values as an array.
#[inline]
#[avx2]
pub(crate) fn to_array(value: __m256) -> [f32; HALF] {
    let mut lanes = [0.0; HALF];
    store(&mut lanes, value);
    lanes
}

/// The largest of the 8 values.
#[inline]
#[avx2]
pub(crate) fn reduce_max(value: __m256) -> f32 {
    let four = _mm_max_ps(_mm256_castps256_ps128(value), _mm256_extractf128_ps::<1>(value));
    let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
}

/// Zeros.
#[inline]
#[avx2]
pub(crate) fn zero() -> Register {
    _mm256_setzero_ps()
}

/// `value` in every lane.
#[inline]
#[avx2]
pub(crate) fn splat(value: f32) -> Register {
    _mm256_set1_ps(value)
}

/// `a + b`.
#[inline]
#[avx2]
pub(crate) fn add(a: Register, b: Register) -> Register {
    _mm256_add_ps(a, b)
}

/// `a - b`.
#[inline]
#[avx2]
pub(crate) fn sub(a: Register, b: Register) -> Register {
    _mm256_sub_ps(a, b)
}

/// `a * b`.
#[inline]
#[avx2]
pub(crate) fn mul(a: Register, b: Register) -> Register {
    _mm256_mul_ps(a, b)
}

/// `a * b + c`, rounded once.
#[inline]
#[avx2]
pub(crate) fn fmadd(a: Register, b: Register, c: Register) -> Register {
    _mm256_fmadd_ps(a, b, c)
}

/// The greater of each two lanes; `b` if one is NaN.
#[inline]
#[avx2]
pub(crate) fn max_lanes(a: Register, b: Register) -> Register {
    _mm256_max_ps(a, b)
}

/// The first `len` lanes of `a`, the others of `b`.
#[inline]
#[avx2]
pub(crate) fn select_first(len: usize, a: Register, b: Register) -> Register {
    _mm256_blendv_ps(b, a, _mm256_castsi256_ps(lane_mask(len)))
}

/// 8 values, widened.
#[inline]
#[avx2]
pub(crate) fn load_bf16(src: &[Bf16; HALF]) -> Register {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    let words = unsafe { _mm_loadu_si128(src.as_ptr().cast()) };
    _mm256_castsi256_ps(_mm256_slli_epi32::<16>(_mm256_cvtepu16_epi32(words)))
}

/// The first 8 values, widened, padded with zeros. AVX2 has no masked load of words: a copy
/// pads them.
#[inline]
#[avx2]
pub(crate) fn load_part_bf16(src: &[Bf16]) -> Register {
    let mut padded = [Bf16(0); HALF];
    let len = src.len().min(HALF);
    padded[..len].copy_from_slice(&src[..len]);
    load_bf16(&padded)
}

/// 16 values, in two registers.
#[inline]
#[avx2]
pub(crate) fn load_two(src: &[f32; LANES]) -> [Register; 2] {
    let (halves, _) = src.as_chunks::<HALF>();
    [load(&halves[0]), load(&halves[1])]
}

/// Stores 16 values from two registers.
#[inline]
#[avx2]
pub(crate) fn store_two(dst: &mut [f32; LANES], values: [Register; 2]) {
    let (halves, _) = dst.as_chunks_mut::<HALF>();
    store(&mut halves[0], values[0]);
    store(&mut halves[1], values[1]);
}
