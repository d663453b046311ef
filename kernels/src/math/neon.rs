//! 8 lanes, operation by operation as in `scalar.rs`.

use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, EXP2_BF16, EXP2_BF16_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, TAIL,
    TAIL_MAX, TANH_CUBE, TANH_MAX, TANH_SCALE,
};
use crate::lanes::neon::Register;
use core::arch::aarch64::*;
use umo_kernels_features::neon;

/// Makes functions of 8 lanes from functions of 4.
macro_rules! of_both {
    ($($(#[$meta:meta])* $name:ident: $four:ident;)*) => {$(
        $(#[$meta])*
        #[inline]
        #[neon]
        pub(crate) fn $name(x: Register) -> Register {
            [$four(x[0]), $four(x[1])]
        }
    )*};
}

of_both! {
    /// `e^x`.
    exp: exp_four;
    /// The tanh form of GELU.
    gelu_tanh: gelu_tanh_four;
    /// `e^x` of a difference from a maximum (`x <= 0`), with fused operations: within 1 ULP, 0 below
    /// -87.33.
    softmax_exp: softmax_exp_four;
    /// `2^t` of a difference from a maximum (`t <= 0`) that will be rounded to bf16: within 1.03e-4
    /// of the value, 0 below -126.
    exp2_bf16: exp2_bf16_four;
}

/// [`Activation`] of 8 values, with the bits of [`super::scalar::activate`].
#[inline]
#[neon]
pub(crate) fn activate(activation: Activation, x: Register) -> Register {
    [activate_four(activation, x[0]), activate_four(activation, x[1])]
}

#[inline]
#[neon]
fn exp_four(x: float32x4_t) -> float32x4_t {
    let small = vcltq_f32(x, vdupq_n_f32(EXP_MIN));
    let large = vcgtq_f32(x, vdupq_n_f32(EXP_MAX));
    let ordered = vceqq_f32(x, x);
    let power = vbslq_f32(large, vdupq_n_f32(f32::INFINITY), exp_in_range(x));
    vbslq_f32(ordered, vbslq_f32(small, vdupq_n_f32(0.0), power), x)
}

#[inline]
#[neon]
fn exp_in_range(x: float32x4_t) -> float32x4_t {
    let round = vdupq_n_f32(ROUND);
    let shifted = vaddq_f32(vmulq_f32(x, vdupq_n_f32(LOG2_E)), round);
    let n = vsubq_f32(shifted, round);
    let r = vsubq_f32(x, vmulq_f32(n, vdupq_n_f32(LN_2_HIGH)));
    let r = vsubq_f32(r, vmulq_f32(n, vdupq_n_f32(LN_2_LOW)));
    let mut tail = vdupq_n_f32(EXP[0]);
    for &c in &EXP[1..] {
        tail = vaddq_f32(vmulq_f32(tail, r), vdupq_n_f32(c));
    }
    let power = vaddq_f32(vmulq_f32(tail, vmulq_f32(r, r)), r);
    scale(vaddq_f32(power, vdupq_n_f32(1.0)), vreinterpretq_s32_f32(shifted))
}

/// Adds the lowest bits of `exponent` to the exponent of `power`.
#[inline]
#[neon]
fn scale(power: float32x4_t, exponent: int32x4_t) -> float32x4_t {
    vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(power), vshlq_n_s32::<23>(exponent)))
}

#[inline]
#[neon]
fn gelu_tanh_four(x: float32x4_t) -> float32x4_t {
    let slope = vfmaq_f32(vdupq_n_f32(TANH_SCALE), vmulq_f32(x, x), vdupq_n_f32(TANH_CUBE));
    let t = vminq_f32(vmulq_f32(x, slope), vdupq_n_f32(TANH_MAX));
    let t = vmaxq_f32(t, vdupq_n_f32(-TANH_MAX));
    vdivq_f32(x, vaddq_f32(exp2_in_range(t), vdupq_n_f32(1.0)))
}

/// `2^t` for `-126..=126`.
#[inline]
#[neon]
fn exp2_in_range(t: float32x4_t) -> float32x4_t {
    let round = vdupq_n_f32(ROUND);
    let shifted = vaddq_f32(t, round);
    let f = vsubq_f32(t, vsubq_f32(shifted, round));
    scale(vfmaq_f32(vdupq_n_f32(1.0), polynomial(&EXP2, f), f), vreinterpretq_s32_f32(shifted))
}

/// The erf form of GELU.
#[inline]
#[neon]
fn gelu_erf_four(x: float32x4_t) -> float32x4_t {
    let size = vminq_f32(vabsq_f32(x), vdupq_n_f32(TAIL_MAX));
    vfmsq_f32(positive(x), size, exp2_in_range(polynomial(&TAIL, size)))
}

/// `x` if it is above 0, otherwise 0, also for NaN.
#[inline]
#[neon]
fn positive(x: float32x4_t) -> float32x4_t {
    vreinterpretq_f32_u32(vandq_u32(vcgtzq_f32(x), vreinterpretq_u32_f32(x)))
}

#[inline]
#[neon]
fn activate_four(activation: Activation, x: float32x4_t) -> float32x4_t {
    match activation {
        Activation::None => x,
        Activation::Relu => positive(x),
        Activation::LeakyRelu(slope) => vbslq_f32(vcgezq_f32(x), x, vmulq_f32(vdupq_n_f32(slope), x)),
        Activation::Gelu => gelu_erf_four(x),
        Activation::GeluTanh => gelu_tanh_four(x),
    }
}

/// Horner's rule in fused steps, highest power first.
#[inline]
#[neon]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: float32x4_t) -> float32x4_t {
    let mut value = vdupq_n_f32(coefficients[0]);
    for &c in &coefficients[1..] {
        value = vfmaq_f32(vdupq_n_f32(c), value, x);
    }
    value
}

#[inline]
#[neon]
fn softmax_exp_four(x: float32x4_t) -> float32x4_t {
    let small = vcltq_f32(x, vdupq_n_f32(EXP_MIN));
    let n = vrndnq_f32(vmulq_f32(x, vdupq_n_f32(LOG2_E)));
    let r = vfmsq_f32(x, n, vdupq_n_f32(LN_2_HIGH));
    let r = vfmsq_f32(r, n, vdupq_n_f32(LN_2_LOW));
    let mut tail = vdupq_n_f32(EXP[0]);
    for &c in &EXP[1..] {
        tail = vfmaq_f32(vdupq_n_f32(c), tail, r);
    }
    let power = vaddq_f32(vfmaq_f32(r, tail, vmulq_f32(r, r)), vdupq_n_f32(1.0));
    clear(small, scale(power, vcvtq_s32_f32(n)))
}

#[inline]
#[neon]
fn exp2_bf16_four(t: float32x4_t) -> float32x4_t {
    let n = vrndmq_f32(t);
    let r = vsubq_f32(t, n);
    let mut power = vdupq_n_f32(EXP2_BF16[0]);
    for &c in &EXP2_BF16[1..] {
        power = vfmaq_f32(vdupq_n_f32(c), power, r);
    }
    let small = vcltq_f32(n, vdupq_n_f32(EXP2_BF16_MIN));
    clear(small, scale(vfmaq_f32(vdupq_n_f32(1.0), power, r), vcvtq_s32_f32(n)))
}

/// Sets the lanes of `mask` to 0.
#[inline]
#[neon]
fn clear(mask: uint32x4_t, x: float32x4_t) -> float32x4_t {
    vreinterpretq_f32_u32(vbicq_u32(vreinterpretq_u32_f32(x), mask))
}
