//! Threads, and which avatars they compute next (SPEC 2.9).
//!
//! An engine has one model, one [`Batch`](crate::batch::Batch) and places for sessions. Its worker looks at every place
//! for a chunk whose audio is there, takes the ones with the earliest deadlines into a batch, computes the batch layer by
//! layer, and looks again. The worker is a thread of the engine's own, or whoever calls [`Engine::poll`].

mod core;
mod worker;

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError, TryLockError};
use std::thread::JoinHandle;
use std::time::Duration;

use atomic_wait::{wait, wake_one};

use crate::avatar::{Avatar, StageTimes};
use crate::clock::Clock;
use crate::defect::{Defect, contain_quietly};
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::memory::{self, OutOfMemory, filled, with_capacity};
use crate::model::Model;
use crate::motion::Pose;
use crate::part::PerPart;
use crate::session::{Failure, Making, Session, SessionConfig, Shared, Shown, state_size};
use crate::team::{Guests, MAX_THREADS, Team};
pub(crate) use core::Core;
use worker::Worker;

/// Most sessions of an engine.
pub const MAX_SESSIONS: usize = 4096;
/// Most avatars of a batch.
pub const MAX_BATCH: usize = 64;

/// Who computes, and for how many.
#[derive(Clone, Debug)]
pub struct EngineConfig {
    /// Who computes.
    pub threads: Threads,
    /// Cores that the threads are bound to, one each, as far as they go; with none the system chooses.
    pub cores: Vec<usize>,
    /// Most sessions at once, `1..=MAX_SESSIONS`.
    pub max_sessions: usize,
    /// Most avatars that are computed together, `1..=MAX_BATCH`: more read the weights less often, and need memory.
    pub max_batch: usize,
    /// The host's threads, in place of the engine's own, where the host polls.
    pub lender: Option<Lender>,
    /// What time it is.
    pub clock: Clock,
}

/// Asks the host for threads: called by the thread that polls, with how many are wanted. Each that the host finds calls
/// [`Engine::lend`]; late ones and missing ones cost speed and nothing else.
#[derive(Clone)]
pub struct Lender(pub Arc<dyn Fn(usize) + Send + Sync>);

impl fmt::Debug for Lender {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Lender")
    }
}

/// Who computes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Threads {
    /// As many threads of the engine's own, `1..=MAX_THREADS`.
    Own(usize),
    /// Whoever calls [`Engine::poll`], with the help of as many more threads, `0..MAX_THREADS`.
    Host(usize),
}

impl Default for EngineConfig {
    /// Two threads, 64 sessions, 8 of them together.
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        Self {
            threads: Threads::Own(cores.min(2)),
            cores: Vec::new(),
            max_sessions: 64,
            max_batch: 8,
            lender: None,
            clock: Clock::system(),
        }
    }
}

/// Why an engine or a session cannot be made.
#[derive(Debug)]
pub enum EngineError {
    /// A number is out of its range.
    Config(LoadError),
    /// The system starts no thread.
    Thread(std::io::Error),
    /// Every place is taken.
    Full {
        /// Places of the engine.
        sessions: usize,
    },
    /// The model gives no pose of rest.
    Rest(StepError),
    /// There is no memory for it.
    Memory(OutOfMemory),
    /// The engine's thread panicked: a defect of this library.
    Panicked(Defect),
}

impl fmt::Display for EngineError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Config(error) => write!(f, "{error}"),
            Self::Thread(error) => write!(f, "cannot start a thread: {error}"),
            Self::Full { sessions } => write!(f, "all {sessions} sessions of the engine are taken: drop one first"),
            Self::Rest(error) => write!(f, "the model's rest codes give no pose: {error}"),
            Self::Memory(missing) => write!(f, "{missing}"),
            Self::Panicked(defect) => write!(f, "the engine's thread ended by a defect of this library: {defect}"),
        }
    }
}

impl std::error::Error for EngineError {}

impl From<OutOfMemory> for EngineError {
    fn from(missing: OutOfMemory) -> Self {
        Self::Memory(missing)
    }
}

impl EngineError {
    /// Why a thread was not started: a system that has no memory for it says only that it did not.
    fn thread(error: std::io::Error) -> Self {
        match memory::check(memory::THREAD) {
            Ok(()) => Self::Thread(error),
            Err(missing) => Self::Memory(missing),
        }
    }
}

impl From<LoadError> for EngineError {
    fn from(error: LoadError) -> Self {
        Self::Config(error)
    }
}

/// What an [`Engine::poll`] left to do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Poll {
    /// Nothing, until more audio comes or frames are pulled.
    Idle,
    /// More: the budget is used up.
    More,
}

/// A poll that could not be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PollError {
    /// Another thread polls.
    Busy,
    /// The engine has threads of its own.
    OwnThreads,
}

impl fmt::Display for PollError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Busy => write!(f, "another thread polls the engine"),
            Self::OwnThreads => write!(f, "an engine with threads of its own is not polled"),
        }
    }
}

impl std::error::Error for PollError {}

/// Wakes the engine's thread.
#[derive(Debug, Default)]
pub(crate) struct Signal {
    /// Counts reasons to look; the thread sleeps on it.
    count: AtomicU32,
    asleep: AtomicBool,
}

impl Signal {
    /// There is something to look at. Wait-free; a system call only where the thread sleeps.
    pub(crate) fn notify(&self) {
        self.count.fetch_add(1, Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) {
            wake_one(&raw const self.count);
        }
    }

    /// Sleeps until the count differs from `seen`.
    fn sleep(&self, seen: u32) {
        self.asleep.store(true, Ordering::SeqCst);
        while self.count.load(Ordering::SeqCst) == seen {
            wait(&self.count, seen);
        }
        self.asleep.store(false, Ordering::SeqCst);
    }

    fn count(&self) -> u32 {
        self.count.load(Ordering::SeqCst)
    }
}

/// Whether the engine's thread has made its worker.
#[derive(Debug, Default)]
struct Started {
    done: AtomicU32,
    error: Mutex<Option<EngineError>>,
}

impl Started {
    fn tell(&self, made: Result<(), EngineError>) {
        *self.error.lock().unwrap_or_else(PoisonError::into_inner) = made.err();
        self.done.store(1, Ordering::Release);
        wake_one(&raw const self.done);
    }

    fn wait(&self) -> Result<(), EngineError> {
        while self.done.load(Ordering::Acquire) == 0 {
            wait(&self.done, 0);
        }
        self.error.lock().unwrap_or_else(PoisonError::into_inner).take().map_or(Ok(()), Err)
    }
}

/// A place for a session.
#[derive(Debug, Default)]
struct Slot {
    /// Whether a session has the place. It is given back only by the host's threads: memory is never freed by the worker.
    taken: AtomicBool,
    /// What the worker computes with; not here while it is in a batch.
    core: Mutex<Option<Core>>,
}

/// What the engine, its worker and its sessions share.
#[derive(Debug)]
struct Inner {
    model: Arc<Model>,
    slots: Box<[Slot]>,
    signal: Arc<Signal>,
    stop: AtomicBool,
    started: Started,
    /// The panic that ended the engine's thread.
    defect: OnceLock<Defect>,
    clock: Clock,
    /// Pose of rest.
    rest: Shown,
    /// Time spent in each stage, as of the last batch that was done.
    times: Mutex<StageTimes>,
}

impl Inner {
    /// What a session and the worker share, and what the worker computes with.
    fn make(&self, config: &SessionConfig) -> Result<(Arc<Shared>, Core), EngineError> {
        let model = &self.model;
        let avatar = Avatar::new(model, &config.avatar)?;
        let making = Making {
            config: &model.config,
            assembly: model.motion.assembly(),
            rest: self.rest.clone(),
            chunk_frames: avatar.chunk_frames(&model.config),
            has_audio: avatar.has_audio(),
            clock: self.clock.clone(),
            signal: Arc::clone(&self.signal),
        };
        let shared = Arc::new(Shared::new(making, config)?);
        let core = Core::new(avatar, Arc::clone(&shared), model, config.sample_rate);
        Ok((shared, core))
    }

    /// Ends every session that has a place: nobody computes any more.
    fn fail(&self, defect: &Defect) {
        for slot in &self.slots {
            if let Some(core) = &*slot.core.lock().unwrap_or_else(PoisonError::into_inner) {
                core.fail(Failure::Defect(defect.clone()));
            }
        }
    }

    /// Frees the places of dropped sessions that are not in a batch.
    fn sweep(&self) {
        for slot in &self.slots {
            slot.sweep();
        }
        // The worker looks at no place that somebody holds: it looks again.
        self.signal.notify();
    }
}

impl Slot {
    fn sweep(&self) {
        if !self.taken.load(Ordering::Acquire) {
            return;
        }
        let core = match self.core.try_lock() {
            Ok(mut core) => core.take_if(|core| core.is_dropped()),
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner().take_if(|core| core.is_dropped()),
            Err(TryLockError::WouldBlock) => None,
        };
        if core.is_some() {
            drop(core);
            self.taken.store(false, Ordering::Release);
        }
    }
}

/// A session's place in its engine, as the session knows it.
#[derive(Debug)]
pub(crate) struct Place {
    inner: Arc<Inner>,
    index: usize,
}

impl Place {
    /// Frees the place of a session that was dropped, where its core is not in a batch.
    pub(crate) fn sweep(&self) {
        self.inner.slots[self.index].sweep();
        self.inner.signal.notify();
    }

    /// The engine's side of the session, and its model, for as long as `f` takes; none where it is in a batch or the engine is
    /// just looking at it. The caller notifies the engine afterwards, which may have passed the place over.
    pub(crate) fn with_core<R>(&self, f: impl FnOnce(&mut Core, &Model) -> R) -> Option<R> {
        let mut core = match self.inner.slots[self.index].core.try_lock() {
            Ok(core) => core,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return None,
        };
        core.as_mut().map(|core| f(core, &self.inner.model))
    }
}

/// Avatars of one model, and who computes them.
#[derive(Debug)]
pub struct Engine {
    inner: Arc<Inner>,
    /// Where the host polls.
    worker: Option<Mutex<Worker>>,
    /// Where the host lends its threads.
    guests: Option<(Guests, Lender)>,
    thread: Option<JoinHandle<()>>,
}

impl Engine {
    /// An engine without sessions. Everything that computing needs is allocated here.
    ///
    /// # Errors
    /// [`EngineError`] where a number is out of range or a thread cannot be started.
    pub fn new(model: Arc<Model>, config: &EngineConfig) -> Result<Self, EngineError> {
        memory::catch(|| Self::start(model, config))?
    }

    fn start(model: Arc<Model>, config: &EngineConfig) -> Result<Self, EngineError> {
        let range = |key: &str, got: usize, to: usize| {
            if (1..=to).contains(&got) {
                return Ok(());
            }
            Err(LoadError::config(key, format!("expected 1 to {to}, got {got}")))
        };
        range("max_sessions", config.max_sessions, MAX_SESSIONS)?;
        range("max_batch", config.max_batch, MAX_BATCH)?;
        let (own, threads) = match config.threads {
            Threads::Own(threads) => (true, threads),
            Threads::Host(more) => (false, more + 1),
        };
        range("threads", threads, MAX_THREADS)?;
        let rest = rest(&model).map_err(EngineError::Rest)?;
        let mut slots = with_capacity(config.max_sessions);
        slots.resize_with(config.max_sessions, Slot::default);
        let inner = Arc::new(Inner {
            slots: slots.into(),
            signal: Arc::default(),
            stop: AtomicBool::new(false),
            started: Started::default(),
            defect: OnceLock::new(),
            clock: config.clock.clone(),
            model,
            rest,
            times: Mutex::default(),
        });
        if !own {
            let worker = Worker::new(&inner, config, threads).map_err(EngineError::thread)?;
            let guests = config.lender.clone().map(|lender| (worker.guests(), lender));
            return Ok(Self { inner, worker: Some(Mutex::new(worker)), guests, thread: None });
        }
        // The thread makes its worker itself, so that the first core is its own.
        let (shared, config) = (Arc::clone(&inner), config.clone());
        let life = move || {
            let make = || memory::catch(|| Worker::new(&shared, &config, threads).map_err(EngineError::thread));
            let made = match contain_quietly(make) {
                Ok(made) => made.unwrap_or_else(|missing| Err(missing.into())),
                Err(defect) => Err(EngineError::Panicked(defect)),
            };
            // Whoever waits may count allocations from then on.
            drop(config);
            match made {
                Ok(worker) => {
                    shared.started.tell(Ok(()));
                    run(worker, &shared);
                }
                Err(error) => shared.started.tell(Err(error)),
            }
        };
        memory::require(memory::THREAD);
        let thread = std::thread::Builder::new().name("umo-0".to_owned()).spawn(life).map_err(EngineError::thread)?;
        if let Err(error) = inner.started.wait() {
            // It ends by itself; the library must not be unloaded before.
            drop(thread.join());
            return Err(error);
        }
        Ok(Self { inner, worker: None, guests: None, thread: Some(thread) })
    }

    /// The model.
    pub fn model(&self) -> &Model {
        &self.inner.model
    }

    /// A new session. Everything that it will need is allocated here.
    ///
    /// # Errors
    /// [`EngineError`] where a number is out of range or every place is taken.
    pub fn session(&self, config: &SessionConfig) -> Result<Session, EngineError> {
        let inner = &self.inner;
        if let Some(defect) = inner.defect.get() {
            return Err(EngineError::Panicked(defect.clone()));
        }
        inner.sweep();
        let (shared, core, state_size) = memory::catch(|| {
            let (shared, mut core) = inner.make(config)?;
            let state_size = state_size(&shared, &mut core, &inner.model);
            Ok::<_, EngineError>((shared, core, state_size))
        })??;
        let free = |slot: &Slot| slot.taken.compare_exchange(false, true, Ordering::AcqRel, Ordering::Relaxed).is_ok();
        let index = inner.slots.iter().position(free);
        let index = index.ok_or(EngineError::Full { sessions: inner.slots.len() })?;
        match inner.slots[index].core.lock() {
            Ok(mut slot) => *slot = Some(core),
            Err(poisoned) => *poisoned.into_inner() = Some(core),
        }
        inner.signal.notify();
        // The engine's thread may have ended before it saw the place.
        if let Some(defect) = inner.defect.get() {
            inner.fail(defect);
        }
        Ok(Session::new(shared, Place { inner: Arc::clone(inner), index }, state_size))
    }

    /// Makes what a session has and drops it again: whether it can be made, and for who counts allocations what it needs.
    ///
    /// # Errors
    /// [`EngineError`] where a number is out of range.
    pub fn check(&self, config: &SessionConfig) -> Result<(), EngineError> {
        memory::catch(|| self.inner.make(config).map(drop))?
    }

    /// Time spent in each stage so far, as of the last batch that was done.
    pub fn stage_times(&self) -> StageTimes {
        *self.inner.times.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Computes until nothing is due or `budget` is used up: it returns at most one layer's time later. A budget of zero
    /// computes one layer.
    ///
    /// # Errors
    /// [`PollError`] where the engine has threads of its own, or another thread polls.
    pub fn poll(&self, budget: Duration) -> Result<Poll, PollError> {
        let worker = self.worker.as_ref().ok_or(PollError::OwnThreads)?;
        let mut worker = match worker.try_lock() {
            Ok(worker) => worker,
            Err(TryLockError::Poisoned(poisoned)) => poisoned.into_inner(),
            Err(TryLockError::WouldBlock) => return Err(PollError::Busy),
        };
        let start = std::time::Instant::now();
        if !worker.turn(&self.inner) {
            return Ok(Poll::Idle);
        }
        // There is something to compute: threads are asked for until the poll is over.
        let team = worker.team();
        let invitation = self.guests.as_ref().filter(|_| team.threads() > 1).map(|(_, Lender(lend))| {
            let invitation = team.invite();
            lend(team.threads() - 1);
            invitation
        });
        let mut left = Poll::More;
        while left == Poll::More && start.elapsed() < budget {
            if !worker.turn(&self.inner) {
                left = Poll::Idle;
            }
        }
        drop(invitation);
        Ok(left)
    }

    /// Computes on the calling thread, which the host lends, until the poll that is under way is over; returns at once
    /// where none is, or where the engine wants no threads. Never allocates.
    pub fn lend(&self) {
        if let Some((guests, _)) = &self.guests {
            guests.work();
        }
    }
}

impl Drop for Engine {
    fn drop(&mut self) {
        self.inner.stop.store(true, Ordering::SeqCst);
        self.inner.signal.notify();
        if let Some(thread) = self.thread.take() {
            // It catches the panics of what it computes.
            drop(thread.join());
        }
        if let Some(worker) = self.worker.take() {
            let mut worker = worker.into_inner().unwrap_or_else(PoisonError::into_inner);
            worker.put_back(&self.inner);
        }
        for slot in &self.inner.slots {
            let core = slot.core.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(core) = core {
                core.close();
            }
        }
    }
}

/// The life of an engine's own thread.
fn run(mut worker: Worker, inner: &Inner) {
    while !inner.stop.load(Ordering::SeqCst) {
        let seen = inner.signal.count();
        // A defect outside of what `turn` itself catches ends the engine, not the process.
        match contain_quietly(|| worker.turn(inner)) {
            Ok(true) => {}
            Ok(false) => inner.signal.sleep(seen),
            Err(defect) => {
                let _ = inner.defect.set(defect.clone());
                worker.put_back(inner);
                inner.fail(&defect);
                return;
            }
        }
    }
    worker.put_back(inner);
}

/// The pose that the model's codes of rest decode to, away from a clip's ends.
fn rest(model: &Model) -> Result<Shown, StepError> {
    let config = &model.config;
    let team = Team::new(1).map_err(|_| StepError::Missing("thread"))?;
    let frames = 2 * model.motion.reach() + 1;
    #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
    let codes = PerPart::from_fn(|part| filled(config.rest[part] as u16, frames));
    let decoded =
        model.motion.decode(Compute { isa: model.isa, team: &team }, PerPart::from_fn(|part| &*codes[part]))?;
    let (middle, assembly) = (frames / 2, model.motion.assembly());
    let channels = PerPart::from_fn(|part| {
        let width = model.motion.channels(part);
        &decoded.channels[part][middle * width..(middle + 1) * width]
    });
    let mut face = filled(0.0, assembly.face_values());
    assembly.face(channels.face, &mut face);
    let mut pose = Pose { rotations: assembly.rotations(channels), translation: decoded.translation[middle] };
    assembly.turn_eyes(&face, &mut pose.rotations);
    (pose.translation[0], pose.translation[2]) = (0.0, 0.0);
    Ok(Shown::new(pose, &face))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::defect::keep_quiet;
    use crate::session::SessionError;

    fn polled() -> Engine {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-small/model.safetensors");
        let file = crate::ModelFile::open(path.as_ref()).unwrap();
        let model = Model::load(&file, crate::Precision::Stored, umo_kernels::Isa::detect()).unwrap();
        let config = EngineConfig { threads: Threads::Host(0), ..EngineConfig::default() };
        Engine::new(Arc::new(model), &config).unwrap()
    }

    #[test]
    fn a_panic_of_a_step_ends_its_session_alone_and_is_kept_with_its_place() {
        keep_quiet(&[]);
        let engine = polled();
        let config = SessionConfig::new(&engine.model().config);
        let (bad, good) = (engine.session(&config).unwrap(), engine.session(&config).unwrap());
        bad.place().with_core(|core, _| core.plant_defect()).unwrap();
        for session in [&bad, &good] {
            session.push_audio(&vec![0.0; 2 * config.sample_rate]).unwrap();
        }
        while engine.poll(Duration::from_secs(1)) != Ok(Poll::Idle) {}
        assert_eq!(bad.pull_frames(1, |_| ()), Err(SessionError::Panicked));
        let defect = bad.defect().unwrap();
        assert!(defect.place().contains("core.rs:"), "{defect}");
        assert!(defect.message().contains("divide by zero"), "{defect}");
        assert!(good.ready_frames().unwrap() > 0);
        assert_eq!(good.defect(), None);
    }

    #[test]
    fn sessions_of_an_engine_whose_thread_has_ended_say_why() {
        let engine = polled();
        let config = SessionConfig::new(&engine.model().config);
        let session = engine.session(&config).unwrap();
        let defect = crate::defect::contain(|| panic!("planned")).unwrap_err();
        let _ = engine.inner.defect.set(defect.clone());
        engine.inner.fail(&defect);
        assert_eq!(session.push_audio(&[0.0]), Err(SessionError::Panicked));
        assert_eq!(session.defect().unwrap().message(), "planned");
        assert!(matches!(engine.session(&config), Err(EngineError::Panicked(_))));
    }
}
