//! The shared loops over weights that are f32 in memory.

use crate::gemm::neon::run;
pub(super) use crate::gemm::neon::tiling;
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Neon, entry};
use crate::mat::MatMut;
use crate::pack::PackedF32;

entry! {
    pub(super) fn matmul(
        _token: Neon,
        fused: bool,
        x: Input<f32>,
        w: PackedF32,
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
        gate: PackedF32,
        up: PackedF32,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Gated(gate, up);
        if fused { run::<_, true>(x, &task, y) } else { run::<_, false>(x, &task, y) }
    }
}
