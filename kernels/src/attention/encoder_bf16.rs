//! Attention over whole sequences with every factor rounded to bf16, for int8 projections,
//! which have no more precision.
//!
//! Sums are f32 and follow the order of `tdpbf16ps` on every back-end: of each [`STEP`]
//! products the even and the odd ones are summed separately, then added, then added to the
//! running sum. Products of two bf16 values are exact, so that fused and separate additions
//! agree. Scores and their maximum are in powers of 2.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512bf16;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;

use super::operands::Operands;
use crate::isa::{Isa, dispatch};
use crate::mat::MatMut;
use crate::math::scalar::exp;
use crate::tiling::Tiling;

/// Calls a back-end's bf16 attention.
macro_rules! dispatch_bf16 {
    ($isa:expr, $function:ident($($argument:expr),*)) => {
        dispatch!($isa, $function($($argument),*), {
            Scalar: scalar,
            Avx2: avx2,
            AvxVnni: avx2,
            Avx512Vnni: avx512vnni,
            Avx512Bf16: avx512bf16,
            Amx: amx,
            Neon: neon,
            NeonDotprod: neon,
            NeonI8mm: neon,
            Simd128: simd128,
        })
    };
}

pub(super) fn tiling(isa: Isa) -> Tiling {
    dispatch_bf16!(isa, tiling())
}

pub(super) fn attention(isa: Isa, operands: Operands<f32>, y: MatMut<f32>) {
    dispatch_bf16!(isa, attention(operands, y));
}

/// Keys per block, during which a query's maximum does not change.
const KEYS: usize = 256;

/// Products that are summed separately: a row of a tile.
const STEP: usize = 32;

/// State of one query's softmax, with scores in powers of 2.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    sum: f32,
    /// The factor that rescales the sums of earlier keys.
    shrink: f32,
}

impl Softmax {
    const START: Self = Self { max: f32::NEG_INFINITY, sum: 0.0, shrink: 0.0 };

    /// Updates the maximum with the largest score of more keys.
    fn update_max(&mut self, largest: f32) {
        let max = self.max.max(largest);
        // No sums exist before the first keys.
        let first = self.max == f32::NEG_INFINITY;
        self.shrink = if first { 0.0 } else { exp((self.max - max) * core::f32::consts::LN_2) };
        self.max = max;
    }

    /// Adds the weights of these keys.
    fn add(&mut self, sum: f32) {
        self.sum = self.sum * self.shrink + sum;
    }
}
