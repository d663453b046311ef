//! The scalar loops, compiled for this instruction set: the same order of additions, the same bits.

use super::scalar;
use crate::isa::Simd128;
use crate::mat::{Mat, MatMut};

pub(super) fn rms_norm(_token: Simd128, x: Mat<f32>, weight: &[f32], eps: f32, y: MatMut<f32>) {
    scalar::rms_norm(x, weight, eps, y);
}

pub(super) fn layer_norm(_token: Simd128, x: Mat<f32>, weight: &[f32], bias: &[f32], eps: f32, y: MatMut<f32>) {
    scalar::layer_norm(x, weight, bias, eps, y);
}

pub(super) fn channel_sums(_token: Simd128, x: Mat<f32>, sum: &mut [f64], squares: &mut [f64]) {
    scalar::channel_sums(x, sum, squares);
}

pub(super) fn channel_affine(_token: Simd128, x: MatMut<f32>, scale: &[f32], shift: &[f32]) {
    scalar::channel_affine(x, scale, shift);
}
