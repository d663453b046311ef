//! Eases after an interrupt: to rest, as frames before the next stream's; and from rest into the
//! first frames of the next stream.

use std::time::Duration;

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::{Cue, OwnedFrame};

use super::Start;

/// Share of the time of the way back from rest or idle motion that the face takes.
pub(super) const FACE_EASE: f64 = 0.25;

/// Frames that ease from a pose.
#[derive(Debug)]
pub(super) struct Ease {
    pub(super) from: OwnedFrame,
    done: u64,
    frames: u64,
}

impl Ease {
    pub(super) fn new(from: OwnedFrame) -> Self {
        Self { from, done: 0, frames: 0 }
    }

    /// Begins an ease of `frames` frames; 0 for none.
    pub(super) fn begin(&mut self, frames: u64) {
        (self.done, self.frames) = (0, frames);
    }

    /// Number of frames left.
    fn left(&self) -> u64 {
        self.frames - self.done
    }

    /// Advances by a frame; returns the share of the frames that are done, or `None` after the end.
    pub(super) fn advance(&mut self) -> Option<f32> {
        if self.done >= self.frames {
            return None;
        }
        self.done += 1;
        Some(self.done as f32 / self.frames as f32)
    }

    /// Describes the ease; returns its number of frames.
    fn state(&mut self, pass: &mut StatePass) -> Result<u64, StateError> {
        self.from.state(pass)?;
        let frames = pass.number("ease", &mut self.frames, u16::MAX.into())?;
        pass.number("ease", &mut self.done, frames)?;
        Ok(frames)
    }
}

/// The ease from the frame shown last to rest, before the next stream.
#[derive(Debug)]
pub(crate) struct ToRest(Ease);

impl ToRest {
    pub(crate) fn new(from: OwnedFrame) -> Self {
        Self(Ease::new(from))
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.0.from.copy(start.last);
        self.0.begin(start.ease);
    }

    /// Makes `frame` the ease's next frame; returns `false` after its end. The next stream begins at
    /// index `base`.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, rest: &OwnedFrame, base: u64) -> bool {
        let Self(ease) = self;
        let Some(t) = ease.advance() else { return false };
        frame.between(&ease.from, rest, smooth(t));
        frame.stay_at(ease.from.pose.translation);
        frame.index = base - ease.left() - 1;
        frame.sample = ease.from.sample;
        frame.cue = Cue::default();
        true
    }

    /// Number of frames left.
    pub(crate) fn left(&self) -> u64 {
        self.0.left()
    }

    /// Describes the ease; returns its number of frames.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<u64, StateError> {
        self.0.state(pass)
    }
}

/// The ease from rest into the first frames of the next stream.
#[derive(Debug)]
pub(crate) struct Arrival {
    ease: Ease,
    /// Upper bound on its frames.
    longest: u64,
}

impl Arrival {
    pub(crate) fn new(from: OwnedFrame, longest: u64) -> Self {
        Self { ease: Ease::new(from), longest }
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.ease.begin(start.ease.min(self.longest));
    }

    /// Eases into `frame` from rest, which `last`, the frame before without layers, shows.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, last: &OwnedFrame) {
        let Self { ease, .. } = self;
        if ease.done == 0 && ease.frames > 0 {
            ease.from.copy(last);
        }
        if let Some(t) = ease.advance() {
            // Speech begins with the mouth.
            frame.ease_from(&ease.from, smooth(t), smooth(t / single(FACE_EASE)));
        }
    }

    /// Describes the ease.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.ease.state(pass).map(drop)
    }
}

/// Smoothstep: 0 to 1 with zero slope at both ends.
pub(super) fn smooth(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[expect(clippy::cast_possible_truncation, reason = "a share of a way")]
pub(super) fn single(value: f64) -> f32 {
    value as f32
}

/// Seconds of an ease.
pub(super) fn seconds_of(ease: Duration) -> f64 {
    ease.as_secs_f64().max(1e-3)
}

/// Number of frames in a duration, rounded up.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 16 bits")]
pub(crate) fn frames_of(time: Duration, frame_rate: usize) -> u16 {
    (time.as_secs_f64() * frame_rate as f64).ceil().min(f64::from(u16::MAX)) as u16
}
