//! The specification: exact integer sums, then one fixed order of roundings.

use super::input::QuantInput;
use crate::gemm::Epilogue;
use crate::gemm::scalar::{store_gated_panel, store_panel};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD, panels};
pub(super) use crate::tiling::portable as tiling;
use crate::tuning::Tuning;

pub(super) fn matmul(x: QuantInput, w: PackedI8, epilogue: Epilogue, mut y: MatMut<f32>, _tuning: Tuning) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows.rows() {
            store_panel(scaled(x, t, w, p), t, p * PANEL, epilogue, &mut y);
        }
    }
}

pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, mut y: MatMut<f32>, _tuning: Tuning) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows.rows() {
            store_gated_panel(scaled(x, t, gate, p), scaled(x, t, up, p), t, p * PANEL, &mut y);
        }
    }
}

/// The real values of panel `p` for row `t`.
#[expect(clippy::cast_precision_loss, reason = "rounding the exact sum to f32 once is the contract")]
fn scaled(x: QuantInput, t: usize, w: PackedI8, p: usize) -> [f32; PANEL] {
    let sums = sums(x.rows.row(t), w.panel(p));
    let x_scale = x.scale(t);
    let mut values = [0.0; PANEL];
    for ((value, sum), w_scale) in values.iter_mut().zip(sums).zip(&w.scale()[p * PANEL..]) {
        *value = sum as f32 * (x_scale * w_scale);
    }
    values
}

/// Exact sums of one row with one panel.
fn sums(x: &[i8], panel: &[[i8; PANEL * QUAD]]) -> [i32; PANEL] {
    let mut sums = [0; PANEL];
    for (x, w) in x.chunks(QUAD).zip(panel) {
        for (lane, w) in w.as_chunks::<QUAD>().0.iter().enumerate() {
            for (&x, &w) in x.iter().zip(w) {
                sums[lane] += i32::from(x) * i32::from(w);
            }
        }
    }
    sums
}
