//! The specification: a tile of scores at a time, with a running maximum.

use super::operands::{HeadOperands, Operands, Widen};
use crate::lanes::{LANES, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::scalar::exp;
use crate::tiling::Tiling;

/// Keys whose scores are held at once.
const TILE: usize = 64;

/// Sizes at which the loops change.
pub(super) fn tiling() -> Tiling {
    Tiling { rows: &[1], outputs: &[TILE], inputs: &[LANES], held: 0, chunk: 0 }
}

pub(super) fn attention<T: Widen>(x: Operands<T>, mut y: MatMut<f32>) {
    for i in 0..x.q.rows() {
        let k = x.k.row_range(0..x.keys(i));
        query(x.q.row(i), k, x.v, x.scale, x.bias(i, 0), y.row_mut(i));
    }
}

/// Sizes at which the loops over heads change.
pub(super) fn heads_tiling() -> Tiling {
    tiling()
}

/// Every head separately.
pub(super) fn heads(x: HeadOperands, mut y: MatMut<f32>) {
    x.each(&mut y, attention);
}

/// One query over all its keys; `y` holds the sum of values scaled by `exp(score - max)` until the
/// end.
fn query<T: Widen>(q: &[f32], k: Mat<T>, v: Mat<T>, scale: f32, bias: &[f32], y: &mut [f32]) {
    let (mut max, mut sums) = (f32::NEG_INFINITY, [0.0_f32; LANES]);
    y.fill(0.0);
    for first in (0..k.rows()).step_by(TILE) {
        let count = TILE.min(k.rows() - first);
        let mut scores = [0.0; TILE];
        for (j, score) in scores[..count].iter_mut().enumerate() {
            *score = scale * dot(q, k.row(first + j)) + bias.get(first + j).unwrap_or(&0.0);
        }
        let scores = &mut scores[..count];
        let new_max = scores.iter().fold(max, |max, &score| max.max(score));
        let shrink = exp(max - new_max);
        max = new_max;
        sums.iter_mut().for_each(|sum| *sum *= shrink);
        // Not a product, whose zeros may be negative.
        y.iter_mut().for_each(|y| *y = if shrink == 0.0 { 0.0 } else { *y * shrink });
        for (j, score) in scores.iter().enumerate() {
            let weight = exp(score - max);
            sums[j % LANES] += weight;
            for (y, v) in y.iter_mut().zip(v.row(first + j)) {
                *y += weight * v.widen();
            }
        }
    }
    let sum = pairwise(sums);
    y.iter_mut().for_each(|y| *y /= sum);
}

/// `sum_i a[i] * b[i]` in `LANES` partial sums, added pairwise at the end.
fn dot<T: Widen>(a: &[f32], b: &[T]) -> f32 {
    let mut sums = [0.0; LANES];
    let (a_chunks, a_tail) = a.as_chunks::<LANES>();
    let (b_chunks, b_tail) = b.as_chunks::<LANES>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane].widen();
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(a_tail.iter().zip(b_tail)) {
        *sum += a * b.widen();
    }
    pairwise(sums)
}
