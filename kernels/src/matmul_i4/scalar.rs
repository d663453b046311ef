//! The specification: exact integer sums, then one fixed order of roundings.

use crate::gemm::Epilogue;
use crate::gemm::scalar::{store_gated_panel, store_panel};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, NIBBLE_OFFSET, PANEL, PackedI4, QUAD, panels, spans};
use crate::tiling::Tiling;
use crate::tuning::Tuning;

/// Sizes at which the loops change.
pub(super) fn tiling() -> Tiling {
    Tiling { rows: &[1], outputs: &[PANEL], inputs: &[QUAD, GROUP], held: 0, chunk: 0 }
}

pub(super) fn matmul(x: QuantInput, w: PackedI4, epilogue: Epilogue, mut y: MatMut<f32>, _tuning: Tuning) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows.rows() {
            store_panel(scaled(x, t, w, p), t, p * PANEL, epilogue, &mut y);
        }
    }
}

pub(super) fn matmul_gated(x: QuantInput, gate: PackedI4, up: PackedI4, mut y: MatMut<f32>, _tuning: Tuning) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows.rows() {
            store_gated_panel(scaled(x, t, gate, p), scaled(x, t, up, p), t, p * PANEL, &mut y);
        }
    }
}

/// The real values of panel `p` for row `t`.
#[expect(clippy::cast_precision_loss, reason = "rounding the exact sum to f32 once is the contract")]
fn scaled(x: QuantInput, t: usize, w: PackedI4, p: usize) -> [f32; PANEL] {
    let sums = sums(x.rows.row(t), w.panel(p));
    let x_scale = x.scale(t);
    let mut values = [0.0; PANEL];
    for ((value, sum), w_scale) in values.iter_mut().zip(sums).zip(&w.scale()[p * PANEL..]) {
        *value = sum as f32 * (x_scale * w_scale);
    }
    values
}

/// Exact sums of one row with one panel.
fn sums(x: &[i8], panel: &[[u8; BLOCK]]) -> [i32; PANEL] {
    let mut sums = [0; PANEL];
    let groups = spans(panel).flat_map(|span| span.multipliers.iter().zip(span.groups));
    for (x, (multipliers, blocks)) in x.chunks(GROUP).zip(groups) {
        let mut group = [0; PANEL];
        for (x, block) in x.chunks(2 * QUAD).zip(blocks) {
            add_block(x, block, &mut group);
        }
        for ((sum, group), m) in sums.iter_mut().zip(group).zip(multipliers) {
            *sum += i32::from(m.cast_signed()) * group;
        }
    }
    sums
}

/// Adds the products of up to two quads of inputs with the codes of a block.
fn add_block(x: &[i8], block: &[u8; BLOCK], sums: &mut [i32; PANEL]) {
    let code = |nibble: u8| i32::from(nibble) - i32::from(NIBBLE_OFFSET);
    for (sum, bytes) in sums.iter_mut().zip(block.as_chunks::<QUAD>().0) {
        for (&x, byte) in x.iter().zip(bytes) {
            *sum += i32::from(x) * code(byte & 15);
        }
        for (&x, byte) in x.iter().skip(QUAD).zip(bytes) {
            *sum += i32::from(x) * code(byte >> 4);
        }
    }
}
