//! One avatar computed where and when the caller wants it: recordings, tests. The stream of a game is an
//! [`Engine`](crate::engine::Engine).

use crate::audio::silence_unusable;
use crate::avatar::{Avatar, AvatarConfig, Due, StageTimes};
use crate::batch::{Batch, FrameSink, Member};
use crate::config::Config;
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::model::Model;
use crate::motion::FrameRef;
use crate::record::Chunk;

/// One avatar, its audio, and room to compute its chunks.
#[derive(Debug)]
pub struct Animation {
    avatar: Avatar,
    batch: Batch,
    /// Samples that came and were not yet used by a chunk.
    pending: Vec<f32>,
    /// Samples that came in all.
    samples: usize,
}

impl Animation {
    /// An animation at its start.
    ///
    /// # Errors
    /// As [`Avatar::new`].
    pub fn new(model: &Model, config: &AvatarConfig) -> Result<Self, LoadError> {
        let avatar = Avatar::new(model, config)?;
        Ok(Self { avatar, batch: Batch::new(model, 1), pending: Vec::new(), samples: 0 })
    }

    /// The avatar.
    pub fn avatar(&self) -> &Avatar {
        &self.avatar
    }

    /// The avatar, to be set up.
    pub fn avatar_mut(&mut self) -> &mut Avatar {
        &mut self.avatar
    }

    /// Keeps from now on what each chunk was made of, for [`Self::chunk`]. Nothing else changes.
    pub fn keep_record(&mut self, config: &Config) {
        self.batch.keep_record(config);
    }

    /// What the chunk of the last [`Self::step`] was made of; none where the step had no chunk, or nothing is kept.
    pub fn chunk(&self) -> Option<Chunk<'_>> {
        self.batch.chunk()
    }

    /// Takes samples at the model's rate, mono, and says how many were no usable number and became silence
    /// ([`silence_unusable`]).
    ///
    /// # Errors
    /// [`StepError::Order`] after [`Self::finish`].
    pub fn push_audio(&mut self, samples: &[f32]) -> Result<usize, StepError> {
        if self.avatar.total.is_some() {
            return Err(StepError::Order("audio was pushed after the end"));
        }
        let start = self.pending.len();
        self.pending.extend_from_slice(samples);
        self.samples += samples.len();
        Ok(silence_unusable(&mut self.pending[start..]))
    }

    /// No more audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.avatar.finish(frames);
    }

    /// Frames of the audio pushed so far.
    pub fn frames_of_audio(&self, config: &Config) -> usize {
        self.samples * config.frame_rate / config.audio.sample_rate
    }

    /// Time spent in each stage so far.
    pub fn stage_times(&self) -> StageTimes {
        self.batch.stage_times()
    }

    /// Computes the next chunk if its audio is there, and gives every frame that became final to `frame`, in order.
    /// Returns whether there was one, or frames that were held back at the end. A stream without audio has chunks only
    /// once its end is known.
    ///
    /// # Errors
    /// [`StepError`], after which the animation wants a new start.
    pub fn step(&mut self, model: &Model, cx: Compute, mut frame: &mut dyn FnMut(FrameRef)) -> Result<bool, StepError> {
        let Self { avatar, batch, pending, .. } = self;
        let due = avatar.due(&model.config, pending.len());
        let endless = avatar.total.is_none() && !avatar.has_audio();
        if endless || !matches!(due, Due::Chunk | Due::Rest) {
            return Ok(false);
        }
        batch.begin([due].into_iter())?;
        let mut members = [Alone { avatar, pending, frame: &mut frame }];
        loop {
            match batch.step(model, cx, &mut members) {
                Ok(true) => {}
                Ok(false) => return Ok(true),
                Err(error) => {
                    batch.abandon();
                    return Err(error);
                }
            }
        }
    }
}

/// The only member of its batch.
struct Alone<'a, 'f> {
    avatar: &'a mut Avatar,
    pending: &'a mut Vec<f32>,
    frame: &'a mut &'f mut dyn FnMut(FrameRef),
}

impl Member for Alone<'_, '_> {
    fn avatar(&mut self) -> &mut Avatar {
        self.avatar
    }

    fn listen(&mut self, samples: &mut [f32]) {
        let count = samples.len().min(self.pending.len());
        samples[..count].copy_from_slice(&self.pending[..count]);
        samples[count..].fill(0.0);
        self.pending.drain(..count);
    }

    fn frames(&mut self) -> (&mut Avatar, &mut dyn FrameSink) {
        (self.avatar, self.frame)
    }
}
