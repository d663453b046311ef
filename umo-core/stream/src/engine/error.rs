//! Errors of an engine.

use std::fmt;

use umo_core_base::defect::Defect;
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{self, OutOfMemory};

/// Reason why an engine or a session cannot be created.
#[derive(Debug)]
pub enum EngineError {
    /// A number is out of range.
    Config(LoadError),
    /// A thread cannot be started.
    Thread(std::io::Error),
    /// All session slots are taken.
    Full {
        /// Number of slots of the engine.
        sessions: usize,
    },
    /// The model's rest pose cannot be computed.
    Rest(StepError),
    /// Out of memory.
    Memory(OutOfMemory),
    /// The engine's thread panicked: a defect of this library.
    Panicked(Defect),
}

impl fmt::Display for EngineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => write!(f, "{error}"),
            Self::Thread(error) => write!(f, "cannot start a thread: {error}"),
            Self::Full { sessions } => write!(f, "all {sessions} sessions of the engine are taken: drop one first"),
            Self::Rest(error) => write!(f, "the model's rest codes give no pose: {error}"),
            Self::Memory(missing) => write!(f, "{missing}"),
            Self::Panicked(defect) => write!(f, "the engine's thread ended due to a defect of this library: {defect}"),
        }
    }
}

impl std::error::Error for EngineError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Config(error) => Some(error),
            Self::Thread(error) => Some(error),
            Self::Rest(error) => Some(error),
            Self::Memory(missing) => Some(missing),
            Self::Full { .. } | Self::Panicked(_) => None,
        }
    }
}

impl From<OutOfMemory> for EngineError {
    fn from(missing: OutOfMemory) -> Self {
        Self::Memory(missing)
    }
}

impl EngineError {
    /// Error of a thread that did not start: the system does not report missing memory as such.
    pub(super) fn thread(error: std::io::Error) -> Self {
        match memory::check_thread() {
            Ok(()) => Self::Thread(error),
            Err(missing) => Self::Memory(missing),
        }
    }
}

impl From<LoadError> for EngineError {
    fn from(error: LoadError) -> Self {
        match error {
            LoadError::Memory(missing) => Self::Memory(missing),
            error => Self::Config(error),
        }
    }
}

/// Reason why a poll failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PollError {
    /// Another thread polls.
    Busy,
    /// The engine has threads of its own.
    OwnThreads,
}

impl fmt::Display for PollError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => write!(f, "another thread polls the engine"),
            Self::OwnThreads => write!(f, "an engine with worker threads cannot be polled"),
        }
    }
}

impl std::error::Error for PollError {}
