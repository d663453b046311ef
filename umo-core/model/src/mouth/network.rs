//! The causal network: rows of features to channels and voice activity, one frame at a time.

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::Rows;
use umo_kernels::{Isa, Mat, MatMut};

use crate::config;
use crate::linear::Linear;
use crate::weights::Loader;

const RELU: Epilogue<'static> = Epilogue::STORE.then(Activation::Relu);

/// Weights of the network.
#[derive(Debug)]
pub(super) struct Network {
    /// Input layer over the last rows, `[width, taps * features]`.
    input: Linear,
    blocks: Box<[Block]>,
    /// Output layer for the channels and the voice activity, `[channels + 1, width]`.
    head: Linear,
    /// The second head, for the frame `behind` frames before, if there is one.
    later: Option<Linear>,
    kernel: usize,
}

/// `x + pointwise(relu(dilated(x)))`.
#[derive(Debug)]
struct Block {
    /// Convolution over `kernel` frames, `dilation` apart; the last one is the current frame.
    dilated: Linear,
    pointwise: Linear,
    dilation: usize,
}

/// Input history of each block: `[(kernel - 1) * dilation + 1, width]`, oldest first; the last row is the
/// current frame. All rows are 0 before the first frame.
#[derive(Debug)]
pub(super) struct History(Slice<Slice<f32>>);

impl History {
    pub(super) fn clear(&mut self) {
        self.0.iter_mut().for_each(|frames| frames.fill(0.0));
    }

    /// Describes the history.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.0.iter_mut().try_for_each(|frames| pass.f32s(frames))
    }
}

/// Scratch memory for one frame.
#[derive(Debug)]
pub(super) struct NetworkScratch {
    /// `[width]`.
    x: Slice<f32>,
    /// Input of a dilated convolution, `[kernel, width]`.
    taps: Slice<f32>,
    /// `[width]`.
    inner: Slice<f32>,
    /// `[channels + 1]`.
    outputs: Slice<f32>,
    /// `[channels + 1]`, empty without a second head.
    later: Slice<f32>,
}

impl Network {
    pub(super) fn load(loader: &Loader, sizes: &config::Mouth) -> Result<Self, LoadError> {
        let (width, kernel) = (sizes.width, sizes.kernel);
        let block = |(i, &dilation): (usize, &usize)| {
            Ok(Block {
                dilated: loader.conv(&format!("mouth.blocks.{i}.0"), width, width, kernel, true)?,
                pointwise: loader.conv(&format!("mouth.blocks.{i}.1"), width, width, 1, true)?,
                dilation,
            })
        };
        Ok(Self {
            input: loader.conv("mouth.input", width, sizes.features(), sizes.taps, true)?,
            blocks: sizes.dilations.iter().enumerate().map(block).collect::<Result<_, LoadError>>()?,
            head: loader.conv("mouth.head", sizes.outputs(), width, 1, true)?,
            later: match sizes.behind {
                0 => None,
                _ => Some(loader.conv("mouth.later", sizes.outputs(), width, 1, true)?),
            },
            kernel,
        })
    }

    fn width(&self) -> usize {
        self.input.outputs()
    }

    pub(super) fn history(&self, arena: &Arena) -> History {
        let frames = |block: &Block| arena.filled(0.0, ((self.kernel - 1) * block.dilation + 1) * self.width());
        History(arena.collect(self.blocks.iter().map(frames)))
    }

    pub(super) fn scratch(&self, arena: &Arena) -> NetworkScratch {
        NetworkScratch {
            x: arena.filled(0.0, self.width()),
            taps: arena.filled(0.0, self.kernel * self.width()),
            inner: arena.filled(0.0, self.width()),
            outputs: arena.filled(0.0, self.head.outputs()),
            later: arena.filled(0.0, self.later.as_ref().map_or(0, Linear::outputs)),
        }
    }

    /// Computes one frame: from `rows [taps, features]`, oldest first, to `[channels + 1]` of each head; the second is
    /// empty if there is none. The last output of each is the log-odds of a voice.
    pub(super) fn run<'a>(
        &self,
        isa: Isa,
        history: &mut History,
        scratch: &'a mut NetworkScratch,
        rows: &[f32],
    ) -> Result<(&'a [f32], &'a [f32]), StepError> {
        let NetworkScratch { x, taps, inner, outputs, later } = scratch;
        apply(isa, &self.input, rows, RELU, x)?;
        for (block, frames) in self.blocks.iter().zip(&mut history.0) {
            frames.copy_within(x.len().., 0);
            let last = frames.len() - x.len();
            frames[last..].copy_from_slice(x);
            let before = frames.chunks_exact(x.len()).step_by(block.dilation);
            taps.chunks_exact_mut(x.len()).zip(before).for_each(|(tap, frame)| tap.copy_from_slice(frame));
            apply(isa, &block.dilated, taps, RELU, inner)?;
            apply(isa, &block.pointwise, inner, Epilogue::ADD, x)?;
        }
        apply(isa, &self.head, x, Epilogue::STORE, outputs)?;
        if let Some(head) = &self.later {
            apply(isa, head, x, Epilogue::STORE, later)?;
        }
        Ok((outputs, later))
    }
}

/// Computes the product for one row.
fn apply(isa: Isa, layer: &Linear, x: &[f32], epilogue: Epilogue, y: &mut [f32]) -> Result<(), StepError> {
    let (x, outputs) = (Rows::float(Mat::new(x, 1, layer.inputs())?), layer.outputs());
    layer.apply_here(isa, x, 0..outputs, epilogue, MatMut::new(y, 1, outputs)?)
}
