//! Failures that tests inject into a member's steps.

use umo_core_base::error::StepError;
use umo_core_model::batch::Batch;

use crate::session::Schedule;

/// Kinds of steps, as [`Batch::next_step`] names them, and that of the live mouth.
pub(crate) const STEPS: [&str; 8] =
    ["tokenize", "encode", "attend", "decode", "draw", "interpolate", "decode motion", MOUTH];
/// The live mouth's step, which is not the batch's.
pub(crate) const MOUTH: &str = "mouth";

/// Failure of a member's steps of one kind, after the first few.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Plant {
    /// One of [`STEPS`].
    pub(crate) step: &'static str,
    /// Number of steps of the kind that succeed first.
    pub(crate) after: usize,
    /// Whether the failure is a panic.
    pub(crate) panics: bool,
}

impl Plant {
    /// Fails if this is the step.
    pub(crate) fn meet(&mut self, step: &str) -> Result<(), StepError> {
        if self.step != step {
            return Ok(());
        }
        if self.after > 0 {
            self.after -= 1;
            return Ok(());
        }
        assert!(!self.panics, "planted");
        Err(StepError::NotFinite("planted values"))
    }
}

/// Fails if injected into a member of the next step.
pub(super) fn meet(batch: &Batch, schedules: &mut [Schedule]) -> Result<(), StepError> {
    let members = schedules.iter_mut().enumerate().filter(|&(number, _)| batch.takes_part(number));
    members
        .filter_map(|(_, schedule)| schedule.plant.as_mut())
        .map(|plant| plant.meet(batch.next_step()))
        .fold(Ok(()), Result::and)
}
