//! Shared basics: errors, memory, files, threads, clocks and saved states.
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod aligned;
pub mod arousal;
pub mod clock;
pub mod counters;
pub mod defect;
pub mod error;
pub mod file;
pub mod functions;
pub mod level;
pub mod memory;
pub mod random;
pub mod samples;
pub mod state;
pub mod sync;
pub mod team;
pub mod thread;
pub mod time;
pub mod voice;

/// A source file of this crate, as panics name it.
pub const SOURCE: &str = file!();
