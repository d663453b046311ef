//! One avatar of an [`Engine`](crate::engine::Engine), as its host sees it: audio goes in on one thread, frames come out on
//! another, and neither ever waits (SPEC 2, 2.8).
//!
//! ```text
//!  audio thread            any thread                  game thread
//!  push_audio, finish      interrupt, reset, set_*     pull_frames, sample_pose
//!       │                        │ cue                      ▲
//!       ▼                        ▼                          │
//!  mix, resample ──ring──► engine: chunks of many avatars ──ring──► ease, place, interpolate
//! ```
//! A *cue* is a number that [`Session::interrupt`] and [`Session::reset`] change: each of the three sides compares it with
//! the one that it saw last and starts anew by itself, so that nobody waits for anybody.

mod config;
pub(crate) mod delay;
mod error;
mod gain;
mod input;
mod output;
mod shared;
mod state;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, MutexGuard};
use std::time::Duration;

use crate::config::Sampling;
use crate::defect::Defect;
use crate::engine::Place;
use crate::lm::layout::MAX_PROMPT_TOKENS;
use crate::part::Part;
pub use crate::state::StateError;
pub use config::{AUDIO_SECONDS, Idle, MAX_CHANNELS, MAX_EASE, MAX_GAIN, MAX_RATE, MIN_RATE, SessionConfig};
pub use error::SessionError;
pub use output::{FrameView, Sampled};
pub(crate) use output::{Shown, words as frame_words, write as write_frame};
pub(crate) use shared::{Cue, ENDLESS, Failure, Making, NOBODY, Shared};
use shared::{Settings, try_lock};
pub(crate) use state::state_size;

/// The calls that exclude each other, as [`SessionError::Busy`] names them.
const INPUT: &str = "push_audio, finish, save or restore";
const OUTPUT: &str = "pull_frames, sample_pose, save or restore";
const SETTER: &str = "a setter, save or restore";

/// What a [`Session::push_audio`] took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Pushed {
    /// Sample frames (one sample of each channel) taken; what is left was not, because the engine is that far behind.
    pub taken: usize,
    /// Samples among them that were no usable number and became silence.
    pub silenced: usize,
}

/// What a session went through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stats {
    /// Chunks computed.
    pub chunks: u64,
    /// Frames computed.
    pub frames: u64,
    /// Frames whose chunk was done later than real time needs it.
    pub late_frames: u64,
    /// Frames that were dropped by an interrupt or a reset before they were shown.
    pub dropped_frames: u64,
    /// Sample frames that were not taken because there was no room.
    pub overruns: u64,
    /// Samples that were no usable number.
    pub silenced: u64,
}

/// How far motion is behind speech.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Latency {
    /// Samples of future audio, at the session's rate, that a frame needs at most, resampling included: what no processor
    /// can shorten.
    pub algorithmic_samples: usize,
    /// Time from a chunk's last sample, or the end of the chunk before where that is later, to its frames: median.
    pub compute_p50: Duration,
    /// Its 99th percentile.
    pub compute_p99: Duration,
    /// Its 99.9th percentile.
    pub compute_p999: Duration,
    /// Its largest.
    pub compute_max: Duration,
    /// Samples, at the session's rate, by which the newest frame is behind the newest audio now, beyond
    /// [`algorithmic_samples`](Self::algorithmic_samples): 0 while the engine keeps up.
    pub backlog_samples: u64,
    /// The largest backlog since the session was made.
    pub backlog_max_samples: u64,
}

/// One avatar. Every call may come from any thread; two threads in the same call at once get [`SessionError::Busy`].
///
/// After it is made, no call allocates, waits, or makes a system call, but to wake the engine.
#[derive(Debug)]
pub struct Session {
    shared: Arc<Shared>,
    /// Where the engine's side of it is.
    place: Place,
    /// Most bytes of a state.
    state_size: usize,
}

impl Session {
    pub(crate) fn new(shared: Arc<Shared>, place: Place, state_size: usize) -> Self {
        Self { shared, place, state_size }
    }

    /// Takes interleaved samples, full scale 1, for the avatar to speak: as many as there is room for.
    ///
    /// Wait-free: meant for a real-time audio thread. Samples that are no number, or louder than
    /// [`LOUDEST`](crate::audio::LOUDEST), become silence and are counted.
    ///
    /// # Errors
    /// [`SessionError`] where the samples are no whole frames, after [`Self::finish`], or where another thread pushes.
    pub fn push_audio(&self, samples: &[f32]) -> Result<Pushed, SessionError> {
        self.push(samples, |&sample| sample)
    }

    /// The same for 16-bit samples, whose full scale is 32768.
    ///
    /// # Errors
    /// As [`Self::push_audio`].
    pub fn push_audio_i16(&self, samples: &[i16]) -> Result<Pushed, SessionError> {
        self.push(samples, |&sample| f32::from(sample) / 32768.0)
    }

    fn push<T>(&self, samples: &[T], float: impl Fn(&T) -> f32) -> Result<Pushed, SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        let frames = samples.len() / input.channels();
        if !samples.len().is_multiple_of(input.channels()) {
            return Err(SessionError::Uneven { got: samples.len(), channels: input.channels() });
        }
        let pushed = input.push(shared, samples, float)?;
        shared.stats.overruns.fetch_add((frames - pushed.taken) as u64, Ordering::Relaxed);
        shared.stats.silenced.fetch_add(pushed.silenced as u64, Ordering::Relaxed);
        if pushed.taken > 0 {
            shared.audio_time.store(shared.clock.nanos(), Ordering::Relaxed);
            shared.wants_silence.store(false, Ordering::Relaxed);
            shared.notify();
        }
        Ok(pushed)
    }

    /// No more audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second call changes
    /// nothing.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pushes at this moment.
    pub fn finish(&self) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        if input.finish(shared) {
            // What is left of the last chunk is due from now on.
            shared.audio_time.store(shared.clock.nanos(), Ordering::Relaxed);
        }
        shared.notify();
        Ok(())
    }

    /// Takes up to `most` frames that are ready, in order, and gives each to `frame`; says how many there were.
    ///
    /// Never waits. A frame's index counts from 0 at the start or the last reset.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Failed`] or `Closed` when all that was ready
    /// has been pulled.
    pub fn pull_frames(&self, most: usize, mut frame: impl FnMut(FrameView)) -> Result<usize, SessionError> {
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let mut count = 0;
        while count < most && output.next(shared) {
            frame(output.shown(shared));
            count += 1;
        }
        if count == 0 && most > 0 {
            shared.check()?;
            output.want_silence(shared);
        }
        Ok(count)
    }

    /// Frames that are ready.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls.
    pub fn ready_frames(&self) -> Result<usize, SessionError> {
        let mut output = try_lock(&self.shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        Ok(output.ready(&self.shared))
    }

    #[cfg(test)]
    pub(crate) fn place(&self) -> &Place {
        &self.place
    }

    /// What the panic said that ended the session with [`SessionError::Panicked`], and where it was.
    pub fn defect(&self) -> Option<&Defect> {
        self.shared.defect()
    }

    /// Whether [`Self::finish`] was called and every frame up to the end was handed out.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Failed`], `Panicked` or `Closed` where the rest
    /// will never come.
    pub fn is_done(&self) -> Result<bool, SessionError> {
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let total = shared.total.load(Ordering::SeqCst);
        // Before the audio side has seen an interrupt or a reset, the end is that of the stream before.
        let heard = shared.heard_cue.load(Ordering::SeqCst) == shared.cue().number;
        if heard && total != ENDLESS && output.is_done(shared, total) {
            return Ok(true);
        }
        if output.ready(shared) == 0 {
            shared.check()?;
        }
        Ok(false)
    }

    /// The pose at `seconds` of the motion (frame index / 30), for a renderer at its own rate: rotations turn the shorter
    /// way, all else is linear. Frames before that time are taken as [`Self::pull_frames`] takes them.
    ///
    /// Earlier than the oldest frame gives the oldest; later than the newest gives what [`Idle`] says. Times that go back
    /// are held.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Range`] where the time is no number.
    pub fn sample_pose(&self, seconds: f64, mut frame: impl FnMut(FrameView)) -> Result<Sampled, SessionError> {
        if !seconds.is_finite() {
            return Err(SessionError::Range("the time of a pose must be a number"));
        }
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let sampled = output.sample(shared, seconds);
        frame(output.sampled(shared));
        Ok(sampled)
    }

    /// Drops everything that is not shown yet and eases to the rest pose within `ease`, at most [`MAX_EASE`]: somebody
    /// has interrupted the avatar. Audio pushed from now on starts a new stream, whose frames follow the ease; the frame
    /// index goes on, and the avatar stays where it stands.
    ///
    /// # Errors
    /// [`SessionError::Range`] for a longer time.
    pub fn interrupt(&self, ease: Duration) -> Result<(), SessionError> {
        if ease > MAX_EASE {
            return Err(SessionError::Range("an interrupt may ease for 10 seconds at most"));
        }
        self.shared.check()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10 seconds of frames")]
        let frames = (ease.as_secs_f64() * self.shared.frame_rate as f64).ceil() as u16;
        self.give_cue(|cue| Cue { number: cue.number.wrapping_add(1), ease: frames, ..cue });
        Ok(())
    }

    /// Back to the start: everything that was pushed and not shown is dropped, the frame index starts at 0, and what
    /// follows is what a new session with the same settings gives.
    ///
    /// # Errors
    /// [`SessionError`] where the session has failed.
    pub fn reset(&self) -> Result<(), SessionError> {
        self.shared.check()?;
        self.give_cue(|cue| Cue { number: cue.number.wrapping_add(1), resets: cue.resets.wrapping_add(1), ease: 0 });
        Ok(())
    }

    fn give_cue(&self, change: impl Fn(Cue) -> Cue) {
        let update = |word| Some(change(Cue::unpack(word)).pack());
        // The closure never refuses.
        let _ = self.shared.cue.fetch_update(Ordering::SeqCst, Ordering::SeqCst, update);
        self.shared.signal.notify();
    }

    /// The ids of the free text from the next chunk on, as [`TextTokenizer::encode`](crate::lm::text::TextTokenizer)
    /// gives them.
    ///
    /// # Errors
    /// [`SessionError::Range`] for more than [`MAX_PROMPT_TOKENS`] ids.
    pub fn set_prompt(&self, ids: &[u32]) -> Result<(), SessionError> {
        if ids.len() > MAX_PROMPT_TOKENS {
            return Err(SessionError::Range("a prompt has 128 tokens at most"));
        }
        self.set(|settings| {
            settings.text[..ids.len()].copy_from_slice(ids);
            settings.text_len = ids.len();
        })
    }

    /// The seed of draws from the next chunk on.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn set_seed(&self, seed: u64) -> Result<(), SessionError> {
        self.set(|settings| settings.sampler.seed = seed)
    }

    /// How codes are drawn from the next chunk on.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the temperature is negative or no number, or `top_p` is outside 0 to 1.
    pub fn set_sampling(&self, sampling: Sampling) -> Result<(), SessionError> {
        if !(0.0..=100.0).contains(&sampling.temperature) || !(0.0..=1.0).contains(&sampling.top_p) {
            return Err(SessionError::Range("temperature must be 0 to 100, and top_p 0 to 1"));
        }
        self.set(|settings| settings.sampler.sampling = sampling)
    }

    /// What is shown while no audio comes, from now on.
    pub fn set_idle(&self, idle: Idle) {
        self.shared.idle.store(idle as u8, Ordering::Relaxed);
    }

    /// How much `part` moves, from the next frame that is handed out: 0 keeps it at rest, 1 shows it as it is computed, up
    /// to [`MAX_GAIN`] exaggerates. A change takes up to a quarter of a second, so that nothing jumps. The lower body's
    /// gain also holds for where the avatar goes, the face's for jaw and eyes.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the gain is no number from 0 to [`MAX_GAIN`].
    pub fn set_gain(&self, part: Part, gain: f32) -> Result<(), SessionError> {
        if !(0.0..=MAX_GAIN).contains(&gain) {
            return Err(SessionError::Range("the gain of a part must be 0 to 2"));
        }
        self.shared.gains[part].store(gain.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// The gain that was set.
    pub fn gain(&self, part: Part) -> f32 {
        f32::from_bits(self.shared.gains[part].load(Ordering::Relaxed))
    }

    /// What is shown while no audio comes.
    pub fn idle(&self) -> Idle {
        self.shared.idle()
    }

    /// How codes are drawn at present.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn sampling(&self) -> Result<Sampling, SessionError> {
        Ok(self.settings()?.sampler.sampling)
    }

    fn set(&self, change: impl FnOnce(&mut Settings)) -> Result<(), SessionError> {
        self.shared.check()?;
        change(&mut *self.settings()?);
        self.shared.unseen.store(true, Ordering::Release);
        Ok(())
    }

    /// The settings; the engine holds them for no longer than it takes to copy them.
    fn settings(&self) -> Result<MutexGuard<'_, Settings>, SessionError> {
        const ATTEMPTS: usize = 10_000;
        for _ in 0..ATTEMPTS {
            if let Some(settings) = try_lock(&self.shared.settings) {
                return Ok(settings);
            }
            std::hint::spin_loop();
        }
        Err(SessionError::Busy(SETTER))
    }

    /// Interleaved channels of the audio that it takes.
    pub fn channels(&self) -> usize {
        self.shared.channels
    }

    /// What the session went through so far.
    pub fn stats(&self) -> Stats {
        let read = |counter: &AtomicU64| counter.load(Ordering::Relaxed);
        let c = &self.shared.stats;
        Stats {
            chunks: read(&c.chunks),
            frames: read(&c.frames),
            late_frames: read(&c.late_frames),
            dropped_frames: read(&c.dropped_frames),
            overruns: read(&c.overruns),
            silenced: read(&c.silenced),
        }
    }

    /// How far motion is behind speech.
    pub fn latency(&self) -> Latency {
        let delays = &self.shared.delays;
        let (backlog_samples, backlog_max_samples) = self.shared.backlog();
        Latency {
            algorithmic_samples: self.shared.algorithmic_samples,
            compute_p50: delays.quantile(0.5),
            compute_p99: delays.quantile(0.99),
            compute_p999: delays.quantile(0.999),
            compute_max: delays.largest(),
            backlog_samples,
            backlog_max_samples,
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.dropped.store(true, Ordering::SeqCst);
        self.place.sweep();
    }
}
