//! Whether and how a session ended.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use umo_core_base::defect::Defect;
use umo_core_base::error::StepError;

use super::error::SessionError;

/// Values of [`Outcome::state`]: whether and how the session's computation ended.
const RUNNING: u8 = 0;
const FAILED: u8 = 1;
const CLOSED: u8 = 2;

/// Reason why the engine stopped computing a session.
#[derive(Clone, Debug)]
pub(crate) enum Failure {
    /// A step failed.
    Step(StepError),
    /// A step panicked.
    Defect(Defect),
}

/// The end of a session: the host has dropped it, or the engine has stopped computing it.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Whether the host has dropped the session.
    pub(super) dropped: AtomicBool,
    state: AtomicU8,
    failure: OnceLock<Failure>,
}

impl Outcome {
    pub(super) fn new() -> Self {
        Self { dropped: AtomicBool::new(false), state: AtomicU8::new(RUNNING), failure: OnceLock::new() }
    }

    /// Ends the session with a failure.
    pub(crate) fn fail(&self, failure: Failure) {
        // The first failure is kept.
        let _ = self.failure.set(failure);
        self.state.store(FAILED, Ordering::Release);
    }

    /// The panic that ended the session.
    pub(super) fn defect(&self) -> Option<&Defect> {
        match self.failure.get() {
            Some(Failure::Defect(defect)) => Some(defect),
            _ => None,
        }
    }

    /// Marks the engine as gone.
    pub(crate) fn close(&self) {
        let _ = self.state.compare_exchange(RUNNING, CLOSED, Ordering::AcqRel, Ordering::Relaxed);
    }

    /// Whether the engine still computes the session.
    pub(crate) fn is_running(&self) -> bool {
        self.state.load(Ordering::Acquire) == RUNNING
    }

    pub(super) fn check(&self) -> Result<(), SessionError> {
        match self.state.load(Ordering::Acquire) {
            FAILED => match self.failure.get() {
                Some(&Failure::Step(error)) => Err(SessionError::Failed(error)),
                _ => Err(SessionError::Panicked),
            },
            CLOSED => Err(SessionError::Closed),
            _ => Ok(()),
        }
    }
}
