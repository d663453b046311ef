//! Symmetric quantization of rows to int8: a maximum, one product, one rounding to nearest even; the
//! order does not matter.

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

/// Quantized rows: `value = code * scale[row]`.
#[derive(Clone, Copy, Debug)]
pub struct QuantRows<'a> {
    pub(crate) codes: Mat<'a, i8>,
    pub(crate) scale: &'a [f32],
}

impl<'a> QuantRows<'a> {
    /// `codes [m, k]` with the scale of each row, `scale [m]`.
    ///
    /// # Errors
    /// [`ShapeError`] if `scale` has another length than `codes` has rows.
    pub fn new(codes: Mat<'a, i8>, scale: &'a [f32]) -> Result<Self, ShapeError> {
        expect_len("scale", codes.rows(), scale.len())?;
        Ok(Self { codes, scale })
    }
}

/// Quantizes every row symmetrically: `scale[t] = max(abs(x[t])) / 127`, `codes = round(x /
/// scale)`, ties to even.
///
/// Shapes: `x [m, k]`, `codes [m, k]`, `scale [m]` (both overwritten).
/// Numerics: codes are in -127..=127; an all-zero row has scale 1. `x / scale` is computed as
/// `x * (127 / max)`; the same bits on every back-end. `x` must be finite.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn quantize_rows(isa: Isa, x: Mat<f32>, codes: MatMut<i8>, scale: &mut [f32]) -> Result<(), ShapeError> {
    expect_len("codes", x.rows(), codes.rows())?;
    expect_len("codes", x.cols(), codes.cols())?;
    expect_len("scale", x.rows(), scale.len())?;
    let mut codes = codes;
    for (t, scale) in scale.iter_mut().enumerate() {
        let row = x.row(t);
        let largest = largest(isa, row);
        *scale = quantization_scale(largest);
        round(isa, row, largest, codes.row_mut(t));
    }
    Ok(())
}

/// The largest absolute value of every row, by which [`quantize_rows`] scales. If the columns
/// of wide rows are divided among threads, each computes its own, and the largest of them is
/// passed to [`quantize_columns`].
///
/// Shapes: `x [m, k]`, `largest [m]` (overwritten). `x` must be finite.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn row_maxima(isa: Isa, x: &MatMut<f32>, largest: &mut [f32]) -> Result<(), ShapeError> {
    expect_len("largest", x.rows(), largest.len())?;
    for (t, largest) in largest.iter_mut().enumerate() {
        *largest = self::largest(isa, x.row(t));
    }
    Ok(())
}

/// Quantizes some columns of rows whose largest absolute value over all columns is `largest`,
/// with the scale [`quantization_scale`]; the codes equal the columns of
/// [`quantize_rows`] over all columns.
///
/// Shapes: `x [m, k]`, `largest [m]`, `codes [m, k]` (overwritten). `x` must be finite.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn quantize_columns(isa: Isa, x: &MatMut<f32>, largest: &[f32], mut codes: MatMut<i8>) -> Result<(), ShapeError> {
    expect_len("largest", x.rows(), largest.len())?;
    expect_len("codes", x.rows(), codes.rows())?;
    expect_len("codes", x.cols(), codes.cols())?;
    for (t, &largest) in largest.iter().enumerate() {
        round(isa, x.row(t), largest, codes.row_mut(t));
    }
    Ok(())
}

/// The scale of a row whose largest absolute value is `largest`.
pub fn quantization_scale(largest: f32) -> f32 {
    scalar::per_unit(largest).map_or(1.0, |(_, scale)| scale)
}

fn largest(isa: Isa, row: &[f32]) -> f32 {
    dispatch!(isa, largest(row))
}

/// The codes of a row whose largest absolute value is `largest`.
fn round(isa: Isa, row: &[f32], largest: f32, codes: &mut [i8]) {
    let Some((per_unit, _)) = scalar::per_unit(largest) else { return codes.fill(0) };
    dispatch!(isa, round(row, per_unit, codes))
}

/// Quantizes one weight row symmetrically and returns its scale, `max(abs(row)) / 127`, or 1 for
/// an all-zero row.
///
/// # Errors
/// [`ShapeError`] if `codes` has another length than `row`.
pub fn quantize_weight_row(row: &[f32], codes: &mut [i8]) -> Result<f32, ShapeError> {
    expect_len("codes", row.len(), codes.len())?;
    Ok(scalar::quantize(row, codes))
}
