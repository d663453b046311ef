//! The scalar loops, compiled for this instruction set: the same order of additions, the same bits.

use super::scalar;
use crate::mat::{Mat, MatMut};

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn rms_norm(x: Mat<f32>, weight: &[f32], eps: f32, y: MatMut<f32>) {
    scalar::rms_norm(x, weight, eps, y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn layer_norm(x: Mat<f32>, weight: &[f32], bias: &[f32], eps: f32, y: MatMut<f32>) {
    scalar::layer_norm(x, weight, bias, eps, y);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn channel_sums(x: Mat<f32>, sum: &mut [f64], squares: &mut [f64]) {
    scalar::channel_sums(x, sum, squares);
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn channel_affine(x: MatMut<f32>, scale: &[f32], shift: &[f32]) {
    scalar::channel_affine(x, scale, shift);
}
