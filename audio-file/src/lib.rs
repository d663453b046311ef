//! Reads speech recordings from files as `f32` samples. [`Reader`] returns them in blocks, whatever their length;
//! [`read`] returns a whole recording.
//!
//! | module | contents |
//! |---|---|
//! | `format` | format detection by the first bytes |
//! | `blocks` | interface of a format's decoder |
//! | `bytes` | random access to a file or a range of it |
//! | `wav` | WAV, RF64, RIFX and Wave64, with untrusted headers |
//! | `compressed` | all other formats, decoded by `symphonia`; Opus by `ropus` |

mod blocks;
mod bytes;
mod compressed;
mod error;
mod format;
mod reader;
mod wav;

pub use error::{AudioError, Note, ReadError};
pub use format::has_extension;
pub use reader::{Reader, Recording, parse, read};

use std::ops::RangeInclusive;

/// Supported sample rates, in Hz.
pub const SAMPLE_RATES: RangeInclusive<u32> = 1_000..=768_000;
/// Upper bound on the number of channels.
pub const MAX_CHANNELS: u16 = 8;
