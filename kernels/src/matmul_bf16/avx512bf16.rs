//! `vdpbf16ps`: rows and weights in bf16 by pairs, 32 multiply-adds with f32 sums, in the f32
//! product's loops.

use super::{Bf16Rows, scalar};
use crate::bf16::Bf16;
use crate::bf16::avx512bf16::multiply_pairs;
use crate::gemm::avx512vnni::{Step, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Avx512Bf16, entry};
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

entry! {
    pub(super) fn matmul_rows(token: Avx512Bf16, x: Bf16Rows, w: PackedBf16, epilogue: Epilogue, y: MatMut<f32>) {
        match x.lo {
            None => run::<_, _, true>(token, Input::all(x.hi), &GemmTask::Plain(w, epilogue), y),
            // Two bf16 products would take as long as one of f32.
            Some(_) => scalar::matmul_rows(x, w, epilogue, y),
        }
    }
}

/// A 32-bit lane holds a pair, the first value in its lower half.
impl Step<Bf16> for [[Bf16; PAIR]; PANEL] {
    const INPUTS: usize = PAIR;
    const SHARED: usize = 1;
    type Token = Avx512Bf16;

    #[inline]
    #[avx512vnni]
    unsafe fn weights(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: row `i` is inside the panel by this function's contract; the load needs no
        // alignment.
        unsafe { _mm512_loadu_ps(panel.wrapping_add(i).cast()) }
    }

    #[inline]
    #[avx512vnni]
    unsafe fn inputs(row: *const Bf16, i: usize) -> __m512 {
        // SAFETY: the row has both inputs of step `i` by this function's contract.
        let pair = unsafe { row.wrapping_add(PAIR * i).cast::<i32>().read_unaligned() };
        _mm512_castsi512_ps(_mm512_set1_epi32(pair))
    }

    #[inline]
    #[avx512vnni]
    unsafe fn last(row: *const Bf16, i: usize) -> __m512 {
        // SAFETY: the row has the first input of step `i` by this function's contract.
        let first = unsafe { *row.wrapping_add(PAIR * i) };
        _mm512_castsi512_ps(_mm512_set1_epi32(first.0.into()))
    }

    #[inline]
    #[avx512vnni]
    unsafe fn multiply<const FUSED: bool>(token: Avx512Bf16, sum: __m512, x: __m512, w: __m512) -> __m512 {
        multiply_pairs(token, x, w, sum)
    }
}
