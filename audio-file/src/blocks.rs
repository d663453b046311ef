//! A decoder of one format, and the rate and channels of its samples.

use crate::error::{AudioError, Note};
use crate::{MAX_CHANNELS, SAMPLE_RATES};

/// Rate and channels of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spec {
    pub(crate) sample_rate: u32,
    pub(crate) channels: u16,
    /// Index of the centre channel, for three channels or more.
    pub(crate) centre: Option<usize>,
}

impl Spec {
    /// # Errors
    /// [`AudioError`] for an unsupported sample rate or number of channels.
    pub(crate) fn new(sample_rate: u32, channels: usize, centre: Option<usize>) -> Result<Self, AudioError> {
        let channels = u16::try_from(channels).unwrap_or(u16::MAX);
        if !(1..=MAX_CHANNELS).contains(&channels) {
            return Err(AudioError::Channels(channels));
        }
        if !SAMPLE_RATES.contains(&sample_rate) {
            return Err(AudioError::SampleRate(sample_rate));
        }
        Ok(Self { sample_rate, channels, centre: centre.filter(|_| channels > 2) })
    }

    pub(crate) fn width(self) -> usize {
        self.channels.into()
    }
}

/// A decoder of one format.
pub(crate) trait Blocks: Send {
    /// Writes the next interleaved samples into `block`, which is empty. Returns rate and channels, which are
    /// constant over the recording, or `None` at the end.
    fn next(&mut self, block: &mut Vec<f32>) -> Result<Option<Spec>, AudioError>;

    /// Problems found so far; complete after the end.
    fn notes(&self) -> Vec<Note>;
}
