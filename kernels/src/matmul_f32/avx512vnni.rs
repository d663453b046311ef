//! The shared loops over weights that are f32 in memory.

use crate::gemm::avx512vnni::{Load, run};
use crate::gemm::{Epilogue, Input, Job};
use crate::lanes::avx512vnni::load;
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedF32};
use core::arch::x86_64::*;

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: Input<f32>, w: PackedF32, end: Epilogue, y: MatMut<f32>) {
    run(x, &Job::Plain(w, end), y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: Input<f32>, gate: PackedF32, up: PackedF32, y: MatMut<f32>) {
    run(x, &Job::Gated(gate, up), y);
}

impl Load for [f32; PANEL] {
    const INPUTS: usize = 1;

    #[inline]
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    unsafe fn load(panel: *const Self, i: usize) -> __m512 {
        // SAFETY: row `i` is inside the panel by this function's contract.
        load(unsafe { &*panel.wrapping_add(i) })
    }
}
