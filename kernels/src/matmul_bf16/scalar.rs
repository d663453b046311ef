//! The specification: the f32 product over widened weights.

use crate::bf16::Bf16;
use crate::mat::MatMut;
use crate::matmul_f32::{Epilogue, Input, finish_panel, gated};
use crate::pack::{PAIR, PANEL, PackedBf16, panels};

pub(super) fn matmul(x: Input<f32>, w: PackedBf16, end: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows() {
            finish_panel(sums(x.row(t), w.panel(p)), t, p * PANEL, end, &mut y);
        }
    }
}

pub(super) fn matmul_gated(x: Input<f32>, gate: PackedBf16, up: PackedBf16, mut y: MatMut<f32>) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows() {
            let row = x.row(t);
            gated(sums(row, gate.panel(p)), sums(row, up.panel(p)), t, p * PANEL, &mut y);
        }
    }
}

fn sums(x: &[f32], panel: &[[[Bf16; PAIR]; PANEL]]) -> [f32; PANEL] {
    let mut sums = [0.0; PANEL];
    for (x, w) in x.chunks(PAIR).zip(panel) {
        for (i, &x) in x.iter().enumerate() {
            for lane in 0..PANEL {
                sums[lane] += x * w[lane][i].to_f32();
            }
        }
    }
    sums
}
