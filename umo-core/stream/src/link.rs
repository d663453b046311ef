//! Queues and protocol between a host, its session and the engine: lock-free, and no side waits.
//!
//! | module | part |
//! |---|---|
//! | `protocol` | the words that the sides share: epochs, ends, and which side waits for which |
//! | `ring` | a queue of words with one producer and one consumer |
//! | `frames` | a queue of whole frames |
//! | `handover` | a value that the host changes and another side takes over |
//! | `signal` | wakes the engine's threads |

mod frames;
mod handover;
mod protocol;
mod ring;
mod signal;

pub(crate) use frames::{FrameRing, Stamp};
pub(crate) use handover::{Handover, try_lock};
pub(crate) use protocol::{EngineView, Epoch, Input, Link};
pub(crate) use ring::Ring;
pub(crate) use signal::Signal;
