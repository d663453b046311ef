//! Element-wise functions: GELU, softmax, argmax.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;

use crate::isa::{Isa, dispatch};

pub use crate::math::Activation;

/// Applies `activation` to every element in place.
///
/// Numerics: both forms of GELU within 4 ULP of the exact value plus `1e-7 * abs(x)`; all back-ends
/// agree bit for bit.
pub fn apply(isa: Isa, activation: Activation, x: &mut [f32]) {
    dispatch!(isa, apply(activation, x))
}

/// Softmax in place: `x[i] = exp(x[i] - max) / sum_j exp(x[j] - max)`. An empty slice stays empty.
///
/// Numerics: relative error at most `(5 + abs(x[i] - max) + len) * 2^-23`, powers below 1.2e-38 are
/// 0; all back-ends agree bit for bit.
pub fn softmax(isa: Isa, x: &mut [f32]) {
    dispatch!(isa, softmax(x))
}

/// Index of the largest element, the lowest index if several are equal; `None` for an empty slice. NaN is
/// never the largest.
pub fn argmax(isa: Isa, x: &[f32]) -> Option<usize> {
    dispatch!(isa, argmax(x))
}
