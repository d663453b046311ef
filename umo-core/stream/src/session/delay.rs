//! Compute times of chunks: a histogram of fixed size that one thread fills while others read it.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use umo_core_base::memory::{Arena, Slice};

/// Buckets per doubling: a bucket is 4.4 % wide.
const STEPS: usize = 16;
/// Doublings from 1 µs on: up to 18 minutes.
const DOUBLINGS: usize = 30;

/// Histogram of delays.
#[derive(Debug)]
pub(crate) struct Delays {
    buckets: Slice<AtomicU64>,
    largest: AtomicU64,
}

impl Delays {
    pub(crate) fn new_in(arena: &Arena) -> Self {
        let buckets = (0..STEPS * DOUBLINGS).map(|_| AtomicU64::new(0));
        Self { buckets: arena.collect(buckets), largest: AtomicU64::new(0) }
    }

    #[expect(clippy::cast_possible_truncation, reason = "2^64 nanoseconds are 584 years")]
    #[expect(clippy::cast_sign_loss, reason = "a delay of at least a microsecond has a logarithm of at least 0")]
    pub(crate) fn add(&self, delay: Duration) {
        let micros = (delay.as_secs_f64() * 1e6).max(1.0);
        let bucket = (micros.log2() * STEPS as f64) as usize;
        self.buckets[bucket.min(self.buckets.len() - 1)].fetch_add(1, Ordering::Relaxed);
        self.largest.fetch_max(delay.as_nanos() as u64, Ordering::Relaxed);
    }

    pub(crate) fn count(&self) -> u64 {
        self.buckets.iter().map(|bucket| bucket.load(Ordering::Relaxed)).sum()
    }

    pub(crate) fn largest(&self) -> Duration {
        Duration::from_nanos(self.largest.load(Ordering::Relaxed))
    }

    /// Quantile `share` of the delays, to 4.4 %; zero if there are none.
    #[expect(clippy::cast_precision_loss, reason = "a bucket's number is small, and 2^53 chunks are many")]
    pub(crate) fn quantile(&self, share: f64) -> Duration {
        let wanted = (self.count() as f64 * share).ceil();
        let mut sum = 0.0;
        for (i, bucket) in self.buckets.iter().enumerate() {
            let count = bucket.load(Ordering::Relaxed);
            sum += count as f64;
            if count > 0 && sum >= wanted {
                let end = 1e-6 * ((i + 1) as f64 / STEPS as f64).exp2();
                return Duration::from_secs_f64(end).min(self.largest());
            }
        }
        Duration::ZERO
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_within_a_bucket() {
        let delays = Delays::new_in(&Arena::system());
        assert_eq!(delays.quantile(0.5), Duration::ZERO);
        for ms in 1..=1000 {
            delays.add(Duration::from_millis(ms));
        }
        for (share, ms) in [(0.5, 500.0), (0.99, 990.0), (0.001, 1.0)] {
            let found = delays.quantile(share).as_secs_f64() * 1e3;
            assert!((ms..=ms * 1.045).contains(&found), "{share}: {found}");
        }
        assert_eq!(delays.quantile(1.0), Duration::from_secs(1));
        delays.add(Duration::ZERO);
        delays.add(Duration::from_secs(1 << 40));
        assert_eq!(delays.count(), 1002);
    }
}
