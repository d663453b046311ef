//! Matrix product with bf16 weights and f32 activations and sums.

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

use crate::bf16::Bf16;
use crate::error::{ShapeError, expect_len};
use crate::gemm::{Epilogue, Input, check_product};
use crate::isa::{Isa, dispatch};
use crate::mat::{Mat, MatMut};
use crate::pack::PackedBf16;
use crate::tiling::Tiling;

/// The [`Tiling`] of a back-end's product.
#[doc(hidden)]
pub fn tiling(isa: Isa) -> Tiling {
    dispatch!(isa.of_floats(), tiling(), with tiles)
}

/// Matrix product with bf16 weights, `y[t, o] = sum_i x[t, i] * w[o, i]` in f32, then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with a scatter, `y [any, n]`.
/// Numerics: weights are widened exactly, so the result equals that of
/// [`crate::matmul_f32::matmul_f32`] on the same back-end with the widened weights bit for bit. Exception:
/// the tiles of `amx` take bf16 on both sides. There an input is the sum of two bf16 values,
/// with a relative error of at most `2^-16`, and products of 32 inputs are summed before they
/// are accumulated. The error is at most `(k * 2^-23 + 2^-16) * sum(abs(x * w))`, and inputs,
/// weights, low parts, products and sums below `2^-126` are flushed to zero. On every back-end
/// each output is summed separately in an order that depends only on `k`: a row's bits depend
/// neither on the other rows nor on the split of outputs into panels.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_bf16(
    isa: Isa,
    x: Input<f32>,
    w: PackedBf16,
    epilogue: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    check_product((x.rows(), x.cols()), (w.n(), w.k()), &y, &epilogue)?;
    dispatch!(isa.of_floats(), matmul(!isa.is_portable(), x, w, epilogue, y), with tiles);
    Ok(())
}

/// Gated product with bf16 weights; as [`crate::matmul_f32::matmul_gated_f32`].
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_gated_bf16(
    isa: Isa,
    x: Input<f32>,
    gate: PackedBf16,
    up: PackedBf16,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    check_product((x.rows(), x.cols()), (gate.n(), gate.k()), &y, &Epilogue::STORE)?;
    expect_len("up", gate.n(), up.n())?;
    expect_len("up", gate.k(), up.k())?;
    dispatch!(isa.of_floats(), matmul_gated(!isa.is_portable(), x, gate, up, y), with tiles);
    Ok(())
}

/// Rows for bf16 products: each value is rounded ([`crate::bf16::round_bf16`]), or split in two
/// ([`split_bf16x2`]).
#[derive(Clone, Copy, Debug)]
pub struct Bf16Rows<'a> {
    /// The values, or their high parts.
    hi: Mat<'a, Bf16>,
    /// Low parts.
    lo: Option<Mat<'a, Bf16>>,
}

impl<'a> Bf16Rows<'a> {
    /// Rows `[m, k]` of rounded values; they may overlap.
    pub fn rounded(values: Mat<'a, Bf16>) -> Self {
        Self { hi: values, lo: None }
    }

    /// Rows `[m, k]` in two parts with the same layout in memory; they may overlap.
    ///
    /// # Errors
    /// [`ShapeError`] if the parts' shapes differ.
    pub fn split(hi: Mat<'a, Bf16>, lo: Mat<'a, Bf16>) -> Result<Self, ShapeError> {
        expect_len("lo", hi.rows(), lo.rows())?;
        expect_len("lo", hi.cols(), lo.cols())?;
        expect_len("lo", hi.stride(), lo.stride())?;
        Ok(Self { hi, lo: Some(lo) })
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.hi.rows()
    }
}

/// Splits every value in two: the upper half of its bits, and the remainder rounded to bf16.
///
/// Shapes: `x`, `hi`, `lo` `[n]` (both overwritten).
/// Numerics: `hi + lo` has a relative error of at most `2^-16`; the low part of an infinity is
/// zero, and at least one part of a NaN is NaN. The same bits on every back-end, except that
/// `amx` flushes a low part below `2^-126` to zero.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn split_bf16x2(isa: Isa, x: &[f32], hi: &mut [Bf16], lo: &mut [Bf16]) -> Result<(), ShapeError> {
    expect_len("hi", x.len(), hi.len())?;
    expect_len("lo", x.len(), lo.len())?;
    // The other back-ends do not use split rows for speed, so they need no faster split.
    dispatch!(isa.of_floats(), split_bf16x2(x, hi, lo), {
        Scalar: scalar,
        Avx2: scalar,
        AvxVnni: scalar,
        Avx512Vnni: scalar,
        Avx512Bf16: scalar,
        Amx: amx,
        Neon: scalar,
        NeonDotprod: scalar,
        NeonI8mm: scalar,
        Simd128: scalar,
    });
    Ok(())
}

/// [`matmul_bf16`] of rows that are bf16 already, for rows that overlap or are read by several
/// threads. On `amx`, split rows have the bits of the product of the original rows.
///
/// Shapes, numerics: as [`matmul_bf16`], with the values of the rows. `avx512bf16` adds the
/// products of rounded rows pair by pair, the second of each pair first, and flushes values
/// below `2^-126` to zero. Back-ends without tiles, and `avx512bf16` for split rows, use a slow
/// portable loop.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_bf16_rows(
    isa: Isa,
    x: Bf16Rows,
    w: PackedBf16,
    epilogue: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    check_product((x.hi.rows(), x.hi.cols()), (w.n(), w.k()), &y, &epilogue)?;
    dispatch!(isa.of_floats(), matmul_rows(x, w, epilogue, y), {
        Scalar: scalar,
        Avx2: scalar,
        AvxVnni: scalar,
        Avx512Vnni: scalar,
        Avx512Bf16: avx512bf16,
        Amx: amx,
        Neon: scalar,
        NeonDotprod: scalar,
        NeonI8mm: scalar,
        Simd128: scalar,
    });
    Ok(())
}
