//! 8 elements at a time, with the scalar bits: `exp` and the activations are the same operations,
//! sums have the same lanes.

use super::scalar;
use crate::isa::{Neon, entry};
use crate::lanes::neon::{HALF, load, load_part, splat, store, store_part, sub};
use crate::math::Activation;
use crate::math::neon::{activate, exp};
use core::arch::aarch64::*;
use umo_kernels_features::neon;

entry! {
    pub(super) fn apply(_token: Neon, activation: Activation, x: &mut [f32]) {
        if activation == Activation::None {
            return;
        }
        let (chunks, tail) = x.as_chunks_mut::<HALF>();
        for x in chunks {
            let value = activate(activation, load(x));
            store(x, value);
        }
        let value = activate(activation, load_part(tail));
        store_part(tail, value);
    }

    pub(super) fn softmax(_token: Neon, x: &mut [f32]) {
        let max = splat(largest_of(x));
        let (chunks, tail) = x.as_chunks_mut::<HALF>();
        for x in chunks {
            let value = exp(sub(load(x), max));
            store(x, value);
        }
        let value = exp(sub(load_part(tail), max));
        store_part(tail, value);
        scalar::divide(x);
    }
}

/// The largest value except NaN; minus infinity if all are NaN.
#[neon]
fn largest_of(x: &[f32]) -> f32 {
    let (chunks, tail) = x.as_chunks::<HALF>();
    let mut max = splat(f32::NEG_INFINITY);
    for x in chunks {
        let x = load(x);
        for half in 0..2 {
            // A comparison with NaN is false.
            max[half] = vbslq_f32(vcgtq_f32(x[half], max[half]), x[half], max[half]);
        }
    }
    tail.iter().fold(vmaxvq_f32(vmaxq_f32(max[0], max[1])), |max, &x| if x > max { x } else { max })
}

entry! {
    pub(super) fn argmax(_token: Neon, x: &[f32]) -> Option<usize> {
        let value = largest_of(x);
        let max = vdupq_n_f32(value);
        let (chunks, _) = x.as_chunks::<HALF>();
        for (c, chunk) in chunks.iter().enumerate() {
            let [low, high] = load(chunk);
            if vmaxvq_u32(vorrq_u32(vceqq_f32(low, max), vceqq_f32(high, max))) != 0 {
                return chunk.iter().position(|&x| x == value).map(|i| c * HALF + i);
            }
        }
        let rest = chunks.len() * HALF;
        x[rest..].iter().position(|&x| x == value).map(|i| rest + i)
    }
}
