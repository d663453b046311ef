//! Power spectra of windowed frames and the mel bands of them.

use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{RealFftPlanner, RealToComplex};

use crate::error::LoadError;
use crate::linear::Linear;
use crate::memory::{Arena, Slice};
use crate::weights::Loader;

/// A window, a Fourier transform and mel filters.
///
/// Energies of quiet bands stand beside loud ones, and their logarithms count as much: the
/// transform is in f64.
pub(crate) struct Spectrum {
    /// `[window]`.
    window: Box<[f32]>,
    /// `[bands, fft / 2 + 1]`.
    pub(crate) filters: Linear,
    fft: Arc<dyn RealToComplex<f64>>,
}

impl fmt::Debug for Spectrum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Spectrum").field("window", &self.window.len()).field("fft", &self.fft.len()).finish()
    }
}

/// Buffers of one transform.
#[derive(Debug)]
pub(crate) struct SpectrumScratch {
    /// `[fft]`.
    frame: Slice<f64>,
    /// `[fft / 2 + 1]`.
    spectrum: Slice<Complex<f64>>,
    /// The transform's own.
    work: Slice<Complex<f64>>,
}

impl Spectrum {
    /// Loads `{name}.window.weight` `[window]` and `{name}.filters.weight` `[bands, fft / 2 + 1]`.
    pub(crate) fn load(
        loader: &Loader,
        name: &str,
        window: usize,
        fft: usize,
        bands: usize,
    ) -> Result<Self, LoadError> {
        Ok(Self {
            window: loader.vector(&format!("{name}.window.weight"), window)?,
            filters: loader.linear(&[format!("{name}.filters.weight")], &[bands], fft / 2 + 1)?,
            fft: RealFftPlanner::new().plan_fft_forward(fft),
        })
    }

    pub(crate) fn scratch(&self, arena: &Arena) -> SpectrumScratch {
        let (zero, fft) = (Complex::new(0.0, 0.0), &self.fft);
        SpectrumScratch {
            frame: arena.filled(0.0, fft.len()),
            spectrum: arena.filled(zero, fft.complex_len()),
            work: arena.filled(zero, fft.get_scratch_len()),
        }
    }

    /// Values of a power spectrum.
    pub(crate) fn bins(&self) -> usize {
        self.filters.inputs()
    }

    /// `[window]`.
    pub(crate) fn window(&self) -> &[f32] {
        &self.window
    }

    /// The power spectrum `[bins]` of one windowed frame, padded with zeros at its end.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of the filters")]
    pub(crate) fn power(&self, scratch: &mut SpectrumScratch, samples: &[f32], power: &mut [f32]) {
        let SpectrumScratch { frame, spectrum, work } = scratch;
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
}
