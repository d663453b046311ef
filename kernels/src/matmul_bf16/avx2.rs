//! The f32 product's loops over weights that are widened as they are loaded.

use crate::bf16::Bf16;
use crate::mat::MatMut;
use crate::matmul_f32::avx2::{Load, run};
use crate::matmul_f32::{Epilogue, Input, Job};
use crate::pack::{PANEL, PackedBf16};
use core::arch::x86_64::*;

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul(x: Input<f32>, w: PackedBf16, end: Epilogue, y: MatMut<f32>) {
    run(x, &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedBf16, up: PackedBf16, y: MatMut<f32>) {
    run(x, &Job::Gated(gate, up), y);
}

impl Load for Bf16 {
    #[inline]
    #[target_feature(enable = "avx2,fma")]
    unsafe fn load(src: &[Self; PANEL]) -> [__m256; 2] {
        let (halves, _) = src.as_chunks::<8>();
        [widen(&halves[0]), widen(&halves[1])]
    }
}

#[inline]
#[target_feature(enable = "avx2,fma")]
fn widen(src: &[Bf16; 8]) -> __m256 {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    let words = unsafe { _mm_loadu_si128(src.as_ptr().cast()) };
    _mm256_castsi256_ps(_mm256_slli_epi32::<16>(_mm256_cvtepu16_epi32(words)))
}
