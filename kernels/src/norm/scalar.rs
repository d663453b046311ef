//! The reference of the norms. Its loops run over independent elements or in 16 lanes, so that
//! the vector back-ends are the same functions, compiled for their instruction set.

use crate::lanes::sum_of;
use crate::mat::{Mat, MatMut};

/// Channels whose sums stay in registers over the whole time.
const CHANNELS: usize = 16;

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
    let ((sums, sums_tail), (squares, squares_tail)) = (sum.as_chunks_mut(), squares.as_chunks_mut());
    for (c, (sum, squares)) in sums.iter_mut().zip(squares).enumerate() {
        let mut now: ([f64; CHANNELS], [f64; CHANNELS]) = (*sum, *squares);
        for t in 0..x.rows() {
            add(&x.row(t)[c * CHANNELS..][..CHANNELS], &mut now.0, &mut now.1);
        }
        (*sum, *squares) = now;
    }
    let rest = x.cols() - sums_tail.len();
    for t in 0..x.rows() {
        add(&x.row(t)[rest..], sums_tail, squares_tail);
    }
}

/// Adds one time step.
#[inline(always)]
fn add(x: &[f32], sum: &mut [f64], squares: &mut [f64]) {
    for ((&x, sum), squares) in x.iter().zip(sum).zip(squares) {
        let x = f64::from(x);
        *sum += x;
        *squares += x * x;
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
