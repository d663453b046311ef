//! Workers, and how they choose the sessions to compute next (SPEC 2.9).
//!
//! An engine has one model, slots for sessions, and workers, each with a
//! [`Batch`](umo_core_model::batch::Batch). A worker searches all slots for chunks whose audio is complete,
//! takes those with the earliest deadlines into its batch, computes the batch layer by layer, and
//! searches again. The first worker, the lead, runs on a thread of the engine or in
//! [`Engine::poll`], and other threads help it with each layer. If many sessions are due, the
//! engine's other threads run workers of their own (`load`).
//!
//! Workers share only the slots. While a session is in a batch its slot is empty, so no other
//! worker computes it, and a worker that the system preempts delays only its own batch.

mod config;
mod economy;
mod error;
mod full_share;
mod load;
#[cfg(test)]
pub(crate) mod plant;
#[cfg(test)]
mod tests;
mod worker;

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, TryLockError};
use std::time::Duration;

use umo_core_base::clock::Clock;
use umo_core_base::defect::{Defect, contain_quietly};
use umo_core_base::error::LoadError;
use umo_core_base::memory::{self, Arena, Counted};
pub use umo_core_base::sync::{wait, wake_one};
use umo_core_base::team::{CoreGroup, ExternalWorkers, MAX_THREADS};
use umo_core_base::thread::{self, JoinHandle};
use umo_core_base::time::Instant;
use umo_core_model::audio::resample::{self, FilterPlan, Resampler};
use umo_core_model::avatar::{Avatar, StageTimes};
use umo_core_model::model::Model;
use umo_core_pose::frame::OwnedFrame;

use crate::levels::Levels;
use crate::link::Signal;
use crate::session::{Failure, Member, Session, SessionConfig, SessionInit, Shared, Slots, Voice, state_size};
use economy::Plan;
use full_share::FullShare;
use load::{LEAD, Load};
use worker::Worker;

pub use config::{CoreKinds, EngineConfig, MAX_BATCH, MAX_SESSIONS, SubmitJobs, Threads};
pub use error::{EngineError, PollError};
pub use umo_core_base::team::Priority;

/// Result of [`Engine::poll`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Poll {
    /// Nothing is due until more audio comes, frames are pulled, or waiting chunks reach their
    /// batching delay ([`EngineConfig::batch_window`]).
    Idle,
    /// The budget is used up; more may be due.
    More,
}

/// Number of the engine's threads that have created their workers or failed to.
#[derive(Debug, Default)]
struct Started {
    count: AtomicU32,
    error: Mutex<Option<EngineError>>,
}

impl Started {
    fn add(&self, made: Result<(), EngineError>) {
        *self.error.lock().unwrap_or_else(PoisonError::into_inner) = made.err();
        self.count.fetch_add(1, Ordering::Release);
        wake_one(&raw const self.count);
    }

    /// Waits for one more than `before`.
    fn wait(&self, before: u32) -> Result<(), EngineError> {
        while self.count.load(Ordering::Acquire) == before {
            wait(&self.count, before);
        }
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// State shared by the engine and its workers.
#[derive(Debug)]
struct Inner {
    slots: Arc<Slots>,
    /// Where the threads run.
    plan: Plan,
    load: Load,
    /// Chunks computed on a slow core.
    slow_chunks: AtomicU64,
    full_share: FullShare,
    started: Started,
    /// The panic that ended one of the engine's threads, and with it the engine.
    defect: OnceLock<Defect>,
    clock: Clock,
    /// The rest pose.
    rest: OwnedFrame,
    /// Time spent in each stage by all workers, as of the last completed batches.
    times: Mutex<StageTimes>,
    /// Resampling filters shared by the sessions whose rate differs from the model's, one per rate.
    filter_plans: Mutex<Vec<Arc<FilterPlan>>>,
    /// Whether a thread was refused its priority.
    refused: AtomicBool,
}

impl Inner {
    fn model(&self) -> &Model {
        &self.slots.model
    }

    fn signal(&self) -> &Signal {
        &self.slots.signal
    }

    /// Filter shared by the resamplers of a session rate; `None` for the model's own rate. Created
    /// at first use. An unused plan is dropped when another one is created.
    fn filter_plan(&self, sample_rate: usize) -> Result<Option<Arc<FilterPlan>>, EngineError> {
        let rates = (sample_rate, self.model().config().audio.sample_rate);
        let mut plans = self.filter_plans.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(plan) = plans.iter().find(|plan| plan.rates() == rates) {
            return Ok(Some(Arc::clone(plan)));
        }
        if rates.0 == rates.1 {
            return Ok(None);
        }
        plans.retain(|plan| Arc::strong_count(plan) > 1);
        let plan = memory::catch(|| resample::plan(rates.0, rates.1))?
            .map_err(|error| LoadError::argument("sample_rate", error.to_string()))?;
        plans.extend(plan.clone());
        Ok(plan)
    }

    /// Creates the state that session and worker share, and the worker's side. Allocates from
    /// `arena`, except for the filter plan of a rate's first session.
    fn make(&self, config: &SessionConfig, arena: &Arena) -> Result<(Counted<Shared>, Member), EngineError> {
        let model = self.model();
        config.check()?;
        let plan = self.filter_plan(config.sample_rate)?;
        let before = arena.used();
        let mut avatar = Avatar::new_in(model, &config.avatar, arena)?;
        // The live mouth is over the frames' own, which packets and takes have.
        if config.voice == Voice::Live && config.packets.is_none() && config.take_bytes == 0 {
            avatar.keep_codes_mouth();
        }
        let levels = Levels::new_in(&avatar, model.config(), arena);
        let init = SessionInit {
            model: &self.slots.model,
            assembly: model.assembly(),
            rest: &self.rest,
            chunk_frames: avatar.chunk_frames(model.config()),
            chunk_samples: avatar.most_samples(),
            // The chunk's samples are saved with their queue.
            kept: (arena.used() - before).saturating_sub(size_of::<f32>() * avatar.most_samples()),
            clock: self.clock.clone(),
            signal: Arc::clone(&self.slots.signal),
            resampler: Resampler::new_in(config.sample_rate, model.config().audio.sample_rate, plan, arena),
            is_decoder: false,
            take: None,
            patches: None,
            arena,
        };
        let shared = arena.counted(Shared::new(init, config)?);
        let member = Member::new_in(avatar, Counted::clone(&shared), &self.slots.model, config, levels, arena);
        Ok((shared, member))
    }

    /// Creates the state of a session of the mouth alone.
    fn make_mouth(&self, config: &SessionConfig, arena: &Arena) -> Result<Counted<Shared>, EngineError> {
        let model = self.model();
        config.check()?;
        config.avatar.check(model.config())?;
        let plan = self.filter_plan(config.sample_rate)?;
        let init = SessionInit {
            model: &self.slots.model,
            assembly: model.assembly(),
            rest: &self.rest,
            chunk_frames: 0,
            chunk_samples: 0,
            kept: 0,
            clock: self.clock.clone(),
            signal: Arc::clone(&self.slots.signal),
            resampler: Resampler::new_in(config.sample_rate, model.config().audio.sample_rate, plan, arena),
            is_decoder: false,
            take: None,
            patches: None,
            arena,
        };
        Ok(arena.counted(Shared::new(init, config)?))
    }

    /// Ends every session: no more frames are computed.
    fn fail(&self, defect: &Defect) {
        self.slots.for_each(|member| {
            if let Some(member) = member {
                member.schedule.fail(Failure::Defect(defect.clone()));
            }
        });
    }
}

thread_local! {
    /// Whether this polling thread is asking its host for threads.
    static ASKS: Cell<bool> = const { Cell::new(false) };
}

/// Sessions of one model, and the workers that compute them.
#[derive(Debug)]
pub struct Engine {
    inner: Arc<Inner>,
    /// The worker of a polled engine.
    worker: Option<Mutex<Worker>>,
    /// Entry point of the threads that the host lends, if it does.
    external_workers: Option<(ExternalWorkers, SubmitJobs)>,
    /// Threads of the workers.
    threads: Vec<JoinHandle<()>>,
    /// Requested priority of these threads.
    priority: Priority,
}

impl Engine {
    /// Creates an engine without sessions. Allocates everything that computing needs. With a model of the mouth alone
    /// ([`Model::load_mouth`]) it has no threads.
    ///
    /// # Errors
    /// [`EngineError`] if a number is out of range or a thread cannot be started.
    pub fn new(model: Arc<Model>, config: &EngineConfig) -> Result<Self, EngineError> {
        memory::catch(|| Self::start(model, config))?
    }

    fn start(model: Arc<Model>, config: &EngineConfig) -> Result<Self, EngineError> {
        let mut engine = Self::bare(model, config)?;
        if engine.model().is_mouth_alone() {
            // Its sessions compute on the host's threads.
            return Ok(engine);
        }
        if matches!(config.threads, Threads::Host(_)) {
            let worker = Worker::new(&engine.inner, config, LEAD).map_err(EngineError::thread)?;
            engine.external_workers = config.jobs.clone().map(|jobs| (worker.external_workers(), jobs));
            engine.worker = Some(Mutex::new(worker));
            return Ok(engine);
        }
        let workers = engine.inner.load.workers() + engine.inner.plan.more_workers();
        engine.threads = memory::with_capacity(workers);
        for index in 0..workers {
            // If one does not start, the engine is dropped with those that did.
            engine.threads.push(start_worker(&engine.inner, config, index)?);
            // The thread's heap may have used up the remaining memory.
            memory::require(memory::SPARE);
        }
        Ok(engine)
    }

    /// Creates an engine without workers.
    fn bare(model: Arc<Model>, config: &EngineConfig) -> Result<Self, EngineError> {
        let range = |name: &'static str, got: usize, to: usize| {
            if (1..=to).contains(&got) {
                return Ok(());
            }
            Err(LoadError::argument(name, format!("expected 1 to {to}, got {got}")))
        };
        range("max_sessions", config.max_sessions, MAX_SESSIONS)?;
        range("max_batch", config.max_batch, MAX_BATCH)?;
        range("threads", config.threads.count(), MAX_THREADS)?;
        let rest = model.rest().map_err(EngineError::Rest)?;
        let plan = Plan::new(config);
        let load = Load::new(config, &plan, model.config());
        let inner = Arc::new(Inner {
            slots: Arc::new(Slots::new(model, config.max_sessions, load.workers() + plan.more_workers())),
            plan,
            load,
            slow_chunks: AtomicU64::new(0),
            full_share: FullShare::default(),
            started: Started::default(),
            defect: OnceLock::new(),
            clock: config.clock.clone(),
            rest,
            times: Mutex::default(),
            filter_plans: Mutex::default(),
            refused: AtomicBool::new(false),
        });
        let priority = config.priority;
        Ok(Self { inner, worker: None, external_workers: None, threads: Vec::new(), priority })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        self.inner.model()
    }

    /// Priority of the engine's own threads: the configured one, or [`Priority::Normal`] if the
    /// system refused it to one of them.
    pub fn priority(&self) -> Priority {
        if self.inner.refused.load(Ordering::Relaxed) { Priority::Normal } else { self.priority }
    }

    /// Number of threads that compute together: fewer than configured if the kind of cores that they run on has fewer
    /// cores.
    pub fn threads(&self) -> usize {
        self.inner.plan.threads
    }

    /// Kinds of cores of these threads, and of the one that computes single chunks while it has time to spare; `None` where
    /// the system chooses, and where there is no such thread.
    #[doc(hidden)]
    pub fn placed(&self) -> [Option<&CoreGroup>; 2] {
        let Plan { team, slow, .. } = &self.inner.plan;
        [team.as_ref(), slow.as_ref()]
    }

    /// Number of chunks that the latter has computed.
    #[doc(hidden)]
    pub fn slow_chunks(&self) -> u64 {
        self.inner.slow_chunks.load(Ordering::Relaxed)
    }

    /// Creates a session. Allocates everything that it will need.
    ///
    /// # Errors
    /// [`EngineError`] if a number is out of range or all slots are taken.
    pub fn session(&self, config: &SessionConfig) -> Result<Session, EngineError> {
        let plan = Arena::plan();
        self.plan_session(config, &plan)?;
        self.make_session(config, &Arena::block(plan.layout()?)?)
    }

    /// Adds the memory that [`Self::session_in`] takes for such a session to `plan`. Allocates
    /// nothing, except at the first use of a sample rate, for the filter that all sessions of that
    /// rate share.
    ///
    /// # Errors
    /// [`EngineError`] if a number is out of range.
    #[doc(hidden)]
    pub fn plan_session(&self, config: &SessionConfig, plan: &Arena) -> Result<(), EngineError> {
        match config.voice {
            Voice::Mouth => self.inner.make_mouth(config, plan).map(drop),
            Voice::Delayed | Voice::Live => self.inner.make(config, plan).map(drop),
        }
    }

    /// Creates a session in memory of `arena`.
    ///
    /// # Errors
    /// As [`Self::session`].
    #[doc(hidden)]
    pub fn session_in(&self, config: &SessionConfig, arena: &Arena) -> Result<Session, EngineError> {
        self.make_session(config, arena)
    }

    fn make_session(&self, config: &SessionConfig, arena: &Arena) -> Result<Session, EngineError> {
        let inner = &self.inner;
        if let Some(defect) = inner.defect.get() {
            return Err(EngineError::Panicked(defect.clone()));
        }
        if config.voice == Voice::Mouth {
            return Ok(Session::of_mouth(inner.make_mouth(config, arena)?, Arc::clone(&inner.slots.model)));
        }
        inner.slots.sweep();
        let (shared, mut member) = inner.make(config, arena)?;
        let state_size = state_size(&shared, Some(&mut member), inner.model());
        let slot = inner.slots.insert(member).ok_or(EngineError::Full { sessions: inner.slots.len() })?;
        // The engine's thread may have ended before it saw the slot.
        if let Some(defect) = inner.defect.get() {
            inner.fail(defect);
        }
        Ok(Session::new(shared, slot, state_size))
    }

    /// Time spent in each stage so far, as of the last completed batches; concurrent batches are
    /// summed.
    pub fn stage_times(&self) -> StageTimes {
        *self.inner.times.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Number of batches computed concurrently while many sessions are due.
    #[doc(hidden)]
    pub fn batches(&self) -> usize {
        self.inner.load.workers()
    }

    /// Sets the overload limit: while chunks begin later than `limit` behind real time, a growing
    /// share of them is computed without the language model, at a quarter of the cost. In these
    /// chunks the body holds its pose, and the mouth comes from the model's mouth network, if it
    /// has one; sessions take turns. The share shrinks again when chunks are in time.
    /// [`Stats::held_chunks`](crate::session::Stats::held_chunks) counts them. While the engine
    /// keeps up, every frame has the same bits.
    ///
    /// With `None`, the default, no body is held: frames come later and later, up to the ten
    /// seconds of audio that a session queues. Keep the default if audio is pushed faster than it
    /// is heard.
    pub fn set_late_limit(&self, limit: Option<Duration>) {
        self.inner.full_share.set_limit(limit);
    }

    /// Computes until nothing is due or the next layer would exceed `budget`, judged by the last
    /// layer of its kind. Computes at least one layer, even with a budget of zero. In a polled
    /// engine, small models compute a layer of one session at a time.
    ///
    /// # Errors
    /// [`PollError`] if the engine has threads of its own, or another thread polls.
    pub fn poll(&self, budget: Duration) -> Result<Poll, PollError> {
        if self.model().is_mouth_alone() {
            return Ok(Poll::Idle);
        }
        let worker = self.worker.as_ref().ok_or(PollError::OwnThreads)?;
        let mut worker = match worker.try_lock() {
            Ok(worker) => worker,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return Err(PollError::Busy),
        };
        let start = Instant::now();
        if !worker.turn(&self.inner) {
            return Ok(Poll::Idle);
        }
        // There is work: the host is asked for threads until the poll ends.
        let team = worker.team();
        let joining = self.external_workers.as_ref().filter(|_| team.threads() > 1).map(|(_, SubmitJobs(lend))| {
            let joining = team.admit();
            let before = ASKS.replace(true);
            lend(team.threads() - 1);
            ASKS.set(before);
            joining
        });
        let mut left = Poll::More;
        while left == Poll::More && budget.saturating_sub(start.elapsed()) > worker.expected() {
            if !worker.turn(&self.inner) {
                left = Poll::Idle;
            }
        }
        drop(joining);
        Ok(left)
    }

    /// Name of the next [`Self::poll`]'s first step, for measurements; `None` if the engine has
    /// threads of its own.
    #[doc(hidden)]
    pub fn next_step(&self) -> Option<&'static str> {
        let worker = self.worker.as_ref()?;
        Some(worker.lock().unwrap_or_else(PoisonError::into_inner).next_step())
    }

    /// Computes on the calling thread, which the host lends, until the current poll ends. Returns
    /// at once if no poll is running, if the engine takes no threads, or if the calling thread is
    /// the polling one, inside its [`SubmitJobs`]. Never allocates.
    pub fn run_job(&self) {
        // This thread would wait for the end of its own poll: a deadlock.
        if ASKS.get() {
            return;
        }
        if let Some((external_workers, _)) = &self.external_workers {
            external_workers.work();
        }
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.inner.signal().stop();
        for thread in self.threads.drain(..) {
            // The thread catches the panics of its computations.
            drop(thread.join());
        }
        if let Some(worker) = self.worker.take() {
            let mut worker = worker.into_inner().unwrap_or_else(PoisonError::into_inner);
            worker.put_back(&self.inner);
        }
        self.inner.slots.for_each(|member| {
            if let Some(member) = member.take() {
                member.close();
            }
        });
    }
}

/// Starts a worker's thread, and waits until it has created the worker.
fn start_worker(inner: &Arc<Inner>, config: &EngineConfig, index: usize) -> Result<JoinHandle<()>, EngineError> {
    let before = inner.started.count.load(Ordering::Relaxed);
    // The thread creates its worker itself, so that it pins itself to its core.
    let (shared, config) = (Arc::clone(inner), config.clone());
    let work = move || {
        // The standard library allocates its thread handle, for parking, on first access.
        #[cfg(feature = "threads")]
        drop(std::thread::current());
        let make = || memory::catch(|| Worker::new(&shared, &config, index).map_err(EngineError::thread));
        let made = match contain_quietly(make) {
            Ok(made) => made.unwrap_or_else(|missing| Err(missing.into())),
            Err(defect) => Err(EngineError::Panicked(defect)),
        };
        // `Engine::new` returns after this; nothing is allocated from then on.
        drop(config);
        match made {
            Ok(worker) => {
                shared.started.add(Ok(()));
                run(worker, &shared);
            }
            Err(error) => shared.started.add(Err(error)),
        }
    };
    memory::require_thread();
    let name = match index {
        LEAD => "umo-0".to_owned(),
        _ if inner.load.is_slow(index) => "umo-economy".to_owned(),
        _ => format!("umo-batch-{index}"),
    };
    let thread = thread::start(name, work).map_err(EngineError::thread)?;
    if let Err(error) = inner.started.wait(before) {
        // The thread ends by itself; the library must not be unloaded before.
        drop(thread.join());
        return Err(error);
    }
    Ok(thread)
}

/// Main loop of a worker's thread.
fn run(mut worker: Worker, inner: &Inner) {
    let index = worker.index();
    while inner.signal().begin_turn(index) {
        // A panic outside of the ones that `turn` catches ends the engine, not the process.
        let defect = match inner.defect.get() {
            Some(defect) => defect.clone(),
            None => match contain_quietly(|| worker.turn(inner)) {
                Ok(true) => continue,
                Ok(false) => {
                    inner.signal().sleep(index, worker.waits());
                    continue;
                }
                Err(defect) => defect,
            },
        };
        let _ = inner.defect.set(defect.clone());
        worker.put_back(inner);
        inner.fail(&defect);
        return;
    }
    worker.put_back(inner);
}
