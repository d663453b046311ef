//! Convolutional stacks of the codecs and the root network (SPEC 2.7).
//!
//! Activations are stored in padded buffers, `[1 + rows + 1, channels]`, with a row of zeros before the first
//! row and after the last. The window of a convolution over three frames is then three adjacent rows, a row
//! of an overlapping [`Mat`]. So every layer pads with zeros, as in training.

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::{Mat, MatMut};

use crate::config::Codec;
use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::Loader;

/// Number of frames in a convolution's window.
const KERNEL: usize = 3;

const LEAKY: Activation = Activation::LeakyRelu(0.2);

/// Two padded buffers that the layers of a stack alternate between, and scratch for quantized windows.
#[derive(Debug)]
pub(super) struct ConvScratch {
    /// `[1 + rows + 1, channels]`: the stack's input, and at the end its output.
    front: Box<[f32]>,
    /// `[1 + rows + 1, channels]`
    back: Box<[f32]>,
    quant: QuantScratch,
    rows: usize,
}

impl ConvScratch {
    /// Allocates scratch for `rows` frames and stacks of width at most `width`.
    pub(crate) fn new(rows: usize, width: usize) -> Self {
        let buffer = || filled(0.0, (rows + 2) * width).into_boxed_slice();
        Self { front: buffer(), back: buffer(), quant: QuantScratch::new(rows, KERNEL * width), rows }
    }

    /// Number of frames that the scratch has room for.
    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    /// Returns the rows `[rows, channels]` of a stack's input, to be written.
    ///
    /// # Errors
    /// [`StepError::TooLong`] if `rows` exceeds the scratch's capacity.
    pub(super) fn input(&mut self, rows: usize, channels: usize) -> Result<&mut [f32], StepError> {
        if rows > self.rows {
            return Err(StepError::TooLong { what: "frames of motion", got: rows, limit: self.rows });
        }
        Ok(padded(&mut self.front, rows, channels))
    }

    /// Returns the rows `[rows, channels]` of the stack's last output.
    pub(super) fn output(&self, rows: usize, channels: usize) -> &[f32] {
        &self.front[channels..][..rows * channels]
    }

    /// Like [`Self::output`], mutable.
    pub(super) fn output_mut(&mut self, rows: usize, channels: usize) -> &mut [f32] {
        &mut self.front[channels..][..rows * channels]
    }
}

/// Zeroes the two padding rows of a buffer and returns the rows between them.
fn padded(buffer: &mut [f32], rows: usize, channels: usize) -> &mut [f32] {
    let (before, rest) = buffer.split_at_mut(channels);
    let (inside, after) = rest.split_at_mut(rows * channels);
    before.fill(0.0);
    after[..channels].fill(0.0);
    inside
}

/// A convolution over three frames.
#[derive(Debug)]
struct Conv(Linear);

impl Conv {
    fn load(loader: &Loader, name: &str, outputs: usize, channels: usize) -> Result<Self, LoadError> {
        Ok(Self(loader.conv(name, outputs, channels, KERNEL, true)?))
    }

    fn channels(&self) -> usize {
        self.0.inputs() / KERNEL
    }

    /// Convolves the padded `x` into the padded `y`.
    fn run(
        &self,
        cx: Compute,
        quant: &mut QuantScratch,
        x: &[f32],
        rows: usize,
        epilogue: Epilogue,
        y: &mut [f32],
    ) -> Result<(), StepError> {
        let x = Mat::with_stride(x, rows, self.0.inputs(), self.channels())?;
        let y = MatMut::new(padded(y, rows, self.0.outputs()), rows, self.0.outputs())?;
        self.0.forward(cx, quant, x, epilogue, y)
    }

    /// Convolution with LeakyReLU from `front` to `front`, using `back`.
    fn activate(&self, cx: Compute, s: &mut ConvScratch, rows: usize) -> Result<(), StepError> {
        self.run(cx, &mut s.quant, &s.front, rows, Epilogue::STORE.then(LEAKY), &mut s.back)?;
        std::mem::swap(&mut s.front, &mut s.back);
        Ok(())
    }

    /// Convolution from `front` to `front`, using `back`.
    fn finish(&self, cx: Compute, s: &mut ConvScratch, rows: usize) -> Result<(), StepError> {
        self.run(cx, &mut s.quant, &s.front, rows, Epilogue::STORE, &mut s.back)?;
        std::mem::swap(&mut s.front, &mut s.back);
        Ok(())
    }
}

/// `x + conv(leaky_relu(conv(x)))`.
#[derive(Debug)]
struct Residual {
    first: Conv,
    second: Conv,
}

impl Residual {
    fn load(loader: &Loader, name: &str, width: usize) -> Result<Self, LoadError> {
        let conv = |i| Conv::load(loader, &format!("{name}.model.{i}"), width, width);
        Ok(Self { first: conv(0)?, second: conv(2)? })
    }

    fn run(&self, cx: Compute, s: &mut ConvScratch, rows: usize) -> Result<(), StepError> {
        self.first.run(cx, &mut s.quant, &s.front, rows, Epilogue::STORE.then(LEAKY), &mut s.back)?;
        self.second.run(cx, &mut s.quant, &s.back, rows, Epilogue::ADD, &mut s.front)
    }
}

/// Stack from `channels` to `width`: per layer a convolution, LeakyReLU and a residual block.
#[derive(Debug)]
pub(super) struct EncoderStack {
    layers: Vec<(Conv, Residual)>,
}

impl EncoderStack {
    /// Loads `{name}.0` and so on.
    pub(super) fn load(loader: &Loader, name: &str, codec: Codec, width: usize) -> Result<Self, LoadError> {
        let layer = |i: usize| {
            let channels = if i == 0 { codec.channels } else { width };
            let conv = Conv::load(loader, &format!("{name}.{}", 3 * i), width, channels)?;
            Ok((conv, Residual::load(loader, &format!("{name}.{}", 3 * i + 2), width)?))
        };
        Ok(Self { layers: (0..codec.layers).map(layer).collect::<Result<_, LoadError>>()? })
    }

    /// Replaces the input of `scratch` by the stack's output.
    pub(super) fn run(&self, cx: Compute, scratch: &mut ConvScratch, rows: usize) -> Result<(), StepError> {
        self.layers.iter().try_for_each(|(conv, residual)| {
            conv.activate(cx, scratch, rows)?;
            residual.run(cx, scratch, rows)
        })
    }
}

/// Stack from `width` to `channels`: two residual blocks, then convolutions with LeakyReLU, the last of which
/// changes the width to `channels`, then a final convolution.
#[derive(Debug)]
pub(super) struct DecoderStack {
    residuals: [Residual; 2],
    layers: Vec<Conv>,
    last: Conv,
}

impl DecoderStack {
    /// Loads `{name}.0` and so on.
    pub(super) fn load(loader: &Loader, name: &str, codec: Codec, width: usize) -> Result<Self, LoadError> {
        let residual = |i: usize| Residual::load(loader, &format!("{name}.{i}"), width);
        let layer = |i: usize| {
            let outputs = if i + 1 == codec.layers { codec.channels } else { width };
            Conv::load(loader, &format!("{name}.{}", 2 + 2 * i), outputs, width)
        };
        Ok(Self {
            residuals: [residual(0)?, residual(1)?],
            layers: (0..codec.layers).map(layer).collect::<Result<_, _>>()?,
            last: Conv::load(loader, &format!("{name}.{}", 2 + 2 * codec.layers), codec.channels, codec.channels)?,
        })
    }

    /// Replaces the input of `scratch` by the stack's output.
    pub(super) fn run(&self, cx: Compute, scratch: &mut ConvScratch, rows: usize) -> Result<(), StepError> {
        self.residuals.iter().try_for_each(|residual| residual.run(cx, scratch, rows))?;
        self.layers.iter().try_for_each(|conv| conv.activate(cx, scratch, rows))?;
        self.last.finish(cx, scratch, rows)
    }
}
