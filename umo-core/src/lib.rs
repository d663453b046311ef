//! Speech to full-body motion on the CPU: the UMo model and its stream.
//!
//! | module | what it holds | SPEC |
//! |---|---|---|
//! | [`config`], [`weights`] | the model file: every dimension, every tensor | 3 |
//! | [`model`], [`avatar`] | a loaded model; one avatar's stream | 2, 2.8 |
//! | [`batch`], [`animation`] | the next chunks of many avatars; one avatar at the caller's pace | 2, 2.9 |
//! | [`engine`], [`session`] | avatars that answer while somebody speaks: threads, scheduling; one of them as its host sees it | 2.8 |
//! | [`audio`] | samples to audio units | 2.1 |
//! | [`lm`] | units, text and history to the codes of new keyframes | 2.2 to 2.5 |
//! | [`interp`] | keyframes to a code for every frame | 2.6 |
//! | [`motion`] | codes to poses, as a whole or as they become known; poses to codes | 2.7, 2.8 |
//! | [`linear`], [`team`] | products at the model's precision, shared by a few threads | 2.9 |
//! | [`floor`] | what each stage must do at least, and how long this processor takes for that | |
//! | [`record`] | what a chunk was made of: codes, experts | |
//! | [`stage`] | one stage alone, for checking a model | 3.1 |
//! | [`retarget`] | poses on other skeletons, face channels on other shapes | |
//! | [`part`], [`error`], [`defect`], [`mod@file`] | the four parts; what can go wrong; panics, contained; opening files | 1 |
#![deny(unsafe_code)]

pub mod animation;
pub mod audio;
pub mod avatar;
pub mod batch;
pub mod clock;
pub mod config;
pub mod defect;
pub mod engine;
pub mod error;
pub mod file;
pub mod floor;
pub mod interp;
pub mod linear;
pub mod lm;
pub mod memory;
pub mod model;
pub mod motion;
pub mod part;
pub mod record;
pub mod retarget;
mod ring;
pub mod session;
pub mod stage;
mod state;
mod sync;
pub mod team;
pub mod weights;

pub use config::Config;
pub use defect::Defect;
pub use error::{LoadError, StepError};
pub use linear::{Compute, Linear, Precision, QuantScratch};
pub use part::{Part, PerPart};
pub use team::Team;
pub use weights::ModelFile;

/// The README's example, compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../../README.md")]
struct Readme;
