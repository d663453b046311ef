//! Distribution of the due sessions over an engine's workers.
//!
//! With few sessions one worker, the lead, computes all of them, and the threads of its team share
//! its steps. With more sessions, threads that share steps slow each other down more than they
//! help: workers then take their own batches, each on one thread. The counts here only decide how
//! many sessions a worker takes. The slots and the signal guarantee that no session is forgotten or
//! computed twice.

use std::sync::atomic::{AtomicUsize, Ordering};

use umo_core_model::batch::is_cached;
use umo_core_model::config::Config;

use super::{EngineConfig, Threads};

/// The worker that computes alone while there are few sessions.
pub(super) const LEAD: usize = 0;
/// Number of sessions, in work or due, from which workers take their own batches.
const CROWD: usize = 4;

/// Load of an engine's workers.
#[derive(Debug)]
pub(super) struct Load {
    workers: usize,
    /// Batching is on: a worker takes every due session.
    waits: bool,
    /// Number of workers with a batch.
    busy: AtomicUsize,
    /// Number of sessions in all batches.
    members: AtomicUsize,
}

impl Load {
    /// For an engine with a model of these dimensions.
    pub(crate) fn new(config: &EngineConfig, model: &Config) -> Self {
        // Layers that exceed a core's caches are read from memory, once per batch and by all
        // threads together. Sharing steps is faster for them.
        let workers = match config.threads {
            Threads::Own(threads) if config.max_sessions >= CROWD && is_cached(model) => threads,
            _ => 1,
        };
        let waits = !config.batch_window.is_zero();
        Self { workers, waits, busy: AtomicUsize::new(0), members: AtomicUsize::new(0) }
    }

    /// Upper bound on the concurrent batches.
    pub(super) fn workers(&self) -> usize {
        self.workers
    }

    /// Upper bound on the `due` sessions that an idle worker takes; 0 if the lead handles them.
    pub(super) fn part(&self, worker: usize, due: usize) -> usize {
        let is_crowd = self.workers > 1 && due + self.members.load(Ordering::Relaxed) >= CROWD;
        match worker {
            _ if is_crowd && self.waits => due,
            _ if is_crowd => due.div_ceil(self.workers.saturating_sub(self.busy.load(Ordering::Relaxed)).max(1)),
            LEAD => due,
            _ => 0,
        }
    }

    /// Whether another worker has a batch, besides the calling one.
    pub(super) fn is_shared(&self) -> bool {
        self.busy.load(Ordering::Relaxed) > 1
    }

    /// Counts a batch that begins.
    pub(super) fn begin(&self, members: usize) {
        self.busy.fetch_add(1, Ordering::Relaxed);
        self.members.fetch_add(members, Ordering::Relaxed);
    }

    /// Counts a batch that ends.
    pub(super) fn end(&self, members: usize) {
        self.busy.fetch_sub(1, Ordering::Relaxed);
        self.members.fetch_sub(members, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(workers: usize) -> Load {
        Load { workers, waits: false, busy: AtomicUsize::new(0), members: AtomicUsize::new(0) }
    }

    #[test]
    fn few_sessions_are_the_leads() {
        let load = load(2);
        for due in 0..CROWD {
            assert_eq!((load.part(LEAD, due), load.part(1, due)), (due, 0));
        }
        load.begin(1);
        assert_eq!(load.part(1, CROWD - 2), 0);
    }

    #[test]
    fn many_sessions_are_shared_out_among_workers_without_a_batch() {
        let load = load(2);
        assert_eq!((load.part(LEAD, 7), load.part(1, 7)), (4, 4));
        load.begin(4);
        assert_eq!((load.part(1, 3), load.part(1, 0)), (3, 0));
        load.begin(3);
        assert!(load.is_shared());
        load.end(4);
        assert_eq!(load.part(LEAD, 1), 1);
        load.end(3);
        assert!(!load.is_shared());
    }

    #[test]
    fn one_worker_takes_all() {
        let load = load(1);
        assert_eq!(load.part(LEAD, 64), 64);
    }
}
