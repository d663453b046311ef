//! Layout `frames`: any parts, with several codes a keyframe. A decoder pass gives one keyframe, whose codes the depth
//! network samples (SPEC 2.13), and a network interpolates the vectors of the frames between keyframes (SPEC 2.14).

use std::ops::{Deref, Range};
use std::sync::Arc;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice, with_capacity};
use umo_core_base::state::{StateError, StatePass};

use super::{Drawn, Pass, Shape, Window, window_frames};
use crate::avatar::Avatar;
use crate::config::{Config, MAX_PARTS};
use crate::interp::vectors::VectorInterp;
use crate::interp::{Filling, InterpScratch};
use crate::linear::Compute;
use crate::lm::LmScratch;
use crate::lm::decoder::Sequence;
use crate::lm::depth::{DepthNet, DepthScratch, Task};
use crate::lm::frames::FrameTables;
use crate::motion::{MotionDecoder, MotionStream};
use crate::weights::Loader;

/// Codes that one bounded step samples: at most one code of this many or more members, or several codes of fewer
/// members.
const BOUNDED_CODES: usize = 8;
/// Limit for one member, whose codes take longer than a share of many members'.
const MEMBER_CODES: usize = 4;

/// The networks.
#[derive(Debug)]
pub struct Networks {
    tables: Arc<FrameTables>,
    depth: Arc<DepthNet>,
    interp: Arc<VectorInterp>,
}

impl Networks {
    pub(super) fn load(loader: &Loader) -> Result<Self, LoadError> {
        Ok(Self {
            tables: Arc::new(FrameTables::load(loader)?),
            depth: Arc::new(DepthNet::load(loader)?),
            interp: Arc::new(VectorInterp::load(loader)?),
        })
    }

    pub(super) fn interp(&self) -> &VectorInterp {
        &self.interp
    }

    pub(super) fn draw(&self, config: &Config, width: usize, per_member: usize) -> Draw {
        let places = config.heard_tokens().count();
        Draw {
            tables: Arc::clone(&self.tables),
            depth: Arc::clone(&self.depth),
            scratch: self.depth.scratch(width),
            tasks: with_capacity(width),
            before: with_capacity(width * self.depth.codes()),
            wanted: with_capacity(width * self.depth.codes()),
            heard: with_capacity(width * per_member * places * config.lm.d_model),
            keyframe: 0,
            vocab: config.vocab.size,
            prefix: config.prefix,
            width,
        }
    }

    pub fn run_in(&self, config: &Config, decoder: &MotionDecoder, shape: Shape, arena: &Arena) -> Run {
        let (len, stride) = (window_frames(config, shape.target), config.keyframe_stride);
        let parts = config.parts.as_deref().unwrap_or_default();
        let moving = parts.iter().filter(|part| !part.is_annotation());
        let mut first = 0;
        let places = parts.iter().map(|part| {
            first += part.levels;
            (part, first - part.levels..first)
        });
        let moving_places = places.filter(|(part, _)| !part.is_annotation()).map(|(part, range)| (range, part.width));
        Run {
            interp: Arc::clone(&self.interp),
            frames: Frames {
                vectors: arena.collect_len(
                    moving.clone().count(),
                    moving.clone().map(|part| arena.filled(0.0, len * part.width)),
                ),
                known: arena.collect((0..len).map(|frame| frame.is_multiple_of(stride))),
                parts: arena.collect_len(moving.clone().count(), moving_places),
                stride,
            },
            motion: MotionStream::new_in(decoder, (shape.target * stride, shape.lookahead), shape.smoothing, arena),
        }
    }
}

/// Vectors of a window's frames, and the motion that is decoded from them.
#[derive(Debug)]
pub struct Run {
    interp: Arc<VectorInterp>,
    pub(super) frames: Frames,
    pub(super) motion: MotionStream<f32>,
}

/// Vectors of a window's frames. Each chunk writes them before it reads them.
#[derive(Debug)]
pub(super) struct Frames {
    /// `[(P + N - 1) * stride + 1, width]` of each part with channels.
    vectors: Slice<Slice<f32>>,
    /// Whether a frame is a keyframe.
    known: Slice<bool>,
    /// Range of each part's codes within a keyframe, and the width of its vectors; only parts with channels.
    parts: Slice<(Range<usize>, usize)>,
    stride: usize,
}

/// Inputs of the motion decoders, one for each part with channels.
pub(super) struct Latents<'a> {
    vectors: [&'a [f32]; MAX_PARTS],
    parts: usize,
}

impl<'a> Deref for Latents<'a> {
    type Target = [&'a [f32]];

    fn deref(&self) -> &Self::Target {
        &self.vectors[..self.parts]
    }
}

impl Frames {
    /// Writes the keyframes' vectors to their frames.
    fn lay_out(&mut self, window: &Window, decoder: &MotionDecoder) -> Result<(), StepError> {
        for (((range, width), vectors), decoder) in self.parts.iter().zip(&mut self.vectors).zip(decoder.decoders()) {
            let rows = vectors.chunks_exact_mut(*width).step_by(self.stride);
            for (codes, row) in window.keyframes().zip(rows) {
                decoder.codebook().vector(&codes[range.clone()], row)?;
            }
        }
        Ok(())
    }

    /// Inputs of the motion decoders: the vectors of the frames from `start` on.
    pub(super) fn latents(&self, start: usize) -> Latents<'_> {
        let mut all = [&[][..]; MAX_PARTS];
        for ((latents, vectors), (_, width)) in all.iter_mut().zip(&self.vectors).zip(&self.parts) {
            *latents = &vectors[start * width..];
        }
        Latents { vectors: all, parts: self.parts.len() }
    }
}

impl Run {
    /// Describes the history, keyframe by keyframe, and the motion.
    pub(super) fn state(
        &mut self,
        pass: &mut StatePass,
        window: &mut Window,
        decoder: &MotionDecoder,
        known: usize,
    ) -> Result<(), StateError> {
        let codes = window.history().len();
        window.state(pass, 0..codes)?;
        self.motion.state(pass, decoder, known, |_, pass, vectors| pass.f32s(vectors))
    }

    pub fn begin_filling(
        &mut self,
        cx: Compute,
        scratch: &mut InterpScratch,
        (window, start): (&Window, usize),
        decoder: &MotionDecoder,
        piece: impl Fn(usize) -> usize,
    ) -> Result<Filling, StepError> {
        self.frames.lay_out(window, decoder)?;
        let Frames { vectors, known, .. } = &self.frames;
        self.interp.begin(cx, scratch, vectors, known, start, piece(vectors.len()))
    }

    pub fn fill(&mut self, cx: Compute, scratch: &mut InterpScratch, filling: &mut Filling) -> Result<bool, StepError> {
        let Frames { vectors, known, .. } = &mut self.frames;
        self.interp.step(cx, scratch, vectors, known, filling)
    }
}

/// Drawing of codes: the depth network, its inputs, and the keyframes that it samples.
#[derive(Debug)]
pub(crate) struct Draw {
    tables: Arc<FrameTables>,
    depth: Arc<DepthNet>,
    scratch: DepthScratch,
    /// One per member at most.
    tasks: Vec<Task>,
    /// `[tasks, codes of a keyframe]`: the keyframe before each task's.
    before: Vec<u16>,
    /// Of the same shape: codes that are set beforehand.
    wanted: Vec<u16>,
    /// `[rows of the decoder pass, places, d_model]`: encoder states at the tokens of the keyframe, if the depth network
    /// reads them.
    heard: Vec<f32>,
    /// Keyframe of the decoder pass.
    keyframe: usize,
    vocab: usize,
    prefix: usize,
    width: usize,
}

impl Draw {
    /// Row of a member's decoder input among the inputs from outside the embedding table: after the history keyframes
    /// of all `width` members.
    fn input(&self, member: usize) -> usize {
        self.width * self.prefix + member
    }

    /// Id of that row.
    #[expect(clippy::cast_possible_truncation, reason = "ids and rows of a batch are far below 2^32")]
    fn input_id(&self, member: usize) -> u32 {
        (self.vocab + self.input(member)) as u32
    }

    pub(super) fn write_history(&self, window: &Window, member: usize, lm: &mut LmScratch) -> Result<(), StepError> {
        for (row, codes) in window.keyframes().take(self.prefix).enumerate() {
            self.tables.history(codes, lm.given_mut(member * self.prefix + row))?;
        }
        Ok(())
    }

    pub(super) fn start(
        &mut self,
        member: usize,
        sequence: &mut Sequence,
        lm: &mut LmScratch,
    ) -> Result<(), StepError> {
        self.keyframe = 0;
        self.tables.start(lm.given_mut(self.input(member)));
        sequence.set_ids(&[self.input_id(member)])
    }

    /// Collects the encoder's states at the tokens of the decoder pass's keyframe, for every sequence of the pass. A
    /// place after the last audible token reads that token; without audio the states are zeros.
    fn list_heard(&mut self, config: &Config, pass: &Pass, avatars: &[Avatar]) {
        let (tokens, d, heard) = (config.heard_tokens(), config.lm.d_model, &mut self.heard);
        heard.clear();
        let (keyframe, mut first) = ((self.prefix + self.keyframe) * config.tokens_per_keyframe(), 0);
        for (number, (sequence, &length)) in pass.sequences.iter().zip(pass.lengths).enumerate() {
            if !sequence.ids().is_empty() {
                let ids = &pass.ids[first..first + length];
                let start = ids.iter().position(|&id| id as usize == config.vocab.audio.start);
                let last =
                    avatars.get(number / pass.per_member).map_or(0, |avatar| avatar.units.len().saturating_sub(1));
                for token in tokens.clone() {
                    let row = start.map(|start| start + 1 + (keyframe + token).min(last)).filter(|&row| row < length);
                    match row {
                        Some(row) => heard.extend_from_slice(&pass.states[(first + row) * d..(first + row + 1) * d]),
                        None => heard.resize(heard.len() + d, 0.0),
                    }
                }
            }
            first += length;
        }
    }

    /// Lists one task for each member of the decoder pass, with the rows of its sequences.
    fn list_tasks(&mut self, config: &Config, pass: &Pass, avatars: &[Avatar]) {
        self.tasks.clear();
        self.before.clear();
        self.wanted.clear();
        let mut row = 0;
        for (member, (sequences, avatar)) in pass.sequences.chunks_exact(pass.per_member).zip(avatars).enumerate() {
            let rows = sequences.iter().filter(|sequence| !sequence.ids().is_empty()).count();
            if rows > 0 {
                let sampling = avatar.chunk_sampling();
                self.before.extend_from_slice(avatar.window.before(self.keyframe));
                self.wanted.extend_from_slice(avatar.window.wanted(self.keyframe));
                self.tasks.push(Task {
                    member,
                    row,
                    unprompted: (rows > 1).then_some(row + 1),
                    guidance: avatar.guidance,
                    rest: avatar.rest(config, self.keyframe),
                    sampler: sampling.sampler,
                    chunk: sampling.chunk,
                    keyframe: u32::try_from(self.keyframe).unwrap_or(u32::MAX),
                });
            }
            row += rows;
        }
    }

    /// Samples codes of the decoder pass's keyframe, for the tasks and codes of one step; after the last, prepares the
    /// inputs of the next pass.
    pub(super) fn step(
        &mut self,
        cx: Compute,
        config: &Config,
        pass: Pass,
        avatars: &mut [Avatar],
        (first, code): (usize, usize),
    ) -> Result<Drawn, StepError> {
        if (first, code) == (0, 0) {
            self.list_heard(config, &pass, avatars);
            self.list_tasks(config, &pass, avatars);
        }
        let Self { depth, scratch, tasks, before, wanted, heard, keyframe, .. } = self;
        let (codes, more) = (depth.codes(), BOUNDED_CODES / (tasks.len() - first).max(1));
        let end = if pass.bounded { codes.min(code + more.clamp(1, MEMBER_CODES)) } else { codes };
        let tasks = (&tasks[first..], &before[first * codes..], &wanted[first * codes..]);
        let states = (pass.lm.states(), heard.as_slice());
        let done = depth.draw(cx, scratch, states, tasks, code..end, |task, drawn| {
            avatars[task.member].window.targets_mut()[*keyframe * codes..][..codes].copy_from_slice(drawn);
        })?;
        if end < codes {
            return Ok(Drawn::Some { first, code: end });
        }
        if first + done < self.tasks.len() {
            return Ok(Drawn::Some { first: first + done, code: 0 });
        }
        self.prepare(pass, avatars)
    }

    /// Prepares the inputs of the next pass.
    fn prepare(&mut self, pass: Pass, avatars: &[Avatar]) -> Result<Drawn, StepError> {
        let (next, mut more) = (self.keyframe + 1, false);
        for task in &self.tasks {
            let avatar = &avatars[task.member];
            let goes_on = next < avatar.target;
            if goes_on {
                let given = pass.lm.given_mut(self.input(task.member));
                self.tables.keyframe(avatar.window.target(self.keyframe), given)?;
            }
            let id = [self.input_id(task.member)];
            for sequence in &mut pass.sequences[task.member * pass.per_member..(task.member + 1) * pass.per_member] {
                if !sequence.ids().is_empty() {
                    sequence.set_ids(if goes_on { &id } else { &[] })?;
                }
            }
            more |= goes_on;
        }
        self.keyframe = next;
        Ok(if more { Drawn::Pass } else { Drawn::Chunk })
    }
}
