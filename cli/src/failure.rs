//! The program's errors: a one-line message, and an exit code that tells whether the input or the
//! environment is at fault.

use std::fmt;

use umo_core::{LoadError, StepError};
use umo_core_tools::stage::StageError;
use umo_figure::FigureError;
use umo_self_test::speed::SpeedError;

/// Reason why the program stops.
#[derive(Debug, PartialEq, Eq)]
pub enum Failure {
    /// The input is at fault: exit code 2.
    Input(String),
    /// The machine is at fault: exit code 1.
    Machine(String),
}

impl Failure {
    /// Returns the exit code.
    pub const fn code(&self) -> u8 {
        match self {
            Self::Input(_) => 2,
            Self::Machine(_) => 1,
        }
    }

    /// Returns a failure of the input.
    pub fn input(problem: impl fmt::Display) -> Self {
        Self::Input(problem.to_string())
    }

    /// Returns a failure of the machine.
    pub fn environment(problem: impl fmt::Display) -> Self {
        Self::Machine(problem.to_string())
    }
}

impl fmt::Display for Failure {
    /// Joins the cause's lines into one.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (Self::Input(text) | Self::Machine(text)) = self;
        let mut lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        f.write_str(lines.next().unwrap_or("unknown"))?;
        lines.try_for_each(|line| write!(f, "; {line}"))
    }
}

impl std::error::Error for Failure {}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::input(error)
    }
}

impl From<StepError> for Failure {
    fn from(error: StepError) -> Self {
        match error {
            StepError::Shape(_) => Self::environment(error),
            _ => Self::input(error),
        }
    }
}

impl From<StageError> for Failure {
    fn from(error: StageError) -> Self {
        match error {
            StageError::Step(error) => error.into(),
            error => Self::input(error),
        }
    }
}

impl From<FigureError> for Failure {
    fn from(error: FigureError) -> Self {
        Self::input(error)
    }
}

impl From<SpeedError> for Failure {
    fn from(error: SpeedError) -> Self {
        match error {
            SpeedError::Engine(error) => Self::input(error),
            error => Self::environment(error),
        }
    }
}
