//! Level control: how loud the voice is and how loud what is behind it, from the past alone, so that
//! speech of any level gives the network the same rows.

use crate::error::LoadError;
use crate::state::{StateError, StatePass};

/// Natural logarithm of power per decibel.
const DECIBEL: f32 = std::f32::consts::LN_10 / 10.0;

/// Level of a new stream, relative to full scale; quieter than speech usually is, since the level
/// rises at once and falls slowly.
const START: f32 = -55.0 * DECIBEL;
/// Noise of a new stream.
const START_NOISE: f32 = -90.0 * DECIBEL;
/// Lowest level: what is quieter is no voice.
const LEAST: f32 = -75.0 * DECIBEL;
/// Seconds in which the level follows a louder sound by 63 %.
const ATTACK_S: f64 = 0.015;
/// The same for a quieter one that stands out from the noise; a pause leaves the level as it is.
const RELEASE_S: f64 = 1.5;
/// The same for the noise and a quieter sound.
const FALL_S: f64 = 0.05;
/// The same for the noise and a louder sound.
const RISE_S: f64 = 3.0;
/// A sound so far above the noise may be a voice.
const STANDS_OUT: f32 = 6.0 * DECIBEL;
/// So much further above, it counts in full.
const STANDS_OUT_RAMP: f32 = 6.0 * DECIBEL;

/// Factors per row, and what full scale is.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelControl {
    full_scale: f32,
    attack: f32,
    release: f32,
    fall: f32,
    rise: f32,
}

/// What is heard of levels so far: natural logarithms of power.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Of the voice.
    pub(super) voice: f32,
    /// Of what is always there.
    pub(super) noise: f32,
}

impl Level {
    /// Describes it.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mut values = [self.voice, self.noise];
        pass.f32s(&mut values)?;
        [self.voice, self.noise] = values;
        Ok(())
    }
}

impl LevelControl {
    /// For rows of these filters `[bands, bins]` over this window, `row_rate` a second.
    #[expect(clippy::cast_possible_truncation, reason = "an f32's precision is enough")]
    #[expect(clippy::cast_precision_loss, reason = "a rate is far below 2^52")]
    pub(super) fn new(filters: &[f32], window: &[f32], floor: f32, row_rate: u64) -> Result<Self, LoadError> {
        let filters: f64 = filters.iter().copied().map(f64::from).sum();
        let window: f64 = window.iter().copied().map(f64::from).map(|w| w * w).sum();
        let full_scale = (filters * window).ln();
        if !(full_scale.is_finite() && full_scale > f64::from(floor).ln()) {
            let problem =
                format!("white noise at full scale gives power {:e}, no more than the floor", filters * window);
            return Err(LoadError::tensor("mouth.filters.weight", problem));
        }
        let factor = |seconds: f64| -(-1.0 / (row_rate as f64 * seconds)).exp_m1() as f32;
        Ok(Self {
            full_scale: full_scale as f32,
            attack: factor(ATTACK_S),
            release: factor(RELEASE_S),
            fall: factor(FALL_S),
            rise: factor(RISE_S),
        })
    }

    /// Of a new stream.
    pub(super) fn start(&self) -> Level {
        Level { voice: self.full_scale + START, noise: self.full_scale + START_NOISE }
    }

    /// Takes a row's energy into account, the natural logarithm of its power.
    pub(super) fn hear(&self, level: &mut Level, energy: f32) {
        let above = energy - level.voice;
        let stands_out = ((energy - level.noise - STANDS_OUT) / STANDS_OUT_RAMP).clamp(0.0, 1.0);
        let factor = if above > 0.0 { self.attack } else { self.release * stands_out };
        level.voice = (level.voice + factor * above).max(self.full_scale + LEAST);
        let louder = energy - level.noise;
        level.noise += if louder > 0.0 { self.rise } else { self.fall } * louder;
    }

    /// The voice's level, relative to full scale.
    pub(super) fn decibels(&self, level: Level) -> f32 {
        (level.voice - self.full_scale) / DECIBEL
    }
}
