//! State shared by the sides of a session.

use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, TryLockError};

use super::config::{AUDIO_SECONDS, Idle, MAX_QUEUE, SessionConfig, in_range};
use super::delay::Delays;
use super::error::SessionError;
use super::input::Input;
use super::kept::Kept;
use super::other::OtherInput;
use super::output::Output;
use super::packets::PacketQueue;
use super::voice::{LiveVoice, Voice};
use crate::link::{FrameRing, Link, Signal};
use umo_core_base::clock::Clock;
use umo_core_base::defect::Defect;
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Boxed};
use umo_core_layers::{Controls, Gestures, Life};
use umo_core_model::audio::resample::Resampler;
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::lm::layout::MAX_PROMPT_TOKENS;
use umo_core_model::lm::sampler::Sampler;
use umo_core_model::model::Model;
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::part::PerPart;
use umo_core_pose::pose::Assembly;

/// Settings that may change while the session runs, taken over at the next chunk.
#[derive(Debug)]
pub(crate) struct Settings {
    pub(crate) sampler: Sampler,
    pub(crate) text: [u32; MAX_PROMPT_TOKENS],
    pub(crate) text_len: usize,
}

impl Settings {
    /// The settings that the avatar was created with.
    pub(crate) fn new(avatar: &AvatarConfig) -> Self {
        let (mut text, text_len) = ([0; MAX_PROMPT_TOKENS], avatar.text.len());
        text[..text_len].copy_from_slice(&avatar.text);
        Self { sampler: avatar.sampler, text, text_len }
    }
}

/// Frames by which a live session's body lags beyond its algorithmic latency: time to compute them.
const MORE_FRAMES: usize = 2;

/// Values of `Shared::state`: whether and how the session's computation ended.
const RUNNING: u8 = 0;
const FAILED: u8 = 1;
const CLOSED: u8 = 2;

/// Reason why the engine stopped computing a session.
#[derive(Clone, Debug)]
pub(crate) enum Failure {
    /// A step failed.
    Step(StepError),
    /// A step panicked.
    Defect(Defect),
}

/// State shared by the sides of a session.
#[derive(Debug)]
pub(crate) struct Shared {
    /// The protocol between the sides.
    pub(crate) link: Link,
    /// Sample frames pushed since the input's epoch began, and the number of them that frames
    /// cover.
    pub(super) pushed: AtomicU64,
    covered: AtomicU64,
    /// Largest backlog so far, in sample frames.
    largest_backlog: AtomicU64,
    /// Whether the host has dropped the session.
    pub(crate) dropped: AtomicBool,
    pub(super) state: AtomicU8,
    pub(super) failure: OnceLock<Failure>,
    pub(crate) idle: AtomicU8,
    /// Gain of each part, as the bits of floats.
    pub(crate) gains: PerPart<AtomicU32>,
    pub(super) settings: Mutex<Settings>,
    /// Whether there are settings that the engine has not seen.
    pub(super) unseen: AtomicBool,
    /// The host's controls of the layers, and whether the output has not seen the newest ones.
    pub(super) controls: Mutex<Controls>,
    pub(super) unseen_controls: AtomicBool,
    /// Gestures that the avatar knows, and the number of requested ones that have begun.
    pub gestures: Gestures,
    pub(super) begun_gestures: AtomicU64,
    /// Number of viseme hints that were shown or dropped.
    pub(super) passed_hints: AtomicU64,
    /// Loudness of the interlocutor, as the bits of a float.
    pub(super) other_level: AtomicU32,
    /// Time of that measurement, by [`Self::now`].
    pub(super) other_time: AtomicU64,
    pub(super) other: Mutex<OtherInput>,
    /// Packets of the session's chunks, if it has any.
    pub(super) packets: Option<PacketQueue>,
    /// The engine's side from before the chunk in work.
    pub(super) kept: Mutex<Kept>,
    pub(super) input: Mutex<Input>,
    pub(super) output: Mutex<Boxed<Output>>,
    pub(crate) stats: Counters,
    pub(crate) delays: Delays,
    pub(crate) clock: Clock,
    /// The host's time, in nanoseconds of the clock's count; 0 while the clock is used.
    pub(super) host_time: AtomicU64,
    /// Time of the last push of audio, by [`Self::now`].
    pub(super) heard: AtomicU64,
    /// Upper bound on the future audio that a frame needs, in samples at the session's rate.
    pub(super) algorithmic_samples: usize,
    /// Upper bound for its mouth.
    pub(super) mouth_samples: usize,
    pub(super) channels: usize,
    pub(super) frame_rate: usize,
    pub(super) sample_rate: usize,
}

#[derive(Debug, Default)]
pub(crate) struct Counters {
    pub(crate) chunks: AtomicU64,
    pub(crate) frames: AtomicU64,
    pub(crate) late_frames: AtomicU64,
    pub(crate) held_chunks: AtomicU64,
    pub(crate) dropped_frames: AtomicU64,
    pub(super) overruns: AtomicU64,
    pub(super) silenced: AtomicU64,
}

impl Counters {
    /// Number of counters that the engine increments.
    pub(super) const OF_ENGINE: usize = 4;

    /// The counters that the engine increments, which precede the others in a state.
    pub(super) fn of_engine(&self) -> [&AtomicU64; Self::OF_ENGINE] {
        [&self.chunks, &self.frames, &self.late_frames, &self.held_chunks]
    }
}

impl Shared {
    pub(crate) fn idle(&self) -> Idle {
        match self.idle.load(Ordering::Relaxed) {
            1 => Idle::Rest,
            2 => Idle::Live,
            _ => Idle::Hold,
        }
    }

    /// Calls `take` with the settings if they have changed. If the host is writing them now, the
    /// next chunk takes them.
    pub(crate) fn take_settings(&self, take: impl FnOnce(&Settings)) {
        if self.unseen.load(Ordering::Acquire)
            && let Some(settings) = try_lock(&self.settings)
        {
            self.unseen.store(false, Ordering::Relaxed);
            take(&settings);
        }
    }

    /// Ends the session with a failure.
    pub(crate) fn fail(&self, failure: Failure) {
        // The first failure is kept.
        let _ = self.failure.set(failure);
        self.state.store(FAILED, Ordering::Release);
    }

    /// Whether frames are queued for the host.
    pub(super) fn has_frames(&self) -> bool {
        self.packets.as_ref().is_none_or(|queue| queue.with_frames)
    }

    /// The panic that ended the session.
    pub(super) fn defect(&self) -> Option<&Defect> {
        match self.failure.get() {
            Some(Failure::Defect(defect)) => Some(defect),
            _ => None,
        }
    }

    /// Marks the engine as gone.
    pub(crate) fn close(&self) {
        let _ = self.state.compare_exchange(RUNNING, CLOSED, Ordering::AcqRel, Ordering::Relaxed);
    }

    /// Whether the engine still computes the session.
    pub(crate) fn is_running(&self) -> bool {
        self.state.load(Ordering::Acquire) == RUNNING
    }

    /// Time for idle motion, nanoseconds: the host's if it sets one, otherwise the clock's.
    pub(super) fn now(&self) -> u64 {
        match self.host_time.load(Ordering::Relaxed) {
            0 => self.clock.nanos(),
            time => time,
        }
    }

    pub(crate) fn check(&self) -> Result<(), SessionError> {
        match self.state.load(Ordering::Acquire) {
            FAILED => match self.failure.get() {
                Some(&Failure::Step(error)) => Err(SessionError::Failed(error)),
                _ => Err(SessionError::Panicked),
            },
            CLOSED => Err(SessionError::Closed),
            _ => Ok(()),
        }
    }

    /// Sample frame, at the session's rate, that a frame of the stream belongs to.
    pub(super) fn sample_of(&self, frame: u64) -> u64 {
        frame * self.sample_rate as u64 / self.frame_rate as u64
    }

    /// Begins a stream in which `pushed` sample frames were pushed and count as covered.
    pub(super) fn begin_backlog(&self, pushed: u64) {
        self.pushed.store(pushed, Ordering::Relaxed);
        self.covered.store(pushed, Ordering::Relaxed);
    }

    /// Marks the stream as covered by frames up to sample frame `sample`, and records the backlog
    /// until now.
    pub(crate) fn cover(&self, sample: u64) {
        self.backlog();
        self.covered.store(sample, Ordering::Relaxed);
    }

    /// Backlog: sample frames by which the newest frame is behind the newest audio, beyond the
    /// algorithmic latency. Returns the current value and the largest so far.
    pub(super) fn backlog(&self) -> (u64, u64) {
        let pushed = self.pushed.load(Ordering::Relaxed);
        let promised = self.covered.load(Ordering::Relaxed) + self.algorithmic_samples as u64;
        let backlog = pushed.saturating_sub(promised);
        (backlog, self.largest_backlog.fetch_max(backlog, Ordering::Relaxed).max(backlog))
    }
}

/// Takes the lock if it is free. A side that panicked left its data consistent, so poisoning is
/// ignored.
pub(super) fn try_lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}

/// The engine's inputs for a new session.
pub(crate) struct SessionInit<'a> {
    pub(crate) model: &'a Arc<Model>,
    pub(crate) assembly: &'a Assembly,
    pub(crate) rest: &'a OwnedFrame,
    /// Upper bound on the frames of a chunk.
    pub(crate) chunk_frames: usize,
    /// Upper bound on the samples of a chunk; 0 if the avatar takes no speech.
    pub(crate) chunk_samples: usize,
    /// Bytes of the buffers of the engine's side.
    pub(crate) kept: usize,
    pub(crate) clock: Clock,
    pub(crate) signal: Arc<Signal>,
    /// Converts the session's rate to the model's.
    pub(crate) resampler: Resampler,
    /// Whether frames come from packets instead of audio.
    pub(crate) is_decoder: bool,
    /// The allocator of all of it.
    pub(crate) arena: &'a Arena,
}

impl Shared {
    pub(crate) fn new(init: SessionInit, session: &SessionConfig) -> Result<Self, LoadError> {
        let SessionInit { model, assembly, rest, chunk_frames, chunk_samples, clock, signal, resampler, .. } = init;
        let (has_audio, is_decoder, arena) = (chunk_samples > 0, init.is_decoder, init.arena);
        let config = model.config();
        in_range("queue_frames", session.queue_frames, 2 * chunk_frames, MAX_QUEUE)?;
        let (rate, face_values) = (config.audio.sample_rate, assembly.face_values());
        let input = Input::new_in(resampler, session.sample_rate, session.channels, config, arena);
        let algorithmic_samples = session.latency_with(config, has_audio);
        let mut mouth_samples = algorithmic_samples;
        let voice = match session.voice {
            Voice::Delayed => None,
            Voice::Live => {
                let frames = (algorithmic_samples * config.frame_rate).div_ceil(session.sample_rate) + MORE_FRAMES;
                let voice = LiveVoice::new_in(Arc::clone(model), frames as u64, rest, arena).filter(|_| has_audio);
                let missing =
                    || LoadError::argument("voice", "live: the model has no mouth network, or takes no audio");
                let voice = voice.ok_or_else(missing)?;
                let delay = voice.latency_samples() * session.sample_rate;
                mouth_samples = delay.div_ceil(rate) + input.resampler().most_delay();
                Some(arena.boxed(voice))
            }
        };
        let chunk = (config.max_target + config.audio.ahead) * config.samples_per_keyframe();
        Ok(Self {
            link: Link::new_in(
                (if is_decoder { 1 } else { (AUDIO_SECONDS * rate).max(2 * chunk) + input.most_left() }, chunk_samples),
                voice.is_some(),
                FrameRing::new_in(session.queue_frames, face_values, arena),
                clock.nanos(),
                signal,
                arena,
            ),
            pushed: AtomicU64::new(0),
            covered: AtomicU64::new(0),
            largest_backlog: AtomicU64::new(0),
            dropped: AtomicBool::new(false),
            state: AtomicU8::new(RUNNING),
            failure: OnceLock::new(),
            idle: AtomicU8::new(session.idle as u8),
            gains: PerPart::from_fn(|_| AtomicU32::new(1.0_f32.to_bits())),
            settings: Mutex::new(Settings::new(&session.avatar)),
            unseen: AtomicBool::new(false),
            controls: Mutex::new(Controls::new(session.layers)),
            unseen_controls: AtomicBool::new(true),
            gestures: session.gestures.clone(),
            begun_gestures: AtomicU64::new(0),
            passed_hints: AtomicU64::new(0),
            other_level: AtomicU32::new(0.0_f32.to_bits()),
            other_time: AtomicU64::new(clock.nanos()),
            other: Mutex::new(OtherInput::new(session.sample_rate, session.channels, config)),
            output: Mutex::new(arena.boxed(Output::new_in(
                session,
                config,
                Life::new(
                    (&config.skeleton, &config.face),
                    config.frame_rate,
                    rest,
                    session.avatar.sampler.seed,
                    session.gestures.clone(),
                ),
                voice,
                rest,
                assembly.is_arkit(),
                chunk_frames,
                is_decoder,
                arena,
            ))),
            packets: session.packets.map(|packets| {
                let length = session.avatar.target * config.keyframe_stride;
                PacketQueue::new_in(packets, model, (session.queue_frames, length), arena)
            }),
            kept: Mutex::new(Kept::new_in(init.kept, arena)),
            input: Mutex::new(input),
            stats: Counters::default(),
            delays: Delays::new_in(arena),
            algorithmic_samples,
            mouth_samples,
            channels: session.channels,
            frame_rate: config.frame_rate,
            sample_rate: session.sample_rate,
            host_time: AtomicU64::new(0),
            heard: AtomicU64::new(clock.nanos()),
            clock,
        })
    }
}
