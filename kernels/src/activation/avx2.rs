//! 8 elements at a time, with the scalar bits: `exp` and the activations are the same operations,
//! sums have the same lanes.

use super::scalar;
use crate::isa::{Avx2, entry};
use crate::lanes::avx2::{HALF, load, load_part, reduce_max, store, store_part};
use crate::math::Activation;
use crate::math::avx2::{activate, exp};
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

entry! {
    pub(super) fn apply(_token: Avx2, activation: Activation, x: &mut [f32]) {
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

    pub(super) fn softmax(_token: Avx2, x: &mut [f32]) {
        let max = _mm256_set1_ps(largest_of(x));
        let (chunks, tail) = x.as_chunks_mut::<HALF>();
        for x in chunks {
            let value = exp(_mm256_sub_ps(load(x), max));
            store(x, value);
        }
        let value = exp(_mm256_sub_ps(load_part(tail), max));
        store_part(tail, value);
        scalar::divide(x);
    }
}

/// The largest value except NaN; minus infinity if all are NaN.
#[avx2]
fn largest_of(x: &[f32]) -> f32 {
    let (chunks, tail) = x.as_chunks::<HALF>();
    // `max` returns the second operand if one is a NaN.
    let mut max = _mm256_set1_ps(f32::NEG_INFINITY);
    for x in chunks {
        max = _mm256_max_ps(load(x), max);
    }
    tail.iter().fold(reduce_max(max), |max, &x| if x > max { x } else { max })
}

entry! {
    pub(super) fn argmax(_token: Avx2, x: &[f32]) -> Option<usize> {
        let value = largest_of(x);
        let max = _mm256_set1_ps(value);
        let (chunks, tail) = x.as_chunks::<HALF>();
        for (c, chunk) in chunks.iter().enumerate() {
            let found = _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_EQ_OQ>(load(chunk), max));
            if found != 0 {
                return Some(c * HALF + found.trailing_zeros() as usize);
            }
        }
        tail.iter().position(|&x| x == value).map(|i| chunks.len() * HALF + i)
    }
}
