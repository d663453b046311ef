//! 4 elements at a time, with the scalar bits: `exp` and the activations are the same operations,
//! sums have the same lanes.

use super::scalar;
use crate::isa::Simd128;
use crate::lanes::simd128::{Register, WIDTH, load, load_part, max_lanes, reduce_max, splat, store, store_part, sub};
use crate::math::Activation;
use crate::math::simd128::{activate, exp};
use core::arch::wasm32::{f32x4_eq, v128_any_true};

pub(super) fn apply(_token: Simd128, activation: Activation, x: &mut [f32]) {
    if activation != Activation::None {
        each(x, |x| activate(activation, x));
    }
}

pub(super) fn softmax(_token: Simd128, x: &mut [f32]) {
    let max = splat(largest_of(x));
    each(x, |x| exp(sub(x, max)));
    scalar::divide(x);
}

#[inline(always)]
fn each(x: &mut [f32], f: impl Fn(Register) -> Register) {
    let (chunks, tail) = x.as_chunks_mut::<WIDTH>();
    for x in chunks {
        let value = f(load(x));
        store(x, value);
    }
    if !tail.is_empty() {
        let value = f(load_part(tail));
        store_part(tail, value);
    }
}

/// The largest value except NaN; minus infinity if all are NaN.
fn largest_of(x: &[f32]) -> f32 {
    let (chunks, tail) = x.as_chunks::<WIDTH>();
    let max = chunks.iter().fold(splat(f32::NEG_INFINITY), |max, x| max_lanes(max, load(x)));
    tail.iter().fold(reduce_max(max), |max, &x| if x > max { x } else { max })
}

pub(super) fn argmax(_token: Simd128, x: &[f32]) -> Option<usize> {
    let value = largest_of(x);
    let (chunks, _) = x.as_chunks::<WIDTH>();
    let max = splat(value);
    let chunk = chunks.iter().position(|x| v128_any_true(f32x4_eq(load(x), max))).unwrap_or(chunks.len());
    x[chunk * WIDTH..].iter().position(|&x| x == value).map(|i| chunk * WIDTH + i)
}
