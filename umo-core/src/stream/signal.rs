//! Wakes the engine's thread when there may be work.

use crate::sync::{AtomicBool, AtomicU32, Ordering, Parking, fence};

/// Counts notifications; one thread sleeps until the next one, or until it is stopped.
#[derive(Debug, Default)]
pub(crate) struct Signal {
    count: AtomicU32,
    stopped: AtomicBool,
    asleep: AtomicBool,
    parking: Parking,
}

impl Signal {
    /// There may be work. Wait-free; makes a system call only if the thread sleeps.
    pub(crate) fn notify(&self) {
        self.count.fetch_add(1, Ordering::SeqCst);
        // Pairs with the fence of `sleep`: either this side sees that the thread sleeps, or the
        // thread sees the new count.
        fence(Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) {
            self.parking.wake(&self.count);
        }
    }

    /// Sleeps until the count differs from `seen`.
    pub(crate) fn sleep(&self, seen: u32) {
        self.asleep.store(true, Ordering::SeqCst);
        fence(Ordering::SeqCst);
        while self.count.load(Ordering::SeqCst) == seen {
            self.parking.wait(&self.count, seen);
        }
        self.asleep.store(false, Ordering::SeqCst);
    }

    /// Ends the thread's loop, from its next turn on. Wakes it.
    pub(crate) fn stop(&self) {
        self.stopped.store(true, Ordering::SeqCst);
        self.notify();
    }

    /// The start of a turn: the count, to sleep on if the turn finds no work; none once stopped.
    pub(crate) fn begin_turn(&self) -> Option<u32> {
        // The count first: a stop after the load of `stopped` then still changes the count, and
        // `sleep` returns.
        let seen = self.count.load(Ordering::SeqCst);
        (!self.stopped.load(Ordering::SeqCst)).then_some(seen)
    }
}

#[cfg(all(test, loom))]
mod interleavings {
    use super::*;
    use loom::sync::Arc;

    /// A missed stop is a deadlock, which loom reports.
    #[test]
    fn stop_ends_the_loop_at_any_point_of_a_turn() {
        loom::model(|| {
            let signal = Arc::new(Signal::default());
            let host = Arc::clone(&signal);
            let thread = loom::thread::spawn(move || {
                host.notify();
                host.stop();
            });
            while let Some(seen) = signal.begin_turn() {
                signal.sleep(seen);
            }
            thread.join().unwrap();
        });
    }
}
