//! What a session refuses, and why it ends.

use std::fmt;

use crate::error::StepError;
use crate::packet::PacketError;
use crate::state::StateError;

/// A call that could not be done; nothing was changed by it. `Copy`: reporting one allocates
/// nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum SessionError {
    /// Another thread is in the same call, or in one that excludes it; the call may be repeated.
    Busy(&'static str),
    /// Audio was pushed after [`Session::finish`](super::Session::finish);
    /// [`Session::reset`](super::Session::reset) or
    /// [`Session::interrupt`](super::Session::interrupt) start anew.
    Finished,
    /// The sample count is not a multiple of the session's channel count.
    Uneven {
        /// Samples given.
        got: usize,
        /// Channels of the session.
        channels: usize,
    },
    /// An argument is out of its range, which the text says.
    Range(&'static str),
    /// The avatar's computation failed: the session gives no more frames.
    Failed(StepError),
    /// The avatar's computation panicked: the session gives no more frames.
    /// [`Session::defect`](super::Session::defect) says what the panic said.
    Panicked,
    /// The engine is gone; frames that were ready can still be pulled.
    Closed,
    /// A state cannot be restored into this session.
    State(StateError),
    /// A packet was not taken.
    Packet(PacketError),
    /// No gesture has this name; [`Session::gesture_names`](super::Session::gesture_names) says
    /// which there are.
    UnknownGesture,
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) gestures wait already; the call may be
    /// repeated when one has begun.
    GesturesFull,
    /// [`MAX_PENDING_HINTS`](crate::MAX_PENDING_HINTS) hints of lips wait already; the call may be
    /// repeated when the time of one has passed.
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
            Self::Failed(error) => write!(f, "the avatar failed and gives no more frames: {error}"),
            Self::Panicked => write!(f, "the avatar failed by a defect of this library and gives no more frames"),
            Self::Closed => write!(f, "the session's engine is gone"),
            Self::State(error) => write!(f, "{error}"),
            Self::Packet(error) => write!(f, "{error}"),
            Self::UnknownGesture => write!(f, "no gesture has this name: list the names that there are"),
            Self::HintsFull => write!(f, "64 hints of lips wait already: call again when the time of one has passed"),
            Self::GesturesFull => write!(f, "eight gestures wait already: call again when one has begun"),
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
