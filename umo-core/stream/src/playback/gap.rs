//! Gaps: frames that were lost or late, where frames come from packets. The frames after a gap are
//! eased in.

use std::time::Duration;

use umo_core_pose::frame::OwnedFrame;

use super::Start;
use super::ease::{Ease, frames_of, seconds_of, smooth};
use super::idle::Stand;

/// The ease into the frames after a gap, and the times at which frames are missing.
#[derive(Debug)]
pub(crate) struct Gap {
    /// The ease from the last frame before a gap, without layers.
    ease: Ease,
    /// Length of an ease, frames and seconds.
    length: u64,
    seconds: f64,
    /// Whether the next frame starts a later stream, which is eased in from rest.
    begins: bool,
    /// The pose that was sampled last.
    shown: OwnedFrame,
    /// Seconds by which that time was past the newest frame.
    ahead: f64,
}

/// A gap as the sampled pose shows it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Missed<'a> {
    /// Duration in seconds of a gap that has just ended, otherwise 0.
    pub(super) seconds: f64,
    /// The pose that was sampled last.
    pub(super) shown: &'a OwnedFrame,
}

impl Gap {
    /// With an ease of length `ease`.
    pub(crate) fn new(from: OwnedFrame, shown: OwnedFrame, ease: Duration, frame_rate: usize) -> Self {
        let (length, seconds) = (frames_of(ease, frame_rate).max(1).into(), seconds_of(ease));
        Self { ease: Ease::new(from), length, seconds, begins: false, shown, ahead: 0.0 }
    }

    pub(crate) fn reset(&mut self, start: &Start) {
        self.ease.begin(0);
        self.begins = start.is_shown;
        if start.is_reset {
            self.ahead = 0.0;
        }
    }

    /// Eases into `frame` after a gap. `last` is the frame before without layers, if any was shown.
    pub(crate) fn apply(&mut self, frame: &mut OwnedFrame, last: Option<&OwnedFrame>) {
        if let Some(last) = last
            && (frame.index > last.index + 1 || std::mem::take(&mut self.begins))
        {
            self.ease.from.copy(last);
            self.ease.begin(self.length);
        }
        if let Some(t) = self.ease.advance() {
            let t = smooth(t);
            frame.ease_from(&self.ease.from, t, t);
        }
    }

    /// Keeps the pose that was sampled last, before the next one is.
    pub(super) fn keep(&mut self, sampled: &OwnedFrame) {
        self.shown.copy(sampled);
    }

    /// Measures for how long frames are missing; returns the gap that has ended.
    pub(crate) fn missed(&mut self, stand: &Stand) -> Missed<'_> {
        let missing = match stand.is_ahead {
            true if stand.is_shown => stand.passed,
            // Only rest was shown.
            true => self.seconds,
            false => 0.0,
        };
        let before = std::mem::replace(&mut self.ahead, missing);
        Missed { seconds: if missing < before { before } else { 0.0 }, shown: &self.shown }
    }
}
