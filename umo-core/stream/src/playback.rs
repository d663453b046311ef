//! The frame side as a chain of stages: from the frames of the decoders to the frames that the host
//! shows (SPEC 2.8 to 2.11).
//!
//! ```text
//!  interrupt ease ──────────────────────┐
//!  source ──► arrival ease ──► gap ─────┴─► layers ──► sample ──► idle ──► gain ──► host
//! ```
//!
//! | module | stage |
//! |---|---|
//! | `source` | takes frames of the present epoch out of the ring and places them where the avatar stands; `voice` puts the live mouth over them |
//! | `ease` | after an interrupt: to rest, and from rest into the next stream |
//! | `gap` | into the frames after lost or late packets |
//! | `layers` | procedural layers |
//! | `sample` | the frame shown last and the next one; interpolation between them |
//! | `idle` | to idle when audio stops, and back |
//! | `gain` | gains of the parts |
//! | `host` | what the host sets for these stages: its time, its requests to the layers |
//!
//! Each stage has `reset`, for the start of a stream; `apply`, which changes a frame; and `state`.
//! [`Session`](crate::session::Session) runs all of them, [`Animation`](crate::animation::Animation)
//! those that a recording needs. No stage allocates, waits or panics.

mod ease;
mod gain;
mod gap;
mod host;
mod idle;
mod layers;
mod sample;
mod source;
mod trend;
mod voice;

use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::pose::Pose;

use crate::link::Epoch;

pub(crate) use ease::{Arrival, ToRest, frames_of};
pub use gain::MAX_GAIN;
pub(crate) use gain::{Gained, gain_bits};
pub(crate) use gap::Gap;
pub(crate) use host::Host;
pub use idle::Idle;
pub(crate) use idle::IdleBlend;
pub(crate) use layers::{Layers, LayersState, controls};
pub use sample::Sampled;
pub(crate) use sample::{Sample, Window};
pub(crate) use source::Source;
pub(crate) use trend::Trend;
pub(crate) use voice::LiveVoice;
pub use voice::Voice;

/// A frame as the host sees it.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a> {
    /// Index since the session's start or last reset, 30 per second.
    pub index: u64,
    /// Sample frame of the pushed audio, at the session's rate, that the frame belongs to.
    pub sample: u64,
    /// Rotations relative to the parents; root translation in metres.
    pub pose: &'a Pose,
    /// Face values, in the order of the model's names.
    pub face: &'a [f32],
}

impl<'a> From<&'a OwnedFrame> for Frame<'a> {
    fn from(frame: &'a OwnedFrame) -> Self {
        Self { index: frame.index, sample: frame.sample, pose: &frame.pose, face: &frame.face }
    }
}

/// Start of a stream, for the stages.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Start<'a> {
    pub(crate) epoch: Epoch,
    /// Whether the session was reset; otherwise it was interrupted.
    pub(crate) is_reset: bool,
    /// Whether any frame was shown since the last reset.
    pub(crate) is_shown: bool,
    /// Number of frames of the ease to rest before the stream; 0 if there is nothing to ease from.
    pub(crate) ease: u64,
    /// Index of the stream's first frame.
    pub(crate) base: u64,
    /// The frame shown last, without layers; the rest pose after a reset.
    pub(crate) last: &'a OwnedFrame,
    pub(crate) rest: &'a OwnedFrame,
}
