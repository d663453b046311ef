//! The specification of the norms. Their loops run over independent elements or in 16 lanes, so that the vector
//! back-ends are these same functions, compiled for their instruction set.

use crate::lanes::sum_of;
use crate::mat::{Mat, MatMut};

#[expect(clippy::cast_precision_loss, reason = "row lengths are far below 2^24")]
#[inline(always)]
pub(super) fn rms_norm(x: Mat<f32>, weight: &[f32], eps: f32, mut y: MatMut<f32>) {
    for t in 0..x.rows() {
        let row = x.row(t);
        let mean = sum_of(row, |x| x * x) / row.len() as f32;
        let factor = 1.0 / (mean + eps).sqrt();
        for ((y, x), weight) in y.row_mut(t).iter_mut().zip(row).zip(weight) {
            *y = x * factor * weight;
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "row lengths are far below 2^24")]
#[inline(always)]
pub(super) fn layer_norm(x: Mat<f32>, weight: &[f32], bias: &[f32], eps: f32, mut y: MatMut<f32>) {
    for t in 0..x.rows() {
        let row = x.row(t);
        let mean = sum_of(row, |x| x) / row.len() as f32;
        let variance = sum_of(row, |x| (x - mean) * (x - mean)) / row.len() as f32;
        let factor = 1.0 / (variance + eps).sqrt();
        for (((y, x), weight), bias) in y.row_mut(t).iter_mut().zip(row).zip(weight).zip(bias) {
            *y = (x - mean) * factor * weight + bias;
        }
    }
}

#[inline(always)]
pub(super) fn channel_sums(x: Mat<f32>, sum: &mut [f64], squares: &mut [f64]) {
    for t in 0..x.rows() {
        for ((&x, sum), squares) in x.row(t).iter().zip(sum.iter_mut()).zip(squares.iter_mut()) {
            let x = f64::from(x);
            *sum += x;
            *squares += x * x;
        }
    }
}

#[inline(always)]
pub(super) fn channel_affine(mut x: MatMut<f32>, scale: &[f32], shift: &[f32]) {
    for t in 0..x.rows() {
        for ((x, scale), shift) in x.row_mut(t).iter_mut().zip(scale).zip(shift) {
            *x = *x * scale + shift;
        }
    }
}
