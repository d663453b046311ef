//! Poses on other skeletons, and characters in glTF files.
//!
//! Implementation detail of `umo-core`, which re-exports what users need. No promise of stability.
#![deny(unsafe_code)]

pub mod glb;
pub mod retarget;
