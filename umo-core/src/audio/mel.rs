//! Log-mel features with causal differences, and a small network on the last of them: the tokenizer of small models.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::{Mat, MatMut};

use crate::config;
use crate::error::{LoadError, StepError};
use crate::linear::{Compute, Linear, Ready};
use crate::memory::filled;
use crate::state::{StateError, StatePass};
use crate::weights::Loader;

/// Between the network's layers.
const RELU: Epilogue<'static> = Epilogue::STORE.then(Activation::Relu);

/// Log-mel features.
///
/// Energies of quiet bands stand beside loud ones, and their logarithms count as much: the transform is in f64.
pub(super) struct Mel {
    sizes: config::Mel,
    hop: usize,
    /// `[window]`.
    window: Box<[f32]>,
    /// `[bands, fft / 2 + 1]`.
    filters: Linear,
    /// `[bands width]`.
    mean: Box<[f32]>,
    /// `[bands width]`.
    scale: Box<[f32]>,
    /// Layers on the last features; none where these are what units are of.
    network: Box<[Linear]>,
    fft: Arc<dyn RealToComplex<f64>>,
}

impl fmt::Debug for Mel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Mel").field("sizes", &self.sizes).field("hop", &self.hop).finish_non_exhaustive()
    }
}

/// What a stream remembers.
#[derive(Debug)]
pub(super) struct Past {
    /// The last two rows of every order of differences but the highest: `[deltas, 2, bands]`, older first.
    differences: Box<[f32]>,
    /// The last features that the network looks back to: `[taps - 1, bands width]`, oldest first.
    rows: Box<[f32]>,
}

impl Past {
    /// Describes it.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.f32s(&mut self.differences)?;
        pass.f32s(&mut self.rows)
    }
}

/// Room for the frames of one call.
#[derive(Debug)]
pub(super) struct Scratch {
    /// `[fft]`.
    frame: Box<[f64]>,
    /// `[fft / 2 + 1]`.
    spectrum: Box<[Complex<f64>]>,
    /// The transform's own.
    work: Box<[Complex<f64>]>,
    /// `[frames, fft / 2 + 1]`.
    power: Box<[f32]>,
    /// `[frames, bands]`.
    energy: Box<[f32]>,
    /// What the network looks back to, then the new features: `[taps - 1 + frames, bands width]`.
    rows: Box<[f32]>,
    /// Outputs of every layer but the last, by turns: each `[frames, widest]`.
    layers: [Box<[f32]>; 2],
}

impl Mel {
    pub(super) fn load(loader: &Loader, sizes: &config::Mel, hop: usize) -> Result<Self, LoadError> {
        let layers = sizes.network.iter().flat_map(|network| network.layers(sizes.bands_width())).enumerate();
        let network = layers
            .map(|(i, (outputs, inputs))| loader.linear_with_bias(&format!("audio.mel.network.{i}"), outputs, inputs));
        Ok(Self {
            network: network.collect::<Result<_, _>>()?,
            sizes: sizes.clone(),
            hop,
            window: loader.vector("audio.mel.window.weight", sizes.window)?,
            filters: loader.linear(&["audio.mel.filters.weight".to_owned()], &[sizes.bands], sizes.fft / 2 + 1)?,
            mean: loader.vector("audio.mel.mean", sizes.bands_width())?,
            scale: loader.vector("audio.mel.scale", sizes.bands_width())?,
            fft: RealFftPlanner::new().plan_fft_forward(sizes.fft),
        })
    }

    /// What a stream remembers; [`Mel::begin`] makes it that of a new stream.
    pub(super) fn past(&self) -> Past {
        Past {
            differences: filled(0.0, self.sizes.deltas * 2 * self.sizes.bands).into(),
            rows: filled(0.0, self.back() * self.sizes.bands_width()).into(),
        }
    }

    /// Features before its own that the network takes for a token.
    fn back(&self) -> usize {
        self.sizes.network.as_ref().map_or(0, |network| network.taps - 1)
    }

    /// Room for `frames` frames per call.
    pub(super) fn scratch(&self, frames: usize) -> Scratch {
        let bins = self.filters.inputs();
        Scratch {
            frame: self.fft.make_input_vec().into(),
            spectrum: self.fft.make_output_vec().into(),
            work: self.fft.make_scratch_vec().into(),
            power: filled(0.0, frames * bins).into(),
            energy: filled(0.0, frames * self.sizes.bands).into(),
            rows: filled(0.0, (self.back() + frames) * self.sizes.bands_width()).into(),
            layers: [(); 2].map(|()| filled(0.0, frames * self.widest()).into()),
        }
    }

    /// Most outputs of a layer that is not the last.
    fn widest(&self) -> usize {
        self.network.iter().rev().skip(1).map(Linear::outputs).max().unwrap_or(0)
    }

    /// Before the first feature there is silence, whose differences are zero.
    pub(super) fn begin(&self, past: &mut Past) {
        past.rows.chunks_exact_mut(self.sizes.bands_width()).for_each(|row| self.silence(row));
        for (order, rows) in past.differences.chunks_exact_mut(2 * self.sizes.bands).enumerate() {
            rows.fill(if order == 0 { self.sizes.floor.ln() } else { 0.0 });
        }
    }

    /// The normalised log-mel feature of silence.
    fn silence(&self, row: &mut [f32]) {
        let (log, differences) = row.split_at_mut(self.sizes.bands);
        log.fill(self.sizes.floor.ln());
        differences.fill(0.0);
        self.normalise(row);
    }

    /// Writes the feature of silence after silence to every row of `features`.
    pub(super) fn fill(&self, cx: Compute, scratch: &mut Scratch, features: &mut [f32]) -> Result<(), StepError> {
        let (width, taps) = (self.sizes.bands_width(), self.back() + 1);
        let Some((first, others)) = features.split_at_mut_checked(self.sizes.width()) else { return Ok(()) };
        scratch.rows[..taps * width].chunks_exact_mut(width).for_each(|row| self.silence(row));
        self.listen(cx, scratch, first)?;
        others.chunks_exact_mut(first.len()).for_each(|row| row.copy_from_slice(first));
        Ok(())
    }

    /// Feature `j` from `samples[hop * j .. hop * j + window]`, as many as `features [n, width]` has rows.
    pub(super) fn extract(
        &self,
        cx: Compute,
        past: &mut Past,
        scratch: &mut Scratch,
        samples: &[f32],
        features: &mut [f32],
    ) -> Result<(), StepError> {
        let (bins, bands, width) = (self.filters.inputs(), self.sizes.bands, self.sizes.bands_width());
        let count = features.len() / self.sizes.width();
        let frames = Mat::with_stride(samples, count, self.sizes.window, self.hop)?;
        for (t, power) in scratch.power.chunks_exact_mut(bins).take(count).enumerate() {
            self.power(frames.row(t), &mut scratch.frame, &mut scratch.spectrum, &mut scratch.work, power);
        }
        let power = Mat::new(&scratch.power, count, bins)?;
        let energy = MatMut::new(&mut scratch.energy, count, bands)?;
        self.filters.apply(cx, Ready::Float(power), None, 0..bands, Epilogue::STORE, energy)?;
        let (back, fresh) = scratch.rows[..(self.back() + count) * width].split_at_mut(past.rows.len());
        for (row, energy) in fresh.chunks_exact_mut(width).zip(scratch.energy.chunks_exact(bands)) {
            for (log, energy) in row.iter_mut().zip(energy) {
                *log = energy.max(self.sizes.floor).ln();
            }
            self.differences(&mut past.differences, row);
            self.normalise(row);
        }
        back.copy_from_slice(&past.rows);
        past.rows.copy_from_slice(&scratch.rows[count * width..][..past.rows.len()]);
        self.listen(cx, scratch, features)
    }

    /// The network's outputs, or the rows themselves, for the last rows of the scratch: `features [n, width]`.
    fn listen(&self, cx: Compute, scratch: &mut Scratch, features: &mut [f32]) -> Result<(), StepError> {
        let (width, count) = (self.sizes.bands_width(), features.len() / self.sizes.width());
        let Some((last, layers)) = self.network.split_last() else {
            features.copy_from_slice(&scratch.rows[..features.len()]);
            return Ok(());
        };
        let [read, write] = &mut scratch.layers;
        let (mut read, mut write) = (read, write);
        // A token's row starts where its oldest feature does: the rows overlap.
        let mut x = Mat::with_stride(&scratch.rows, count, (self.back() + 1) * width, width)?;
        for layer in layers {
            let y = MatMut::new(write, count, layer.outputs())?;
            layer.apply(cx, Ready::Float(x), None, 0..layer.outputs(), RELU, y)?;
            std::mem::swap(&mut read, &mut write);
            x = Mat::new(read, count, layer.outputs())?;
        }
        let y = MatMut::new(features, count, last.outputs())?;
        last.apply(cx, Ready::Float(x), None, 0..last.outputs(), Epilogue::STORE, y)
    }

    /// The power spectrum of one windowed frame, padded with zeros at its end.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of the filters")]
    fn power(
        &self,
        samples: &[f32],
        frame: &mut [f64],
        spectrum: &mut [Complex<f64>],
        work: &mut [Complex<f64>],
        power: &mut [f32],
    ) {
        let (head, padding) = frame.split_at_mut(self.window.len());
        for ((frame, &sample), &weight) in head.iter_mut().zip(samples).zip(&self.window) {
            *frame = f64::from(sample) * f64::from(weight);
        }
        padding.fill(0.0);
        self.fft.process_with_scratch(frame, spectrum, work).expect("the buffers are the plan's own");
        for (power, value) in power.iter_mut().zip(spectrum.iter()) {
            *power = value.norm_sqr() as f32;
        }
    }

    /// Each order from the one below: half the change over the last two rows.
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
