//! Synchronization primitives: the standard atomics, or loom's, which explores every interleaving.

#[cfg(not(loom))]
use std::sync::OnceLock;
#[cfg(not(loom))]
use std::thread::{self, Thread};
#[cfg(not(loom))]
use std::time::Duration;

#[cfg(loom)]
pub use loom::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};
#[cfg(not(loom))]
pub use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering, fence};

#[cfg(all(feature = "threads", not(target_family = "wasm")))]
pub use atomic_wait::{wait, wake_all, wake_one};

/// Waits while the word is `seen`, for threads that a host lends, which are awake. A WebAssembly module here has one
/// thread: nobody else could change the word.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
#[expect(clippy::assertions_on_constants, reason = "of each target")]
pub fn wait(word: &std::sync::atomic::AtomicU32, seen: u32) {
    assert!(!cfg!(target_family = "wasm"), "the only thread waits for another");
    while word.load(std::sync::atomic::Ordering::Acquire) == seen {
        std::hint::spin_loop();
    }
}

/// Wakes one waiting thread: a no-op, since none sleeps.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
pub fn wake_one(_word: *const std::sync::atomic::AtomicU32) {}

/// Wakes all waiting threads: a no-op, since none sleeps.
#[cfg(any(not(feature = "threads"), target_family = "wasm"))]
pub fn wake_all(_word: *const std::sync::atomic::AtomicU32) {}

/// Lets one thread wait for a word to change. [`Self::wake`] takes no lock on supported systems: the standard library
/// parks threads with futexes, or with a semaphore on Apple systems.
#[cfg(not(loom))]
#[derive(Debug, Default)]
pub struct Parking(OnceLock<Thread>);

#[cfg(not(loom))]
impl Parking {
    /// Registers the calling thread as the one that waits. Must precede the change of the word that announces it.
    pub fn enter(&self) {
        self.0.get_or_init(thread::current);
    }

    /// Sleeps while the word is `seen`; may wake spuriously.
    pub fn wait(&self, word: &AtomicU32, seen: u32) {
        if word.load(Ordering::SeqCst) == seen {
            thread::park();
        }
    }

    /// Like [`Self::wait`], for at most `longest`.
    pub fn wait_for(&self, word: &AtomicU32, seen: u32, longest: Duration) {
        if word.load(Ordering::SeqCst) == seen {
            thread::park_timeout(longest);
        }
    }

    /// Wakes the thread that waits for the word.
    pub fn wake(&self, _: &AtomicU32) {
        if let Some(thread) = self.0.get() {
            thread.unpark();
        }
    }
}

/// [`Parking`] with loom's primitives: loom reports a lost wake-up as a deadlock.
#[cfg(loom)]
#[derive(Debug, Default)]
pub struct Parking {
    lock: loom::sync::Mutex<()>,
    changed: loom::sync::Condvar,
}

#[cfg(loom)]
impl Parking {
    /// Does nothing: the lock and the condition belong to all threads.
    pub fn enter(&self) {}

    /// Sleeps while the word is `seen`.
    pub fn wait(&self, word: &AtomicU32, seen: u32) {
        let guard = self.lock.lock().unwrap();
        // Like a futex: sleeps only if the word still has the value.
        if word.load(Ordering::SeqCst) == seen {
            drop(self.changed.wait(guard).unwrap());
        }
    }

    /// Without the timeout, which correctness must not depend on.
    pub fn wait_for(&self, word: &AtomicU32, seen: u32, _: std::time::Duration) {
        self.wait(word, seen);
    }

    /// Wakes the thread that waits for the word.
    pub fn wake(&self, _: &AtomicU32) {
        drop(self.lock.lock().unwrap());
        self.changed.notify_one();
    }
}
