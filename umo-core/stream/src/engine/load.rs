//! Distribution of the due sessions over an engine's workers.
//!
//! With few sessions one worker, the lead, computes all of them, and the threads of its team share
//! its steps. With more sessions, threads that share steps slow each other down more than they
//! help: workers then take their own batches, each on one thread. The counts here only decide how
//! many sessions a worker takes. A worker on a slow core, if there is one, takes single sessions
//! while [`Economy`] says so. The slots and the signal guarantee that no session is forgotten or
//! computed twice.

use std::sync::atomic::{AtomicUsize, Ordering};

use umo_core_model::batch::is_cached;
use umo_core_model::config::Config;

use super::economy::{Economy, Plan};
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
    /// The choice between them and the worker on a slow core, whose number is the next one.
    economy: Option<Economy>,
}

impl Load {
    /// For an engine with a model of these dimensions.
    pub(crate) fn new(config: &EngineConfig, plan: &Plan, model: &Config) -> Self {
        // Layers that exceed a core's caches are read from memory, once per batch and by all
        // threads together. Sharing steps is faster for them.
        let workers = match config.threads {
            Threads::Own(_) if config.max_sessions >= CROWD && is_cached(model) => plan.threads,
            _ => 1,
        };
        let waits = !config.batch_window.is_zero();
        Self { workers, waits, busy: AtomicUsize::new(0), members: AtomicUsize::new(0), economy: plan.economy() }
    }

    /// Upper bound on the concurrent batches, except that on a slow core.
    pub(super) fn workers(&self) -> usize {
        self.workers
    }

    /// Whether this worker has the slow core.
    pub(super) fn is_slow(&self, worker: usize) -> bool {
        worker == self.workers && self.economy.is_some()
    }

    /// The choice between the team and the slow core, if there is one.
    pub(super) fn economy(&self) -> Option<&Economy> {
        self.economy.as_ref()
    }

    /// The worker that computes the `due` sessions while there are few; `begins` if one of them begins its stream, for
    /// whose first frame somebody waits.
    pub(super) fn keeper(&self, due: usize, begins: bool) -> usize {
        let is_single = due + self.members.load(Ordering::Relaxed) <= 1 && !begins;
        let is_slow = is_single && self.economy.as_ref().is_some_and(Economy::is_on);
        if is_slow { self.workers } else { LEAD }
    }

    /// The worker to wake first.
    pub(super) fn first(&self) -> usize {
        self.keeper(1, false)
    }

    /// Upper bound on the `due` sessions that an idle worker takes; 0 if the keeper handles them.
    pub(super) fn part(&self, worker: usize, due: usize, begins: bool) -> usize {
        let is_crowd = self.workers > 1 && due + self.members.load(Ordering::Relaxed) >= CROWD;
        match worker {
            _ if worker == self.keeper(due, begins) && !is_crowd => due,
            _ if worker >= self.workers => 0,
            _ if is_crowd && self.waits => due,
            _ if is_crowd => due.div_ceil(self.workers.saturating_sub(self.busy.load(Ordering::Relaxed)).max(1)),
            _ => 0,
        }
    }

    /// Whether another worker has a batch, besides the calling one.
    pub(super) fn is_shared(&self) -> bool {
        self.busy.load(Ordering::Relaxed) > 1
    }

    /// Counts a batch of `worker` that begins.
    pub(super) fn begin(&self, worker: usize, members: usize) {
        // The slow core takes no core from the others.
        self.busy.fetch_add(usize::from(!self.is_slow(worker)), Ordering::Relaxed);
        self.members.fetch_add(members, Ordering::Relaxed);
    }

    /// Counts a batch of `worker` that ends.
    pub(super) fn end(&self, worker: usize, members: usize) {
        self.busy.fetch_sub(usize::from(!self.is_slow(worker)), Ordering::Relaxed);
        self.members.fetch_sub(members, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(workers: usize) -> Load {
        Load { workers, waits: false, busy: AtomicUsize::new(0), members: AtomicUsize::new(0), economy: None }
    }

    #[test]
    fn few_sessions_are_the_leads() {
        let load = load(2);
        for due in 0..CROWD {
            assert_eq!((load.part(LEAD, due, false), load.part(1, due, false)), (due, 0));
        }
        load.begin(LEAD, 1);
        assert_eq!(load.part(1, CROWD - 2, false), 0);
    }

    #[test]
    fn many_sessions_are_shared_out_among_workers_without_a_batch() {
        let load = load(2);
        assert_eq!((load.part(LEAD, 7, false), load.part(1, 7, false)), (4, 4));
        load.begin(LEAD, 4);
        assert_eq!((load.part(1, 3, false), load.part(1, 0, false)), (3, 0));
        load.begin(LEAD, 3);
        assert!(load.is_shared());
        load.end(LEAD, 4);
        assert_eq!(load.part(LEAD, 1, false), 1);
        load.end(LEAD, 3);
        assert!(!load.is_shared());
    }

    #[test]
    fn one_worker_takes_all() {
        let load = load(1);
        assert_eq!(load.part(LEAD, 64, false), 64);
    }

    #[test]
    fn single_sessions_are_the_slow_cores_while_it_has_room() {
        let (machine, threads) = (Some(crate::engine::tests::two_kinds(&[0], &[1])), Threads::Own(1));
        let config = EngineConfig { machine, threads, ..EngineConfig::default() };
        let plan = Plan::new(&config);
        let load = Load { economy: plan.economy(), ..load(2) };
        let (slow, economy) = (2, load.economy().unwrap());
        assert!(load.is_slow(slow) && !load.is_slow(1));
        assert_eq!((load.part(LEAD, 1, false), load.part(slow, 1, false), load.first()), (1, 0, LEAD));
        let took = |is_slow, time| super::super::economy::Took {
            is_slow,
            chunks: 1,
            time: std::time::Duration::from_millis(time),
            period: std::time::Duration::from_millis(500),
        };
        (0..10).for_each(|i| economy.learn(took(false, 10), i * 500_000_000));
        assert_eq!((load.part(LEAD, 1, false), load.part(slow, 1, false), load.first()), (0, 1, slow));
        assert_eq!((load.keeper(1, false), load.keeper(1, true), load.keeper(2, false)), (slow, LEAD, LEAD));
        // A stream's first chunk, two at once, and one beside another are the team's.
        assert_eq!((load.part(LEAD, 1, true), load.part(slow, 1, true)), (1, 0));
        assert_eq!((load.part(LEAD, 2, false), load.part(slow, 2, false)), (2, 0));
        load.begin(slow, 1);
        assert_eq!((load.part(LEAD, 1, false), load.part(slow, 1, false)), (1, 0));
        assert!(!load.is_shared());
        assert_eq!((load.part(LEAD, 7, false), load.part(1, 7, false), load.part(slow, 7, false)), (4, 4, 0));
        load.end(slow, 1);
        economy.learn(took(true, 400), 0);
        assert_eq!((load.part(LEAD, 1, false), load.part(slow, 1, false)), (1, 0));
    }
}
