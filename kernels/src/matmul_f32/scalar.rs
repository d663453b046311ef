//! The specification: one panel of outputs at a time, inputs in ascending order.

use crate::gemm::scalar::{store_gated_panel, store_panel};
use crate::gemm::{Epilogue, Input};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedF32, panels};
pub(super) use crate::tiling::portable as tiling;

pub(super) fn matmul(_fused: bool, x: Input<f32>, w: PackedF32, epilogue: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows() {
            store_panel(sums(x.row(t), w.panel(p)), t, p * PANEL, epilogue, &mut y);
        }
    }
}

pub(super) fn matmul_gated(_fused: bool, x: Input<f32>, gate: PackedF32, up: PackedF32, mut y: MatMut<f32>) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows() {
            let row = x.row(t);
            store_gated_panel(sums(row, gate.panel(p)), sums(row, up.panel(p)), t, p * PANEL, &mut y);
        }
    }
}

/// `sum_i x[i] * panel[i][lane]` for every lane.
fn sums(x: &[f32], panel: &[[f32; PANEL]]) -> [f32; PANEL] {
    let mut sums = [0.0; PANEL];
    for (&x, w) in x.iter().zip(panel) {
        for lane in 0..PANEL {
            sums[lane] += x * w[lane];
        }
    }
    sums
}
