//! Single-precision matrix product with packed weights.

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
use crate::gemm::{Epilogue, Input, check_product};
use crate::isa::{Isa, dispatch};
use crate::mat::MatMut;
use crate::pack::PackedF32;
use crate::tiling::Tiling;

/// The [`Tiling`] of a back-end's product.
#[doc(hidden)]
pub fn tiling(isa: Isa) -> Tiling {
    dispatch!(isa, tiling())
}

/// Matrix product `y[t, o] = sum_i x[t, i] * w[o, i]`, then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with a scatter, `y [any, n]`.
/// Numerics: each output is summed separately over ascending `i`; a row's bits depend neither
/// on the other rows nor on the split of outputs into panels. Error at most `k * 2^-23 *
/// sum(abs(x * w))`.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_f32(isa: Isa, x: Input<f32>, w: PackedF32, epilogue: Epilogue, y: MatMut<f32>) -> Result<(), ShapeError> {
    check_product((x.rows(), x.cols()), (w.n(), w.k()), &y, &epilogue)?;
    dispatch!(isa.of_floats(), matmul(!isa.is_portable(), x, w, epilogue, y));
    Ok(())
}

/// Gated product `y[t, o] = gelu_tanh(sum_i x[t, i] * gate[o, i]) * sum_i x[t, i] * up[o, i]`.
///
/// Shapes: `x [m, k]`, `gate`, `up` `[n, k]` packed, `y [m, n]` (overwritten).
/// Numerics, cost: as [`matmul_f32`], twice.
/// Paper: section 3.2; SPEC 2.4.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_gated_f32(
    isa: Isa,
    x: Input<f32>,
    gate: PackedF32,
    up: PackedF32,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    check_product((x.rows(), x.cols()), (gate.n(), gate.k()), &y, &Epilogue::STORE)?;
    expect_len("up", gate.n(), up.n())?;
    expect_len("up", gate.k(), up.k())?;
    dispatch!(isa.of_floats(), matmul_gated(!isa.is_portable(), x, gate, up, y));
    Ok(())
}
