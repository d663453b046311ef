//! The f32 product's loops over weights that are widened as they are loaded.
//!
//! Not `vdpbf16ps`: it multiplies half as many pairs per cycle as `vfmadd231ps` does on the processors measured, and
//! rounds in another way.

use crate::bf16::Bf16;
use crate::mat::MatMut;
use crate::matmul_f32::avx512vnni::{Load, run};
use crate::matmul_f32::{Epilogue, Input, Job};
use crate::pack::{PANEL, PackedBf16};
use core::arch::x86_64::*;

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: Input<f32>, w: PackedBf16, end: Epilogue, y: MatMut<f32>) {
    run(x, &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedBf16, up: PackedBf16, y: MatMut<f32>) {
    run(x, &Job::Gated(gate, up), y);
}

impl Load for Bf16 {
    #[inline]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    unsafe fn load(src: &[Self; PANEL]) -> __m512 {
        // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
        let words = unsafe { _mm256_loadu_si256(src.as_ptr().cast()) };
        _mm512_castsi512_ps(_mm512_slli_epi32::<16>(_mm512_cvtepu16_epi32(words)))
    }

    /// One permutation: every word goes to the upper half of its lane, over zeros.
    #[inline]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    unsafe fn load_of_two(src: &[[Self; PANEL]; 2], which: usize) -> __m512 {
        const UPPER_HALVES: __mmask32 = 0xaaaa_aaaa;
        // SAFETY: `src` is 64 readable bytes; the load needs no alignment.
        let words = unsafe { _mm512_loadu_si512(src.as_ptr().cast()) };
        // Word `2 i + 1` of the first register is word `i`, of the second word `16 + i`.
        let lane = _mm512_set_epi32(15, 14, 13, 12, 11, 10, 9, 8, 7, 6, 5, 4, 3, 2, 1, 0);
        let word = if which == 0 { lane } else { _mm512_add_epi32(lane, _mm512_set1_epi32(16)) };
        _mm512_castsi512_ps(_mm512_maskz_permutexvar_epi16(UPPER_HALVES, _mm512_slli_epi32::<16>(word), words))
    }
}
