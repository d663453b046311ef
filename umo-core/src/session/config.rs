//! What a session is made with.

use std::time::Duration;

use super::voice::Voice;
use crate::audio::resample;
use crate::avatar::AvatarConfig;
use crate::config::Config;
use crate::error::LoadError;
use crate::life::LifeConfig;
use crate::lm::layout::Template;

/// Least seconds of audio that wait for the engine before
/// [`Session::push_audio`](super::Session::push_audio) takes no more.
pub const AUDIO_SECONDS: usize = 10;
/// Lowest sample rate of a session, per second.
pub const MIN_RATE: usize = 8_000;
/// Highest sample rate of a session, per second.
pub const MAX_RATE: usize = 192_000;
/// Most channels of a session's audio.
pub const MAX_CHANNELS: usize = 64;
/// Largest gain of a part.
pub const MAX_GAIN: f32 = 2.0;
/// Longest [`Session::interrupt`](super::Session::interrupt).
pub const MAX_EASE: Duration = Duration::from_secs(10);

/// Most frames that wait for the host.
pub(super) const MAX_QUEUE: usize = 1 << 16;

/// A session's [`smoothing`](AvatarConfig::smoothing): what takes the decoders' tremor away and
/// leaves the strokes.
const SMOOTHING: f32 = 1.2;

/// Packets of a session (SPEC 2.18).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct PacketConfig {
    /// Keyframes before those of its chunk that a packet says again, as many as fit the model's
    /// history.
    pub history: usize,
    /// Whether frames are queued, too. Without them nothing waits for
    /// [`Session::pull_frames`](super::Session::pull_frames).
    pub with_frames: bool,
}

impl PacketConfig {
    /// Packets beside frames, each of which says the chunk before again: one that is lost changes
    /// nothing.
    pub fn new(target: usize) -> Self {
        Self { history: target, with_frames: true }
    }
}

/// What a session is made with.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct SessionConfig {
    /// The avatar.
    pub avatar: AvatarConfig,
    /// Samples per second of the audio that is pushed, [`MIN_RATE`] to [`MAX_RATE`].
    pub sample_rate: usize,
    /// Interleaved channels of that audio, 1 to [`MAX_CHANNELS`]; they are mixed.
    pub channels: usize,
    /// When the mouth moves. [`Voice::Live`] needs a model with a mouth network.
    pub voice: Voice,
    /// What is shown while no audio comes.
    pub idle: Idle,
    /// Time without audio after which [`Idle::Rest`] and [`Idle::Live`] begin.
    pub idle_after: Duration,
    /// How long an ease to rest takes, and the way back from it.
    pub ease: Duration,
    /// Frames that wait for the host before the engine stops computing: at least two chunks' worth.
    pub queue_frames: usize,
    /// Packets for [`Session::decoder`](super::Session::decoder)s elsewhere, where there are any.
    pub packets: Option<PacketConfig>,
    /// Of a [`Session::decoder`](super::Session::decoder): packets that may come before one that is missing counts as lost,
    /// 0 to 4.
    pub patience: usize,
}

/// What is shown while no audio comes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Idle {
    /// The last pose.
    #[default]
    Hold,
    /// An ease to the rest pose; only [`Session::sample_pose`](super::Session::sample_pose) shows
    /// it.
    Rest,
    /// The model, run on silence.
    Live,
}

impl SessionConfig {
    /// The model's own defaults, speech to motion, mono audio at the model's rate, smoothed, with
    /// all layers.
    pub fn new(config: &Config) -> Self {
        Self {
            avatar: AvatarConfig { smoothing: SMOOTHING, life: LifeConfig::ON, ..AvatarConfig::new(config) },
            sample_rate: config.audio.sample_rate,
            channels: 1,
            voice: Voice::Delayed,
            idle: Idle::Hold,
            idle_after: Duration::from_millis(300),
            ease: Duration::from_millis(500),
            queue_frames: 4 * config.max_target * config.keyframe_stride,
            packets: None,
            patience: 0,
        }
    }

    /// Samples of future audio, at the session's rate, that a frame needs at most, resampling
    /// included: the [`algorithmic_samples`](super::Latency::algorithmic_samples) of a session made
    /// with this.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the template is missing, or the target, the lookahead or the
    /// rate is out of range.
    pub fn latency_samples(&self, config: &Config) -> Result<usize, LoadError> {
        self.avatar.check(config)?;
        let has_audio = Template::new(config, &self.avatar.template)?.has_audio();
        resample::check_rates(self.sample_rate, config.audio.sample_rate)
            .map_err(|error| LoadError::config("sample_rate", error.to_string()))?;
        Ok(self.latency_with(config, has_audio))
    }

    /// Refuses a rate or channels that no session has.
    pub(crate) fn check(&self) -> Result<(), LoadError> {
        in_range("sample_rate", self.sample_rate, MIN_RATE, MAX_RATE)?;
        in_range("channels", self.channels, 1, MAX_CHANNELS)
    }

    /// [`Self::latency_samples`] of settings that were checked.
    pub(super) fn latency_with(&self, config: &Config, has_audio: bool) -> usize {
        let frames = self.avatar.latency_frames(config);
        let delay = if has_audio { resample::most_delay(self.sample_rate, config.audio.sample_rate) } else { 0 };
        (frames * self.sample_rate).div_ceil(config.frame_rate) + delay
    }
}

/// That a number of a configuration is `from` to `to`.
pub(super) fn in_range(key: &str, got: usize, from: usize, to: usize) -> Result<(), LoadError> {
    if (from..=to).contains(&got) {
        return Ok(());
    }
    Err(LoadError::config(key, format!("expected {from} to {to}, got {got}")))
}
