//! One avatar of an [`Engine`](crate::engine::Engine), as its host sees it: audio goes in on one
//! thread, frames come out on another, and neither thread waits (SPEC 2, 2.8).
//!
//! ```text
//!  audio thread            any thread                  game thread
//!  push_audio, finish      interrupt, reset, set_*     pull_frames, sample_pose
//!       │                        │ epoch                    ▲
//!       ▼                        ▼                          │
//!  mix, resample ──ring──► engine: chunks of many avatars ──ring──► ease, place, interpolate
//! ```
//!
//! | module | part |
//! |---|---|
//! | `input`, `other`, `output`, `schedule` | the sides of the host's audio thread, of its game thread, and of the engine |
//! | `shared` | the state they share; their protocol is in `stream` |
//! | `slots` | where the engine finds its sessions |
//! | `packets`, `receiver` | chunks as packets, and sessions whose frames come of those |
//! | `state` | all of it as bytes |
//! | `config`, `error`, `delay`, `gain` | what a session is made with, what it refuses, how late it was, how much it moves |

mod config;
pub(crate) mod delay;
mod error;
mod gain;
mod held;
mod input;
mod kept;
mod other;
mod output;
mod packets;
mod receiver;
mod schedule;
mod shared;
mod slots;
mod state;
mod voice;

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};
use std::time::Duration;

use crate::config::Sampling;
use crate::defect::Defect;
use crate::life::gesture::Request;
use crate::life::{Attention, Controls, GestureOptions, Layer, LipShape, Mood};
use crate::lm::layout::MAX_PROMPT_TOKENS;
use crate::memory::Counted;
use crate::part::Part;
pub use crate::state::StateError;
use crate::stream::Epoch;
pub use config::{
    AUDIO_SECONDS, Idle, MAX_CHANNELS, MAX_EASE, MAX_GAIN, MAX_RATE, MIN_RATE, PacketConfig, SessionConfig,
};
pub use error::SessionError;
pub use output::{Frame, Sampled};
use packets::PacketQueue;
pub(crate) use packets::PacketWriter;
use receiver::Receiver;
pub(crate) use schedule::{Member, Schedule};
pub(crate) use shared::{Failure, SessionInit, Shared};
use shared::{Settings, try_lock};
pub(crate) use slots::{SlotHandle, Slots};
pub(crate) use state::state_size;
pub use voice::Voice;

/// The calls that exclude each other, as [`SessionError::Busy`] names them.
const INPUT: &str = "push_audio, finish, save or restore";
const OTHER: &str = "push_other_audio";
const OUTPUT: &str = "pull_frames, sample_pose, set_clock, save or restore";
const SETTER: &str = "a setter, save or restore";

/// Largest delay of an output device, seconds.
pub const MAX_OUTPUT_DELAY: f64 = 2.0;

/// Furthest coordinate of a point to look at, metres.
const MAX_DISTANCE: f32 = 10_000.0;

/// A lock that the engine or the output holds for no longer than a copy takes.
fn spin_lock<T>(mutex: &Mutex<T>) -> Result<MutexGuard<'_, T>, SessionError> {
    const ATTEMPTS: usize = 10_000;
    for _ in 0..ATTEMPTS {
        if let Some(guard) = try_lock(mutex) {
            return Ok(guard);
        }
        std::hint::spin_loop();
    }
    Err(SessionError::Busy(SETTER))
}

/// What a [`Session::push_audio`] took.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Pushed {
    /// Sample frames (one sample of each channel) taken; what is left was not, because the engine
    /// is that far behind.
    pub taken: usize,
    /// Samples among them that were NaN, infinite or too loud, and became silence.
    pub silenced: usize,
}

/// What a session went through.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Stats {
    /// Chunks computed.
    pub chunks: u64,
    /// Frames computed.
    pub frames: u64,
    /// Frames whose chunk was done later than real time needs it.
    pub late_frames: u64,
    /// Chunks among them whose body was held because the engine did not keep up
    /// ([`Engine::set_late_limit`](crate::Engine::set_late_limit)).
    pub held_chunks: u64,
    /// Frames that were dropped by an interrupt or a reset before they were shown.
    pub dropped_frames: u64,
    /// Sample frames that were not taken because there was no room.
    pub overruns: u64,
    /// Samples that were NaN, infinite or too loud.
    pub silenced: u64,
}

/// How far motion is behind speech.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct Latency {
    /// Samples of future audio, at the session's rate, that a frame needs at most, resampling
    /// included: what no processor can shorten.
    pub algorithmic_samples: usize,
    /// Time from a chunk's last sample, or the end of the chunk before where that is later, to its
    /// frames: median.
    pub compute_p50: Duration,
    /// Its 99th percentile.
    pub compute_p99: Duration,
    /// Its 99.9th percentile.
    pub compute_p999: Duration,
    /// Its largest.
    pub compute_max: Duration,
    /// Samples, at the session's rate, by which the newest frame is behind the newest audio now,
    /// beyond [`algorithmic_samples`](Self::algorithmic_samples): 0 while the engine keeps up.
    pub backlog_samples: u64,
    /// The largest backlog since the session was made.
    pub backlog_max_samples: u64,
    /// Samples of future audio, at the session's rate, that a frame's mouth needs at most:
    /// [`algorithmic_samples`](Self::algorithmic_samples), or less with [`Voice::Live`].
    pub mouth_samples: usize,
}

/// One avatar. Every call may come from any thread; two threads in the same call at once get
/// [`SessionError::Busy`].
///
/// After it is made, no call allocates, waits, or makes a system call, but to wake the engine.
#[derive(Debug)]
pub struct Session {
    shared: Counted<Shared>,
    source: Source,
    /// Most bytes of a state.
    state_size: usize,
    /// Seconds that the host's output device takes, as the bits of a float.
    output_delay: AtomicU64,
}

/// Where a session's frames come from.
#[derive(Debug)]
enum Source {
    /// An engine: where its side of the session is.
    Engine(SlotHandle),
    /// Packets.
    Packets(Box<Mutex<Receiver>>),
}

impl Session {
    pub(crate) fn new(shared: Counted<Shared>, slot: SlotHandle, state_size: usize) -> Self {
        Self { shared, source: Source::Engine(slot), state_size, output_delay: AtomicU64::new(0) }
    }

    /// Where the engine's side of it is.
    pub(crate) fn slot(&self) -> Result<&SlotHandle, SessionError> {
        match &self.source {
            Source::Engine(slot) => Ok(slot),
            Source::Packets(_) => Err(SessionError::Range("a decoder takes no audio, text or state: its sender does")),
        }
    }

    /// Takes interleaved samples, full scale 1, for the avatar to speak: as many as there is room
    /// for.
    ///
    /// Wait-free: meant for a real-time audio thread. Samples that are no number, or louder than
    /// [`MAX_AMPLITUDE`](crate::MAX_AMPLITUDE), become silence and are counted.
    ///
    /// # Errors
    /// [`SessionError`] where the samples are no whole frames, after [`Self::finish`], or where
    /// another thread pushes.
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
        self.slot()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        let frames = samples.len() / input.channels();
        if !samples.len().is_multiple_of(input.channels()) {
            return Err(SessionError::Uneven { got: samples.len(), channels: input.channels() });
        }
        let pushed = input.push(shared, samples, float)?;
        shared.stats.overruns.fetch_add((frames - pushed.taken) as u64, Ordering::Relaxed);
        shared.stats.silenced.fetch_add(pushed.silenced as u64, Ordering::Relaxed);
        if pushed.taken > 0 {
            shared.link.audio_pushed(shared.clock.nanos());
            shared.heard.store(shared.now(), Ordering::Relaxed);
        }
        Ok(pushed)
    }

    /// Takes interleaved samples of who speaks to the avatar, at the session's rate and channels, so
    /// that it listens: it looks at the listener's place, nods and raises its brows at the pauses.
    /// Only their loudness is used. Samples that are no number count as silence.
    ///
    /// Wait-free, from any thread beside any other call, meant for the thread that records.
    ///
    /// # Errors
    /// [`SessionError::Uneven`] where the samples are no whole frames, [`SessionError::Busy`] where
    /// another thread is in this call.
    pub fn push_other_audio(&self, samples: &[f32]) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        try_lock(&shared.other).ok_or(SessionError::Busy(OTHER))?.push(shared, samples)
    }

    /// No more audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A
    /// second call changes nothing.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pushes at this moment.
    pub fn finish(&self) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        self.slot()?;
        let mut input = try_lock(&shared.input).ok_or(SessionError::Busy(INPUT))?;
        input.finish(shared);
        Ok(())
    }

    /// Takes up to `most` frames that are ready, in order, and gives each to `frame`; says how many
    /// there were.
    ///
    /// Never waits. A frame's index counts from 0 at the start or the last reset.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Failed`] or `Closed` when
    /// all that was ready has been pulled.
    pub fn pull_frames(&self, most: usize, mut frame: impl FnMut(Frame)) -> Result<usize, SessionError> {
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

    /// Message and location of the panic that ended the session with
    /// [`SessionError::Panicked`].
    pub fn defect(&self) -> Option<&Defect> {
        self.shared.defect()
    }

    /// Whether [`Self::finish`] was called and every frame up to the end was handed out; of a session
    /// that queues no frames, every packet.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Failed`], `Panicked` or
    /// `Closed` if the remaining frames will never be computed.
    pub fn is_done(&self) -> Result<bool, SessionError> {
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        if let Some(total) = shared.link.total() {
            let has_ended = |queue: &PacketQueue| total == 0 || queue.has_ended(shared.link.epoch().number);
            let is_done = match &shared.packets {
                Some(queue) if !queue.with_frames => has_ended(queue),
                _ => output.is_done(shared, total),
            };
            if is_done {
                return Ok(true);
            }
        }
        if output.ready(shared) == 0 {
            shared.check()?;
        }
        Ok(false)
    }

    /// The pose at `seconds` of the motion (frame index / 30), less [`Self::output_delay`], for a
    /// renderer at its own rate: rotations turn the shorter way, all else is linear. Frames before that time are taken as
    /// [`Self::pull_frames`] takes them.
    ///
    /// Earlier than the oldest frame gives the oldest; later than the newest gives what [`Idle`]
    /// says. Times that go back are held.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Range`] where the time is
    /// no number.
    pub fn sample_pose(&self, seconds: f64, mut frame: impl FnMut(Frame)) -> Result<Sampled, SessionError> {
        if !seconds.is_finite() {
            return Err(SessionError::Range("the time of a pose must be a number"));
        }
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        let sampled = output.sample(shared, seconds - self.output_delay());
        frame(output.sampled(shared));
        Ok(sampled)
    }

    /// Sets the output device's own delay, seconds from the sound that is played to the sound that is
    /// heard, 0 to [`MAX_OUTPUT_DELAY`]: [`Self::sample_pose`] shows the pose of so much earlier. 0 where
    /// nothing is set. It is no part of a state, and changes no frame.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the delay is not in the range.
    pub fn set_output_delay(&self, seconds: f64) -> Result<(), SessionError> {
        if !(0.0..=MAX_OUTPUT_DELAY).contains(&seconds) {
            return Err(SessionError::Range("the output device's delay must be 0 to 2 seconds"));
        }
        self.output_delay.store(seconds.to_bits(), Ordering::Relaxed);
        Ok(())
    }

    /// The output device's delay that was set, seconds.
    pub fn output_delay(&self) -> f64 {
        f64::from_bits(self.output_delay.load(Ordering::Relaxed))
    }

    /// What time it is for the host, in seconds from any moment on, 0 to 1e9: from the first call on,
    /// what moves while no frames come, eases to it and back, and [`SessionConfig::idle_after`] go
    /// by this time, and no longer by the clock. A host that renders slower than real time, or
    /// pauses, gives it with every picture, before [`Self::sample_pose`]. Times that go back are
    /// held, but for [`Self::restore`], which goes back to the state's.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread pulls; [`SessionError::Range`] where the time is
    /// not in 0 to 1e9.
    pub fn set_clock(&self, seconds: f64) -> Result<(), SessionError> {
        if !(0.0..=1e9).contains(&seconds) {
            return Err(SessionError::Range("the host's time must be 0 to 1e9 seconds"));
        }
        let shared = &*self.shared;
        let mut output = try_lock(&shared.output).ok_or(SessionError::Busy(OUTPUT))?;
        output.set_clock(shared, Duration::from_secs_f64(seconds));
        Ok(())
    }

    /// Drops everything that is not shown yet and eases to the rest pose within `ease`, at most
    /// [`MAX_EASE`], for barge-in. Audio pushed from now on starts a new
    /// stream, whose frames follow the ease; the frame index goes on, and the avatar stays where it
    /// stands. As many frames of the new stream, at most [`SessionConfig::ease`], come out of the rest
    /// pose, the face in a quarter of them.
    ///
    /// # Errors
    /// [`SessionError::Range`] for a longer time.
    pub fn interrupt(&self, ease: Duration) -> Result<(), SessionError> {
        if ease > MAX_EASE {
            return Err(SessionError::Range("an interrupt may ease for 10 seconds at most"));
        }
        self.shared.check()?;
        self.slot()?;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 10 seconds of frames")]
        let frames = (ease.as_secs_f64() * self.shared.frame_rate as f64).ceil() as u16;
        self.shared.link.begin_epoch(|epoch| epoch.interrupted(frames));
        Ok(())
    }

    /// Back to the start: everything that was pushed and not shown is dropped, the frame index
    /// starts at 0, and what follows is what a new session with the same settings gives.
    ///
    /// # Errors
    /// [`SessionError`] where the session has failed.
    pub fn reset(&self) -> Result<(), SessionError> {
        self.shared.check()?;
        self.shared.link.begin_epoch(Epoch::reset);
        Ok(())
    }

    /// The ids of the free text from the next chunk on, as
    /// [`TextTokenizer::encode`](crate::lm::text::TextTokenizer) gives them.
    ///
    /// # Errors
    /// [`SessionError::Range`] for more than [`MAX_PROMPT_TOKENS`] ids.
    pub fn set_prompt(&self, ids: &[u32]) -> Result<(), SessionError> {
        if ids.len() > MAX_PROMPT_TOKENS {
            return Err(SessionError::Range("a prompt has 128 tokens at most"));
        }
        self.slot()?;
        self.set(|settings| {
            settings.text[..ids.len()].copy_from_slice(ids);
            settings.text_len = ids.len();
        })
    }

    /// The seed of draws from the next chunk on. The layers keep the one that the session was made
    /// with.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn set_seed(&self, seed: u64) -> Result<(), SessionError> {
        self.set(|settings| settings.sampler.seed = seed)
    }

    /// How codes are drawn from the next chunk on.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the temperature is negative or no number, or `top_p` is
    /// outside 0 to 1.
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

    /// How much `part` moves, from the next frame that is handed out: 0 keeps it at rest, 1 shows
    /// it as it is computed, up to [`MAX_GAIN`] exaggerates. A change takes up to a quarter of a
    /// second, so that nothing jumps. The lower body's gain also holds for where the avatar goes,
    /// the face's for jaw and eyes.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the gain is not in 0 to [`MAX_GAIN`].
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

    /// How strong a layer over the decoders' frames is, 0 to 1, from the next frame on; 0 leaves
    /// what the layers before it gave.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the gain is not in 0 to 1, [`SessionError::Busy`] where another
    /// thread sets something at this moment.
    pub fn set_layer(&self, layer: Layer, gain: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&gain) {
            return Err(SessionError::Range("the gain of a layer must be 0 to 1"));
        }
        self.control(|controls| controls.layers = controls.layers.with(layer, gain))
    }

    /// Looks at a point in the avatar's space, metres, with a strength of 0 to 1, from the next
    /// frame on: the eyes first, then the head, then the trunk, as far as a body turns. A strength
    /// of 0 looks away from it again. The point may be set anew for every frame.
    ///
    /// # Errors
    /// [`SessionError::Range`] where a number is not finite or the strength is not in 0 to 1,
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn look_at(&self, point: [f32; 3], strength: f32) -> Result<(), SessionError> {
        if !point.iter().all(|value| value.abs() <= MAX_DISTANCE) || !(0.0..=1.0).contains(&strength) {
            return Err(SessionError::Range("a look-at needs a point within 10 km and a strength of 0 to 1"));
        }
        self.control(|controls| (controls.look_at, controls.look_at_strength) = (point, strength))
    }

    /// What the avatar attends to from the next frame on; changes are blended over half a second.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn set_attention(&self, attention: Attention) -> Result<(), SessionError> {
        self.control(|controls| controls.attention = attention)
    }

    /// The mood of face and posture from the next frame on, with a strength of 0 to 1; changes are
    /// blended over a second.
    ///
    /// # Errors
    /// [`SessionError::Range`] where the strength is not in 0 to 1, [`SessionError::Busy`] where
    /// another thread sets something at this moment.
    pub fn set_mood(&self, mood: Mood, strength: f32) -> Result<(), SessionError> {
        if !(0.0..=1.0).contains(&strength) {
            return Err(SessionError::Range("the strength of a mood must be 0 to 1"));
        }
        self.control(|controls| (controls.mood, controls.mood_strength) = (mood, strength))
    }

    /// Plays a gesture over what the model does, from the next frame on or at a time: its parts of
    /// the body ease to it and back, the others go on. Gestures of the same parts follow each other
    /// in the order in which they were asked for; one with a time takes their place. An
    /// [`interrupt`](Self::interrupt) lets go of what plays, with an ease, and of what waits;
    /// a [`reset`](Self::reset) of all at once. While no frames come, gestures without a time play on
    /// and times of the motion stand still.
    ///
    /// # Errors
    /// [`SessionError::UnknownGesture`], [`SessionError::GesturesFull`] where
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) wait, [`SessionError::Range`] where an
    /// option is out of its range, [`SessionError::Busy`] where another thread sets something at
    /// this moment.
    pub fn play_gesture(&self, name: &str, options: &GestureOptions) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        let epoch = shared.link.epoch().number;
        let request = Request::new(&shared.gestures, name, options, shared.frame_rate, epoch)?;
        let begun = shared.begun_gestures.load(Ordering::Acquire);
        spin_lock(&shared.controls)?.gestures.push(request, begun)?;
        shared.unseen_controls.store(true, Ordering::Release);
        Ok(())
    }

    /// Says that a sound is heard that one sees on the lips: from `start` on for `duration`, seconds of
    /// the audio that was pushed since the session began or was reset. The lips are in its shape then,
    /// and reach and leave it within 60 ms, whatever the model does; models without ARKit's shapes show
    /// nothing of it. Sounds may come in any order, before their audio or after it; one whose time was
    /// handed out already shows no more. An [`interrupt`](Self::interrupt) drops those that wait.
    ///
    /// # Errors
    /// [`SessionError::Range`] where a time is no number of seconds from 0 on, or the duration not 0 to
    /// [`MAX_HINT_SECONDS`](crate::MAX_HINT_SECONDS), [`SessionError::HintsFull`] where
    /// [`MAX_PENDING_HINTS`](crate::MAX_PENDING_HINTS) wait, [`SessionError::Busy`] where another thread
    /// sets something at this moment.
    pub fn hint_lips(&self, shape: LipShape, start: f64, duration: f64) -> Result<(), SessionError> {
        let shared = &*self.shared;
        shared.check()?;
        let epoch = shared.link.epoch().number;
        let passed = shared.passed_hints.load(Ordering::Acquire);
        spin_lock(&shared.controls)?.hints.push((start, duration), shape, shared.sample_rate, (epoch, passed))?;
        shared.unseen_controls.store(true, Ordering::Release);
        Ok(())
    }

    /// Names of the gestures that the avatar knows.
    pub fn gesture_names(&self) -> impl Iterator<Item = &str> {
        self.shared.gestures.names()
    }

    fn control(&self, change: impl FnOnce(&mut Controls)) -> Result<(), SessionError> {
        self.shared.check()?;
        change(&mut *spin_lock(&self.shared.controls)?);
        self.shared.unseen_controls.store(true, Ordering::Release);
        Ok(())
    }

    /// The gain of a layer that was set last.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn layer(&self, layer: Layer) -> Result<f32, SessionError> {
        Ok(spin_lock(&self.shared.controls)?.layers.gain(layer))
    }

    /// What the avatar attends to, as it was set last.
    ///
    /// # Errors
    /// [`SessionError::Busy`] where another thread sets something at this moment.
    pub fn attention(&self) -> Result<Attention, SessionError> {
        Ok(spin_lock(&self.shared.controls)?.attention)
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
        spin_lock(&self.shared.settings)
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
            held_chunks: read(&c.held_chunks),
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
            mouth_samples: self.shared.mouth_samples,
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
        if let Source::Engine(slot) = &self.source {
            slot.sweep();
        }
    }
}
