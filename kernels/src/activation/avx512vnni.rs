//! 16 elements at a time, with the scalar bits: `exp` and the activations are the same operations,
//! sums have the same lanes.

use super::scalar;
use crate::isa::{Avx512Vnni, entry};
use crate::lanes::LANES;
use crate::lanes::avx512vnni::{lane_mask, load, load_part, store, store_part};
use crate::math::Activation;
use crate::math::avx512vnni::{activate, exp};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

entry! {
    pub(super) fn apply(_token: Avx512Vnni, activation: Activation, x: &mut [f32]) {
        if activation == Activation::None {
            return;
        }
        let (chunks, tail) = x.as_chunks_mut::<LANES>();
        for x in chunks {
            let value = activate(activation, load(x));
            store(x, value);
        }
        let value = activate(activation, load_part(tail));
        store_part(tail, value);
    }

    pub(super) fn softmax(_token: Avx512Vnni, x: &mut [f32]) {
        let max = _mm512_set1_ps(largest_of(x));
        let (chunks, tail) = x.as_chunks_mut::<LANES>();
        for x in chunks {
            let value = exp(_mm512_sub_ps(load(x), max));
            store(x, value);
        }
        let value = exp(_mm512_sub_ps(load_part(tail), max));
        store_part(tail, value);
        scalar::divide(x);
    }
}

/// The largest value except NaN; minus infinity if all are NaN.
#[avx512vnni]
fn largest_of(x: &[f32]) -> f32 {
    let (chunks, tail) = x.as_chunks::<LANES>();
    // `max` returns the second operand if one is a NaN.
    let mut max = _mm512_set1_ps(f32::NEG_INFINITY);
    for x in chunks {
        max = _mm512_max_ps(load(x), max);
    }
    let max = _mm512_mask_max_ps(max, lane_mask(tail.len()), load_part(tail), max);
    _mm512_reduce_max_ps(max)
}

entry! {
    pub(super) fn argmax(_token: Avx512Vnni, x: &[f32]) -> Option<usize> {
        let max = _mm512_set1_ps(largest_of(x));
        let (chunks, tail) = x.as_chunks::<LANES>();
        for (c, chunk) in chunks.iter().enumerate() {
            let found = _mm512_cmp_ps_mask::<_CMP_EQ_OQ>(load(chunk), max);
            if found != 0 {
                return Some(c * LANES + found.trailing_zeros() as usize);
            }
        }
        let found = _mm512_mask_cmp_ps_mask::<_CMP_EQ_OQ>(lane_mask(tail.len()), load_part(tail), max);
        (found != 0).then(|| chunks.len() * LANES + found.trailing_zeros() as usize)
    }
}
