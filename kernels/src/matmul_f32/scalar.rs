//! The specification: one panel of outputs at a time, inputs in ascending order.

use super::{Epilogue, Input};
use crate::activation::activate;
use crate::mat::MatMut;
use crate::math::scalar::gelu_tanh;
use crate::pack::{PANEL, PackedF32, panels};

pub(super) fn matmul(x: Input<f32>, w: PackedF32, end: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows() {
            finish_panel(sums(x.row(t), w.panel(p)), t, p * PANEL, end, &mut y);
        }
    }
}

pub(super) fn matmul_gated(x: Input<f32>, gate: PackedF32, up: PackedF32, mut y: MatMut<f32>) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows() {
            let row = x.row(t);
            gated(sums(row, gate.panel(p)), sums(row, up.panel(p)), t, p * PANEL, &mut y);
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

/// Ends the outputs `first..` of row `t`, whose sums are given.
pub(crate) fn finish_panel(sums: [f32; PANEL], t: usize, first: usize, end: Epilogue, y: &mut MatMut<f32>) {
    let outputs = first..(first + PANEL).min(y.cols());
    let value = |lane: usize| {
        let sum = end.bias.map_or(sums[lane], |bias| sums[lane] + bias[first + lane]);
        activate(end.activation, sum)
    };
    let row = end.scatter.map_or(t, |scatter| scatter.rows[t] as usize);
    let y = &mut y.row_mut(row)[outputs];
    for (lane, y) in y.iter_mut().enumerate() {
        *y = match end.scatter {
            Some(scatter) => *y + scatter.weight[t] * value(lane),
            None if end.add => *y + value(lane),
            None => value(lane),
        };
    }
}

/// Ends the gated outputs `first..` of row `t`.
pub(crate) fn gated(gate: [f32; PANEL], up: [f32; PANEL], t: usize, first: usize, y: &mut MatMut<f32>) {
    let outputs = first..(first + PANEL).min(y.cols());
    for ((y, gate), up) in y.row_mut(t)[outputs].iter_mut().zip(gate).zip(up) {
        *y = gelu_tanh(gate) * up;
    }
}
