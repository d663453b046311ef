//! What a host, its session and the engine pass to each other, and in which order they may: no
//! lock, no wait.
//!
//! | module | part |
//! |---|---|
//! | `protocol` | the words that the sides share: epochs, ends, who waits for what |
//! | `ring` | a queue of words with one producer and one consumer |
//! | `frames` | the same of whole frames |
//! | `signal` | wakes the engine's thread |

mod frames;
mod protocol;
mod ring;
mod signal;

pub(crate) use frames::{FrameRing, MAX_INDEX, MAX_SAMPLE, OwnedFrame, Stamp};
pub(crate) use protocol::{EngineView, Epoch, Input, Link};
pub(crate) use ring::Ring;
pub(crate) use signal::Signal;
