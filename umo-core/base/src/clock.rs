//! Clock for deadlines and delays: the system's, or one set by a simulation.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use crate::time::Instant;

/// Offset of [`Clock::nanos`], so that times before the clock's start, which a restored session may contain, are
/// representable.
const START: u64 = 1 << 62;

/// A monotonic clock.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Clock {
    /// The system's clock, counted from this instant.
    System(Instant),
    /// Nanoseconds, set by a simulation.
    Manual(Arc<AtomicU64>),
}

impl Clock {
    /// The system's clock, starting now.
    pub fn system() -> Self {
        Self::System(Instant::now())
    }

    /// Time since the clock's start.
    pub fn now(&self) -> Duration {
        match self {
            Self::System(start) => start.elapsed(),
            Self::Manual(nanos) => Duration::from_nanos(nanos.load(Ordering::Relaxed)),
        }
    }

    #[expect(clippy::cast_possible_truncation, reason = "2^62 nanoseconds are 146 years")]
    /// Time since the clock's start plus a fixed offset, nanoseconds.
    #[doc(hidden)]
    pub fn nanos(&self) -> u64 {
        START + self.now().as_nanos() as u64
    }
}
