//! Settings of an engine: threads and capacity.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

use umo_core_base::clock::Clock;
use umo_core_base::team::{Cores, Priority};
use umo_core_base::thread;

#[cfg(doc)]
use super::Engine;

/// Upper bound on the sessions of an engine.
pub const MAX_SESSIONS: usize = 4096;
/// Upper bound on the avatars of a batch.
pub const MAX_BATCH: usize = 64;

/// Threads and capacity of an engine.
#[derive(Clone, Debug)]
pub struct EngineConfig {
    /// The threads that compute.
    pub threads: Threads,
    /// Cores to pin the threads to, one each; threads beyond the list are not pinned.
    pub cores: Vec<usize>,
    /// Kinds of cores that the threads which are not pinned run on, on a machine that has several.
    pub core_kinds: CoreKinds,
    /// The machine's cores by kind; `None` asks the system when the engine is created.
    pub machine: Option<Cores>,
    /// Priority of the engine's own threads.
    pub priority: Priority,
    /// Upper bound on the sessions, `1..=MAX_SESSIONS`.
    pub max_sessions: usize,
    /// Upper bound on the avatars computed together, `1..=MAX_BATCH`. Larger batches read the
    /// weights less often and need more memory.
    pub max_batch: usize,
    /// Batching window: the longest that a due chunk waits for others, to be computed together.
    /// With 50 ms, 32 avatars take about a fifth less processor time; frames come later by the
    /// wait. A chunk does not wait at the start of a stream, once at most half of its duration is
    /// left until it would be late, or if a batch is full or all sessions are due. Zero turns
    /// waiting off.
    pub batch_window: Duration,
    /// The host's threads, used instead of the engine's own if the host polls.
    pub jobs: Option<SubmitJobs>,
    /// The clock for deadlines and delays.
    pub clock: Clock,
}

/// Asks the host for threads: the polling thread calls it with the number wanted. Each thread that
/// the host provides calls [`Engine::run_job`]. Late or missing threads, and calls by the polling
/// thread itself, only cost speed.
#[derive(Clone)]
pub struct SubmitJobs(pub Arc<dyn Fn(usize) + Send + Sync>);

impl fmt::Debug for SubmitJobs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("SubmitJobs")
    }
}

/// Kinds of cores that an engine's own threads run on (SPEC 2.9). On a machine with cores of one kind all are the same.
///
/// All but [`System`](Self::System) start at most as many threads as the kind has cores. Linux keeps threads on their
/// kind; other systems may run them elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CoreKinds {
    /// A crowd on the kind whose cores are the fastest together; what one slower core computes with room to spare, on
    /// that core, unless the priority is high.
    #[default]
    Auto,
    /// Wherever the system puts them.
    System,
    /// The fastest kind alone.
    Performance,
    /// The slowest kind that is not low-power, alone.
    Efficiency,
}

/// The threads that compute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// This many threads of the engine's own, `1..=MAX_THREADS`. With few sessions they share each
    /// layer of one batch. With more, and a small model, each has its own batches.
    Own(usize),
    /// The thread that calls [`Engine::poll`], helped by this many more threads, `0..MAX_THREADS`.
    Host(usize),
}

impl Threads {
    /// Number of threads that compute.
    #[doc(hidden)]
    pub fn count(self) -> usize {
        match self {
            Self::Own(threads) => threads,
            Self::Host(more) => more.saturating_add(1),
        }
    }
}

impl Default for EngineConfig {
    /// Two threads, 64 sessions, batches of 8, no batching window. Without the feature `threads`
    /// the host polls.
    fn default() -> Self {
        let has_threads = cfg!(feature = "threads");
        Self {
            threads: if has_threads { Threads::Own(thread::available().min(2)) } else { Threads::Host(0) },
            cores: Vec::new(),
            core_kinds: CoreKinds::Auto,
            machine: None,
            priority: Priority::Normal,
            max_sessions: 64,
            max_batch: 8,
            batch_window: Duration::ZERO,
            jobs: None,
            clock: Clock::system(),
        }
    }
}
