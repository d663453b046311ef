//! Filters: one output of a finite impulse response.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "aarch64")]
mod neon;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;

use crate::error::{ShapeError, expect_len};
use crate::isa::{Isa, dispatch};

/// Dot product of a filter's taps with the samples: `sum_i taps[i] * samples[i]`.
///
/// Shapes: `taps [n]`, `samples [n]`.
/// Numerics: f32 over 32 partial sums, no fused multiply-add; the error is at most
/// `(n / 32 + 6) * 2^-24 * sum_i |taps[i] * samples[i]|`; all back-ends agree bit for bit.
///
/// # Errors
/// [`ShapeError`] if the numbers of taps and samples differ.
pub fn dot(isa: Isa, taps: &[f32], samples: &[f32]) -> Result<f32, ShapeError> {
    expect_len("samples", taps.len(), samples.len())?;
    Ok(dispatch!(isa, dot(taps, samples)))
}
