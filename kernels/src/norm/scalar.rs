//! The specification of the norms.

use crate::mat::{Mat, MatMut};

/// Partial sums of a row: one AVX-512 register, so that every back-end can add in the same order.
const LANES: usize = 16;

#[expect(clippy::cast_precision_loss, reason = "row lengths are far below 2^24")]
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

/// `sum_i f(x[i])` in `LANES` partial sums, added pairwise at the end.
fn sum_of(x: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut sums = [0.0; LANES];
    let (chunks, tail) = x.as_chunks::<LANES>();
    for chunk in chunks {
        for (sum, &x) in sums.iter_mut().zip(chunk) {
            *sum += f(x);
        }
    }
    for (sum, &x) in sums.iter_mut().zip(tail) {
        *sum += f(x);
    }
    let mut width = LANES / 2;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    sums[0]
}

pub(super) fn channel_sums(x: Mat<f32>, sum: &mut [f64], squares: &mut [f64]) {
    for t in 0..x.rows() {
        for ((&x, sum), squares) in x.row(t).iter().zip(sum.iter_mut()).zip(squares.iter_mut()) {
            let x = f64::from(x);
            *sum += x;
            *squares += x * x;
        }
    }
}

pub(super) fn channel_affine(mut x: MatMut<f32>, scale: &[f32], shift: &[f32]) {
    for t in 0..x.rows() {
        for ((x, scale), shift) in x.row_mut(t).iter_mut().zip(scale).zip(shift) {
            *x = *x * scale + shift;
        }
    }
}
