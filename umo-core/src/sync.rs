//! What threads share: the standard atomics, or loom's, which tries every interleaving.

#[cfg(not(loom))]
use std::sync::OnceLock;
#[cfg(not(loom))]
use std::thread::{self, Thread};
#[cfg(not(loom))]
use std::time::Duration;

#[cfg(loom)]
pub(crate) use loom::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};
#[cfg(not(loom))]
pub(crate) use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};

#[cfg(all(feature = "threads", not(target_family = "wasm")))]
pub(crate) use atomic_wait::{wait, wake_all, wake_one};

/// Waits while the word is `seen`, for the threads that a host lends: they are at work, and awake. A
/// module of WebAssembly has one thread here: nobody else would change it.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
#[expect(clippy::assertions_on_constants, reason = "of each target")]
pub(crate) fn wait(word: &std::sync::atomic::AtomicU32, seen: u32) {
    assert!(!cfg!(target_family = "wasm"), "the only thread waits for another");
    while word.load(std::sync::atomic::Ordering::Acquire) == seen {
        std::hint::spin_loop();
    }
}

/// Wakes a thread that waits for the word: none sleeps.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
pub(crate) fn wake_one(_word: *const std::sync::atomic::AtomicU32) {}

/// Wakes all threads that wait for the word: none sleeps.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
pub(crate) fn wake_all(_word: *const std::sync::atomic::AtomicU32) {}

/// Where one thread waits for a word to change. [`Self::wake`] takes no lock on the systems that umo is built for: the standard
/// library parks threads by futexes, and by a semaphore on Apple's.
#[cfg(not(loom))]
#[derive(Debug, Default)]
pub(crate) struct Parking(OnceLock<Thread>);

#[cfg(not(loom))]
impl Parking {
    /// Says that the calling thread is the one that waits. Called before the word says so.
    pub(crate) fn enter(&self) {
        self.0.get_or_init(thread::current);
    }

    /// Sleeps while the word is `seen`; may wake for no reason.
    pub(crate) fn wait(&self, word: &AtomicU32, seen: u32) {
        if word.load(Ordering::SeqCst) == seen {
            thread::park();
        }
    }

    /// The same, for `longest` at most.
    pub(crate) fn wait_for(&self, word: &AtomicU32, seen: u32, longest: Duration) {
        if word.load(Ordering::SeqCst) == seen {
            thread::park_timeout(longest);
        }
    }

    /// Wakes the thread that waits for the word.
    pub(crate) fn wake(&self, _: &AtomicU32) {
        if let Some(thread) = self.0.get() {
            thread.unpark();
        }
    }
}

/// The same with what loom knows: a wake-up that never comes is a deadlock, which it reports.
#[cfg(loom)]
#[derive(Debug, Default)]
pub(crate) struct Parking {
    lock: loom::sync::Mutex<()>,
    changed: loom::sync::Condvar,
}

#[cfg(loom)]
impl Parking {
    pub(crate) fn enter(&self) {}

    pub(crate) fn wait(&self, word: &AtomicU32, seen: u32) {
        let guard = self.lock.lock().unwrap();
        // As the system call does: it sleeps only where the word is still the same.
        if word.load(Ordering::SeqCst) == seen {
            drop(self.changed.wait(guard).unwrap());
        }
    }

    /// Without the limit, which a wake-up must not need.
    pub(crate) fn wait_for(&self, word: &AtomicU32, seen: u32, _: std::time::Duration) {
        self.wait(word, seen);
    }

    pub(crate) fn wake(&self, _: &AtomicU32) {
        drop(self.lock.lock().unwrap());
        self.changed.notify_one();
    }
}
