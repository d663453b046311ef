//! Single-precision matrix product with packed weights.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod scalar;

use crate::error::{ShapeError, expect_len};
use crate::gemm::{Epilogue, Input, check_product};
use crate::isa::{Backend, Isa};
use crate::mat::MatMut;
use crate::pack::PackedF32;

/// Matrix product `y[t, o] = sum_i x[t, i] * w[o, i]`, then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with a scatter, `y [any, n]`.
/// Numerics: each output is summed on its own over ascending `i`; a row's bits do not depend on the other rows, nor on
/// how outputs are cut into panels. Error at most `k * 2^-23 * sum(abs(x * w))`.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees.
pub fn matmul_f32(isa: Isa, x: Input<f32>, w: PackedF32, end: Epilogue, y: MatMut<f32>) -> Result<(), ShapeError> {
    check_product((x.rows(), x.cols()), (w.n(), w.k()), &y, &end)?;
    match isa.0 {
        Backend::Scalar => scalar::matmul(x, w, end, y),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that `avx2` enables.
        Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::matmul(x, w, end, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that `avx512vnni` enables.
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::matmul(x, w, end, y) },
        // Its tiles hold no f32.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        Backend::Amx => unsafe { avx512vnni::matmul(x, w, end, y) },
    }
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
    match isa.0 {
        Backend::Scalar => scalar::matmul_gated(x, gate, up, y),
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that `avx2` enables.
        Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::matmul_gated(x, gate, up, y) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that `avx512vnni` enables.
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::matmul_gated(x, gate, up, y) },
        // Its tiles hold no f32.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        Backend::Amx => unsafe { avx512vnni::matmul_gated(x, gate, up, y) },
    }
    Ok(())
}
