//! Single stages and floors, for measuring and for comparing with other implementations.
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod floor;
pub mod stage;
