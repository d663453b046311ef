//! The session slots of an engine. Workers look for due sessions in them; the host frees them.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, TryLockError};

use umo_core_base::memory::with_capacity;
use umo_core_model::model::Model;

use super::schedule::Member;
use super::shared::try_lock;
use crate::link::Signal;

/// A slot for one session.
#[derive(Debug, Default)]
struct Slot {
    /// Whether a session owns the slot. Only the host's threads free it: a worker never frees
    /// memory.
    taken: AtomicBool,
    /// The engine's side of the session; `None` while it is in a batch.
    member: Mutex<Option<Member>>,
}

impl Slot {
    fn sweep(&self) {
        if !self.taken.load(Ordering::Acquire) {
            return;
        }
        let member = match self.member.try_lock() {
            Ok(mut member) => member.take_if(|member| member.is_dropped()),
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner().take_if(|member| member.is_dropped()),
            Err(TryLockError::WouldBlock) => None,
        };
        if member.is_some() {
            drop(member);
            self.taken.store(false, Ordering::Release);
        }
    }
}

/// The slots of one engine, and the model of their sessions.
#[derive(Debug)]
pub(crate) struct Slots {
    slots: Box<[Slot]>,
    pub(crate) model: Arc<Model>,
    pub(crate) signal: Arc<Signal>,
}

impl Slots {
    /// Creates `count` free slots, searched by `workers` workers.
    pub(crate) fn new(model: Arc<Model>, count: usize, workers: usize) -> Self {
        let mut slots = with_capacity(count);
        slots.resize_with(count, Slot::default);
        Self { slots: slots.into(), model, signal: Arc::new(Signal::new(workers)) }
    }

    pub(crate) fn len(&self) -> usize {
        self.slots.len()
    }

    /// Puts a member into a free slot and wakes a worker; `None` if all are taken.
    pub(crate) fn insert(self: &Arc<Self>, member: Member) -> Option<SlotHandle> {
        let free = |slot: &Slot| slot.taken.compare_exchange(false, true, Ordering::AcqRel, Ordering::Relaxed).is_ok();
        let index = self.slots.iter().position(free)?;
        *self.slots[index].member.lock().unwrap_or_else(PoisonError::into_inner) = Some(member);
        self.signal.notify();
        Some(SlotHandle { slots: Arc::clone(self), index })
    }

    /// Frees the slots of dropped sessions that are not in a batch.
    pub(crate) fn sweep(&self) {
        self.slots.iter().for_each(Slot::sweep);
        // Workers skip locked slots: they must check again.
        self.signal.notify();
    }

    /// Calls `f` for every member in an unlocked slot.
    pub(crate) fn for_each_unlocked(&self, mut f: impl FnMut(usize, &mut Member)) {
        for (index, slot) in self.slots.iter().enumerate() {
            // A slot that the host is filling or freeing is checked in the next turn: the host
            // notifies. A member that another worker holds is computed by that worker, or passed on
            // by it.
            if let Ok(mut slot) = slot.member.try_lock()
                && let Some(member) = &mut *slot
            {
                f(index, member);
            }
        }
    }

    /// Takes a member out of its slot if `f` returns true for it; `None` if the slot is locked or
    /// empty.
    pub(crate) fn take_if(&self, index: usize, f: impl FnOnce(&mut Member) -> bool) -> Option<Member> {
        self.slots[index].member.try_lock().ok()?.take_if(f)
    }

    /// Puts a member back. The host locks an empty slot only for the time of a comparison.
    pub(crate) fn put_back(&self, index: usize, member: Member) {
        let mut slot = loop {
            match self.slots[index].member.try_lock() {
                Ok(slot) => break slot,
                Err(TryLockError::Poisoned(poisoned)) => break poisoned.into_inner(),
                Err(TryLockError::WouldBlock) => std::hint::spin_loop(),
            }
        };
        *slot = Some(member);
    }

    /// Calls `f` for every slot's member, waiting for locks.
    pub(crate) fn for_each(&self, mut f: impl FnMut(&mut Option<Member>)) {
        for slot in &self.slots {
            f(&mut slot.member.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }
}

/// Attempts to take a lock between two yields, and number of yields.
const SPINS: u32 = 200;
const YIELDS: u32 = 200;

/// Takes a lock that others hold for some microseconds; `None` if its holder makes no progress.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> Option<MutexGuard<'_, T>> {
    for _ in 0..YIELDS {
        for _ in 0..SPINS {
            if let Some(guard) = try_lock(mutex) {
                return Some(guard);
            }
            std::hint::spin_loop();
        }
        std::thread::yield_now();
    }
    None
}

/// A session's slot in its engine.
#[derive(Debug)]
pub(crate) struct SlotHandle {
    slots: Arc<Slots>,
    index: usize,
}

impl SlotHandle {
    /// Frees the slot of a dropped session that is not in a batch.
    pub(super) fn sweep(&self) {
        self.slots.slots[self.index].sweep();
        self.slots.signal.notify();
    }

    /// Calls `f` with the engine's side of the session and its model; `None` if it is in a batch.
    /// The caller then notifies the engine, which may have skipped the slot.
    pub(crate) fn with_member<R>(&self, f: impl FnOnce(&mut Member, &Model) -> R) -> Option<R> {
        // A worker holds it only while it checks whether something is due.
        let mut member = lock(&self.slots.slots[self.index].member)?;
        member.as_mut().map(|member| f(member, &self.slots.model))
    }

    /// The model.
    pub(super) fn model(&self) -> &Model {
        &self.slots.model
    }
}
