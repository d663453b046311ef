//! Failures that tests inject into a member's steps.

use super::{Batch, Phase};
use crate::avatar::Avatar;
use umo_core_base::error::StepError;

/// Kind of step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// Audio tokenizer.
    Audio,
    /// Encoder.
    Encoder,
    /// Keys and values of the cross-attention.
    Attention,
    /// Decoder.
    Decoder,
    /// Depth network.
    Depth,
    /// Interpolation network.
    Interpolation,
    /// Motion decoders.
    Motion,
    /// Live mouth.
    Mouth,
}

impl Step {
    /// All steps.
    pub const ALL: [Self; 8] = [
        Self::Audio,
        Self::Encoder,
        Self::Attention,
        Self::Decoder,
        Self::Depth,
        Self::Interpolation,
        Self::Motion,
        Self::Mouth,
    ];
}

/// Failure of a member's steps of one kind, after the first few.
#[derive(Clone, Copy, Debug)]
pub struct Plant {
    /// Step that fails.
    pub step: Step,
    /// Steps of the kind that succeed first.
    pub after: usize,
    /// Whether the failure is a panic.
    pub panics: bool,
}

impl Avatar {
    /// Fails if injected.
    pub fn meet_plant(&mut self, step: Step) -> Result<(), StepError> {
        let Some(plant) = self.plant.as_mut().filter(|plant| plant.step == step) else { return Ok(()) };
        if plant.after > 0 {
            plant.after -= 1;
            return Ok(());
        }
        assert!(!plant.panics, "planted");
        Err(StepError::NotFinite("planted values"))
    }
}

impl Batch {
    /// Fails if injected into a member of the next step.
    pub(super) fn meet_plants(&self, avatars: &mut [Avatar]) -> Result<(), StepError> {
        let (step, member) = match self.phase {
            Phase::Idle => return Ok(()),
            Phase::Tokenize { member } => (Step::Audio, Some(member)),
            Phase::Encode { .. } => (Step::Encoder, None),
            Phase::Attend { sequence, .. } => (Step::Attention, Some(sequence / self.per_member)),
            Phase::Decode { .. } => (Step::Decoder, None),
            Phase::Draw { .. } => (Step::Depth, None),
            Phase::Interpolate { member } => (Step::Interpolation, Some(member)),
            Phase::DecodeMotion { member } => (Step::Motion, Some(member)),
        };
        let takes_part = |number| member.map_or(self.is_coded(number), |member| member == number);
        let members = avatars.iter_mut().enumerate().filter(|&(number, _)| takes_part(number));
        members.map(|(_, avatar)| avatar.meet_plant(step)).fold(Ok(()), Result::and)
    }
}
