//! The audio side of a session: mixes the channels, resamples, and fills the ring.

use std::sync::atomic::Ordering;

use umo_core_base::memory::{Arena, Slice};
use umo_core_base::samples::{mix, silence_unusable};
use umo_core_base::state::{StateError, StatePass};
use umo_core_model::audio::resample::Resampler;
use umo_core_model::config::Config;

use super::{Pushed, SessionError, Shared};
use crate::link::Epoch;

/// Upper bound of a session's sample frames: 180 years at 192 kHz.
const MAX_TAKEN: u64 = 1 << 50;

/// Sample frames mixed at a time.
const PIECE: usize = 128;

#[derive(Debug)]
pub(crate) struct Input {
    resampler: Resampler,
    channels: usize,
    sample_rate: usize,
    frame_rate: usize,
    /// One piece, all channels interleaved.
    interleaved: Slice<f32>,
    epoch: Epoch,
    /// Sample frames taken since the session's creation or last reset.
    taken: u64,
    /// Sample frames among them from before the present stream.
    base: u64,
    finished: bool,
    /// Samples of the ring that are reserved for the end of the resampler's stream.
    reserve: usize,
}

impl Input {
    /// `resampler` converts from the session's rate to the model's.
    pub(super) fn new_in(
        resampler: Resampler,
        sample_rate: usize,
        channels: usize,
        config: &Config,
        arena: &Arena,
    ) -> Self {
        Self {
            reserve: resampler.most_left(),
            resampler,
            channels,
            sample_rate,
            frame_rate: config.frame_rate,
            interleaved: arena.filled(0.0, PIECE * channels),
            epoch: Epoch::default(),
            taken: 0,
            base: 0,
            finished: false,
        }
    }

    /// Settings that a state must share with this session, besides the model.
    pub(super) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("sample rate", self.sample_rate as u64)?;
        pass.same("number of channels", self.channels as u64)
    }

    /// Describes the audio side and the values that it publishes, with `waiting` samples in the
    /// ring.
    pub(super) fn state(&mut self, pass: &mut StatePass, shared: &Shared, waiting: usize) -> Result<(), StateError> {
        self.epoch.state(pass)?;
        let taken = pass.number("samples taken", &mut self.taken, MAX_TAKEN)?;
        let base = pass.number("samples taken", &mut self.base, taken)?;
        let finished = pass.switch("end of audio", &mut self.finished)?;
        let start = shared.link.input_start_state(pass)?;
        let left = self.resampler.state(pass, if finished { 0 } else { taken - base.min(taken) })?;
        pass.must(waiting + left <= shared.link.audio.capacity(), "room for audio")?;
        if pass.loads() {
            shared.backlog.begin(taken - base);
            shared.link.restore_input(self.epoch, start, base, finished.then(|| self.frames()));
        }
        Ok(())
    }

    /// Frames of the audio taken since the stream's start.
    fn frames(&self) -> u64 {
        (self.taken - self.base) * self.frame_rate as u64 / self.sample_rate as u64
    }

    /// Restarts if the session was interrupted or reset.
    fn sync_epoch(&mut self, shared: &Shared) {
        let epoch = shared.link.epoch();
        if epoch == self.epoch {
            return;
        }
        self.resampler.reset();
        self.finished = false;
        if epoch.resets != self.epoch.resets {
            self.taken = 0;
        }
        self.base = self.taken;
        self.epoch = epoch;
        shared.backlog.begin(0);
        shared.link.start_input(epoch, self.taken);
    }

    /// Takes as many whole frames of `samples` as there is room for, and reports them to the engine.
    pub(super) fn push<T>(
        &mut self,
        shared: &Shared,
        samples: &[T],
        float: impl Fn(&T) -> f32,
    ) -> Result<Pushed, SessionError> {
        if !samples.len().is_multiple_of(self.channels) {
            return Err(SessionError::Uneven { got: samples.len(), channels: self.channels });
        }
        self.sync_epoch(shared);
        if self.finished {
            return Err(SessionError::Finished);
        }
        let mut pushed = Pushed::default();
        for piece in samples.chunks(PIECE * self.channels) {
            // Without the reserve nothing can be pushed, not even the first few samples: the filter
            // outputs nothing for them now, but flushes its tail at the end of the stream.
            let Some(room) = shared.link.audio_room().checked_sub(self.reserve) else { break };
            let whole = piece.len() / self.channels;
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
            self.resampler.push(&mono[..frames], |samples| shared.link.push_audio(samples));
            pushed.taken += frames;
            self.taken += frames as u64;
            if frames < whole {
                break;
            }
        }
        shared.backlog.push(self.taken - self.base);
        shared.stats.overruns.fetch_add((samples.len() / self.channels - pushed.taken) as u64, Ordering::Relaxed);
        shared.stats.silenced.fetch_add(pushed.silenced as u64, Ordering::Relaxed);
        if pushed.taken > 0 {
            shared.link.audio_pushed(shared.host.clock.nanos());
            shared.host.clock.hear();
        }
        Ok(pushed)
    }

    /// Ends the stream, unless it has ended already.
    pub(super) fn finish(&mut self, shared: &Shared) {
        self.sync_epoch(shared);
        if !self.finished {
            self.finished = true;
            self.resampler.finish(|samples| shared.link.push_audio(samples));
            shared.link.end_input(self.frames(), shared.host.clock.nanos());
            shared.host.clock.hear();
        }
    }
}
