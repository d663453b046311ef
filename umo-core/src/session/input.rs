//! The audio side of a session: channels mixed, resampled, put in the ring.

use std::sync::atomic::Ordering;

use super::{Cue, Pushed, SessionError, Shared};
use crate::audio::resample::{Resampler, mix};
use crate::audio::silence_unusable;
use crate::config::Config;
use crate::error::StepError;
use crate::memory::filled;
use crate::state::{StateError, StatePass};

/// Sample frames that no session is given: at 192 kHz, 180 years.
const MOST_TAKEN: u64 = 1 << 50;
/// Samples that no session's ring was ever given.
const MOST_PLACE: u64 = 1 << 62;

/// Sample frames that are mixed at a time.
const PIECE: usize = 128;

#[derive(Debug)]
pub(crate) struct Input {
    resampler: Resampler,
    channels: usize,
    sample_rate: usize,
    frame_rate: usize,
    /// One piece of all channels.
    interleaved: Box<[f32]>,
    cue: Cue,
    /// Sample frames taken since the session was made, or reset.
    taken: u64,
    /// Of these, before the stream's start.
    base: u64,
    finished: bool,
    /// Samples in the ring that are kept free for the end of the resampler's stream.
    reserve: usize,
}

impl Input {
    pub(super) fn new(sample_rate: usize, channels: usize, config: &Config) -> Result<Self, StepError> {
        let resampler = Resampler::new(sample_rate, config.audio.sample_rate)?;
        Ok(Self {
            reserve: resampler.most_left(),
            resampler,
            channels,
            sample_rate,
            frame_rate: config.frame_rate,
            interleaved: filled(0.0, PIECE * channels).into(),
            cue: Cue::default(),
            taken: 0,
            base: 0,
            finished: false,
        })
    }

    pub(super) fn channels(&self) -> usize {
        self.channels
    }

    pub(super) fn resampler(&self) -> &Resampler {
        &self.resampler
    }

    /// Room that the end of a stream may take.
    pub(super) fn most_left(&self) -> usize {
        self.reserve
    }

    /// What a state must have in common with this session, beside the model.
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("sample rate", self.sample_rate as u64)?;
        pass.same("number of channels", self.channels as u64)
    }

    /// Describes the audio side, and what it tells the others, with so much audio in the ring.
    pub(super) fn state(&mut self, pass: &mut StatePass, shared: &Shared, waiting: usize) -> Result<(), StateError> {
        self.cue.state(pass)?;
        let taken = pass.number("samples taken", &mut self.taken, MOST_TAKEN)?;
        let base = pass.number("samples taken", &mut self.base, taken)?;
        let finished = pass.switch("end of audio", &mut self.finished)?;
        let heard_from = pass.limited("place of audio", shared.heard_from.load(Ordering::Relaxed), MOST_PLACE)?;
        let left = self.resampler.state(pass, if finished { 0 } else { taken - base.min(taken) })?;
        pass.must(waiting + left <= shared.audio.capacity(), "room for audio")?;
        if pass.loads() {
            shared.total.store(if finished { self.frames() } else { super::ENDLESS }, Ordering::SeqCst);
            shared.sample_base.store(base, Ordering::Relaxed);
            shared.begin_backlog(taken - base);
            shared.heard_from.store(heard_from, Ordering::Relaxed);
            shared.heard_cue.store(self.cue.number, Ordering::SeqCst);
        }
        Ok(())
    }

    /// Frames of the audio that was taken since the stream's start.
    fn frames(&self) -> u64 {
        (self.taken - self.base) * self.frame_rate as u64 / self.sample_rate as u64
    }

    /// Starts anew where somebody interrupted or reset the session.
    fn follow(&mut self, shared: &Shared) {
        let cue = shared.cue();
        if cue == self.cue {
            return;
        }
        self.resampler.reset();
        self.finished = false;
        if cue.resets != self.cue.resets {
            self.taken = 0;
        }
        self.base = self.taken;
        self.cue = cue;
        shared.total.store(super::ENDLESS, Ordering::Relaxed);
        shared.sample_base.store(self.taken, Ordering::Relaxed);
        shared.begin_backlog(0);
        shared.heard_from.store(shared.audio.written(), Ordering::Relaxed);
        // What is written above is there for those who see the number.
        shared.heard_cue.store(cue.number, Ordering::SeqCst);
    }

    pub(super) fn push<T>(
        &mut self,
        shared: &Shared,
        samples: &[T],
        float: impl Fn(&T) -> f32,
    ) -> Result<Pushed, SessionError> {
        self.follow(shared);
        if self.finished {
            return Err(SessionError::Finished);
        }
        let mut pushed = Pushed::default();
        for piece in samples.chunks(PIECE * self.channels) {
            let (whole, room) = (piece.len() / self.channels, shared.audio.room().saturating_sub(self.reserve));
            let mut frames = whole;
            while frames > 0 && self.resampler.most_given(frames) > room {
                frames -= 1;
            }
            let piece = &piece[..frames * self.channels];
            let interleaved = &mut self.interleaved[..piece.len()];
            interleaved.iter_mut().zip(piece).for_each(|(slot, sample)| *slot = float(sample));
            pushed.silenced += silence_unusable(interleaved);
            let mut mono = [0.0; PIECE];
            mix(interleaved, self.channels, &mut mono);
            self.resampler.push(&mono[..frames], |samples| put(shared, samples));
            pushed.taken += frames;
            self.taken += frames as u64;
            if frames < whole {
                break;
            }
        }
        shared.pushed.store(self.taken - self.base, Ordering::Relaxed);
        Ok(pushed)
    }

    /// Ends the stream; whether it had not ended before.
    pub(super) fn finish(&mut self, shared: &Shared) -> bool {
        self.follow(shared);
        if self.finished {
            return false;
        }
        self.finished = true;
        self.resampler.finish(|samples| put(shared, samples));
        shared.total.store(self.frames(), Ordering::SeqCst);
        true
    }
}

/// Appends samples, for which the caller made sure that there is room.
fn put(shared: &Shared, samples: &[f32]) {
    let written = shared.audio.push(samples.iter().map(|sample| sample.to_bits()));
    debug_assert_eq!(written, samples.len(), "the ring was said to have room");
}
