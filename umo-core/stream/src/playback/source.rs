//! Frames of the present epoch: out of the ring, or under the live mouth, placed where the avatar
//! stands.

use std::sync::atomic::{AtomicU64, Ordering};

use umo_core_base::error::StepError;
use umo_core_base::memory::Boxed;
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::{MAX_INDEX, OwnedFrame};

use crate::link::{Epoch, Link};

use super::Start;
use super::voice::LiveVoice;

/// Where a session's frames come from.
#[derive(Debug)]
pub(crate) struct Source {
    epoch: Epoch,
    voice: Option<Boxed<LiveVoice>>,
    /// Index of the present stream's first frame.
    base: u64,
    /// Origin of the present stream, metres: x and z.
    origin: [f32; 2],
    /// Upper bound on the frames of a chunk.
    chunk_frames: usize,
    /// Sample frames and frames a second.
    rates: (u64, u64),
}

impl Source {
    pub(crate) fn new(
        voice: Option<Boxed<LiveVoice>>,
        chunk_frames: usize,
        (sample_rate, frame_rate): (usize, usize),
    ) -> Self {
        let rates = (sample_rate as u64, frame_rate as u64);
        Self { epoch: Epoch::default(), voice, base: 0, origin: [0.0; 2], chunk_frames, rates }
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.epoch = start.epoch;
        self.base = start.base;
        let [x, _, z] = start.last.pose.translation;
        self.origin = if start.is_reset { [0.0; 2] } else { [x, z] };
        if let Some(voice) = &mut self.voice {
            voice.begin(start.rest);
        }
    }

    pub(crate) fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// Index of the present stream's first frame.
    pub(crate) fn base(&self) -> u64 {
        self.base
    }

    /// Whether the mouth is live.
    pub(crate) fn is_live(&self) -> bool {
        self.voice.is_some()
    }

    /// Whether frames have a mouth alone.
    pub(crate) fn is_mouth(&self) -> bool {
        self.voice.as_ref().is_some_and(|voice| voice.is_alone())
    }

    /// Number of frames after the end of the audio.
    pub(crate) fn tail(&self) -> u64 {
        self.voice.as_ref().map_or(0, |voice| voice.delay())
    }

    /// Makes `frame` the stream's next frame; returns whether there is one. Counts frames of other
    /// epochs in `dropped`.
    ///
    /// # Errors
    /// [`StepError`] of the mouth network.
    pub(crate) fn apply(
        &mut self,
        frame: &mut OwnedFrame,
        link: &Link,
        dropped: &AtomicU64,
    ) -> Result<bool, StepError> {
        let there = if self.voice.is_some() {
            self.take_live(frame, link, dropped)?
        } else {
            self.take_delayed(frame, link, dropped)
        };
        if there {
            for (axis, origin) in [(0, self.origin[0]), (2, self.origin[1])] {
                // A stream at the origin keeps its bits.
                if origin != 0.0 {
                    frame.pose.translation[axis] += origin;
                }
            }
        }
        Ok(there)
    }

    /// Pops the engine's next frame, if there is one.
    fn take_delayed(&mut self, frame: &mut OwnedFrame, link: &Link, dropped: &AtomicU64) -> bool {
        let count = || count(dropped);
        let Some(stamp) = link.take_frame(self.epoch, self.chunk_frames, frame, count) else { return false };
        (frame.index, frame.sample) = (self.base + stamp.index, stamp.sample);
        true
    }

    /// Takes the next frame whose mouth is known, over the body that is due.
    fn take_live(&mut self, frame: &mut OwnedFrame, link: &Link, dropped: &AtomicU64) -> Result<bool, StepError> {
        self.drop_other_epochs(link, dropped);
        let Some(voice) = &mut self.voice else { return Ok(false) };
        let Some(index) = voice.apply(frame, link, self.epoch, self.chunk_frames)? else { return Ok(false) };
        frame.index = self.base + index;
        let (sample_rate, frame_rate) = self.rates;
        frame.sample = link.input_base() + index * sample_rate / frame_rate;
        Ok(true)
    }

    fn drop_other_epochs(&self, link: &Link, dropped: &AtomicU64) {
        link.drop_other_epochs(self.epoch, self.chunk_frames, || count(dropped));
    }

    /// Number of this stream's frames that wait, after dropping those of other epochs.
    pub(crate) fn ready(&mut self, link: &Link, dropped: &AtomicU64) -> usize {
        self.drop_other_epochs(link, dropped);
        self.waiting(link)
    }

    /// Number of frames that wait.
    pub(crate) fn waiting(&mut self, link: &Link) -> usize {
        match &mut self.voice {
            Some(voice) => voice.ready(link, self.epoch),
            None => link.frames.len(),
        }
    }

    /// Describes the epoch. [`Self::voice_state`] and [`Self::state`] follow later in a state.
    pub(crate) fn epoch_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.epoch.state(pass)
    }

    /// Describes the live mouth, if there is one.
    pub(crate) fn voice_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.voice.as_mut().map_or(Ok(()), |voice| voice.state(pass))
    }

    /// Describes where the stream begins, after an ease of `eased` frames.
    pub(crate) fn state(&mut self, pass: &mut StatePass, eased: u64) -> Result<(), StateError> {
        let base = pass.number("start of the stream", &mut self.base, MAX_INDEX)?;
        pass.must(base >= eased, "start of the stream")?;
        pass.places(&mut self.origin)
    }
}

/// Counts a dropped frame.
fn count(dropped: &AtomicU64) {
    dropped.fetch_add(1, Ordering::Relaxed);
}
