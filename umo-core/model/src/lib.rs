//! The networks of the model, and the chunks of an avatar.
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod audio;
pub mod avatar;
pub mod batch;
pub mod calibration;
pub mod config;
pub mod interp;
pub mod layout;
pub mod linear;
pub mod lm;
pub mod model;
pub mod motion;
pub mod mouth;
mod pauses;
pub mod record;
pub mod weights;

/// A source file of this crate, as panics name it.
pub const SOURCE: &str = file!();
