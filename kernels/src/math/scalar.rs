//! The specification: the order of operations that every back-end keeps.

use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, EXP2_BF16, EXP2_BF16_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, TAIL,
    TAIL_MAX, TANH_CUBE, TANH_MAX, TANH_SCALE,
};

/// `e^x`.
#[inline]
pub(crate) fn exp(x: f32) -> f32 {
    if x > EXP_MAX {
        f32::INFINITY
    } else if x < EXP_MIN {
        0.0
    } else if x.is_nan() {
        x
    } else {
        exp_in_range(x)
    }
}

/// `e^x` for `EXP_MIN..=EXP_MAX`: `2^n * e^r` with `abs(r) <= ln(2) / 2`.
#[inline]
fn exp_in_range(x: f32) -> f32 {
    let shifted = x * LOG2_E + ROUND;
    let n = shifted - ROUND;
    let r = (x - n * LN_2_HIGH) - n * LN_2_LOW;
    let mut tail = EXP[0];
    for c in &EXP[1..] {
        tail = tail * r + c;
    }
    let power = (tail * (r * r) + r) + 1.0;
    f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// `x * (1 + tanh(u)) / 2` with `u = sqrt(2 / pi) * (x + 0.044715 x^3)`, written as `x / (1 + 2^t)`
/// with `t = -2 u log2(e)`.
#[inline]
pub(crate) fn gelu_tanh(x: f32) -> f32 {
    let t = x * (x * x).mul_add(TANH_CUBE, TANH_SCALE);
    let t = if TANH_MAX < t { TANH_MAX } else { t };
    let t = if -TANH_MAX > t { -TANH_MAX } else { t };
    x / (exp2_in_range(t) + 1.0)
}

/// `2^t` for `-126..=126`: `2^n * 2^f` with `abs(f) <= 1 / 2`.
#[inline]
fn exp2_in_range(t: f32) -> f32 {
    let shifted = t + ROUND;
    let f = t - (shifted - ROUND);
    let power = polynomial(&EXP2, f).mul_add(f, 1.0);
    f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// Horner's rule in fused steps, highest power first.
#[inline]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: f32) -> f32 {
    coefficients[1..].iter().fold(coefficients[0], |value, &c| value.mul_add(x, c))
}

/// `x * (1 + erf(x / sqrt(2))) / 2`, written as `max(x, 0) - abs(x) * tail(abs(x))`. A tail of NaN
/// may have any bits: its product is NaN.
#[inline]
pub(crate) fn gelu_erf(x: f32) -> f32 {
    let size = x.abs();
    let size = if TAIL_MAX < size { TAIL_MAX } else { size };
    let positive = if x > 0.0 { x } else { 0.0 };
    (-size).mul_add(exp2_in_range(polynomial(&TAIL, size)), positive)
}

/// [`Activation`] of one value.
pub(crate) fn activate(activation: Activation, x: f32) -> f32 {
    match activation {
        Activation::None => x,
        // Not `max`, which may or may not keep the sign of a negative zero.
        Activation::Relu => {
            if x > 0.0 {
                x
            } else {
                0.0
            }
        }
        Activation::LeakyRelu(slope) => {
            if x >= 0.0 {
                x
            } else {
                slope * x
            }
        }
        Activation::Gelu => gelu_erf(x),
        Activation::GeluTanh => gelu_tanh(x),
    }
}

/// `2^t` of a difference from a maximum (`t <= 0`) that will be rounded to bf16: within 1.03e-4 of
/// the value, 0 below -126.
pub(crate) fn exp2_bf16(t: f32) -> f32 {
    let n = t.floor();
    let r = t - n;
    let power = EXP2_BF16[1..].iter().fold(EXP2_BF16[0], |power, &c| power.mul_add(r, c)).mul_add(r, 1.0);
    #[expect(clippy::cast_possible_truncation, reason = "an integer of at least -126, or NaN")]
    let exponent = (n as i32) << 23;
    if n < EXP2_BF16_MIN { 0.0 } else { f32::from_bits(power.to_bits().wrapping_add_signed(exponent)) }
}
