//! Log-mel features with causal differences: the tokenizer of small models.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};
use umo_kernels::matmul_f32::Epilogue;
use umo_kernels::{Mat, MatMut};

use crate::config;
use crate::error::{LoadError, StepError};
use crate::linear::{Compute, Linear, Ready};
use crate::state::{StateError, StatePass};
use crate::weights::Loader;

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
    /// `[width]`.
    mean: Box<[f32]>,
    /// `[width]`.
    scale: Box<[f32]>,
    fft: Arc<dyn RealToComplex<f64>>,
}

impl fmt::Debug for Mel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Mel").field("sizes", &self.sizes).field("hop", &self.hop).finish_non_exhaustive()
    }
}

/// The last two rows of every order of differences but the highest: `[deltas, 2, bands]`, older first.
#[derive(Debug)]
pub(super) struct Past(Box<[f32]>);

impl Past {
    /// Describes what the stream remembers.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.f32s(&mut self.0)
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
}

impl Mel {
    pub(super) fn load(loader: &Loader, sizes: &config::Mel, hop: usize) -> Result<Self, LoadError> {
        Ok(Self {
            sizes: sizes.clone(),
            hop,
            window: loader.vector("audio.mel.window.weight", sizes.window)?,
            filters: loader.linear(&["audio.mel.filters.weight".to_owned()], &[sizes.bands], sizes.fft / 2 + 1)?,
            mean: loader.vector("audio.mel.mean", sizes.width())?,
            scale: loader.vector("audio.mel.scale", sizes.width())?,
            fft: RealFftPlanner::new().plan_fft_forward(sizes.fft),
        })
    }

    /// What a stream remembers; [`Mel::begin`] makes it that of a new stream.
    pub(super) fn past(&self) -> Past {
        Past(vec![0.0; self.sizes.deltas * 2 * self.sizes.bands].into())
    }

    /// Room for `frames` frames per call.
    pub(super) fn scratch(&self, frames: usize) -> Scratch {
        let bins = self.filters.inputs();
        Scratch {
            frame: self.fft.make_input_vec().into(),
            spectrum: self.fft.make_output_vec().into(),
            work: self.fft.make_scratch_vec().into(),
            power: vec![0.0; frames * bins].into(),
            energy: vec![0.0; frames * self.sizes.bands].into(),
        }
    }

    /// Before the first feature there is silence, whose differences are zero.
    pub(super) fn begin(&self, past: &mut Past) {
        for (order, rows) in past.0.chunks_exact_mut(2 * self.sizes.bands).enumerate() {
            rows.fill(if order == 0 { self.sizes.floor.ln() } else { 0.0 });
        }
    }

    /// Writes the feature of silence to every row of `features`.
    pub(super) fn fill(&self, features: &mut [f32]) {
        for row in features.chunks_exact_mut(self.sizes.width()) {
            let (log, differences) = row.split_at_mut(self.sizes.bands);
            log.fill(self.sizes.floor.ln());
            differences.fill(0.0);
            self.normalise(row);
        }
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
        let (bins, bands, width) = (self.filters.inputs(), self.sizes.bands, self.sizes.width());
        let count = features.len() / width;
        let frames = Mat::with_stride(samples, count, self.sizes.window, self.hop)?;
        for (t, power) in scratch.power.chunks_exact_mut(bins).take(count).enumerate() {
            self.power(frames.row(t), &mut scratch.frame, &mut scratch.spectrum, &mut scratch.work, power);
        }
        let power = Mat::new(&scratch.power, count, bins)?;
        let energy = MatMut::new(&mut scratch.energy, count, bands)?;
        self.filters.apply(cx, Ready::Float(power), None, 0..bands, Epilogue::STORE, energy)?;
        for (row, energy) in features.chunks_exact_mut(width).zip(scratch.energy.chunks_exact(bands)) {
            for (log, energy) in row.iter_mut().zip(energy) {
                *log = energy.max(self.sizes.floor).ln();
            }
            self.differences(past, row);
            self.normalise(row);
        }
        Ok(())
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
    fn differences(&self, past: &mut Past, row: &mut [f32]) {
        let bands = self.sizes.bands;
        for (order, rows) in past.0.chunks_exact_mut(2 * bands).enumerate() {
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
