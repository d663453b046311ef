//! Standard output and standard error of the whole program. `println!`, `print!` and `eprintln!` here replace
//! the standard library's, which panic if the reader has closed the pipe or the disk is full.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

use crate::failure::Failure;

/// Prints a line to standard output; [`finish`] reports errors.
macro_rules! println {
    () => { $crate::console::print(format_args!("\n")) };
    ($($text:tt)*) => { $crate::console::print(format_args!("{}\n", format_args!($($text)*))) };
}

/// Prints to standard output; [`finish`] reports errors.
macro_rules! print {
    ($($text:tt)*) => { $crate::console::print(format_args!($($text)*)) };
}

/// Prints a line to standard error, if it can be written.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::console::note(format_args!("{}\n", format_args!($($text)*))) };
}

/// First error of standard output.
static FAILED: Mutex<Option<io::Error>> = Mutex::new(None);

pub(crate) fn print(text: fmt::Arguments<'_>) {
    remember(io::stdout().lock().write_fmt(text));
}

pub(crate) fn note(text: fmt::Arguments<'_>) {
    // An error of standard error cannot be reported anywhere.
    let _ = io::stderr().lock().write_fmt(text);
}

/// Keeps the first error of standard output for [`finish`].
pub(crate) fn remember(written: io::Result<()>) {
    if let Err(error) = written {
        FAILED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// Flushes standard output and reports its first error. A closed pipe is not an error.
///
/// # Errors
/// [`Failure::Machine`], for example if the disk is full.
pub(crate) fn finish() -> Result<(), Failure> {
    remember(io::stdout().flush());
    match FAILED.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::environment(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}
