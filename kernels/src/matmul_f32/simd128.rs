//! The shared loops over weights that are f32 in memory.

pub(super) use crate::gemm::simd128::tiling;
use crate::gemm::simd128::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::Simd128;
use crate::lanes::simd128::{REGISTERS, Register, load_all};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedF32};

pub(super) fn matmul(_token: Simd128, _fused: bool, x: Input<f32>, w: PackedF32, epilogue: Epilogue, y: MatMut<f32>) {
    run(x, &GemmTask::Plain(w, epilogue), y);
}

pub(super) fn matmul_gated(
    _token: Simd128,
    _fused: bool,
    x: Input<f32>,
    gate: PackedF32,
    up: PackedF32,
    y: MatMut<f32>,
) {
    run(x, &GemmTask::Gated(gate, up), y);
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    fn load(&self, _which: usize) -> [Register; REGISTERS] {
        load_all(self)
    }
}
