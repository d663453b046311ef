//! Power spectra of windowed frames, and their mel bands.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};
use umo_core_base::error::LoadError;
use umo_core_base::memory::{self, Arena, Slice};

use crate::linear::Linear;
use crate::weights::Loader;

/// Power spectra of real numbers. Even and odd elements are the real and imaginary parts of one complex
/// transform of half the length.
///
/// The transform is rustfft's scalar one, with the same bits on every instruction set. The SIMD transforms
/// would make up a third of this crate's code, and a spectrum is a small part of a chunk's time.
struct PowerTransform {
    /// Transform of `length / 2` complex numbers.
    half: Arc<dyn Fft<f64>>,
    /// `exp(-2πik / length)`, `[length / 4 + 1]`.
    twiddles: Box<[Complex<f64>]>,
}

impl PowerTransform {
    /// `length` is even and not 0. If memory runs out, unwinds to [`memory::catch`].
    fn new(length: usize) -> Self {
        // More than the planner allocates; its own allocation failure would abort the process.
        memory::require(64 * length);
        let step = -2.0 * PI / length as f64;
        Self {
            half: FftPlannerScalar::new().plan_fft_forward(length / 2),
            twiddles: (0..=length / 4).map(|k| Complex::from_polar(1.0, step * k as f64)).collect(),
        }
    }

    fn scratch(&self, arena: &Arena) -> SpectrumScratch {
        let zero = Complex::new(0.0, 0.0);
        SpectrumScratch {
            pairs: arena.filled(zero, self.half.len()),
            work: arena.filled(zero, self.half.get_inplace_scratch_len()),
        }
    }

    /// Writes the power spectrum `power` `[length / 2 + 1]` of `values`, padded with zeros to the length.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of the filters")]
    fn power(&self, scratch: &mut SpectrumScratch, mut values: impl Iterator<Item = f64>, power: &mut [f32]) {
        let SpectrumScratch { pairs, work } = scratch;
        for pair in pairs.iter_mut() {
            *pair = Complex::new(values.next().unwrap_or(0.0), values.next().unwrap_or(0.0));
        }
        self.half.process_with_scratch(pairs, work);
        // The transforms of the even and odd elements give bin `k` and bin `half - k`.
        let half = pairs.len();
        for (k, &twiddle) in self.twiddles.iter().enumerate() {
            let (value, mirrored) = (pairs[k], pairs[(half - k) % half].conj());
            let even = (value + mirrored) * 0.5;
            let odd = (value - mirrored) * Complex::new(0.0, -0.5) * twiddle;
            power[k] = (even + odd).norm_sqr() as f32;
            power[half - k] = (even - odd).norm_sqr() as f32;
        }
    }
}

/// A window, a Fourier transform and mel filters.
///
/// Quiet bands are as important as loud ones, since their logarithms count equally: the transform is in f64.
pub(crate) struct Spectrum {
    /// `[window]`.
    window: Box<[f32]>,
    /// `[bands, fft / 2 + 1]`.
    pub(crate) filters: Linear,
    transform: PowerTransform,
}

impl fmt::Debug for Spectrum {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let fft = 2 * self.transform.half.len();
        f.debug_struct("Spectrum").field("window", &self.window.len()).field("fft", &fft).finish()
    }
}

/// Buffers of one transform.
#[derive(Debug)]
pub(crate) struct SpectrumScratch {
    /// `[fft / 2]`.
    pairs: Slice<Complex<f64>>,
    /// Scratch memory of the transform.
    work: Slice<Complex<f64>>,
}

impl Spectrum {
    /// Loads `{name}.window.weight` `[window]` and `{name}.filters.weight` `[bands, fft / 2 + 1]`.
    /// `fft` is even, and at least `window`.
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
            transform: PowerTransform::new(fft),
        })
    }

    pub(crate) fn scratch(&self, arena: &Arena) -> SpectrumScratch {
        self.transform.scratch(arena)
    }

    /// Number of values of a power spectrum.
    pub(crate) fn bins(&self) -> usize {
        self.filters.inputs()
    }

    /// The window's weights, `[window]`.
    pub(crate) fn window(&self) -> &[f32] {
        &self.window
    }

    /// Computes the power spectrum `[bins]` of one windowed frame, padded with zeros at its end.
    pub(crate) fn power(&self, scratch: &mut SpectrumScratch, samples: &[f32], power: &mut [f32]) {
        let windowed = samples.iter().zip(&self.window).map(|(&sample, &weight)| f64::from(sample) * f64::from(weight));
        self.transform.power(scratch, windowed, power);
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    /// Power spectrum by the definition of the Fourier transform.
    fn power_by_definition(values: &[f64], length: usize) -> Vec<f64> {
        let bin = |k: usize| -> f64 {
            let term = |(i, &value): (usize, &f64)| {
                Complex::from_polar(value, -2.0 * PI * (i * k % length) as f64 / length as f64)
            };
            values.iter().enumerate().map(term).sum::<Complex<f64>>().norm_sqr()
        };
        (0..=length / 2).map(bin).collect()
    }

    proptest! {
        /// Every even length, including powers of two and twice a prime, and no more values than the length.
        #[test]
        fn power_is_that_of_the_definition(
            (length, values) in (1..=300_usize).prop_flat_map(|half| (Just(2 * half), vec(-1.0..=1.0_f64, 0..=2 * half))),
        ) {
            let transform = PowerTransform::new(length);
            let mut power = vec![f32::NAN; length / 2 + 1];
            transform.power(&mut transform.scratch(&Arena::system()), values.iter().copied(), &mut power);
            for (&power, expected) in power.iter().zip(power_by_definition(&values, length)) {
                let error = (f64::from(power) - expected).abs();
                prop_assert!(error <= 1e-7 * expected + 1e-12 * length as f64, "{power} is not {expected}");
            }
        }
    }
}
