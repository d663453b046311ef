//! Fused attention of one head, or of all heads of a few rows: scores, relative-position bias, mask,
//! softmax and values in one pass.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod encoder_bf16;
#[cfg(target_arch = "aarch64")]
mod neon;
mod operands;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;

use crate::bf16::Bf16;
use crate::error::ShapeError;
use crate::isa::{Isa, dispatch};
use crate::mat::{Mat, MatMut};
use crate::tiling::Tiling;
use operands::HeadOperands;
pub use operands::{HeadCache, Operands, RelativeBias, Visible};

/// The modules of back-ends whose results are those of `scalar`.
mod portable {
    #[cfg(target_arch = "x86_64")]
    pub(super) use super::avx2::portable as avx2;
    #[cfg(target_arch = "x86_64")]
    pub(super) use super::avx512vnni::portable as avx512vnni;
    #[cfg(target_arch = "aarch64")]
    pub(super) use super::neon::portable as neon;
    pub(super) use super::scalar;
    #[cfg(target_arch = "wasm32")]
    pub(super) use super::simd128;
}

/// [`dispatch!`] to the modules of [`portable`], if `$isa` is portable.
macro_rules! dispatch_f32 {
    ($isa:expr, $function:ident($($argument:expr),*) $(, with $tiles:tt)?) => {
        if $isa.is_portable() {
            use portable::*;
            dispatch!($isa, $function($($argument),*))
        } else {
            dispatch!($isa, $function($($argument),*) $(, with $tiles)?)
        }
    };
}

/// The [`Tiling`]s of a back-end: of attention, and of the encoder's in f32 and in bf16.
#[doc(hidden)]
pub fn tilings(isa: Isa) -> [Tiling; 3] {
    let encoder_f32 = dispatch_f32!(isa, tiling(), with tiles);
    [dispatch_f32!(isa, tiling()), encoder_f32, encoder_bf16::tiling(isa.of_floats())]
}

/// The [`Tiling`] of [`attention_heads_f32`], in which `rows` are heads.
#[doc(hidden)]
pub fn heads_tiling(isa: Isa) -> Tiling {
    dispatch_f32!(isa, heads_tiling())
}

/// Attention of one head: `y[i] = sum_j softmax_j(scale * q[i] . k[j] + bias) * v[j]`.
///
/// Shapes: `q`, `k`, `v` as in [`Operands`], `y [m, head_dim]` (overwritten, strided).
/// Numerics: f32, with error terms of `head_dim` and `n` sums; on one back-end a row's bits do not
/// depend on the other rows, nor on keys that it does not see. Scores are never stored beyond a
/// tile of keys.
/// Cost: `2 * m * n * head_dim` multiply-adds; no allocation. With few queries the call leaves memory
/// bandwidth unused, and prefetches the operands of [`Operands::hinting`]. On processors tuned for one stream
/// ([`crate::tuning`]), contiguous keys and values are themselves prefetched shortly before they are read, and the
/// hint is ignored.
/// Paper: section 3.1; SPEC 2.4.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees; `k` if a query has no key.
pub fn attention_f32(isa: Isa, operands: Operands<f32>, y: MatMut<f32>) -> Result<(), ShapeError> {
    let operands = Operands { self_prefetch: isa.tuning().self_prefetch, ..operands };
    if operands.check(&y)? {
        dispatch_f32!(isa, attention(operands, y));
    }
    Ok(())
}

/// [`attention_f32`] over keys and values stored as bf16, which halves the memory traffic. They
/// are widened when loaded: factors and sums are f32, and the result equals
/// [`attention_f32`] over the widened values bit for bit.
///
/// # Errors
/// As [`attention_f32`].
pub fn attention_bf16(isa: Isa, operands: Operands<Bf16>, y: MatMut<f32>) -> Result<(), ShapeError> {
    let operands = Operands { self_prefetch: isa.tuning().self_prefetch, ..operands };
    if operands.check(&y)? {
        dispatch_f32!(isa, attention(operands, y));
    }
    Ok(())
}

/// [`attention_f32`] of all heads of some rows, one query each, in one call: for a decoder with so few
/// keys and values that the overhead of a call per head exceeds their cost.
///
/// Shapes: `q [rows, heads * head_dim]`, `y` the same (overwritten), both strided; the cache
/// as in [`HeadCache`].
/// Numerics: the bits of [`attention_f32`] with [`Visible::All`] for each head separately.
/// Cost: `2 * rows * heads * filled * head_dim` multiply-adds; no allocation. Heads of 32, 48 and
/// 64 columns with at most 64 filled places have specialised loops; others take as long as
/// separate calls.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees; `cache.filled` if it is 0 or exceeds
/// the number of places.
pub fn attention_heads_f32(
    isa: Isa,
    q: Mat<f32>,
    cache: HeadCache,
    scale: f32,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let operands = HeadOperands { q, cache, scale };
    if operands.check(&y)? {
        dispatch_f32!(isa, heads(operands, y));
    }
    Ok(())
}

/// Attention of one head over a whole sequence at once, as in an encoder: every query sees every
/// key.
///
/// [`attention_f32`] with [`Visible::All`], except for its bits: on processors with bf16 tiles,
/// long sequences run on tiles. A row's bits do not depend on the other rows: the number of
/// keys and `head_dim` alone select the path. A decoder, whose rows arrive one at a time or
/// several together, uses [`attention_f32`]; use one of the two for each attention of a
/// network.
///
/// Numerics: as [`attention_f32`]. On `amx` every factor is split exactly into three bf16
/// values, each product has a relative error of at most 2^-21, and denormals are flushed to
/// zero. If an input is not finite, the outputs that depend on it are NaN.
///
/// # Errors
/// As [`attention_f32`].
pub fn encoder_attention_f32(isa: Isa, operands: Operands<f32>, y: MatMut<f32>) -> Result<(), ShapeError> {
    let operands = operands.seeing(Visible::All);
    if !operands.check(&y)? {
        return Ok(());
    }
    dispatch_f32!(isa, attention(operands, y), with tiles);
    Ok(())
}

/// [`encoder_attention_f32`] with every factor rounded to bf16: queries, keys, values, and
/// weights `exp(score - max)` before their normalization. Sums and scores are f32.
///
/// Meant for int8 projections, whose outputs have no more precision than bf16's 8 bits; tiles
/// need a sixth of the products of [`encoder_attention_f32`].
///
/// Numerics: all back-ends agree bit for bit, except if a product or sum is denormal, which
/// tiles flush to zero. A row's bits do not depend on the other rows. Weights have a relative
/// error of at most 2^-7.9. If an input is not finite, neither are the outputs that depend on it.
///
/// # Errors
/// As [`attention_f32`].
pub fn encoder_attention_bf16(isa: Isa, operands: Operands<f32>, y: MatMut<f32>) -> Result<(), ShapeError> {
    let operands = operands.seeing(Visible::All);
    if !operands.check(&y)? {
        return Ok(());
    }
    encoder_bf16::attention(isa.of_floats(), operands, y);
    Ok(())
}
