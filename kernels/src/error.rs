//! The error type of this crate.

use core::fmt;

/// An argument whose length disagrees with the other arguments. It is `Copy`, so that reporting it
/// does not allocate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ShapeError {
    /// Name of the argument in the operation's signature.
    pub arg: &'static str,
    /// Length required by the other arguments.
    pub want: usize,
    /// Actual length.
    pub got: usize,
}

impl fmt::Display for ShapeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "argument `{}`: expected a length of {}, got {}", self.arg, self.want, self.got)
    }
}

impl core::error::Error for ShapeError {}

/// `Ok` if `got == want`, otherwise the error that names `arg`.
#[inline]
pub(crate) fn expect_len(arg: &'static str, want: usize, got: usize) -> Result<(), ShapeError> {
    if want == got { Ok(()) } else { Err(ShapeError { arg, want, got }) }
}
