//! Speech to full-body motion on the CPU: the UMo model and its stream.
//!
//! | module | what it holds | SPEC |
//! |---|---|---|
//! | [`config`], [`weights`] | the model file: every dimension, every tensor | 3 |
//! | [`linear`], [`team`] | products at the model's precision, shared by a few threads | 2.9 |
//! | [`audio`] | samples to audio units | 2.1 |
//! | [`motion`] | codes to poses | 2.7 |
//! | [`part`], [`error`] | the four parts; what can go wrong | 1 |
#![deny(unsafe_code)]

pub mod audio;
pub mod config;
pub mod error;
pub mod linear;
pub mod lm;
pub mod motion;
pub mod part;
pub mod stage;
pub mod team;
pub mod weights;

pub use config::Config;
pub use error::{LoadError, StepError};
pub use linear::{Compute, Linear, Precision, QuantScratch};
pub use part::{Part, PerPart};
pub use team::Team;
pub use weights::ModelFile;
