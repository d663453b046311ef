//! Backlog: time by which a session's frames are behind its audio.

use std::sync::atomic::{AtomicU64, Ordering};

/// Sample frames, at the session's rate, that were pushed in the present stream and that frames
/// cover.
#[derive(Debug)]
pub(crate) struct Backlog {
    pushed: AtomicU64,
    covered: AtomicU64,
    largest: AtomicU64,
    /// Upper bound on the future audio that a frame needs.
    latency: u64,
}

impl Backlog {
    pub(super) fn new(latency: usize) -> Self {
        let (pushed, covered, largest) = Default::default();
        Self { pushed, covered, largest, latency: latency as u64 }
    }

    /// Begins a stream in which `pushed` sample frames were pushed and count as covered.
    pub(super) fn begin(&self, pushed: u64) {
        self.pushed.store(pushed, Ordering::Relaxed);
        self.covered.store(pushed, Ordering::Relaxed);
    }

    /// Sets the number of sample frames pushed in the stream.
    pub(super) fn push(&self, pushed: u64) {
        self.pushed.store(pushed, Ordering::Relaxed);
    }

    /// Marks the stream as covered by frames up to sample frame `sample`, and records the backlog
    /// until now.
    pub(crate) fn cover(&self, sample: u64) {
        self.measure();
        self.covered.store(sample, Ordering::Relaxed);
    }

    /// Backlog: sample frames by which the newest frame is behind the newest audio, beyond the
    /// algorithmic latency. Returns the current value and the largest so far.
    pub(super) fn measure(&self) -> (u64, u64) {
        let pushed = self.pushed.load(Ordering::Relaxed);
        let promised = self.covered.load(Ordering::Relaxed) + self.latency;
        let backlog = pushed.saturating_sub(promised);
        (backlog, self.largest.fetch_max(backlog, Ordering::Relaxed).max(backlog))
    }
}
