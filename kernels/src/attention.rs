//! Fused attention of one head: scores, relative-position bias, mask, softmax and values in one pass.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod encoder_bf16;
mod operands;
mod scalar;

use crate::bf16::Bf16;
use crate::error::ShapeError;

use crate::isa::{Isa, dispatch};
use crate::mat::{Mat, MatMut};
use crate::prefetch::PrefetchHint;
use operands::Operands;
pub use operands::{RelativeBias, Visible};

/// Attention of one head: `y[i] = sum_j softmax_j(scale * q[i] . k[j] + bias) * v[j]`.
///
/// Shapes: `q [m, head_dim]`, `k [n, head_dim]`, `v [n, head_dim]`, `y [m, head_dim]` (overwritten); all strided, so that
/// a head is a column range of the projections.
/// Numerics: f32, with error terms of `head_dim` and `n` sums; on one back-end a row's bits do not depend on the other
/// rows, nor on keys that it does not see. Scores are never stored beyond a tile of keys.
/// Cost: `2 * m * n * head_dim` multiply-adds; no allocation. Few queries leave memory idle half of the time: `ahead`, the
/// next head's keys and values or whatever comes then, is fetched between; on processors whose memory had rather be read in order,
/// keys and values without gaps are, a little before they are read, and `ahead` is not.
/// Paper: section 3.1; SPEC 2.4.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees; `k` where there is no key for some query.
#[expect(clippy::too_many_arguments, reason = "the operands of one fused operation, each named")]
pub fn attention_f32(
    isa: Isa,
    q: Mat<f32>,
    k: Mat<f32>,
    v: Mat<f32>,
    scale: f32,
    bias: Option<RelativeBias>,
    visible: Visible,
    hint: PrefetchHint,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let operands = Operands { q, k, v, scale, bias, visible, hint, self_prefetch: isa.tuning().self_prefetch };
    if operands.check(&y)? {
        dispatch!(isa, attention(operands, y));
    }
    Ok(())
}

/// The same over keys and values stored as bfloat16, which take half the reading. They are widened as they are loaded:
/// factors and sums are f32, and the bits those of [`attention_f32`] over the widened values.
///
/// # Errors
/// As [`attention_f32`].
#[expect(clippy::too_many_arguments, reason = "the operands of one fused operation, each named")]
pub fn attention_bf16(
    isa: Isa,
    q: Mat<f32>,
    k: Mat<Bf16>,
    v: Mat<Bf16>,
    scale: f32,
    bias: Option<RelativeBias>,
    visible: Visible,
    hint: PrefetchHint,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let operands = Operands { q, k, v, scale, bias, visible, hint, self_prefetch: isa.tuning().self_prefetch };
    if operands.check(&y)? {
        dispatch!(isa, attention(operands, y));
    }
    Ok(())
}

/// Attention of one head over a whole sequence at once, as in an encoder: every query sees every key.
///
/// The same as [`attention_f32`] with [`Visible::All`], but for its bits: where the processor has tiles for bfloat16, this
/// takes them, and what repays them is a sequence of queries. Here too a row's bits do not depend on the other rows: which
/// road a call takes is decided by the number of keys and by `head_dim`. A decoder's rows, which come alone as well as
/// together, are what [`attention_f32`] is for; keep to one of the two per attention of a network.
///
/// Numerics: as [`attention_f32`]. On the `amx` back-end every factor is exactly the sum of three bfloat16 values, each product
/// is off by at most 2^-21 of its size, and denormals are taken as zero. Where an input is not finite, what
/// depends on it is NaN.
///
/// # Errors
/// As [`attention_f32`].
pub fn encoder_attention_f32(
    isa: Isa,
    q: Mat<f32>,
    k: Mat<f32>,
    v: Mat<f32>,
    scale: f32,
    bias: Option<RelativeBias>,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let operands =
        Operands { q, k, v, scale, bias, visible: Visible::All, hint: PrefetchHint::NONE, self_prefetch: false };
    if !operands.check(&y)? {
        return Ok(());
    }
    dispatch!(isa, attention(operands, y), {
        Scalar: scalar,
        Avx2: avx2,
        AvxVnni: avx2,
        Avx512Vnni: avx512vnni,
        Avx512Bf16: avx512vnni,
        Amx: amx,
    });
    Ok(())
}

/// The same with every factor rounded to bfloat16: queries, keys, values, and weights `exp(score - max)` before they are divided by
/// their sum. Sums, and what is made of them, are f32.
///
/// For projections that are int8 themselves: a value that has passed a product of bytes has no more than these eight bits to
/// offer, and tiles take a sixth of the products of [`encoder_attention_f32`].
///
/// Numerics: all back-ends agree bit for bit, but where a product or sum is denormal, which tiles take as zero. A row's bits
/// do not depend on the other rows. Weights are off by up to 2^-7.9 of their size. Where an input is not finite, no value that
/// depends on it is.
///
/// # Errors
/// As [`attention_f32`].
pub fn encoder_attention_bf16(
    isa: Isa,
    q: Mat<f32>,
    k: Mat<f32>,
    v: Mat<f32>,
    scale: f32,
    bias: Option<RelativeBias>,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    let operands =
        Operands { q, k, v, scale, bias, visible: Visible::All, hint: PrefetchHint::NONE, self_prefetch: false };
    if !operands.check(&y)? {
        return Ok(());
    }
    encoder_bf16::attention(isa, operands, y);
    Ok(())
}
