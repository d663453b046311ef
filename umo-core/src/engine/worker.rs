//! A worker: selects the next sessions and computes their batch layer by layer.

use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use super::load::LEAD;
use super::{EngineConfig, Inner, Threads};
use crate::avatar::{Avatar, Due, StageTimes};
use crate::batch::Batch;
use crate::defect::contain;
use crate::linear::Compute;
use crate::memory::with_capacity;
use crate::session::{Failure, Member, PacketWriter, Schedule};
use crate::team::{ExternalWorkers, Placement, Team};
use crate::time::Instant;

/// A batch, and the sessions in it.
#[derive(Debug)]
pub(super) struct Worker {
    /// Which of the engine's workers it is.
    index: usize,
    team: Arc<Team>,
    batch: Batch,
    /// The members of the batch, in its order: their avatars, their schedules, their slots.
    avatars: Vec<Avatar>,
    schedules: Vec<Schedule>,
    slots: Vec<usize>,
    /// Deadline and slot of every session that is due.
    candidates: Vec<(u64, usize)>,
    /// What is due of each member.
    due: Vec<Due>,
    packets: PacketWriter,
    /// The longest that chunks which are due wait for others, nanoseconds.
    gather: u64,
    /// How long those that the last turn found wait from then on, if they do.
    gathers: Option<Duration>,
    /// How long the mouth network heard a chunk the last time.
    heard: Duration,
    /// The batch's times that the engine has been told of.
    told: StageTimes,
}

impl Worker {
    /// Worker `index` of the engine. The [`LEAD`] has the engine's threads as a team; each of the others is
    /// one thread, on the core of the team's thread of that number, which sleeps while the other computes.
    pub(super) fn new(inner: &Inner, config: &EngineConfig, index: usize) -> std::io::Result<Self> {
        let threads = config.threads.count();
        let width = config.max_batch.min(config.max_sessions);
        // The thread that polls is the host's.
        let (own, others) = match (config.threads, &*config.cores) {
            (Threads::Own(_), [own, others @ ..]) => (Some(*own), others),
            (_, cores) => (None, cores),
        };
        let team = match (&config.lender, config.threads) {
            (Some(_), Threads::Host(_)) => Team::with_external_workers(threads),
            _ if index != LEAD => {
                Team::placed(1, Placement { caller: config.cores.get(index).copied(), ..Placement::default() })?
            }
            _ => Team::placed(threads, Placement { caller: own, cores: others, priority: config.priority })?,
        };
        // After the team's threads, which would begin with it.
        let is_set = matches!(config.threads, Threads::Host(_)) || config.priority.set();
        if !is_set || !team.has_priority() {
            inner.refused.store(true, Ordering::Relaxed);
        }
        let mut batch = Batch::new(inner.model(), width);
        if matches!(config.threads, Threads::Host(_)) {
            batch.bound(&inner.model().config);
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
            gather: u64::try_from(config.gather.as_nanos()).unwrap_or(u64::MAX),
            gathers: None,
            heard: Duration::ZERO,
            told: StageTimes::default(),
        })
    }

    /// Which of the engine's workers it is.
    pub(super) fn index(&self) -> usize {
        self.index
    }

    /// How long the chunks that the last turn found due wait for others.
    pub(super) fn gathers(&self) -> Option<Duration> {
        self.gathers
    }

    /// The threads that compute.
    pub(super) fn team(&self) -> Arc<Team> {
        Arc::clone(&self.team)
    }

    /// How long the next turn will take, as far as that is known.
    pub(super) fn expected(&self) -> Duration {
        if self.is_mouth_next() { self.heard } else { self.batch.expected() }
    }

    /// What the next turn does.
    #[cfg(feature = "internals")]
    pub(super) fn next_step(&self) -> &'static str {
        if self.is_mouth_next() { "mouth" } else { self.batch.next_step() }
    }

    /// Where the host lends its threads.
    pub(super) fn external_workers(&self) -> ExternalWorkers {
        self.team.external_workers()
    }

    /// Computes one layer or starts the next batch; returns whether there was work. Never
    /// allocates.
    pub(super) fn turn(&mut self, inner: &Inner) -> bool {
        if !self.batch.is_busy() {
            return self.begin(inner);
        }
        if let Some(member) = self.schedules.iter().position(Schedule::awaits_mouth) {
            self.hear_mouth(member);
            return true;
        }
        let Self { team, batch, avatars, schedules, .. } = self;
        batch.set_alone(inner.load.is_shared());
        let cx = Compute { isa: inner.model().isa, team };
        let result = contain(|| batch.step(inner.model(), cx, avatars, &mut schedules[..]));
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

    /// Ends the chunks of the batch that is done, but of the members that failed.
    fn end(&mut self, inner: &Inner) {
        let now = inner.clock.nanos();
        let members = self.schedules.iter_mut().zip(&self.avatars).zip(&self.due);
        for ((schedule, avatar), &due) in members.filter(|((schedule, _), _)| schedule.is_running()) {
            schedule.write_packet(&mut self.packets, avatar, inner.model(), due);
            schedule.end(now);
        }
        // Whoever reads them at this moment gets the last batch's.
        if let Ok(mut times) = inner.times.try_lock() {
            let now = self.batch.stage_times();
            times.add(now.since(std::mem::replace(&mut self.told, now)));
        }
        self.put_back(inner);
    }

    /// Has the mouth network hear one member's chunk: a step of its own, so that a poll keeps its budget
    /// however many bodies are held.
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

    /// Whether the next turn has a mouth network hear something.
    fn is_mouth_next(&self) -> bool {
        self.schedules.iter().any(Schedule::awaits_mouth)
    }

    /// Puts the sessions with the earliest deadlines into a batch, as many as are this worker's part.
    fn begin(&mut self, inner: &Inner) -> bool {
        let (now, model) = (inner.clock.nanos(), inner.model());
        self.candidates.clear();
        self.gathers = None;
        let (candidates, mut latest) = (&mut self.candidates, (i64::MIN, 0));
        let (gather, mut sessions, mut patience) = (self.gather, 0, u64::MAX);
        inner.slots.for_each_unlocked(|slot, member| {
            sessions += 1;
            if let Some((due, deadline)) = member.due(model, now) {
                candidates.push((deadline, slot));
                latest = latest.max(member.schedule.late());
                if gather > 0 {
                    patience = patience.min(member.patience((due, deadline), gather, now));
                }
            }
        });
        let part = inner.load.part(self.index, self.candidates.len()).min(self.batch.width());
        if part == 0 && !self.candidates.is_empty() {
            // It may have looked while this worker had one of their slots.
            inner.signal().call(LEAD);
            return false;
        }
        let has_room = (1..sessions.min(self.batch.width())).contains(&self.candidates.len());
        if gather > 0 && has_room && patience > 0 {
            self.gathers = Some(Duration::from_nanos(patience));
            return false;
        }
        self.candidates.sort_unstable();
        let share = inner.pace.full_share(now, latest);
        let mut left = self.candidates.len();
        for &(_, slot) in &self.candidates {
            if self.avatars.len() == part {
                break;
            }
            left -= 1;
            // It may have been interrupted or dropped in the meantime, or another worker has it.
            let mut due = None;
            let is_due = |member: &mut Member| {
                due = member.due(model, now).and_then(|(due, _)| member.prepare(due, share, slot, model));
                due.is_some()
            };
            let Some(mut member) = inner.slots.take_if(slot, is_due) else { continue };
            let Some(due) = due else { continue };
            member.begin(due, share < 1.0, &model.config);
            self.avatars.push(member.avatar);
            self.schedules.push(member.schedule);
            self.slots.push(slot);
            self.due.push(due);
        }
        if self.avatars.is_empty() {
            return false;
        }
        inner.load.begin(self.avatars.len());
        if left > 0 && inner.load.workers() > 1 {
            inner.signal().notify();
        }
        self.batch.begin(self.due.iter().copied()).expect("no batch is under way, and there are no more than fit");
        true
    }

    /// Ends the batch, finished or not, and returns its members to their slots.
    pub(super) fn put_back(&mut self, inner: &Inner) {
        self.batch.abandon();
        if !self.avatars.is_empty() {
            inner.load.end(self.avatars.len());
        }
        let members = self.avatars.drain(..).zip(self.schedules.drain(..));
        for ((avatar, schedule), slot) in members.zip(self.slots.drain(..)) {
            inner.slots.put_back(slot, Member { avatar, schedule });
        }
        self.due.clear();
    }
}
