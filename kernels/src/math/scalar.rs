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

/// `a * b + c`, rounded once.
#[cfg(not(all(windows, target_env = "gnu")))]
#[inline]
pub(crate) fn mul_add(a: f32, b: f32, c: f32) -> f32 {
    a.mul_add(b, c)
}

/// `a * b + c`, rounded once: MinGW's `fmaf`, which the standard library calls, rounds a quarter of
/// all results twice.
#[cfg(all(windows, target_env = "gnu"))]
pub(crate) fn mul_add(a: f32, b: f32, c: f32) -> f32 {
    mul_add_in_f64(a, b, c)
}

/// [`mul_add`] in f64: the product is exact, and the sum is rounded to odd, so that a second
/// rounding, to f32, gives the result of a single one.
#[cfg(any(test, all(windows, target_env = "gnu")))]
fn mul_add_in_f64(a: f32, b: f32, c: f32) -> f32 {
    let (product, c) = (f64::from(a) * f64::from(b), f64::from(c));
    let sum = product + c;
    // The rounding error of the sum, exactly (Knuth's two-sum).
    let added = sum - product;
    let lost = (product - (sum - added)) + (c - added);
    let is_odd = sum.to_bits() & 1 == 1;
    let odd = match sum.is_finite() && lost != 0.0 && !is_odd {
        true if (lost > 0.0) == (sum > 0.0) => f64::from_bits(sum.to_bits() + 1),
        true => f64::from_bits(sum.to_bits() - 1),
        false => sum,
    };
    #[expect(clippy::cast_possible_truncation, reason = "the second rounding")]
    let rounded = odd as f32;
    rounded
}

/// `x * (1 + tanh(u)) / 2` with `u = sqrt(2 / pi) * (x + 0.044715 x^3)`, written as `x / (1 + 2^t)`
/// with `t = -2 u log2(e)`.
#[inline]
pub(crate) fn gelu_tanh(x: f32) -> f32 {
    let t = x * mul_add(x * x, TANH_CUBE, TANH_SCALE);
    let t = if TANH_MAX < t { TANH_MAX } else { t };
    let t = if -TANH_MAX > t { -TANH_MAX } else { t };
    x / (exp2_in_range(t) + 1.0)
}

/// `2^t` for `-126..=126`: `2^n * 2^f` with `abs(f) <= 1 / 2`.
#[inline]
fn exp2_in_range(t: f32) -> f32 {
    let shifted = t + ROUND;
    let f = t - (shifted - ROUND);
    let power = mul_add(polynomial(&EXP2, f), f, 1.0);
    f32::from_bits(power.to_bits().wrapping_add(shifted.to_bits() << 23))
}

/// Horner's rule in fused steps, highest power first.
#[inline]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: f32) -> f32 {
    coefficients[1..].iter().fold(coefficients[0], |value, &c| mul_add(value, x, c))
}

/// `x * (1 + erf(x / sqrt(2))) / 2`, written as `max(x, 0) - abs(x) * tail(abs(x))`. A NaN tail
/// may have any bits: its product is NaN.
#[inline]
pub(crate) fn gelu_erf(x: f32) -> f32 {
    let size = x.abs();
    let size = if TAIL_MAX < size { TAIL_MAX } else { size };
    let positive = if x > 0.0 { x } else { 0.0 };
    mul_add(-size, exp2_in_range(polynomial(&TAIL, size)), positive)
}

/// [`Activation`] of one value.
pub(crate) fn activate(activation: Activation, x: f32) -> f32 {
    match activation {
        Activation::None => x,
        // Not `max`, which may drop the sign of a negative zero.
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
    let power = mul_add(EXP2_BF16[1..].iter().fold(EXP2_BF16[0], |power, &c| mul_add(power, r, c)), r, 1.0);
    #[expect(clippy::cast_possible_truncation, reason = "an integer of at least -126, or NaN")]
    let exponent = (n as i32) << 23;
    if n < EXP2_BF16_MIN { 0.0 } else { f32::from_bits(power.to_bits().wrapping_add_signed(exponent)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn multiplying_and_adding_rounds_once() {
        let is_same = |x: f32, y: f32| x == y || x.is_nan() && y.is_nan();
        let (mut state, mut exact) = (1_u64, 0);
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            // Any bits, and every other time a number near 1.
            let bits = state.to_be_bytes();
            let bits = u32::from_be_bytes([bits[0], bits[1], bits[2], bits[3]]);
            f32::from_bits(if state & 1 << 20 == 0 { bits } else { bits & 0x80ff_ffff | 0x3f00_0000 })
        };
        for _ in 0..200_000 {
            let (a, b, c) = (next(), next(), next());
            let product = a * b;
            for c in [c, -product] {
                let got = mul_add_in_f64(a, b, c);
                assert!(cfg!(all(windows, target_env = "gnu")) || is_same(got, a.mul_add(b, c)), "{a:e} {b:e} {c:e}");
                assert!(is_same(got, mul_add(a, b, c)), "{a:e} {b:e} {c:e}");
            }
            // The rounding error of a product is an f32, and f64 represents it exactly.
            if product.is_normal() && product.abs() > 1e-20 {
                let lost = f64::from(a) * f64::from(b) - f64::from(product);
                assert_eq!(f64::from(mul_add(a, b, -product)), lost, "{a:e} {b:e}");
                exact += 1;
            }
        }
        assert!(exact > 50_000, "{exact}");
    }
}
