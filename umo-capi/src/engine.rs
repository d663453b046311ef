//! Engines: one model, its threads or the host's, and places for sessions.

use std::ffi::c_void;
use std::mem::ManuallyDrop;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use umo_core::engine::{Engine, EngineConfig, Lender, Poll, Priority, Threads};
use umo_core::memory;

use crate::ffi::{self, Sized32, guard, put, put_if_wanted, wanted};
use crate::gesture::Known;
use crate::handle::{self, Held, Table};
use crate::log::{Log, UMO_LOG_INFO, UMO_LOG_WARNING, UmoLog};
use crate::model::{self, ModelHandle, UmoModel};
use crate::status::{Failure, UMO_STATUS_UNSUPPORTED, UmoStatus};

/// An engine. A handle, never a pointer to memory.
pub struct UmoEngine {
    _opaque: [u8; 0],
}

/// The engine has threads of its own.
pub const UMO_ENGINE_THREADS: u32 = 0;
/// The host computes by `umo_engine_poll`.
pub const UMO_ENGINE_POLLED: u32 = 1;

/// Threads have the priority of any new thread of the process.
pub const UMO_PRIORITY_NORMAL: u32 = 0;
/// Threads run before those of normal priority: frames are nearly as fast beside a program that
/// keeps every core busy. Linux refuses it to most users; Windows, Android and Apple's systems
/// grant it.
pub const UMO_PRIORITY_HIGH: u32 = 1;
/// Threads run behind those of normal priority, in the time that they leave.
pub const UMO_PRIORITY_LOW: u32 = 2;

/// Most cores that threads can be bound to.
const MAX_CORES: usize = 64;

/// Lends the threads of the host's job system to an engine. Each `umo_engine_poll` then calls
/// `submit` for every thread but its own; the host runs `job(context)` on another thread as soon as
/// it can, which computes until the poll is over and returns. It needs 1 MiB of stack. A job that
/// is run late, or never, costs speed and nothing else; one that is run after the engine was freed,
/// or by `submit` itself, returns at once.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoJobs {
    /// Given to `submit`.
    pub userdata: *mut c_void,
    /// Hands a job over. Called by the thread that polls; must not wait for a job that another thread
    /// runs, and must not throw.
    pub submit: Option<
        unsafe extern "C" fn(
            userdata: *mut c_void,
            job: Option<unsafe extern "C" fn(context: *mut c_void)>,
            context: *mut c_void,
        ),
    >,
}

/// Configuration of an engine. Start it with `umo_engine_config_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoEngineConfig {
    /// `sizeof(umo_engine_config)`.
    pub struct_size: u32,
    /// `UMO_ENGINE_THREADS` or `UMO_ENGINE_POLLED`.
    pub mode: u32,
    /// Threads that compute, 1 to 64: the engine's own, or, where the host polls, the polling
    /// thread and as many more of the engine's own as make up the number.
    pub threads: u32,
    /// Most sessions at once, 1 to 4,096.
    pub max_sessions: u32,
    /// Most sessions that are computed together, 1 to 64: more read the weights less often and need
    /// memory.
    pub max_batch: u32,
    /// How many `cores` there are, 0 to 64.
    pub core_count: u32,
    /// Processor numbers that the engine's own threads are bound to, one each, as far as they go;
    /// NULL leaves that to the system.
    pub cores: *const u32,
    /// The host's threads, where they are to compute in place of the engine's own, or NULL. Only
    /// with `UMO_ENGINE_POLLED`.
    pub jobs: *const UmoJobs,
    /// Log callback for this engine and its sessions, or NULL.
    pub log: *const UmoLog,
    /// `UMO_PRIORITY_…` of the engine's own threads. Where the system refuses it they are
    /// `UMO_PRIORITY_NORMAL`, and `log` gets a warning that says what it takes.
    pub priority: u32,
    /// The longest that a chunk which is due waits for others, to be computed together, milliseconds: with 50, 32 avatars
    /// take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the start of a
    /// stream, once half of its length or less is left until it would be late, or where all sessions are due. 0: none waits.
    pub gather_ms: u32,
}

// SAFETY: `repr(C)`, starts with its size, integers and pointers that may be NULL.
unsafe impl Sized32 for UmoEngineConfig {
    const FIRST: usize = 24 + 3 * size_of::<*const u32>();
}

/// What an engine's handle stands for.
pub(crate) struct EngineHandle {
    /// Dropped by hand: not in a process that was forked from the engine's.
    engine: ManuallyDrop<Engine>,
    pub(crate) model: Arc<ModelHandle>,
    pub(crate) log: Log,
    /// What sessions that are made from now on know.
    pub(crate) gestures: Known,
    process: u32,
}

/// Most engines at once.
const MAX_ENGINES: usize = 1024;
static ENGINES: Table<EngineHandle, MAX_ENGINES> = Table::new(2, "engine");

pub(crate) fn get(engine: *const UmoEngine) -> Result<Held<'static, EngineHandle>, Failure> {
    if engine.is_null() {
        return Err(Failure::null("engine"));
    }
    ENGINES.get(engine.addr())
}

impl EngineHandle {
    pub(crate) fn engine(&self) -> &Engine {
        &self.engine
    }
}

/// The process, of which only threads ask; WebAssembly in a browser has one.
fn process() -> u32 {
    #[cfg(all(feature = "threads", not(all(target_family = "wasm", target_os = "unknown"))))]
    return std::process::id();
    #[cfg(not(all(feature = "threads", not(all(target_family = "wasm", target_os = "unknown")))))]
    return 0;
}

impl Drop for EngineHandle {
    fn drop(&mut self) {
        // A forked process has the engine's memory, but not its threads: there is none to wait for.
        if self.process == process() {
            // SAFETY: it is dropped once, here.
            unsafe { ManuallyDrop::drop(&mut self.engine) };
        }
    }
}

impl UmoEngineConfig {
    fn defaults() -> Self {
        let EngineConfig { threads, max_sessions, max_batch, .. } = EngineConfig::default();
        let (mode, threads) = match threads {
            Threads::Own(threads) => (UMO_ENGINE_THREADS, threads),
            Threads::Host(more) => (UMO_ENGINE_POLLED, 1 + more),
        };
        let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        Self {
            struct_size: 0,
            mode,
            threads: count(threads),
            max_sessions: count(max_sessions),
            max_batch: count(max_batch),
            core_count: 0,
            cores: std::ptr::null(),
            jobs: std::ptr::null(),
            log: std::ptr::null(),
            priority: UMO_PRIORITY_NORMAL,
            gather_ms: 0,
        }
    }

    /// # Safety
    /// `cores` is NULL or has `core_count` readable values; `jobs` is NULL or readable.
    unsafe fn read(&self, handle: &Arc<AtomicUsize>) -> Result<EngineConfig, Failure> {
        if self.core_count as usize > MAX_CORES {
            return Err(Failure::argument(format_args!("core_count {}: expected 0 to {MAX_CORES}", self.core_count)));
        }
        // SAFETY: guaranteed by the caller (see # Safety).
        let cores = unsafe { ffi::slice(self.cores, self.core_count as usize, "cores")? };
        if cfg!(not(feature = "threads"))
            && (self.mode == UMO_ENGINE_THREADS || (self.threads > 1 && self.jobs.is_null()))
        {
            let what = "this library was built without threads: make the engine with mode UMO_ENGINE_POLLED, \
                        and with threads 1 or with `jobs` that lend yours";
            return Err(Failure::new(UMO_STATUS_UNSUPPORTED, what));
        }
        let threads = match (self.mode, self.threads as usize) {
            (UMO_ENGINE_THREADS, threads) => Threads::Own(threads),
            (UMO_ENGINE_POLLED, threads @ 1..) => Threads::Host(threads - 1),
            (UMO_ENGINE_POLLED, 0) => return Err(Failure::argument("threads 0: the one that polls counts")),
            (mode, _) => return Err(Failure::argument(format_args!("mode {mode} is none of UMO_ENGINE_…"))),
        };
        let priority = match self.priority {
            UMO_PRIORITY_NORMAL => Priority::Normal,
            UMO_PRIORITY_HIGH => Priority::High,
            UMO_PRIORITY_LOW => Priority::Low,
            other => return Err(Failure::argument(format_args!("priority {other} is none of UMO_PRIORITY_…"))),
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        let lender = match (self.mode, unsafe { crate::read_if_given(self.jobs, "config.jobs")? }) {
            (_, None) => None,
            (UMO_ENGINE_POLLED, Some(UmoJobs { submit: None, .. })) => {
                return Err(Failure::null("config.jobs->submit"));
            }
            (UMO_ENGINE_POLLED, Some(jobs)) => {
                let (jobs, handle) = (Jobs(jobs), Arc::clone(handle));
                let lend = move |count| (0..count).for_each(|_| jobs.submit(handle.load(Ordering::Relaxed)));
                Some(Lender(Arc::new(lend)))
            }
            _ => return Err(Failure::argument("jobs are for engines that are polled: UMO_ENGINE_POLLED")),
        };
        Ok(EngineConfig {
            threads,
            lender,
            cores: cores.iter().map(|&core| core as usize).collect(),
            priority,
            gather: Duration::from_millis(self.gather_ms.into()),
            max_sessions: self.max_sessions as usize,
            max_batch: self.max_batch as usize,
            ..EngineConfig::default()
        })
    }
}

/// A host's job system.
#[derive(Clone, Copy)]
struct Jobs(UmoJobs);

// SAFETY: `UmoJobs` says which thread calls it; the host's pointer is only handed back.
unsafe impl Send for Jobs {}
// SAFETY: as above.
unsafe impl Sync for Jobs {}

impl Jobs {
    /// Submits one job, which refers to its engine by handle: a late job finds it freed and returns.
    fn submit(&self, engine: usize) {
        let UmoJobs { userdata, submit: Some(submit) } = self.0 else { return };
        // SAFETY: the host's own function, called as its description says.
        unsafe { submit(userdata, Some(work), std::ptr::without_provenance_mut(engine)) };
    }
}

/// One of the host's threads, for as long as the poll lasts.
unsafe extern "C" fn work(context: *mut c_void) {
    // What goes wrong in a piece of work is the poll's to tell.
    guard(|| {
        if let Ok(engine) = ENGINES.get(context.addr()) {
            engine.engine().lend();
        }
        Ok(())
    });
}

/// Fills an engine configuration with its defaults: two threads of its own (one where there is one
/// core), 64 sessions, 8 of them together. A library that was built without threads has one that the
/// host polls. `size` is `sizeof *config`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `config` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_config_init(config: *mut UmoEngineConfig, size: usize) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(config, size, "config", &UmoEngineConfig::defaults()) })
}

/// Creates an engine for a model, which may be freed before it. `config` may be NULL.
///
/// Threads: any but the audio thread. Allocates everything that computing will need, and starts the
/// engine's threads.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
/// number), `STRUCT_SIZE`, `THREAD`, `MODEL` (the model has no rest pose), `FULL` (1,024
/// engines), `OUT_OF_MEMORY`, `UNSUPPORTED` (threads of its own, in a library that was built without
/// them).
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says, with `cores`, `jobs` and `log` as
/// described; `engine` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_new(
    model: *const UmoModel,
    config: *const UmoEngineConfig,
    engine: *mut *mut UmoEngine,
) -> UmoStatus {
    guard(|| {
        wanted(engine, "engine")?;
        let model = Arc::clone(&*model::get(model)?);
        let config = if config.is_null() {
            UmoEngineConfig::defaults()
        } else {
            // SAFETY: guaranteed by the caller (see # Safety).
            unsafe { ffi::read(config, "config")? }
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        let log = Log(unsafe { crate::read_if_given(config.log, "config.log")? });
        let (made, known, wanted) = memory::watch(|| {
            let known = Arc::new(AtomicUsize::new(0));
            // SAFETY: guaranteed by the caller (see # Safety).
            let wanted = unsafe { config.read(&known)? };
            let engine = ManuallyDrop::new(Engine::new(Arc::clone(&model.model), &wanted)?);
            let handle = EngineHandle { engine, model, log, gestures: Known::new(), process: process() };
            Ok::<_, Failure>((handle::boxed(handle)?, known, wanted.priority))
        })??;
        if made.engine.priority() != wanted {
            let advice = Priority::advice();
            log.say(UMO_LOG_WARNING, format_args!("priority {}: the system refuses it: {advice}", config.priority));
        }
        let name = &made.model.model.config().name;
        log.say(UMO_LOG_INFO, format_args!("engine of {name} with {} threads", config.threads));
        let handle = ENGINES.insert(made)?;
        known.store(handle, Ordering::Relaxed);
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(engine, "engine", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Stops an engine's threads and frees it. Its sessions live on without it: frames that were ready
/// can be pulled, then they say `CLOSED`. NULL is fine.
///
/// Threads: any but the audio thread. Waits for the layer that is being computed, a few
/// milliseconds at most.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is in progress, as `umo_engine_poll`, or a job
/// that it gave to `umo_jobs.submit`). After `BUSY` the engine takes no other calls, and jobs that
/// have not begun return at once; free it again when those in progress have returned:
/// `while (umo_engine_free(engine) == UMO_STATUS_BUSY) wait_for_my_jobs();`
#[unsafe(no_mangle)]
pub extern "C" fn umo_engine_free(engine: *mut UmoEngine) -> UmoStatus {
    guard(|| {
        if engine.is_null() {
            return Ok(());
        }
        let freed = ENGINES.remove(engine.addr())?;
        freed.log.say(UMO_LOG_INFO, "freed engine");
        Ok(())
    })
}

/// What happens when there is more to compute than time: while chunks begin later than `seconds` behind
/// real time, a growing share of them is computed without the language model, at a quarter of the cost.
/// In these the body holds its pose, and the mouth comes from the model's mouth network, if it has one;
/// sessions take turns. The share shrinks again when chunks are in time; `umo_stats.held_chunks` counts
/// them. While the engine keeps up, every frame has the same bits.
///
/// A negative number, as an engine begins, holds no body: frames come later and later, up to the ten
/// seconds of audio that a session queues. Leave it so where audio is pushed faster than it is heard.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (not finite).
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_engine_set_late_limit(engine: *mut UmoEngine, seconds: f64) -> UmoStatus {
    guard(|| {
        let engine = get(engine)?;
        if !seconds.is_finite() {
            return Err(Failure::argument(
                "`seconds` is not finite: a late limit is a time, and a negative one holds no body",
            ));
        }
        let limit = (seconds >= 0.0).then(|| Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
        engine.engine().set_late_limit(limit);
        Ok(())
    })
}

/// Computes on the calling thread, where the engine was made with `UMO_ENGINE_POLLED`: until nothing is due, or until
/// the next layer would no longer fit `budget` microseconds, by how long the last of its kind took. It computes one layer
/// at least: one with a budget of 0. `more`, which may be NULL, becomes 1 where the budget left something that is due,
/// else 0: a session is due when the audio of its next chunk was pushed and its queue of frames has room, so that one whose
/// queue is full is due again once frames are pulled.
///
/// Threads: one at a time, with at least 1 MiB of stack; not the audio thread. Never allocates;
/// waits only for the engine's own threads and for work that lent ones have begun.
/// Errors: `INVALID_HANDLE`, `BUSY` (another thread polls), `UNSUPPORTED` (the engine has threads
/// of its own).
///
/// # Safety
/// `more` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_poll(engine: *mut UmoEngine, budget: u32, more: *mut u32) -> UmoStatus {
    guard(|| {
        let engine = get(engine)?;
        let left = engine.engine().poll(Duration::from_micros(budget.into()))?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put_if_wanted(more, "more", u32::from(left == Poll::More)) }
    })
}
