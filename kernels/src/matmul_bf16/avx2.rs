//! The f32 product's loops over weights that are widened when loaded.

use crate::bf16::Bf16;
pub(super) use crate::gemm::avx2::tiling;
use crate::gemm::avx2::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Avx2, entry};
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

/// Mask of the second value of a pair, whose bits are in the position of an f32's.
const UPPER_HALF: i32 = -1 << 16;

entry! {
    pub(super) fn matmul(
        _token: Avx2,
        fused: bool,
        x: Input<f32>,
        w: PackedBf16,
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Plain(w, epilogue);
        if fused { run::<_, true>(x, &task, y) } else { run::<_, false>(x, &task, y) }
    }

    pub(super) fn matmul_gated(
        _token: Avx2,
        fused: bool,
        x: Input<f32>,
        gate: PackedBf16,
        up: PackedBf16,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Gated(gate, up);
        if fused { run::<_, true>(x, &task, y) } else { run::<_, false>(x, &task, y) }
    }
}

impl Load for [[Bf16; PAIR]; PANEL] {
    const INPUTS: usize = PAIR;

    /// A lane holds a pair, the first value in its lower half.
    #[inline]
    #[avx2]
    unsafe fn load(panel: *const Self, i: usize) -> [__m256; 2] {
        // SAFETY: the row of input `i` is inside the panel by this function's contract.
        let (halves, _) = unsafe { &*panel.wrapping_add(i / PAIR) }.as_chunks::<8>();
        [widen(&halves[0], i % PAIR), widen(&halves[1], i % PAIR)]
    }
}

#[inline]
#[avx2]
fn widen(src: &[[Bf16; PAIR]; 8], which: usize) -> __m256 {
    // SAFETY: `src` is 32 readable bytes; the load needs no alignment.
    let pairs = unsafe { _mm256_loadu_si256(src.as_ptr().cast()) };
    _mm256_castsi256_ps(if which == 0 {
        _mm256_slli_epi32::<16>(pairs)
    } else {
        _mm256_and_si256(pairs, _mm256_set1_epi32(UPPER_HALF))
    })
}
