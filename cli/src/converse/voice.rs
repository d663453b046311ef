//! What a member of a conversation says.

use std::path::Path;

use umo_core::{AudioSource, Resampler, StepError, WordRules};
use umo_core_base::level::Meter;

use super::crosstalk;
use crate::failure::Failure;
use crate::speech::Speech;
use crate::words::Script;

/// The voice of a member.
pub(crate) enum Voice {
    /// A recording.
    Recording(Box<Speech>),
    /// A channel of one.
    Channel { rate: usize, samples: Vec<f32> },
}

impl Voice {
    /// The voices of a recording with a channel for each.
    pub(crate) fn channels(path: &Path, repair: bool) -> Result<Vec<Self>, Failure> {
        let speech = Speech::open(path, repair)?;
        let (rate, mut channels) = (speech.sample_rate(), speech.channels()?);
        crosstalk::attenuate(&mut channels, rate);
        let voice = |mut samples: Vec<f32>| {
            let mut meter = Meter::new(1, rate);
            meter.push(&samples);
            meter.gains(None).apply(&mut samples);
            Self::Channel { rate, samples }
        };
        Ok(channels.into_iter().map(voice).collect())
    }

    /// Sample rate.
    pub(crate) fn sample_rate(&self) -> usize {
        match self {
            Self::Recording(speech) => speech.sample_rate(),
            Self::Channel { rate, .. } => *rate,
        }
    }

    /// Length in seconds.
    pub(crate) fn seconds(&self) -> f64 {
        match self {
            Self::Recording(speech) => speech.seconds(),
            Self::Channel { rate, samples } => samples.len() as f64 / *rate as f64,
        }
    }

    /// Number of animation frames at `rate`.
    pub(super) fn frames(&self, rate: usize) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a length of a recording")]
        let frames = (self.seconds() * rate as f64 + 1e-6) as usize;
        frames
    }

    /// The words of a file; plain text is spread over the voice.
    pub(crate) fn script(&self, path: &Path, rules: &WordRules) -> Result<Script, Failure> {
        Script::read(path, rules, self.seconds(), |rate| self.mono(rate))
    }

    /// All samples at `rate`.
    pub(crate) fn mono(&self, rate: usize) -> Result<Vec<f32>, Failure> {
        let (mut source, mut all) = (self.source(rate)?, Vec::new());
        while source.pull(&mut all)? {}
        Ok(all)
    }

    fn source(&self, rate: usize) -> Result<Box<dyn AudioSource + '_>, Failure> {
        Ok(match self {
            Self::Recording(speech) => Box::new(speech.samples(rate)?),
            Self::Channel { rate: own, samples } => {
                Box::new(Channel { resampler: Resampler::new(*own, rate)?, blocks: samples.chunks(own.div_ceil(10)) })
            }
        })
    }

    /// The samples at `rate` in pieces of any length, with silence after them.
    pub(super) fn feed(&self, rate: usize) -> Result<Feed<'_>, Failure> {
        Ok(Feed { source: self.source(rate)?, samples: Vec::new(), taken: 0, is_over: false })
    }
}

/// A channel, resampled.
struct Channel<'a> {
    resampler: Resampler,
    blocks: std::slice::Chunks<'a, f32>,
}

impl AudioSource for Channel<'_> {
    fn pull(&mut self, samples: &mut Vec<f32>) -> Result<bool, StepError> {
        let block = self.blocks.next();
        match block {
            Some(block) => self.resampler.push(block, |piece| samples.extend_from_slice(piece)),
            None => self.resampler.finish(|piece| samples.extend_from_slice(piece)),
        }
        Ok(block.is_some())
    }
}

/// A voice as it goes on.
pub(super) struct Feed<'a> {
    source: Box<dyn AudioSource + 'a>,
    samples: Vec<f32>,
    taken: usize,
    is_over: bool,
}

impl Feed<'_> {
    /// The next samples.
    pub(super) fn take(&mut self, count: usize) -> Result<&[f32], Failure> {
        self.samples.drain(..std::mem::take(&mut self.taken));
        while self.samples.len() < count && !self.is_over {
            self.is_over = !self.source.pull(&mut self.samples)?;
        }
        if self.samples.len() < count {
            self.samples.resize(count, 0.0);
        }
        self.taken = count;
        Ok(&self.samples[..count])
    }
}
