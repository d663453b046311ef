//! Speech detection: the network's voice activity with hysteresis, and the resulting opening of the mouth.

use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};

/// Voice probability from which speech is detected.
const OPENS: f32 = 0.6;
/// Voice probability below which a frame counts as without voice.
const SHUTS: f32 = 0.4;
/// Number of consecutive frames without voice after which the mouth shuts.
const HOLD: u64 = 6;
/// Opening of the gate per frame.
const OPENING: f32 = 0.5;
/// Shutting of the gate per frame.
const SHUTTING: f32 = 0.125;

/// State of the speech detection.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gate {
    /// Share of the network's output in the channels, 0 to 1.
    open: f32,
    /// Whether speech is detected.
    speaks: bool,
    /// Number of consecutive frames without voice, up to `HOLD`.
    without: u64,
}

impl Gate {
    /// Share of the network's output in the channels, 0 to 1.
    pub(super) fn open(&self) -> f32 {
        self.open
    }

    /// Updates the gate with a frame's log-odds of a voice. Returns the share of the network's output in the
    /// channels.
    pub(super) fn hear(&mut self, odds: f32) -> f32 {
        let probability = 1.0 / (1.0 + (-odds).exponential());
        self.without = if probability < SHUTS { (self.without + 1).min(HOLD) } else { 0 };
        self.speaks = probability >= OPENS || (self.speaks && self.without < HOLD);
        self.open = if self.speaks { (self.open + OPENING).min(1.0) } else { (self.open - SHUTTING).max(0.0) };
        self.open
    }

    /// Describes the state.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.share(&mut self.open)?;
        pass.switch("mouth", &mut self.speaks)?;
        pass.number("mouth", &mut self.without, HOLD)?;
        Ok(())
    }
}
