//! Trend of the voice's arousal (SPEC 2.22).

use umo_core_base::arousal::ORDINARY;
use umo_core_base::state::{StateError, StatePass};

/// Time constants of what is now and of what was before, seconds.
const NOW_SECONDS: f32 = 0.5;
const BEFORE_SECONDS: f32 = 2.0;

/// Two low-passes over the arousal of the frames shown.
#[derive(Debug)]
pub(crate) struct Trend {
    now: f32,
    before: f32,
    frame_seconds: f32,
}

impl Trend {
    /// The trend before a stream's first frame.
    #[expect(clippy::cast_precision_loss, reason = "a small number")]
    pub(crate) fn new(frame_rate: usize) -> Self {
        Self { now: ORDINARY, before: ORDINARY, frame_seconds: 1.0 / frame_rate as f32 }
    }

    pub(crate) fn reset(&mut self) {
        (self.now, self.before) = (ORDINARY, ORDINARY);
    }

    /// Follows the arousal by one frame.
    pub(crate) fn follow(&mut self, arousal: f32) {
        self.now += (arousal - self.now) * (self.frame_seconds / NOW_SECONDS);
        self.before += (arousal - self.before) * (self.frame_seconds / BEFORE_SECONDS);
    }

    /// Change of the arousal, per second.
    pub(crate) fn value(&self) -> f32 {
        (self.now - self.before) / (BEFORE_SECONDS - NOW_SECONDS)
    }

    /// Saves or loads the trend between two frames.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.share(&mut self.now)?;
        pass.share(&mut self.before)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_has_its_slope_and_a_steady_voice_none() {
        let mut trend = Trend::new(30);
        assert_eq!(trend.value(), 0.0);
        (0..300).for_each(|frame| trend.follow(0.02 * frame as f32 / 30.0 + 0.5));
        assert!((trend.value() - 0.02).abs() < 1e-3, "{}", trend.value());
        (0..600).for_each(|_| trend.follow(0.7));
        assert!(trend.value().abs() < 1e-3);
    }
}
