//! The specification: exact integer sums, then one fixed order of roundings.

use super::QuantInput;
use crate::mat::MatMut;
use crate::matmul_f32::{Epilogue, finish_panel, gated};
use crate::pack::{PANEL, PackedI8, QUAD, panels};

/// Quantises one row, returns the real value of one step.
pub(crate) fn quantize(row: &[f32], steps: &mut [i8]) -> f32 {
    let Some((per_unit, scale)) = per_unit(largest(row)) else {
        steps.fill(0);
        return 1.0;
    };
    round(row, per_unit, steps);
    scale
}

/// The largest size of a value.
pub(super) fn largest(row: &[f32]) -> f32 {
    row.iter().fold(0.0, |max, x| max.max(x.abs()))
}

/// The nearest steps, halves to even.
#[expect(clippy::cast_possible_truncation, reason = "rounded values lie in -127..=127")]
pub(super) fn round(row: &[f32], per_unit: f32, steps: &mut [i8]) {
    for (step, x) in steps.iter_mut().zip(row) {
        *step = (x * per_unit).round_ties_even() as i8;
    }
}

/// Steps per unit and the size of a step, for a row whose largest value is `max`; none for a row of zeros.
#[inline]
pub(super) fn per_unit(max: f32) -> Option<(f32, f32)> {
    let per_unit = 127.0 / max;
    // Nor where a denormal maximum makes the quotient infinite: such a row is zero to any precision that matters.
    per_unit.is_finite().then_some((per_unit, max / 127.0))
}

pub(super) fn matmul(x: QuantInput, w: PackedI8, end: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows.rows() {
            finish_panel(scaled(x, t, w, p), t, p * PANEL, end, &mut y);
        }
    }
}

pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, mut y: MatMut<f32>) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows.rows() {
            gated(scaled(x, t, gate, p), scaled(x, t, up, p), t, p * PANEL, &mut y);
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
