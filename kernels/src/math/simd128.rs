//! 4 lanes, operation by operation as in `scalar.rs`.

use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, EXP2_BF16, EXP2_BF16_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, TAIL,
    TAIL_MAX, TANH_CUBE, TANH_MAX, TANH_SCALE,
};
use crate::lanes::simd128::{Register, add, divide, fmadd, mul, multiply_add, splat, sub};
use core::arch::wasm32::*;

/// `e^x`.
#[inline]
pub(crate) fn exp(x: Register) -> Register {
    let small = f32x4_lt(x, splat(EXP_MIN));
    let large = f32x4_gt(x, splat(EXP_MAX));
    let ordered = f32x4_eq(x, x);
    let power = v128_bitselect(splat(f32::INFINITY), exp_in_range(x), large);
    v128_bitselect(v128_andnot(power, small), x, ordered)
}

#[inline]
fn exp_in_range(x: Register) -> Register {
    let shifted = multiply_add(x, splat(LOG2_E), splat(ROUND));
    let n = sub(shifted, splat(ROUND));
    let r = sub(sub(x, mul(n, splat(LN_2_HIGH))), mul(n, splat(LN_2_LOW)));
    let mut tail = splat(EXP[0]);
    for &c in &EXP[1..] {
        tail = multiply_add(tail, r, splat(c));
    }
    scale(add(multiply_add(tail, mul(r, r), r), splat(1.0)), shifted)
}

/// Adds the lowest bits of `exponent` to the exponent of `power`.
#[inline]
fn scale(power: Register, exponent: v128) -> Register {
    i32x4_add(power, i32x4_shl(exponent, 23))
}

/// The tanh form of GELU.
#[inline]
pub(crate) fn gelu_tanh(x: Register) -> Register {
    let t = mul(x, fmadd(mul(x, x), splat(TANH_CUBE), splat(TANH_SCALE)));
    // NaN stays NaN, as in the comparisons of the reference.
    let t = f32x4_pmax(f32x4_pmin(t, splat(TANH_MAX)), splat(-TANH_MAX));
    divide(x, add(exp2_in_range(t), splat(1.0)))
}

/// `2^t` for `-126..=126`.
#[inline]
fn exp2_in_range(t: Register) -> Register {
    let shifted = add(t, splat(ROUND));
    let f = sub(t, sub(shifted, splat(ROUND)));
    scale(fmadd(polynomial(&EXP2, f), f, splat(1.0)), shifted)
}

/// The erf form of GELU.
#[inline]
fn gelu_erf(x: Register) -> Register {
    let size = f32x4_pmin(f32x4_abs(x), splat(TAIL_MAX));
    fmadd(f32x4_neg(size), exp2_in_range(polynomial(&TAIL, size)), positive(x))
}

/// `x` if it is above 0, otherwise 0, also for NaN.
#[inline]
fn positive(x: Register) -> Register {
    v128_and(f32x4_gt(x, splat(0.0)), x)
}

/// [`Activation`] of 4 values, with the bits of [`super::scalar::activate`].
#[inline]
pub(crate) fn activate(activation: Activation, x: Register) -> Register {
    match activation {
        Activation::None => x,
        Activation::Relu => positive(x),
        Activation::LeakyRelu(slope) => v128_bitselect(x, mul(splat(slope), x), f32x4_ge(x, splat(0.0))),
        Activation::Gelu => gelu_erf(x),
        Activation::GeluTanh => gelu_tanh(x),
    }
}

/// Horner's rule in fused steps, highest power first.
#[inline]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: Register) -> Register {
    let mut value = splat(coefficients[0]);
    for &c in &coefficients[1..] {
        value = fmadd(value, x, splat(c));
    }
    value
}

/// `2^t` of a difference from a maximum (`t <= 0`) that will be rounded to bf16: within 1.03e-4
/// of the value, 0 below -126.
#[inline]
pub(crate) fn exp2_bf16(t: Register) -> Register {
    let n = f32x4_floor(t);
    let r = sub(t, n);
    let mut power = splat(EXP2_BF16[0]);
    for &c in &EXP2_BF16[1..] {
        power = fmadd(power, r, splat(c));
    }
    let small = f32x4_lt(n, splat(EXP2_BF16_MIN));
    v128_andnot(scale(fmadd(power, r, splat(1.0)), i32x4_trunc_sat_f32x4(n)), small)
}
