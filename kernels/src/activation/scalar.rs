//! The specification of the element-wise functions.

use crate::math::scalar::{gelu_erf, gelu_tanh};
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
        // Not `max`, which may keep the sign of a negative zero or not.
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
