//! What threads share: the standard atomics, or loom's, which tries every interleaving.

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

/// A thread that waits for a word to change.
#[cfg(not(loom))]
#[derive(Debug, Default)]
pub(crate) struct Parking;

#[cfg(not(loom))]
impl Parking {
    /// Sleeps while the word is `seen`; may wake for no reason.
    #[expect(clippy::unused_self, reason = "loom's version has a lock")]
    pub(crate) fn wait(&self, word: &AtomicU32, seen: u32) {
        wait(word, seen);
    }

    /// Wakes the thread that waits for the word.
    #[expect(clippy::unused_self, reason = "loom's version has a lock")]
    pub(crate) fn wake(&self, word: &AtomicU32) {
        wake_one(word);
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
    pub(crate) fn wait(&self, word: &AtomicU32, seen: u32) {
        let guard = self.lock.lock().unwrap();
        // As the system call does: it sleeps only where the word is still the same.
        if word.load(Ordering::SeqCst) == seen {
            drop(self.changed.wait(guard).unwrap());
        }
    }

    pub(crate) fn wake(&self, _: &AtomicU32) {
        drop(self.lock.lock().unwrap());
        self.changed.notify_one();
    }
}
