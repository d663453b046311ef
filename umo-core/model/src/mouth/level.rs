//! Level control: estimates the levels of the voice and of the noise from the past alone, so that the network
//! gets the same rows for speech of any level.

use umo_core_base::error::LoadError;
use umo_core_base::functions::Functions;
use umo_core_base::state::{StateError, StatePass};

/// One decibel as a natural logarithm of power.
const DECIBEL: f32 = std::f32::consts::LN_10 / 10.0;

/// Initial level of a stream, relative to full scale. It is below the usual level of speech, since the level
/// rises at once and falls slowly.
const START: f32 = -55.0 * DECIBEL;
/// Initial noise level of a stream, relative to full scale.
const START_NOISE: f32 = -90.0 * DECIBEL;
/// Minimum level: quieter sound is not a voice.
const LEAST: f32 = -75.0 * DECIBEL;
/// Time in which the level follows a louder sound by 63 %, in seconds.
const ATTACK_S: f64 = 0.015;
/// Like [`ATTACK_S`], for a quieter sound that stands out from the noise. In a pause the level does not
/// change.
const RELEASE_S: f64 = 1.5;
/// Like [`ATTACK_S`], for the noise level and a quieter sound.
const FALL_S: f64 = 0.05;
/// Like [`ATTACK_S`], for the noise level and a louder sound.
const RISE_S: f64 = 3.0;
/// Distance above the noise from which a sound may be a voice.
const STANDS_OUT: f32 = 6.0 * DECIBEL;
/// Further distance over which a sound's weight rises to 1.
const STANDS_OUT_RAMP: f32 = 6.0 * DECIBEL;

/// Smoothing factors per row, and the full-scale reference.
#[derive(Clone, Copy, Debug)]
pub(super) struct LevelControl {
    full_scale: f32,
    attack: f32,
    release: f32,
    fall: f32,
    rise: f32,
}

/// Levels estimated so far, as natural logarithms of power.
#[derive(Clone, Copy, Debug)]
pub(super) struct Level {
    /// Level of the voice.
    pub(super) voice: f32,
    /// Level of the constant background.
    pub(super) noise: f32,
}

impl Level {
    /// Describes the levels.
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mut values = [self.voice, self.noise];
        pass.f32s(&mut values)?;
        [self.voice, self.noise] = values;
        Ok(())
    }
}

impl LevelControl {
    /// Creates the control for rows of the filters `[bands, bins]` over the window, at `row_rate` per second.
    #[expect(clippy::cast_possible_truncation, reason = "an f32's precision is enough")]
    #[expect(clippy::cast_precision_loss, reason = "a rate is far below 2^52")]
    pub(crate) fn new(filters: &[f32], window: &[f32], floor: f32, row_rate: u64) -> Result<Self, LoadError> {
        let filters: f64 = filters.iter().copied().map(f64::from).sum();
        let window: f64 = window.iter().copied().map(f64::from).map(|w| w * w).sum();
        let full_scale = (filters * window).logarithm();
        if !(full_scale.is_finite() && full_scale > f64::from(floor).logarithm()) {
            let problem =
                format!("white noise at full scale gives power {:e}, no more than the floor", filters * window);
            return Err(LoadError::tensor("mouth.filters.weight", problem));
        }
        let factor = |seconds: f64| -(-1.0 / (row_rate as f64 * seconds)).exponential_less_one() as f32;
        Ok(Self {
            full_scale: full_scale as f32,
            attack: factor(ATTACK_S),
            release: factor(RELEASE_S),
            fall: factor(FALL_S),
            rise: factor(RISE_S),
        })
    }

    /// Levels of a new stream.
    pub(super) fn start(&self) -> Level {
        Level { voice: self.full_scale + START, noise: self.full_scale + START_NOISE }
    }

    /// Updates the levels with a row's energy, the natural logarithm of its power.
    pub(super) fn hear(&self, level: &mut Level, energy: f32) {
        let above = energy - level.voice;
        let stands_out = ((energy - level.noise - STANDS_OUT) / STANDS_OUT_RAMP).clamp(0.0, 1.0);
        let factor = if above > 0.0 { self.attack } else { self.release * stands_out };
        level.voice = (level.voice + factor * above).max(self.full_scale + LEAST);
        let louder = energy - level.noise;
        level.noise += if louder > 0.0 { self.rise } else { self.fall } * louder;
    }

    /// Level of the voice, in dB of full scale.
    pub(super) fn decibels(&self, level: Level) -> f32 {
        (level.voice - self.full_scale) / DECIBEL
    }
}
