//! The live mouth of a session: each frame's mouth comes from its own sound as soon as that is
//! heard, over a body that follows with its chunks (SPEC 2.10).
//!
//! ```text
//! input ──samples──► mouth network ──► mouth of frame n ─┐
//! engine ──frames──► body of frame n - delay ────────────┴─► frame n
//! ```
//! The network runs on the host's frame side, frame by frame, so that the mouth never waits for the
//! engine.

use std::sync::Arc;

use umo_core_base::error::StepError;
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::model::Model;
use umo_core_model::mouth::{JAW_OPEN, Mouth, MouthFrame, MouthStream, TO_REST};
use umo_core_pose::frame::{Cue, MAX_INDEX, OwnedFrame};
use umo_core_pose::rotation::axis_angle_to_quat;
use umo_core_pose::skeleton::JAW;

use crate::link::{Epoch, Link};

/// Samples that the network takes at a time: few enough that at most one frame comes out.
const PIECE: usize = 128;
/// Capacity in frames: upper bound on the frames that the end of a stream flushes at once.
const QUEUE: usize = 16;

/// Timing of the mouth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Voice {
    /// With the body: everything comes from the chunk, in sync, one latency of the session after
    /// the sound.
    #[default]
    Delayed = 0,
    /// As the sound is heard, `Latency::mouth_samples` after it: with the default model 11 ms at 16
    /// kHz, 18 ms at 48 kHz. The body lags by the session's latency, and the stream has as many
    /// more frames at its end.
    Live = 1,
    /// The mouth alone, timed as with [`Self::Live`]: no chunk is computed. The body is at rest, with the layers over it: it
    /// breathes, looks, nods and gestures as asked. Needs no engine thread, and no more of the model than
    /// [`Model::load_mouth`] loads.
    Mouth = 2,
}

/// The live mouth's state in one session.
#[derive(Debug)]
pub(crate) struct LiveVoice {
    model: Arc<Model>,
    stream: MouthStream,
    /// Whether the waiting samples belong to this epoch.
    joined: bool,
    /// Whether the network was flushed at the stream's end.
    ended: bool,
    /// Mouths that are known and not yet shown, from `first` on: `[QUEUE, channels]`, frame `index`
    /// at `index % QUEUE`.
    mouths: Slice<f32>,
    levels: [f32; QUEUE],
    /// Sum of squares and number of the samples since the last mouth became known.
    sum: f64,
    heard: u32,
    first: u64,
    known: u64,
    /// The mouth shown last: `[channels]`.
    last: Slice<f32>,
    /// Index of jawOpen in it.
    jaw: Option<usize>,
    /// Frames by which the body lags; 0 and no body, with the mouth alone.
    delay: u64,
    is_alone: bool,
    /// The newest due frame of the body, and its index.
    body: OwnedFrame,
    body_index: Option<u64>,
}

impl LiveVoice {
    /// A mouth over a body that lags by `delay` frames, or over the rest pose. `None` if the model has no mouth network.
    pub(crate) fn new_in(model: Arc<Model>, delay: Option<u64>, rest: &OwnedFrame, arena: &Arena) -> Option<Self> {
        let mouth = model.mouth()?;
        let channels = mouth.channels().len();
        let jaw_open = model.config().face.names.iter().position(|name| name == "jawOpen");
        Some(Self {
            stream: MouthStream::new_in(mouth, arena),
            joined: true,
            ended: false,
            mouths: arena.filled(0.0, QUEUE * channels),
            levels: [0.0; QUEUE],
            sum: 0.0,
            heard: 0,
            first: 0,
            known: 0,
            last: arena.copied(mouth.rest()),
            jaw: mouth.channels().iter().position(|&channel| Some(channel) == jaw_open),
            delay: delay.unwrap_or_default(),
            is_alone: delay.is_none(),
            body: rest.clone_in(arena),
            body_index: None,
            model,
        })
    }

    fn mouth(model: &Model) -> &Mouth {
        model.mouth().expect("a live voice is made of a model with a mouth")
    }

    /// Samples, at the model's rate, after a frame's time that its mouth needs.
    pub(crate) fn latency_samples(&self) -> usize {
        Self::mouth(&self.model).latency_samples()
    }

    /// Number of frames that can be shown without more audio.
    pub(super) fn ready(&mut self, link: &Link, epoch: Epoch) -> usize {
        if !self.join(link, epoch) {
            return 0;
        }
        let known = match link.total() {
            Some(total) => total + self.tail_known(link, epoch, total),
            None => Self::mouth(&self.model).frames_after(&self.stream, link.voice().len()),
        };
        usize::try_from(known.saturating_sub(self.first)).unwrap_or(usize::MAX)
    }

    /// Number of frames after the end of a stream of `total` frames whose body has arrived.
    fn tail_known(&self, link: &Link, epoch: Epoch, total: u64) -> u64 {
        let frames = &link.frames;
        let waiting = frames.next().filter(|stamp| stamp.epoch == epoch.number);
        let newest = waiting.map(|stamp| stamp.index + frames.len() as u64 - 1).or(self.body_index);
        newest.map_or(0, |newest| (newest + 1 + self.delay).min(total + self.delay).saturating_sub(total))
    }

    /// Frames by which the body lags.
    pub(super) fn delay(&self) -> u64 {
        self.delay
    }

    /// Whether there is no body.
    pub(super) fn is_alone(&self) -> bool {
        self.is_alone
    }

    /// Begins a new stream.
    pub(super) fn begin(&mut self, rest: &OwnedFrame) {
        let mouth = Self::mouth(&self.model);
        self.stream.reset(mouth);
        (self.joined, self.ended) = (false, false);
        (self.first, self.known, self.sum, self.heard) = (0, 0, 0.0, 0);
        self.last.copy_from_slice(mouth.rest());
        self.body.copy(rest);
        self.body_index = None;
    }

    /// Drops the samples of other epochs; returns whether the remaining ones belong to this one.
    fn join(&mut self, link: &Link, epoch: Epoch) -> bool {
        if !self.joined
            && let Some(start) = link.input_start_in(epoch)
        {
            link.voice().skip_to(start);
            self.joined = true;
        }
        self.joined
    }

    /// Makes `frame` the next frame: the body that is due, with its mouth. Returns the frame's index,
    /// or `None` if audio is missing, or in the tail its body.
    ///
    /// # Errors
    /// [`StepError`] of the network.
    pub(super) fn apply(
        &mut self,
        frame: &mut OwnedFrame,
        link: &Link,
        epoch: Epoch,
        enough: usize,
    ) -> Result<Option<u64>, StepError> {
        let index = self.next(link, epoch)?.filter(|&index| self.take_body(link, epoch, index, enough));
        if index.is_some() {
            frame.copy(&self.body);
            self.put_mouth(frame);
        }
        Ok(index)
    }

    /// Computes the next frame's mouth, unless it is known; returns the frame's index, or `None` if
    /// audio is missing.
    fn next(&mut self, link: &Link, epoch: Epoch) -> Result<Option<u64>, StepError> {
        if !self.join(link, epoch) {
            return Ok(None);
        }
        let Self { model, stream, mouths, levels, known, sum, heard, .. } = self;
        let mouth = Self::mouth(model);
        let width = mouth.channels().len();
        // Stores the mouth of a frame that has become known; returns its slot.
        let keep = |frame: MouthFrame, mouths: &mut [f32], known: &mut u64| {
            #[expect(clippy::cast_possible_truncation, reason = "below the queue's length")]
            let slot = (frame.index % QUEUE as u64) as usize;
            mouths[slot * width..][..width].copy_from_slice(frame.channels);
            *known = frame.index + 1;
            slot
        };
        let mut words = [0; PIECE];
        let mut samples = [0.0; PIECE];
        while self.first == *known {
            // The end is set after the last samples, so it is read before looking for them: if it
            // is set and there are none, none will come.
            let total = link.total();
            let count = link.voice().peek(&mut words);
            if count > 0 {
                link.voice().skip(count);
                samples.iter_mut().zip(words).for_each(|(sample, word)| *sample = f32::from_bits(word));
                *sum += samples[..count].iter().map(|sample| f64::from(*sample).powi(2)).sum::<f64>();
                *heard += u32::try_from(count).unwrap_or(u32::MAX);
                stream.push(mouth, model.isa(), &samples[..count], |frame| {
                    #[expect(clippy::cast_possible_truncation, reason = "a level's precision is enough")]
                    let level = (*sum / f64::from((*heard).max(1))).sqrt() as f32;
                    levels[keep(frame, mouths, known)] = level;
                    (*sum, *heard) = (0.0, 0);
                })?;
            } else if total.is_some() && !self.ended {
                self.ended = true;
                stream.finish(mouth, model.isa(), |frame| levels[keep(frame, mouths, known)] = 0.0)?;
            } else {
                break;
            }
        }
        let is_left = |total| total > 0 && self.first < total + self.delay;
        let is_tail = self.ended && link.total().is_some_and(is_left);
        let is_over = self.is_alone && self.ended && !is_tail;
        Ok(((self.first < self.known || is_tail) && !is_over).then_some(self.first))
    }

    /// Takes the body's frames that are due at frame `index`; returns whether the frame can be
    /// shown. In the tail, which has no sound, that requires its body.
    fn take_body(&mut self, link: &Link, epoch: Epoch, index: u64, enough: usize) -> bool {
        let Some(due) = index.checked_sub(self.delay).filter(|_| !self.is_alone) else { return true };
        let frames = &link.frames;
        while let Some(stamp) = frames.next()
            && stamp.epoch == epoch.number
            && stamp.index <= due
        {
            frames.pop(&mut self.body);
            link.frame_taken(enough);
            self.body_index = Some(stamp.index);
        }
        index < self.known || self.body_index == Some(due)
    }

    /// Puts the next frame's mouth into `frame`, which has its body.
    fn put_mouth(&mut self, frame: &mut OwnedFrame) {
        let mouth = Self::mouth(&self.model);
        let width = mouth.channels().len();
        let mut level = 0.0;
        if self.first < self.known {
            #[expect(clippy::cast_possible_truncation, reason = "below the queue's length")]
            let slot = (self.first % QUEUE as u64) as usize;
            self.last.copy_from_slice(&self.mouths[slot * width..][..width]);
            level = self.levels[slot];
        } else {
            self.last.iter_mut().zip(mouth.rest()).for_each(|(value, rest)| *value += TO_REST * (rest - *value));
        }
        self.first += 1;
        self.known = self.known.max(self.first);
        for (&channel, value) in mouth.channels().iter().zip(&self.last) {
            frame.face[channel] = *value;
        }
        if let Some(jaw) = self.jaw {
            frame.pose.rotations[JAW] = axis_angle_to_quat([JAW_OPEN * self.last[jaw], 0.0, 0.0]);
        }
        // Level of the sound heard now, not of the body's; its next phrase is still unknown.
        frame.cue = Cue { level, onset: -1.0, ..frame.cue };
    }

    /// Describes it.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.stream.state(pass)?;
        pass.switch("mouth", &mut self.joined)?;
        pass.switch("mouth", &mut self.ended)?;
        pass.moderate(&mut self.mouths)?;
        pass.f32s(&mut self.levels)?;
        pass.sum(&mut self.sum)?;
        let heard = pass.limited("mouth", self.heard.into(), 1 << 20)?;
        if pass.loads() {
            self.heard = u32::try_from(heard).unwrap_or_default();
        }
        pass.moderate(&mut self.last)?;
        let known = pass.number("mouth", &mut self.known, MAX_INDEX)?;
        let first = pass.number("mouth", &mut self.first, known)?;
        pass.must(known - first.min(known) <= QUEUE as u64, "mouth")?;
        self.body.state(pass)?;
        pass.maybe("body's frame", &mut self.body_index, MAX_INDEX).map(drop)
    }
}
