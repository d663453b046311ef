//! Conversion of any sample rate to the model's, and of any number of channels to one.

#[cfg(feature = "resample")]
mod filter;
#[cfg(not(feature = "resample"))]
#[path = "resample/no_filter.rs"]
mod filter;

use std::sync::Arc;

use filter::Filter;
pub use filter::FilterPlan;
use umo_core_base::error::StepError;
use umo_core_base::memory::Arena;
use umo_core_base::state::{StateError, StatePass};

/// Lowest accepted sample rate, per second.
pub const MIN_RATE: usize = 1_000;
/// Highest accepted sample rate, per second.
pub const MAX_RATE: usize = 768_000;

/// Streaming conversion of mono samples from one rate to another.
///
/// The filter's delay is compensated, so output sample `i` is at the time of input sample
/// `i * rate_in / rate_out`. Each output is a sum over the same inputs in the same order, regardless of how
/// samples are split into pushes.
#[derive(Debug)]
pub struct Resampler {
    rate_in: usize,
    rate_out: usize,
    /// `None` if the rates are equal.
    filter: Option<Filter>,
    /// Number of input samples so far.
    taken: usize,
    /// Number of output samples so far.
    given: usize,
}

impl Resampler {
    /// Creates a resampler from `rate_in` to `rate_out` samples per second, each 1,000 to 768,000.
    ///
    /// # Errors
    /// [`StepError::OutOfRange`] for any other rate; [`StepError::Disagree`] for different rates if this
    /// library was built without the feature `resample`.
    pub fn new(rate_in: usize, rate_out: usize) -> Result<Self, StepError> {
        Ok(Self::new_in(rate_in, rate_out, plan(rate_in, rate_out)?, &Arena::system()))
    }

    /// Like [`Self::new`], in memory of `arena`, with the [`plan`] of these rates.
    #[doc(hidden)]
    pub fn new_in(rate_in: usize, rate_out: usize, plan: Option<Arc<FilterPlan>>, arena: &Arena) -> Self {
        let filter = plan.map(|plan| Filter::new_in(plan, arena));
        Self { rate_in, rate_out, filter, taken: 0, given: 0 }
    }

    /// Takes samples and passes the outputs that can be computed to `out`, in pieces. Never allocates.
    pub fn push(&mut self, samples: &[f32], mut out: impl FnMut(&[f32])) {
        self.taken += samples.len();
        let given = &mut self.given;
        let mut count = |piece: &[f32]| {
            *given += piece.len();
            out(piece);
        };
        match &mut self.filter {
            None => count(samples),
            Some(filter) => filter.push(samples, count),
        }
    }

    /// Flushes the filter as if silence followed, and resets it. Never allocates.
    ///
    /// After `n` input samples since the start, the total output is then `round(n * rate_out / rate_in)`
    /// samples.
    pub fn finish(&mut self, mut out: impl FnMut(&[f32])) {
        if let Some(filter) = &mut self.filter {
            let mut missing = rounded(self.taken, self.rate_out, self.rate_in) - self.given;
            while missing > 0 {
                filter.silence(|piece| {
                    let piece = &piece[..piece.len().min(missing)];
                    missing -= piece.len();
                    out(piece);
                });
            }
        }
        self.reset();
    }

    /// Resets the resampler to the start of a stream.
    pub fn reset(&mut self) {
        (self.taken, self.given) = (0, 0);
        if let Some(filter) = &mut self.filter {
            filter.reset();
        }
    }

    /// Describes the stream after `taken` samples, a count that its owner also stores. Returns the number of
    /// samples that [`Self::finish`] would output. The other counts follow from `taken`.
    #[expect(clippy::cast_possible_truncation, reason = "no more samples than were taken at a time")]
    #[doc(hidden)]
    pub fn state(&mut self, pass: &mut StatePass, taken: u64) -> Result<usize, StateError> {
        let (given, all) = match &mut self.filter {
            None => (taken, taken),
            Some(filter) => {
                let all = rounded(taken as usize, self.rate_out, self.rate_in) as u64;
                (filter.state(pass, taken)?, all)
            }
        };
        if pass.loads() {
            (self.taken, self.given) = (taken as usize, given as usize);
        }
        Ok((all - given) as usize)
    }

    /// Upper bound on the outputs of the next `count` samples.
    pub fn most_given(&self, count: usize) -> usize {
        self.filter.as_ref().map_or(count, |filter| filter.most_given(count))
    }

    /// Upper bound on the filter's delay of an output sample, in input samples.
    pub fn most_delay(&self) -> usize {
        most_delay(self.rate_in, self.rate_out)
    }

    /// Upper bound on the outputs of [`Self::finish`].
    pub fn most_left(&self) -> usize {
        self.filter.as_ref().map_or(0, Filter::most_left)
    }
}

/// Checks that both rates are 1,000 to 768,000, and that they are equal if this library was built without the
/// feature `resample`.
pub fn check_rates(rate_in: usize, rate_out: usize) -> Result<(), StepError> {
    for got in [rate_in, rate_out] {
        if !(MIN_RATE..=MAX_RATE).contains(&got) {
            return Err(StepError::OutOfRange { what: "sample rate", got, limit: MAX_RATE + 1 });
        }
    }
    if cfg!(feature = "resample") || rate_in == rate_out {
        Ok(())
    } else {
        FilterPlan::new(rate_in, rate_out).map(drop)
    }
}

/// Shared plan of the resamplers between two rates; `None` if the rates are equal.
///
/// # Errors
/// As [`Resampler::new`].
pub fn plan(rate_in: usize, rate_out: usize) -> Result<Option<Arc<FilterPlan>>, StepError> {
    check_rates(rate_in, rate_out)?;
    if rate_in == rate_out { Ok(None) } else { Ok(Some(Arc::new(FilterPlan::new(rate_in, rate_out)?))) }
}

/// [`Resampler::most_delay`] between two rates.
pub fn most_delay(rate_in: usize, rate_out: usize) -> usize {
    // From the end of an output sample, `rate_in / rate_out` after its start, to the end of the last input
    // that it needs.
    if rate_in == rate_out { 0 } else { filter::half_length(rate_in, rate_out) + 1 - rate_in / rate_out }
}

/// Converts a whole recording to another rate: `round(n * rate_out / rate_in)` samples.
///
/// # Errors
/// [`StepError::OutOfRange`] for rates outside [`MIN_RATE`] to [`MAX_RATE`].
pub fn to_rate(samples: &[f32], rate_in: usize, rate_out: usize) -> Result<Vec<f32>, StepError> {
    let mut resampler = Resampler::new(rate_in, rate_out)?;
    let mut out = Vec::with_capacity(rounded(samples.len(), rate_out, rate_in));
    resampler.push(samples, |piece| out.extend_from_slice(piece));
    resampler.finish(|piece| out.extend_from_slice(piece));
    Ok(out)
}

/// `round(n * up / down)`, halves up, without overflow for any clip that fits in memory.
fn rounded(n: usize, up: usize, down: usize) -> usize {
    let (n, up, down) = (n as u128, up as u128, down as u128);
    usize::try_from((2 * n * up + down) / (2 * down)).expect("at most 768 times what memory holds")
}
