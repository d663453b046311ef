//! The shared loops over weights that are f32 in memory.

pub(super) use crate::gemm::avx512vnni::tiling;
use crate::gemm::avx512vnni::{Load, run};
use crate::gemm::{Epilogue, GemmTask, Input};
use crate::isa::{Avx512Vnni, entry};
use crate::lanes::avx512vnni::load;
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedF32};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

entry! {
    pub(super) fn matmul(
        _token: Avx512Vnni,
        fused: bool,
        x: Input<f32>,
        w: PackedF32,
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
        gate: PackedF32,
        up: PackedF32,
        y: MatMut<f32>,
    ) {
        let task = GemmTask::Gated(gate, up);
        if fused { run::<_, _, true>((), x, &task, y) } else { run::<_, _, false>((), x, &task, y) }
    }
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[avx512vnni]
    unsafe fn load(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: row `i` is inside the panel by this function's contract.
        load(unsafe { &*panel.wrapping_add(i) })
    }
}
