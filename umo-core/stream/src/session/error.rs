//! Errors of a session.

use std::fmt;

use umo_core_base::error::StepError;
use umo_core_base::state::StateError;
use umo_core_layers::RequestError;

use crate::packet::PacketError;

/// Argument of a session's call that can be out of range. Its text gives the range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Argument {
    /// Strength of a mood.
    MoodStrength,
    /// Time of a pose.
    PoseTime,
    /// Delay of the host's output device.
    OutputDelay,
    /// Time of the host's clock.
    HostTime,
    /// Ease of an interrupt.
    Ease,
    /// Number of a prompt's tokens.
    PromptLength,
    /// Temperature and `top_p`.
    Sampling,
    /// Activity of the hands.
    Activity,
    /// Expression of the voice.
    Expression,
    /// Gain of a part of the body.
    PartGain,
    /// Gain of a layer.
    LayerGain,
    /// Point and strength of a look-at.
    LookAt,
    /// Speed and strength of a gesture.
    GestureOptions,
    /// Target of a gesture.
    GestureTarget,
    /// Time of a gesture.
    GestureTime,
    /// Time and duration of a viseme hint.
    VisemeHint,
    /// Times of words.
    WordTime,
    /// Number of one call's words.
    WordCount,
}

impl fmt::Display for Argument {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::MoodStrength => "the strength of a mood must be 0 to 1",
            Self::PoseTime => "the time of a pose must be a number",
            Self::OutputDelay => "the output device's delay must be 0 to 2 seconds",
            Self::HostTime => "the host's time must be 0 to 1e9 seconds",
            Self::Ease => "an interrupt may ease for 10 seconds at most",
            Self::PromptLength => "a prompt has 128 tokens at most",
            Self::Sampling => "temperature must be 0 to 100, and top_p 0 to 1",
            Self::Activity => "the activity must be 0 to 1",
            Self::Expression => "the expression must be 0 to 1",
            Self::PartGain => "the gain of a part must be 0 to 2",
            Self::LayerGain => "the gain of a layer must be 0 to 1",
            Self::LookAt => "a look-at needs a point within 10 km and a strength of 0 to 1",
            Self::GestureOptions => "a gesture's speed must be 0.5 to 2, and its strength 0 to 1",
            Self::GestureTarget => "a gesture's target must be a place within 10 km",
            Self::GestureTime => "a gesture's time must be a number of seconds from 0 on",
            Self::WordTime => "words need a start from 0 on and an end of 0 to 30 seconds later",
            Self::WordCount => "one call takes 64 words at most: give them in several",
            Self::VisemeHint => "a hint needs a time from 0 on and a duration of 0 to 2 seconds",
        })
    }
}

/// A call that failed; it changed nothing. `Copy`: reporting one allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    /// An argument is out of range.
    Range(Argument),
    /// The buffer is too small for what the call writes.
    Short {
        /// Bytes needed.
        needed: usize,
    },
    /// The session has an engine; the call is for decoders.
    NotDecoder,
    /// The session is a decoder, which takes packets alone.
    IsDecoder,
    /// The session plays a take, which has the packets; or the call is for such sessions alone.
    Take,
    /// The session records no take: [`SessionConfig::take_bytes`](super::SessionConfig::take_bytes) is 0.
    NoTake,
    /// The session was made without packets.
    NoPackets,
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
    /// [`MAX_PENDING_GESTURES`](umo_core_layers::MAX_PENDING_GESTURES) gestures are already pending; retry
    /// when one has begun.
    GesturesFull,
    /// [`MAX_PENDING_HINTS`](umo_core_layers::MAX_PENDING_HINTS) viseme hints are already pending; retry when
    /// the time of one has passed.
    HintsFull,
    /// So many words are already pending that [`MAX_PENDING_WORDS`](umo_core_layers::MAX_PENDING_WORDS) would be
    /// exceeded; retry when the time of some has come.
    WordsFull,
}

impl fmt::Display for SessionError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy(call) => write!(f, "another thread is in {call}: call again"),
            Self::Finished => write!(f, "audio was pushed after finish: reset or interrupt the session first"),
            Self::Uneven { got, channels } => {
                write!(f, "sample count {got} is not a multiple of the channel count {channels}")
            }
            Self::Range(argument) => write!(f, "{argument}"),
            Self::Short { needed } => write!(f, "the buffer needs {needed} bytes"),
            Self::NotDecoder => write!(f, "packets are for decoders; this session takes audio"),
            Self::IsDecoder => write!(f, "a decoder takes no audio, text or state: its sender does"),
            Self::Take => write!(f, "a session that plays a take has its packets: push the take; others cannot"),
            Self::NoTake => write!(f, "the session records no take: make it with memory for one"),
            Self::NoPackets => write!(f, "the session was made without packets"),
            Self::Failed(error) => write!(f, "the avatar failed and gives no more frames: {error}"),
            Self::Panicked => write!(f, "the avatar failed by a defect of this library and gives no more frames"),
            Self::Closed => write!(f, "the session's engine is gone"),
            Self::State(error) => write!(f, "{error}"),
            Self::Packet(error) => write!(f, "{error}"),
            Self::UnknownGesture => write!(f, "unknown gesture: list the names"),
            Self::HintsFull => write!(f, "64 lip hints are already queued: call again when the time of one has passed"),
            Self::WordsFull => write!(f, "at most 64 words wait: call again when the time of some has come"),
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

impl From<RequestError> for SessionError {
    fn from(error: RequestError) -> Self {
        match error {
            RequestError::GestureOptions => Self::Range(Argument::GestureOptions),
            RequestError::GestureTarget => Self::Range(Argument::GestureTarget),
            RequestError::GestureTime => Self::Range(Argument::GestureTime),
            RequestError::VisemeHint => Self::Range(Argument::VisemeHint),
            RequestError::WordTime => Self::Range(Argument::WordTime),
            RequestError::WordCount => Self::Range(Argument::WordCount),
            RequestError::WordsFull => Self::WordsFull,
            RequestError::UnknownGesture => Self::UnknownGesture,
            RequestError::GesturesFull => Self::GesturesFull,
            RequestError::HintsFull => Self::HintsFull,
        }
    }
}

impl From<StateError> for SessionError {
    fn from(error: StateError) -> Self {
        Self::State(error)
    }
}
