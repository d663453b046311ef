//! The specification.

use super::{KEYS, STEP, Softmax};
use crate::attention::operands::Operands;
use crate::bf16::Bf16;
use crate::lanes::{LANES, pairwise};
use crate::mat::MatMut;
use crate::math::LOG2_E;
use crate::math::scalar::{exp2_bf16, mul_add};
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling() -> Tiling {
    Tiling { rows: &[1], outputs: &[STEP, KEYS], inputs: &[STEP], held: 0, chunk: 0 }
}

pub(super) fn attention(x: Operands<f32>, mut y: MatMut<f32>) {
    for i in 0..x.q.rows() {
        query(x, i, y.row_mut(i));
    }
}

/// One query over all keys; `y` holds the sum of values times weights until the end.
fn query(x: Operands<f32>, i: usize, y: &mut [f32]) {
    let (q, bias) = (x.q.row(i), x.bias(i, 0));
    let mut softmax = Softmax::START;
    for first in (0..x.k.rows()).step_by(KEYS) {
        let mut weights = [0.0; KEYS];
        let weights = &mut weights[..KEYS.min(x.k.rows() - first)];
        for (j, score) in weights.iter_mut().enumerate() {
            let k = x.k.row(first + j);
            let product = sum_of_products(q.len(), |d| round_to_bf16(q[d]) * round_to_bf16(k[d]));
            *score = mul_add(product, x.scale * LOG2_E, bias.get(first + j).unwrap_or(&0.0) * LOG2_E);
        }
        softmax.update_max(weights.iter().fold(f32::NEG_INFINITY, |max, &score| max.max(score)));
        weights.iter_mut().for_each(|weight| *weight = exp2_bf16(*weight - softmax.max));
        softmax.add(sum(weights));
        for (c, y) in y.iter_mut().enumerate() {
            let value = |j: usize| round_to_bf16(x.v.row(first + j)[c]);
            let sum = sum_of_products(weights.len(), |j| round_to_bf16(weights[j]) * value(j));
            *y = if first > 0 { mul_add(*y, softmax.shrink, sum) } else { sum };
        }
    }
    y.iter_mut().for_each(|y| *y /= softmax.sum);
}

/// `sum_i product(i)`.
fn sum_of_products(len: usize, product: impl Fn(usize) -> f32) -> f32 {
    let mut sum = 0.0;
    for first in (0..len).step_by(STEP) {
        let (mut even, mut odd) = (0.0, 0.0);
        for i in (first..len.min(first + STEP)).step_by(2) {
            even += product(i);
            if i + 1 < len {
                odd += product(i + 1);
            }
        }
        sum += even + odd;
    }
    sum
}

/// The sum of weights; in each pair of 16 keys, lanes are added first.
fn sum(weights: &[f32]) -> f32 {
    let mut lanes = [0.0; LANES];
    for step in weights.chunks(STEP) {
        for (lane, sum) in lanes.iter_mut().enumerate() {
            *sum += step.get(lane).unwrap_or(&0.0) + step.get(LANES + lane).unwrap_or(&0.0);
        }
    }
    pairwise(lanes)
}

/// The nearest bf16, ties to even; denormals are flushed to 0, as on tiles.
fn round_to_bf16(x: f32) -> f32 {
    if x.abs() < f32::MIN_POSITIVE { 0.0 } else { Bf16::from_f32(x).to_f32() }
}
