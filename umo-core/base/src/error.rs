//! Errors: [`LoadError`] on reading a model, [`StepError`] on running it.

use std::fmt;
use std::path::PathBuf;

use umo_kernels::ShapeError;
use umo_kernels::product::ProductError;

use crate::memory::OutOfMemory;

/// Error from loading a model, or from making something of one.
#[derive(Debug)]
pub enum LoadError {
    /// The file cannot be opened or mapped.
    Io {
        /// The file.
        path: PathBuf,
        /// The system's error.
        cause: std::io::Error,
    },
    /// Out of memory.
    Memory(OutOfMemory),
    /// The file is not a safetensors file, is truncated, or is not a umo model of a known version.
    File(String),
    /// An argument of the call is out of range, or asks for what the model cannot do.
    Argument {
        /// Name of the argument, such as `target`.
        name: &'static str,
        /// Value expected, and value given.
        problem: String,
    },
    /// A number or name in the model's config is missing, out of range, or disagrees with another.
    Config {
        /// Path in the config, such as `lm.d_model`.
        key: String,
        /// Value found and value expected.
        problem: String,
    },
    /// A tensor is missing, has another shape or type, or holds a value that is NaN or infinite.
    Tensor {
        /// The tensor's name in the file.
        name: String,
        /// Value found and value expected.
        problem: String,
    },
}

impl LoadError {
    /// Error of the argument `name`.
    #[doc(hidden)]
    pub fn argument(name: &'static str, problem: impl Into<String>) -> Self {
        Self::Argument { name, problem: problem.into() }
    }

    /// Error of the config's `key`.
    #[doc(hidden)]
    pub fn config(key: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Config { key: key.into(), problem: problem.into() }
    }

    /// Error of the tensor `name`.
    #[doc(hidden)]
    pub fn tensor(name: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Tensor { name: name.into(), problem: problem.into() }
    }
}

impl From<OutOfMemory> for LoadError {
    fn from(missing: OutOfMemory) -> Self {
        Self::Memory(missing)
    }
}

impl fmt::Display for LoadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io { path, cause } => write!(f, "cannot read model {}: {cause}", path.display()),
            Self::Memory(missing) => write!(f, "cannot load the model: {missing}"),
            Self::File(problem) => write!(f, "not a usable model file: {problem}"),
            Self::Argument { name, problem } => write!(f, "`{name}`: {problem}"),
            Self::Config { key, problem } => write!(f, "config `{key}`: {problem}"),
            Self::Tensor { name, problem } => write!(f, "tensor `{name}`: {problem}"),
        }
    }
}

impl std::error::Error for LoadError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io { cause, .. } => Some(cause),
            Self::Memory(missing) => Some(missing),
            Self::File(_) | Self::Argument { .. } | Self::Config { .. } | Self::Tensor { .. } => None,
        }
    }
}

/// Error from a step. `Copy`: reporting one does not allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StepError {
    /// A kernel was called with lengths that disagree: a defect of this library.
    Shape(ShapeError),
    /// More input than the model or session was created for.
    TooLong {
        /// Name of the input.
        what: &'static str,
        /// Number given.
        got: usize,
        /// Upper bound.
        limit: usize,
    },
    /// Nothing was given, but at least one is needed.
    Empty(&'static str),
    /// An id, code or unit outside its range.
    OutOfRange {
        /// Name of the value.
        what: &'static str,
        /// The value.
        got: usize,
        /// Exclusive upper bound.
        limit: usize,
    },
    /// Inputs that must agree with each other do not.
    Disagree(&'static str),
    /// The model file lacks data that the call needs.
    Missing(&'static str),
    /// A call in the wrong order, such as audio after the end.
    Order(&'static str),
    /// A stage of the model produced infinite or NaN values: its weights are damaged or not fully trained.
    NotFinite(&'static str),
    /// A stage of the model produced values that no body can have: its weights are damaged or not fully trained.
    Implausible(&'static str),
}

/// Checks that all values are finite; `what` names them.
///
/// # Errors
/// [`StepError::NotFinite`].
pub fn check_finite(values: &[f32], what: &'static str) -> Result<(), StepError> {
    // No early exit, so that it vectorizes.
    if values.iter().fold(true, |finite, v| finite & v.is_finite()) { Ok(()) } else { Err(StepError::NotFinite(what)) }
}

impl From<ShapeError> for StepError {
    fn from(error: ShapeError) -> Self {
        Self::Shape(error)
    }
}

impl From<ProductError> for StepError {
    fn from(error: ProductError) -> Self {
        match error {
            ProductError::Shape(error) => Self::Shape(error),
            ProductError::Form => Self::Disagree("weights and rows of different precisions"),
        }
    }
}

impl fmt::Display for StepError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Shape(error) => write!(f, "internal: {error}"),
            Self::TooLong { what, got, limit } => write!(f, "{what}: {got} given, at most {limit} allowed"),
            Self::Empty(what) => write!(f, "{what}: at least one is needed"),
            Self::OutOfRange { what, got, limit } => write!(f, "{what} {got} is outside 0..{limit}"),
            Self::Disagree(problem) => write!(f, "{problem}"),
            Self::Missing(what) => write!(f, "this model has no {what}"),
            Self::Order(problem) => write!(f, "{problem}"),
            Self::NotFinite(what) => write!(f, "{what} are not finite: the model's weights are defective"),
            Self::Implausible(problem) => write!(f, "{problem}: the model's weights are defective"),
        }
    }
}

impl std::error::Error for StepError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Shape(error) => Some(error),
            _ => None,
        }
    }
}
