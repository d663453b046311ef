//! Errors of requests to the layers.

/// A request that was refused; it changed nothing. `Copy`: reporting one allocates nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RequestError {
    /// Speed or strength of a gesture out of range.
    GestureOptions,
    /// Target of a gesture out of range.
    GestureTarget,
    /// Time of a gesture out of range.
    GestureTime,
    /// Time or duration of a viseme hint out of range.
    VisemeHint,
    /// Times of words out of range.
    WordTime,
    /// More words in one call than can wait.
    WordCount,
    /// No gesture has this name.
    UnknownGesture,
    /// [`MAX_PENDING_GESTURES`](crate::MAX_PENDING_GESTURES) gestures are already pending.
    GesturesFull,
    /// [`MAX_PENDING_HINTS`](crate::MAX_PENDING_HINTS) viseme hints are already pending.
    HintsFull,
    /// [`MAX_PENDING_WORDS`](crate::MAX_PENDING_WORDS) words are already pending.
    WordsFull,
}

impl From<umo_core_words::WordError> for RequestError {
    fn from(error: umo_core_words::WordError) -> Self {
        match error {
            umo_core_words::WordError::Time => Self::WordTime,
            umo_core_words::WordError::TooMany => Self::WordCount,
            umo_core_words::WordError::Full => Self::WordsFull,
        }
    }
}
