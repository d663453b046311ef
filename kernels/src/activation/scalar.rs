//! The specification of the element-wise functions.

use crate::lanes::sum_of;
use crate::math::Activation;
use crate::math::scalar::{activate, exp};

pub(super) fn apply(activation: Activation, x: &mut [f32]) {
    if activation != Activation::None {
        for x in x {
            *x = activate(activation, *x);
        }
    }
}

/// The largest value except NaN; NaN if all are NaN.
fn largest(x: &[f32]) -> f32 {
    x.iter().fold(f32::NEG_INFINITY, |max, &x| if x > max { x } else { max })
}

pub(super) fn softmax(x: &mut [f32]) {
    let max = largest(x);
    for x in x.iter_mut() {
        *x = exp(*x - max);
    }
    divide(x);
}

/// Divides every element by the sum of all elements.
#[inline(always)]
pub(super) fn divide(x: &mut [f32]) {
    let sum = sum_of(x, |x| x);
    for x in x {
        *x /= sum;
    }
}

pub(super) fn argmax(x: &[f32]) -> Option<usize> {
    let max = largest(x);
    x.iter().position(|&x| x == max)
}
