//! Attention of the avatar: idle, listening, thinking, speaking, and the transitions between them;
//! and the analysis of its voice that it follows in automatic mode.

use umo_core_base::state::{StateError, StatePass};
use umo_core_base::voice::{SILENCE_DBFS, VoiceLevels, decibels};

use super::rig::step;
use super::{Role, Tick};

/// Attention of the avatar.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Attention {
    /// Automatic: speaking while its voice is heard, else idle; in company, as the scene says.
    #[default]
    Auto = 0,
    /// Attends to nothing in particular.
    Idle = 1,
    /// Attends to the interlocutor: looks there, nods and raises its brows at pauses.
    Listening = 2,
    /// Thinks of an answer: looks away.
    Thinking = 3,
    /// Attends to its own speech.
    Speaking = 4,
}

impl Attention {
    /// All values in numeric order.
    pub const ALL: [Self; 5] = [Self::Auto, Self::Idle, Self::Listening, Self::Thinking, Self::Speaking];
}

/// Weight of each attention state, 0 to 1; they sum to 1.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Weights {
    pub(crate) idle: f32,
    pub(crate) listening: f32,
    pub(crate) thinking: f32,
    pub(crate) speaking: f32,
    /// The avatar's voice.
    pub(super) own: Heard,
}

/// Analysis of a voice at a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Heard {
    /// Whether the voice sounds.
    pub(super) is_on: bool,
    /// Whether a phrase begins: sound after a pause.
    pub(super) begins: bool,
    /// Whether a phrase has ended: a pause after sound.
    pub(super) ends: bool,
    /// Strength of an accent that begins at this tick, 0 to 1; 0 without one.
    pub(super) accent: f32,
    /// Distance below the voice's loud level, dB.
    pub(super) below_loud: f32,
}

/// Seconds that speaking continues after the avatar's last sound.
const OWN_HOLD_SECONDS: f32 = 0.6;

/// Time constant of each of the two low-passes over the weights, seconds: 95 % of a change takes
/// 0.5 s.
const WEIGHT_FILTER_SECONDS: f32 = 0.105;

/// Current weights.
#[derive(Debug)]
pub(super) struct State {
    own: Voice,
    /// Weights after the first and the second low-pass, in the order of [`Weights`].
    halfway: [f32; 4],
    weights: [f32; 4],
    /// Whether a tick has run.
    is_started: bool,
}

impl State {
    pub(crate) fn new() -> Self {
        Self { own: Voice::new(), halfway: [1.0, 0.0, 0.0, 0.0], weights: [1.0, 0.0, 0.0, 0.0], is_started: false }
    }

    /// Advances by one tick and returns its weights.
    pub(crate) fn advance(&mut self, tick: &Tick) -> Weights {
        let own = self.own.hear(tick.cue.level, tick.seconds);
        let wanted = match tick.controls.attention {
            Attention::Auto if tick.controls.company.is_on() => match tick.controls.company.role {
                Some(Role::Speaking) => 3,
                Some(Role::Listening) => 1,
                Some(Role::Idle) | None => 0,
            },
            Attention::Auto if self.own.silent < OWN_HOLD_SECONDS => 3,
            Attention::Auto | Attention::Idle => 0,
            Attention::Listening => 1,
            Attention::Thinking => 2,
            Attention::Speaking => 3,
        };
        // The first tick has no previous weights.
        let share = if self.is_started { step(tick.seconds, WEIGHT_FILTER_SECONDS) } else { 1.0 };
        self.is_started = true;
        for (state, (halfway, weight)) in self.halfway.iter_mut().zip(&mut self.weights).enumerate() {
            let goal = if state == wanted { 1.0 } else { 0.0 };
            *halfway += share * (goal - *halfway);
            *weight += share * (*halfway - *weight);
        }
        // The weights of a loaded state may all be 0.
        let sum = self.weights.iter().sum::<f32>().max(1e-6);
        let [idle, listening, thinking, speaking] = self.weights.map(|weight| weight / sum);
        Weights { idle, listening, thinking, speaking, own }
    }

    /// Saves or loads the weights.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.own.state(pass)?;
        self.halfway.iter_mut().chain(&mut self.weights).try_for_each(|weight| pass.share(weight))?;
        pass.switch("attention", &mut self.is_started)?;
        Ok(())
    }
}

/// Time constant of the running mean that accents are measured against, seconds.
const ACCENT_MEAN_SECONDS: f32 = 0.35;

/// An accent: dB above the running mean, largest distance below the loud level in dB, and least seconds
/// between two.
const MIN_ACCENT_DB: f32 = 5.0;
const MAX_ACCENT_DB_BELOW_LOUD: f32 = 14.0;
const MIN_ACCENT_GAP_SECONDS: f32 = 0.3;

/// Least pause before a new phrase, least silence that ends a phrase, and least sound of a phrase that
/// has an end, seconds.
const MIN_PAUSE_SECONDS: f32 = 0.4;
const PHRASE_END_SECONDS: f32 = 0.2;
const MIN_PHRASE_SECONDS: f32 = 0.5;

/// Cap of the time counters, seconds.
const COUNTER_CAP_SECONDS: f32 = 1e3;

/// Phrases and accents of a voice.
#[derive(Debug)]
struct Voice {
    levels: VoiceLevels,
    /// Running mean of the level, dBFS.
    mean: f32,
    /// Level of the previous tick, dBFS.
    before: f32,
    /// Seconds since the last sound; seconds of sound in this phrase, short pauses excluded; seconds since
    /// the last accent.
    silent: f32,
    voiced: f32,
    accent: f32,
}

impl Voice {
    fn new() -> Self {
        Self {
            levels: VoiceLevels::default(),
            mean: SILENCE_DBFS,
            before: SILENCE_DBFS,
            silent: COUNTER_CAP_SECONDS,
            voiced: 0.0,
            accent: COUNTER_CAP_SECONDS,
        }
    }

    /// Processes the level of one tick, full scale 1.
    fn hear(&mut self, level: f32, seconds: f32) -> Heard {
        let level = decibels(level);
        let is_on = self.levels.hear(level, seconds);
        let mut heard = Heard { is_on, below_loud: self.levels.loud() - level, ..Heard::default() };
        let pause = self.silent;
        if is_on {
            if pause >= MIN_PAUSE_SECONDS {
                heard.begins = true;
                self.voiced = 0.0;
            }
            self.silent = 0.0;
            self.voiced = (self.voiced + seconds).min(COUNTER_CAP_SECONDS);
        } else {
            self.silent = (self.silent + seconds).min(COUNTER_CAP_SECONDS);
            heard.ends =
                pause < PHRASE_END_SECONDS && self.silent >= PHRASE_END_SECONDS && self.voiced >= MIN_PHRASE_SECONDS;
        }
        self.accent = (self.accent + seconds).min(COUNTER_CAP_SECONDS);
        let rise = level - self.mean;
        if is_on
            && rise > MIN_ACCENT_DB
            && level > self.before
            && level > self.levels.loud() - MAX_ACCENT_DB_BELOW_LOUD
            && self.accent >= MIN_ACCENT_GAP_SECONDS
        {
            heard.accent = (rise / (4.0 * MIN_ACCENT_DB)).clamp(0.25, 1.0);
            self.accent = 0.0;
        }
        // In silence the mean falls no further than the threshold at which a voice is detected.
        let floor = self.levels.floor();
        self.mean += step(seconds, ACCENT_MEAN_SECONDS) * (level.max(floor) - self.mean);
        self.before = level;
        heard
    }

    /// Saves or loads the voice.
    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.levels.state(pass)?;
        let mut values = [self.mean, self.before, self.silent, self.voiced, self.accent];
        pass.moderate(&mut values)?;
        [self.mean, self.before, self.silent, self.voiced, self.accent] = values;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::trial::{Trial, speech};
    use super::super::{Controls, Cue, Layer, LayerGains, Tick};
    use super::*;

    const SECONDS: f32 = 1.0 / 30.0;

    /// Advances the weights by one tick.
    fn advance(state: &mut State, trial: &Trial, controls: &Controls, own: f32) -> Weights {
        state.advance(&Tick {
            number: 0,
            seconds: SECONDS,
            seed: 0,
            cue: Cue { level: own, ..Cue::default() },
            controls,
            weights: Weights::default(),
            glance: None,
            rig: &trial.rig,
            lively: 0.0,
            shift: 0.0,
            stride: Default::default(),
            resting: [0.0; 2],
            gain: 1.0,
        })
    }

    fn as_array(weights: &Weights) -> [f32; 4] {
        [weights.idle, weights.listening, weights.thinking, weights.speaking]
    }

    #[test]
    fn weights_sum_to_1_and_never_jump() {
        let trial = Trial::new(&[Layer::Gaze], 0);
        let (mut state, mut controls) = (State::new(), Controls::new(LayerGains::ON));
        let mut before: Option<[f32; 4]> = None;
        let mut largest = 0.0_f32;
        for tick in 0..900 {
            controls.attention = Attention::ALL[tick / 37 % 5];
            let weights = as_array(&advance(&mut state, &trial, &controls, speech(tick)));
            assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-5, "{weights:?}");
            assert!(weights.iter().all(|weight| (0.0..=1.0 + 1e-6).contains(weight)), "{weights:?}");
            if let Some(before) = before {
                let step = weights.iter().zip(before).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
                assert!(step < 0.13, "{before:?} {weights:?}");
                largest = largest.max(weights[2]);
            }
            before = Some(weights);
        }
        assert!(largest > 0.95, "{largest}");
    }

    #[test]
    fn auto_follows_the_voice_however_quiet() {
        let trial = Trial::new(&[Layer::Gaze], 0);
        for loudness in [1.0, 0.1, 0.01] {
            let (mut state, controls) = (State::new(), Controls::new(LayerGains::ON));
            let mut tell = |ticks: usize, own: f32| {
                let mut weights = Weights::default();
                for tick in 0..ticks {
                    // A pause begins after some time of speech.
                    weights = advance(&mut state, &trial, &controls, own * speech(tick) * loudness);
                }
                as_array(&weights)
            };
            assert!(tell(60, 0.0)[0] > 0.99);
            assert!(tell(57, 1.0)[3] > 0.95, "{loudness}");
            // Speaking continues for 0.6 s.
            assert!(tell(12, 0.0)[3] > 0.95);
            assert!(tell(40, 0.0)[0] > 0.9);
        }
    }

    #[test]
    fn noise_becomes_silence_and_phrases_have_ends() {
        let mut voice = Voice::new();
        let on = (0..900).filter(|_| voice.hear(0.002, SECONDS).is_on).count();
        assert!(on < 450, "{on}");
        assert!(!voice.hear(0.002, SECONDS).is_on);

        let mut voice = Voice::new();
        let heard: Vec<Heard> = (0..780).map(|tick| voice.hear(speech(tick), SECONDS)).collect();
        let count = |is: fn(&Heard) -> bool| heard.iter().filter(|heard| is(heard)).count();
        assert_eq!(count(|heard| heard.begins), 10);
        assert_eq!(count(|heard| heard.ends), 10);
        let accents = count(|heard| heard.accent > 0.0);
        assert!((10..=60).contains(&accents), "{accents}");
        assert!(heard.iter().all(|heard| (0.0..=1.0).contains(&heard.accent)));
    }

    #[test]
    fn levels_that_are_no_numbers_do_nothing_bad() {
        let mut voice = Voice::new();
        for level in [f32::NAN, f32::INFINITY, -1.0, 1e30, 0.0] {
            voice.hear(level, SECONDS);
            let values = [voice.levels.loud(), voice.mean, voice.before];
            assert!(values.iter().all(|value| value.is_finite()), "{level} {values:?}");
        }
    }
}
