//! Errors of requests to the layers.

/// A request that was refused; it changed nothing. `Copy`: reporting one allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// An argument is out of range; the text gives the range.
    Range(&'static str),
    /// No gesture has this name.
    UnknownGesture,
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) gestures are already pending.
    GesturesFull,
    /// [`MAX_PENDING_HINTS`](crate::MAX_PENDING_HINTS) viseme hints are already pending.
    HintsFull,
}
