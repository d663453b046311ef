//! The specification: a tile of scores at a time, with a running maximum.

use super::{RelativeBias, Visible};
use crate::mat::{Mat, MatMut};

/// Keys whose scores are held at once.
const TILE: usize = 64;

/// Partial sums of a dot product: one AVX-512 register, so that every back-end can add in the same order.
const LANES: usize = 16;

pub(super) fn attention(
    q: Mat<f32>,
    k: Mat<f32>,
    v: Mat<f32>,
    scale: f32,
    bias: Option<RelativeBias>,
    visible: Visible,
    mut y: MatMut<f32>,
) {
    for i in 0..q.rows() {
        let keys = match visible {
            Visible::All => k.rows(),
            Visible::Causal { first } => first + i + 1,
        };
        let bias = bias.map(|bias| &bias.values[bias.origin - i..bias.origin - i + keys]);
        query(q.row(i), k.row_range(0..keys), v, scale, bias, y.row_mut(i));
    }
}

/// One query over all its keys; `y` holds the sum of values scaled by `exp(score - max)` until the end.
fn query(q: &[f32], k: Mat<f32>, v: Mat<f32>, scale: f32, bias: Option<&[f32]>, y: &mut [f32]) {
    let (mut max, mut sum) = (f32::NEG_INFINITY, 0.0_f32);
    y.fill(0.0);
    for first in (0..k.rows()).step_by(TILE) {
        let count = TILE.min(k.rows() - first);
        let mut scores = [0.0; TILE];
        for (j, score) in scores[..count].iter_mut().enumerate() {
            *score = scale * dot(q, k.row(first + j)) + bias.map_or(0.0, |bias| bias[first + j]);
        }
        let scores = &mut scores[..count];
        let new_max = scores.iter().fold(max, |max, &score| max.max(score));
        let shrink = (max - new_max).exp();
        (max, sum) = (new_max, sum * shrink);
        y.iter_mut().for_each(|y| *y *= shrink);
        for (j, score) in scores.iter().enumerate() {
            let weight = (score - max).exp();
            sum += weight;
            for (y, v) in y.iter_mut().zip(v.row(first + j)) {
                *y += weight * v;
            }
        }
    }
    y.iter_mut().for_each(|y| *y /= sum);
}

/// `sum_i a[i] * b[i]` in `LANES` partial sums, added pairwise at the end.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0; LANES];
    let (a_chunks, a_tail) = a.as_chunks::<LANES>();
    let (b_chunks, b_tail) = b.as_chunks::<LANES>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    for (sum, (a, b)) in sums.iter_mut().zip(a_tail.iter().zip(b_tail)) {
        *sum += a * b;
    }
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    sums[0]
}
