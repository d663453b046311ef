//! Norms: RMS and layer norm over a row, statistics of a channel over time.

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
use crate::mat::{Mat, MatMut};

/// RMS norm as in T5, without mean and bias: `y = x / sqrt(mean(x^2) + eps) * weight`.
///
/// Shapes: `x [rows, dim]`, `weight [dim]`, `y [rows, dim]` (overwritten).
/// Numerics: the mean in f32 over 16 partial sums; relative error at most `(dim / 2 + 5) * 2^-23`;
/// all back-ends agree bit for bit.
/// Paper: section 3.2 (backbone); SPEC 2.4.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn rms_norm(isa: Isa, x: Mat<f32>, weight: &[f32], eps: f32, y: MatMut<f32>) -> Result<(), ShapeError> {
    expect_len("weight", x.cols(), weight.len())?;
    check_same(&x, &y)?;
    dispatch!(isa, rms_norm(x, weight, eps, y));
    Ok(())
}

/// Layer norm: `y = (x - mean(x)) / sqrt(var(x) + eps) * weight + bias`, variance over the row,
/// biased.
///
/// Shapes: `x [rows, dim]`, `weight`, `bias` `[dim]`, `y [rows, dim]` (overwritten).
/// Numerics: mean, then the mean of squared differences, each in f32 over 16 partial sums; all
/// back-ends agree bit for bit.
/// Paper: section 3 (audio tokenizer); SPEC 2.1.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn layer_norm(
    isa: Isa,
    x: Mat<f32>,
    weight: &[f32],
    bias: &[f32],
    eps: f32,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    expect_len("weight", x.cols(), weight.len())?;
    expect_len("bias", x.cols(), bias.len())?;
    check_same(&x, &y)?;
    dispatch!(isa, layer_norm(x, weight, bias, eps, y));
    Ok(())
}

/// Adds every channel's sum and sum of squares over time: the running statistics of a group norm
/// over a stream.
///
/// Shapes: `x [time, channels]`, `sum`, `squares` `[channels]` (added to).
/// Numerics: f64, in ascending time, so that any split of the stream into calls gives the
/// same bits.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn channel_sums(isa: Isa, x: Mat<f32>, sum: &mut [f64], squares: &mut [f64]) -> Result<(), ShapeError> {
    expect_len("sum", x.cols(), sum.len())?;
    expect_len("squares", x.cols(), squares.len())?;
    dispatch!(isa, channel_sums(x, sum, squares));
    Ok(())
}

/// Scales and shifts every channel in place: `x[t, c] = x[t, c] * scale[c] + shift[c]`.
///
/// Shapes: `x [time, channels]`, `scale`, `shift` `[channels]`.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn channel_affine(isa: Isa, x: MatMut<f32>, scale: &[f32], shift: &[f32]) -> Result<(), ShapeError> {
    expect_len("scale", x.cols(), scale.len())?;
    expect_len("shift", x.cols(), shift.len())?;
    dispatch!(isa, channel_affine(x, scale, shift));
    Ok(())
}

fn check_same(x: &Mat<f32>, y: &MatMut<f32>) -> Result<(), ShapeError> {
    expect_len("y", x.rows(), y.rows())?;
    expect_len("y", x.cols(), y.cols())
}
