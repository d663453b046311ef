//! Replacement of the filter if the library is built without the feature `resample`.

use std::sync::Arc;

use umo_core_base::error::StepError;
use umo_core_base::memory::Arena;
use umo_core_base::state::{StateError, StatePass};

/// Uninhabited: there are no plans without the feature.
#[derive(Debug)]
pub enum FilterPlan {}

/// Nothing is filtered.
pub(super) fn half_length(_: usize, _: usize) -> usize {
    0
}

impl FilterPlan {
    /// # Errors
    /// [`StepError::Disagree`], always.
    pub(crate) fn new(_: usize, _: usize) -> Result<Self, StepError> {
        Err(StepError::Disagree(
            "the sample rate must be the model's: this library was built without the feature `resample`",
        ))
    }

    /// Rates of the input and the output, Hz.
    pub fn rates(&self) -> (usize, usize) {
        match *self {}
    }
}

/// Uninhabited, like [`FilterPlan`].
#[derive(Debug)]
pub(super) enum Filter {}

impl Filter {
    pub(super) fn new_in(plan: Arc<FilterPlan>, _: &Arena) -> Self {
        match *plan {}
    }

    pub(super) fn most_given(&self, _: usize) -> usize {
        match *self {}
    }

    pub(super) fn most_left(&self) -> usize {
        match *self {}
    }

    pub(super) fn push(&mut self, _: &[f32], _: impl FnMut(&[f32])) {
        match *self {}
    }

    pub(super) fn silence(&mut self, _: impl FnMut(&[f32])) {
        match *self {}
    }

    pub fn reset(&mut self) {
        match *self {}
    }

    pub fn state(&mut self, _: &mut StatePass, _: u64) -> Result<u64, StateError> {
        match *self {}
    }
}
