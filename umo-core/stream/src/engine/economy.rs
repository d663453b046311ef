//! Which kind of cores computes what (SPEC 2.9).
//!
//! On a machine with several kinds, an engine has one more worker: one thread on a slow core. While that core computes
//! single chunks with room to spare, it is given them; all else is for the other workers. Threads that share a batch are
//! always of one kind, as the slowest would hold up the others. What chunks take is learned while the engine runs: another
//! program may have the slow cores.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, TryLockError};
use std::time::Duration;

use umo_core_base::team::{CoreGroup, CoreKind, Cores, Priority};

use super::{CoreKinds, EngineConfig, Threads};

/// Most that a chunk may take on the slow core, and most of its time that chunks may take, as a share of their length.
pub(super) const LIMIT: f32 = 0.5;
/// The same to begin there: less, so that the choice does not waver.
const ENTRY: f32 = 0.3;
/// Time over which the share of the core's time is averaged, seconds.
const MEMORY: f32 = 4.0;
/// Chunks in a row that must fit before the slow core is given any.
const TRIALS: u32 = 4;
/// Time before the slow core is tried again after it took too long; doubled each time up to the second.
const WAIT: Duration = Duration::from_secs(5);
const LONGEST_WAIT: Duration = Duration::from_secs(300);
/// Time on the slow core after which the wait is the first again.
const PROVEN: Duration = Duration::from_secs(60);
/// Step of one chunk towards its time.
const RATE: f32 = 0.25;

/// Where an engine's threads run.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Plan {
    /// Number of threads.
    pub(super) threads: usize,
    /// Kind of the team's cores; `None` leaves them to the system.
    pub(super) team: Option<CoreGroup>,
    /// Kind of the slow core, if there is a worker for it.
    pub(super) slow: Option<CoreGroup>,
}

impl Plan {
    /// Chooses the kinds for an engine.
    pub(super) fn new(config: &EngineConfig) -> Self {
        let threads = config.threads.count();
        let left = Self { threads, ..Self::default() };
        let is_ours = config.cores.is_empty() && matches!(config.threads, Threads::Own(_));
        if !is_ours || config.core_kinds == CoreKinds::System {
            return left;
        }
        let machine = config.machine.clone().unwrap_or_else(Cores::system);
        let team = match config.core_kinds {
            CoreKinds::System | CoreKinds::Auto => machine.fastest(threads),
            CoreKinds::Performance => machine.groups().first().filter(|_| machine.differ()),
            CoreKinds::Efficiency => machine.slowest(),
        };
        let Some(team) = team else { return left };
        // Chunks that wait for others are computed together.
        let may_wait = !config.batch_window.is_zero();
        let may_save = config.core_kinds == CoreKinds::Auto && config.priority != Priority::High && !may_wait;
        // Where no kind is meant to save energy, there is nothing to gain.
        let saves = |group: &&CoreGroup| group.kind == CoreKind::Efficiency && group.speed < team.speed;
        let slow = machine.groups().iter().rev().find(saves).filter(|_| may_save).cloned();
        Self { threads: threads.min(team.cores), team: Some(team.clone()), slow }
    }

    /// Number of workers in addition to those of the team.
    pub(super) fn more_workers(&self) -> usize {
        usize::from(self.slow.is_some())
    }

    /// The choice between team and slow core; `None` if there is no slow core.
    pub(super) fn economy(&self) -> Option<Economy> {
        let (team, slow) = (self.team.as_ref()?, self.slow.as_ref()?);
        Some(Economy::new(team.speed / slow.speed))
    }
}

/// A chunk that was computed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Took {
    /// Whether it was on the slow core.
    pub(super) is_slow: bool,
    /// Number of chunks computed together.
    pub(super) chunks: usize,
    pub(super) time: Duration,
    /// Length of a chunk's motion.
    pub(super) period: Duration,
}

/// The choice between the team and the slow core.
#[derive(Debug)]
pub(super) struct Economy {
    /// Whether single chunks are the slow core's.
    is_on: AtomicBool,
    learned: Mutex<Learned>,
}

#[derive(Debug)]
struct Learned {
    /// Time of a chunk on the slow core over that on the team: as the system reports it, and as learned.
    reported: f32,
    ratio: f32,
    /// Share of the slow core's time that chunks take there, or would.
    busy: f32,
    /// Time of a chunk on the team, and of one on the slow core, as a share of its length.
    team: f32,
    slow: f32,
    /// Chunks in a row that would have fitted.
    fitting: u32,
    /// Time of the last chunk's end, of the last change, and from which the slow core may be tried; nanoseconds.
    last: u64,
    changed: u64,
    from: u64,
    wait: Duration,
}

impl Economy {
    /// Starts with the team. `ratio` is the time on the slow core over that on the team, as the system reports it.
    fn new(ratio: f32) -> Self {
        let (busy, team, slow, fitting) = (0.0, 0.0, 0.0, 0);
        let (last, changed, from, wait) = (0, 0, 0, WAIT);
        let learned = Learned { reported: ratio, ratio, busy, team, slow, fitting, last, changed, from, wait };
        Self { is_on: AtomicBool::new(false), learned: Mutex::new(learned) }
    }

    /// Whether single chunks are the slow core's.
    pub(super) fn is_on(&self) -> bool {
        self.is_on.load(Ordering::Relaxed)
    }

    /// Learns from chunks that ended at `now`, nanoseconds. If another worker is in this call, nothing is learned.
    pub(super) fn learn(&self, took: Took, now: u64) {
        let mut learned = match self.learned.try_lock() {
            Ok(learned) => learned,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return,
        };
        let was_on = self.is_on();
        let is_on = learned.next(was_on, took, now);
        if is_on != was_on {
            learned.changed = now;
            self.is_on.store(is_on, Ordering::Relaxed);
        }
    }
}

impl Learned {
    /// Whether the slow core is given single chunks from now on.
    fn next(&mut self, is_on: bool, took: Took, now: u64) -> bool {
        let passed = Duration::from_nanos(now.saturating_sub(self.last)).as_secs_f32();
        self.last = now;
        let share = took.time.as_secs_f32() / took.period.as_secs_f32().max(1e-3);
        let known = if took.is_slow { &mut self.slow } else { &mut self.team };
        // Slower chunks count at once, faster ones bit by bit.
        *known = if took.chunks > 1 { *known } else { share.max(*known + RATE * (share - *known)) };
        if took.is_slow && self.team > 0.0 {
            self.ratio += RATE * (share / self.team - self.ratio);
        }
        let there = if took.is_slow { 1.0 } else { self.ratio };
        self.busy = self.busy * (-passed / MEMORY).exp() + there * took.time.as_secs_f32() / MEMORY;
        if is_on {
            if took.is_slow && self.slow.max(self.busy) > LIMIT {
                self.from = now.saturating_add(u64::try_from(self.wait.as_nanos()).unwrap_or(u64::MAX));
                self.wait = (2 * self.wait).min(LONGEST_WAIT);
                // The times learned there are dropped: the cause of the slowness may end.
                (self.slow, self.ratio, self.fitting) = (0.0, self.reported, 0);
                return false;
            }
            if now.saturating_sub(self.changed) > u64::try_from(PROVEN.as_nanos()).unwrap_or(u64::MAX) {
                self.wait = WAIT;
            }
            return true;
        }
        let fits = took.chunks == 1 && self.team * self.ratio < ENTRY && self.busy < ENTRY;
        self.fitting = if fits { self.fitting + 1 } else { 0 };
        self.fitting >= TRIALS && now >= self.from
    }
}

#[cfg(test)]
mod tests;
