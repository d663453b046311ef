//! Symmetric quantization of rows to int8: a maximum, one product, one rounding to even, in any order.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod scalar;

use crate::error::{ShapeError, expect_len};
use crate::isa::{Isa, dispatch};
use crate::mat::{Mat, MatMut};

/// Quantised rows: `value = step * scale[row]`.
#[derive(Clone, Copy, Debug)]
pub struct QuantRows<'a> {
    pub(crate) steps: Mat<'a, i8>,
    pub(crate) scale: &'a [f32],
}

impl<'a> QuantRows<'a> {
    /// `steps [m, k]` with the real value of one step per row, `scale [m]`.
    ///
    /// # Errors
    /// [`ShapeError`] where `scale` has another length than `steps` has rows.
    pub fn new(steps: Mat<'a, i8>, scale: &'a [f32]) -> Result<Self, ShapeError> {
        expect_len("scale", steps.rows(), scale.len())?;
        Ok(Self { steps, scale })
    }
}

/// Quantises every row symmetrically: `scale[t] = max(abs(x[t])) / 127`, `steps = round(x / scale)`, halves to even.
///
/// Shapes: `x [m, k]`, `steps [m, k]`, `scale [m]` (both overwritten).
/// Numerics: steps lie in -127..=127; an all-zero row has scale 1. `x / scale` is computed as `x * (127 / max)`; the
/// same bits on every back-end. `x` must be finite.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn quantize_rows(isa: Isa, x: Mat<f32>, steps: MatMut<i8>, scale: &mut [f32]) -> Result<(), ShapeError> {
    expect_len("steps", x.rows(), steps.rows())?;
    expect_len("steps", x.cols(), steps.cols())?;
    expect_len("scale", x.rows(), scale.len())?;
    let mut steps = steps;
    for (t, scale) in scale.iter_mut().enumerate() {
        let row = x.row(t);
        let largest = largest(isa, row);
        *scale = step_size(largest);
        round(isa, row, largest, steps.row_mut(t));
    }
    Ok(())
}

/// The largest size of a value in every row, which is what [`quantize_rows`] quantises by: where the columns of wide rows are
/// in several hands, each finds its own, and the largest of them goes to [`quantize_columns`].
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

/// Quantises some columns of rows of which `largest` says the largest size of a value in any column; the steps are those of
/// [`quantize_rows`] over all columns, each of the size [`step_size`].
///
/// Shapes: `x [m, k]`, `largest [m]`, `steps [m, k]` (overwritten). `x` must be finite.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn quantize_columns(isa: Isa, x: &MatMut<f32>, largest: &[f32], mut steps: MatMut<i8>) -> Result<(), ShapeError> {
    expect_len("largest", x.rows(), largest.len())?;
    expect_len("steps", x.rows(), steps.rows())?;
    expect_len("steps", x.cols(), steps.cols())?;
    for (t, &largest) in largest.iter().enumerate() {
        round(isa, x.row(t), largest, steps.row_mut(t));
    }
    Ok(())
}

/// The real value of one step of a row whose values are `largest` in size at most.
pub fn step_size(largest: f32) -> f32 {
    scalar::per_unit(largest).map_or(1.0, |(_, scale)| scale)
}

fn largest(isa: Isa, row: &[f32]) -> f32 {
    dispatch!(isa, largest(row))
}

/// The steps of values of a row whose largest is `largest`.
fn round(isa: Isa, row: &[f32], largest: f32, steps: &mut [i8]) {
    let Some((per_unit, _)) = scalar::per_unit(largest) else { return steps.fill(0) };
    dispatch!(isa, round(row, per_unit, steps))
}

/// Quantises one weight row symmetrically: the step is `max(abs(row)) / 127`, returned; an all-zero row has step 1.
///
/// # Errors
/// [`ShapeError`] where `steps` has another length than `row`.
pub fn quantize_weight_row(row: &[f32], steps: &mut [i8]) -> Result<f32, ShapeError> {
    expect_len("steps", row.len(), steps.len())?;
    Ok(scalar::quantize(row, steps))
}
