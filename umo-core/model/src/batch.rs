//! The next chunk of one or several avatars, computed together one layer at a time (paper section 3.1; SPEC 2).
//!
//! ```text
//! avatar 0: tokenize ─┐                                              ┌─ interpolate, decode motion
//! avatar 1: tokenize ─┼─ encode (all rows) ─ attend ─ decode (N x 4) ─┼─ interpolate, decode motion
//! avatar 2: tokenize ─┘                                              └─ interpolate, decode motion
//! ```
//! Encoder and decoder read their weights once for all avatars. Every stage in the picture is divided into layers;
//! between two layers, work can pause and continue on another thread. The result depends neither on the other avatars
//! of the batch nor on where the work was divided (SPEC 2.9).
//!
//! In layout `frames` a decoder pass computes one keyframe, and the depth network samples its codes before the next
//! (SPEC 2.13). A guided avatar has two sequences, with and without its text (SPEC 2.16).

mod phase;
mod sharing;
#[cfg(test)]
mod tests;

use std::time::Duration;

use umo_core_base::error::StepError;
use umo_core_base::memory::filled;
use umo_core_base::time::Instant;
use umo_kernels::Mat;

use crate::audio::{AudioScratch, Call};
use crate::avatar::{Avatar, Due, StageTimes};
use crate::config::Config;
use crate::interp::{Filling, InterpScratch};
use crate::layout::{Draw, Drawn, Pass};
use crate::linear::Compute;
use crate::lm::decoder::Sequence;
use crate::lm::depth::is_guidable;
use crate::lm::layout::{max_encoder_tokens, window_tokens};
use crate::lm::{EncoderPiece, Lengths, Lm, LmScratch};
use crate::model::Model;
use crate::motion::{FrameRef, MotionScratch, Push};
use crate::record::{Chunk, Codes};
use phase::Phase;
use sharing::Sharing;

/// Receiver of the frames of a batch's avatars; each avatar's arrive in order.
pub trait FrameSink {
    /// Receives the next frame of the batch's avatar `member`.
    fn frame(&mut self, member: usize, frame: FrameRef);
}

impl<F: FnMut(FrameRef)> FrameSink for F {
    fn frame(&mut self, _: usize, frame: FrameRef) {
        self(frame);
    }
}

/// Buffers for chunks of at most `width` avatars of one model, and the state of the current batch.
#[derive(Debug)]
pub struct Batch {
    audio: AudioScratch,
    /// Tokenizer call in progress.
    call: Option<Call>,
    /// Interpolation in progress.
    filling: Option<Filling>,
    /// Motion decoding in progress.
    pushing: Option<Pushing>,
    lm: LmScratch,
    draw: Draw,
    interp: InterpScratch,
    motion: MotionScratch,
    /// Encoder ids of all sequences, concatenated.
    ids: Box<[u32]>,
    /// Encoder states of all sequences, `[rows, d_model]`.
    states: Box<[f32]>,
    /// Encoder rows of each sequence; 0 if it has no chunk to compute.
    lengths: Box<[usize]>,
    /// `per_member` of each member: with its text, and if guided, without.
    sequences: Box<[Sequence]>,
    per_member: usize,
    due: Box<[Due]>,
    members: usize,
    phase: Phase,
    /// Member whose chunk the language model computes alone, after a step for several members failed.
    single: Option<usize>,
    times: StageTimes,
    sharing: Sharing,
    /// Whether steps are divided by member where that costs little.
    bounded: bool,
    /// Whether steps run without the team's other threads.
    alone: bool,
    /// Duration of the last step of each kind.
    last: [Duration; Phase::KINDS],
    /// Codes of the last chunk, if they are recorded; for batches of one.
    codes: Option<Codes>,
}

/// Largest encoder layer, in weights, that stays in a core's caches from one member to the next.
const CACHED_WEIGHTS: usize = 4 << 20;

/// Whether a layer of a model of these dimensions stays in a core's caches.
pub fn is_cached(config: &Config) -> bool {
    Lm::encoder_layer_weights(config) <= CACHED_WEIGHTS
}

/// Sequences in one bounded step of a decoder pass: enough to share a reading of the weights, within a few hundred
/// microseconds.
const BOUNDED_SEQUENCES: usize = 8;

impl Batch {
    /// Creates a batch for `width` avatars with at most the model's `max_target`; allocates all that is needed.
    ///
    /// # Panics
    /// If `width` is 0.
    pub fn new(model: &Model, width: usize) -> Self {
        assert!(width > 0, "a batch has at least one member");
        let config = &model.config;
        let lengths = Lengths::of(config);
        let per_member = if is_guidable(config) { 2 } else { 1 };
        let sequences = width * per_member;
        // The history's keyframes, and the one that the decoder reads.
        let given = if config.is_frames() { width * (config.prefix + 1) } else { 0 };
        let window = window_tokens(config, config.max_target);
        let rows = model
            .body()
            .motion
            .stream_rows(config.max_target * config.keyframe_stride, config.prefix * config.keyframe_stride);
        Self {
            audio: model
                .body()
                .tokenizer
                .scratch(window, (config.max_target + config.audio.ahead) * config.tokens_per_keyframe()),
            call: None,
            filling: None,
            pushing: None,
            lm: LmScratch::with_given(config, sequences * lengths.encoder.max(lengths.decoder), given),
            draw: model.body().layout.draw(config, width, per_member),
            interp: model.body().layout.scratch(config, config.max_target),
            motion: model.body().motion.scratch(rows),
            ids: filled(0, sequences * max_encoder_tokens(config)).into(),
            states: filled(0.0, sequences * lengths.encoder * config.lm.d_model).into(),
            lengths: filled(0, sequences).into(),
            sequences: (0..sequences)
                .map(|_| Sequence::new(config, lengths, model.body().lm.cross_storage()))
                .collect(),
            per_member,
            due: filled(Due::Nothing, width).into(),
            members: 0,
            phase: Phase::Idle,
            single: None,
            times: StageTimes::default(),
            sharing: Sharing::new(Phase::KINDS, width),
            bounded: false,
            alone: false,
            last: [Duration::ZERO; Phase::KINDS],
            codes: None,
        }
    }

    /// Makes all further steps short, for a host that lends little time per call: a few heads, rows or expert slots
    /// of one member in an encoder layer, a few sequences of a decoder layer, a few codes of a keyframe, a layer or a
    /// few frames of an interpolation, or one motion decoder. Only for models whose layers stay in cache, because
    /// each part reads its weights again.
    pub fn bound(&mut self, config: &Config) {
        self.bounded = is_cached(config);
    }

    /// Sets whether the next steps run without the team's other threads, which are busy elsewhere.
    pub fn set_alone(&mut self, alone: bool) {
        self.alone = alone;
    }

    /// Records the codes of each chunk from now on. Allocates once.
    pub fn keep_record(&mut self, config: &Config) {
        self.lm.keep_tally(config);
        self.codes = Some(Codes::new(config));
    }

    /// The record of the last chunk, if there is one.
    pub fn chunk(&self) -> Option<Chunk<'_>> {
        self.codes.as_ref()?.chunk(self.lm.tally.as_ref()?)
    }

    /// Maximum number of members.
    pub fn width(&self) -> usize {
        self.due.len()
    }

    /// Whether a batch is in progress.
    pub fn is_busy(&self) -> bool {
        self.phase != Phase::Idle
    }

    /// Expected duration of the next step: that of the last one of its kind, or zero if there was none.
    pub fn expected(&self) -> Duration {
        self.last[self.phase.kind()]
    }

    /// Name of the next step; "begin" if no batch is in progress.
    pub fn next_step(&self) -> &'static str {
        self.phase.name()
    }

    /// Time spent in each stage since the batch was created.
    pub fn stage_times(&self) -> StageTimes {
        self.times
    }

    /// Starts a batch of `members` members, `1..=width`, all of which are due ([`Avatar::due`]). Members with
    /// [`Due::Flush`] only emit their last frames; the bodies of those with [`Due::Held`] hold their pose.
    ///
    /// # Errors
    /// [`StepError`] if a batch is in progress, or there are too many members.
    pub fn begin(&mut self, due: impl ExactSizeIterator<Item = Due>) -> Result<(), StepError> {
        let (got, limit) = (due.len(), self.width());
        if self.is_busy() {
            return Err(StepError::Order("a batch was started before the last one had ended"));
        }
        if got > limit {
            return Err(StepError::TooLong { what: "avatars in a batch", got, limit });
        }
        (self.members, self.single) = (got, None);
        if let (Some(codes), Some(tally)) = (&mut self.codes, &mut self.lm.tally) {
            codes.clear();
            tally.clear();
        }
        self.due.iter_mut().zip(due).for_each(|(slot, due)| *slot = due);
        self.phase = self.tokenize_from(0);
        Ok(())
    }

    /// After a failed step, removes the member that failed and returns its number; the others continue, and
    /// [`Self::is_busy`] tells whether any work is left. `None` if the step was for several members: the language
    /// model then computes their chunks one by one, so that the step that fails again belongs to one member.
    pub fn exclude(&mut self) -> Option<usize> {
        (self.call, self.filling, self.pushing) = (None, None, None);
        let member = match self.phase {
            Phase::Idle => return None,
            Phase::Tokenize { member } | Phase::Interpolate { member } | Phase::DecodeMotion { member } => member,
            Phase::Encode { .. } | Phase::Attend { .. } | Phase::Decode { .. } | Phase::Draw { .. } => {
                let first = self.next_coded(0)?;
                if self.next_coded(first + 1).is_some() {
                    (self.single, self.phase) = (Some(first), Phase::ENCODE);
                    return None;
                }
                first
            }
        };
        self.due[member] = Due::Nothing;
        self.phase = match self.phase {
            Phase::Tokenize { .. } => self.tokenize_from(member + 1),
            Phase::Interpolate { .. } => self.interpolate_from(member + 1),
            Phase::DecodeMotion { .. } => self.decode_motion_from(member + 1),
            _ => self.end_codes(),
        };
        Some(member)
    }

    /// Removes a member before the first step; the others continue.
    pub fn remove(&mut self, member: usize) {
        self.due[member] = Due::Nothing;
        self.phase = self.tokenize_from(0);
    }

    /// Aborts the batch; the state of its members is undefined until [`Avatar::reset`].
    pub fn abandon(&mut self) {
        (self.phase, self.call, self.filling, self.pushing, self.single) = (Phase::Idle, None, None, None, None);
    }

    /// Computes one more layer; returns whether there is more to do. `avatars` are the members that the batch was
    /// started with, in the same order, each with its chunk's audio in `Avatar::samples`. `sink` receives frames as
    /// they become final. `model` is the one that the batch and the avatars were created for. Never allocates.
    ///
    /// # Errors
    /// [`StepError`]; call [`Self::exclude`] or [`Self::abandon`] next.
    pub fn step(
        &mut self,
        model: &Model,
        cx: Compute,
        avatars: &mut [Avatar],
        sink: &mut (impl FrameSink + ?Sized),
    ) -> Result<bool, StepError> {
        if avatars.len() != self.members {
            return Err(StepError::Disagree("a batch was taken up with other members"));
        }
        let (start, layers, phase) = (Instant::now(), self.lm.times, self.phase);
        let shared = !self.alone && self.sharing.choose(phase.kind(), self.members);
        cx.team.set_alone(!shared);
        let next = match phase {
            Phase::Idle => return Ok(false),
            Phase::Tokenize { member } => self.tokenize(model, cx, &mut avatars[member], member),
            Phase::Encode { layer, first, piece } => self.encode(model, cx, avatars, (layer, first), piece),
            Phase::Attend { sequence, layer, row } => self.attend(model, cx, (sequence, layer), row),
            Phase::Decode { layer, first } => self.decode(model, cx, (layer, first)),
            Phase::Draw { first, code } => self.draw(model, cx, avatars, (first, code)),
            Phase::Interpolate { member } => self.interpolate(model, cx, &mut avatars[member], member),
            Phase::DecodeMotion { member } => self.decode_motion(model, cx, &mut avatars[member], member, sink),
        };
        match phase {
            Phase::Encode { .. } => self.times.encoder_layers += self.lm.times.since(layers),
            Phase::Decode { .. } => self.times.decoder_layers += self.lm.times.since(layers),
            _ => {}
        }
        let time = match phase {
            Phase::Tokenize { .. } | Phase::Idle => &mut self.times.tokenizer,
            Phase::Encode { .. } => &mut self.times.encoder,
            Phase::Attend { .. } | Phase::Decode { .. } => &mut self.times.decoder,
            Phase::Draw { .. } => self.draw.time(&mut self.times),
            Phase::Interpolate { .. } => &mut self.times.interp,
            Phase::DecodeMotion { .. } => &mut self.times.motion,
        };
        let elapsed = start.elapsed();
        *time += elapsed;
        self.last[phase.kind()] = elapsed;
        if cx.team.threads() > 1 && !self.alone {
            self.sharing.learn(phase.kind(), self.members, shared, elapsed);
        }
        self.phase = next?;
        Ok(self.is_busy())
    }

    /// The next member from `first` on that has a chunk to compute, held or not.
    fn next_chunk(&self, first: usize) -> Option<usize> {
        (first..self.members).find(|&member| matches!(self.due[member], Due::Chunk | Due::Held))
    }

    /// Whether the language model computes a member's chunk now.
    fn is_coded(&self, member: usize) -> bool {
        self.due[member] == Due::Chunk && self.single.is_none_or(|single| single == member)
    }

    /// Whether the next step computes something of `member`.
    #[doc(hidden)]
    pub fn takes_part(&self, member: usize) -> bool {
        match self.phase {
            Phase::Idle => false,
            Phase::Tokenize { member: one }
            | Phase::Interpolate { member: one }
            | Phase::DecodeMotion { member: one } => one == member,
            Phase::Attend { sequence, .. } => sequence / self.per_member == member,
            Phase::Encode { .. } | Phase::Decode { .. } | Phase::Draw { .. } => self.is_coded(member),
        }
    }

    /// The first member from `first` on whose chunk the language model computes now.
    fn next_coded(&self, first: usize) -> Option<usize> {
        (first..self.members).find(|&member| self.is_coded(member))
    }

    /// The phase after the language model's last keyframe: the next member, if they are computed one by one, or
    /// interpolation.
    fn end_codes(&mut self) -> Phase {
        if let Some(done) = self.single.take() {
            self.single = self.next_coded(done + 1);
        }
        if self.single.is_some() { Phase::ENCODE } else { self.interpolate_from(0) }
    }

    /// Tokenizing of the first member from `first` on that has a chunk, or the following phase.
    fn tokenize_from(&self, first: usize) -> Phase {
        match self.next_chunk(first) {
            Some(member) => Phase::Tokenize { member },
            None if self.next_coded(0).is_some() => Phase::ENCODE,
            None => self.interpolate_from(0),
        }
    }

    fn decode_motion_from(&self, member: usize) -> Phase {
        if member < self.members { Phase::DecodeMotion { member } } else { Phase::Idle }
    }

    /// Runs one more step of tokenizing a member's next samples into the units of its window.
    fn tokenize(&mut self, model: &Model, cx: Compute, avatar: &mut Avatar, member: usize) -> Result<Phase, StepError> {
        if self.call.is_none() {
            avatar.hear(model)?;
        }
        if let Some((audio, samples, units)) = avatar.audio_parts() {
            let mut call = match self.call.take() {
                Some(call) => call,
                None => model.body().tokenizer.begin(audio, &mut self.audio, samples)?,
            };
            if model.body().tokenizer.step(cx, audio, &mut self.audio, &mut call, units)? {
                self.call = Some(call);
                return Ok(Phase::Tokenize { member });
            }
            avatar.replace_units(&model.config);
        }
        if self.due[member] == Due::Held {
            avatar.window.hold();
            return Ok(self.tokenize_from(member + 1));
        }
        self.write_prompt(model, avatar, member)?;
        Ok(self.tokenize_from(member + 1))
    }

    /// Appends the encoder's ids of a member's sequences.
    fn write_prompt(&mut self, model: &Model, avatar: &Avatar, member: usize) -> Result<(), StepError> {
        let (first, prefix) = (member * self.per_member, model.config.prefix);
        self.draw.write_history(&avatar.window, member, &mut self.lm)?;
        #[expect(clippy::cast_possible_truncation, reason = "ids and rows of a batch are far below 2^32")]
        let keyframes = [member, member + 1].map(|member| (model.config.vocab.size + member * prefix) as u32);
        for (sequence, prompted) in (first..first + self.per_member).zip([true, false]) {
            let start = self.rows(sequence);
            self.lengths[sequence] = match prompted || avatar.is_guided() {
                true => avatar.prompt(prompted, keyframes[0]..keyframes[1], &mut self.ids[start..])?,
                false => 0,
            };
        }
        Ok(())
    }

    /// Encoder rows of the sequences before `sequence` that are computed.
    fn rows(&self, sequence: usize) -> usize {
        (0..sequence).filter(|&s| self.is_coded(s / self.per_member)).map(|s| self.lengths[s]).sum()
    }

    fn encode(
        &mut self,
        model: &Model,
        cx: Compute,
        avatars: &[Avatar],
        (layer, first): (usize, usize),
        piece: EncoderPiece,
    ) -> Result<Phase, StepError> {
        let sequences = self.members * self.per_member;
        let is_first = (layer, first, piece) == (0, 0, EncoderPiece::FIRST);
        if is_first {
            for sequence in 0..sequences {
                if !self.is_coded(sequence / self.per_member) {
                    self.lengths[sequence] = 0;
                }
            }
            if let Some(member) = self.single {
                self.write_prompt(model, &avatars[member], member)?;
            }
        }
        let (lm, rows) = (&model.body().lm, self.rows(sequences));
        let lengths = &self.lengths[..sequences];
        if is_first {
            lm.begin_encode(&mut self.lm, &self.ids[..rows], lengths)?;
        }
        let end = if self.bounded { first + self.per_member } else { sequences };
        let before = lengths[..first].iter().sum();
        let lengths_here = &lengths[first..end];
        if self.bounded {
            if lengths_here.iter().any(|&rows| rows > 0)
                && let Some(piece) = lm.encode_piece(cx, &mut self.lm, layer, (before, lengths_here), piece)?
            {
                return Ok(Phase::Encode { layer, first, piece });
            }
        } else {
            lm.encode_layer(cx, &mut self.lm, layer, before, lengths_here)?;
        }
        if end < sequences {
            return Ok(Phase::Encode { layer, first: end, piece: EncoderPiece::FIRST });
        }
        if layer + 1 < lm.encoder_layers() {
            return Ok(Phase::Encode { layer: layer + 1, first: 0, piece: EncoderPiece::FIRST });
        }
        lm.end_encode(cx, &self.lm, lengths, &mut self.states[..rows * lm.d_model()])?;
        for sequence in 0..sequences {
            self.sequences[sequence].set_ids(&[])?;
        }
        Ok(self.attend_from(0))
    }

    /// Keys and values of the first sequence from `first` on that has encoder states, or else decoding.
    fn attend_from(&self, first: usize) -> Phase {
        let next = (first..self.members * self.per_member).find(|&sequence| self.lengths[sequence] > 0);
        next.map_or(Phase::DECODE, |sequence| Phase::Attend { sequence, layer: 0, row: 0 })
    }

    fn attend(
        &mut self,
        model: &Model,
        cx: Compute,
        (index, layer): (usize, usize),
        row: usize,
    ) -> Result<Phase, StepError> {
        let (lm, width) = (&model.body().lm, model.body().lm.d_model());
        let (start, rows) = (self.rows(index), self.lengths[index]);
        let sequence = &mut self.sequences[index];
        if (layer, row) == (0, 0) {
            lm.begin_attend(sequence, rows)?;
        }
        let states = Mat::new(&self.states[start * width..], rows, width)?;
        if !self.bounded {
            lm.attend_layer(cx, &mut self.lm, layer, states, sequence)?;
        } else if let Some(row) = lm.attend_piece(cx, &mut self.lm, layer, states, row, sequence)? {
            return Ok(Phase::Attend { sequence: index, layer, row });
        }
        if layer + 1 < lm.decoder_layers() {
            return Ok(Phase::Attend { sequence: index, layer: layer + 1, row: 0 });
        }
        self.draw.start(index / self.per_member, sequence, &mut self.lm)?;
        Ok(self.attend_from(index + 1))
    }

    fn decode(&mut self, model: &Model, cx: Compute, (layer, first): (usize, usize)) -> Result<Phase, StepError> {
        let (lm, sequences) = (&model.body().lm, &mut self.sequences[..self.members * self.per_member]);
        if (layer, first) == (0, 0) {
            lm.begin_decode(&mut self.lm, sequences)?;
        }
        let end = if self.bounded { sequences.len().min(first + BOUNDED_SEQUENCES) } else { sequences.len() };
        let (before, now) = sequences[..end].split_at_mut(first);
        if now.iter().any(|sequence| !sequence.ids().is_empty()) {
            let row = before.iter().map(|sequence| sequence.ids().len()).sum();
            lm.decode_layer(cx, &mut self.lm, layer, row, now)?;
        }
        if end < sequences.len() {
            return Ok(Phase::Decode { layer, first: end });
        }
        if layer + 1 < lm.decoder_layers() {
            return Ok(Phase::Decode { layer: layer + 1, first: 0 });
        }
        lm.end_decode(cx, &mut self.lm, sequences)?;
        Ok(Phase::DRAW)
    }

    /// Draws codes of a decoder pass, and writes the inputs of the next.
    fn draw(
        &mut self,
        model: &Model,
        cx: Compute,
        avatars: &mut [Avatar],
        from: (usize, usize),
    ) -> Result<Phase, StepError> {
        let pass = Pass {
            lm: &mut self.lm,
            sequences: &mut self.sequences[..self.members * self.per_member],
            per_member: self.per_member,
            ids: &self.ids,
            states: &self.states,
            lengths: &self.lengths,
            bounded: self.bounded,
        };
        Ok(match self.draw.step(cx, &model.config, pass, avatars, from)? {
            Drawn::Some { first, code } => Phase::Draw { first, code },
            Drawn::Pass => Phase::DECODE,
            Drawn::Chunk => self.end_codes(),
        })
    }

    /// Interpolation of the first member from `first` on that has a chunk, or the following phase.
    fn interpolate_from(&self, first: usize) -> Phase {
        self.next_chunk(first).map_or_else(|| self.decode_motion_from(0), |member| Phase::Interpolate { member })
    }

    fn interpolate(
        &mut self,
        model: &Model,
        cx: Compute,
        avatar: &mut Avatar,
        member: usize,
    ) -> Result<Phase, StepError> {
        loop {
            if !self.interpolate_step(model, cx, avatar)? {
                self.filling = None;
                return Ok(self.interpolate_from(member + 1));
            }
            if self.bounded {
                return Ok(Phase::Interpolate { member });
            }
        }
    }

    /// Starts or continues a member's interpolation; returns whether there is more to do.
    fn interpolate_step(&mut self, model: &Model, cx: Compute, avatar: &mut Avatar) -> Result<bool, StepError> {
        if let Some(filling) = &mut self.filling {
            return avatar.run.fill(cx, &mut self.interp, filling);
        }
        let window = (&avatar.window, avatar.window.fresh_start(avatar.chunk == 0));
        let filling = avatar.run.begin_filling(cx, &mut self.interp, window, &model.body().motion, self.bounded)?;
        self.filling = Some(filling);
        Ok(true)
    }

    fn decode_motion(
        &mut self,
        model: &Model,
        cx: Compute,
        avatar: &mut Avatar,
        member: usize,
        sink: &mut (impl FrameSink + ?Sized),
    ) -> Result<Phase, StepError> {
        while self.decode_motion_step(model, cx, avatar, member, sink)? {
            if self.bounded {
                return Ok(Phase::DecodeMotion { member });
            }
        }
        Ok(self.decode_motion_from(member + 1))
    }

    /// Starts or continues a member's motion; returns whether there is more to do.
    fn decode_motion_step(
        &mut self,
        model: &Model,
        cx: Compute,
        avatar: &mut Avatar,
        member: usize,
        sink: &mut (impl FrameSink + ?Sized),
    ) -> Result<bool, StepError> {
        let (total, first) = (avatar.total, avatar.chunk == 0);
        let mut heard = avatar.mouth.as_mut().zip(model.mouth.as_ref());
        if let (None, Some((mouth, _))) = (&self.pushing, &mut heard) {
            mouth.begin();
        }
        let mut within = |f: FrameRef| {
            if total.is_some_and(|total| f.index >= total) {
                return;
            }
            match &mut heard {
                None => sink.frame(member, f),
                Some((heard, mouth)) => {
                    let (pose, face) = heard.put(mouth, &f);
                    sink.frame(member, FrameRef { pose, face, ..f });
                }
            }
        };
        let (decoder, scratch, run) = (&model.body().motion, &mut self.motion, &mut avatar.run);
        let start = avatar.window.fresh_start(first);
        let Some(Pushing { mut push, is_end }) = self.pushing.take() else {
            return match self.due[member] {
                Due::Chunk | Due::Held => {
                    let push = run.begin_push(decoder, scratch, start, avatar.lookahead)?.ending_at(total);
                    self.pushing = Some(Pushing { push, is_end: false });
                    Ok(true)
                }
                Due::Flush => self.begin_end(model, avatar),
                _ => Ok(false),
            };
        };
        let more = run.push_step(cx, decoder, scratch, start, &mut push, &mut within)?;
        if more {
            self.pushing = Some(Pushing { push, is_end });
            return Ok(true);
        }
        if is_end {
            return Ok(false);
        }
        let known = avatar.known_frames(&model.config, avatar.chunk);
        if let Some(codes) = &mut self.codes {
            avatar.run.keep(&avatar.window, codes, (avatar.chunk, known), first);
        }
        avatar.window.advance();
        avatar.chunk += 1;
        self.begin_end(model, avatar)
    }

    /// Starts on the frames that the last chunk held back, if it was the last.
    fn begin_end(&mut self, model: &Model, avatar: &Avatar) -> Result<bool, StepError> {
        let Some(total) = avatar.total.filter(|_| Some(avatar.chunk) >= avatar.chunks(&model.config)) else {
            return Ok(false);
        };
        self.pushing = Some(Pushing { push: avatar.run.begin_finish(total)?, is_end: true });
        Ok(true)
    }
}

/// Frames of a member that are being decoded.
#[derive(Debug)]
struct Pushing {
    push: Push,
    /// Whether they are the frames that the last chunk held back.
    is_end: bool,
}
