//! Registers of 8 lanes: two of them are the 16.

use core::arch::x86_64::*;

/// Lanes of one register.
pub(crate) const HALF: usize = 8;

/// All bits of the first `len` lanes.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn first_lanes(len: usize) -> __m256i {
    let len = i32::try_from(len).unwrap_or(i32::MAX);
    _mm256_cmpgt_epi32(_mm256_set1_epi32(len), _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7))
}

/// 8 values.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn load(src: &[f32; HALF]) -> __m256 {
    // SAFETY: `src` is 8 readable floats; the load needs no alignment.
    unsafe { _mm256_loadu_ps(src.as_ptr()) }
}

/// The first 8 values, zeros where there are fewer.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn load_part(src: &[f32]) -> __m256 {
    let mask = first_lanes(src.len());
    // SAFETY: `mask` selects no more lanes than `src` has elements; the others are not read.
    unsafe { _mm256_maskload_ps(src.as_ptr(), mask) }
}

/// 8 values.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn store(dst: &mut [f32; HALF], value: __m256) {
    // SAFETY: `dst` is 8 writable floats; the store needs no alignment.
    unsafe { _mm256_storeu_ps(dst.as_mut_ptr(), value) }
}

/// As many of the 8 values as `dst` has room for.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn store_part(dst: &mut [f32], value: __m256) {
    let mask = first_lanes(dst.len());
    // SAFETY: `mask` selects no more lanes than `dst` has elements; the others are not written.
    unsafe { _mm256_maskstore_ps(dst.as_mut_ptr(), mask, value) }
}

/// The 8 values as an array.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn array(value: __m256) -> [f32; HALF] {
    let mut lanes = [0.0; HALF];
    store(&mut lanes, value);
    lanes
}

/// The largest of the 8 values.
#[inline]
#[target_feature(enable = "avx2")]
pub(crate) fn largest(value: __m256) -> f32 {
    let four = _mm_max_ps(_mm256_castps256_ps128(value), _mm256_extractf128_ps::<1>(value));
    let two = _mm_max_ps(four, _mm_movehl_ps(four, four));
    _mm_cvtss_f32(_mm_max_ss(two, _mm_movehdup_ps(two)))
}
