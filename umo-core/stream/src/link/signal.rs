//! Wakes the engine's threads when there may be work.

use std::time::Duration;

pub(super) use umo_core_base::sync::{AtomicBool, AtomicU32, Ordering, Parking};

use std::sync::atomic::AtomicUsize;

/// The thread looks for work or computes.
const AWAKE: u32 = 0;
/// The thread found no work and sleeps.
const ASLEEP: u32 = 1;
/// There may be work that the thread has not seen: it looks again before it sleeps.
const CALLED: u32 = 2;

/// State of one thread, on which it sleeps.
#[derive(Debug, Default)]
struct Place {
    state: AtomicU32,
    parking: Parking,
}

impl Place {
    /// Makes the thread look again; returns whether it slept.
    fn call(&self) -> bool {
        let slept = self.state.swap(CALLED, Ordering::SeqCst) == ASLEEP;
        if slept {
            self.parking.wake(&self.state);
        }
        slept
    }
}

/// Threads that sleep until there may be work or until they are stopped. The first sleeping one is
/// woken, after the one that [`Self::set_first`] names.
///
/// No call is lost: a thread that is called after it began to look does not go to sleep, and one
/// that is called before it begins sees all work from before the call.
#[derive(Debug)]
pub(crate) struct Signal {
    places: Box<[Place]>,
    /// The thread that is woken first; the others follow in their order.
    first: AtomicUsize,
    stopped: AtomicBool,
}

impl Default for Signal {
    /// A signal for one thread.
    fn default() -> Self {
        Self::new(1)
    }
}

impl Signal {
    /// Creates a signal for `threads` threads.
    pub(crate) fn new(threads: usize) -> Self {
        let places = (0..threads).map(|_| Place::default()).collect();
        Self { places, first: AtomicUsize::new(0), stopped: AtomicBool::new(false) }
    }

    /// Sets which thread [`Self::notify`] wakes first.
    pub(crate) fn set_first(&self, thread: usize) {
        self.first.store(thread, Ordering::Relaxed);
    }

    /// Reports that there may be work. Wakes the first sleeping thread, if any; the busy threads
    /// before it look again when they are done. Wait-free; makes a system call only if a thread
    /// sleeps.
    pub(crate) fn notify(&self) {
        // The woken thread wakes others if there is more work than it takes.
        let first = self.first.load(Ordering::Relaxed);
        let _ = self.places[first].call() || self.places.iter().any(Place::call);
    }

    /// [`Self::notify`] for one thread: there may be work for `thread` alone.
    pub(crate) fn call(&self, thread: usize) {
        self.places[thread].call();
    }

    /// Sleeps until `thread` is called, for at most `longest` if given. Returns at once if it was
    /// called since its turn began. Only that thread calls this.
    pub(crate) fn sleep(&self, thread: usize, longest: Option<Duration>) {
        let Place { state, parking } = &self.places[thread];
        parking.enter();
        if state.compare_exchange(AWAKE, ASLEEP, Ordering::SeqCst, Ordering::SeqCst).is_err() {
            return;
        }
        match longest {
            // This may wake spuriously: the thread looks once more than necessary.
            Some(longest) => parking.wait_for(state, ASLEEP, longest),
            None => {
                while state.load(Ordering::SeqCst) == ASLEEP {
                    parking.wait(state, ASLEEP);
                }
            }
        }
    }

    /// Stops all threads: wakes them, and their loops end at the next turn.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        self.places.iter().for_each(|place| {
            place.call();
        });
    }

    /// Begins a turn of `thread`, in which it looks for work; returns false once stopped.
    pub(crate) fn begin_turn(&self, thread: usize) -> bool {
        // The order matters: if `stop` comes after the load of `stopped`, it still changes the
        // state, and `sleep` returns.
        self.places[thread].state.swap(AWAKE, Ordering::SeqCst);
        !self.stopped.load(Ordering::SeqCst)
    }
}

#[cfg(all(test, not(loom), feature = "threads"))]
mod tests {
    use super::*;

    /// Longer than any test may take.
    const HOURS: Duration = Duration::from_secs(7200);

    #[test]
    fn a_sleep_ends_by_a_call_or_by_its_limit() {
        let signal = Signal::new(2);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for longest in [None, Some(HOURS), None, Some(HOURS)] {
                    assert!(signal.begin_turn(1));
                    signal.call(0);
                    signal.sleep(1, longest);
                }
                signal.stop();
            });
            while signal.begin_turn(0) {
                signal.call(1);
                signal.sleep(0, Some(HOURS));
            }
        });
        let signal = Signal::default();
        for _ in 0..3 {
            assert!(signal.begin_turn(0));
            signal.sleep(0, Some(Duration::from_millis(1)));
        }
    }
}

/// A lost call is a deadlock, which loom reports.
#[cfg(all(test, loom))]
mod interleavings {
    use super::*;
    use loom::sync::{Arc, Mutex};

    /// Runs every interleaving with at most three preemptions; losing a call takes two.
    fn explore(threads: impl Fn() + Send + Sync + 'static) {
        let mut model = loom::model::Builder::new();
        model.preemption_bound = Some(3);
        model.check(threads);
    }

    #[test]
    fn stop_ends_the_loops_at_any_point_of_a_turn() {
        explore(|| {
            let signal = Arc::new(Signal::new(2));
            let other = Arc::clone(&signal);
            let other = loom::thread::spawn(move || {
                while other.begin_turn(1) {
                    other.sleep(1, None);
                }
            });
            let host = Arc::clone(&signal);
            let host = loom::thread::spawn(move || {
                host.notify();
                host.stop();
            });
            while signal.begin_turn(0) {
                signal.sleep(0, None);
            }
            host.join().unwrap();
            other.join().unwrap();
        });
    }

    /// A chunk becomes due while both threads look for work or go to sleep. The second thread
    /// leaves it to the first, as an engine's other workers do with few chunks, and may hold its
    /// slot while the first one looks. The slot holds an atomic, because loom switches threads only
    /// at those.
    #[test]
    fn what_one_thread_leaves_to_the_other_is_not_lost() {
        explore(|| {
            let (signal, slot) = (Arc::new(Signal::new(2)), Arc::new(Mutex::new(AtomicBool::new(false))));
            let (other, seen) = (Arc::clone(&signal), Arc::clone(&slot));
            let other = loom::thread::spawn(move || {
                while other.begin_turn(1) {
                    let is_due = seen.try_lock().is_ok_and(|due| due.load(Ordering::SeqCst));
                    if is_due {
                        other.call(0);
                    }
                    other.sleep(1, None);
                }
            });
            let (host, filled) = (Arc::clone(&signal), Arc::clone(&slot));
            let host = loom::thread::spawn(move || {
                filled.lock().unwrap().store(true, Ordering::SeqCst);
                host.notify();
            });
            while signal.begin_turn(0) {
                if slot.try_lock().is_ok_and(|due| due.swap(false, Ordering::SeqCst)) {
                    signal.stop();
                } else {
                    signal.sleep(0, None);
                }
            }
            host.join().unwrap();
            other.join().unwrap();
        });
    }
}
