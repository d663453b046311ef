//! Voice of one member: when it sounds, and where its phrases begin and end.

use umo_core_base::state::{StateError, StatePass};
use umo_core_base::voice::{VoiceLevels, decibels};

use super::{TICK_SECONDS, ticks};

/// Silence within a sound.
const GAP: u32 = ticks(0.25);
/// Least silence before a phrase, silence that ends one, and least sound of one that has an end.
const PAUSE: u32 = ticks(0.4);
const END: u32 = ticks(0.2);
const LEAST_PHRASE: u32 = ticks(0.5);
/// Sound after which somebody is heard to speak.
const HEARD: u32 = ticks(0.1);
/// Cap of the counters.
const MOST: u32 = 1 << 20;

/// A voice at a tick; counters are in ticks.
#[derive(Debug)]
pub(super) struct Voice {
    levels: VoiceLevels,
    /// Root mean square, full scale 1.
    pub(super) level: f32,
    /// Since the last sound.
    pub(super) silent: u32,
    /// Length of the present sound with its gaps, and how much of it sounded.
    pub(super) run: u32,
    pub(super) heard: u32,
    /// Sound in the present phrase.
    phrase: u32,
    /// Whether the present sound begins a phrase that was not told yet.
    is_onset: bool,
    /// Whether a phrase begins, or has ended, at this tick.
    pub(super) begins: bool,
    pub(super) ends: bool,
}

impl Voice {
    pub(super) fn new() -> Self {
        Self {
            levels: VoiceLevels::default(),
            level: 0.0,
            silent: MOST,
            run: 0,
            heard: 0,
            phrase: 0,
            is_onset: false,
            begins: false,
            ends: false,
        }
    }

    /// Hears one tick.
    pub(super) fn hear(&mut self, level: f32) {
        self.level = level;
        (self.begins, self.ends) = (false, false);
        if self.levels.hear(decibels(level), TICK_SECONDS) {
            if self.silent >= GAP {
                (self.run, self.heard) = (0, 0);
            }
            if self.silent >= PAUSE {
                (self.phrase, self.is_onset) = (0, true);
            }
            self.silent = 0;
            self.heard = (self.heard + 1).min(MOST);
            self.phrase = (self.phrase + 1).min(MOST);
            if self.heard >= HEARD {
                self.begins = std::mem::take(&mut self.is_onset);
            }
        } else {
            self.silent = (self.silent + 1).min(MOST);
            self.ends = self.silent == END && self.phrase >= LEAST_PHRASE;
        }
        if self.silent < GAP {
            self.run = (self.run + 1).min(MOST);
        }
    }

    /// Whether it sounds, short gaps included.
    pub(super) fn sounds(&self) -> bool {
        self.silent < GAP && self.heard >= HEARD
    }

    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.levels.state(pass)?;
        pass.within(&mut self.level, 0.0..=super::MAX_LEVEL)?;
        for count in [&mut self.silent, &mut self.run, &mut self.heard, &mut self.phrase] {
            super::count(pass, count, MOST)?;
        }
        pass.switch("voice", &mut self.is_onset)?;
        pass.switch("voice", &mut self.begins)?;
        pass.switch("voice", &mut self.ends).map(drop)
    }
}
