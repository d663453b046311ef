//! State that one avatar keeps between two chunks: windows, history, motion (paper section 3.1; SPEC 2, 2.8). A
//! [`Batch`](crate::batch::Batch) computes its chunks.

use std::ops::Range;
use std::time::Duration;

use umo_core_base::arousal::ORDINARY;
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{Fingerprint, StateError, StatePass};

use crate::audio::AudioStream;
use crate::config::Config;
use crate::layout::{FREE, Run, Shape, Window};
use crate::lm::generate::ChunkSampling;
use crate::lm::layout::{MAX_PROMPT_TOKENS, Prompt, Template, window_tokens};
use crate::lm::sampler::{Sampler, USUAL_ACTIVITY};
use crate::lm::{LayerTimes, depth};
use crate::model::Model;
use crate::motion::Smoothing;
use crate::mouth::heard::HeardMouth;
use crate::pauses::Pauses;

/// Upper bound on a stream's chunks: 6,900 years at five a second.
const MAX_CHUNKS: u64 = 1 << 40;
/// Upper bound on a stream's frames.
const MAX_FRAMES: u64 = 1 << 50;

/// Time before the end of a stream in which hands come to rest, seconds.
const END_SECONDS: f32 = 1.0;

/// Bias towards rest in silence, nats.
const REST_NATS: f32 = 8.0;
/// Bias away from rest for an activity of 1 more, up to 0.5 and beyond it, nats. Layers make rests at 0.5, between which
/// hands are busy.
const ACTIVE_NATS: [f32; 2] = [6.0, 1.0];
/// The same under a prompt, below [`USUAL_ACTIVITY`] and beyond 0.5.
const PROMPTED_NATS: f32 = 4.0;
/// Bias away from rest of the liveliest voice, and towards it of the dullest, at an expression of 0.5, nats. Less of the
/// second: a voice may be flat because it is cold.
const LIVELY_NATS: f32 = 1.8;
const DULL_NATS: f32 = 1.1;

/// Settings of an avatar.
#[derive(Clone, Debug)]
pub struct AvatarConfig {
    /// Keyframes per chunk, `1..=max_target`.
    pub target: usize,
    /// Frames held back until the next chunk (SPEC 2.8); more if [`Self::smoothing`] looks further ahead.
    pub lookahead: usize,
    /// Standard deviation of the low-pass over the body's motion, frames, 0 to 1.5. 0 leaves the decoders' motion
    /// unchanged, bit for bit. The filter looks two standard deviations ahead, 3 frames at most. The face is not
    /// smoothed.
    pub smoothing: f32,
    /// Sampling of codes.
    pub sampler: Sampler,
    /// Name of the encoder's template.
    pub template: String,
    /// Token ids of a free text, for templates that take one.
    pub text: Vec<u32>,
    /// Keyframes of audio after a chunk that must have arrived before it, `0..=audio.ahead`: the motion anticipates
    /// speech, and latency grows by the same amount (SPEC 2.15).
    pub horizon: usize,
    /// Strength of classifier-free guidance by the text, 1 to 3: logits are extrapolated from those without the text
    /// towards and beyond those with it. 1 uses the logits with the text only, at half the cost of other values (SPEC
    /// 2.16).
    pub guidance: f32,
}

/// Upper bound of [`AvatarConfig::guidance`].
pub const MAX_GUIDANCE: f32 = 3.0;

impl AvatarConfig {
    /// The model's own defaults, speech to motion: the decoders' motion without smoothing.
    pub fn new(config: &Config) -> Self {
        Self {
            target: config.target,
            lookahead: config.lookahead,
            smoothing: 0.0,
            sampler: Sampler { sampling: config.sampling, ..Sampler::GREEDY },
            template: "audio_to_motion".to_owned(),
            text: Vec::new(),
            horizon: 0,
            guidance: 1.0,
        }
    }

    /// Maximum number of frames of future speech that a frame needs with these settings: [`Config::latency_frames`],
    /// with frames held back for smoothing, plus the horizon.
    pub fn latency_frames(&self, config: &Config) -> usize {
        config.latency_frames(self.target, self.held_back()) + self.horizon * config.keyframe_stride
    }

    /// Frames held back until the next chunk, including those that smoothing needs.
    #[doc(hidden)]
    pub fn held_back(&self) -> usize {
        self.lookahead.max(Smoothing::new(self.smoothing).map_or(0, |smoothing| smoothing.radius()))
    }

    /// Checks the settings against the model's ranges.
    #[doc(hidden)]
    pub fn check(&self, config: &Config) -> Result<(), LoadError> {
        if !(1..=config.max_target).contains(&self.target) {
            return Err(LoadError::argument(
                "target",
                format!("expected 1 to {}, got {}", config.max_target, self.target),
            ));
        }
        let most = config.keyframe_stride * config.prefix;
        if self.lookahead > most {
            return Err(LoadError::argument("lookahead", format!("expected 0 to {most}, got {}", self.lookahead)));
        }
        let ahead = config.audio.ahead;
        if self.horizon > ahead {
            return Err(LoadError::argument("horizon", format!("expected 0 to {ahead}, got {}", self.horizon)));
        }
        let activity = self.sampler.activity;
        if !(0.0..=1.0).contains(&activity) {
            return Err(LoadError::argument("activity", format!("expected 0 to 1, got {activity}")));
        }
        let expression = self.sampler.expression;
        if !(0.0..=1.0).contains(&expression) {
            return Err(LoadError::argument("expression", format!("expected 0 to 1, got {expression}")));
        }
        let most = if depth::is_guidable(config) { MAX_GUIDANCE } else { 1.0 };
        if !(1.0..=most).contains(&self.guidance) {
            return Err(LoadError::argument("guidance", format!("expected 1 to {most}, got {}", self.guidance)));
        }
        Smoothing::new(self.smoothing).map(drop)
    }
}

/// Time spent in each stage (the rows of the paper's runtime table).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct StageTimes {
    /// Audio tokenizer.
    pub tokenizer: Duration,
    /// T5 encoder.
    pub encoder: Duration,
    /// T5 decoder, including the cross-attention's keys and values.
    pub decoder: Duration,
    /// Interpolation network.
    pub interp: Duration,
    /// VQ decoders and root network.
    pub motion: Duration,
    /// Depth network, in layout `frames`.
    pub depth: Duration,
    /// Layers of the encoder; included in `encoder`.
    pub encoder_layers: LayerTimes,
    /// Layers of the decoder; included in `decoder`.
    pub decoder_layers: LayerTimes,
}

impl StageTimes {
    /// Sum over all stages.
    pub fn total(&self) -> Duration {
        self.tokenizer + self.encoder + self.decoder + self.depth + self.interp + self.motion
    }

    /// Time added since `before`.
    #[must_use]
    pub fn since(&self, before: Self) -> Self {
        Self {
            tokenizer: self.tokenizer - before.tokenizer,
            encoder: self.encoder - before.encoder,
            decoder: self.decoder - before.decoder,
            interp: self.interp - before.interp,
            motion: self.motion - before.motion,
            depth: self.depth - before.depth,
            encoder_layers: self.encoder_layers.since(before.encoder_layers),
            decoder_layers: self.decoder_layers.since(before.decoder_layers),
        }
    }

    /// Adds the times of another thread.
    #[doc(hidden)]
    pub fn add(&mut self, more: Self) {
        self.tokenizer += more.tokenizer;
        self.encoder += more.encoder;
        self.decoder += more.decoder;
        self.interp += more.interp;
        self.motion += more.motion;
        self.depth += more.depth;
        self.encoder_layers += more.encoder_layers;
        self.decoder_layers += more.decoder_layers;
    }
}

/// One avatar: all state that a chunk leaves for the next.
#[derive(Debug)]
pub struct Avatar {
    /// Keyframes per chunk.
    pub target: usize,
    /// Frames held back, including those that smoothing needs.
    pub lookahead: usize,
    /// Keyframes of audio after the chunk.
    horizon: usize,
    pub(crate) guidance: f32,
    /// Standard deviation of the low-pass, frames.
    smoothing: f32,
    pub(crate) sampler: Sampler,
    template: Template,
    /// Hash of the template's name.
    template_name: u64,
    /// `[MAX_PROMPT_TOKENS]`; the first `text_len` are in use.
    text: Slice<u32>,
    text_len: usize,
    /// Chunks done.
    pub chunk: u64,
    /// Frames of the whole stream, once the end is known.
    pub total: Option<usize>,
    pub(crate) audio: Option<AudioStream>,
    pauses: Pauses,
    /// The mouth of its frames from their sound, if the model's network has the head for it.
    pub(crate) mouth: Option<HeardMouth>,
    /// Arousal of the voice at each keyframe of the next chunk.
    arousal: Slice<f32>,
    /// Audio of the next chunk, silence after the end of the stream. Sized for the first chunk, which also takes the
    /// keyframes up to the horizon.
    samples: Slice<f32>,
    /// Samples per keyframe, 0 without audio.
    keyframe_samples: usize,
    /// Units of the window, `[(P + N + horizon) * tokens_per_keyframe]`.
    pub(crate) units: Slice<u32>,
    /// Tokens of the window that lie after the horizon.
    hidden_units: usize,
    whole: Option<WholeFile>,
    /// Index of the phase of a gesture among the codes of a keyframe, if the model has it.
    intent: Option<usize>,
    /// Codes of the window.
    pub window: Window,
    /// State that the layout's chunks keep.
    pub run: Run,
}

/// Audio units of a whole recording, used instead of the stream's.
#[derive(Debug)]
struct WholeFile {
    units: Vec<u32>,
    /// Unit of silence, used before and after the recording.
    silence: u32,
    /// Number of the stream's units that were compared, and number that differed.
    compared: usize,
    differed: usize,
}

/// Next work of an avatar.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// A chunk can be computed.
    Chunk,
    /// A chunk can be computed without the language model: the body holds its pose, or all codes are set.
    Held,
    /// All chunks are done; the frames held back at the end are due.
    Flush,
    /// More audio is needed.
    Audio,
    /// None: all frames were emitted.
    Nothing,
}

impl Avatar {
    /// Creates an avatar at the start of its stream and allocates everything it will need.
    ///
    /// # Errors
    /// [`LoadError::Config`] if the template is missing; [`LoadError::Argument`] if a number is out of range.
    pub fn new(model: &Model, config: &AvatarConfig) -> Result<Self, LoadError> {
        Self::new_in(model, config, &Arena::system())
    }

    /// Creates an avatar in memory of `arena`.
    ///
    /// # Errors
    /// As in [`Self::new`].
    pub fn new_in(model: &Model, config: &AvatarConfig, arena: &Arena) -> Result<Self, LoadError> {
        let c = &model.config;
        model.check_body()?;
        config.check(c)?;
        let (got, limit) = (config.text.len(), MAX_PROMPT_TOKENS);
        if got > limit {
            return Err(LoadError::argument(
                "text",
                StepError::TooLong { what: "prompt tokens", got, limit }.to_string(),
            ));
        }
        let template = Template::new_in(c, &config.template, arena)?;
        let (tokens, new) = (c.tokens_per_keyframe(), (config.target + config.horizon) * c.tokens_per_keyframe());
        let hidden_units = (c.audio.ahead - config.horizon) * tokens;
        let window = window_tokens(c, config.target) - hidden_units;
        let audio = template.has_audio().then(|| model.body().tokenizer.stream_in(window, new, arena));
        let (lookahead, smoothing) = (config.held_back(), Smoothing::new(config.smoothing)?);
        let mut template_name = Fingerprint::new();
        template_name.add(config.template.as_bytes());
        Ok(Self {
            target: config.target,
            lookahead,
            horizon: config.horizon,
            guidance: config.guidance,
            smoothing: config.smoothing,
            sampler: config.sampler,
            template,
            template_name: template_name.0,
            text: arena.collect_len(MAX_PROMPT_TOKENS, config.text.iter().copied().chain(std::iter::repeat(0))),
            text_len: config.text.len(),
            chunk: 0,
            total: None,
            samples: arena.filled(0.0, if audio.is_some() { new * c.hop() } else { 0 }),
            pauses: Pauses::new_in(
                (config.target, config.horizon),
                (c.hop(), 1.0 / c.audio.token_rate as f32),
                c.keyframe_stride as f32 / c.frame_rate as f32,
                arena,
            ),
            mouth: model.mouth.as_ref().filter(|_| audio.is_some()).and_then(|mouth| {
                // Frames that were heard, and are not yet taken: a chunk with its horizon, and those held back.
                let frames = (config.target + config.horizon + 1) * c.keyframe_stride + lookahead;
                let face_values = model.assembly().face_values();
                HeardMouth::new_in(mouth, &c.face.names, (frames, face_values), arena)
            }),
            arousal: arena.filled(ORDINARY, config.target),
            keyframe_samples: if audio.is_some() { c.samples_per_keyframe() } else { 0 },
            audio,
            units: arena.filled(0, window),
            hidden_units,
            whole: None,
            intent: depth::intent(c),
            window: Window::new_in(c, config.target, arena),
            run: model.body().layout.run_in(
                c,
                &model.body().motion,
                Shape { target: config.target, lookahead, smoothing },
                arena,
            ),
        })
    }

    /// Returns to the start of a stream, with rest codes as history; text and sampler are kept. Never allocates.
    pub fn reset(&mut self) {
        (self.chunk, self.total, self.whole) = (0, None, None);
        if let Some(audio) = &mut self.audio {
            audio.reset();
        }
        self.pauses.reset();
        if let Some(mouth) = &mut self.mouth {
            mouth.reset();
        }
        self.arousal.fill(ORDINARY);
        self.window.rest();
        self.run.reset();
    }

    /// Properties that a saved state must share with this avatar, besides the model.
    pub fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("target", self.target as u64)?;
        pass.same("lookahead", self.lookahead as u64)?;
        pass.same("smoothing", self.smoothing.to_bits().into())?;
        pass.same("template", self.template_name)?;
        // Only layout `frames` has these.
        if let Run::Frames(_) = &self.run {
            pass.same("horizon", self.horizon as u64)?;
            pass.same("guidance", self.guidance.to_bits().into())?;
        }
        Ok(())
    }

    /// Describes all state that the last chunk leaves for the next; returns the samples of audio consumed so far.
    /// Units are omitted, because each chunk writes them before it reads them, and so are whole-recording units,
    /// which sessions never have.
    #[expect(clippy::cast_possible_truncation, reason = "a session's counts fit its memory's words")]
    pub fn state(&mut self, pass: &mut StatePass, model: &Model) -> Result<u64, StateError> {
        let config = &model.config;
        let chunk = pass.number("chunks", &mut self.chunk, MAX_CHUNKS)?;
        let mut total = self.total.map(|total| total as u64);
        pass.maybe("frames in all", &mut total, MAX_FRAMES)?;
        let text = pass.count("prompt", self.text_len, MAX_PROMPT_TOKENS)?;
        if pass.loads() {
            (self.total, self.text_len) = (total.map(|total| total as usize), text);
        }
        pass.ids(&mut self.text[..text])?;
        self.sampler.state(pass)?;
        let consumed = self.consumed(chunk);
        if let Some(audio) = &mut self.audio {
            audio.state(pass, consumed)?;
            self.pauses.state(pass)?;
        }
        // The chunk count of the state, not of this avatar: they differ while the state is checked.
        let known = self.known_frames(config, chunk);
        self.run.state(pass, &mut self.window, &model.body().motion, known)?;
        if let Some(mouth) = &mut self.mouth {
            mouth.state(pass)?;
        }
        Ok(consumed)
    }

    /// Whether a prompt says what it does.
    pub fn is_prompted(&self) -> bool {
        !self.has_audio() || self.text_len > 0
    }

    /// Whether it reads audio.
    pub fn has_audio(&self) -> bool {
        self.audio.is_some()
    }

    /// Sets the free text's token ids from the next chunk on.
    ///
    /// # Errors
    /// [`StepError::TooLong`] for more than [`MAX_PROMPT_TOKENS`] ids.
    pub fn set_text(&mut self, ids: &[u32]) -> Result<(), StepError> {
        let (got, limit) = (ids.len(), MAX_PROMPT_TOKENS);
        let room = self.text.get_mut(..got);
        room.ok_or(StepError::TooLong { what: "prompt tokens", got, limit })?.copy_from_slice(ids);
        self.text_len = got;
        Ok(())
    }

    /// Sets the sampler from the next chunk on.
    pub fn set_sampler(&mut self, sampler: Sampler) {
        self.sampler = sampler;
    }

    /// Sets the keyframes before the start of the stream, instead of rest codes: `codes [T, codes of a keyframe]`,
    /// oldest first. Only the last `P` are used; if there are fewer, the first is repeated in front.
    ///
    /// # Errors
    /// [`StepError`] after the first chunk, if `codes` is empty or no whole number of keyframes, or if a code is out of
    /// range.
    pub fn set_history(&mut self, codes: &[u16]) -> Result<(), StepError> {
        if self.chunk > 0 {
            return Err(StepError::Order("history can only be set before the first chunk"));
        }
        self.window.set(codes)
    }

    /// Sets codes `[N, codes of a keyframe]` of the next chunk's keyframes, [`FREE`] for those that the model
    /// draws: after codes that are set, and those of the same keyframe before them. If all are set, the chunk is due as
    /// [`Due::Held`]: the language model has nothing to draw.
    ///
    /// # Errors
    /// [`StepError`] for another number of codes, if one is out of range, or if only some are set in layout `parts`.
    pub fn want(&mut self, codes: &[u16]) -> Result<(), StepError> {
        let some = codes.iter().any(|&code| code != FREE) && codes.contains(&FREE);
        if some && !matches!(self.run, Run::Frames(_)) {
            return Err(StepError::Missing("keyframes whose codes can be set one by one (layout `frames`)"));
        }
        self.window.want(codes)
    }

    /// Uses the units of a whole recording instead of the stream's: the paper's offline setting. The stream's are
    /// still computed, for comparison ([`Self::unit_disagreement`]).
    pub fn use_whole_file_units(&mut self, units: Vec<u32>, silence: u32) {
        self.whole = Some(WholeFile { units, silence, compared: 0, differed: 0 });
    }

    /// Number of the stream's units that were compared with the whole recording's, and number that differed.
    pub fn unit_disagreement(&self) -> Option<(usize, usize)> {
        self.whole.as_ref().map(|whole| (whole.compared, whole.differed))
    }

    /// Ends the audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.total = Some(frames);
    }

    /// Samples that the next chunk takes; 0 without audio.
    pub fn chunk_samples(&self) -> usize {
        (self.target + if self.chunk == 0 { self.horizon } else { 0 }) * self.keyframe_samples
    }

    /// Maximum number of samples that a chunk takes; 0 without audio.
    pub fn most_samples(&self) -> usize {
        if self.has_audio() { (self.target + self.horizon) * self.keyframe_samples } else { 0 }
    }

    /// Buffer for the next chunk's samples.
    pub fn samples_mut(&mut self) -> &mut [f32] {
        let count = self.chunk_samples();
        &mut self.samples[..count]
    }

    /// Returns the audio stream, the next chunk's samples and the units of its window.
    pub(crate) fn audio_parts(&mut self) -> Option<(&mut AudioStream, &[f32], &mut [u32])> {
        let count = self.chunk_samples();
        self.audio.as_mut().map(|audio| (audio, &self.samples[..count], &mut *self.units))
    }

    /// Arousal of the voice at each keyframe of the next chunk, 0 to 1: set before each chunk, ordinary if nobody does.
    pub fn arousal_mut(&mut self) -> &mut [f32] {
        &mut self.arousal
    }

    /// Hears the pauses in the next chunk's samples, and the mouth.
    pub(crate) fn hear(&mut self, model: &Model) -> Result<(), StepError> {
        let count = self.chunk_samples();
        if count == 0 {
            return Ok(());
        }
        self.pauses.hear(&self.samples[..count], self.keyframe_samples);
        match (&mut self.mouth, &model.mouth) {
            (Some(heard), Some(mouth)) => heard.hear(mouth, model.isa, &self.samples[..count]),
            _ => Ok(()),
        }
    }

    /// Whether the mouth of its frames comes from their sound, not from the codes.
    pub fn hears_mouth(&self) -> bool {
        self.mouth.is_some()
    }

    /// The last chunk's frames whose mouth comes from their sound; empty where it does not.
    pub fn mouth_frames(&self) -> Range<u64> {
        self.mouth.as_ref().map_or(0..0, HeardMouth::chunk)
    }

    /// The mouth of one of [`Self::mouth_frames`]: a byte for each of the network's channels, 255 for 1.
    pub fn mouth(&self, frame: u64) -> &[u8] {
        self.mouth.as_ref().map_or(&[], |mouth| mouth.said(frame))
    }

    /// Leaves the mouth of all frames to the codes. Before the first chunk.
    pub fn keep_codes_mouth(&mut self) {
        self.mouth = None;
    }

    /// Bias towards rest of the phase of a gesture at a keyframe of the chunk, in nats (SPEC 2.21).
    pub(crate) fn rest(&self, config: &Config, keyframe: usize) -> f32 {
        let Sampler { activity, expression, .. } = self.sampler;
        let lively = 2.0 * expression * 2.0 * (self.arousal[keyframe] - ORDINARY);
        let nats = if lively > 0.0 { LIVELY_NATS } else { DULL_NATS };
        let (more, [to_half, beyond]) = ((activity - 0.5).max(0.0), ACTIVE_NATS);
        let active = match self.is_prompted() {
            true => PROMPTED_NATS * ((USUAL_ACTIVITY - activity).max(0.0) - more),
            false => to_half * (USUAL_ACTIVITY - activity.min(0.5)) - beyond * more,
        };
        let usual = active - nats * lively;
        // A prompt says what to do, in silence too.
        if self.is_prompted() {
            return usual;
        }
        let silent = match self.ends(config, keyframe) {
            true => 1.0,
            false => self.pauses.rest(keyframe) * (2.0 - 2.0 * activity).min(1.0),
        };
        usual + REST_NATS * silent
    }

    /// Whether a keyframe of the chunk is near the end of the stream, and the chunk's samples reach beyond it. Otherwise
    /// it would depend on the moment of [`Self::finish`] whether the chunk knows the end.
    fn ends(&self, config: &Config, keyframe: usize) -> bool {
        let (stride, first) = (config.keyframe_stride as u64, self.chunk * self.target as u64);
        let heard = (first + (self.target + self.horizon) as u64) * stride;
        let here = (first + keyframe as u64) * stride;
        let total = self.total.map(|total| total as u64).filter(|&total| total < heard);
        total.is_some_and(|total| total.saturating_sub(here) as f32 <= END_SECONDS * config.frame_rate as f32)
    }

    /// Samples consumed by this number of chunks.
    pub fn consumed(&self, chunks: u64) -> u64 {
        let ahead = if chunks == 0 { 0 } else { self.horizon as u64 };
        (chunks * self.target as u64 + ahead) * self.keyframe_samples as u64
    }

    /// Maximum number of frames that one chunk makes final.
    pub fn chunk_frames(&self, config: &Config) -> usize {
        self.target * config.keyframe_stride + self.lookahead
    }

    /// Frames of the horizon.
    pub fn horizon_frames(&self, config: &Config) -> usize {
        self.horizon * config.keyframe_stride
    }

    /// Number of chunks of the whole stream, once the end is known: up to the keyframe at or after the last frame.
    pub fn chunks(&self, config: &Config) -> Option<u64> {
        let last = match self.total? {
            0 => return Some(0),
            total => (total - 1).div_ceil(config.keyframe_stride),
        };
        Some((last / self.target + 1) as u64)
    }

    /// Next work, given `available` samples that no chunk has used.
    pub fn due(&self, config: &Config, available: usize) -> Due {
        match (self.total, self.chunks(config)) {
            (Some(_), Some(chunks)) if self.chunk < chunks => self.next_chunk(),
            (Some(total), _) if self.chunk > 0 && self.run.emitted() < total => Due::Flush,
            (Some(_), _) => Due::Nothing,
            (None, _) if available >= self.chunk_samples() => self.next_chunk(),
            (None, _) => Due::Audio,
        }
    }

    /// Whether the hands rest at the last keyframe; `false` for a model that does not know.
    pub fn rests(&self) -> bool {
        self.intent.is_some_and(|at| self.window.before(0)[at] == depth::REST)
    }

    fn next_chunk(&self) -> Due {
        if self.window.is_given() { Due::Held } else { Due::Chunk }
    }

    /// Number of frames whose codes are known after this number of chunks: up to the last keyframe.
    #[expect(clippy::cast_possible_truncation, reason = "a session's counts fit its memory's words")]
    pub fn known_frames(&self, config: &Config, chunks: u64) -> usize {
        let frames = chunks as usize * self.target * config.keyframe_stride;
        if chunks == 0 { 0 } else { frames + 1 - config.keyframe_stride }
    }

    /// Writes the encoder's ids of the current window, including the text if `prompted`. In layout `frames` the ids
    /// of the history are `keyframes`.
    pub(crate) fn prompt(&self, prompted: bool, keyframes: Range<u32>, ids: &mut [u32]) -> Result<usize, StepError> {
        let text = if prompted { &self.text[..self.text_len] } else { &[] };
        let (units, history) = (&*self.units, self.window.history());
        self.template.write(&Prompt { units, hidden_units: self.hidden_units, history, keyframes, text }, ids)
    }

    /// Whether its logits are combined with logits without the text.
    pub(crate) fn is_guided(&self) -> bool {
        self.guidance > 1.0 && self.text_len > 0 && self.template.has_text()
    }

    pub(crate) fn chunk_sampling(&self) -> ChunkSampling {
        ChunkSampling { sampler: self.sampler, chunk: self.chunk, target: self.target }
    }

    /// Appends the units of the last chunk's audio.
    pub fn append_units(&self, config: &Config, units: &mut Vec<u32>) {
        let tokens = config.tokens_per_keyframe();
        let chunks = usize::try_from(self.chunk).unwrap_or(usize::MAX);
        let end = chunks.saturating_mul(self.target * tokens).saturating_add(self.horizon * tokens);
        let new = end.saturating_sub(units.len()).min(self.units.len());
        units.extend_from_slice(&self.units[self.units.len() - new..]);
    }

    /// Replaces the window's units by the whole recording's, if set.
    pub(crate) fn replace_units(&mut self, config: &Config) {
        if let Some(whole) = &mut self.whole {
            let new = self.target * config.tokens_per_keyframe();
            whole.replace(&mut self.units, self.chunk, new, self.horizon * config.tokens_per_keyframe());
        }
    }
}

impl WholeFile {
    /// Replaces the window's units, and counts how many of its `new` last ones differ from the stream's; the window
    /// ends `ahead` units after the chunk.
    fn replace(&mut self, units: &mut [u32], chunk: u64, new: usize, ahead: usize) {
        let end = (usize::try_from(chunk).unwrap_or(usize::MAX)).saturating_add(1).saturating_mul(new);
        let end = end.saturating_add(ahead);
        let window = units.len();
        for (i, unit) in units.iter_mut().enumerate() {
            let at = (end + i).checked_sub(window).and_then(|token| self.units.get(token));
            if let (Some(&whole), true) = (at, i + new >= window) {
                self.compared += 1;
                self.differed += usize::from(whole != *unit);
            }
            *unit = at.copied().unwrap_or(self.silence);
        }
    }
}
