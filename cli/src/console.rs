//! Standard output and standard error, for the whole program: `println!`, `print!` and `eprintln!` here are not
//! the standard library's, which panic where a reader is gone or a disk is full.

use std::fmt;
use std::io::{self, ErrorKind, Write};
use std::sync::{Mutex, PoisonError};

use crate::failure::Failure;

/// Prints a line to standard output; [`finish`] tells where that failed.
macro_rules! println {
    () => { $crate::console::print(format_args!("\n")) };
    ($($text:tt)*) => { $crate::console::print(format_args!("{}\n", format_args!($($text)*))) };
}

/// Prints to standard output; [`finish`] tells where that failed.
macro_rules! print {
    ($($text:tt)*) => { $crate::console::print(format_args!($($text)*)) };
}

/// Prints a line to standard error, if it can be written.
macro_rules! eprintln {
    ($($text:tt)*) => { $crate::console::note(format_args!("{}\n", format_args!($($text)*))) };
}

/// The first error of standard output.
static FAILED: Mutex<Option<io::Error>> = Mutex::new(None);

pub(crate) fn print(text: fmt::Arguments<'_>) {
    remember(io::stdout().lock().write_fmt(text));
}

pub(crate) fn note(text: fmt::Arguments<'_>) {
    // Nobody is left who could be told.
    let _ = io::stderr().lock().write_fmt(text);
}

/// Keeps what standard output answered for [`finish`].
pub(crate) fn remember(written: io::Result<()>) {
    if let Err(error) = written {
        FAILED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
    }
}

/// Flushes standard output, and says whether it took everything. A reader that is gone wanted no more.
///
/// # Errors
/// [`Failure::Machine`], for example where the disk is full.
pub(crate) fn finish() -> Result<(), Failure> {
    remember(io::stdout().flush());
    match FAILED.lock().unwrap_or_else(PoisonError::into_inner).take() {
        Some(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::environment(format!("cannot write to standard output: {error}")))
        }
        _ => Ok(()),
    }
}
