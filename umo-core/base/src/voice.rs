//! Whether a voice sounds, from the level of its sound.

use crate::functions::Functions;
use crate::state::{StateError, StatePass};

/// Level of digital silence, dBFS.
pub const SILENCE_DBFS: f32 = -100.0;

/// Least level of a voice, dBFS: a quiet voice is at -60.
const MIN_VOICE_DBFS: f32 = -80.0;

/// Least distance of a voice above the noise, and largest below its loud level, dB.
const MIN_DB_ABOVE_NOISE: f32 = 8.0;
const MAX_DB_BELOW_LOUD: f32 = 26.0;

/// Time constants, seconds: of the noise level when rising and falling, and of the loud level.
const NOISE_RISE_SECONDS: f32 = 6.0;
const NOISE_FALL_SECONDS: f32 = 0.1;
const LOUD_RISE_SECONDS: f32 = 0.05;
const LOUD_FALL_SECONDS: f32 = 12.0;

/// Level in dBFS of a root mean square, full scale 1: [`SILENCE_DBFS`] to 0.
pub fn decibels(level: f32) -> f32 {
    // `max` ignores NaN.
    (20.0 * level.max(1e-5).logarithm_10()).min(0.0)
}

/// Share by which a first-order low-pass approaches its input in a step of `seconds`.
pub fn step(seconds: f32, time: f32) -> f32 {
    1.0 - (-seconds / time).exponential()
}

/// Levels of the noise and of the loud parts of a sound, dBFS. Voice activity is relative to both, so that quiet voices
/// are detected too (SPEC 2.11.1).
#[derive(Debug)]
pub struct VoiceLevels {
    noise: f32,
    loud: f32,
}

impl Default for VoiceLevels {
    /// The levels before any sound.
    fn default() -> Self {
        Self { noise: MIN_VOICE_DBFS, loud: MIN_VOICE_DBFS }
    }
}

impl VoiceLevels {
    /// Level of the loud parts, dBFS.
    pub fn loud(&self) -> f32 {
        self.loud
    }

    /// Level below which no voice is detected, relative to the loud parts, dBFS.
    pub fn floor(&self) -> f32 {
        self.loud - MAX_DB_BELOW_LOUD
    }

    /// Processes `seconds` of a sound of this level in dBFS; returns whether a voice sounds.
    pub fn hear(&mut self, level: f32, seconds: f32) -> bool {
        let noise_time = if level > self.noise { NOISE_RISE_SECONDS } else { NOISE_FALL_SECONDS };
        self.noise += step(seconds, noise_time) * (level - self.noise);
        let loud_time = if level > self.loud { LOUD_RISE_SECONDS } else { LOUD_FALL_SECONDS };
        self.loud += step(seconds, loud_time) * (level.max(MIN_VOICE_DBFS) - self.loud);
        level > MIN_VOICE_DBFS && level > self.noise + MIN_DB_ABOVE_NOISE && level > self.floor()
    }

    /// Saves or loads the levels.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mut values = [self.noise, self.loud];
        pass.moderate(&mut values)?;
        [self.noise, self.loud] = values;
        Ok(())
    }
}
