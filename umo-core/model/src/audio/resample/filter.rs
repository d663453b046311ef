//! The windowed-sinc filter that converts between two sample rates.

use std::f64::consts::PI;
use std::sync::Arc;
use umo_core_base::functions::Functions;

use umo_kernels::Isa;
use umo_kernels::filter::dot;

use umo_core_base::error::StepError;
use umo_core_base::memory::{self, Arena, Slice};
use umo_core_base::samples::MAX_AMPLITUDE;
use umo_core_base::state::{Span, StateError, StatePass};

/// Minimum half length of the filter, in samples of the lower of the two rates. This is its delay: 7 ms at 16
/// kHz. By Kaiser's formula, the response is then 110 dB down at half that rate, and is kept up to 0.93 of
/// it.
const HALF: usize = 112;
/// Shape of the Kaiser window with side lobes 110 dB down.
const BETA: f64 = 0.1102 * (ATTENUATION - 8.7);
const ATTENUATION: f64 = 110.0;

/// Half lengths are multiples of this, so that a filter fills registers of 16 values.
const HALF_STEP: usize = 8;

/// Maximum number of values in a table with one row per phase: 1 MiB.
const MAX_TABLE: usize = 1 << 18;
/// Phases per sample of the lower rate, if one row per phase would exceed the table. Linear interpolation
/// between them is 107 dB from the exact filter.
const PHASES: usize = 512;

/// Number of output samples passed on at a time.
const PIECE: usize = 256;

/// Filter values at every phase, shared by the filters between two rates.
///
/// Output sample `j` is at the input's time `j * rate_in / rate_out`; its phase is the fractional part. Row
/// `q` of `rows` holds the filter for phase `q / rows`. It covers the inputs from `half - 1` before the
/// sample at or before that time to `half` after it, and sums to 1.
#[derive(Debug)]
pub struct FilterPlan {
    rates: (usize, usize),
    isa: Isa,
    half: usize,
    rows: usize,
    /// `[rows, 2 * half]`, plus one row for phase 1 if phases fall between rows.
    table: Box<[f32]>,
}

/// Number of input samples that the filter covers on either side.
pub(super) fn half_length(rate_in: usize, rate_out: usize) -> usize {
    (HALF * rate_in.max(rate_out)).div_ceil(rate_out).next_multiple_of(HALF_STEP)
}

/// Both rates divided by their greatest common divisor.
fn reduced(rate_in: usize, rate_out: usize) -> (usize, usize) {
    let divisor = greatest_common_divisor(rate_in, rate_out);
    (rate_in / divisor, rate_out / divisor)
}

impl FilterPlan {
    /// Creates the plan for two different rates.
    ///
    /// # Errors
    /// Never fails; the version without the feature `resample` does.
    pub(crate) fn new(rate_in: usize, rate_out: usize) -> Result<Self, StepError> {
        let half = half_length(rate_in, rate_out);
        let (_, unit_out) = reduced(rate_in, rate_out);
        let (rows, more) = match unit_out * 2 * half <= MAX_TABLE {
            true => (unit_out, 0),
            false => ((PHASES * rate_out).div_ceil(rate_in.max(rate_out)), 1),
        };
        let mut table = memory::filled(0.0, (rows + more) * 2 * half);
        // Number of samples of the lower rate per input sample.
        let scale = rate_out.min(rate_in) as f64 / rate_in as f64;
        for (q, row) in table.chunks_exact_mut(2 * half).enumerate() {
            windowed_sinc(q as f64 / rows as f64, scale, row);
        }
        Ok(Self { rates: (rate_in, rate_out), isa: Isa::detect(), half, rows, table: table.into_boxed_slice() })
    }

    /// Rates in and out.
    pub fn rates(&self) -> (usize, usize) {
        self.rates
    }

    /// Whether every phase that occurs has its own row.
    fn is_exact(&self) -> bool {
        self.table.len() == self.rows * 2 * self.half
    }

    /// Dot product of row `q` and the samples.
    fn dot(&self, q: usize, samples: &[f32]) -> f32 {
        let row = &self.table[q * 2 * self.half..][..2 * self.half];
        dot(self.isa, row, samples).expect("as many samples as taps")
    }

    /// Computes the output at `phase / unit_out` after the middle sample of `samples`.
    #[expect(clippy::cast_precision_loss, reason = "phases have 20 bits, their fractions need fewer")]
    fn output(&self, samples: &[f32], phase: usize, unit_out: usize) -> f32 {
        if self.is_exact() {
            return self.dot(phase, samples);
        }
        let (q, rest) = (phase * self.rows / unit_out, phase * self.rows % unit_out);
        let (before, after) = (self.dot(q, samples), self.dot(q + 1, samples));
        before + rest as f32 / unit_out as f32 * (after - before)
    }
}

/// Writes one row: a sinc under a Kaiser window, normalised to sum 1, at `phase` of a sample after its
/// middle. `scale` is the number of samples of the lower rate per input sample.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
fn windowed_sinc(phase: f64, scale: f64, row: &mut [f32]) {
    let half = row.len() / 2;
    let width = half as f64 * scale;
    // Kaiser's formula for the width of the transition, in cycles per sample of the lower rate.
    let transition = (ATTENUATION - 7.95) / (14.36 * 2.0 * width);
    let cutoff = 1.0 - transition;
    let value = |i: usize| {
        let x = (i as f64 + 1.0 - half as f64 - phase) * scale;
        let (edge, turn) = (x / width, PI * cutoff * x);
        let sinc = if turn == 0.0 { 1.0 } else { turn.sine() / turn };
        bessel_i0(BETA * (1.0 - edge * edge).max(0.0).sqrt()) * sinc
    };
    let sum: f64 = (0..row.len()).map(value).sum();
    row.iter_mut().enumerate().for_each(|(i, slot)| *slot = (value(i) / sum) as f32);
}

/// The modified Bessel function of the first kind and order 0, by its power series.
fn bessel_i0(x: f64) -> f64 {
    let quarter = x * x / 4.0;
    let (mut term, mut sum, mut k) = (1.0, 1.0, 1.0);
    while term > f64::EPSILON * sum {
        term *= quarter / (k * k);
        sum += term;
        k += 1.0;
    }
    sum
}

/// Filter state of one stream.
#[derive(Debug)]
pub(super) struct Filter {
    plan: Arc<FilterPlan>,
    /// Rates in and out, divided by their greatest common divisor.
    units: (usize, usize),
    /// The newest samples, with silence before the stream's start: `[4 * half]`; the first `filled` are
    /// valid.
    samples: Slice<f32>,
    filled: usize,
    /// Index in `samples` of the first input of the next output.
    next: usize,
    /// Phase of the next output, in units of one over the second of `units`.
    phase: usize,
}

impl Filter {
    /// Creates a filter at the start of a stream, in memory of `arena`.
    pub(super) fn new_in(plan: Arc<FilterPlan>, arena: &Arena) -> Self {
        let (rate_in, rate_out) = plan.rates;
        let samples = arena.filled(0.0, 4 * plan.half);
        Self { units: reduced(rate_in, rate_out), samples, filled: plan.half - 1, next: 0, phase: 0, plan }
    }

    /// Number of outputs that can be computed from `taken` input samples.
    fn outputs(&self, taken: u64) -> u64 {
        let (unit_in, unit_out) = (self.units.0 as u128, self.units.1 as u128);
        let behind = u128::from(taken).saturating_sub(self.plan.half as u128);
        u64::try_from((behind * unit_out).div_ceil(unit_in)).expect("at most 768 times what was taken")
    }

    /// Upper bound on the outputs that the next `count` samples allow.
    pub(super) fn most_given(&self, count: usize) -> usize {
        let missing = (self.next + 2 * self.plan.half).saturating_sub(self.filled);
        match count.checked_sub(missing) {
            None => 0,
            Some(beyond) => {
                let (unit_in, unit_out) = self.units;
                1 + (beyond * unit_out + (unit_out - 1 - self.phase)) / unit_in
            }
        }
    }

    /// Upper bound on the outputs that silence after the stream allows.
    pub(super) fn most_left(&self) -> usize {
        let (unit_in, unit_out) = self.units;
        (self.plan.half * unit_out).div_ceil(unit_in) + 1
    }

    pub(super) fn push(&mut self, mut samples: &[f32], mut out: impl FnMut(&[f32])) {
        while !samples.is_empty() {
            if self.filled == self.samples.len() {
                self.samples.copy_within(self.next.., 0);
                self.filled -= self.next;
                self.next = 0;
            }
            let room = &mut self.samples[self.filled..];
            let (head, tail) = samples.split_at(samples.len().min(room.len()));
            room[..head.len()].copy_from_slice(head);
            self.filled += head.len();
            samples = tail;
            self.give(&mut out);
        }
    }

    /// Outputs all samples that can be computed from the inputs.
    fn give(&mut self, out: &mut impl FnMut(&[f32])) {
        let ((unit_in, unit_out), length) = (self.units, 2 * self.plan.half);
        let mut piece = [0.0; PIECE];
        let mut count = 0;
        while self.next + length <= self.filled {
            piece[count] = self.plan.output(&self.samples[self.next..][..length], self.phase, unit_out);
            count += 1;
            if count == PIECE {
                out(&piece);
                count = 0;
            }
            self.phase += unit_in;
            self.next += self.phase / unit_out;
            self.phase %= unit_out;
        }
        if count > 0 {
            out(&piece[..count]);
        }
    }

    /// Pushes a piece of silence, to output the remaining samples.
    pub(super) fn silence(&mut self, out: impl FnMut(&[f32])) {
        const SILENCE: [f32; PIECE] = [0.0; PIECE];
        self.push(&SILENCE[..PIECE.min(self.plan.half)], out);
    }

    pub(super) fn reset(&mut self) {
        self.filled = self.plan.half - 1;
        self.samples[..self.filled].fill(0.0);
        (self.next, self.phase) = (0, 0);
    }

    /// Describes the filter after `taken` samples. Returns the number of samples that it has output.
    pub(super) fn state(&mut self, pass: &mut StatePass, taken: u64) -> Result<u64, StateError> {
        let half = self.plan.half;
        let given = self.outputs(taken);
        let place = u128::from(given) * self.units.0 as u128;
        let (middle, phase) = (place / self.units.1 as u128, place % self.units.1 as u128);
        let kept = match pass.follows(false) {
            true => 2 * half - 1,
            false => (u128::from(taken) + half as u128 - 1 - middle) as usize,
        };
        if pass.loads() {
            (self.next, self.filled, self.phase) = (0, kept, phase as usize);
        }
        // When samples are loaded, checked or only counted, their position does not matter.
        let first = self.filled.saturating_sub(kept);
        samples(pass, &mut self.samples[first..][..kept])?;
        Ok(given)
    }
}

/// Describes samples to resample.
fn samples(pass: &mut StatePass, values: &mut [f32]) -> Result<(), StateError> {
    match pass.span(4 * values.len())? {
        Span::Size => {}
        Span::Check(bytes) => {
            let is_sample = |&bytes: &[u8; 4]| (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(&f32::from_le_bytes(bytes));
            if !bytes.as_chunks().0.iter().all(is_sample) {
                return Err(StateError::Field("samples to resample"));
            }
        }
        Span::Save(bytes) => {
            let slots = bytes.as_chunks_mut().0.iter_mut();
            slots.zip(values).for_each(|(slot, value)| *slot = value.to_le_bytes());
        }
        Span::Load(bytes) => {
            let bytes = bytes.as_chunks().0.iter();
            values.iter_mut().zip(bytes).for_each(|(value, &bytes)| *value = f32::from_le_bytes(bytes));
        }
    }
    Ok(())
}

fn greatest_common_divisor(a: usize, b: usize) -> usize {
    if b == 0 { a } else { greatest_common_divisor(b, a % b) }
}
