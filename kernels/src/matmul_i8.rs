//! Int8 matrix product: int8 weights per output row, activations quantised per row on the fly, int32 sums.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512bf16;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "x86_64")]
mod avxvnni;
#[cfg(target_arch = "x86_64")]
mod chunk;
mod quantize;
mod scalar;

use crate::error::{ShapeError, expect_len};
use crate::isa::{Backend, Isa};
use crate::mat::{Mat, MatMut};
use crate::matmul_f32::{Epilogue, Input, Panels, check_product};
use crate::pack::{PANEL, PackedI8, QUAD};

/// Longest row whose sum cannot overflow: `k * 128 * 128 <= i32::MAX`.
pub const MAX_K: usize = 131_071;

/// How a back-end cuts the product: rows that it multiplies at once, and inputs per step. Tests draw their shapes from it.
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    pub rows: usize,
    pub inputs: usize,
}

/// The [`Tiling`] of a back-end.
#[doc(hidden)]
pub fn tiling(isa: Isa) -> Tiling {
    match isa.0 {
        Backend::Scalar => Tiling { rows: 1, inputs: QUAD },
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 => Tiling { rows: avx2::ROWS, inputs: QUAD },
        #[cfg(target_arch = "x86_64")]
        Backend::AvxVnni => Tiling { rows: avxvnni::ROWS, inputs: QUAD },
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni => Tiling { rows: avx512vnni::ROWS, inputs: QUAD },
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Bf16 => Tiling { rows: avx512bf16::ROWS, inputs: QUAD },
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => Tiling { rows: amx::ROWS, inputs: amx::INPUTS },
    }
}

/// Quantised rows: `value = step * scale[row]`.
#[derive(Clone, Copy, Debug)]
pub struct QuantRows<'a> {
    steps: Mat<'a, i8>,
    scale: &'a [f32],
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
    match isa.0 {
        Backend::Scalar => scalar::largest(row),
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::AvxVnni => unsafe { quantize::avx2::largest(row) },
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { quantize::avx512vnni::largest(row) },
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => unsafe { quantize::avx512vnni::largest(row) },
    }
}

/// The steps of values of a row whose largest is `largest`.
fn round(isa: Isa, row: &[f32], largest: f32, steps: &mut [i8]) {
    let Some((per_unit, _)) = scalar::per_unit(largest) else { return steps.fill(0) };
    match isa.0 {
        Backend::Scalar => scalar::round(row, per_unit, steps),
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::AvxVnni => unsafe { quantize::avx2::round(row, per_unit, steps) },
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { quantize::avx512vnni::round(row, per_unit, steps) },
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => unsafe { quantize::avx512vnni::round(row, per_unit, steps) },
    }
}

/// Int8 product with int32 sums: `y[t, o] = x_scale[t] * w_scale[o] * sum_i x[t, i] * w[o, i]`, then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with an `index`, row `t` is `x[index[t]]`; with a scatter, `y [any, n]`.
/// Numerics: sums are exact for `k <= MAX_K` over all int8 values; `v = sum as f32 * (x_scale * w_scale)`; all
/// back-ends agree bit for bit.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees, or `k` above [`MAX_K`].
pub fn matmul_i8(
    isa: Isa,
    x: QuantRows,
    index: Option<&[u32]>,
    w: PackedI8,
    end: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let x = input(x, index)?;
    check_k(w.k())?;
    check_product((x.rows.rows(), x.rows.cols()), (w.n(), w.k()), &y, &end)?;
    match isa.0 {
        Backend::Scalar => scalar::matmul(x, w, end, y),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that `avx2` enables.
        Backend::Avx2 => unsafe { avx2::matmul(x, w, end, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `AvxVnni` only after detection of every feature that `avxvnni` enables.
        Backend::AvxVnni => unsafe { avxvnni::matmul(x, w, end, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that `avx512vnni` enables.
        Backend::Avx512Vnni => unsafe { avx512vnni::matmul(x, w, end, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Bf16` only where it could hold `Avx512Vnni`.
        Backend::Avx512Bf16 => unsafe { avx512bf16::matmul(x, w, end, y) },
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        // SAFETY: `Isa` holds `Amx` only after detection of tiles, and where it could hold `Avx512Vnni`.
        Backend::Amx => unsafe { amx::matmul(x, w, end, y) },
    }
    Ok(())
}

/// Gated int8 product: `gelu_tanh(x . gate) * (x . up)`, shapes and numerics as [`matmul_i8`].
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees, or `k` above [`MAX_K`].
pub fn matmul_gated_i8(
    isa: Isa,
    x: QuantRows,
    index: Option<&[u32]>,
    gate: PackedI8,
    up: PackedI8,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let x = input(x, index)?;
    check_k(gate.k())?;
    check_product((x.rows.rows(), x.rows.cols()), (gate.n(), gate.k()), &y, &Epilogue::STORE)?;
    expect_len("up", gate.n(), up.n())?;
    expect_len("up", gate.k(), up.k())?;
    match isa.0 {
        Backend::Scalar => scalar::matmul_gated(x, gate, up, y),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that `avx2` enables.
        Backend::Avx2 => unsafe { avx2::matmul_gated(x, gate, up, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `AvxVnni` only after detection of every feature that `avxvnni` enables.
        Backend::AvxVnni => unsafe { avxvnni::matmul_gated(x, gate, up, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that `avx512vnni` enables.
        Backend::Avx512Vnni => unsafe { avx512vnni::matmul_gated(x, gate, up, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Bf16` only where it could hold `Avx512Vnni`.
        Backend::Avx512Bf16 => unsafe { avx512bf16::matmul_gated(x, gate, up, y) },
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        // SAFETY: `Isa` holds `Amx` only after detection of tiles, and where it could hold `Avx512Vnni`.
        Backend::Amx => unsafe { amx::matmul_gated(x, gate, up, y) },
    }
    Ok(())
}

/// A job on int8 weights.
type Job<'a> = crate::matmul_f32::Job<'a, PackedI8<'a>>;

impl<'a> Panels<'a> for PackedI8<'a> {
    type Row = [i8; PANEL * QUAD];
    fn n(&self) -> usize {
        PackedI8::n(self)
    }
    fn k(&self) -> usize {
        PackedI8::k(self)
    }
    fn panel(&self, p: usize) -> &'a [[i8; PANEL * QUAD]] {
        PackedI8::panel(self, p)
    }
}

/// Checked input rows with their scales.
#[derive(Clone, Copy)]
pub(crate) struct QuantInput<'a> {
    rows: Input<'a, i8>,
    scale: &'a [f32],
}

impl QuantInput<'_> {
    fn scale(&self, t: usize) -> f32 {
        self.scale[self.rows.index.map_or(t, |index| index[t] as usize)]
    }
}

fn input<'a>(x: QuantRows<'a>, index: Option<&'a [u32]>) -> Result<QuantInput<'a>, ShapeError> {
    let rows = match index {
        Some(index) => Input::gather(x.steps, index)?,
        None => Input::all(x.steps),
    };
    Ok(QuantInput { rows, scale: x.scale })
}

fn check_k(k: usize) -> Result<(), ShapeError> {
    if k <= MAX_K { Ok(()) } else { Err(ShapeError { arg: "k", want: MAX_K, got: k }) }
}

pub(crate) use scalar::quantize as scalar_quantize;
