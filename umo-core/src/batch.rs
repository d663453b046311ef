//! The next chunk of one or many avatars, computed together, a layer at a time (paper section 3.1; SPEC 2).
//!
//! ```text
//! avatar 0: listen ─┐                                              ┌─ fill, move
//! avatar 1: listen ─┼─ encode (all rows) ─ attend ─ decode (N x 4) ─┼─ fill, move
//! avatar 2: listen ─┘                                              └─ fill, move
//! ```
//! Encoder and decoder read their weights once for all avatars. Every step in the picture is cut into layers, and between
//! two layers the work can be put down and taken up again on another thread. What is computed does not depend on who is in
//! the batch, or on where the work was cut (SPEC 2.9).

use std::time::Instant;

use umo_kernels::Mat;

use crate::audio::{AudioScratch, Call};
use crate::avatar::{Avatar, Due, StageTimes};
use crate::config::Config;
use crate::error::StepError;
use crate::interp::InterpScratch;
use crate::linear::Compute;
use crate::lm::decoder::Sequence;
use crate::lm::generate::{Generator, Place};
use crate::lm::layout::{max_encoder_tokens, window_tokens};
use crate::lm::{Lengths, LmScratch};
use crate::memory::filled;
use crate::model::Model;
use crate::motion::{FrameRef, MotionScratch};
use crate::record::{Chunk, Codes};

/// An avatar in a batch, where its audio comes from and where its frames go.
pub trait Member {
    /// The avatar.
    fn avatar(&mut self) -> &mut Avatar;

    /// Writes the next samples of its audio, silence where it has ended.
    fn listen(&mut self, samples: &mut [f32]);

    /// The avatar, with what takes its frames.
    fn frames(&mut self) -> (&mut Avatar, &mut dyn FrameSink);
}

/// What takes the frames of an avatar, in order.
pub trait FrameSink {
    /// Takes the next one.
    fn frame(&mut self, frame: FrameRef);
}

impl<F: FnMut(FrameRef)> FrameSink for F {
    fn frame(&mut self, frame: FrameRef) {
        self(frame);
    }
}

/// Where the work stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// No batch is under way.
    Idle,
    /// A piece of the audio tokenizer's work for one member.
    Listen { member: usize },
    /// One layer of the encoder.
    Encode { layer: usize },
    /// The decoder's keys and values of one member's encoder states, in one layer.
    Attend { member: usize, layer: usize },
    /// One layer of a decoder pass.
    Decode { layer: usize },
    /// The interpolation network of one member.
    Fill { member: usize },
    /// The motion decoders of one member.
    Move { member: usize },
}

/// Room for the chunks of at most `width` avatars of one model, and the state of the batch in work.
#[derive(Debug)]
pub struct Batch {
    audio: AudioScratch,
    /// The audio of the member that is listened to, where that has begun.
    call: Option<Call>,
    lm: LmScratch,
    generator: Generator,
    interp: InterpScratch,
    motion: MotionScratch,
    /// One chunk of audio.
    samples: Box<[f32]>,
    /// Encoder ids of all members, one behind the other.
    ids: Box<[u32]>,
    /// Encoder states of all members, `[rows, d_model]`.
    states: Box<[f32]>,
    /// Encoder rows of each member; none for one that has no chunk to compute.
    lengths: Box<[usize]>,
    /// One per member.
    sequences: Box<[Sequence]>,
    places: Box<[Place]>,
    due: Box<[Due]>,
    members: usize,
    phase: Phase,
    times: StageTimes,
    /// Codes of the last chunk, where somebody wants to know; for batches of one.
    codes: Option<Codes>,
}

impl Batch {
    /// Room for `width` avatars with at most the model's `max_target`; everything that is needed is allocated here.
    ///
    /// # Panics
    /// Where `width` is 0.
    pub fn new(model: &Model, width: usize) -> Self {
        assert!(width > 0, "a batch has at least one member");
        let config = &model.config;
        let lengths = Lengths::of(config);
        let window = window_tokens(config, config.max_target);
        let frames = config.keyframe_stride * (config.prefix + config.max_target - 1) + 1;
        let rows = model
            .motion
            .stream_rows(config.max_target * config.keyframe_stride, config.prefix * config.keyframe_stride);
        Self {
            audio: model.tokenizer.scratch(window, config.max_target * config.tokens_per_keyframe()),
            call: None,
            lm: LmScratch::new(config, width * lengths.encoder.max(lengths.decoder)),
            generator: Generator::new(config),
            interp: model.interp.scratch(frames),
            motion: model.motion.scratch(rows),
            samples: filled(0.0, config.max_target * config.samples_per_keyframe()).into(),
            ids: filled(0, width * max_encoder_tokens(config)).into(),
            states: filled(0.0, width * lengths.encoder * config.lm.d_model).into(),
            lengths: filled(0, width).into(),
            sequences: (0..width).map(|_| Sequence::new(config, lengths, model.lm.cross_storage())).collect(),
            places: filled(Place::default(), width).into(),
            due: filled(Due::Nothing, width).into(),
            members: 0,
            phase: Phase::Idle,
            times: StageTimes::default(),
            codes: None,
        }
    }

    /// Keeps from now on what each chunk was made of. Allocates, once.
    pub(crate) fn keep_record(&mut self, config: &Config) {
        self.lm.keep_tally(config);
        self.codes = Some(Codes::new(config));
    }

    /// What the last chunk was made of, where that is kept and there was one.
    pub(crate) fn chunk(&self) -> Option<Chunk<'_>> {
        self.codes.as_ref()?.chunk(self.lm.tally.as_ref()?)
    }

    /// Most members.
    pub fn width(&self) -> usize {
        self.sequences.len()
    }

    /// Whether a batch is under way.
    pub fn is_busy(&self) -> bool {
        self.phase != Phase::Idle
    }

    /// Time spent in each stage since the batch was made.
    pub fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Starts a batch of `members` members, `1..=width`, all of which are due ([`Avatar::due`]): the ones with
    /// [`Due::Rest`] only get their last frames.
    ///
    /// # Errors
    /// [`StepError`] where another batch is under way, or there are too many members.
    pub fn begin(&mut self, due: impl ExactSizeIterator<Item = Due>) -> Result<(), StepError> {
        let (got, limit) = (due.len(), self.width());
        if self.is_busy() {
            return Err(StepError::Order("a batch was started before the last one had ended"));
        }
        if got > limit {
            return Err(StepError::TooLong { what: "avatars in a batch", got, limit });
        }
        self.members = got;
        if let (Some(codes), Some(tally)) = (&mut self.codes, &mut self.lm.tally) {
            codes.clear();
            tally.clear();
        }
        self.due.iter_mut().zip(due).for_each(|(slot, due)| *slot = due);
        self.phase = self.listen(0);
        Ok(())
    }

    /// After a step that failed: leaves out the member that it was about, and says which; the others go on. None where the
    /// step was about all of them, which ends the batch.
    pub fn exclude(&mut self) -> Option<usize> {
        let (member, next) = match self.phase {
            Phase::Listen { member } => (member, self.listen(member + 1)),
            Phase::Fill { member } => (member, self.filling(member + 1)),
            Phase::Move { member } => (member, self.moving(member + 1)),
            Phase::Idle | Phase::Encode { .. } | Phase::Attend { .. } | Phase::Decode { .. } => {
                self.abandon();
                return None;
            }
        };
        self.due[member] = Due::Nothing;
        self.call = None;
        // Where it was the last with a chunk, there is nothing to encode or to fill.
        self.phase = match next {
            Phase::Encode { .. } if self.next_chunk(0).is_none() => self.moving(0),
            next => next,
        };
        Some(member)
    }

    /// Puts the batch down for good; its members are in no defined state and want [`Avatar::reset`].
    pub fn abandon(&mut self) {
        (self.phase, self.call) = (Phase::Idle, None);
    }

    /// Computes one more layer, and says whether there is more to do. `members` are those that the batch was started
    /// with, in the same order. Never allocates.
    ///
    /// # Errors
    /// [`StepError`], after which the batch wants [`Self::exclude`] or [`Self::abandon`].
    pub fn step<M: Member>(&mut self, model: &Model, cx: Compute, members: &mut [M]) -> Result<bool, StepError> {
        if members.len() != self.members {
            return Err(StepError::Disagree("a batch was taken up with other members"));
        }
        let (start, layers, phase) = (Instant::now(), self.lm.times, self.phase);
        let next = match phase {
            Phase::Idle => return Ok(false),
            Phase::Listen { member } => self.listen_to(model, cx, &mut members[member], member),
            Phase::Encode { layer } => self.encode(model, cx, layer),
            Phase::Attend { member, layer } => self.attend(model, cx, member, layer),
            Phase::Decode { layer } => self.decode(model, cx, members, layer),
            Phase::Fill { member } => self.fill(model, cx, &mut members[member], member),
            Phase::Move { member } => self.move_on(model, cx, &mut members[member], member),
        };
        match phase {
            Phase::Encode { .. } => self.times.encoder_layers += self.lm.times.since(layers),
            Phase::Decode { .. } => self.times.decoder_layers += self.lm.times.since(layers),
            _ => {}
        }
        let time = match phase {
            Phase::Listen { .. } | Phase::Idle => &mut self.times.tokenizer,
            Phase::Encode { .. } => &mut self.times.encoder,
            Phase::Attend { .. } | Phase::Decode { .. } => &mut self.times.decoder,
            Phase::Fill { .. } => &mut self.times.interp,
            Phase::Move { .. } => &mut self.times.motion,
        };
        *time += start.elapsed();
        self.phase = next?;
        Ok(self.is_busy())
    }

    /// The members from `first` on that have a chunk to compute.
    fn next_chunk(&self, first: usize) -> Option<usize> {
        (first..self.members).find(|&member| self.due[member] == Due::Chunk)
    }

    /// Listening to the first member from `first` on that has a chunk, or what follows when there is none.
    fn listen(&self, first: usize) -> Phase {
        match self.next_chunk(first) {
            Some(member) => Phase::Listen { member },
            None if self.next_chunk(0).is_some() => Phase::Encode { layer: 0 },
            None => self.moving(0),
        }
    }

    fn moving(&self, member: usize) -> Phase {
        if member < self.members { Phase::Move { member } } else { Phase::Idle }
    }

    /// One more piece of turning a member's next samples into the units of its window.
    fn listen_to(
        &mut self,
        model: &Model,
        cx: Compute,
        of: &mut impl Member,
        member: usize,
    ) -> Result<Phase, StepError> {
        let samples = &mut self.samples[..of.avatar().chunk_samples(&model.config)];
        if self.call.is_none() && !samples.is_empty() {
            of.listen(samples);
        }
        let avatar = of.avatar();
        if let Some(audio) = &mut avatar.audio {
            let mut call = match self.call.take() {
                Some(call) => call,
                None => model.tokenizer.begin(audio, &mut self.audio, samples)?,
            };
            if model.tokenizer.step(cx, audio, &mut self.audio, &mut call, &mut avatar.units)? {
                self.call = Some(call);
                return Ok(Phase::Listen { member });
            }
            avatar.replace_units(&model.config);
        }
        let start = self.rows(member);
        self.lengths[member] = avatar.prompt(&mut self.ids[start..])?;
        Ok(self.listen(member + 1))
    }

    /// Encoder rows of the members before `member` that have a chunk.
    fn rows(&self, member: usize) -> usize {
        (0..member).filter(|&m| self.due[m] == Due::Chunk).map(|m| self.lengths[m]).sum()
    }

    fn encode(&mut self, model: &Model, cx: Compute, layer: usize) -> Result<Phase, StepError> {
        let (lm, rows) = (&model.lm, self.rows(self.members));
        if layer == 0 {
            for member in 0..self.members {
                if self.due[member] != Due::Chunk {
                    self.lengths[member] = 0;
                }
            }
        }
        let lengths = &self.lengths[..self.members];
        if layer == 0 {
            lm.begin_encode(&mut self.lm, &self.ids[..rows], lengths)?;
        }
        lm.encode_layer(cx, &mut self.lm, layer, lengths)?;
        if layer + 1 < lm.encoder_layers() {
            return Ok(Phase::Encode { layer: layer + 1 });
        }
        lm.end_encode(cx, &self.lm, lengths, &mut self.states[..rows * lm.d_model()])?;
        for member in 0..self.members {
            self.sequences[member].set_ids(&[])?;
        }
        Ok(self.attending(0))
    }

    /// Attending of the first member from `first` on that has a chunk, or decoding where there is none.
    fn attending(&self, first: usize) -> Phase {
        self.next_chunk(first).map_or(Phase::Decode { layer: 0 }, |member| Phase::Attend { member, layer: 0 })
    }

    fn attend(&mut self, model: &Model, cx: Compute, member: usize, layer: usize) -> Result<Phase, StepError> {
        let (lm, width) = (&model.lm, model.lm.d_model());
        let (start, rows) = (self.rows(member), self.lengths[member]);
        let sequence = &mut self.sequences[member];
        if layer == 0 {
            lm.begin_attend(sequence, rows)?;
        }
        let states = Mat::new(&self.states[start * width..], rows, width)?;
        lm.attend_layer(cx, &mut self.lm, layer, states, sequence)?;
        if layer + 1 < lm.decoder_layers() {
            return Ok(Phase::Attend { member, layer: layer + 1 });
        }
        self.places[member] = self.generator.begin(sequence)?;
        Ok(self.attending(member + 1))
    }

    fn decode<M: Member>(
        &mut self,
        model: &Model,
        cx: Compute,
        members: &mut [M],
        layer: usize,
    ) -> Result<Phase, StepError> {
        let (lm, sequences) = (&model.lm, &mut self.sequences[..self.members]);
        if layer == 0 {
            lm.begin_decode(&mut self.lm, sequences)?;
        }
        lm.decode_layer(cx, &mut self.lm, layer, sequences)?;
        if layer + 1 < lm.decoder_layers() {
            return Ok(Phase::Decode { layer: layer + 1 });
        }
        lm.end_decode(cx, &mut self.lm, sequences)?;
        let (mut row, mut more) = (0, false);
        for ((sequence, place), member) in sequences.iter_mut().zip(&mut self.places).zip(members) {
            let count = sequence.ids().len();
            if count == 0 {
                continue;
            }
            row += count;
            let avatar = member.avatar();
            let (draw, mut codes) = (avatar.draw(), avatar.history.target());
            more |= self.generator.write(cx, lm, &mut self.lm, row - 1, draw, place, &mut codes, sequence)?;
        }
        Ok(if more { Phase::Decode { layer: 0 } } else { self.filling(0) })
    }

    /// Filling of the first member from `first` on that has a chunk, or what follows when there is none.
    fn filling(&self, first: usize) -> Phase {
        self.next_chunk(first).map_or_else(|| self.moving(0), |member| Phase::Fill { member })
    }

    fn fill(&mut self, model: &Model, cx: Compute, of: &mut impl Member, member: usize) -> Result<Phase, StepError> {
        let history = &mut of.avatar().history;
        history.lay_out();
        model.interp.fill(cx, &mut self.interp, history.frames())?;
        Ok(self.filling(member + 1))
    }

    fn move_on(&mut self, model: &Model, cx: Compute, of: &mut impl Member, member: usize) -> Result<Phase, StepError> {
        let (avatar, frames) = of.frames();
        if self.due[member] == Due::Nothing {
            return Ok(self.moving(member + 1));
        }
        if self.due[member] == Due::Chunk {
            let fresh = avatar.history.fresh(avatar.chunk == 0);
            if let Some(codes) = &mut self.codes {
                codes.keep(avatar.chunk, avatar.known_frames(&model.config, avatar.chunk), fresh);
            }
            let total = avatar.total;
            let mut within = |f: FrameRef| {
                if total.is_none_or(|total| f.index < total) {
                    frames.frame(f);
                }
            };
            avatar.motion.push(cx, &model.motion, &mut self.motion, fresh, avatar.lookahead, &mut within)?;
            avatar.history.advance();
            avatar.chunk += 1;
        }
        if let (Some(total), true) = (avatar.total, Some(avatar.chunk) >= avatar.chunks(&model.config)) {
            avatar.motion.finish(cx, &model.motion, &mut self.motion, total, &mut |f| frames.frame(f))?;
        }
        Ok(self.moving(member + 1))
    }
}
