//! Share of the chunks that is computed in full under overload (SPEC 2.9).

use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

/// Nanoseconds in which the share falls from 1 to 0 while chunks are late, and rises back while
/// they are not. It falls within a few chunks, before the audio ring is full; it rises slowly, so
/// that it settles.
const FALL: f32 = 1.5e9;
const RISE: f32 = 12e9;
/// Upper bound on the time counted between two looks: a longer gap means that nothing was computed.
const LONGEST_LOOK: u64 = 100_000_000;
/// Fraction of a chunk's duration, as a divisor: a chunk is in time if it begins this much before
/// it would be late.
const IN_TIME: i64 = 4;
/// No limit: no body is held.
const UNLIMITED: u64 = u64::MAX;

/// The share, which all workers of an engine update when they look for work.
#[derive(Debug)]
pub(super) struct FullShare {
    /// Lateness, in nanoseconds, at which bodies begin to be held.
    limit: AtomicU64,
    /// An f32 as its bits.
    share: AtomicU32,
    /// Time when a worker looked last, nanoseconds.
    looked: AtomicU64,
}

impl Default for FullShare {
    fn default() -> Self {
        let share = AtomicU32::new(1.0_f32.to_bits());
        Self { limit: AtomicU64::new(UNLIMITED), share, looked: AtomicU64::new(0) }
    }
}

impl FullShare {
    /// Sets the lateness at which bodies begin to be held.
    pub(super) fn set_limit(&self, limit: Option<Duration>) {
        let nanos = limit.map_or(UNLIMITED, |limit| u64::try_from(limit.as_nanos()).unwrap_or(UNLIMITED));
        self.limit.store(nanos, Ordering::Relaxed);
    }

    /// Share of the chunks that is computed in full from `now` on: it falls while the chunk that
    /// has waited longest is `late` by more than the limit, and rises while that chunk is in time.
    pub(super) fn full_share(&self, now: u64, (late, period): (i64, i64)) -> f32 {
        let limit = self.limit.load(Ordering::Relaxed);
        // Elapsed time is counted once, by whichever worker looks first.
        let elapsed = now.saturating_sub(self.looked.fetch_max(now, Ordering::Relaxed)).min(LONGEST_LOOK) as f32;
        let next = |share: f32| {
            if limit == UNLIMITED {
                1.0
            } else if late > i64::try_from(limit).unwrap_or(i64::MAX) {
                (share - elapsed / FALL).max(0.0)
            } else if late <= -period / IN_TIME {
                (share + elapsed / RISE).min(1.0)
            } else {
                share
            }
        };
        let mut bits = self.share.load(Ordering::Relaxed);
        loop {
            let share = next(f32::from_bits(bits));
            match self.share.compare_exchange_weak(bits, share.to_bits(), Ordering::Relaxed, Ordering::Relaxed) {
                Ok(_) => return share,
                Err(now) => bits = now,
            }
        }
    }
}
