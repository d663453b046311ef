//! What an engine is made with: who computes, and for how many.

use std::fmt;
use std::sync::Arc;
use std::time::Duration;

#[cfg(doc)]
use super::Engine;
use crate::clock::Clock;
use crate::team::Priority;
use crate::thread;

/// Most sessions of an engine.
pub const MAX_SESSIONS: usize = 4096;
/// Most avatars of a batch.
pub const MAX_BATCH: usize = 64;

/// Threads and capacity of an engine.
#[derive(Clone, Debug)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub struct EngineConfig {
    /// Who computes.
    pub threads: Threads,
    /// Cores to pin the threads to, one each; threads beyond the list are not pinned.
    pub cores: Vec<usize>,
    /// That of the engine's own threads.
    pub priority: Priority,
    /// Most sessions at once, `1..=MAX_SESSIONS`.
    pub max_sessions: usize,
    /// Most avatars that are computed together, `1..=MAX_BATCH`: more read the weights less often,
    /// and need memory.
    pub max_batch: usize,
    /// The longest that a chunk which is due waits for others, to be computed together: with 50 ms, 32 avatars take about
    /// a fifth less processor time, and frames come later by the wait. A chunk does not wait at the start of a stream, once
    /// half of its length or less is left until it would be late, or where all sessions are due. Zero: none waits.
    pub gather: Duration,
    /// The host's threads, in place of the engine's own, where the host polls.
    pub lender: Option<Lender>,
    /// What time it is.
    pub clock: Clock,
}

/// Asks the host for threads: called by the thread that polls, with how many are wanted. Each that
/// the host finds calls [`Engine::lend`]; late ones, missing ones and calls by the polling thread
/// itself cost speed and nothing else.
#[derive(Clone)]
pub struct Lender(pub Arc<dyn Fn(usize) + Send + Sync>);

impl fmt::Debug for Lender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Lender")
    }
}

/// Who computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(not(feature = "internals"), non_exhaustive)]
pub enum Threads {
    /// As many threads of the engine's own, `1..=MAX_THREADS`. With few sessions they share each layer of
    /// one batch; with more, and a small model, each has batches of its own.
    Own(usize),
    /// Whoever calls [`Engine::poll`], with the help of as many more threads, `0..MAX_THREADS`.
    Host(usize),
}

impl Threads {
    /// How many threads compute.
    pub(super) fn count(self) -> usize {
        match self {
            Self::Own(threads) => threads,
            Self::Host(more) => more.saturating_add(1),
        }
    }
}

impl Default for EngineConfig {
    /// Two threads, 64 sessions, 8 of them together; none waits for others. Without the feature `threads` the host polls.
    fn default() -> Self {
        let has_threads = cfg!(feature = "threads");
        Self {
            threads: if has_threads { Threads::Own(thread::available().min(2)) } else { Threads::Host(0) },
            cores: Vec::new(),
            priority: Priority::Normal,
            max_sessions: 64,
            max_batch: 8,
            gather: Duration::ZERO,
            lender: None,
            clock: Clock::system(),
        }
    }
}
