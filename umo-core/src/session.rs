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

pub(crate) mod delay;
mod gain;
mod input;
mod output;
mod state;

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};
use std::time::Duration;

use crate::avatar::AvatarConfig;
use crate::clock::Clock;
use crate::config::{Config, Sampling};
use crate::engine::{Place, Signal};
use crate::error::{LoadError, StepError};
use crate::lm::layout::MAX_PROMPT_TOKENS;
use crate::lm::sampler::Sampler;
use crate::motion::Assembly;
use crate::part::{Part, PerPart};
use crate::ring::Ring;
pub use crate::state::StateError;
use crate::state::StatePass;
use delay::Delays;
use input::Input;
use output::Output;
pub use output::{FrameView, Sampled};
pub(crate) use output::{Shown, words as frame_words, write as write_frame};
pub(crate) use state::state_size;

/// Least seconds of audio that wait for the engine before [`Session::push_audio`] takes no more.
pub const AUDIO_SECONDS: usize = 10;
/// Lowest sample rate of a session, per second.
pub const MIN_RATE: usize = 8_000;
/// Highest sample rate of a session, per second.
pub const MAX_RATE: usize = 192_000;
/// Most channels of a session's audio.
pub const MAX_CHANNELS: usize = 64;
/// Largest gain of a part.
pub const MAX_GAIN: f32 = 2.0;
/// Longest [`Session::interrupt`].
pub const MAX_EASE: Duration = Duration::from_secs(10);

/// The calls that exclude each other, as [`SessionError::Busy`] names them.
const INPUT: &str = "push_audio, finish, save or restore";
const OUTPUT: &str = "pull_frames, sample_pose, save or restore";
const SETTER: &str = "a setter, save or restore";

/// What a session is made with.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// The avatar.
    pub avatar: AvatarConfig,
    /// Samples per second of the audio that is pushed, [`MIN_RATE`] to [`MAX_RATE`].
    pub sample_rate: usize,
    /// Interleaved channels of that audio, 1 to [`MAX_CHANNELS`]; they are mixed.
    pub channels: usize,
    /// What is shown while no audio comes.
    pub idle: Idle,
    /// Time without audio after which [`Idle::Rest`] and [`Idle::Live`] begin.
    pub idle_after: Duration,
    /// How long an ease to rest takes, and the way back from it.
    pub ease: Duration,
    /// Frames that wait for the host before the engine stops computing: at least two chunks' worth.
    pub queue_frames: usize,
}

/// What is shown while no audio comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Idle {
    /// The last pose.
    #[default]
    Hold,
    /// An ease to the rest pose; only [`Session::sample_pose`] shows it.
    Rest,
    /// The model, run on silence.
    Live,
}

impl SessionConfig {
    /// The model's own defaults, speech to motion, mono audio at the model's rate.
    pub fn new(config: &Config) -> Self {
        Self {
            avatar: AvatarConfig::new(config),
            sample_rate: config.audio.sample_rate,
            channels: 1,
            idle: Idle::Hold,
            idle_after: Duration::from_millis(300),
            ease: Duration::from_millis(500),
            queue_frames: 4 * config.max_target * config.keyframe_stride,
        }
    }
}

/// A call that could not be done; nothing was changed by it. `Copy`: reporting one allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionError {
    /// Another thread is in the same call, or in one that excludes it; the call may be repeated.
    Busy(&'static str),
    /// Audio was pushed after [`Session::finish`]; [`Session::reset`] or [`Session::interrupt`] start anew.
    Finished,
    /// The samples are no whole number of the session's channels.
    Uneven {
        /// Samples given.
        got: usize,
        /// Channels of the session.
        channels: usize,
    },
    /// An argument is out of its range, which the text says.
    Range(&'static str),
    /// The avatar's computation failed: the session gives no more frames.
    Failed(StepError),
    /// The avatar's computation panicked: the session gives no more frames.
    Panicked,
    /// The engine is gone; frames that were ready can still be pulled.
    Closed,
    /// A state cannot be restored into this session.
    State(StateError),
}

impl fmt::Display for SessionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy(call) => write!(f, "another thread is in {call}: call again"),
            Self::Finished => write!(f, "audio was pushed after finish: reset or interrupt the session first"),
            Self::Uneven { got, channels } => {
                write!(f, "{got} samples are no whole number of frames of {channels} channels")
            }
            Self::Range(what) => write!(f, "{what}"),
            Self::Failed(error) => write!(f, "the avatar failed and gives no more frames: {error}"),
            Self::Panicked => write!(f, "the avatar failed by a defect of this library and gives no more frames"),
            Self::Closed => write!(f, "the session's engine is gone"),
            Self::State(error) => write!(f, "{error}"),
        }
    }
}

impl std::error::Error for SessionError {}

impl From<StateError> for SessionError {
    fn from(error: StateError) -> Self {
        Self::State(error)
    }
}

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
}

/// What an interrupt or a reset tells the three sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Cue {
    /// Counts all cues.
    pub(crate) number: u32,
    /// Counts resets, modulo 2^16.
    pub(crate) resets: u16,
    /// Frames to ease in.
    pub(crate) ease: u16,
}

impl Cue {
    fn pack(self) -> u64 {
        u64::from(self.number) << 32 | u64::from(self.resets) << 16 | u64::from(self.ease)
    }

    #[expect(clippy::cast_possible_truncation, reason = "fields of a word")]
    fn unpack(word: u64) -> Self {
        Self { number: (word >> 32) as u32, resets: (word >> 16) as u16, ease: word as u16 }
    }

    /// Describes a cue that one of the sides saw.
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        let word = pass.word(self.pack())?;
        if pass.loads() {
            *self = Self::unpack(word);
        }
        Ok(())
    }
}

/// What is set while the session runs, taken over at the next chunk.
#[derive(Debug)]
pub(crate) struct Settings {
    pub(crate) sampler: Sampler,
    pub(crate) text: [u32; MAX_PROMPT_TOKENS],
    pub(crate) text_len: usize,
}

impl Settings {
    /// What the avatar was made with.
    fn new(avatar: &AvatarConfig) -> Self {
        let (mut text, text_len) = ([0; MAX_PROMPT_TOKENS], avatar.text.len());
        text[..text_len].copy_from_slice(&avatar.text);
        Self { sampler: avatar.sampler, text, text_len }
    }
}

/// No sample position: nobody waits for audio.
pub(crate) const NOBODY: u64 = u64::MAX;
/// No end of the stream is known.
pub(crate) const ENDLESS: u64 = u64::MAX;

/// How a session's computation ended, if it did.
const RUNNING: u8 = 0;
const FAILED: u8 = 1;
const PANICKED: u8 = 2;
const CLOSED: u8 = 3;

/// What the sides of a session share.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Samples at the model's rate, as the bits of floats.
    pub(crate) audio: Ring,
    /// Frames, as [`output`] lays them out.
    pub(crate) frames: Ring,
    cue: AtomicU64,
    /// The last cue that the audio side saw, and where in `audio` what came after it starts.
    pub(crate) heard_cue: AtomicU32,
    pub(crate) heard_from: AtomicU64,
    /// Sample frames pushed before that cue, at the session's rate.
    pub(crate) sample_base: AtomicU64,
    /// Frames of the stream in all since that cue, or [`ENDLESS`].
    pub(crate) total: AtomicU64,
    /// Position in `audio` at which the next chunk is due, or [`NOBODY`].
    pub(crate) due_at: AtomicU64,
    /// When audio last came, nanoseconds.
    pub(crate) audio_time: AtomicU64,
    /// The engine waits for room in `frames`.
    pub(crate) wants_room: AtomicBool,
    /// The host waits for frames while no audio comes.
    pub(crate) wants_silence: AtomicBool,
    /// The host has dropped the session.
    pub(crate) dropped: AtomicBool,
    state: AtomicU8,
    failure: OnceLock<StepError>,
    pub(crate) idle: AtomicU8,
    /// How much each part moves, as the bits of floats.
    pub(crate) gains: PerPart<AtomicU32>,
    settings: Mutex<Settings>,
    /// Settings that the engine has not seen.
    unseen: AtomicBool,
    input: Mutex<Input>,
    output: Mutex<Output>,
    pub(crate) stats: Counters,
    pub(crate) delays: Delays,
    pub(crate) clock: Clock,
    pub(crate) signal: Arc<Signal>,
    /// Samples at the session's rate that a frame needs at most.
    algorithmic_samples: usize,
    channels: usize,
    frame_rate: usize,
}

#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) chunks: AtomicU64,
    pub(crate) frames: AtomicU64,
    pub(crate) late_frames: AtomicU64,
    pub(crate) dropped_frames: AtomicU64,
    overruns: AtomicU64,
    silenced: AtomicU64,
}

impl Shared {
    pub(crate) fn cue(&self) -> Cue {
        Cue::unpack(self.cue.load(Ordering::SeqCst))
    }

    pub(crate) fn idle(&self) -> Idle {
        match self.idle.load(Ordering::Relaxed) {
            1 => Idle::Rest,
            2 => Idle::Live,
            _ => Idle::Hold,
        }
    }

    /// Takes settings over, where there are new ones; at the next chunk where the host is just writing them.
    pub(crate) fn take_settings(&self, take: impl FnOnce(&Settings)) {
        if self.unseen.load(Ordering::Acquire)
            && let Some(settings) = try_lock(&self.settings)
        {
            self.unseen.store(false, Ordering::Relaxed);
            take(&settings);
        }
    }

    /// The engine cannot go on with this session.
    pub(crate) fn fail(&self, error: Option<StepError>) {
        if let Some(error) = error {
            // The first failure stays.
            let _ = self.failure.set(error);
        }
        let state = if error.is_some() { FAILED } else { PANICKED };
        self.state.store(state, Ordering::Release);
    }

    /// The engine is gone.
    pub(crate) fn close(&self) {
        let _ = self.state.compare_exchange(RUNNING, CLOSED, Ordering::AcqRel, Ordering::Relaxed);
    }

    /// Whether the engine still computes for it.
    pub(crate) fn is_running(&self) -> bool {
        self.state.load(Ordering::Acquire) == RUNNING
    }

    fn check(&self) -> Result<(), SessionError> {
        match self.state.load(Ordering::Acquire) {
            FAILED => Err(self.failure.get().map_or(SessionError::Panicked, |&error| SessionError::Failed(error))),
            PANICKED => Err(SessionError::Panicked),
            CLOSED => Err(SessionError::Closed),
            _ => Ok(()),
        }
    }

    /// Tells the engine to look, where it waits for what is now in `audio`.
    fn notify(&self) {
        let due = self.due_at.load(Ordering::SeqCst);
        if due != NOBODY && (self.audio.written() >= due || self.total.load(Ordering::Relaxed) != ENDLESS) {
            self.due_at.store(NOBODY, Ordering::SeqCst);
            self.signal.notify();
        }
    }
}

/// The lock, where nobody has it. A side that panicked left nothing half done that the next call would trip over.
fn try_lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
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

/// What an engine knows of a session that is being made.
pub(crate) struct Making<'a> {
    pub(crate) config: &'a Config,
    pub(crate) assembly: &'a Assembly,
    pub(crate) rest: Shown,
    /// Most frames of one chunk, and frames of future audio that a frame needs.
    pub(crate) chunk_frames: usize,
    pub(crate) latency_frames: usize,
    /// Samples of one chunk, none where it needs no audio.
    pub(crate) chunk_samples: usize,
    pub(crate) clock: Clock,
    pub(crate) signal: Arc<Signal>,
}

impl Shared {
    pub(crate) fn new(making: Making, session: &SessionConfig) -> Result<Self, LoadError> {
        let Making { config, assembly, rest, chunk_frames, latency_frames, chunk_samples, clock, signal } = making;
        let range = |key: &str, got: usize, from: usize, to: usize| {
            if (from..=to).contains(&got) {
                return Ok(());
            }
            Err(LoadError::config(key, format!("expected {from} to {to}, got {got}")))
        };
        range("sample_rate", session.sample_rate, MIN_RATE, MAX_RATE)?;
        range("channels", session.channels, 1, MAX_CHANNELS)?;
        range("queue_frames", session.queue_frames, 2 * chunk_frames, 1 << 16)?;
        let (rate, face_values) = (config.audio.sample_rate, assembly.face_values());
        let input = Input::new(session.sample_rate, session.channels, config)
            .map_err(|error| LoadError::config("sample_rate", error.to_string()))?;
        let chunk = config.max_target * config.samples_per_keyframe();
        let delay = if chunk_samples > 0 { input.most_delay(chunk_samples) } else { 0 };
        Ok(Self {
            audio: Ring::new((AUDIO_SECONDS * rate).max(2 * chunk) + input.most_left()),
            frames: Ring::new(session.queue_frames * frame_words(face_values)),
            cue: AtomicU64::new(0),
            heard_cue: AtomicU32::new(0),
            heard_from: AtomicU64::new(0),
            sample_base: AtomicU64::new(0),
            total: AtomicU64::new(ENDLESS),
            due_at: AtomicU64::new(NOBODY),
            audio_time: AtomicU64::new(clock.nanos()),
            wants_room: AtomicBool::new(false),
            wants_silence: AtomicBool::new(false),
            dropped: AtomicBool::new(false),
            state: AtomicU8::new(RUNNING),
            failure: OnceLock::new(),
            idle: AtomicU8::new(session.idle as u8),
            gains: PerPart::from_fn(|_| AtomicU32::new(1.0_f32.to_bits())),
            settings: Mutex::new(Settings::new(&session.avatar)),
            unseen: AtomicBool::new(false),
            output: Mutex::new(Output::new(session, config, rest, assembly.is_arkit(), chunk_frames)),
            input: Mutex::new(input),
            stats: Counters::default(),
            delays: Delays::new(),
            algorithmic_samples: (latency_frames * session.sample_rate).div_ceil(config.frame_rate) + delay,
            channels: session.channels,
            frame_rate: config.frame_rate,
            clock,
            signal,
        })
    }
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
        Latency {
            algorithmic_samples: self.shared.algorithmic_samples,
            compute_p50: delays.quantile(0.5),
            compute_p99: delays.quantile(0.99),
            compute_p999: delays.quantile(0.999),
            compute_max: delays.largest(),
        }
    }
}

impl Drop for Session {
    fn drop(&mut self) {
        self.shared.dropped.store(true, Ordering::SeqCst);
        self.place.sweep();
    }
}
