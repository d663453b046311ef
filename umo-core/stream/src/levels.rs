//! Sound level of each frame.

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::avatar::Avatar;
use umo_core_model::config::Config;
use umo_core_model::motion::FrameRef;
use umo_core_pose::pose::FIRST_CONTACT;

use umo_core_pose::frame::Cue;

/// Returns the cue of a frame with the level of its sound.
pub(crate) fn cue(frame: &FrameRef, level: f32) -> Cue {
    let contacts = frame.channels.lower.get(FIRST_CONTACT..FIRST_CONTACT + 4);
    Cue { level, contacts: std::array::from_fn(|i| contacts.map_or(0.0, |values| values[i].clamp(0.0, 1.0))) }
}

/// Levels of the newest frames of a stream, computed from the samples of its chunks.
#[derive(Debug)]
pub(crate) struct Levels {
    /// Root mean square of frame `index` at `index % len`, full scale 1.
    frames: Slice<f32>,
    /// Samples heard so far.
    heard: u64,
    /// Sum of squares of the incomplete frame.
    sum: f64,
    sample_rate: u64,
    frame_rate: u64,
}

impl Levels {
    /// Creates the levels of an avatar at the start of its stream, in memory of `arena`.
    pub(crate) fn new_in(avatar: &Avatar, config: &Config, arena: &Arena) -> Self {
        // The frames of a chunk, the frames held back before it, and the horizon.
        let frames = 2 * avatar.chunk_frames(config) + 2 * config.keyframe_stride + avatar.horizon_frames(config);
        Self {
            frames: arena.filled(0.0, frames),
            heard: 0,
            sum: 0.0,
            sample_rate: config.audio.sample_rate as u64,
            frame_rate: config.frame_rate as u64,
        }
    }

    /// Returns to the start of a stream.
    pub(crate) fn reset(&mut self) {
        self.frames.fill(0.0);
        (self.heard, self.sum) = (0, 0.0);
    }

    /// Adds a chunk's samples.
    pub(crate) fn push(&mut self, samples: &[f32]) {
        for &sample in samples {
            self.sum += f64::from(sample) * f64::from(sample);
            let frame = self.heard * self.frame_rate / self.sample_rate;
            self.heard += 1;
            if self.heard * self.frame_rate / self.sample_rate > frame {
                self.end(frame);
            }
        }
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_precision_loss, reason = "a level's precision is enough")]
    fn end(&mut self, frame: u64) {
        let count = self.sample_rate as f64 / self.frame_rate as f64;
        let place = (frame % self.frames.len() as u64) as usize;
        self.frames[place] = (self.sum / count).sqrt() as f32;
        self.sum = 0.0;
    }

    /// Returns the root mean square level of `count` frames from `first` on.
    pub(crate) fn mean(&self, first: u64, count: usize) -> f32 {
        let heard = self.heard * self.frame_rate / self.sample_rate;
        #[expect(clippy::cast_possible_truncation, reason = "below the length")]
        let place = |frame: u64| (frame % self.frames.len() as u64) as usize;
        let squares = (first..heard.min(first + count as u64)).map(|frame| self.frames[place(frame)].powi(2));
        (squares.sum::<f32>() / count.max(1) as f32).sqrt()
    }

    /// Returns the cue of a frame.
    pub(crate) fn cue(&self, frame: &FrameRef) -> Cue {
        let index = frame.index as u64;
        #[expect(clippy::cast_possible_truncation, reason = "below the length")]
        let place = (index % self.frames.len() as u64) as usize;
        let is_heard = index < self.heard * self.frame_rate / self.sample_rate;
        cue(frame, if is_heard { self.frames[place] } else { 0.0 })
    }

    /// Saves or loads the levels.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("samples heard", &mut self.heard, 1 << 60)?;
        pass.sum(&mut self.sum)?;
        pass.f32s(&mut self.frames)
    }
}
