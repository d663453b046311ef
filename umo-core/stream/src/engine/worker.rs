//! A worker: selects the next sessions and computes their batch layer by layer.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use umo_core_base::defect::contain;
use umo_core_base::memory::with_capacity;
use umo_core_base::team::{CoreGroup, ExternalWorkers, Placement, Team};
use umo_core_base::time::Instant;
use umo_core_model::avatar::{Avatar, Due, StageTimes};
use umo_core_model::batch::Batch;
use umo_core_model::linear::Compute;

use super::economy::{LIMIT, Took};
use super::load::LEAD;
use super::{EngineConfig, Inner, Threads};
use crate::session::{Failure, Member, Members, PacketWriter, Schedule};

/// A batch, and the sessions in it.
#[derive(Debug)]
pub(super) struct Worker {
    /// Index among the engine's workers.
    index: usize,
    team: Arc<Team>,
    batch: Batch,
    /// The members of the batch, in its order: avatars, schedules, slots.
    avatars: Vec<Avatar>,
    schedules: Vec<Schedule>,
    slots: Vec<usize>,
    /// Deadline and slot of every due session.
    candidates: Vec<(u64, usize)>,
    /// Kind of chunk of each member.
    due: Vec<Due>,
    packets: PacketWriter,
    /// Batching window: the longest that due chunks wait for others, nanoseconds.
    batch_window: u64,
    /// Remaining batching delay of the sessions that the last turn found due; `None` if they do not
    /// wait.
    waits: Option<Duration>,
    /// Time that the mouth network took for the last chunk.
    heard: Duration,
    /// Start of the batch.
    began: Instant,
    /// Whether the slow core's worker has left that core to end its chunk.
    escaped: bool,
    /// Stage times of the batch that were already added to the engine's.
    told: StageTimes,
}

impl Worker {
    /// Creates worker `index` of the engine. The [`LEAD`] has the engine's threads as its team.
    /// Each other worker is one thread, on the core of the team thread with the same number; one of
    /// the two sleeps while the other computes. The one after the engine's workers has the slow
    /// core.
    pub(crate) fn new(inner: &Inner, config: &EngineConfig, index: usize) -> std::io::Result<Self> {
        let (plan, is_slow) = (&inner.plan, inner.load.is_slow(index));
        let threads = plan.threads;
        let width = if is_slow { 1 } else { config.max_batch.min(config.max_sessions) };
        let kind = if is_slow { plan.slow.as_ref() } else { plan.team.as_ref() };
        // The host's thread polls.
        let (own, others) = match (config.threads, &*config.cores) {
            (Threads::Own(_), [own, others @ ..]) => (Some(*own), others),
            (_, cores) => (None, cores),
        };
        let team = match (&config.jobs, config.threads) {
            (Some(_), Threads::Host(_)) => Team::with_external_workers(threads),
            _ if index != LEAD => {
                Team::placed(1, Placement { caller: config.cores.get(index).copied(), kind, ..Placement::default() })?
            }
            _ => Team::placed(threads, Placement { caller: own, cores: others, kind, priority: config.priority })?,
        };
        // Set after the team's threads have started, because they would inherit it.
        let is_set = matches!(config.threads, Threads::Host(_)) || config.priority.set();
        if !is_set || !team.has_priority() {
            inner.refused.store(true, Ordering::Relaxed);
        }
        let mut batch = Batch::new(inner.model(), width);
        if matches!(config.threads, Threads::Host(_)) {
            batch.bound(inner.model().config());
        }
        Ok(Self {
            index,
            team: Arc::new(team),
            batch,
            avatars: with_capacity(width),
            schedules: with_capacity(width),
            slots: with_capacity(width),
            candidates: with_capacity(config.max_sessions),
            due: with_capacity(width),
            packets: PacketWriter::new(inner.model()),
            batch_window: u64::try_from(config.batch_window.as_nanos()).unwrap_or(u64::MAX),
            waits: None,
            heard: Duration::ZERO,
            began: Instant::now(),
            escaped: false,
            told: StageTimes::default(),
        })
    }

    /// Index among the engine's workers.
    pub(super) fn index(&self) -> usize {
        self.index
    }

    /// Remaining batching delay of the chunks that the last turn found due.
    pub(super) fn waits(&self) -> Option<Duration> {
        self.waits
    }

    /// The threads that compute.
    pub(super) fn team(&self) -> Arc<Team> {
        Arc::clone(&self.team)
    }

    /// Expected duration of the next turn.
    pub(super) fn expected(&self) -> Duration {
        if self.is_mouth_next() { self.heard } else { self.batch.expected() }
    }

    /// Name of the next turn's step.
    pub(super) fn next_step(&self) -> &'static str {
        if self.is_mouth_next() { "mouth" } else { self.batch.next_step() }
    }

    /// Entry point of the threads that the host lends.
    pub(super) fn external_workers(&self) -> ExternalWorkers {
        self.team.external_workers()
    }

    /// Computes one layer or starts the next batch; returns whether there was work. Never
    /// allocates.
    pub(super) fn turn(&mut self, inner: &Inner) -> bool {
        if !self.batch.is_busy() {
            return self.begin(inner);
        }
        if inner.load.is_slow(self.index) {
            self.escape(inner);
        }
        if let Some(member) = self.schedules.iter().position(Schedule::awaits_mouth) {
            self.hear_mouth(member);
            return true;
        }
        let Self { team, batch, avatars, schedules, .. } = self;
        batch.set_alone(inner.load.is_shared());
        let cx = Compute { isa: inner.model().isa(), team };
        let result = contain(|| {
            #[cfg(test)]
            super::plant::meet(batch, schedules)?;
            batch.step(inner.model(), cx, avatars, &mut Members(schedules))
        });
        let failure = match result {
            Ok(Ok(_)) => None,
            Ok(Err(error)) => Some(Failure::Step(error)),
            Err(defect) => Some(Failure::Defect(defect)),
        };
        if let Some(failure) = failure
            && let Some(member) = self.batch.exclude()
        {
            self.schedules[member].fail(failure);
        }
        if !self.batch.is_busy() {
            self.end(inner);
        }
        true
    }

    /// Ends the chunks of the completed batch, except for failed members.
    fn end(&mut self, inner: &Inner) {
        let now = inner.clock.nanos();
        let members = self.schedules.iter_mut().zip(&self.avatars).zip(&self.due);
        for ((schedule, avatar), &due) in members.filter(|((schedule, _), _)| schedule.is_running()) {
            schedule.write_packet(&mut self.packets, avatar, inner.model(), due);
            schedule.end(now);
        }
        // If another thread reads the times now, they are added after the next batch.
        if let Ok(mut times) = inner.times.try_lock() {
            let now = self.batch.stage_times();
            times.add(now.since(std::mem::replace(&mut self.told, now)));
        }
        self.learn(inner, now);
        self.put_back(inner);
    }

    /// Leaves the slow core if the chunk has taken too long there, to end it on the team's cores: another program may have
    /// nearly all of the slow one.
    fn escape(&mut self, inner: &Inner) {
        let Some(period) = self.schedules.first().map(Schedule::period).filter(|_| !self.escaped) else { return };
        if self.began.elapsed() > period.mul_f32(LIMIT) {
            self.escaped = inner.plan.team.as_ref().is_some_and(CoreGroup::keep);
        }
    }

    /// Learns from the time of the completed batch whether a slow core has time for single chunks.
    fn learn(&self, inner: &Inner, now: u64) {
        let (Some(economy), Some(first)) = (inner.load.economy(), self.schedules.first()) else { return };
        let is_slow = inner.load.is_slow(self.index);
        let (chunks, time) = (self.schedules.len(), self.began.elapsed());
        if is_slow {
            inner.slow_chunks.fetch_add(chunks as u64, Ordering::Relaxed);
        }
        economy.learn(Took { is_slow, chunks, time, period: first.period() }, now);
    }

    /// Feeds one member's chunk to the mouth network. This is a separate step, so that a poll keeps
    /// its budget however many bodies are held.
    fn hear_mouth(&mut self, member: usize) {
        let start = Instant::now();
        let (schedule, avatar) = (&mut self.schedules[member], &mut self.avatars[member]);
        let failure = match contain(|| schedule.hear_mouth(avatar)) {
            Ok(Ok(())) => None,
            Ok(Err(error)) => Some(Failure::Step(error)),
            Err(defect) => Some(Failure::Defect(defect)),
        };
        if let Some(failure) = failure {
            schedule.fail(failure);
            self.batch.remove(member);
        }
        self.heard = start.elapsed();
    }

    /// Whether the next turn runs the mouth network.
    fn is_mouth_next(&self) -> bool {
        self.schedules.iter().any(Schedule::awaits_mouth)
    }

    /// Puts this worker's part of the due sessions, those with the earliest deadlines, into a
    /// batch.
    fn begin(&mut self, inner: &Inner) -> bool {
        let (now, model) = (inner.clock.nanos(), inner.model());
        self.candidates.clear();
        self.waits = None;
        let (candidates, mut latest) = (&mut self.candidates, (i64::MIN, 0));
        let (window, mut sessions, mut wait) = (self.batch_window, 0, u64::MAX);
        let mut begins = false;
        inner.slots.for_each_unlocked(|slot, member| {
            sessions += 1;
            if let Some((due, deadline)) = member.due(model, now) {
                candidates.push((deadline, slot));
                begins |= member.avatar.chunk == 0;
                latest = latest.max(member.schedule.late());
                if window > 0 {
                    wait = wait.min(member.wait((due, deadline), window, now));
                }
            }
        });
        let part = inner.load.part(self.index, self.candidates.len(), begins).min(self.batch.width());
        if part == 0 && !self.candidates.is_empty() {
            // It may have looked while this worker held one of their slots.
            inner.signal().call(inner.load.keeper(self.candidates.len(), begins));
            return false;
        }
        let has_room = (1..sessions.min(self.batch.width())).contains(&self.candidates.len());
        if window > 0 && has_room && wait > 0 {
            self.waits = Some(Duration::from_nanos(wait));
            return false;
        }
        self.candidates.sort_unstable();
        let share = inner.full_share.full_share(now, latest);
        let mut left = self.candidates.len();
        for &(_, slot) in &self.candidates {
            if self.avatars.len() == part {
                break;
            }
            left -= 1;
            // It may have been interrupted or dropped in the meantime, or taken by another worker.
            let mut due = None;
            let is_due = |member: &mut Member| {
                due = member.due(model, now).and_then(|(due, _)| member.prepare(due, share, slot, model));
                due.is_some()
            };
            let Some(mut member) = inner.slots.take_if(slot, is_due) else { continue };
            let Some(due) = due else { continue };
            member.begin(due, share < 1.0, model.config());
            self.avatars.push(member.avatar);
            self.schedules.push(member.schedule);
            self.slots.push(slot);
            self.due.push(due);
        }
        if self.avatars.is_empty() {
            return false;
        }
        self.began = Instant::now();
        inner.load.begin(self.index, self.avatars.len());
        if left > 0 && inner.load.workers() > 1 {
            inner.signal().notify();
        }
        self.batch.begin(self.due.iter().copied()).expect("no batch is under way, and there are no more than fit");
        true
    }

    /// Ends the batch, finished or not, and returns its members to their slots.
    pub(super) fn put_back(&mut self, inner: &Inner) {
        self.batch.abandon();
        if std::mem::take(&mut self.escaped) {
            let _ = inner.plan.slow.as_ref().map(CoreGroup::keep);
        }
        if !self.avatars.is_empty() {
            inner.load.end(self.index, self.avatars.len());
            inner.signal().set_first(inner.load.first());
        }
        let members = self.avatars.drain(..).zip(self.schedules.drain(..));
        for ((avatar, schedule), slot) in members.zip(self.slots.drain(..)) {
            inner.slots.put_back(slot, Member { avatar, schedule });
        }
        self.due.clear();
    }
}
