//! Errors of a session.

use std::fmt;

use crate::error::StepError;
use crate::packet::PacketError;
use crate::state::StateError;

/// A call that failed; it changed nothing. `Copy`: reporting one allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum SessionError {
    /// Another thread is in the same call, or in one that excludes it; retry.
    Busy(&'static str),
    /// Audio was pushed after [`Session::finish`](super::Session::finish); call
    /// [`Session::reset`](super::Session::reset) or
    /// [`Session::interrupt`](super::Session::interrupt) first.
    Finished,
    /// The sample count is not a multiple of the session's channel count.
    Uneven {
        /// Number of samples.
        got: usize,
        /// The session's channel count.
        channels: usize,
    },
    /// An argument is out of range; the text gives the range.
    Range(&'static str),
    /// The avatar's computation failed: the session produces no more frames.
    Failed(StepError),
    /// The avatar's computation panicked: the session produces no more frames.
    /// [`Session::defect`](super::Session::defect) has the panic's message.
    Panicked,
    /// The engine is gone; frames that were ready can still be pulled.
    Closed,
    /// A state cannot be restored into this session.
    State(StateError),
    /// A packet was refused.
    Packet(PacketError),
    /// No gesture has this name; [`Session::gesture_names`](super::Session::gesture_names) lists
    /// them.
    UnknownGesture,
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) gestures are already pending; retry
    /// when one has begun.
    GesturesFull,
    /// [`MAX_PENDING_HINTS`](crate::MAX_PENDING_HINTS) viseme hints are already pending; retry when
    /// the time of one has passed.
    HintsFull,
}

impl fmt::Display for SessionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy(call) => write!(f, "another thread is in {call}: call again"),
            Self::Finished => write!(f, "audio was pushed after finish: reset or interrupt the session first"),
            Self::Uneven { got, channels } => {
                write!(f, "sample count {got} is not a multiple of the channel count {channels}")
            }
            Self::Range(what) => write!(f, "{what}"),
            Self::Failed(error) => write!(f, "the avatar failed and yields no more frames: {error}"),
            Self::Panicked => write!(f, "the avatar failed due to a defect of this library and yields no more frames"),
            Self::Closed => write!(f, "the session's engine is gone"),
            Self::State(error) => write!(f, "{error}"),
            Self::Packet(error) => write!(f, "{error}"),
            Self::UnknownGesture => write!(f, "unknown gesture: list the names"),
            Self::HintsFull => write!(f, "64 lip hints are already queued: call again when the time of one has passed"),
            Self::GesturesFull => write!(f, "eight gestures are already queued: call again when one has started"),
        }
    }
}

impl std::error::Error for SessionError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Failed(error) => Some(error),
            Self::State(error) => Some(error),
            Self::Packet(error) => Some(error),
            _ => None,
        }
    }
}

impl From<StateError> for SessionError {
    fn from(error: StateError) -> Self {
        Self::State(error)
    }
}
