//! Handles, which the host holds instead of pointers. A handle is a slot of a table and the slot's
//! generation: freed handles, handles of another kind and invalid values are detected, and no object is
//! freed while a thread uses it.

use std::ops::Deref;
use std::ptr::NonNull;
use std::sync::Mutex;
use std::sync::atomic::{AtomicPtr, AtomicU64, Ordering};

use umo_core_base::memory::{self, Arena, Boxed};

use crate::status::{Failure, UMO_STATUS_BUSY, UMO_STATUS_FULL, UMO_STATUS_INVALID_HANDLE};

/// Bits of a slot's state that count the threads using it.
const USERS: u32 = 22;
const USER: u64 = 1;
const LIVE: u64 = 1 << USERS;
/// The object is being freed, and no new call gets it.
const CLOSING: u64 = LIVE << 1;
/// Increment of the slot's generation.
const GENERATION: u64 = CLOSING << 1;
const USERS_MASK: u64 = LIVE - 1;

/// Width in bits of a handle's kind and slot index; the remaining bits are the generation.
const KIND_BITS: u32 = 4;
const INDEX_BITS: u32 = 16;

/// Maximum number of sessions at once, across all engines.
pub(crate) const MAX_SESSIONS: usize = 16_384;

/// Number of times that a free checks whether the calls in progress have returned: first it spins, then
/// it yields.
const CHECKS: usize = 1000;
const SPINS: usize = 100;

/// A slot for one object.
pub(crate) struct Slot<T> {
    /// Generation, whether it is being freed, whether it is in use, and number of threads using it.
    state: AtomicU64,
    object: AtomicPtr<T>,
}

impl<T> Slot<T> {
    pub(crate) const fn new() -> Self {
        Self { state: AtomicU64::new(0), object: AtomicPtr::new(std::ptr::null_mut()) }
    }
}

/// Table of all objects of one kind.
pub(crate) struct Table<T: 'static, const N: usize> {
    slots: [Slot<T>; N],
    /// Number of the kind in its handles, `1..16`.
    kind: usize,
    /// Name of the kind in errors.
    name: &'static str,
    /// Slot to try first.
    next: Mutex<usize>,
}

/// Moves `object` to memory of the system's, for [`Table::insert`].
pub(crate) fn boxed<T>(object: T) -> Result<Boxed<T>, Failure> {
    Ok(memory::catch(|| Arena::system().boxed(object))?)
}

/// Guard of an object that this thread uses, so that it is not freed.
pub(crate) struct Guard<'a, T> {
    slot: &'a Slot<T>,
    object: &'a T,
}

impl<T> Deref for Guard<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        self.object
    }
}

impl<T> Drop for Guard<'_, T> {
    fn drop(&mut self) {
        self.slot.state.fetch_sub(USER, Ordering::Release);
    }
}

impl<T: Send + Sync, const N: usize> Table<T, N> {
    pub(crate) const fn new(kind: usize, name: &'static str) -> Self {
        assert!(N <= 1 << INDEX_BITS && kind > 0 && kind < 1 << KIND_BITS);
        Self { slots: [const { Slot::new() }; N], kind, name, next: Mutex::new(0) }
    }

    /// Stores an object and returns its handle.
    pub(crate) fn insert(&self, object: Boxed<T>) -> Result<usize, Failure> {
        let mut next = self.next.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let free = |&index: &usize| self.slots[index].state.load(Ordering::Acquire) & LIVE == 0;
        let index = (0..N).map(|i| (*next + i) % N).find(free);
        let Some(index) = index else {
            return Err(Failure::new(
                UMO_STATUS_FULL,
                format_args!("there are {N} {}s already: free one first", self.name),
            ));
        };
        *next = (index + 1) % N;
        let slot = &self.slots[index];
        slot.object.store(object.into_raw().as_ptr(), Ordering::Release);
        let state = slot.state.fetch_add(GENERATION | LIVE, Ordering::AcqRel) + (GENERATION | LIVE);
        Ok(self.handle(index, state))
    }

    fn handle(&self, index: usize, state: u64) -> usize {
        ((state / GENERATION) as usize) << (KIND_BITS + INDEX_BITS) | index << KIND_BITS | self.kind
    }

    fn invalid(&self) -> Failure {
        let what = format_args!("not a {} handle, or the {} was freed", self.name, self.name);
        Failure::new(UMO_STATUS_INVALID_HANDLE, what)
    }

    fn slot(&self, handle: usize) -> Option<(usize, &Slot<T>)> {
        let index = (handle >> KIND_BITS) & ((1 << INDEX_BITS) - 1);
        let slot = self.slots.get(index)?;
        (handle & ((1 << KIND_BITS) - 1) == self.kind).then_some((index, slot))
    }

    /// Returns the object of a handle, held until the guard is dropped. Wait-free.
    pub(crate) fn get(&self, handle: usize) -> Result<Guard<'_, T>, Failure> {
        let (index, slot) = self.slot(handle).ok_or_else(|| self.invalid())?;
        // Calls with a freed handle, or one that is being freed, do not touch the count: they would keep the free
        // waiting.
        if !self.is_open(index, slot.state.load(Ordering::Acquire), handle) {
            return Err(self.invalid());
        }
        // From here on the object, if it still exists, is not freed.
        let state = slot.state.fetch_add(USER, Ordering::Acquire);
        if !self.is_open(index, state, handle) {
            slot.state.fetch_sub(USER, Ordering::Release);
            return Err(self.invalid());
        }
        let object = slot.object.load(Ordering::Acquire);
        // SAFETY: the slot is live, so `insert` put a box's pointer there, and `remove` does not
        // take it out while we are counted among its users.
        Ok(Guard { slot, object: unsafe { &*object } })
    }

    /// Whether a slot in this state holds the handle's object and accepts calls.
    fn is_open(&self, index: usize, state: u64, handle: usize) -> bool {
        state & (LIVE | CLOSING) == LIVE && self.handle(index, state) == handle
    }

    /// Takes an object out. No call that starts later gets it. `BUSY` if an earlier call is still in progress
    /// after a millisecond or so: then `remove` again.
    pub(crate) fn remove(&self, handle: usize) -> Result<Boxed<T>, Failure> {
        let (index, slot) = self.slot(handle).ok_or_else(|| self.invalid())?;
        for look in 0..CHECKS {
            let state = slot.state.load(Ordering::Acquire);
            if state & LIVE == 0 || self.handle(index, state) != handle {
                return Err(self.invalid());
            }
            if state & CLOSING == 0 {
                // The slot may hold another object by now: the exchange fails if anything has changed.
                let marked = slot.state.compare_exchange(state, state | CLOSING, Ordering::AcqRel, Ordering::Relaxed);
                if marked.is_err() {
                    continue;
                }
            }
            let state = state | CLOSING;
            if state & USERS_MASK > 0 {
                if look < SPINS {
                    std::hint::spin_loop()
                } else {
                    umo_core_base::thread::yield_now()
                }
                continue;
            }
            let empty = state & !(LIVE | CLOSING);
            if slot.state.compare_exchange(state, empty, Ordering::AcqRel, Ordering::Relaxed).is_ok() {
                let object = slot.object.swap(std::ptr::null_mut(), Ordering::AcqRel);
                let object = NonNull::new(object).expect("a live slot has an object");
                // SAFETY: `insert` put a box's pointer there, and the exchange above made this the
                // only thread that takes it out, with no call in progress.
                return Ok(unsafe { Boxed::from_raw(object) });
            }
        }
        let what = format_args!(
            "another thread is in a call on this {}: free it again when that has returned; it takes no other calls",
            self.name
        );
        Err(Failure::new(UMO_STATUS_BUSY, what))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicUsize;

    static COUNTED: Table<Counted, 4> = Table::new(3, "thing");
    static ALIVE: AtomicUsize = AtomicUsize::new(0);

    struct Counted(usize);

    impl Counted {
        fn boxed(value: usize) -> Boxed<Self> {
            ALIVE.fetch_add(1, Ordering::Relaxed);
            Arena::system().boxed(Self(value))
        }
    }

    impl Drop for Counted {
        fn drop(&mut self) {
            ALIVE.fetch_sub(1, Ordering::Relaxed);
        }
    }

    #[test]
    fn handles_are_good_once_and_for_one_kind() {
        let first = COUNTED.insert(Counted::boxed(7)).ok().unwrap();
        assert_eq!(COUNTED.get(first).ok().unwrap().0, 7);
        let held = COUNTED.get(first).ok().unwrap();
        assert_eq!(COUNTED.remove(first).err().unwrap().status, UMO_STATUS_BUSY);
        assert_eq!(COUNTED.get(first).err().unwrap().status, UMO_STATUS_INVALID_HANDLE, "it is being freed");
        assert_eq!(held.0, 7);
        drop(held);
        drop(COUNTED.remove(first).ok().unwrap());
        for stale in [first, first ^ 1, 0, usize::MAX, first + (1 << KIND_BITS), 0x7fff_1234_5678] {
            assert_eq!(COUNTED.get(stale).err().unwrap().status, UMO_STATUS_INVALID_HANDLE, "{stale:x}");
            assert_eq!(COUNTED.remove(stale).err().unwrap().status, UMO_STATUS_INVALID_HANDLE, "{stale:x}");
        }
        // A reused slot has other handles.
        for round in 0..50 {
            let handle = COUNTED.insert(Counted::boxed(round)).ok().unwrap();
            assert_ne!(handle, first);
            assert!(COUNTED.get(first).is_err());
            drop(COUNTED.remove(handle).ok().unwrap());
        }
        let four: Vec<_> = (0..4).map(|i| COUNTED.insert(Counted::boxed(i)).ok().unwrap()).collect();
        assert_eq!(COUNTED.insert(Counted::boxed(9)).err().unwrap().status, UMO_STATUS_FULL);
        four.iter().for_each(|&handle| drop(COUNTED.remove(handle).ok().unwrap()));
        assert_eq!(ALIVE.load(Ordering::Relaxed), 0);
    }

    #[test]
    fn nothing_is_freed_under_a_thread_that_uses_it() {
        static SHARED: Table<Vec<usize>, 2> = Table::new(1, "thing");
        for round in 0..100 {
            let handle = SHARED.insert(Arena::system().boxed(vec![round; 64])).ok().unwrap();
            std::thread::scope(|scope| {
                for _ in 0..2 {
                    scope.spawn(move || {
                        while let Ok(held) = SHARED.get(handle) {
                            assert!(held.iter().all(|&v| v == round));
                        }
                    });
                }
                scope.spawn(move || while SHARED.remove(handle).is_err_and(|f| f.status == UMO_STATUS_BUSY) {});
            });
        }
    }

    /// Calls that always overlap: a free first marks the object, which keeps new calls out.
    #[test]
    fn callers_that_never_pause_do_not_keep_an_object() {
        use std::sync::atomic::AtomicBool;
        static HAMMERED: Table<Vec<usize>, 2> = Table::new(2, "thing");
        for _ in 0..20 {
            let handle = HAMMERED.insert(Arena::system().boxed(vec![1; 64])).ok().unwrap();
            let (calls, is_over) = (AtomicUsize::new(0), AtomicBool::new(false));
            std::thread::scope(|scope| {
                for _ in 0..3 {
                    scope.spawn(|| {
                        while !is_over.load(Ordering::Relaxed) {
                            // A call is always in progress or about to be: the next begins before the last has ended.
                            let first = HAMMERED.get(handle);
                            let second = HAMMERED.get(handle);
                            drop(first);
                            calls.fetch_add(usize::from(second.is_ok()), Ordering::Relaxed);
                        }
                    });
                }
                while calls.load(Ordering::Relaxed) < 1000 {
                    std::thread::yield_now();
                }
                // A caller that was preempted in the middle of its call may take a few attempts.
                let freed = (0..100).any(|_| HAMMERED.remove(handle).is_ok());
                is_over.store(true, Ordering::Relaxed);
                assert!(freed, "a hundred times busy");
            });
        }
    }
}
