//! A keyframe of layout `frames` after its decoder pass: the depth network's inputs, and the codes that it samples
//! (SPEC 2.13).

use super::{Batch, BetweenScratch, OTHER_LAYOUT, Phase};
use crate::avatar::{Avatar, Window};
use crate::config::Config;
use crate::error::StepError;
use crate::linear::Compute;
use crate::lm::depth::Task;
use crate::model::{Between, Model};

/// Codes that one bounded step samples: at most one code of this many or more members, or several codes of fewer
/// members.
const BOUNDED_CODES: usize = 8;
/// Limit for one member, whose codes take longer than a share of many members'.
const MEMBER_CODES: usize = 4;

/// Row id of a member's decoder input, after the history keyframes of all `width` members.
#[expect(clippy::cast_possible_truncation, reason = "ids and rows of a batch are far below 2^32")]
pub(super) fn keyframe_id(model: &Model, width: usize, member: usize) -> u32 {
    (model.config.vocab.size + width * model.config.prefix + member) as u32
}

impl Batch {
    /// Collects the encoder's states at the tokens of the decoder pass's keyframe, for every sequence of the pass. A
    /// place after the last audible token reads that token; without audio the states are zeros.
    pub(super) fn list_heard(&mut self, config: &Config, avatars: &[Avatar]) {
        let (tokens, d) = (config.heard_tokens(), config.lm.d_model);
        let BetweenScratch::Vectors { heard, keyframe, .. } = &mut self.between else { return };
        heard.clear();
        let (keyframe, mut first) = ((config.prefix + *keyframe) * config.tokens_per_keyframe(), 0);
        let sequences = self.sequences.iter().zip(&self.lengths).enumerate();
        for (number, (sequence, &length)) in sequences.take(self.members * self.per_member) {
            if !sequence.ids().is_empty() {
                let ids = &self.ids[first..first + length];
                let start = ids.iter().position(|&id| id as usize == config.vocab.audio.start);
                let last =
                    avatars.get(number / self.per_member).map_or(0, |avatar| avatar.units.len().saturating_sub(1));
                for token in tokens.clone() {
                    let row = start.map(|start| start + 1 + (keyframe + token).min(last)).filter(|&row| row < length);
                    match row {
                        Some(row) => heard.extend_from_slice(&self.states[(first + row) * d..(first + row + 1) * d]),
                        None => heard.resize(heard.len() + d, 0.0),
                    }
                }
            }
            first += length;
        }
    }

    /// Lists one task for each member of the decoder pass, with the rows of its sequences.
    pub(super) fn list_tasks(&mut self, avatars: &[Avatar]) {
        let BetweenScratch::Vectors { tasks, before, keyframe, .. } = &mut self.between else { return };
        tasks.clear();
        before.clear();
        let mut row = 0;
        for (member, (sequences, avatar)) in self.sequences.chunks_exact(self.per_member).zip(avatars).enumerate() {
            let rows = sequences.iter().filter(|sequence| !sequence.ids().is_empty()).count();
            if rows > 0 {
                let sampling = avatar.chunk_sampling();
                if let Window::Keyframes(history) = &avatar.history {
                    before.extend_from_slice(history.before(*keyframe));
                }
                tasks.push(Task {
                    member,
                    row,
                    unprompted: (rows > 1).then_some(row + 1),
                    guidance: avatar.guidance,
                    sampler: sampling.sampler,
                    chunk: sampling.chunk,
                    keyframe: u32::try_from(*keyframe).unwrap_or(u32::MAX),
                });
            }
            row += rows;
        }
    }

    /// Samples codes of the decoder pass's keyframe, for the members and codes of one step, and prepares the input of
    /// the next pass.
    pub(super) fn draw(
        &mut self,
        model: &Model,
        cx: Compute,
        avatars: &mut [Avatar],
        first: usize,
        code: usize,
    ) -> Result<Phase, StepError> {
        let (
            Between::Vectors { depth, .. },
            BetweenScratch::Vectors { depth: scratch, tasks, before, heard, keyframe, .. },
        ) = (&model.between, &mut self.between)
        else {
            return Err(OTHER_LAYOUT);
        };
        let more = (BOUNDED_CODES / (tasks.len() - first).max(1)).clamp(1, MEMBER_CODES);
        let end = if self.bounded { depth.codes().min(code + more) } else { depth.codes() };
        let before = &before[first * depth.codes()..];
        let states = (self.lm.states(), heard.as_slice());
        let done = depth.draw(cx, scratch, states, (&tasks[first..], before), code..end, |task, codes| {
            if let Window::Keyframes(history) = &mut avatars[task.member].history {
                history.write(*keyframe, codes);
            }
        })?;
        if end < depth.codes() {
            return Ok(Phase::Draw { first, code: end });
        }
        if first + done < tasks.len() {
            return Ok(Phase::Draw { first: first + done, code: 0 });
        }
        let (frames, width, next) = (model.lm.frames().ok_or(OTHER_LAYOUT)?, self.due.len(), *keyframe + 1);
        let mut more = false;
        for task in tasks.iter() {
            let avatar = &avatars[task.member];
            let Window::Keyframes(history) = &avatar.history else { return Err(OTHER_LAYOUT) };
            let goes_on = next < avatar.target;
            if goes_on {
                let given = self.lm.given_mut(width * model.config.prefix + task.member);
                frames.keyframe(history.target(*keyframe), given)?;
            }
            let id = [keyframe_id(model, width, task.member)];
            for sequence in &mut self.sequences[task.member * self.per_member..(task.member + 1) * self.per_member] {
                if !sequence.ids().is_empty() {
                    sequence.set_ids(if goes_on { &id } else { &[] })?;
                }
            }
            more |= goes_on;
        }
        *keyframe = next;
        Ok(if more { Phase::DECODE } else { self.end_codes() })
    }
}
