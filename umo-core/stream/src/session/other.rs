//! The interlocutor's audio, of which only the loudness is used.

use umo_core_base::samples::MAX_AMPLITUDE;
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::config::Config;

use super::{SessionError, Shared};

/// Loudness of the interlocutor's audio, measured per frame.
#[derive(Debug)]
pub(crate) struct OtherInput {
    /// Sum of squares of the incomplete frame, and the number of its values.
    sum: f64,
    count: usize,
    /// Values per frame, all channels together.
    frame: usize,
    channels: usize,
}

impl OtherInput {
    pub(crate) fn new(sample_rate: usize, channels: usize, config: &Config) -> Self {
        Self { sum: 0.0, count: 0, frame: (sample_rate * channels / config.frame_rate).max(1), channels }
    }

    /// Describes the incomplete frame.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.sum(&mut self.sum)?;
        pass.length("other's audio", &mut self.count, self.frame as u64 - 1).map(drop)
    }

    /// Takes interleaved samples; NaN and infinite ones count as silence.
    pub(super) fn push(&mut self, shared: &Shared, samples: &[f32]) -> Result<(), SessionError> {
        if !samples.len().is_multiple_of(self.channels) {
            return Err(SessionError::Uneven { got: samples.len(), channels: self.channels });
        }
        for &sample in samples {
            let value = if (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(&sample) { f64::from(sample) } else { 0.0 };
            self.sum += value * value;
            self.count += 1;
            if self.count == self.frame {
                #[expect(clippy::cast_possible_truncation, reason = "a level's precision is enough")]
                let level = (self.sum / self.frame as f64).sqrt() as f32;
                shared.host.set_other_level(level);
                (self.sum, self.count) = (0.0, 0);
            }
        }
        Ok(())
    }
}
