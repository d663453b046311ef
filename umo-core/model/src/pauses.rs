//! Pauses of a stream's voice at its keyframes, from the samples that its chunks wait for anyway.

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};
use umo_core_base::voice::{VoiceLevels, decibels};

/// Silence after which hands begin to come to rest, and after which they rest, seconds. Pauses within a phrase are
/// shorter.
const BEGIN_SECONDS: f32 = 0.6;
const FULL_SECONDS: f32 = 1.2;
/// Time before a sound at which hands are free again: a stroke is prepared before its accent. Seconds.
const PREPARE_SECONDS: f32 = 0.75;
/// Upper bound of the counted silence, keyframes.
const MOST: u64 = 1 << 20;

/// Where the voice sounds in the keyframes of a chunk and of its horizon.
#[derive(Debug)]
pub(crate) struct Pauses {
    levels: VoiceLevels,
    /// Whether there is a voice between a keyframe and the next: the chunk's keyframes, then those of the horizon.
    sounds: Slice<bool>,
    /// Keyframes of silence before them.
    silent: u64,
    /// Keyframes of a chunk.
    target: usize,
    /// Samples of a step of the levels, and its duration in seconds.
    hop: usize,
    hop_seconds: f32,
    /// Seconds from a keyframe to the next.
    seconds: f32,
}

impl Pauses {
    /// Creates the state before a stream, which is silence.
    pub(crate) fn new_in(
        (target, horizon): (usize, usize),
        (hop, hop_seconds): (usize, f32),
        seconds: f32,
        arena: &Arena,
    ) -> Self {
        let sounds = arena.filled(false, target + horizon);
        Self { levels: VoiceLevels::default(), sounds, silent: MOST, target, hop, hop_seconds, seconds }
    }

    /// Returns to the start of a stream.
    pub(crate) fn reset(&mut self) {
        (self.levels, self.silent) = (VoiceLevels::default(), MOST);
        self.sounds.fill(false);
    }

    /// Hears the next chunk's samples, which are `each` per keyframe.
    pub(crate) fn hear(&mut self, samples: &[f32], each: usize) {
        let new = samples.len() / each;
        if new <= self.target {
            // The chunk before is over.
            let before = &self.sounds[..new];
            let since = before.iter().rev().position(|&sound| sound);
            self.silent = since.map_or_else(|| MOST.min(self.silent + new as u64), |since| since as u64);
            self.sounds.copy_within(new.., 0);
        }
        let Self { levels, sounds, hop, hop_seconds, .. } = self;
        let first = sounds.len() - new;
        for (sound, samples) in sounds[first..].iter_mut().zip(samples.chunks_exact(each)) {
            *sound = false;
            for samples in samples.chunks(*hop) {
                let power = samples.iter().map(|sample| sample * sample).sum::<f32>() / samples.len() as f32;
                *sound |= levels.hear(decibels(power.sqrt()), *hop_seconds);
            }
        }
    }

    /// How far the hands are to rest at a keyframe of the chunk, 0 to 1: 0 while there is a voice or one follows.
    pub(crate) fn rest(&self, keyframe: usize) -> f32 {
        let (before, after) = self.sounds.split_at(keyframe + 1);
        let since =
            before.iter().rev().position(|&sound| sound).map_or(self.silent + before.len() as u64, |k| k as u64);
        let until = after.iter().position(|&sound| sound);
        if until.is_some_and(|until| (until + 1) as f32 * self.seconds < PREPARE_SECONDS) {
            return 0.0;
        }
        ((since as f32 * self.seconds - BEGIN_SECONDS) / (FULL_SECONDS - BEGIN_SECONDS)).clamp(0.0, 1.0)
    }

    /// Saves or loads the state between two chunks.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        self.levels.state(pass)?;
        pass.number("silence", &mut self.silent, MOST)?;
        self.sounds.iter_mut().try_for_each(|sound| pass.switch("sound", sound).map(drop))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HOP: usize = 320;
    /// Samples and seconds of a keyframe.
    const EACH: usize = 1600;
    const SECONDS: f32 = 0.1;
    const TARGET: usize = 5;

    fn pauses(horizon: usize) -> Pauses {
        Pauses::new_in((TARGET, horizon), (HOP, 0.02), SECONDS, &Arena::system())
    }

    /// How far hands rest at each keyframe of a sound with a level for each keyframe, silent at its end.
    fn rests(levels: &[f32], horizon: usize) -> Vec<f32> {
        let mut pauses = pauses(horizon);
        let sound = |keyframe: usize| levels.get(keyframe).copied().unwrap_or_default();
        let mut heard = 0;
        (0..levels.len().div_ceil(TARGET))
            .flat_map(|chunk| {
                let until = (chunk + 1) * TARGET + horizon;
                let samples: Vec<f32> = (heard..until).flat_map(|keyframe| [sound(keyframe); EACH]).collect();
                heard = until;
                pauses.hear(&samples, EACH);
                std::array::from_fn::<f32, TARGET, _>(|keyframe| pauses.rest(keyframe))
            })
            .collect()
    }

    /// A voice of 3 s, then silence of 3 s, then a voice.
    fn speech() -> Vec<f32> {
        let voice = |from: usize| (from..from + 30).map(|at| if at % 4 == 3 { 0.01 } else { 0.1 });
        voice(0).chain([0.0; 30]).chain(voice(0)).collect()
    }

    #[test]
    fn hands_rest_in_pauses_and_are_free_before_the_next_sound() {
        for (horizon, free_again) in [(0, 60), (5, 55)] {
            let rests = rests(&speech(), horizon);
            assert!(rests[..30].iter().all(|&rest| rest == 0.0), "{horizon}: {rests:?}");
            assert_eq!(rests[34], 0.0, "{horizon}: short pauses are part of a phrase");
            assert!(rests[38] > 0.0 && rests[38] < 1.0, "{horizon}: {}", rests[38]);
            assert!(rests[42..free_again].iter().all(|&rest| rest == 1.0), "{horizon}: {rests:?}");
            assert!(rests[60..].iter().all(|&rest| rest == 0.0), "{horizon}: {rests:?}");
            let waits = rests[55..60].iter().filter(|&&rest| rest == 0.0).count();
            assert_eq!(waits > 0, horizon > 0, "{horizon}: what is heard ahead counts");
        }
    }

    #[test]
    fn a_stream_begins_in_silence_and_steady_noise_is_no_voice() {
        assert!(rests(&[0.0; 20], 0).iter().all(|&rest| rest == 1.0));
        let noise = rests(&[0.002; 200], 0);
        assert!(noise[150..].iter().all(|&rest| rest == 1.0), "{noise:?}");
        // In noise, a voice is still heard.
        let mut levels = vec![0.002; 100];
        levels.extend(speech());
        assert!(rests(&levels, 0)[100..130].iter().all(|&rest| rest == 0.0));
    }
}
