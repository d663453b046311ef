//! Speech to full-body motion on the CPU, while the speech is still arriving: the UMo model and its
//! stream.
//!
//! | to | use |
//! |---|---|
//! | load a model file | [`Model`], [`ModelFile`], [`Precision`], [`Isa`] |
//! | animate live speech | [`Engine`], [`EngineConfig`], [`Session`], [`SessionConfig`], [`Frame`] |
//! | let avatars know each other | [`Scene`], [`Place`], [`Target`] |
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
//! # Other skeletons
//!
//! ```
//! use umo_core::{Bone, Floor, Mapping, Pose, Retarget, RetargetError, Rig, Skeleton, StepError};
//!
//! fn prepare(skeleton: &Skeleton, bones: Vec<Bone>) -> Result<Retarget, RetargetError> {
//!     let rig = Rig::new(bones)?; // names, parents, rest transforms: checked
//!     let (mapping, _) = Mapping::guess(&rig)?; // or `Mapping::set` for each joint
//!     Retarget::new(skeleton, &rig, &mapping, Floor::AtRest)
//! }
//!
//! fn animate(retarget: &Retarget, poses: &[Pose]) -> Result<(), StepError> {
//!     let mut scratch = retarget.scratch();
//!     let mut rotations = vec![[0.0, 0.0, 0.0, 1.0]; retarget.bones()]; // the last allocation
//!     for pose in poses {
//!         let hips = retarget.apply(&mut scratch, pose, &mut rotations)?;
//!         println!("bone {} is at {hips:?}", retarget.hips());
//!     }
//!     Ok(())
//! }
//! # let bones = vec![Bone::new("Hips", None, [0.0, 1.0, 0.0])];
//! # assert!(Rig::new(bones).is_ok());
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
#![deny(unsafe_code)]
#![cfg_attr(docsrs, feature(doc_cfg))]

// Models.
#[doc(inline)]
pub use umo_core_model::config::{Config, Sampling};
#[doc(inline)]
pub use umo_core_model::linear::Precision;
#[doc(inline)]
pub use umo_core_model::lm::text::TextTokenizer;
#[doc(inline)]
pub use umo_core_model::model::Model;
#[doc(inline)]
pub use umo_core_model::weights::ModelFile;
#[doc(inline)]
pub use umo_core_pose::face::{Face, FaceKind};
#[doc(inline)]
pub use umo_core_pose::skeleton::Skeleton;
#[doc(inline)]
pub use umo_kernels::Isa;

// Live speech.
#[doc(inline)]
pub use umo_core_base::clock::Clock;
#[doc(inline)]
pub use umo_core_base::samples::MAX_AMPLITUDE;
#[doc(inline)]
pub use umo_core_base::team::{CoreGroup, CoreKind, Cores};
#[doc(inline)]
pub use umo_core_layers::{
    Attention, Gesture, GestureOptions, GestureParts, Gestures, LAYERS, Layer, LayerGains, LipShape, MAX_GESTURES,
    MAX_HINT_SECONDS, MAX_PENDING_GESTURES, MAX_PENDING_HINTS, MAX_PENDING_WORDS, MAX_WORDS_SECONDS, Mood, RulesError,
    Side, WordRules,
};
#[doc(inline)]
pub use umo_core_model::avatar::{AvatarConfig, StageTimes};
#[doc(inline)]
pub use umo_core_model::lm::layout::MAX_PROMPT_TOKENS;
#[doc(inline)]
pub use umo_core_model::lm::sampler::Sampler;
#[doc(inline)]
pub use umo_core_pose::clip::MAX_GESTURE_FRAMES;
#[doc(inline)]
pub use umo_core_stream::engine::{
    CoreKinds, Engine, EngineConfig, MAX_BATCH, MAX_SESSIONS, Poll, Priority, SubmitJobs, Threads,
};
#[doc(inline)]
pub use umo_core_stream::scene::{Allowed, Body, MAX_MEMBERS, MemberInfo, Place, Role, Scene, SceneError, Target};
#[doc(inline)]
pub use umo_core_stream::session::{
    AUDIO_SECONDS, Frame, Idle, Latency, MAX_CHANNELS, MAX_EASE, MAX_GAIN, MAX_OUTPUT_DELAY, MAX_RATE, MIN_RATE,
    PacketConfig, Pushed, Sampled, Session, SessionConfig, Stats, Voice,
};

// Recordings.
#[doc(inline)]
pub use umo_core_base::team::{MAX_THREADS, Team};
#[cfg(feature = "resample")]
#[doc(inline)]
pub use umo_core_model::audio::resample::Resampler;
#[doc(inline)]
pub use umo_core_model::linear::Compute;
#[doc(inline)]
pub use umo_core_model::motion::FrameRef;
#[doc(inline)]
pub use umo_core_stream::animation::{Animation, AudioSource};

// Packets, takes.
#[doc(inline)]
pub use umo_core_stream::packet::{Decoder, PacketError, PacketHead, PacketLayout, Received};
#[doc(inline)]
pub use umo_core_stream::take::{Edit, EditError, Event, Take, TakeError, TakeInfo};

// Poses.
#[doc(inline)]
pub use umo_core_pose::part::{Part, PerPart};
#[doc(inline)]
pub use umo_core_pose::pose::Pose;
#[doc(inline)]
pub use umo_core_pose::rotation::Quat;
#[doc(inline)]
pub use umo_core_pose::skeleton::{ARKIT_NAMES, JOINT_NAMES, JOINTS};
#[doc(inline)]
pub use umo_core_pose::visemes::{VISEME_NAMES, VISEMES, Visemes};
#[cfg(feature = "retarget")]
#[doc(inline)]
pub use umo_core_rig::retarget::face::FaceMap;
#[cfg(feature = "retarget")]
#[doc(inline)]
pub use umo_core_rig::retarget::{
    Bone, Floor, Follow, MAX_BONES, Mapping, Outline, Retarget, RetargetError, Rig, Scratch as RetargetScratch,
    SurfacePoint, Volume,
};

// Errors.
#[doc(inline)]
pub use umo_core_base::defect::Defect;
#[doc(inline)]
pub use umo_core_base::error::{LoadError, StepError};
#[doc(inline)]
pub use umo_core_base::memory::OutOfMemory;
#[doc(inline)]
pub use umo_core_stream::engine::{EngineError, PollError};
#[doc(inline)]
pub use umo_core_stream::session::{Argument, SessionError, StateError};

/// A source file of each crate of this library, as panics name them.
#[doc(hidden)]
pub use umo_core_stream::SOURCES;
