//! Live sessions and their engine, packets, and recordings.
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod animation;
pub mod engine;
pub mod levels;
pub mod link;
pub mod packet;
pub(crate) mod playback;
pub mod retime;
pub mod scene;
pub mod session;
pub mod take;

/// A source file of this crate and of each below it, as panics name them.
pub const SOURCES: &[&str] =
    &[umo_core_base::SOURCE, umo_core_pose::SOURCE, umo_core_layers::SOURCE, umo_core_model::SOURCE, file!()];
