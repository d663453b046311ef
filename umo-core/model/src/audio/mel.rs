//! Log-mel features with causal differences, and a small network over recent features: the tokenizer of small
//! models.

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::functions::Functions;
use umo_core_base::memory::{Arena, Slice, filled};
use umo_core_base::state::{StateError, StatePass};
use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::product::Rows;
use umo_kernels::{Mat, MatMut};

use crate::config;
use crate::linear::{Compute, Linear};
use crate::weights::Loader;

use super::spectrum::{Spectrum, SpectrumScratch};

/// Epilogue between the network's layers.
const RELU: Epilogue<'static> = Epilogue::STORE.then(Activation::Relu);

/// Log-mel features.
#[derive(Debug)]
pub(super) struct Mel {
    sizes: config::Mel,
    hop: usize,
    spectrum: Spectrum,
    /// `[bands width]`.
    mean: Box<[f32]>,
    /// `[bands width]`.
    scale: Box<[f32]>,
    /// Layers over recent features; empty if units are computed from the features themselves.
    network: Box<[Linear]>,
    /// Blocks between the first layer and the others.
    blocks: Box<[Block]>,
    /// Number of rows that a block reads.
    kernel: usize,
}

/// `x + pointwise(relu(causal(x)))`.
#[derive(Debug)]
struct Block {
    /// Convolution over a row and the `kernel - 1` rows before it.
    causal: Linear,
    pointwise: Linear,
}

/// State of a stream.
#[derive(Debug)]
pub(super) struct Past {
    /// The last two rows of every order of differences except the highest: `[deltas, 2, bands]`, older first.
    differences: Slice<f32>,
    /// The last features in the network's history: `[taps - 1, bands width]`, oldest first.
    rows: Slice<f32>,
    /// The last rows in each block's history: `[blocks, kernel - 1, width]`, oldest first.
    blocks: Slice<f32>,
}

impl Past {
    /// Describes the state.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.f32s(&mut self.differences)?;
        pass.f32s(&mut self.rows)?;
        pass.f32s(&mut self.blocks)
    }
}

/// Scratch memory for the frames of one call.
#[derive(Debug)]
pub(super) struct Scratch {
    spectrum: SpectrumScratch,
    /// `[frames, fft / 2 + 1]`.
    power: Box<[f32]>,
    /// `[frames, bands]`.
    energy: Box<[f32]>,
    /// The network's history, then the new features: `[taps - 1 + frames, bands width]`.
    rows: Box<[f32]>,
    /// Outputs of every layer except the last, alternating: each `[frames, widest]`.
    layers: [Box<[f32]>; 2],
    /// A block's history, then its input: `[kernel - 1 + frames, width]`.
    block: Box<[f32]>,
    /// Feature of silence after silence: `[width]`.
    silence: Box<[f32]>,
}

impl Mel {
    pub(super) fn load(loader: &Loader, sizes: &config::Mel, hop: usize) -> Result<Self, LoadError> {
        let layers = sizes.network.iter().flat_map(|network| network.layers(sizes.bands_width())).enumerate();
        let network = layers
            .map(|(i, (outputs, inputs))| loader.linear_with_bias(&format!("audio.mel.network.{i}"), outputs, inputs));
        let blocks = sizes.network.iter().filter_map(|network| Some((network.width(), network.blocks?)));
        let block = |(width, kernel, i): (usize, usize, usize)| {
            Ok(Block {
                causal: loader.conv(&format!("audio.mel.network.blocks.{i}.0"), width, width, kernel, true)?,
                pointwise: loader.conv(&format!("audio.mel.network.blocks.{i}.1"), width, width, 1, true)?,
            })
        };
        Ok(Self {
            network: network.collect::<Result<_, _>>()?,
            blocks: blocks
                .clone()
                .flat_map(|(width, blocks)| (0..blocks.count).map(move |i| (width, blocks.kernel, i)))
                .map(block)
                .collect::<Result<_, LoadError>>()?,
            kernel: blocks.map(|(_, blocks)| blocks.kernel).next().unwrap_or(1),
            sizes: sizes.clone(),
            hop,
            spectrum: Spectrum::load(loader, "audio.mel", sizes.window, sizes.fft, sizes.bands)?,
            mean: loader.vector("audio.mel.mean", sizes.bands_width())?,
            scale: loader.vector("audio.mel.scale", sizes.bands_width())?,
        })
    }

    /// Allocates the state of a stream; [`Mel::begin`] initialises it.
    pub(super) fn past(&self, arena: &Arena) -> Past {
        Past {
            differences: arena.filled(0.0, self.sizes.deltas * 2 * self.sizes.bands),
            rows: arena.filled(0.0, self.back() * self.sizes.bands_width()),
            blocks: arena.filled(0.0, self.blocks.len() * self.block_back()),
        }
    }

    /// Number of earlier features that the network reads for a token.
    fn back(&self) -> usize {
        self.sizes.network.as_ref().map_or(0, |network| network.taps - 1)
    }

    /// Number of values in the history of one block.
    fn block_back(&self) -> usize {
        self.blocks.first().map_or(0, |block| (self.kernel - 1) * block.pointwise.outputs())
    }

    /// Allocates scratch for `frames` frames per call.
    pub(super) fn scratch(&self, frames: usize) -> Scratch {
        let frames = frames.max(1);
        Scratch {
            spectrum: self.spectrum.scratch(&Arena::system()),
            power: filled(0.0, frames * self.spectrum.bins()).into(),
            energy: filled(0.0, frames * self.sizes.bands).into(),
            rows: filled(0.0, (self.back() + frames) * self.sizes.bands_width()).into(),
            layers: [(); 2].map(|()| filled(0.0, frames * self.widest()).into()),
            block: filled(0.0, self.block_back() + frames * self.widest()).into(),
            silence: filled(0.0, self.sizes.width()).into(),
        }
    }

    /// Maximum number of outputs of any layer except the last.
    fn widest(&self) -> usize {
        self.network.iter().rev().skip(1).map(Linear::outputs).max().unwrap_or(0)
    }

    /// Sets the history to silence, with differences of zero, and computes the feature of silence.
    pub(super) fn begin(&self, cx: Compute, past: &mut Past, scratch: &mut Scratch) -> Result<(), StepError> {
        past.rows.chunks_exact_mut(self.sizes.bands_width()).for_each(|row| self.silence(row));
        for (order, rows) in past.differences.chunks_exact_mut(2 * self.sizes.bands).enumerate() {
            rows.fill(if order == 0 { self.sizes.floor.logarithm() } else { 0.0 });
        }
        past.blocks.fill(0.0);
        let mut heard = std::mem::take(&mut scratch.silence);
        let rows = (self.back() + 1) * self.sizes.bands_width();
        for _ in 0..=self.blocks.len() * (self.kernel - 1) {
            scratch.rows[..rows].chunks_exact_mut(self.sizes.bands_width()).for_each(|row| self.silence(row));
            self.listen(cx, past, scratch, &mut heard)?;
        }
        scratch.silence = heard;
        Ok(())
    }

    /// Writes the normalised log-mel feature of silence.
    fn silence(&self, row: &mut [f32]) {
        let (log, differences) = row.split_at_mut(self.sizes.bands);
        log.fill(self.sizes.floor.logarithm());
        differences.fill(0.0);
        self.normalise(row);
    }

    /// Writes the feature of silence after silence to every row of `features`, after [`Mel::begin`].
    pub(super) fn fill(&self, scratch: &Scratch, features: &mut [f32]) {
        features.chunks_exact_mut(self.sizes.width()).for_each(|row| row.copy_from_slice(&scratch.silence));
    }

    /// Computes feature `j` from `samples[hop * j .. hop * j + window]`, for every row of
    /// `features [n, width]`.
    pub(super) fn extract(
        &self,
        cx: Compute,
        past: &mut Past,
        scratch: &mut Scratch,
        samples: &[f32],
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let (bins, bands, width) = (self.spectrum.bins(), self.sizes.bands, self.sizes.bands_width());
        let count = features.len() / self.sizes.width();
        let frames = Mat::with_stride(samples, count, self.sizes.window, self.hop)?;
        for (t, power) in scratch.power.chunks_exact_mut(bins).take(count).enumerate() {
            self.spectrum.power(&mut scratch.spectrum, frames.row(t), power);
        }
        let power = Mat::new(&scratch.power, count, bins)?;
        let energy = MatMut::new(&mut scratch.energy, count, bands)?;
        self.spectrum.filters.apply(cx, Rows::float(power), 0..bands, Epilogue::STORE, energy)?;
        let (back, fresh) = scratch.rows[..(self.back() + count) * width].split_at_mut(past.rows.len());
        for (row, energy) in fresh.chunks_exact_mut(width).zip(scratch.energy.chunks_exact(bands)) {
            for (log, energy) in row.iter_mut().zip(energy) {
                *log = energy.max(self.sizes.floor).logarithm();
            }
            self.differences(&mut past.differences, row);
            self.normalise(row);
        }
        back.copy_from_slice(&past.rows);
        let rows = &mut *past.rows;
        rows.copy_from_slice(&scratch.rows[count * width..][..rows.len()]);
        self.listen(cx, past, scratch, features)
    }

    /// Writes the network's outputs for the last rows of the scratch to `features [n, width]`, or the rows
    /// themselves without a network.
    fn listen(
        &self,
        cx: Compute,
        past: &mut Past,
        scratch: &mut Scratch,
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let (width, count) = (self.sizes.bands_width(), features.len() / self.sizes.width());
        let Some((last, layers)) = self.network.split_last() else {
            features.copy_from_slice(&scratch.rows[..features.len()]);
            return Ok(());
        };
        let [read, write] = &mut scratch.layers;
        let (mut read, mut write) = (read, write);
        // A token's row starts at its oldest feature, so rows overlap.
        let mut x = Mat::with_stride(&scratch.rows, count, (self.back() + 1) * width, width)?;
        for (i, layer) in layers.iter().enumerate() {
            let y = MatMut::new(write, count, layer.outputs())?;
            layer.apply(cx, Rows::float(x), 0..layer.outputs(), RELU, y)?;
            std::mem::swap(&mut read, &mut write);
            if i == 0 {
                self.residual(cx, &mut past.blocks, &mut scratch.block, write, read, count)?;
            }
            x = Mat::new(read, count, layer.outputs())?;
        }
        let y = MatMut::new(features, count, last.outputs())?;
        last.apply(cx, Rows::float(x), 0..last.outputs(), Epilogue::STORE, y)
    }

    /// Applies all blocks to `x [count, width]`, then ReLU.
    fn residual(
        &self,
        cx: Compute,
        past: &mut [f32],
        rows: &mut [f32],
        inner: &mut [f32],
        x: &mut [f32],
        count: usize,
    ) -> Result<(), StepError> {
        let back = self.block_back();
        for (i, block) in self.blocks.iter().enumerate() {
            let width = block.pointwise.outputs();
            let (x, before) = (&mut x[..count * width], &mut past[i * back..(i + 1) * back]);
            rows[..back].copy_from_slice(before);
            rows[back..back + x.len()].copy_from_slice(x);
            before.copy_from_slice(&rows[x.len()..x.len() + back]);
            let windows = Mat::with_stride(rows, count, back + width, width)?;
            block.causal.apply(cx, Rows::float(windows), 0..width, RELU, MatMut::new(inner, count, width)?)?;
            let inner = Rows::float(Mat::new(inner, count, width)?);
            block.pointwise.apply(cx, inner, 0..width, Epilogue::ADD, MatMut::new(x, count, width)?)?;
        }
        if let Some(block) = self.blocks.first() {
            x[..count * block.pointwise.outputs()].iter_mut().for_each(|value| *value = value.max(0.0));
        }
        Ok(())
    }

    /// Computes each order from the one below: half the change over the last two rows.
    fn differences(&self, past: &mut [f32], row: &mut [f32]) {
        let bands = self.sizes.bands;
        for (order, rows) in past.chunks_exact_mut(2 * bands).enumerate() {
            let (older, newer) = rows.split_at_mut(bands);
            let (below, above) = row[order * bands..(order + 2) * bands].split_at_mut(bands);
            for (((above, &below), older), newer) in above.iter_mut().zip(&*below).zip(older).zip(newer) {
                *above = (below - *older) / 2.0;
                *older = *newer;
                *newer = below;
            }
        }
    }

    fn normalise(&self, row: &mut [f32]) {
        for ((value, mean), scale) in row.iter_mut().zip(&self.mean).zip(&self.scale) {
            *value = (*value - mean) * scale;
        }
    }
}
