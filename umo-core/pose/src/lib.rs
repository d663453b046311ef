//! Poses: rotations, the 55 joints, face channels, frames and clips (SPEC 2.7).
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod axes;
pub mod clip;
pub mod face;
pub mod frame;
pub mod names;
pub mod part;
pub mod pose;
pub mod rotation;
pub mod skeleton;
pub mod visemes;

/// A source file of this crate, as panics name it.
pub const SOURCE: &str = file!();
