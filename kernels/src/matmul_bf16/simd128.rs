//! The f32 product's loops over weights that are widened when loaded.

use crate::bf16::Bf16;
pub(super) use crate::gemm::simd128::tiling;
use crate::gemm::simd128::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::Simd128;
use crate::lanes::simd128::{REGISTERS, Register, zero};
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16};
use core::arch::wasm32::*;

pub(super) fn matmul(_token: Simd128, _fused: bool, x: Input<f32>, w: PackedBf16, epilogue: Epilogue, y: MatMut<f32>) {
    run(x, &GemmTask::Plain(w, epilogue), y);
}

pub(super) fn matmul_gated(
    _token: Simd128,
    _fused: bool,
    x: Input<f32>,
    gate: PackedBf16,
    up: PackedBf16,
    y: MatMut<f32>,
) {
    run(x, &GemmTask::Gated(gate, up), y);
}

impl Load for [[Bf16; PAIR]; PANEL] {
    const INPUTS: usize = PAIR;

    /// A lane holds a pair, the first value in its lower half.
    #[inline]
    fn load(&self, which: usize) -> [Register; REGISTERS] {
        let mut weights = [zero(); REGISTERS];
        for (weights, four) in weights.iter_mut().zip(self.as_chunks::<4>().0) {
            // SAFETY: `four` is 16 readable bytes; the load needs no alignment.
            let pairs = unsafe { v128_load(four.as_ptr().cast()) };
            *weights = if which == 0 { u32x4_shl(pairs, 16) } else { v128_and(pairs, u32x4_splat(u32::MAX << 16)) };
        }
        weights
    }
}
