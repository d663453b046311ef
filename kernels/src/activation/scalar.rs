//! The specification of the element-wise functions.

use crate::matmul_f32::Activation;

pub(super) fn apply(activation: Activation, x: &mut [f32]) {
    if activation != Activation::None {
        for x in x {
            *x = activate(activation, *x);
        }
    }
}

/// One element.
pub(crate) fn activate(activation: Activation, x: f32) -> f32 {
    match activation {
        Activation::None => x,
        Activation::Relu => x.max(0.0),
        Activation::LeakyRelu(slope) => {
            if x >= 0.0 {
                x
            } else {
                slope * x
            }
        }
        Activation::Gelu => gelu(x),
        Activation::GeluTanh => gelu_tanh(x),
    }
}

/// `x * (1 + erf(x / sqrt(2))) / 2`.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 once is the contract")]
fn gelu(x: f32) -> f32 {
    let wide = f64::from(x);
    (0.5 * wide * (1.0 + erf(wide * core::f64::consts::FRAC_1_SQRT_2))) as f32
}

/// The tanh approximation: `x * (1 + tanh(sqrt(2 / pi) * (x + 0.044715 x^3))) / 2`, written as `x * sigmoid(2 u)`.
pub(crate) fn gelu_tanh(x: f32) -> f32 {
    /// `2 * sqrt(2 / pi)`.
    const TWICE: f32 = 1.595_769;
    let u = TWICE * (x + 0.044_715 * x * x * x);
    x / (1.0 + (-u).exp())
}

/// Error function in f64 by `erf(x) = 2/sqrt(pi) * exp(-x^2) * sum_n 2^n x^(2n+1) / (1 * 3 * .. * (2n+1))`, whose terms
/// are all of one sign: nothing cancels. Beyond 6 it is 1 to f64's precision.
fn erf(x: f64) -> f64 {
    let size = x.abs();
    if size >= 6.0 {
        return 1.0_f64.copysign(x);
    }
    let (mut term, mut sum, mut n) = (size, size, 1.0);
    while term > sum * 1e-17 {
        term *= 2.0 * size * size / (2.0 * n + 1.0);
        sum += term;
        n += 1.0;
    }
    (core::f64::consts::FRAC_2_SQRT_PI * (-size * size).exp() * sum).copysign(x)
}

pub(super) fn softmax(x: &mut [f32]) {
    let max = x.iter().fold(f32::NEG_INFINITY, |max, &x| max.max(x));
    let mut sum = 0.0;
    for x in x.iter_mut() {
        *x = (*x - max).exp();
        sum += *x;
    }
    for x in x {
        *x /= sum;
    }
}

pub(super) fn argmax(x: &[f32]) -> Option<usize> {
    let mut best: Option<usize> = None;
    for (i, &value) in x.iter().enumerate() {
        if !value.is_nan() && best.is_none_or(|b| value > x[b]) {
            best = Some(i);
        }
    }
    best
}
