//! The shared loops over weights that are f32 in memory.

pub(super) use crate::gemm::neon::tiling;
use crate::gemm::neon::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Neon, entry};
use crate::lanes::neon::{Register, load_two};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedF32};
use umo_kernels_features::neon;

entry! {
    pub(super) fn matmul(_token: Neon, x: Input<f32>, w: PackedF32, epilogue: Epilogue, y: MatMut<f32>) {
        run(x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: Neon, x: Input<f32>, gate: PackedF32, up: PackedF32, y: MatMut<f32>) {
        run(x, &GemmTask::Gated(gate, up), y);
    }
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[neon]
    unsafe fn load(panel: *const Self, i: usize) -> [Register; 2] {
        // SAFETY: row `i` is inside the panel by this function's contract.
        load_two(unsafe { &*panel.wrapping_add(i) })
    }
}
