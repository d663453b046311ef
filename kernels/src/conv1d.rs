//! Convolutions over time as matrix products: a window of frames is a row of a [`Mat`] whose rows
//! overlap.
//!
//! ```text
//! x [frames, channels]            windows, kernel 3, step 2           weight [out, k * in]
//! f0 f1 f2 f3 f4 f5 f6      ->    row 0: f0 f1 f2                     (reordered from [out, in, k])
//!                                 row 1:       f2 f3 f4
//!                                 row 2:             f4 f5 f6
//! ```
//! Nothing is copied: `y = windows . weight^T` is an ordinary product with any weight type. A
//! grouped convolution reads its input group by group, `[groups, frames, channels / groups]`;
//! [`regroup`] makes that copy, with the padding.

use crate::error::{ShapeError, expect_len};
use crate::gemm::{Epilogue, Input};
use crate::isa::Isa;
use crate::mat::{Mat, MatMut};
use crate::matmul_f32::matmul_f32;
use crate::pack::{PackedF32, packed_len};

/// Output frames of a convolution of `frames` without padding.
pub const fn frames_out(frames: usize, kernel: usize, step: usize) -> usize {
    if frames < kernel { 0 } else { (frames - kernel) / step + 1 }
}

/// The windows of `x [frames, channels]`, dense: `[frames_out, kernel * channels]`, window `t`
/// starting at frame `t * step`.
///
/// # Errors
/// [`ShapeError`] if `x` is shorter than `frames * channels`, or `kernel` or `step` is 0.
pub fn windows<T>(
    x: &[T],
    frames: usize,
    channels: usize,
    kernel: usize,
    step: usize,
) -> Result<Mat<'_, T>, ShapeError> {
    for (arg, value) in [("kernel", kernel), ("step", step)] {
        if value == 0 {
            return Err(ShapeError { arg, want: 1, got: 0 });
        }
    }
    let len = frames.saturating_mul(channels);
    if x.len() < len {
        return Err(ShapeError { arg: "x", want: len, got: x.len() });
    }
    Mat::with_stride(&x[..len], frames_out(frames, kernel, step), kernel * channels, step * channels)
}

/// Reorders a weight from PyTorch's order, `[out, channels, kernel]`, to that of a window,
/// `[out, kernel, channels]`.
///
/// # Errors
/// [`ShapeError`] if a length is not `out * channels * kernel`.
pub fn reorder_weight<T: Copy>(
    weight: &[T],
    out: usize,
    channels: usize,
    kernel: usize,
    reordered: &mut [T],
) -> Result<(), ShapeError> {
    expect_len("weight", out * channels * kernel, weight.len())?;
    expect_len("reordered", weight.len(), reordered.len())?;
    for o in 0..out {
        for c in 0..channels {
            for k in 0..kernel {
                reordered[(o * kernel + k) * channels + c] = weight[(o * channels + c) * kernel + k];
            }
        }
    }
    Ok(())
}

/// Copies `x [frames, channels]` group by group with zero padding: `[groups, before + frames +
/// after, channels / groups]`; every element of `grouped` is written.
///
/// # Errors
/// [`ShapeError`] if `groups` does not divide the channels, or `grouped` has another length.
pub fn regroup(x: Mat<f32>, groups: usize, before: usize, after: usize, grouped: &mut [f32]) -> Result<(), ShapeError> {
    let channels = group_channels("x", x.cols(), groups)?;
    let frames = before + x.rows() + after;
    expect_len("grouped", groups * frames * channels, grouped.len())?;
    grouped.fill(0.0);
    for g in 0..groups {
        for t in 0..x.rows() {
            let to = (g * frames + before + t) * channels;
            grouped[to..to + channels].copy_from_slice(&x.row(t)[g * channels..(g + 1) * channels]);
        }
    }
    Ok(())
}

/// A weight whose groups are packed one after the other: the outputs of group `g` read only
/// that group's channels.
#[derive(Clone, Copy, Debug)]
pub struct GroupedF32<'a> {
    data: &'a [f32],
    groups: usize,
    /// Per group.
    out: usize,
    /// Per group.
    channels: usize,
    kernel: usize,
}

impl<'a> GroupedF32<'a> {
    /// A view of `groups` weights `[out / groups, kernel * channels / groups]`, each packed
    /// separately (`groups` times [`packed_len`]).
    ///
    /// # Errors
    /// [`ShapeError`] if `groups` does not divide `out` or `channels`, or `data` has
    /// another length.
    pub fn new(data: &'a [f32], groups: usize, out: usize, channels: usize, kernel: usize) -> Result<Self, ShapeError> {
        let out = group_channels("out", out, groups)?;
        let channels = group_channels("channels", channels, groups)?;
        expect_len("data", groups * packed_len(out, kernel * channels), data.len())?;
        Ok(Self { data, groups, out, channels, kernel })
    }

    /// Groups.
    pub fn groups(&self) -> usize {
        self.groups
    }

    /// The weight of group `g`.
    fn group(&self, g: usize) -> PackedF32<'a> {
        let len = packed_len(self.out, self.kernel * self.channels);
        PackedF32::new(&self.data[g * len..(g + 1) * len], self.out, self.kernel * self.channels)
            .expect("`new` checked the length")
    }
}

/// Grouped convolution of step 1, as in HuBERT's positional embedding: `y[t, g, o] = sum_kc
/// x[g, t + k, c] * w[g, o, k, c]`, then the epilogue (with a bias of `[groups * out]`).
///
/// Shapes: `x [groups, frames, channels / groups]` from [`regroup`], `y [frames - kernel +
/// 1, out]`.
/// Numerics, cost: as [`matmul_f32`] with `k = kernel * channels / groups`, once per group.
/// Paper: section 3 (audio tokenizer); SPEC 2.1.
///
/// # Errors
/// [`ShapeError`] naming the argument whose length disagrees; `epilogue` if it scatters.
pub fn conv1d_grouped_f32(
    isa: Isa,
    x: &[f32],
    frames: usize,
    w: GroupedF32,
    epilogue: Epilogue,
    y: MatMut<f32>,
) -> Result<(), ShapeError> {
    expect_len("x", w.groups * frames * w.channels, x.len())?;
    expect_len("y", w.groups * w.out, y.cols())?;
    expect_len("y", frames_out(frames, w.kernel, 1), y.rows())?;
    if let Some(bias) = epilogue.bias {
        expect_len("bias", w.groups * w.out, bias.len())?;
    }
    if let Some(scatter) = epilogue.scatter {
        return Err(ShapeError { arg: "epilogue", want: 0, got: scatter.rows.len() });
    }
    let mut rest = y;
    for g in 0..w.groups {
        let (mine, after) = rest.split_columns(w.out);
        let windows = windows(&x[g * frames * w.channels..], frames, w.channels, w.kernel, 1)?;
        matmul_f32(isa, Input::all(windows), w.group(g), epilogue.outputs(g * w.out..(g + 1) * w.out), mine)?;
        rest = after;
    }
    Ok(())
}

/// `total / groups`, if `groups` divides it.
fn group_channels(arg: &'static str, total: usize, groups: usize) -> Result<usize, ShapeError> {
    if groups == 0 || !total.is_multiple_of(groups) {
        return Err(ShapeError { arg, want: groups, got: total });
    }
    Ok(total / groups)
}
