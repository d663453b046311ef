//! One avatar's stream: windows, history and where its motion stands (paper section 3.1; SPEC 2, 2.8). A
//! [`Batch`](crate::batch::Batch) computes its chunks.

mod history;

use std::time::Duration;

use crate::audio::AudioStream;
use crate::config::Config;
use crate::error::{LoadError, StepError};
use crate::lm::LayerTimes;
use crate::lm::generate::Draw;
use crate::lm::layout::{MAX_PROMPT_TOKENS, Prompt, Template, window_tokens};
use crate::lm::sampler::Sampler;
use crate::memory::filled;
use crate::model::Model;
use crate::motion::MotionStream;
use crate::part::PerPart;
use crate::state::{Fingerprint, StateError, StatePass};
use history::History;

/// Chunks that no stream comes to: at five a second, 6,900 years.
const MOST_CHUNKS: u64 = 1 << 40;
/// Frames that no recording has.
const MOST_FRAMES: u64 = 1 << 50;

/// What an avatar is made with.
#[derive(Clone, Debug)]
pub struct AvatarConfig {
    /// Keyframes per chunk, `1..=max_target`.
    pub target: usize,
    /// Frames held back until the next chunk (SPEC 2.8).
    pub lookahead: usize,
    /// How codes are drawn.
    pub sampler: Sampler,
    /// Name of the encoder's template.
    pub template: String,
    /// Ids of a free text, for templates that have room for one.
    pub text: Vec<u32>,
}

impl AvatarConfig {
    /// The model's own defaults, speech to motion.
    pub fn new(config: &Config) -> Self {
        Self {
            target: config.target,
            lookahead: config.lookahead,
            sampler: Sampler { sampling: config.sampling, seed: 0 },
            template: "audio_to_motion".to_owned(),
            text: Vec::new(),
        }
    }

    /// Refuses a target or a lookahead that the model does not allow.
    pub(crate) fn check(&self, config: &Config) -> Result<(), LoadError> {
        if !(1..=config.max_target).contains(&self.target) {
            return Err(LoadError::config(
                "target",
                format!("expected 1 to {}, got {}", config.max_target, self.target),
            ));
        }
        let most = config.keyframe_stride * config.prefix;
        if self.lookahead > most {
            return Err(LoadError::config("lookahead", format!("expected 0 to {most}, got {}", self.lookahead)));
        }
        Ok(())
    }
}

/// Time spent in each stage (the rows of the paper's runtime table).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageTimes {
    /// Audio tokenizer.
    pub tokenizer: Duration,
    /// T5 encoder.
    pub encoder: Duration,
    /// T5 decoder, with the cross-attention's keys and values.
    pub decoder: Duration,
    /// Interpolation network.
    pub interp: Duration,
    /// VQ decoders and root network.
    pub motion: Duration,
    /// Layers of the encoder; part of `encoder`.
    pub encoder_layers: LayerTimes,
    /// Layers of the decoder; part of `decoder`.
    pub decoder_layers: LayerTimes,
}

impl StageTimes {
    /// All stages together.
    pub fn total(&self) -> Duration {
        self.tokenizer + self.encoder + self.decoder + self.interp + self.motion
    }

    /// What was added since `before`.
    #[must_use]
    pub fn since(&self, before: Self) -> Self {
        Self {
            tokenizer: self.tokenizer - before.tokenizer,
            encoder: self.encoder - before.encoder,
            decoder: self.decoder - before.decoder,
            interp: self.interp - before.interp,
            motion: self.motion - before.motion,
            encoder_layers: self.encoder_layers.since(before.encoder_layers),
            decoder_layers: self.decoder_layers.since(before.decoder_layers),
        }
    }
}

/// One avatar: everything that a chunk leaves behind for the next.
#[derive(Debug)]
pub struct Avatar {
    pub(crate) target: usize,
    pub(crate) lookahead: usize,
    pub(crate) sampler: Sampler,
    template: Template,
    /// Tells the template's name from others.
    template_name: u64,
    /// `[MAX_PROMPT_TOKENS]`, of which `text_len` count.
    text: Box<[u32]>,
    text_len: usize,
    /// Chunks done.
    pub(crate) chunk: u64,
    /// Frames in all, once the end is known.
    pub(crate) total: Option<usize>,
    pub(crate) audio: Option<AudioStream>,
    /// Units of the window, `[(P + N) * tokens_per_keyframe]`.
    pub(crate) units: Box<[u32]>,
    whole: Option<WholeFile>,
    pub(crate) history: History,
    pub(crate) motion: MotionStream,
}

/// Units of a whole recording, used in place of the stream's.
#[derive(Debug)]
struct WholeFile {
    units: Vec<u32>,
    /// Unit of silence, before and after.
    silence: u32,
    /// Units of the stream that were compared, and how many differed.
    compared: usize,
    differed: usize,
}

/// What an avatar waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Due {
    /// A chunk can be computed.
    Chunk,
    /// All chunks are done; frames that were held back at the end can be given.
    Rest,
    /// Audio that has not come yet.
    Audio,
    /// Nothing: every frame was given.
    Nothing,
}

impl Avatar {
    /// An avatar at the start of its stream; everything that it will need is allocated here.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the template is missing or a number is out of range.
    pub fn new(model: &Model, config: &AvatarConfig) -> Result<Self, LoadError> {
        let c = &model.config;
        config.check(c)?;
        let template = Template::new(c, &config.template)?;
        let (window, new) = (window_tokens(c, config.target), config.target * c.tokens_per_keyframe());
        let audio = template.has_audio().then(|| model.tokenizer.stream(window, new));
        let mut template_name = Fingerprint::new();
        template_name.add(config.template.as_bytes());
        let mut avatar = Self {
            target: config.target,
            lookahead: config.lookahead,
            sampler: config.sampler,
            template,
            template_name: template_name.0,
            text: filled(0, MAX_PROMPT_TOKENS).into(),
            text_len: 0,
            chunk: 0,
            total: None,
            audio,
            units: filled(0, window).into(),
            whole: None,
            history: History::new(c, config.target),
            motion: MotionStream::new(&model.motion, config.target * c.keyframe_stride, config.lookahead),
        };
        avatar.set_text(&config.text).map_err(|error| LoadError::config("text", error.to_string()))?;
        Ok(avatar)
    }

    /// Back to the start of a stream, with rest codes as history; texts and draws stay as they are set. Never allocates.
    pub fn reset(&mut self) {
        (self.chunk, self.total, self.whole) = (0, None, None);
        if let Some(audio) = &mut self.audio {
            audio.reset();
        }
        self.history.rest();
        self.motion.reset();
    }

    /// What a state must have in common with this avatar, beside the model.
    pub(crate) fn identity(&self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.same("target", self.target as u64)?;
        pass.same("lookahead", self.lookahead as u64)?;
        pass.same("template", self.template_name)
    }

    /// Describes everything that the last chunk leaves behind for the next; samples of audio so far. Units are written by
    /// each chunk before they are read, and those of a whole recording no session has.
    #[expect(clippy::cast_possible_truncation, reason = "what a session counts fits its memory's words")]
    pub(crate) fn state(&mut self, pass: &mut StatePass, model: &Model) -> Result<u64, StateError> {
        let config = &model.config;
        let samples = self.chunk_samples(config);
        let chunk = pass.number("chunks", &mut self.chunk, MOST_CHUNKS)?;
        let mut total = self.total.map(|total| total as u64);
        pass.maybe("frames in all", &mut total, MOST_FRAMES)?;
        let text = pass.count("prompt", self.text_len, MAX_PROMPT_TOKENS)?;
        if pass.loads() {
            (self.total, self.text_len) = (total.map(|total| total as usize), text);
        }
        pass.ids(&mut self.text[..text])?;
        self.sampler.state(pass)?;
        let heard = chunk * samples as u64;
        if let Some(audio) = &mut self.audio {
            audio.state(pass, heard)?;
        }
        self.history.state(pass)?;
        // The state's chunks, which are not this avatar's while the state is checked.
        self.motion.state(pass, &model.motion, self.known_frames(config, chunk))?;
        Ok(heard)
    }

    /// Whether speech moves it.
    pub fn has_audio(&self) -> bool {
        self.audio.is_some()
    }

    /// The ids of the free text from the next chunk on.
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

    /// How codes are drawn from the next chunk on.
    pub fn set_sampler(&mut self, sampler: Sampler) {
        self.sampler = sampler;
    }

    /// The last codes before the stream starts, oldest first, in place of the rest codes; of more than `P` codes the
    /// last `P` count, of fewer the first is repeated in front.
    ///
    /// # Errors
    /// [`StepError`] after the first chunk, where there is no code, or one out of range.
    pub fn set_history(&mut self, codes: PerPart<&[u16]>) -> Result<(), StepError> {
        if self.chunk > 0 {
            return Err(StepError::Order("history can only be set before the first chunk"));
        }
        self.history.set(codes)
    }

    /// Takes the units of a whole recording instead of the stream's: the paper's offline setting. The stream's are
    /// still computed, to be compared ([`Self::unit_disagreement`]).
    pub fn use_whole_file_units(&mut self, units: Vec<u32>, silence: u32) {
        self.whole = Some(WholeFile { units, silence, compared: 0, differed: 0 });
    }

    /// Units of the stream that were compared with those of the whole recording, and how many differed.
    pub fn unit_disagreement(&self) -> Option<(usize, usize)> {
        self.whole.as_ref().map(|whole| (whole.compared, whole.differed))
    }

    /// No more audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.total = Some(frames);
    }

    /// Samples that a chunk takes; none without audio.
    pub fn chunk_samples(&self, config: &Config) -> usize {
        if self.has_audio() { self.target * config.samples_per_keyframe() } else { 0 }
    }

    /// Most frames that one chunk makes final.
    pub fn chunk_frames(&self, config: &Config) -> usize {
        self.target * config.keyframe_stride + self.lookahead
    }

    /// Chunks in all, once the end is known: as many as it takes to reach the keyframe at or after the last frame.
    pub fn chunks(&self, config: &Config) -> Option<u64> {
        let last = match self.total? {
            0 => return Some(0),
            total => (total - 1).div_ceil(config.keyframe_stride),
        };
        Some((last / self.target + 1) as u64)
    }

    /// What it waits for, with `available` samples that no chunk has used.
    pub fn due(&self, config: &Config, available: usize) -> Due {
        match (self.total, self.chunks(config)) {
            (Some(_), Some(chunks)) if self.chunk < chunks => Due::Chunk,
            (Some(total), _) if self.chunk > 0 && self.motion.emitted() < total => Due::Rest,
            (Some(_), _) => Due::Nothing,
            (None, _) if available >= self.chunk_samples(config) => Due::Chunk,
            (None, _) => Due::Audio,
        }
    }

    /// Frames whose codes so many chunks have made known: up to the last keyframe of the last chunk.
    #[expect(clippy::cast_possible_truncation, reason = "what a session counts fits its memory's words")]
    pub(crate) fn known_frames(&self, config: &Config, chunks: u64) -> usize {
        let frames = chunks as usize * self.target * config.keyframe_stride;
        if chunks == 0 { 0 } else { frames + 1 - config.keyframe_stride }
    }

    /// Writes the encoder's ids of the present window.
    pub(crate) fn prompt(&self, ids: &mut [u32]) -> Result<usize, StepError> {
        let text = &self.text[..self.text_len];
        self.template.write(Prompt { units: &self.units, history: self.history.prefix(), text }, ids)
    }

    pub(crate) fn draw(&self) -> Draw {
        Draw { sampler: self.sampler, chunk: self.chunk, target: self.target }
    }

    /// Puts the whole recording's units in the place of the window's, where there are any.
    pub(crate) fn replace_units(&mut self, config: &Config) {
        if let Some(whole) = &mut self.whole {
            let new = self.target * config.tokens_per_keyframe();
            whole.replace(&mut self.units, self.chunk, new);
        }
    }
}

impl WholeFile {
    /// Replaces the window's units, counting how many of its `new` last ones differ from the stream's.
    fn replace(&mut self, units: &mut [u32], chunk: u64, new: usize) {
        let end = (usize::try_from(chunk).unwrap_or(usize::MAX)).saturating_add(1).saturating_mul(new);
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
