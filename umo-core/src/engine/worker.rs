//! What computes: which sessions come next, and one layer of their batch after the other.

use std::sync::Arc;

use super::core::Core;
use super::{EngineConfig, Inner, Threads};
use crate::avatar::Due;
use crate::batch::Batch;
use crate::defect::contain;
use crate::linear::Compute;
use crate::memory::with_capacity;
use crate::session::Failure;
use crate::team::{Guests, Team};

/// A batch, and the sessions in it.
#[derive(Debug)]
pub(super) struct Worker {
    team: Arc<Team>,
    batch: Batch,
    members: Vec<Core>,
    /// Places of the members.
    places: Vec<usize>,
    /// Deadline and place of every session that is due.
    candidates: Vec<(u64, usize)>,
    /// What is due of each member.
    due: Vec<Due>,
}

impl Worker {
    pub(super) fn new(inner: &Inner, config: &EngineConfig, threads: usize) -> std::io::Result<Self> {
        let width = config.max_batch.min(config.max_sessions);
        // The thread that polls is the host's.
        let (own, others) = match (config.threads, &*config.cores) {
            (Threads::Own(_), [own, others @ ..]) => (Some(*own), others),
            (_, cores) => (None, cores),
        };
        let team = match (&config.lender, config.threads) {
            (Some(_), Threads::Host(_)) => Team::of_guests(threads),
            _ => Team::on_cores(threads, own, others)?,
        };
        Ok(Self {
            team: Arc::new(team),
            batch: Batch::new(&inner.model, width),
            members: with_capacity(width),
            places: with_capacity(width),
            candidates: with_capacity(config.max_sessions),
            due: with_capacity(width),
        })
    }

    /// The threads that compute.
    pub(super) fn team(&self) -> Arc<Team> {
        Arc::clone(&self.team)
    }

    /// Where the host lends its threads.
    pub(super) fn guests(&self) -> Guests {
        self.team.guests()
    }

    /// Computes one layer, or starts the next batch; whether there was anything to do. Never allocates.
    pub(super) fn turn(&mut self, inner: &Inner) -> bool {
        if !self.batch.is_busy() {
            return self.begin(inner);
        }
        let Self { team, batch, members, .. } = self;
        let cx = Compute { isa: inner.model.isa, team };
        let result = contain(|| batch.step(&inner.model, cx, members));
        let failure = match result {
            Ok(Ok(true)) => return true,
            Ok(Ok(false)) => {
                let now = inner.clock.nanos();
                self.members.iter_mut().for_each(|core| core.end(now));
                // Whoever reads them at this moment gets the last batch's.
                if let Ok(mut times) = inner.times.try_lock() {
                    *times = self.batch.stage_times();
                }
                self.put_back(inner);
                return true;
            }
            Ok(Err(error)) => Failure::Step(error),
            Err(defect) => Failure::Defect(defect),
        };
        match self.batch.exclude() {
            Some(member) => self.members[member].fail(failure),
            None => {
                self.members.iter().for_each(|core| core.fail(failure.clone()));
                self.put_back(inner);
            }
        }
        true
    }

    /// Puts the sessions with the earliest deadlines into a batch.
    fn begin(&mut self, inner: &Inner) -> bool {
        let now = inner.clock.nanos();
        self.candidates.clear();
        for (place, slot) in inner.slots.iter().enumerate() {
            // A place that the host is just filling or freeing is looked at next time: the host notifies.
            let Ok(mut slot) = slot.core.try_lock() else { continue };
            if let Some((_, deadline)) = slot.as_mut().and_then(|core| core.due(&inner.model, now)) {
                self.candidates.push((deadline, place));
            }
        }
        self.candidates.sort_unstable();
        for &(_, place) in self.candidates.iter().take(self.batch.width()) {
            let Ok(mut slot) = inner.slots[place].core.try_lock() else { continue };
            // It may have been interrupted or dropped in the meantime.
            let Some((due, _)) = slot.as_mut().and_then(|core| core.due(&inner.model, now)) else { continue };
            let Some(mut core) = slot.take() else { continue };
            core.begin();
            self.members.push(core);
            self.places.push(place);
            self.due.push(due);
        }
        if self.members.is_empty() {
            return false;
        }
        self.batch.begin(self.due.iter().copied()).expect("no batch is under way, and there are no more than fit");
        true
    }

    /// Gives the members back to their places, whatever the batch has come to.
    pub(super) fn put_back(&mut self, inner: &Inner) {
        self.batch.abandon();
        for (core, place) in self.members.drain(..).zip(self.places.drain(..)) {
            // The host holds the lock for no longer than it takes to see that the place is empty.
            let mut slot = loop {
                match inner.slots[place].core.try_lock() {
                    Ok(slot) => break slot,
                    Err(std::sync::TryLockError::Poisoned(poisoned)) => break poisoned.into_inner(),
                    Err(std::sync::TryLockError::WouldBlock) => std::hint::spin_loop(),
                }
            };
            *slot = Some(core);
        }
        self.due.clear();
    }
}
