//! Settings of a session.

use std::time::Duration;

use umo_core_base::error::LoadError;
use umo_core_layers::{Gestures, LayerGains, WordRules};
use umo_core_model::audio::resample;
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::config::Config;
use umo_core_model::lm::layout::Template;

use crate::playback::{Idle, Voice};

/// Least amount of queued audio, in seconds, at which
/// [`Session::push_audio`](super::Session::push_audio) may refuse more.
pub const AUDIO_SECONDS: usize = 10;
/// Lowest sample rate of a session, per second.
pub const MIN_RATE: usize = 8_000;
/// Highest sample rate of a session, per second.
pub const MAX_RATE: usize = 192_000;
/// Most channels of a session's audio.
pub const MAX_CHANNELS: usize = 64;
/// Longest [`Session::interrupt`](super::Session::interrupt).
pub const MAX_EASE: Duration = Duration::from_secs(10);

/// Upper bound of [`SessionConfig::queue_frames`].
pub(super) const MAX_QUEUE: usize = 1 << 16;

/// Default [`smoothing`](AvatarConfig::smoothing) of a session: removes the decoders' jitter and
/// keeps the strokes.
const SMOOTHING: f32 = 1.2;

/// Default [`expression`](umo_core_model::lm::sampler::Sampler::expression) of a session.
const EXPRESSION: f32 = 0.5;
/// Default [`activity`](umo_core_model::lm::sampler::Sampler::activity) of a session: hands rest as often as people's.
const ACTIVITY: f32 = 0.5;

/// Packets of a session (SPEC 2.18).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketConfig {
    /// Keyframes before its own chunk that a packet repeats, at most as many as the model's history
    /// holds.
    pub history: usize,
    /// Whether frames are queued, too. Without them, nothing waits for
    /// [`Session::pull_frames`](super::Session::pull_frames).
    pub with_frames: bool,
}

impl PacketConfig {
    /// Packets in addition to frames. Each packet repeats the previous chunk, so that a single lost
    /// packet changes nothing.
    pub fn new(target: usize) -> Self {
        Self { history: target, with_frames: true }
    }
}

/// Settings of a session.
#[derive(Clone, Debug)]
pub struct SessionConfig {
    /// The avatar.
    pub avatar: AvatarConfig,
    /// Initial gain of each layer over the model's frames.
    pub layers: LayerGains,
    /// Available gestures.
    pub gestures: Gestures,
    /// Rules of the words that [`Session::hint_words`](super::Session::hint_words) takes.
    pub words: WordRules,
    /// Sample rate of the pushed audio, [`MIN_RATE`] to [`MAX_RATE`].
    pub sample_rate: usize,
    /// Number of interleaved channels of that audio, 1 to [`MAX_CHANNELS`]; they are mixed down.
    pub channels: usize,
    /// Timing of the mouth, and whether there is a body. [`Voice::Live`] and [`Voice::Mouth`] need a model with a mouth
    /// network.
    pub voice: Voice,
    /// Behaviour while no audio comes.
    pub idle: Idle,
    /// Time without audio after which [`Idle::Rest`] and [`Idle::Live`] begin.
    pub idle_after: Duration,
    /// Duration of the ease to rest, and of the way back.
    pub ease: Duration,
    /// Capacity of the frame queue; the engine pauses while a chunk does not fit. At least two
    /// chunks' worth.
    pub queue_frames: usize,
    /// Packets for [`Session::decoder`](super::Session::decoder)s elsewhere, if any.
    pub packets: Option<PacketConfig>,
    /// Bytes of memory for a take that is recorded while the session runs
    /// ([`Session::take`](super::Session::take)), some 700 a second; 0 for none.
    pub take_bytes: usize,
    /// For a [`Session::decoder`](super::Session::decoder): number of later packets, 0 to 4, that
    /// may arrive before a missing one counts as lost.
    pub reorder_window: usize,
}

impl SessionConfig {
    /// The model's defaults, speech to motion, mono audio at the model's rate, with smoothing and
    /// all layers.
    pub fn new(config: &Config) -> Self {
        Self {
            avatar: {
                let mut avatar = AvatarConfig::new(config);
                avatar.smoothing = SMOOTHING;
                (avatar.sampler.activity, avatar.sampler.expression) = (ACTIVITY, EXPRESSION);
                avatar
            },
            layers: LayerGains::ON,
            gestures: Gestures::new(),
            words: WordRules::english(),
            sample_rate: config.audio.sample_rate,
            channels: 1,
            voice: Voice::Delayed,
            idle: Idle::Hold,
            idle_after: Duration::from_millis(300),
            ease: Duration::from_millis(500),
            queue_frames: 4 * config.max_target * config.keyframe_stride,
            packets: None,
            take_bytes: 0,
            reorder_window: 0,
        }
    }

    /// Upper bound on the future audio that a frame needs, in samples at the session's rate,
    /// including resampling: the [`algorithmic_samples`](super::Latency::algorithmic_samples) of a
    /// session with these settings.
    ///
    /// # Errors
    /// [`LoadError::Config`] if the template is missing, or the target, the lookahead or the rate
    /// is out of range.
    pub fn latency_samples(&self, config: &Config) -> Result<usize, LoadError> {
        self.avatar.check(config)?;
        if self.voice == Voice::Mouth {
            let missing = || LoadError::argument("voice", "mouth: the model has no mouth network");
            let mouth = config.mouth.as_ref().ok_or_else(missing)?;
            let samples = (mouth.ahead * config.audio.sample_rate).div_ceil(config.frame_rate * mouth.rows);
            resample::check_rates(self.sample_rate, config.audio.sample_rate)
                .map_err(|error| LoadError::config("sample_rate", error.to_string()))?;
            let delay = resample::most_delay(self.sample_rate, config.audio.sample_rate);
            return Ok((samples * self.sample_rate).div_ceil(config.audio.sample_rate) + delay);
        }
        let has_audio = Template::new(config, &self.avatar.template)?.has_audio();
        resample::check_rates(self.sample_rate, config.audio.sample_rate)
            .map_err(|error| LoadError::config("sample_rate", error.to_string()))?;
        Ok(self.latency_with(config, has_audio))
    }

    /// Checks the ranges of rate and channels.
    #[doc(hidden)]
    pub fn check(&self) -> Result<(), LoadError> {
        in_range("sample_rate", self.sample_rate, MIN_RATE, MAX_RATE)?;
        in_range("channels", self.channels, 1, MAX_CHANNELS)?;
        let has_frames = self.packets.is_none_or(|packets| packets.with_frames);
        if self.take_bytes > 0 && (self.voice != Voice::Delayed || !has_frames) {
            let problem =
                "a take is recorded of delayed frames: not with a live voice or the mouth alone, nor of packets alone";
            return Err(LoadError::argument("take_bytes", problem));
        }
        if self.voice == Voice::Mouth && self.packets.is_some() {
            return Err(LoadError::argument("packets", "the mouth alone has no chunks to make packets of"));
        }
        check_words(&self.words, &self.gestures)
    }

    /// [`Self::latency_samples`] of checked settings.
    pub(super) fn latency_with(&self, config: &Config, has_audio: bool) -> usize {
        let frames = self.avatar.latency_frames(config);
        let delay = if has_audio { resample::most_delay(self.sample_rate, config.audio.sample_rate) } else { 0 };
        (frames * self.sample_rate).div_ceil(config.frame_rate) + delay
    }
}

/// Checks that the avatar knows the gestures of its word rules.
pub(crate) fn check_words(words: &WordRules, gestures: &Gestures) -> Result<(), LoadError> {
    match words.unknown_gesture(|name| gestures.stroke(name).is_some()) {
        None => Ok(()),
        Some((class, gesture)) => {
            let problem =
                format!("class {class} has the gesture {gesture}, which the avatar does not know: add it first");
            Err(LoadError::argument("words", problem))
        }
    }
}

/// Checks that a setting is in `from..=to`.
pub(super) fn in_range(name: &'static str, got: usize, from: usize, to: usize) -> Result<(), LoadError> {
    if (from..=to).contains(&got) {
        return Ok(());
    }
    Err(LoadError::argument(name, format!("expected {from} to {to}, got {got}")))
}
