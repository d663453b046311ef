//! Whether somebody speaks: the network's voice activity with hysteresis, and how far the mouth
//! follows it.

use crate::state::{StateError, StatePass};

/// Probability of a voice from which somebody speaks.
const OPENS: f32 = 0.6;
/// Probability below which nobody does.
const SHUTS: f32 = 0.4;
/// Frames in a row below it until the mouth shuts.
const HOLD: u64 = 6;
/// How far the gate opens in a frame.
const OPENING: f32 = 0.5;
/// How far it shuts in a frame.
const SHUTTING: f32 = 0.125;

/// The state of the decision.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gate {
    /// How far the channels follow the network, 0 to 1.
    open: f32,
    /// Whether somebody speaks.
    speaks: bool,
    /// Frames in a row that may have no voice.
    without: u64,
}

impl Gate {
    /// How far the channels follow the network, 0 to 1.
    pub(super) fn open(&self) -> f32 {
        self.open
    }

    /// Takes a frame's log-odds of a voice into account; how far the channels follow the network.
    pub(super) fn hear(&mut self, odds: f32) -> f32 {
        let probability = 1.0 / (1.0 + (-odds).exp());
        self.without = if probability < SHUTS { (self.without + 1).min(HOLD) } else { 0 };
        self.speaks = probability >= OPENS || (self.speaks && self.without < HOLD);
        self.open = if self.speaks { (self.open + OPENING).min(1.0) } else { (self.open - SHUTTING).max(0.0) };
        self.open
    }

    /// Describes it.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.share(&mut self.open)?;
        pass.switch("mouth", &mut self.speaks)?;
        pass.number("mouth", &mut self.without, HOLD)?;
        Ok(())
    }
}
