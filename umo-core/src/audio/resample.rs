//! Any sample rate to the model's, any number of channels to one.

use rubato::audioadapter_buffers::direct::SequentialSlice;
use rubato::{Fft, FixedSync, Resampler as _, WindowFunction};

use super::LOUDEST;
use crate::error::StepError;
use crate::memory::{self, filled, with_capacity};
use crate::state::{Span, StateError, StatePass};

/// Lowest sample rate that is taken, per second.
pub const MIN_RATE: usize = 1_000;
/// Highest sample rate that is taken, per second.
pub const MAX_RATE: usize = 768_000;

/// Least length of the filter, in samples of the lower of the two rates. At 480, measured: the band up to 0.93 of half
/// that rate is kept within 1e-7, all above the half is below -140 dB, and the filter waits for 240 samples, 15 ms at
/// 16 kHz. Rates with a small common divisor need longer blocks: at worst (coprime) the filter waits for a second.
const FILTER: usize = 480;

/// Samples that are given at a time.
const PIECE: usize = 256;

/// A stream of samples at one rate to another, mono.
///
/// The filter's delay is taken off, so that output sample `i` is at the time of input sample `i * rate_in / rate_out`.
/// Blocks of the Fourier filter are counted from the stream's start: how samples are cut into pushes changes nothing.
#[derive(Debug)]
pub struct Resampler {
    rate_in: usize,
    rate_out: usize,
    /// None where the rates are equal.
    filter: Option<Filter>,
    /// Samples taken so far.
    taken: usize,
    /// Samples given out so far.
    given: usize,
}

#[derive(Debug)]
struct Filter {
    fft: Fft<f64>,
    /// Samples that fill no block yet, `[block in]` at most.
    waiting: Vec<f64>,
    /// The block that was filtered last, which what overlaps the next one comes from; nothing at the start.
    last: Vec<f64>,
    /// One block of output.
    block: Box<[f64]>,
    /// Samples of the filter's delay that are still to be dropped.
    delay: usize,
}

impl Resampler {
    /// From `rate_in` to `rate_out` samples per second, each [`MIN_RATE`] to [`MAX_RATE`].
    ///
    /// # Errors
    /// [`StepError::OutOfRange`] for any other rate.
    pub fn new(rate_in: usize, rate_out: usize) -> Result<Self, StepError> {
        for got in [rate_in, rate_out] {
            if !(MIN_RATE..=MAX_RATE).contains(&got) {
                return Err(StepError::OutOfRange { what: "sample rate", got, limit: MAX_RATE + 1 });
            }
        }
        let filter = (rate_in != rate_out).then(|| Filter::new(rate_in, rate_out));
        Ok(Self { rate_in, rate_out, filter, taken: 0, given: 0 })
    }

    /// Takes samples and gives to `out` what can be computed of them, in pieces. Never allocates.
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

    /// Gives the rest, as if silence followed, and starts anew. Never allocates.
    ///
    /// Of `n` samples taken since the start, `round(n * rate_out / rate_in)` are then given in all.
    pub fn finish(&mut self, mut out: impl FnMut(&[f32])) {
        if let Some(filter) = &mut self.filter {
            // The delay keeps what is given behind what was taken, so the last block is the only one to run ahead.
            let mut missing = rounded(self.taken, self.rate_out, self.rate_in) - self.given;
            while missing > 0 {
                filter.block(|piece| {
                    let piece = &piece[..piece.len().min(missing)];
                    missing -= piece.len();
                    out(piece);
                });
            }
        }
        self.reset();
    }

    /// Forgets what came so far.
    pub fn reset(&mut self) {
        (self.taken, self.given) = (0, 0);
        if let Some(filter) = &mut self.filter {
            filter.reset();
        }
    }

    /// Describes the stream after `taken` samples, which its owner counts too; samples that [`Self::finish`] would give. All
    /// else follows from the samples.
    #[expect(clippy::cast_possible_truncation, reason = "no more samples than were taken at a time")]
    pub(crate) fn state(&mut self, pass: &mut StatePass, taken: u64) -> Result<usize, StateError> {
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

    /// Most samples that the next `count` samples make it give.
    pub fn most_given(&self, count: usize) -> usize {
        match &self.filter {
            None => count,
            Some(filter) => (filter.waiting.len() + count) / filter.fft.fft_size_in() * filter.fft.fft_size_out(),
        }
    }

    /// Most samples, at the rate of the input, by which the filter delays the sample that ends a chunk of `chunk` samples of
    /// output.
    pub fn most_delay(&self, chunk: usize) -> usize {
        let Some(filter) = &self.filter else { return 0 };
        let (block_in, block_out, delay) =
            (filter.fft.fft_size_in(), filter.fft.fft_size_out(), filter.fft.output_delay());
        // Chunks end at every place in a block that comes round.
        let late = |n: usize| (n * chunk + delay).next_multiple_of(block_out) - n * chunk;
        let most = (1..=block_out).map(late).max().unwrap_or(0);
        (most * block_in).div_ceil(block_out)
    }

    /// Most samples that [`Self::finish`] gives, whatever came before.
    pub fn most_left(&self) -> usize {
        self.filter.as_ref().map_or(0, |filter| 2 * filter.fft.fft_size_out())
    }
}

/// A whole recording at another rate, `round(n * rate_out / rate_in)` samples.
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

impl Filter {
    fn new(rate_in: usize, rate_out: usize) -> Self {
        let divisor = greatest_common_divisor(rate_in, rate_out);
        let (unit_in, unit_out) = (rate_in / divisor, rate_out / divisor);
        // An even number of units: half a block, the delay, is then a whole number of samples at both rates.
        let blocks = FILTER.div_ceil(unit_in.min(unit_out)).next_multiple_of(2);
        // The plan of the transforms is another crate's: both blocks, in and out, and their twiddle factors, as complex numbers
        // of 16 bytes, a few times each.
        memory::require(256 * blocks * (unit_in + unit_out));
        let window = WindowFunction::BlackmanHarris2;
        let fft = Fft::new_custom(rate_in, rate_out, blocks * unit_in, 1, 1, window, FixedSync::Both)
            .expect("rates and block are above zero");
        let room = || with_capacity(fft.fft_size_in());
        let (waiting, last, block) = (room(), room(), filled(0.0, fft.fft_size_out()).into());
        Self { delay: fft.output_delay(), fft, waiting, last, block }
    }

    fn push(&mut self, mut samples: &[f32], mut out: impl FnMut(&[f32])) {
        let size = self.fft.fft_size_in();
        while !samples.is_empty() {
            let (head, tail) = samples.split_at(samples.len().min(size - self.waiting.len()));
            self.waiting.extend(head.iter().map(|&v| f64::from(v)));
            samples = tail;
            if self.waiting.len() == size {
                self.block(&mut out);
            }
        }
    }

    fn reset(&mut self) {
        self.fft.reset();
        self.waiting.clear();
        self.last.clear();
        self.delay = self.fft.output_delay();
    }

    /// Filters what waits, padded with zeros to a block.
    #[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
    fn block(&mut self, mut out: impl FnMut(&[f32])) {
        std::mem::swap(&mut self.waiting, &mut self.last);
        self.waiting.clear();
        self.last.resize(self.fft.fft_size_in(), 0.0);
        self.filter();
        let size = self.block.len();
        let late = self.delay.min(size);
        self.delay -= late;
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
        let (taken, size) = (self.last.len(), self.block.len());
        let input = SequentialSlice::new(&self.last[..], 1, taken).expect("one channel");
        let mut output = SequentialSlice::new_mut(&mut self.block[..], 1, size).expect("one channel");
        self.fft.process_into_buffer(&input, &mut output, None).expect("both buffers are one block");
    }

    /// Describes the filter after so many samples; samples that it gave.
    #[expect(clippy::cast_possible_truncation, reason = "less than a block, and what was given of samples in memory")]
    fn state(&mut self, pass: &mut StatePass, taken: u64) -> Result<u64, StateError> {
        let (size_in, size_out) = (self.fft.fft_size_in() as u64, self.fft.fft_size_out() as u64);
        let delay = self.fft.output_delay() as u64;
        let filtered = taken / size_in * size_out;
        let waiting = if pass.follows(false) { size_in } else { taken % size_in } as usize;
        let last = if pass.follows(filtered > 0) { size_in } else { 0 } as usize;
        if pass.loads() {
            self.waiting.resize(waiting, 0.0);
            self.last.resize(last, 0.0);
            self.delay = delay.saturating_sub(filtered) as usize;
        }
        // A pass that only measures counts a whole block of samples that wait, which there never are.
        samples(pass, &mut self.waiting, waiting)?;
        samples(pass, &mut self.last, last)?;
        if pass.loads() {
            // What the transform keeps of its past comes from the last block alone.
            self.fft.reset();
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
            let is_sample = |&bytes: &[u8; 4]| (-LOUDEST..=LOUDEST).contains(&f32::from_le_bytes(bytes));
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

/// `round(n * up / down)`, halves up, with no overflow for any clip that fits in memory.
fn rounded(n: usize, up: usize, down: usize) -> usize {
    let (n, up, down) = (n as u128, up as u128, down as u128);
    usize::try_from((2 * n * up + down) / (2 * down)).expect("at most 768 times what memory holds")
}

/// Writes the mean of each frame's channels, in f64, so that channels near the largest f32 still have a finite sum. An
/// incomplete last frame is left out.
///
/// # Panics
/// Where `channels` is 0, or `mono` is shorter than there are frames.
#[expect(clippy::cast_possible_truncation, reason = "rounded to the precision of samples")]
pub fn mix(interleaved: &[f32], channels: usize, mono: &mut [f32]) {
    assert!(channels > 0, "a frame has at least one channel");
    let frames = interleaved.chunks_exact(channels);
    assert!(mono.len() >= frames.len(), "a sample for every frame");
    for (slot, frame) in mono.iter_mut().zip(frames) {
        *slot = (frame.iter().map(|&v| f64::from(v)).sum::<f64>() / channels as f64) as f32;
    }
}
