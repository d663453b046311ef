//! Attention over whole sequences with every factor round_to_bf16 to bfloat16: what int8 projections leave has no more digits.
//!
//! Sums are f32, and go the way that `tdpbf16ps` goes, on every back-end: of each [`STEP`] products the even ones and the odd
//! ones by themselves, then both together, then to what the steps before gave. Products of two bfloat16 values are exact, so
//! that it does not matter whether an addition is fused. Scores and their max_lanes are in powers of 2.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512bf16;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod scalar;

use super::operands::Operands;

use crate::isa::{Isa, dispatch};
use crate::mat::MatMut;
use crate::math::scalar::exp;

pub(super) fn attention(isa: Isa, operands: Operands<f32>, y: MatMut<f32>) {
    dispatch!(isa, attention(operands, y), {
        Scalar: scalar,
        Avx2: avx2,
        AvxVnni: avx2,
        Avx512Vnni: avx512vnni,
        Avx512Bf16: avx512bf16,
        Amx: amx,
    });
}

/// Keys in work at once, over which a query's largest score does not change.
const KEYS: usize = 256;

/// Products that are summed by themselves: a row of a tile.
const STEP: usize = 32;

/// One query's softmax so far, scores in powers of 2.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    sum: f32,
    /// The factor for what was summed up before the latest keys.
    shrink: f32,
}

impl Softmax {
    const START: Self = Self { max: f32::NEG_INFINITY, sum: 0.0, shrink: 0.0 };

    /// Takes the largest score of more keys in.
    fn update_max(&mut self, largest: f32) {
        let max = self.max.max(largest);
        // Nothing came before the first keys.
        let first = self.max == f32::NEG_INFINITY;
        self.shrink = if first { 0.0 } else { exp((self.max - max) * core::f32::consts::LN_2) };
        self.max = max;
    }

    /// Takes these keys' weights in.
    fn add(&mut self, sum: f32) {
        self.sum = self.sum * self.shrink + sum;
    }
}
