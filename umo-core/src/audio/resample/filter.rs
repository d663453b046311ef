//! The Fourier filter that converts between two sample rates.

use std::f64::consts::PI;
use std::fmt;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};

use crate::audio::MAX_AMPLITUDE;
use crate::error::StepError;
use crate::memory::{self, Arena, Slice, filled};
use crate::state::{Span, StateError, StatePass};

/// Least length of the filter, in samples of the lower of the two rates. At 480, measured: the band
/// up to 0.93 of half that rate is kept within 1e-7, all above the half is below -140 dB, and the
/// filter waits for 240 samples, 15 ms at 16 kHz. Rates with a small common divisor need longer
/// blocks: at worst (coprime) the filter waits for a second.
const FILTER: usize = 480;

/// Samples that are given at a time.
const PIECE: usize = 256;

/// What filters between two rates share: the filter's spectrum and the transforms of a block.
///
/// A block is transformed with as many zeros behind it, multiplied with the spectrum of a windowed
/// sinc, cut or extended to the other rate's band, and transformed back; what reaches beyond the
/// block is added to the next. Windows and band edge are those of the crate `rubato`, bit for bit.
pub(crate) struct FilterPlan {
    rates: (usize, usize),
    /// Samples of one block, in and out.
    blocks: (usize, usize),
    /// `[block in + 1]`.
    spectrum: Box<[Complex<f64>]>,
    forward: Arc<dyn RealToComplex<f64>>,
    inverse: Arc<dyn ComplexToReal<f64>>,
}

impl fmt::Debug for FilterPlan {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FilterPlan").field("rates", &self.rates).field("blocks", &self.blocks).finish_non_exhaustive()
    }
}

/// Samples of one block at two rates that differ.
pub(super) fn block_sizes(rate_in: usize, rate_out: usize) -> (usize, usize) {
    let divisor = greatest_common_divisor(rate_in, rate_out);
    let (unit_in, unit_out) = (rate_in / divisor, rate_out / divisor);
    // An even number of units: half a block, the delay, is then a whole number of samples at both
    // rates.
    let blocks = FILTER.div_ceil(unit_in.min(unit_out)).next_multiple_of(2);
    (blocks * unit_in, blocks * unit_out)
}

impl FilterPlan {
    /// For two rates that differ.
    ///
    /// # Errors
    /// None: the other version of this has one.
    pub(super) fn new(rate_in: usize, rate_out: usize) -> Result<Self, StepError> {
        let blocks = block_sizes(rate_in, rate_out);
        let (size_in, size_out) = blocks;
        // The plan of the transforms is another crate's: both blocks, in and out, and their twiddle
        // factors, as complex numbers of 16 bytes, a few times each.
        memory::require(256 * (size_in + size_out));
        let mut planner = RealFftPlanner::new();
        let (forward, inverse) = (planner.plan_fft_forward(2 * size_in), planner.plan_fft_inverse(2 * size_out));
        let mut impulse = filled(0.0, 2 * size_in);
        windowed_sinc(size_in, cutoff(size_in, size_out), &mut impulse);
        let mut spectrum = filled(Complex::new(0.0, 0.0), size_in + 1).into_boxed_slice();
        let mut work = filled(Complex::new(0.0, 0.0), forward.get_scratch_len());
        forward.process_with_scratch(&mut impulse, &mut spectrum, &mut work).expect("the buffers are the plan's own");
        Ok(Self { rates: (rate_in, rate_out), blocks, spectrum, forward, inverse })
    }

    /// Rates in and out.
    pub(crate) fn rates(&self) -> (usize, usize) {
        self.rates
    }
}

/// Edge of the band that is kept, of half the rate of a block of `size_in` samples: as high as the
/// window's side lobes allow.
#[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a fit of three digits")]
fn cutoff(size_in: usize, size_out: usize) -> f32 {
    const FIT: [f64; 3] = [13.745202940783823, 121.73532586374934, 5964.163279612051];
    let [k1, k2, k3] = FIT.map(|value| value as f32);
    let points = size_in.min(size_out) as f32;
    let cutoff = 1.0 / (k1 / points + k2 / (points * points) + k3 / (points * points * points) + 1.0);
    if size_in > size_out { cutoff * size_out as f32 / size_in as f32 } else { cutoff }
}

/// Writes the impulse response, of which `len` values are not zero: a sinc under a squared
/// Blackman-Harris window, of sum 1 over the length of its transform.
#[expect(clippy::cast_precision_loss, reason = "a block is shorter than 2^53")]
fn windowed_sinc(len: usize, cutoff: f32, impulse: &mut [f64]) {
    let mut sum = 0.0;
    for (i, value) in impulse.iter_mut().enumerate().take(len) {
        let turn = |n: f64| (n * PI * i as f64 / len as f64).cos();
        let window = 0.35875 - 0.48829 * turn(2.0) + 0.14128 * turn(4.0) - 0.01168 * turn(6.0);
        let x = (i as f64 - (len / 2) as f64) * f64::from(cutoff);
        let sinc = if x == 0.0 { 1.0 } else { (x * PI).sin() / (x * PI) };
        *value = window * window * sinc;
        sum += *value;
    }
    impulse.iter_mut().take(len).for_each(|value| *value = *value / sum / (2 * len) as f64);
}

/// One stream's filter.
#[derive(Debug)]
pub(super) struct Filter {
    plan: Arc<FilterPlan>,
    /// Samples that fill no block yet, of which `waiting_len` count: `[block in]`.
    waiting: Slice<f64>,
    waiting_len: usize,
    /// The block that was filtered last, which what overlaps the next one comes from: `[block in]`.
    last: Slice<f64>,
    /// One block of output.
    block: Slice<f64>,
    /// What the last block adds to the next: `[block out]`.
    overlap: Slice<f64>,
    /// The block and zeros behind it: `[2, block in]`.
    padded: Slice<f64>,
    /// `[block in + 1]`.
    spectrum_in: Slice<Complex<f64>>,
    /// `[block out + 1]`.
    spectrum_out: Slice<Complex<f64>>,
    /// `[2, block out]`.
    wave: Slice<f64>,
    /// The transforms' own, one after the other.
    work: Slice<Complex<f64>>,
    /// Samples of the filter's delay that are still to be dropped.
    left_out: usize,
}

impl Filter {
    /// A stream at its start, in memory of `arena`.
    pub(super) fn new_in(plan: Arc<FilterPlan>, arena: &Arena) -> Self {
        let ((size_in, size_out), zero) = (plan.blocks, Complex::new(0.0, 0.0));
        let floats = |len: usize| arena.filled(0.0, len);
        Self {
            waiting: floats(size_in),
            waiting_len: 0,
            last: floats(size_in),
            block: floats(size_out),
            overlap: floats(size_out),
            padded: floats(2 * size_in),
            spectrum_in: arena.filled(zero, size_in + 1),
            spectrum_out: arena.filled(zero, size_out + 1),
            wave: floats(2 * size_out),
            work: arena.filled(zero, plan.forward.get_scratch_len().max(plan.inverse.get_scratch_len())),
            left_out: size_out / 2,
            plan,
        }
    }

    /// Samples of one block, in and out.
    pub(super) fn block_sizes(&self) -> (usize, usize) {
        self.plan.blocks
    }

    /// Samples of output by which the filter delays.
    fn delay(&self) -> usize {
        self.plan.blocks.1 / 2
    }

    /// Samples that fill no block yet.
    pub(super) fn waiting(&self) -> usize {
        self.waiting_len
    }

    pub(super) fn push(&mut self, mut samples: &[f32], mut out: impl FnMut(&[f32])) {
        while !samples.is_empty() {
            let room = &mut self.waiting[self.waiting_len..];
            let (head, tail) = samples.split_at(samples.len().min(room.len()));
            room.iter_mut().zip(head).for_each(|(slot, &v)| *slot = f64::from(v));
            self.waiting_len += head.len();
            samples = tail;
            if self.waiting_len == self.waiting.len() {
                self.block(&mut out);
            }
        }
    }

    pub(super) fn reset(&mut self) {
        self.overlap.fill(0.0);
        self.waiting_len = 0;
        self.left_out = self.delay();
    }

    /// Filters what waits, padded with zeros to a block.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
    pub(super) fn block(&mut self, mut out: impl FnMut(&[f32])) {
        self.waiting[self.waiting_len..].fill(0.0);
        std::mem::swap(&mut self.waiting, &mut self.last);
        self.waiting_len = 0;
        self.filter();
        let size = self.block.len();
        let late = self.left_out.min(size);
        self.left_out -= late;
        let mut piece = [0.0; PIECE];
        for values in self.block[late..].chunks(PIECE) {
            piece.iter_mut().zip(values).for_each(|(slot, &v)| *slot = v as f32);
            out(&piece[..values.len()]);
        }
    }
}

impl Filter {
    /// Filters `last` into `block`.
    fn filter(&mut self) {
        let Self { plan, last, block, overlap, padded, spectrum_in, spectrum_out, wave, work, .. } = self;
        let (size_in, size_out) = plan.blocks;
        padded[..size_in].copy_from_slice(last);
        padded[size_in..].fill(0.0);
        let room = &mut work[..plan.forward.get_scratch_len()];
        plan.forward.process_with_scratch(padded, spectrum_in, room).expect("the buffers are the plan's own");
        let kept = if size_in < size_out { size_in + 1 } else { size_out };
        let products = spectrum_in.iter().zip(&plan.spectrum).map(|(value, filter)| value * filter);
        spectrum_out.iter_mut().zip(products.take(kept)).for_each(|(slot, value)| *slot = value);
        spectrum_out[kept..].fill(Complex::new(0.0, 0.0));
        let room = &mut work[..plan.inverse.get_scratch_len()];
        // It fails, after all is done, only where the ends of the spectrum are not real: where
        // samples were no numbers.
        let _ = plan.inverse.process_with_scratch(spectrum_out, wave, room);
        let (now, next) = wave.split_at(size_out);
        block.iter_mut().zip(now.iter().zip(&*overlap)).for_each(|(slot, (now, before))| *slot = now + before);
        overlap.copy_from_slice(next);
    }

    /// Describes the filter after so many samples; samples that it gave.
    #[expect(clippy::cast_possible_truncation, reason = "less than a block, and what was given of samples in memory")]
    pub(super) fn state(&mut self, pass: &mut StatePass, taken: u64) -> Result<u64, StateError> {
        let (size_in, size_out) = (self.plan.blocks.0 as u64, self.plan.blocks.1 as u64);
        let delay = self.delay() as u64;
        let filtered = taken / size_in * size_out;
        let waiting = if pass.follows(false) { size_in } else { taken % size_in } as usize;
        let last = if pass.follows(filtered > 0) { size_in } else { 0 } as usize;
        if pass.loads() {
            self.waiting_len = waiting;
            self.left_out = delay.saturating_sub(filtered) as usize;
        }
        // A pass that only measures counts a whole block of samples that wait, which there never
        // are.
        samples(pass, &mut self.waiting, waiting)?;
        samples(pass, &mut self.last, last)?;
        if pass.loads() {
            // What the transform keeps of its past comes from the last block alone.
            self.overlap.fill(0.0);
            if last > 0 {
                self.filter();
            }
        }
        Ok(filtered.saturating_sub(delay))
    }
}

/// Describes `count` samples, which a filter keeps as the floats that they were.
#[expect(clippy::cast_possible_truncation, reason = "they came from f32")]
fn samples(pass: &mut StatePass, values: &mut [f64], count: usize) -> Result<(), StateError> {
    match pass.span(4 * count)? {
        Span::Size => {}
        Span::Check(bytes) => {
            // The transform panics where its sums are no numbers.
            let is_sample = |&bytes: &[u8; 4]| (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(&f32::from_le_bytes(bytes));
            if !bytes.as_chunks().0.iter().all(is_sample) {
                return Err(StateError::Field("samples to resample"));
            }
        }
        Span::Save(bytes) => {
            let slots = bytes.as_chunks_mut().0.iter_mut();
            slots.zip(values).for_each(|(slot, &mut value)| *slot = (value as f32).to_le_bytes());
        }
        Span::Load(bytes) => {
            let bytes = bytes.as_chunks().0.iter();
            values.iter_mut().zip(bytes).for_each(|(value, &bytes)| *value = f32::from_le_bytes(bytes).into());
        }
    }
    Ok(())
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}
