//! Values that the host changes and another side takes over.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, TryLockError};

/// A value that the host changes and another side takes over when it has changed. Both hold the
/// lock only while they copy, and the other side never waits for it.
#[derive(Debug)]
pub(crate) struct Handover<T> {
    pub(crate) value: Mutex<T>,
    /// Whether the other side has not seen the newest value.
    pub(crate) is_unseen: AtomicBool,
}

impl<T> Handover<T> {
    pub(crate) fn new(value: T, is_unseen: bool) -> Self {
        Self { value: Mutex::new(value), is_unseen: AtomicBool::new(is_unseen) }
    }

    /// Marks the value as changed.
    pub(crate) fn changed(&self) {
        self.is_unseen.store(true, Ordering::Release);
    }

    /// Calls `take` with the value if it has changed. If the host is writing it now, the next call
    /// takes it.
    pub(crate) fn take(&self, take: impl FnOnce(&T)) {
        if self.is_unseen.load(Ordering::Acquire)
            && let Some(value) = try_lock(&self.value)
        {
            self.is_unseen.store(false, Ordering::Relaxed);
            take(&value);
        }
    }
}

/// Takes the lock if it is free. A side that panicked left its data consistent, so poisoning is
/// ignored.
pub(crate) fn try_lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    match mutex.try_lock() {
        Ok(guard) => Some(guard),
        Err(TryLockError::Poisoned(poisoned)) => Some(poisoned.into_inner()),
        Err(TryLockError::WouldBlock) => None,
    }
}
