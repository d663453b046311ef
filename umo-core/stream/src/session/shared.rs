//! State shared by the sides of a session.

use std::sync::atomic::AtomicU64;
use std::sync::{Arc, Mutex};

use umo_core_base::clock::Clock;
use umo_core_base::error::LoadError;
use umo_core_base::memory::{Arena, Boxed};
use umo_core_model::audio::resample::Resampler;
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::lm::layout::MAX_PROMPT_TOKENS;
use umo_core_model::lm::sampler::Sampler;
use umo_core_model::model::Model;
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Assembly;

use super::backlog::Backlog;
use super::config::{AUDIO_SECONDS, MAX_QUEUE, SessionConfig, in_range};
use super::delay::Delays;
use super::input::Input;
use super::kept::Kept;
use super::other::OtherInput;
use super::outcome::Outcome;
use super::output::Output;
use super::packets::PacketQueue;
pub(super) use crate::link::try_lock;
use crate::link::{FrameRing, Handover, Link, Signal};
use crate::playback::{Host, LiveVoice, Voice};
use crate::take::{Head, Log, Patch, Recorder, Take};

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

/// State shared by the sides of a session.
#[derive(Debug)]
pub(crate) struct Shared {
    /// The protocol between the sides.
    pub(crate) link: Link,
    /// What the host sets for the frame side.
    pub(super) host: Host,
    pub(crate) backlog: Backlog,
    pub(crate) outcome: Outcome,
    /// The host's settings of the engine's side.
    pub(super) settings: Handover<Settings>,
    pub(super) other: Mutex<OtherInput>,
    /// Packets of the session's chunks, if it has any.
    pub(super) packets: Option<PacketQueue>,
    /// The take that it plays, if it plays one.
    pub(super) take: Option<Take>,
    /// Recorder of its own take, if it records one.
    pub(super) recorder: Option<Recorder>,
    /// The engine's side from before the chunk in work.
    pub(super) kept: Mutex<Kept>,
    pub(super) input: Mutex<Input>,
    pub(super) output: Mutex<Boxed<Output>>,
    pub(crate) stats: Counters,
    pub(super) format: Format,
}

/// Rates, channels and latency of a session.
#[derive(Clone, Copy, Debug)]
pub(super) struct Format {
    pub(super) channels: usize,
    pub(super) frame_rate: usize,
    pub(super) sample_rate: usize,
    /// Upper bound on the future audio that a frame needs, in samples at the session's rate.
    pub(super) algorithmic_samples: usize,
    /// Upper bound for its mouth.
    pub(super) mouth_samples: usize,
}

impl Format {
    /// Sample frame, at the session's rate, that a frame of the stream belongs to.
    pub(super) fn sample_of(&self, frame: u64) -> u64 {
        frame * self.sample_rate as u64 / self.frame_rate as u64
    }
}

/// Statistics of a session.
#[derive(Debug)]
pub(crate) struct Counters {
    pub(crate) chunks: AtomicU64,
    pub(crate) frames: AtomicU64,
    pub(crate) late_frames: AtomicU64,
    pub(crate) held_chunks: AtomicU64,
    pub(crate) dropped_frames: AtomicU64,
    pub(super) overruns: AtomicU64,
    pub(super) silenced: AtomicU64,
    /// Compute times of the chunks; not part of a state.
    pub(crate) delays: Delays,
}

impl Counters {
    /// Number of counters that the engine increments.
    pub(super) const OF_ENGINE: usize = 4;

    fn new_in(arena: &Arena) -> Self {
        let [chunks, frames, late_frames, held_chunks] = Default::default();
        let [dropped_frames, overruns, silenced] = Default::default();
        let delays = Delays::new_in(arena);
        Self { chunks, frames, late_frames, held_chunks, dropped_frames, overruns, silenced, delays }
    }

    /// The counters that the engine increments, which precede the others in a state.
    pub(super) fn of_engine(&self) -> [&AtomicU64; Self::OF_ENGINE] {
        [&self.chunks, &self.frames, &self.late_frames, &self.held_chunks]
    }
}

impl Shared {
    /// Whether frames are queued for the host.
    pub(super) fn has_frames(&self) -> bool {
        self.packets.as_ref().is_none_or(|queue| queue.with_frames)
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
    /// The take that it plays, if it plays one.
    pub(crate) take: Option<&'a Take>,
    /// Changed frames of that take.
    pub(crate) patches: Option<Arc<[Patch]>>,
    /// The allocator of all of it.
    pub(crate) arena: &'a Arena,
}

impl SessionInit<'_> {
    fn has_audio(&self) -> bool {
        self.chunk_samples > 0
    }

    /// The live mouth, if the session has one, whose body lags by at least `latency` samples.
    fn voice(&self, session: &SessionConfig, latency: usize) -> Result<Option<LiveVoice>, LoadError> {
        match session.voice {
            Voice::Delayed => Ok(None),
            Voice::Mouth => {
                let voice = LiveVoice::new_in(Arc::clone(self.model), None, self.rest, self.arena);
                let missing = || LoadError::argument("voice", "mouth: the model has no mouth network");
                voice.map(Some).ok_or_else(missing)
            }
            Voice::Live => {
                let frame_rate = self.model.config().frame_rate;
                let frames = (latency * frame_rate).div_ceil(session.sample_rate) + MORE_FRAMES;
                let voice = LiveVoice::new_in(Arc::clone(self.model), Some(frames as u64), self.rest, self.arena);
                let missing =
                    || LoadError::argument("voice", "live: the model has no mouth network, or takes no audio");
                voice.filter(|_| self.has_audio()).map(Some).ok_or_else(missing)
            }
        }
    }

    fn format(&self, session: &SessionConfig, algorithmic_samples: usize, voice: Option<&LiveVoice>) -> Format {
        let config = self.model.config();
        let live = |voice: &LiveVoice| {
            let delay = voice.latency_samples() * session.sample_rate;
            delay.div_ceil(config.audio.sample_rate) + self.resampler.most_delay()
        };
        let mouth_samples = voice.map_or(algorithmic_samples, live);
        Format {
            channels: session.channels,
            frame_rate: config.frame_rate,
            sample_rate: session.sample_rate,
            algorithmic_samples: if session.voice == Voice::Mouth { mouth_samples } else { algorithmic_samples },
            mouth_samples,
        }
    }

    fn link(&self, session: &SessionConfig) -> Link {
        let (is_live, is_mouth) = (session.voice == Voice::Live, session.voice == Voice::Mouth);
        let config = self.model.config();
        let chunk = (config.max_target + config.audio.ahead) * config.samples_per_keyframe();
        let audio = (AUDIO_SECONDS * config.audio.sample_rate).max(2 * chunk) + self.resampler.most_left();
        Link::new_in(
            (if self.is_decoder { 1 } else { audio }, self.chunk_samples),
            is_live,
            // No frames are queued of a mouth alone.
            FrameRing::new_in(if is_mouth { 1 } else { session.queue_frames }, self.assembly.face_values(), self.arena),
            self.clock.nanos(),
            Arc::clone(&self.signal),
            self.arena,
        )
    }
}

impl Shared {
    pub(crate) fn new(init: SessionInit, session: &SessionConfig) -> Result<Self, LoadError> {
        let (config, arena) = (init.model.config(), init.arena);
        in_range("queue_frames", session.queue_frames, 2 * init.chunk_frames, MAX_QUEUE)?;
        let latency = session.latency_with(config, init.has_audio());
        let voice = init.voice(session, latency)?;
        let format = init.format(session, latency, voice.as_ref());
        let link = init.link(session);
        let output = Output::new_in(&init, session, voice.map(|voice| arena.boxed(voice)));
        let avatar = &session.avatar;
        Ok(Self {
            link,
            host: Host::new(
                init.clock,
                crate::playback::controls(&avatar.sampler, session.layers),
                (session.gestures.clone(), session.words.clone()),
                session.idle,
            ),
            backlog: Backlog::new(format.algorithmic_samples),
            outcome: Outcome::new(),
            settings: Handover::new(Settings::new(avatar), false),
            other: Mutex::new(OtherInput::new(session.sample_rate, session.channels, config)),
            packets: session.packets.map(|packets| {
                let length = avatar.target * config.keyframe_stride;
                PacketQueue::new_in(packets, init.model, (session.queue_frames, length, avatar.held_back()), arena)
            }),
            take: init.take.cloned(),
            recorder: (session.take_bytes > 0).then(|| {
                let of = (config, init.model.fingerprint());
                let head = Head::new(of, avatar, session.layers, session.sample_rate, &[], arena);
                Recorder::new(head, session.words.fingerprint(), Log::bounded_in(session.take_bytes, arena))
            }),
            kept: Mutex::new(Kept::new_in(init.kept, arena)),
            input: Mutex::new(Input::new_in(init.resampler, session.sample_rate, session.channels, config, arena)),
            output: Mutex::new(arena.boxed(output)),
            stats: Counters::new_in(arena),
            format,
        })
    }
}
