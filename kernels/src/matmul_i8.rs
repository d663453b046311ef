//! Int8 matrix product: int8 weights per output row, activations quantized per row on the fly,
//! int32 sums.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512vnni;
#[cfg(target_arch = "x86_64")]
mod avxvnni;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod chunk;
pub(crate) mod input;
#[cfg(target_arch = "aarch64")]
pub(crate) mod neon;
#[cfg(target_arch = "aarch64")]
pub(crate) mod neon_dotprod;
#[cfg(target_arch = "aarch64")]
mod neon_i8mm;
mod scalar;
#[cfg(target_arch = "wasm32")]
pub(crate) mod simd128;

use crate::error::{ShapeError, expect_len};
use crate::gemm::{Epilogue, Input, check_product};
use crate::isa::{Isa, dispatch};
use crate::mat::MatMut;
use crate::pack::PackedI8;
use crate::quantize::QuantRows;
use crate::tiling::Tiling;
use input::QuantInput;

/// Longest row whose sum cannot overflow: `k * 128 * 128 <= i32::MAX`.
pub const MAX_K: usize = 131_071;

/// Calls a back-end's int8 product; each instruction set with byte dot products has its own.
macro_rules! dispatch_i8 {
    ($isa:expr, $function:ident($($argument:expr),*)) => {
        dispatch!($isa, $function($($argument),*), {
            Scalar: scalar,
            Avx2: avx2,
            AvxVnni: avxvnni,
            Avx512Vnni: avx512vnni,
            Avx512Bf16: avx512vnni,
            Amx: amx,
            Neon: neon,
            NeonDotprod: neon_dotprod,
            NeonI8mm: neon_i8mm,
            Simd128: simd128,
        })
    };
}

/// The [`Tiling`] of a back-end's product.
#[doc(hidden)]
pub fn tiling(isa: Isa) -> Tiling {
    dispatch_i8!(isa, tiling())
}

/// Int8 product with int32 sums: `y[t, o] = x_scale[t] * w_scale[o] * sum_i x[t, i] * w[o, i]`,
/// then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with an `index`, row `t` is `x[index[t]]`;
/// with a scatter, `y [any, n]`.
/// Numerics: sums are exact for `k <= MAX_K` over all int8 values; `v = sum as f32 * (x_scale *
/// w_scale)`; all back-ends agree bit for bit.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees, or `k` above [`MAX_K`].
pub fn matmul_i8(
    isa: Isa,
    x: QuantRows,
    index: Option<&[u32]>,
    w: PackedI8,
    epilogue: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let x = input(x, index)?;
    check_k(w.k())?;
    check_product((x.rows.rows(), x.rows.cols()), (w.n(), w.k()), &y, &epilogue)?;
    dispatch_i8!(isa, matmul(x, w, epilogue, y, isa.tuning()));
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
    dispatch_i8!(isa, matmul_gated(x, gate, up, y, isa.tuning()));
    Ok(())
}

pub(crate) fn input<'a>(x: QuantRows<'a>, index: Option<&'a [u32]>) -> Result<QuantInput<'a>, ShapeError> {
    let rows = match index {
        Some(index) => Input::gather(x.codes, index)?,
        None => Input::all(x.codes),
    };
    Ok(QuantInput { rows, scale: x.scale })
}

pub(crate) fn check_k(k: usize) -> Result<(), ShapeError> {
    if k <= MAX_K { Ok(()) } else { Err(ShapeError { arg: "k", want: MAX_K, got: k }) }
}
