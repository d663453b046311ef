//! Speech to full-body motion on the CPU, while the speech is still arriving: the UMo model and its
//! stream.
//!
//! | to | use |
//! |---|---|
//! | load a model file | [`Model`], [`ModelFile`], [`Precision`], [`Isa`] |
//! | animate live speech | [`Engine`], [`EngineConfig`], [`Session`], [`SessionConfig`], [`Frame`] |
//! | animate a recording | [`Animation`], [`AvatarConfig`], [`Compute`], [`Team`] |
//! | send codes and decode them elsewhere | [`Session::pull_packets`], [`Session::decoder`]; [`Animation::packet`], [`Decoder`] |
//! | read a pose | [`Pose`], [`Part`], [`JOINT_NAMES`], [`ARKIT_NAMES`], [`Visemes`] |
#![cfg_attr(
    feature = "retarget",
    doc = "| put a pose on another skeleton | [`Retarget`], [`Rig`], [`Mapping`], [`FaceMap`] |"
)]
//! | know what went wrong | [`LoadError`], [`EngineError`], [`SessionError`], [`StepError`] |
//!
//! ```no_run
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! use std::sync::Arc;
//! use umo_core::{Engine, EngineConfig, Model, SessionConfig};
//!
//! let model = Arc::new(Model::open("model.safetensors".as_ref())?);
//! let engine = Engine::new(model, &EngineConfig::default())?;
//! let session = engine.session(&SessionConfig::new(engine.model().config()))?;
//! session.push_audio(&[0.0; 160])?; // on the audio thread
//! session.pull_frames(8, |frame| println!("{:?}", frame.pose.translation))?; // on the game thread
//! # Ok(())
//! # }
//! ```
//!
//! # Features
//!
//! | feature | default | what it adds |
//! |---|---|---|
//! | `threads` | yes | teams and engines with threads of their own; without it, a host polls its engines, and may lend them its threads |
//! | `files` | yes | models out of files, not of memory alone |
//! | `clock` | yes | the system's clock: budgets of polls, times of stages; without it every moment is the same, and the host tells the time |
//! | `mmap` | yes | model files are mapped and not read: less memory while loading. Implies `files` |
//! | `resample` | yes | sessions at any sample rate, not at the model's alone |
//! | `retarget` | yes | poses on other skeletons, face channels on other blendshapes, gestures out of characters' files |
//! | `internals` | no | every module, for tools of this repository. **Unstable:** any release may change it |
#![deny(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]
// Without `internals` the modules are private, and some of what they hold serves only the tools.
#![cfg_attr(not(feature = "internals"), allow(unreachable_pub, dead_code, unused_imports, reason = "for `internals`"))]

#[path = "."]
mod inner {
    pub mod aligned;
    pub mod animation;
    pub mod audio;
    pub mod avatar;
    pub mod batch;
    #[cfg(feature = "internals")]
    pub mod calibration;
    pub mod clock;
    pub mod config;
    pub mod defect;
    pub mod engine;
    pub mod error;
    #[cfg(feature = "files")]
    pub mod file;
    pub mod floor;
    #[cfg(feature = "retarget")]
    pub mod glb;
    pub mod interp;
    pub(crate) mod layout;
    pub mod life;
    pub mod linear;
    pub mod lm;
    pub mod memory;
    pub mod model;
    pub mod motion;
    pub mod mouth;
    pub mod names;
    pub mod packet;
    pub mod part;
    pub mod record;
    #[cfg(feature = "retarget")]
    pub mod retarget;
    pub mod retime;
    pub mod session;
    pub mod stage;
    pub(crate) mod state;
    pub(crate) mod stream;
    pub(crate) mod sync;
    pub mod team;
    pub mod thread;
    pub mod time;
    pub mod weights;
}

#[cfg(feature = "internals")]
pub use inner::*;
#[cfg(not(feature = "internals"))]
use inner::*;
use inner::{state, stream, sync};

// Models.
pub use inner::config::{Config, Face, FaceKind, Sampling, Skeleton};
pub use inner::linear::Precision;
pub use inner::lm::text::TextTokenizer;
pub use inner::model::Model;
pub use inner::weights::ModelFile;
pub use umo_kernels::Isa;

// Live speech.
pub use inner::audio::MAX_AMPLITUDE;
pub use inner::avatar::{AvatarConfig, StageTimes};
pub use inner::clock::Clock;
pub use inner::engine::{Engine, EngineConfig, Lender, MAX_BATCH, MAX_SESSIONS, Poll, Priority, Threads};
pub use inner::life::{
    Attention, Gesture, GestureOptions, GestureParts, Gestures, LAYERS, Layer, LifeConfig, LipShape,
    MAX_GESTURE_FRAMES, MAX_GESTURES, MAX_HINT_SECONDS, MAX_PENDING_GESTURES, MAX_PENDING_HINTS, Mood, Side,
};
pub use inner::lm::layout::MAX_PROMPT_TOKENS;
pub use inner::lm::sampler::Sampler;
pub use inner::session::{
    AUDIO_SECONDS, Frame, Idle, Latency, MAX_CHANNELS, MAX_EASE, MAX_GAIN, MAX_OUTPUT_DELAY, MAX_RATE, MIN_RATE,
    PacketConfig, Pushed, Sampled, Session, SessionConfig, Stats, Voice,
};

// Recordings.
pub use inner::animation::{Animation, AudioSource};
#[cfg(feature = "resample")]
pub use inner::audio::resample::Resampler;
pub use inner::linear::Compute;
pub use inner::motion::FrameRef;
pub use inner::team::{MAX_THREADS, Team};

// Packets.
pub use inner::packet::{Decoder, PacketError, PacketHead, PacketLayout, Received};

// Poses.
pub use inner::motion::Pose;
pub use inner::motion::rotation::Quat;
pub use inner::motion::skeleton::{ARKIT_NAMES, JOINT_NAMES, JOINTS};
pub use inner::motion::visemes::{VISEME_NAMES, VISEMES, Visemes};
pub use inner::part::{Part, PerPart};
#[cfg(feature = "retarget")]
pub use inner::retarget::{
    Bone, Floor, Follow, MAX_BONES, Mapping, Retarget, RetargetError, Rig, Scratch as RetargetScratch, face::FaceMap,
};

// Errors.
pub use inner::defect::Defect;
pub use inner::engine::{EngineError, PollError};
pub use inner::error::{LoadError, StepError};
pub use inner::memory::OutOfMemory;
pub use inner::session::{SessionError, StateError};

/// This crate's folder of sources, as panics name it.
const SOURCE: &str = file!();
