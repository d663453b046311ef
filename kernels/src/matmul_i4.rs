//! Int4 matrix product: int4 weights in groups, activations quantized per row on the fly, int32
//! sums. Every weight is an int8 value, so that the results are those of [`crate::matmul_i8`] with
//! these values, at half the memory traffic.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "x86_64")]
mod avxvnni;
#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(target_arch = "aarch64")]
mod neon_dotprod;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32"))]
mod tiles;

use crate::error::{ShapeError, expect_len};
use crate::gemm::{Epilogue, check_product};
use crate::isa::{Backend, Isa, dispatch};
use crate::mat::MatMut;
use crate::matmul_i8::{check_k, input};
use crate::pack::PackedI4;
use crate::quantize::QuantRows;
use crate::tiling::Tiling;

/// Calls a back-end's int4 product.
macro_rules! dispatch_i4 {
    ($isa:expr, $function:ident($($argument:expr),*)) => {
        dispatch!($isa, $function($($argument),*), {
            Scalar: scalar,
            Avx2: avx2,
            AvxVnni: avxvnni,
            Avx512Vnni: avx512vnni,
            Avx512Bf16: avx512vnni,
            Amx: avx512vnni,
            Neon: neon,
            NeonDotprod: neon_dotprod,
            NeonI8mm: neon_dotprod,
            Simd128: simd128,
        })
    };
}

/// The [`Tiling`] of a back-end's product.
#[doc(hidden)]
pub fn tiling(isa: Isa) -> Tiling {
    dispatch_i4!(isa, tiling())
}

/// Whether products, of few rows or of any number, are faster with int4 weights than with the same
/// weights in int8.
#[cfg_attr(target_arch = "wasm32", expect(unused_variables, reason = "neither is faster there"))]
pub const fn is_fast(isa: Isa, few_rows: bool) -> bool {
    match isa.backend() {
        // The sums of nibbles are AVX2's fastest products; other back-ends have better int8
        // instructions, and gain only memory bandwidth.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2(_) => true,
        #[cfg(target_arch = "x86_64")]
        Backend::AvxVnni(_) | Backend::Avx512Vnni(_) | Backend::Avx512Bf16(_) => few_rows,
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx(_) => few_rows,
        // Speed does not matter for the reference.
        Backend::Scalar => true,
        // Fewer instructions than int8 without dot products.
        #[cfg(target_arch = "aarch64")]
        Backend::Neon(_) => true,
        #[cfg(target_arch = "aarch64")]
        Backend::NeonDotprod(_) | Backend::NeonI8mm(_) => few_rows,
        // Int8 is widened by its loads, nibbles by separate instructions: 1.2 to 1.8 times as slow on x86.
        #[cfg(target_arch = "wasm32")]
        Backend::Simd128(_) => false,
    }
}

/// Int4 product with int32 sums: `y[t, o] = x_scale[t] * w_scale[o] * sum_i x[t, i] * w[o, i]` with
/// `w[o, i] = multiplier[o, i / GROUP] * code[o, i]`, then the epilogue.
///
/// Shapes: `x [m, k]`, `w [n, k]` packed, `y [m, n]`; with an `index`, row `t` is `x[index[t]]`;
/// with a scatter, `y [any, n]`.
/// Numerics: as [`crate::matmul_i8::matmul_i8`] with the same `w`, bit for bit.
/// Cost: `m * n * k` multiply-adds; no allocation.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees, or `k` above
/// [`crate::matmul_i8::MAX_K`].
pub fn matmul_i4(
    isa: Isa,
    x: QuantRows,
    index: Option<&[u32]>,
    w: PackedI4,
    epilogue: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let x = input(x, index)?;
    check_k(w.k())?;
    check_product((x.rows.rows(), x.rows.cols()), (w.n(), w.k()), &y, &epilogue)?;
    dispatch_i4!(isa, matmul(x, w, epilogue, y, isa.tuning()));
    Ok(())
}

/// Gated int4 product: `gelu_tanh(x . gate) * (x . up)`, shapes and numerics as [`matmul_i4`].
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees, or `k` above
/// [`crate::matmul_i8::MAX_K`].
pub fn matmul_gated_i4(
    isa: Isa,
    x: QuantRows,
    index: Option<&[u32]>,
    gate: PackedI4,
    up: PackedI4,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let x = input(x, index)?;
    check_k(gate.k())?;
    check_product((x.rows.rows(), x.rows.cols()), (gate.n(), gate.k()), &y, &Epilogue::STORE)?;
    expect_len("up", gate.n(), up.n())?;
    expect_len("up", gate.k(), up.k())?;
    dispatch_i4!(isa, matmul_gated(x, gate, up, y, isa.tuning()));
    Ok(())
}
