//! bfloat16 values: the upper half of an `f32`.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512bf16;
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

/// One bfloat16 value, stored as its 16 bits. Conversion to `f32` is exact; from `f32` it rounds to
/// nearest, ties to even.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(transparent)]
pub struct Bf16(pub u16);

impl Bf16 {
    /// Rounds `value` to the nearest bfloat16 (ties to even; NaN stays NaN).
    #[inline]
    pub fn from_f32(value: f32) -> Self {
        Self(half::bf16::from_f32(value).to_bits())
    }

    /// The exact value as `f32`.
    #[inline]
    pub fn to_f32(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
    }
}

/// Rounds every value of `x` as [`Bf16::from_f32`] does.
///
/// Shapes: `x [rows, cols]`, `y [rows, cols]` (overwritten).
/// Numerics: all back-ends agree bit for bit.
///
/// # Errors
/// [`ShapeError`] if the shapes disagree.
pub fn round_bf16(isa: Isa, x: Mat<f32>, y: MatMut<Bf16>) -> Result<(), ShapeError> {
    expect_len("y", x.rows(), y.rows())?;
    expect_len("y", x.cols(), y.cols())?;
    dispatch!(isa, round(x, y));
    Ok(())
}
