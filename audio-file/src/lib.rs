//! Recordings of speech from files, as `f32` samples. [`Reader`] gives them block by block, however
//! long they are; [`read`] gives all.
//!
//! | module | part |
//! |---|---|
//! | `format` | formats, by their first bytes |
//! | `bytes` | a file, or a part of it, read where it is wanted |
//! | `wav` | WAV, RF64, RIFX and Wave64, with headers that are not trusted |
//! | `compressed` | all others, by `symphonia`; Opus by `ropus` |

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

/// Sample rates that are read, in Hz.
pub const SAMPLE_RATES: RangeInclusive<u32> = 1_000..=768_000;
/// Most channels that are read.
pub const MAX_CHANNELS: u16 = 8;
