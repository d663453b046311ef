//! The frame shown last and the next one, and poses between them.

use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::frame::OwnedFrame;

use super::Start;
use super::ease::single;
use super::gap::Gap;
use super::idle::Stand;

/// Range of times that [`Session::sample_pose`](crate::session::Session::sample_pose) could choose
/// from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// Time of the oldest frame still held, seconds.
    pub oldest: f64,
    /// Time of the newest ready frame, seconds.
    pub newest: f64,
    /// Whether the requested time was later than that.
    pub is_ahead: bool,
}

/// A frame with layers, and without.
#[derive(Debug)]
pub(crate) struct Layered {
    pub(crate) frame: OwnedFrame,
    pub(crate) raw: OwnedFrame,
}

/// The frame shown last and the one after it.
#[derive(Debug)]
pub(crate) struct Window {
    pub(crate) last: Layered,
    /// Whether any frame was shown since the start.
    pub(crate) any: bool,
    /// The frame after it, if it was already taken out of the ring.
    pub(crate) next: Layered,
    pub(crate) has_next: bool,
}

impl Window {
    /// Starts without a frame shown; `frame` makes the buffers.
    pub(crate) fn new(frame: impl Fn() -> OwnedFrame) -> Self {
        let layered = || Layered { frame: frame(), raw: frame() };
        Self { last: layered(), any: false, next: layered(), has_next: false }
    }

    /// Drops the next frame, and after a reset the one shown; returns whether there was a next one.
    pub(crate) fn reset(&mut self, is_reset: bool, rest: &OwnedFrame) -> bool {
        if is_reset {
            self.last.frame.copy(rest);
            self.last.raw.copy(rest);
            self.any = false;
        }
        std::mem::take(&mut self.has_next)
    }

    /// Describes the frames; [`Self::flags_state`] precedes them in a state.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.last.frame.state(pass)?;
        self.next.frame.state(pass)?;
        self.last.raw.state(pass)?;
        self.next.raw.state(pass)
    }

    /// Describes which of the frames there are.
    pub(crate) fn flags_state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.switch("frame shown", &mut self.any)?;
        pass.switch("next frame", &mut self.has_next).map(drop)
    }
}

/// The pose between two frames at the host's time.
#[derive(Debug)]
pub(crate) struct Sample {
    /// The pose sampled last. Each sample recomputes it, so a state does not have it.
    pub(crate) frame: OwnedFrame,
    /// Last requested time, seconds of the motion.
    pub(crate) time: f64,
    pub(crate) frame_rate: f64,
}

impl Sample {
    pub(crate) fn new(frame: OwnedFrame, frame_rate: usize) -> Self {
        Self { frame, time: 0.0, frame_rate: frame_rate as f64 }
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        if start.is_reset {
            self.frame.copy(start.rest);
            self.time = 0.0;
        }
    }

    /// Time of a frame, seconds.
    pub(crate) fn seconds(&self, frame: &OwnedFrame) -> f64 {
        frame.index as f64 / self.frame_rate
    }

    /// Makes the next frame of `window` the one shown; returns its time, seconds.
    pub(crate) fn show_next(&mut self, window: &mut Window) -> f64 {
        std::mem::swap(&mut window.last, &mut window.next);
        (window.has_next, window.any) = (false, true);
        let time = self.seconds(&window.last.frame);
        self.advance(time);
        time
    }

    /// Moves the time forward to `seconds`, and returns it; it never goes back.
    pub(crate) fn advance(&mut self, seconds: f64) -> f64 {
        self.time = self.time.max(seconds);
        self.time
    }

    /// Samples the pose at `time`; returns where the avatar stands then. `gap` keeps the pose
    /// sampled before.
    pub(crate) fn apply<'a>(
        &mut self,
        window: &'a Window,
        rest: &'a OwnedFrame,
        time: f64,
        gap: Option<&mut Gap>,
    ) -> Stand<'a> {
        let Window { last, any, next, has_next } = window;
        let oldest = self.seconds(&last.frame);
        let passed = time - oldest;
        if let Some(gap) = gap {
            gap.keep(&self.frame);
        }
        (self.frame.index, self.frame.sample) = (last.frame.index, last.frame.sample);
        if *has_next && *any {
            // Frames of a forged state may repeat a time or go back.
            let length = self.seconds(&next.frame) - oldest;
            let t = if length > 0.0 { single(passed / length) } else { 1.0 };
            self.frame.between(&last.frame, &next.frame, t);
        } else {
            self.frame.pose_of(&last.frame);
        }
        let is_ahead = !any || !has_next && time > oldest;
        Stand { is_ahead, is_shown: *any, passed, last: &last.raw, rest }
    }

    /// Describes the time.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.float(&mut self.time).map(drop)
    }
}
