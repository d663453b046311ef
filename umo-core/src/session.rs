//! One avatar's stream: audio in, chunk by chunk, poses out (paper section 3.1; SPEC 2, 2.8).

mod history;

use std::time::{Duration, Instant};

use umo_kernels::Mat;

use crate::audio::{AudioScratch, AudioStream, silence_unusable};
use crate::config::Config;
use crate::error::{LoadError, StepError};
use crate::interp::InterpScratch;
use crate::linear::Compute;
use crate::lm::decoder::DecoderCache;
use crate::lm::generate::Generator;
use crate::lm::layout::{Prompt, Template, max_encoder_tokens, window_tokens};
use crate::lm::sampler::Sampler;
use crate::lm::{Lengths, LmScratch};
use crate::model::Model;
use crate::motion::{FrameRef, MotionScratch, MotionStream};
use crate::part::PerPart;
use history::History;

/// What a session is made with.
#[derive(Clone, Debug)]
pub struct SessionConfig {
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

impl SessionConfig {
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
}

/// Scratch of one chunk, for sessions of a model with at most its `max_target`: dead between chunks, so that many
/// sessions may share one.
#[derive(Debug)]
pub struct Scratch {
    audio: AudioScratch,
    lm: LmScratch,
    cache: DecoderCache,
    generator: Generator,
    interp: InterpScratch,
    motion: MotionScratch,
    /// Encoder ids.
    ids: Box<[u32]>,
    /// Encoder states, `[max_encoder_tokens, d_model]`.
    states: Box<[f32]>,
}

impl Scratch {
    /// Sized from the model's config.
    pub fn new(model: &Model) -> Self {
        let config = &model.config;
        let lengths = Lengths::of(config);
        let window = window_tokens(config, config.max_target);
        let frames = config.keyframe_stride * (config.prefix + config.max_target - 1) + 1;
        Self {
            audio: model.tokenizer.scratch(window, config.max_target * config.tokens_per_keyframe()),
            lm: LmScratch::new(config, lengths.encoder.max(lengths.decoder)),
            cache: DecoderCache::new(config, lengths),
            generator: Generator::new(config),
            interp: model.interp.scratch(frames),
            motion: model.motion.scratch(
                model
                    .motion
                    .stream_rows(config.max_target * config.keyframe_stride, config.prefix * config.keyframe_stride),
            ),
            ids: vec![0; max_encoder_tokens(config)].into(),
            states: vec![0.0; lengths.encoder * config.lm.d_model].into(),
        }
    }
}

/// Time spent in each stage since the session was made (the rows of the paper's runtime table).
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
}

/// Gives the time since it was last asked.
struct Lap(Instant);

impl Lap {
    fn lap(&mut self) -> Duration {
        let now = Instant::now();
        let lap = now - self.0;
        self.0 = now;
        lap
    }
}

/// One avatar.
#[derive(Debug)]
pub struct Session {
    config: SessionConfig,
    template: Template,
    /// Chunks done.
    chunk: u64,
    /// Samples that came and were not yet used by a chunk.
    pending: Vec<f32>,
    /// Samples that came in all.
    samples: usize,
    /// Frames in all, once the end is known.
    total: Option<usize>,
    audio: Option<AudioStream>,
    /// Units of the window, `[(P + N) * tokens_per_keyframe]`.
    units: Box<[u32]>,
    whole: Option<WholeFile>,
    history: History,
    motion: MotionStream,
    times: StageTimes,
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

impl Session {
    /// A session at the start of its stream; everything that it will need is allocated here.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the template is missing or a number is out of range.
    pub fn new(model: &Model, config: SessionConfig) -> Result<Self, LoadError> {
        let c = &model.config;
        if !(1..=c.max_target).contains(&config.target) {
            return Err(LoadError::config("target", format!("expected 1 to {}, got {}", c.max_target, config.target)));
        }
        let most = c.keyframe_stride * c.prefix;
        if config.lookahead > most {
            return Err(LoadError::config("lookahead", format!("expected 0 to {most}, got {}", config.lookahead)));
        }
        let template = Template::new(c, &config.template)?;
        let (window, new) = (window_tokens(c, config.target), config.target * c.tokens_per_keyframe());
        let audio = template.has_audio().then(|| model.tokenizer.stream(window, new));
        Ok(Self {
            template,
            chunk: 0,
            pending: Vec::new(),
            samples: 0,
            total: None,
            audio,
            units: vec![0; window].into(),
            whole: None,
            history: History::new(c, config.target),
            times: StageTimes::default(),
            motion: MotionStream::new(&model.motion, config.target * c.keyframe_stride, config.lookahead),
            config,
        })
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

    /// Takes samples at the model's rate, mono, and says how many were no usable number and became silence
    /// ([`silence_unusable`]).
    ///
    /// # Errors
    /// [`StepError::Order`] after [`Self::finish`].
    pub fn push_audio(&mut self, samples: &[f32]) -> Result<usize, StepError> {
        if self.total.is_some() {
            return Err(StepError::Order("audio was pushed after the end"));
        }
        let start = self.pending.len();
        self.pending.extend_from_slice(samples);
        self.samples += samples.len();
        Ok(silence_unusable(&mut self.pending[start..]))
    }

    /// No more audio: the stream ends after `frames` frames.
    pub fn finish(&mut self, frames: usize) {
        self.total = Some(frames);
    }

    /// Time spent in each stage so far.
    pub fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Frames of the audio pushed so far.
    pub fn frames_of_audio(&self, config: &Config) -> usize {
        self.samples * config.frame_rate / config.audio.sample_rate
    }

    /// Chunks in all, once the end is known: as many as it takes to reach the keyframe at or after the last frame.
    pub fn chunks(&self, config: &Config) -> Option<u64> {
        let last = self.total?.checked_sub(1)?.div_ceil(config.keyframe_stride);
        Some((last / self.config.target + 1) as u64)
    }

    /// Computes the next chunk if its audio is there, and gives every frame that became final to `frame`, in order.
    /// Returns whether there was one, or frames that were held back at the end.
    ///
    /// # Errors
    /// [`StepError`], after which the session is where it was before the call in all but its audio.
    pub fn step(
        &mut self,
        model: &Model,
        cx: Compute,
        scratch: &mut Scratch,
        frame: &mut dyn FnMut(FrameRef),
    ) -> Result<bool, StepError> {
        let config = &model.config;
        let needed = self.config.target * config.samples_per_keyframe();
        match self.total {
            Some(total) if self.chunk >= self.chunks(config).unwrap_or(0) => {
                return self.give_rest(model, cx, &mut scratch.motion, total, frame);
            }
            None if self.pending.len() < needed || !self.template.has_audio() => return Ok(false),
            _ => {}
        }
        let mut clock = Lap(Instant::now());
        if self.audio.is_some() {
            self.listen(model, cx, scratch, needed)?;
        }
        self.times.tokenizer += clock.lap();
        let prompt = Prompt { units: &self.units, history: self.history.prefix(), text: &self.config.text };
        let count = self.template.write(prompt, &mut scratch.ids)?;
        let width = model.lm.d_model();
        let states = &mut scratch.states[..count * width];
        model.lm.encode(cx, &mut scratch.lm, &scratch.ids[..count], &[count], states)?;
        self.times.encoder += clock.lap();
        let draw = (self.config.sampler, self.chunk);
        let states = Mat::new(states, count, width)?;
        let Scratch { lm, cache, generator, interp, motion, .. } = scratch;
        generator.generate(cx, &model.lm, lm, states, cache, draw, self.history.target())?;
        self.times.decoder += clock.lap();

        self.history.lay_out();
        model.interp.fill(cx, interp, self.history.frames())?;
        self.times.interp += clock.lap();
        let fresh = self.history.fresh(self.chunk == 0);
        let mut within = frame_limit(self.total, &mut *frame);
        self.motion.push(cx, &model.motion, motion, fresh, self.config.lookahead, &mut within)?;
        drop(within);
        self.history.advance();
        self.chunk += 1;
        if let (Some(total), true) = (self.total, Some(self.chunk) == self.chunks(config)) {
            self.motion.finish(cx, &model.motion, &mut scratch.motion, total, frame)?;
        }
        self.times.motion += clock.lap();
        Ok(true)
    }

    /// Gives the frames that are still held back where the last chunk came before its audio was known to be the last.
    fn give_rest(
        &mut self,
        model: &Model,
        cx: Compute,
        scratch: &mut MotionScratch,
        total: usize,
        frame: &mut dyn FnMut(FrameRef),
    ) -> Result<bool, StepError> {
        let left = self.chunk > 0 && self.motion.emitted() < total;
        if left {
            self.motion.finish(cx, &model.motion, scratch, total, frame)?;
        }
        Ok(left)
    }

    /// Turns the next `needed` samples (silence where the audio has ended) into the window's units.
    fn listen(&mut self, model: &Model, cx: Compute, scratch: &mut Scratch, needed: usize) -> Result<(), StepError> {
        if self.pending.len() < needed {
            self.pending.resize(needed, 0.0);
        }
        let Some(audio) = &mut self.audio else { return Ok(()) };
        model.tokenizer.advance(cx, audio, &mut scratch.audio, &self.pending[..needed], &mut self.units)?;
        self.pending.drain(..needed);
        if let Some(whole) = &mut self.whole {
            let new = self.config.target * model.config.tokens_per_keyframe();
            whole.replace(&mut self.units, self.chunk, new);
        }
        Ok(())
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

/// Passes on the frames before `total`.
fn frame_limit<'a>(total: Option<usize>, frame: &'a mut dyn FnMut(FrameRef)) -> impl FnMut(FrameRef) + 'a {
    move |f| {
        if total.is_none_or(|total| f.index < total) {
            frame(f);
        }
    }
}
