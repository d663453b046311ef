//! The f32 product's loops over weights that are widened when loaded.

use crate::bf16::Bf16;
pub(super) use crate::gemm::neon::tiling;
use crate::gemm::neon::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Neon, entry};
use crate::lanes::neon::Register;
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::aarch64::*;
use umo_kernels_features::neon;

/// Mask of the second value of a pair, whose bits are in the position of an f32's.
const UPPER_HALF: u32 = u32::MAX << 16;

entry! {
    pub(super) fn matmul(
        _token: Neon,
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
        _token: Neon,
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
    #[neon]
    unsafe fn load(panel: *const Self, i: usize) -> [Register; 2] {
        // SAFETY: the row of input `i` is inside the panel by this function's contract.
        let (fours, _) = unsafe { &*panel.wrapping_add(i / PAIR) }.as_chunks::<4>();
        let which = i % PAIR;
        [[widen(&fours[0], which), widen(&fours[1], which)], [widen(&fours[2], which), widen(&fours[3], which)]]
    }
}

#[inline]
#[neon]
fn widen(src: &[[Bf16; PAIR]; 4], which: usize) -> float32x4_t {
    // SAFETY: `src` is 16 readable bytes, and the load needs no alignment.
    let pairs = vreinterpretq_u32_u8(unsafe { vld1q_u8(src.as_ptr().cast()) });
    vreinterpretq_f32_u32(if which == 0 { vshlq_n_u32::<16>(pairs) } else { vandq_u32(pairs, vdupq_n_u32(UPPER_HALF)) })
}
