//! The specification: the f32 product over widened weights.

use super::Bf16Rows;
use crate::bf16::Bf16;
use crate::gemm::scalar::{store_gated_panel, store_panel};
use crate::gemm::{Epilogue, Input};
use crate::mat::MatMut;
use crate::pack::{PAIR, PANEL, PackedBf16, panels};
pub(super) use crate::tiling::portable as tiling;

pub(super) fn matmul(_fused: bool, x: Input<f32>, w: PackedBf16, epilogue: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.rows() {
            store_panel(sums(x.row(t), w.panel(p)), t, p * PANEL, epilogue, &mut y);
        }
    }
}

pub(super) fn matmul_gated(_fused: bool, x: Input<f32>, gate: PackedBf16, up: PackedBf16, mut y: MatMut<f32>) {
    for p in 0..panels(gate.n()) {
        for t in 0..x.rows() {
            let row = x.row(t);
            store_gated_panel(sums(row, gate.panel(p)), sums(row, up.panel(p)), t, p * PANEL, &mut y);
        }
    }
}

pub(super) fn split_bf16x2(x: &[f32], hi: &mut [Bf16], lo: &mut [Bf16]) {
    for ((&x, hi), lo) in x.iter().zip(hi).zip(lo) {
        let upper = Bf16((x.to_bits() >> 16) as u16);
        *hi = upper;
        *lo = if x.is_infinite() { Bf16::default() } else { Bf16::from_f32(x - upper.to_f32()) };
    }
}

/// Adds the two parts of split rows before the product.
pub(super) fn matmul_rows(x: Bf16Rows, w: PackedBf16, epilogue: Epilogue, mut y: MatMut<f32>) {
    for p in 0..panels(w.n()) {
        for t in 0..x.hi.rows() {
            let mut sums = [0.0; PANEL];
            let rest = x.lo.as_ref().map(|rest| rest.row(t));
            for (i, x) in x.hi.row(t).iter().enumerate() {
                let x = x.to_f32() + rest.map_or(0.0, |rest| rest[i].to_f32());
                for (sum, pair) in sums.iter_mut().zip(&w.panel(p)[i / PAIR]) {
                    *sum += x * pair[i % PAIR].to_f32();
                }
            }
            store_panel(sums, t, p * PANEL, epilogue, &mut y);
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
