//! What the sides of a session share, and what they tell each other.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};

use super::config::{AUDIO_SECONDS, Idle, MAX_CHANNELS, MAX_RATE, MIN_RATE, SessionConfig};
use super::delay::Delays;
use super::error::SessionError;
use super::input::Input;
use super::output::{Output, Shown, words as frame_words};
use crate::avatar::AvatarConfig;
use crate::clock::Clock;
use crate::config::Config;
use crate::defect::Defect;
use crate::engine::Signal;
use crate::error::{LoadError, StepError};
use crate::lm::layout::MAX_PROMPT_TOKENS;
use crate::lm::sampler::Sampler;
use crate::motion::Assembly;
use crate::part::PerPart;
use crate::ring::Ring;
use crate::state::{StateError, StatePass};

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
    pub(super) fn pack(self) -> u64 {
        u64::from(self.number) << 32 | u64::from(self.resets) << 16 | u64::from(self.ease)
    }

    #[expect(clippy::cast_possible_truncation, reason = "fields of a word")]
    pub(super) fn unpack(word: u64) -> Self {
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
    pub(super) fn new(avatar: &AvatarConfig) -> Self {
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
const CLOSED: u8 = 2;

/// Why the engine cannot go on with a session.
#[derive(Clone, Debug)]
pub(crate) enum Failure {
    /// A step could not be taken.
    Step(StepError),
    /// A step panicked.
    Defect(Defect),
}

/// What the sides of a session share.
#[derive(Debug)]
pub(crate) struct Shared {
    /// Samples at the model's rate, as the bits of floats.
    pub(crate) audio: Ring,
    /// Frames, as [`output`] lays them out.
    pub(crate) frames: Ring,
    pub(super) cue: AtomicU64,
    /// The last cue that the audio side saw, and where in `audio` what came after it starts.
    pub(crate) heard_cue: AtomicU32,
    pub(crate) heard_from: AtomicU64,
    /// Sample frames pushed before that cue, at the session's rate.
    pub(crate) sample_base: AtomicU64,
    /// Sample frames pushed since that cue, and up to which of them there are frames.
    pub(super) pushed: AtomicU64,
    covered: AtomicU64,
    /// The largest backlog that was seen, in sample frames.
    largest_backlog: AtomicU64,
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
    pub(super) state: AtomicU8,
    pub(super) failure: OnceLock<Failure>,
    pub(crate) idle: AtomicU8,
    /// How much each part moves, as the bits of floats.
    pub(crate) gains: PerPart<AtomicU32>,
    pub(super) settings: Mutex<Settings>,
    /// Settings that the engine has not seen.
    pub(super) unseen: AtomicBool,
    pub(super) input: Mutex<Input>,
    pub(super) output: Mutex<Output>,
    pub(crate) stats: Counters,
    pub(crate) delays: Delays,
    pub(crate) clock: Clock,
    pub(crate) signal: Arc<Signal>,
    /// Samples at the session's rate that a frame needs at most.
    pub(super) algorithmic_samples: usize,
    pub(super) channels: usize,
    pub(super) frame_rate: usize,
}

#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) chunks: AtomicU64,
    pub(crate) frames: AtomicU64,
    pub(crate) late_frames: AtomicU64,
    pub(crate) dropped_frames: AtomicU64,
    pub(super) overruns: AtomicU64,
    pub(super) silenced: AtomicU64,
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
    pub(crate) fn fail(&self, failure: Failure) {
        // The first failure stays.
        let _ = self.failure.set(failure);
        self.state.store(FAILED, Ordering::Release);
    }

    /// The panic that ended the session.
    pub(super) fn defect(&self) -> Option<&Defect> {
        match self.failure.get() {
            Some(Failure::Defect(defect)) => Some(defect),
            _ => None,
        }
    }

    /// The engine is gone.
    pub(crate) fn close(&self) {
        let _ = self.state.compare_exchange(RUNNING, CLOSED, Ordering::AcqRel, Ordering::Relaxed);
    }

    /// Whether the engine still computes for it.
    pub(crate) fn is_running(&self) -> bool {
        self.state.load(Ordering::Acquire) == RUNNING
    }

    pub(super) fn check(&self) -> Result<(), SessionError> {
        match self.state.load(Ordering::Acquire) {
            FAILED => match self.failure.get() {
                Some(&Failure::Step(error)) => Err(SessionError::Failed(error)),
                _ => Err(SessionError::Panicked),
            },
            CLOSED => Err(SessionError::Closed),
            _ => Ok(()),
        }
    }

    /// A stream begins with so much audio pushed.
    pub(super) fn begin_backlog(&self, pushed: u64) {
        self.pushed.store(pushed, Ordering::Relaxed);
        self.covered.store(pushed, Ordering::Relaxed);
    }

    /// There are frames of the stream up to sample frame `sample`. How far behind they were until now is remembered.
    pub(crate) fn cover(&self, sample: u64) {
        self.backlog();
        self.covered.store(sample, Ordering::Relaxed);
    }

    /// Sample frames by which the newest frame is behind the newest audio, beyond what every frame needs of its future: now,
    /// and the most so far.
    pub(super) fn backlog(&self) -> (u64, u64) {
        let pushed = self.pushed.load(Ordering::Relaxed);
        let promised = self.covered.load(Ordering::Relaxed) + self.algorithmic_samples as u64;
        let backlog = pushed.saturating_sub(promised);
        (backlog, self.largest_backlog.fetch_max(backlog, Ordering::Relaxed).max(backlog))
    }

    /// Tells the engine to look, where it waits for what is now in `audio`.
    pub(super) fn notify(&self) {
        let due = self.due_at.load(Ordering::SeqCst);
        if due != NOBODY && (self.audio.written() >= due || self.total.load(Ordering::Relaxed) != ENDLESS) {
            self.due_at.store(NOBODY, Ordering::SeqCst);
            self.signal.notify();
        }
    }
}

/// The lock, where nobody has it. A side that panicked left nothing half done that the next call would trip over.
pub(super) fn try_lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// What an engine knows of a session that is being made.
pub(crate) struct Making<'a> {
    pub(crate) config: &'a Config,
    pub(crate) assembly: &'a Assembly,
    pub(crate) rest: Shown,
    /// Most frames of one chunk.
    pub(crate) chunk_frames: usize,
    /// Whether speech moves the avatar.
    pub(crate) has_audio: bool,
    pub(crate) clock: Clock,
    pub(crate) signal: Arc<Signal>,
}

impl Shared {
    pub(crate) fn new(making: Making, session: &SessionConfig) -> Result<Self, LoadError> {
        let Making { config, assembly, rest, chunk_frames, has_audio, clock, signal } = making;
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
        let algorithmic_samples = session.latency_with(config, has_audio, input.resampler());
        let chunk = config.max_target * config.samples_per_keyframe();
        Ok(Self {
            audio: Ring::new((AUDIO_SECONDS * rate).max(2 * chunk) + input.most_left()),
            frames: Ring::new(session.queue_frames * frame_words(face_values)),
            cue: AtomicU64::new(0),
            heard_cue: AtomicU32::new(0),
            heard_from: AtomicU64::new(0),
            sample_base: AtomicU64::new(0),
            pushed: AtomicU64::new(0),
            covered: AtomicU64::new(0),
            largest_backlog: AtomicU64::new(0),
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
            algorithmic_samples,
            channels: session.channels,
            frame_rate: config.frame_rate,
            clock,
            signal,
        })
    }
}
