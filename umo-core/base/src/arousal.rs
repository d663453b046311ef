//! Arousal of a voice: how lively it speaks, from its sound alone (SPEC 2.22).
//!
//! ```text
//! samples ─▶ two low-passes ─┬─▶ 4 kHz ─▶ pitch and harmonicity ─┐
//!     │                      └─▶ energy below and above 1 kHz ───┼─▶ means over seconds ─▶ 0 to 1
//!     └─▶ level ─▶ voice or not ──────────────────────────────────┘
//! ```
//! Everything is causal and relative: to the population's means, and to the speaker's last half minute. A gain changes
//! nothing but what the noise of 16 bits hides.

use crate::functions::Functions;
use crate::memory::{Arena, Slice};
use crate::state::{StateError, StatePass};
use crate::voice::{SILENCE_DBFS, VoiceLevels, decibels};

/// Arousal of an ordinary voice, and of no voice.
pub const ORDINARY: f32 = 0.5;

/// Values a second.
pub const RATE: u32 = 10;

/// Steps of the analysis a second, and in a value.
const STEPS: u64 = 40;
const STEPS_PER_VALUE: u32 = 4;
const STEP_SECONDS: f32 = 1.0 / STEPS as f32;

/// Rate of the samples in which the pitch is sought, hertz; corner of the low-passes before it.
const PITCH_RATE: f32 = 4000.0;
const CORNER_HERTZ: f32 = 1000.0;
/// Window of the pitch, and its least and largest lag: 400 to 60 Hz.
const WINDOW: usize = 160;
const LEAST_LAG: usize = 10;
const MOST_LAG: usize = 66;
const HISTORY: usize = WINDOW + MOST_LAG + 2;
/// Least height of a peak of the normalised difference, and share of the highest one that the first must have (McLeod
/// and Wyvill 2005).
const LEAST_PEAK: f32 = 0.3;
const PEAK_SHARE: f32 = 0.85;
/// Harmonicity from which a step is voiced.
const VOICED: f32 = 0.6;

/// Largest step of the pitch, semitones: octave errors count no more.
const MOST_SEMITONES: f32 = 4.0;
/// Largest step of the level, dB.
const MOST_RISE: f32 = 20.0;
/// Depth of the level's modulation that counts, dB below the loud parts.
const MODULATION_DB: f32 = 40.0;
/// Height of a syllable's level above its surroundings at which it begins, and below them at which it ends, dB.
const SYLLABLE_DB: f32 = 1.0;

/// Time constants in seconds: of a syllable's peak, of its surroundings, of what is now, of a phrase, of prosody, of the
/// speaker.
const PEAK_SECONDS: f32 = 0.05;
const SYLLABLE_SECONDS: f32 = 0.4;
const NOW_SECONDS: f32 = 0.6;
const PHRASE_SECONDS: f32 = 2.0;
const PROSODY_SECONDS: f32 = 4.0;
const SPEAKER_SECONDS: f32 = 30.0;

/// Mean and standard deviation among readers of what tells a lively voice, and its weight: slope of the pitch in
/// semitones a step, syllables a second, rise and tilt in dB (`training/umo_train/speech/arousal.py` measures them).
const SLOPE: [f32; 3] = [0.62, 0.15, 0.35];
const SYLLABLES: [f32; 3] = [2.5, 0.6, 0.2];
const RISE: [f32; 3] = [4.3, 0.8, 0.5];
/// Little of it: some voices and microphones are bright.
const TILT: [f32; 3] = [-3.8, 2.5, 0.2];
/// Deviations that count.
const MOST_DEVIATIONS: f32 = 2.0;
/// What readers have of all this on average over a recording.
const USUAL: f32 = 0.12;
/// Weights of what is now above the speaker's own: per dB, per semitone, and per dB of tilt.
const LEVEL_WEIGHT: f32 = 0.4;
const PITCH_WEIGHT: f32 = 0.15;
const TILT_WEIGHT: f32 = 0.1;
/// Share of voiced steps below which a voice whispers, and what a whisper takes away.
const LEAST_VOICED: f32 = 0.4;
const WHISPER: f32 = 3.0;
/// Steps of a voice that make half of an opinion.
const EVIDENCE_STEPS: f32 = 16.0;
/// Modulation of a voice: dB from which there is any, and more for all of it. Noise and music are steadier.
const LEAST_MODULATION: f32 = 5.0;
const MODULATION_RANGE: f32 = 3.0;
/// Share of steps with sound that counts as speech.
const SPEECH_SHARE: f32 = 0.3;

/// A mean over an exponential window that is exact from its first value on.
#[derive(Clone, Copy, Debug)]
struct Mean {
    keeps: f32,
    weight: f32,
    value: f32,
}

impl Mean {
    fn new(seconds: f32) -> Self {
        Self { keeps: (-STEP_SECONDS / seconds).exponential(), weight: 0.0, value: 0.0 }
    }

    fn add(&mut self, value: f32) {
        self.weight = self.keeps * self.weight + 1.0;
        self.value += (value - self.value) / self.weight;
    }

    fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let mut values = [self.weight, self.value];
        pass.moderate(&mut values)?;
        [self.weight, self.value] = values;
        Ok(())
    }
}

/// Arousal of one stream's voice.
#[derive(Debug)]
pub struct Arousal {
    /// Samples a second, of the stream, and of the running step.
    sample_rate: u64,
    samples: u64,
    in_step: u32,
    /// Share by which the low-passes approach their input, and their outputs.
    share: f32,
    low: [f32; 2],
    /// Sums of squares of the step: of the samples, and of their parts below and above the corner.
    power: [f64; 3],
    /// Samples for each one of the pitch, and how many of them have passed.
    factor: u32,
    phase: u32,
    /// The newest samples of the pitch: a ring, and the place of the oldest.
    history: Slice<f32>,
    oldest: usize,
    voice: VoiceLevels,
    /// Level of the step before, dBFS; its pitch in semitones, if it was voiced; and whether it was in a syllable.
    before: f32,
    semitones: Option<f32>,
    is_syllable: bool,
    means: Means,
    /// Steps of the running value.
    steps: u32,
    value: f32,
}

/// Running means of the analysis.
#[derive(Clone, Copy, Debug)]
struct Means {
    /// Level of the voice now and of the speaker, dBFS.
    level: Mean,
    speaker_level: Mean,
    /// Change of the level from step to step, dB.
    rise: Mean,
    /// Share of steps with sound, and of voiced ones among them.
    sounds: Mean,
    voiced: Mean,
    /// Pitch now and of the speaker, semitones; and its change from step to step.
    pitch: Mean,
    speaker_pitch: Mean,
    slope: Mean,
    /// Energy above the corner less that below, of a phrase and of the speaker, dB.
    tilt: Mean,
    speaker_tilt: Mean,
    /// Level with its pauses, and its square distance from the mean.
    modulated: Mean,
    modulation: Mean,
    /// The same level of a syllable's peak and around it; syllables a second.
    peak: Mean,
    syllable: Mean,
    syllables: Mean,
}

impl Means {
    fn new() -> Self {
        Self {
            level: Mean::new(NOW_SECONDS),
            speaker_level: Mean::new(SPEAKER_SECONDS),
            rise: Mean::new(PHRASE_SECONDS),
            sounds: Mean::new(PROSODY_SECONDS),
            voiced: Mean::new(PHRASE_SECONDS),
            pitch: Mean::new(NOW_SECONDS),
            speaker_pitch: Mean::new(SPEAKER_SECONDS),
            slope: Mean::new(PROSODY_SECONDS),
            tilt: Mean::new(PHRASE_SECONDS),
            speaker_tilt: Mean::new(SPEAKER_SECONDS),
            modulated: Mean::new(PROSODY_SECONDS),
            modulation: Mean::new(PROSODY_SECONDS),
            peak: Mean::new(PEAK_SECONDS),
            syllable: Mean::new(SYLLABLE_SECONDS),
            syllables: Mean::new(PROSODY_SECONDS),
        }
    }

    fn all(&mut self) -> [&mut Mean; 15] {
        let Self { level, speaker_level, rise, sounds, voiced, pitch, speaker_pitch, slope, .. } = self;
        let Self { tilt, speaker_tilt, modulated, modulation, peak, syllable, syllables, .. } = self;
        [
            level,
            speaker_level,
            rise,
            sounds,
            voiced,
            pitch,
            speaker_pitch,
            slope,
            tilt,
            speaker_tilt,
            modulated,
            modulation,
            peak,
            syllable,
            syllables,
        ]
    }

    /// Arousal, 0 to 1.
    fn arousal(&self) -> f32 {
        let relative = |mean: Mean, [usual, deviation, weight]: [f32; 3]| {
            weight * ((mean.value - usual) / deviation).clamp(-MOST_DEVIATIONS, MOST_DEVIATIONS)
        };
        let voice = relative(self.slope, SLOPE)
            + relative(self.syllables, SYLLABLES)
            + relative(self.rise, RISE)
            + relative(self.tilt, TILT);
        let own = LEVEL_WEIGHT * (self.level.value - self.speaker_level.value)
            + PITCH_WEIGHT * (self.pitch.value - self.speaker_pitch.value)
            + TILT_WEIGHT * (self.tilt.value - self.speaker_tilt.value);
        let whisper = WHISPER * (1.0 - self.voiced.value / LEAST_VOICED).max(0.0);
        let evidence = |mean: Mean| mean.weight / (mean.weight + EVIDENCE_STEPS);
        let score = evidence(self.slope) * (voice + own - USUAL) - evidence(self.voiced) * whisper;
        let modulation = (self.modulation.value.max(0.0).sqrt() - LEAST_MODULATION) / MODULATION_RANGE;
        let speech = modulation.clamp(0.0, 1.0) * (self.sounds.value / SPEECH_SHARE).min(1.0);
        ORDINARY + 0.5 * speech * score.hyperbolic_tangent()
    }
}

impl Arousal {
    /// Creates the state before a stream of `sample_rate` samples a second, in memory of `arena`.
    pub fn new_in(sample_rate: usize, arena: &Arena) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small positive number")]
        let factor = ((sample_rate as f32 / PITCH_RATE).round() as u32).max(1);
        Self {
            sample_rate: sample_rate as u64,
            samples: 0,
            in_step: 0,
            share: 1.0 - (-std::f32::consts::TAU * CORNER_HERTZ / sample_rate as f32).exponential(),
            low: [0.0; 2],
            power: [0.0; 3],
            factor,
            phase: 0,
            history: arena.filled(0.0, HISTORY),
            oldest: 0,
            voice: VoiceLevels::default(),
            before: SILENCE_DBFS,
            semitones: None,
            is_syllable: false,
            means: Means::new(),
            steps: 0,
            value: ORDINARY,
        }
    }

    /// Returns to the start of a stream.
    pub fn reset(&mut self) {
        (self.samples, self.in_step, self.phase, self.oldest, self.steps) = (0, 0, 0, 0, 0);
        (self.low, self.power, self.before, self.value) = ([0.0; 2], [0.0; 3], SILENCE_DBFS, ORDINARY);
        self.history.fill(0.0);
        (self.semitones, self.is_syllable) = (None, false);
        (self.voice, self.means) = (VoiceLevels::default(), Means::new());
    }

    /// Hears samples; passes on each value that is known then, [`RATE`] of them a second. Never allocates.
    pub fn push(&mut self, samples: &[f32], mut value: impl FnMut(f32)) {
        let mut rest = samples;
        while !rest.is_empty() {
            let ends = (self.samples * STEPS / self.sample_rate + 1) * self.sample_rate;
            let left = ends.div_ceil(STEPS) - self.samples;
            let count = usize::try_from(left).unwrap_or(usize::MAX).min(rest.len());
            let (here, after) = rest.split_at(count);
            here.iter().for_each(|&sample| self.hear(sample));
            (self.samples, rest) = (self.samples + count as u64, after);
            if count as u64 == left {
                self.step();
                if self.steps == STEPS_PER_VALUE {
                    self.steps = 0;
                    value(self.value);
                }
            }
        }
    }

    fn hear(&mut self, sample: f32) {
        self.low[0] += self.share * (sample - self.low[0]);
        self.low[1] += self.share * (self.low[0] - self.low[1]);
        let low = self.low[1];
        let high = sample - low;
        for (sum, part) in self.power.iter_mut().zip([sample, low, high]) {
            *sum += f64::from(part * part);
        }
        self.in_step += 1;
        self.phase += 1;
        if self.phase == self.factor {
            self.phase = 0;
            self.history[self.oldest] = low;
            self.oldest = (self.oldest + 1) % HISTORY;
        }
    }

    /// Ends a step.
    fn step(&mut self) {
        let [all, low, high] = std::mem::take(&mut self.power);
        #[expect(clippy::cast_possible_truncation, reason = "a level's precision is enough")]
        let level = decibels((all / f64::from(self.in_step.max(1))).sqrt() as f32);
        self.in_step = 0;
        self.steps += 1;
        // In silence the low-passes would stay at denormal numbers, which take long.
        self.low = self.low.map(|low| if low.abs() < 1e-15 { 0.0 } else { low });
        let is_on = self.voice.hear(level, STEP_SECONDS);
        let means = &mut self.means;
        let modulated = level.max(self.voice.loud() - MODULATION_DB);
        means.modulated.add(modulated);
        means.modulation.add((modulated - means.modulated.value).powi(2));
        means.sounds.add(f32::from(u8::from(is_on)));
        means.peak.add(modulated);
        means.syllable.add(modulated);
        let edge = if self.is_syllable { -SYLLABLE_DB } else { SYLLABLE_DB };
        let is_syllable = means.peak.value - means.syllable.value > edge;
        let was_syllable = std::mem::replace(&mut self.is_syllable, is_syllable);
        let semitones_before = self.semitones.take();
        if is_on {
            means.level.add(level);
            means.speaker_level.add(level);
            means.rise.add((level - self.before).abs().min(MOST_RISE));
            means.syllables.add(if is_syllable && !was_syllable { STEPS as f32 } else { 0.0 });
            let mut samples = [0.0; HISTORY];
            let (newer, older) = self.history.split_at(self.oldest);
            samples[..older.len()].copy_from_slice(older);
            samples[older.len()..].copy_from_slice(newer);
            let (lag, harmonicity) = pitch(&samples);
            let is_voiced = harmonicity > VOICED;
            means.voiced.add(f32::from(u8::from(is_voiced)));
            if is_voiced {
                // Relative to 100 Hz; `factor` may not divide the rate.
                let hertz = self.sample_rate as f32 / self.factor as f32 / lag;
                let semitones = 12.0 * (hertz / 100.0).logarithm_2();
                means.pitch.add(semitones);
                means.speaker_pitch.add(semitones);
                if let Some(before) = semitones_before {
                    means.slope.add((semitones - before).abs().min(MOST_SEMITONES));
                }
                self.semitones = Some(semitones);
                #[expect(clippy::cast_possible_truncation, reason = "a level's precision is enough")]
                let tilt = (10.0 * ((high + 1e-12) / (low + 1e-12)).logarithm_10()) as f32;
                means.tilt.add(tilt);
                means.speaker_tilt.add(tilt);
            }
        }
        self.before = level;
        self.value = self.means.arousal().clamp(0.0, 1.0);
    }

    /// Saves or loads the state between two pushes.
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("arousal", &mut self.samples, 1 << 50)?;
        for (count, most) in [
            (&mut self.in_step, self.sample_rate),
            (&mut self.phase, u64::from(self.factor) - 1),
            (&mut self.steps, u64::from(STEPS_PER_VALUE) - 1),
        ] {
            let value = pass.limited("arousal", (*count).into(), most)?;
            if pass.loads() {
                *count = u32::try_from(value).unwrap_or_default();
            }
        }
        pass.length("arousal", &mut self.oldest, HISTORY as u64 - 1)?;
        pass.f32s(&mut self.low)?;
        self.power.iter_mut().try_for_each(|sum| pass.sum(sum))?;
        pass.f32s(&mut self.history)?;
        self.voice.state(pass)?;
        self.means.all().into_iter().try_for_each(|mean| mean.state(pass))?;
        let mut is_voiced = self.semitones.is_some();
        let mut values = [self.before, self.semitones.unwrap_or_default()];
        pass.moderate(&mut values)?;
        pass.switch("arousal", &mut is_voiced)?;
        pass.switch("arousal", &mut self.is_syllable)?;
        self.before = values[0];
        self.semitones = is_voiced.then_some(values[1]);
        pass.share(&mut self.value)
    }
}

/// Lag of the pitch in the newest samples, and its harmonicity, 0 to 1, by the normalised square difference (McLeod and
/// Wyvill 2005); 0 without a peak.
fn pitch(samples: &[f32; HISTORY]) -> (f32, f32) {
    let newest = &samples[HISTORY - WINDOW..];
    let own: f32 = dot(newest, newest);
    let mut heights = [0.0; MOST_LAG + 2];
    let first = LEAST_LAG - 2;
    let mut power =
        dot(&samples[HISTORY - WINDOW - first..HISTORY - first], &samples[HISTORY - WINDOW - first..HISTORY - first]);
    for (lag, height) in heights.iter_mut().enumerate().skip(first) {
        let start = HISTORY - WINDOW - lag;
        if lag > first {
            power += samples[start].powi(2) - samples[start + WINDOW].powi(2);
        }
        *height = 2.0 * dot(newest, &samples[start..start + WINDOW]) / (own + power.max(0.0) + 1e-9);
    }
    let is_peak =
        |lag: usize| heights[lag] > LEAST_PEAK && heights[lag] >= heights[lag - 1] && heights[lag] > heights[lag + 1];
    let peaks = || (LEAST_LAG - 1..=MOST_LAG).filter(|&lag| is_peak(lag));
    let highest = peaks().map(|lag| heights[lag]).fold(0.0, f32::max);
    let Some(lag) = peaks().find(|&lag| heights[lag] >= PEAK_SHARE * highest) else { return (0.0, 0.0) };
    let [before, height, after] = [heights[lag - 1], heights[lag], heights[lag + 1]];
    let curve = before - 2.0 * height + after;
    let offset = if curve < 0.0 { 0.5 * (before - after) / curve } else { 0.0 };
    (lag as f32 + offset, height)
}

/// Sum of products, in lanes that a compiler can keep in a register.
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut lanes = [0.0; 8];
    for (a, b) in a.as_chunks::<8>().0.iter().zip(b.as_chunks::<8>().0) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    lanes.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SAMPLES: usize = 16_000;

    fn values(samples: &[f32], piece: usize) -> Vec<f32> {
        let mut arousal = Arousal::new_in(SAMPLES, &Arena::system());
        let mut values = Vec::new();
        samples.chunks(piece).for_each(|samples| arousal.push(samples, |value| values.push(value)));
        values
    }

    /// A voice of syllables and phrases, whose pitch is `hertz`, moves by `range`, and falls off with `tilt`.
    #[expect(clippy::cast_possible_truncation, reason = "samples")]
    fn voice(seconds: usize, hertz: f64, range: f64, tilt: f64) -> Vec<f32> {
        let mut phase = 0.0;
        let sample = |at: usize| {
            let time = at as f64 / SAMPLES as f64;
            phase += std::f64::consts::TAU / SAMPLES as f64
                * hertz
                * (1.0 + range * (std::f64::consts::TAU * 2.8 * time).sin());
            let tone: f64 = (1..9).map(|k| (f64::from(k) * phase).sin() / f64::from(k).powf(tilt)).sum();
            (loudness(time) * tone + 1e-4 * hiss(at)) as f32
        };
        (0..seconds * SAMPLES).map(sample).collect()
    }

    fn loudness(time: f64) -> f64 {
        let syllable = (std::f64::consts::TAU * 4.3 * time).sin().max(0.0);
        if time % 1.9 < 1.5 { 0.05 * syllable } else { 0.0 }
    }

    fn hiss(at: usize) -> f64 {
        (at as f64 * at as f64 * 0.37).sin()
    }

    #[expect(clippy::cast_possible_truncation, reason = "samples")]
    fn whisper(seconds: usize) -> Vec<f32> {
        let sample = |at: usize| ((0.3 * loudness(at as f64 / SAMPLES as f64) + 1e-4) * hiss(at)) as f32;
        (0..seconds * SAMPLES).map(sample).collect()
    }

    fn mean(values: &[f32]) -> f32 {
        values.iter().sum::<f32>() / values.len() as f32
    }

    /// The voice of `training/umo_train/speech/arousal.py`, whose `golden` writes the values.
    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "samples")]
    fn values_are_those_of_the_reference() {
        let golden = include_str!("arousal/golden.txt").lines().map(|line| line.parse::<f32>().unwrap());
        let mut phase = 0.0;
        let sample = |at: usize| {
            let time = at as f64 / SAMPLES as f64;
            let lively = if time >= 6.0 { 1.0 } else { 0.0 };
            let turn = std::f64::consts::TAU * 0.7 * time;
            let hertz = (110.0 + 50.0 * lively) * (1.0 + (0.05 + 0.2 * lively) * turn.sin());
            phase += std::f64::consts::TAU / SAMPLES as f64 * hertz;
            let tone: f64 = (1..9).map(|k| (f64::from(k) * phase).sin() / f64::from(k).powf(1.6 - 0.6 * lively)).sum();
            let sound = if time >= 9.0 { 0.3 * hiss(at) } else { tone };
            (loudness(time) * (1.0 + 2.0 * lively) * sound + 1e-4 * hiss(at)) as f32
        };
        let found = values(&(0..12 * SAMPLES).map(sample).collect::<Vec<_>>(), 4800);
        assert_eq!(found.len(), golden.clone().count());
        for (number, (found, golden)) in found.iter().zip(golden).enumerate() {
            assert!((found - golden).abs() < 0.005, "{number}: {found}, not {golden}");
        }
    }

    #[test]
    fn livelier_voices_have_more_at_every_gain() {
        let voices = [whisper(6), voice(6, 110.0, 0.04, 2.2), voice(6, 150.0, 0.2, 1.4), voice(6, 200.0, 0.3, 0.7)];
        for gain in [4.0, 0.4, 0.04] {
            let found = voices
                .each_ref()
                .map(|voice| mean(&values(&voice.iter().map(|sample| gain * sample).collect::<Vec<_>>(), 1600)[20..]));
            assert!(found.is_sorted() && found[1] > found[0] + 0.02 && found[3] > found[1] + 0.3, "{gain}: {found:?}");
        }
    }

    #[test]
    #[expect(clippy::cast_possible_truncation, reason = "samples")]
    fn noise_and_music_have_none_and_neither_has_silence_after_a_voice() {
        let noise: Vec<f32> = (0..8 * SAMPLES).map(|at| (0.1 * hiss(at)) as f32).collect();
        let chord = |at: usize| {
            let time = at as f64 / SAMPLES as f64;
            let notes = [220.0, 277.2, 329.6].map(|hertz| (std::f64::consts::TAU * hertz * time).sin());
            // Struck twice a second.
            (0.05 * notes.iter().sum::<f64>() * (0.4 + 0.6 * (-3.0 * (time % 0.5)).exp())) as f32
        };
        let music: Vec<f32> = (0..8 * SAMPLES).map(chord).collect();
        for sound in [noise, music] {
            let found = values(&sound, 1600);
            assert!(found[20..].iter().all(|value| (value - ORDINARY).abs() < 0.05), "{found:?}");
        }
        let mut sound = voice(6, 200.0, 0.3, 0.7);
        let spoken = *values(&sound, 1600).last().unwrap();
        sound.resize(26 * SAMPLES, 0.0);
        let after = *values(&sound, 1600).last().unwrap();
        assert!(spoken > 0.6 && (after - ORDINARY).abs() < 0.05, "{spoken}, then {after}");
    }

    #[test]
    fn neither_cuts_nor_saves_nor_resets_change_a_bit() {
        let sound = voice(4, 140.0, 0.2, 1.4);
        let whole = values(&sound, sound.len());
        assert_eq!(values(&sound, 1), whole);
        assert_eq!(values(&sound, 777), whole);
        let (first, second) = sound.split_at(31_234);
        let mut before = Arousal::new_in(SAMPLES, &Arena::system());
        let mut found = Vec::new();
        before.push(first, |value| found.push(value));
        let mut bytes = vec![0; 8192];
        let mut pass = StatePass::save(&mut bytes, 0, 0);
        before.state(&mut pass).unwrap();
        let length = pass.end().unwrap();
        let mut after = Arousal::new_in(SAMPLES, &Arena::system());
        after.push(second, |_| {});
        let mut pass = StatePass::load(&bytes[..length], 0);
        after.state(&mut pass).unwrap();
        after.push(second, |value| found.push(value));
        assert_eq!(found, whole);
        after.reset();
        found.clear();
        after.push(&sound, |value| found.push(value));
        assert_eq!(found, whole);
    }
}
