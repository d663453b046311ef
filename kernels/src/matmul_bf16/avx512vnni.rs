//! The shared loops over weights that are widened to f32 when loaded.
//!
//! Not `vdpbf16ps`, which needs rounded inputs and has half the multiply-adds per cycle of
//! `vfmadd231ps` on Intel's processors.

use crate::bf16::Bf16;
pub(super) use crate::gemm::avx512vnni::tiling;
use crate::gemm::avx512vnni::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Mask of the second value of a pair, whose bits are in the position of an f32's.
const UPPER_HALF: i32 = -1 << 16;

entry! {
    pub(super) fn matmul(
        _token: Avx512Vnni,
        fused: bool,
        x: Input<f32>,
        w: PackedBf16,
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Plain(w, epilogue);
        if fused { run::<_, _, true>((), x, &task, y) } else { run::<_, _, false>((), x, &task, y) }
    }

    pub(super) fn matmul_gated(
        _token: Avx512Vnni,
        fused: bool,
        x: Input<f32>,
        gate: PackedBf16,
        up: PackedBf16,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Gated(gate, up);
        if fused { run::<_, _, true>((), x, &task, y) } else { run::<_, _, false>((), x, &task, y) }
    }
}

impl Load for [[Bf16; PAIR]; PANEL] {
    const INPUTS: usize = PAIR;

    /// A lane holds a pair, the first value in its lower half.
    #[inline]
    #[avx512vnni]
    unsafe fn load(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: the pairs of input `i` are inside the panel by this function's contract; the load
        // needs no alignment.
        let pairs = unsafe { _mm512_loadu_si512(panel.wrapping_add(i / PAIR).cast()) };
        _mm512_castsi512_ps(if i.is_multiple_of(PAIR) {
            _mm512_slli_epi32::<16>(pairs)
        } else {
            _mm512_and_si512(pairs, _mm512_set1_epi32(UPPER_HALF))
        })
    }
}
