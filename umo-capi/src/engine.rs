//! Engines: one model, compute threads of the engine or the host, and slots for sessions.

use std::ffi::c_void;
use std::mem::ManuallyDrop;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use umo_core::{CoreKinds, Engine, EngineConfig, Poll, Priority, SubmitJobs, Threads};
use umo_core_base::memory;

use crate::ffi::{self, Sized32, guard, put, put_if_wanted, wanted};
use crate::handle::{self, Guard, Table};
use crate::log::{Log, UMO_LOG_INFO, UMO_LOG_WARNING, UmoLog};
use crate::model::{self, ModelHandle, UmoModel};
use crate::status::{Failure, UMO_STATUS_UNSUPPORTED, UmoStatus};

use gestures::Known;
use words::Words;

pub(crate) mod gestures;
pub mod words;

/// An engine. A handle, never a pointer to memory.
pub struct UmoEngine {
    _opaque: [u8; 0],
}

/// The engine computes on its own threads.
pub const UMO_ENGINE_THREADS: u32 = 0;
/// The host computes by calling `umo_engine_poll`.
pub const UMO_ENGINE_POLLED: u32 = 1;

/// Default priority of the process's new threads.
pub const UMO_PRIORITY_NORMAL: u32 = 0;
/// Priority above normal: frames are nearly as fast beside a program that keeps every core busy. Linux
/// refuses it to most users; Windows, Android and Apple's systems grant it.
pub const UMO_PRIORITY_HIGH: u32 = 1;
/// Priority below normal: threads use the time that others leave.
pub const UMO_PRIORITY_LOW: u32 = 2;

/// On a machine with fast and slow cores: a crowd on the kind whose cores are the fastest together; what one slower core
/// computes with room to spare, on that core, unless the priority is high.
pub const UMO_CORES_AUTO: u32 = 0;
/// Threads run wherever the system puts them.
pub const UMO_CORES_SYSTEM: u32 = 1;
/// The fastest kind of cores alone.
pub const UMO_CORES_PERFORMANCE: u32 = 2;
/// The slowest kind of cores that is not low-power, alone.
pub const UMO_CORES_EFFICIENCY: u32 = 3;

/// Maximum number of cores that threads can be pinned to.
const MAX_CORES: usize = 64;

/// Lends the threads of the host's job system to an engine. Each `umo_engine_poll` calls `submit` once
/// for every compute thread except its own; the host then runs `job(context)` on another thread as soon
/// as it can. The job computes until the poll is over and needs 1 MiB of stack. A job that runs late, or
/// never, costs only speed. A job that runs after the engine was freed, or inside `submit`, returns at
/// once.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoJobs {
    /// Passed to `submit`.
    pub userdata: *mut c_void,
    /// Submits a job. Called on the polling thread; must not wait for a job that runs on another thread,
    /// and must not throw.
    pub submit: Option<
        unsafe extern "C" fn(
            userdata: *mut c_void,
            job: Option<unsafe extern "C" fn(context: *mut c_void)>,
            context: *mut c_void,
        ),
    >,
}

/// Configuration of an engine. Initialise it with `umo_engine_config_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoEngineConfig {
    /// `sizeof(umo_engine_config)`.
    pub struct_size: u32,
    /// Threads that compute: one of `UMO_ENGINE_…`.
    pub mode: u32,
    /// Number of compute threads, 1 to 64. With `UMO_ENGINE_POLLED` the polling thread is one of them, and
    /// the engine starts the others unless `jobs` lends them.
    pub threads: u32,
    /// Maximum number of sessions at once, 1 to 4,096.
    pub max_sessions: u32,
    /// Maximum number of sessions in a batch, 1 to 64: larger batches read the weights less often and need
    /// more memory.
    pub max_batch: u32,
    /// Number of `cores`, 0 to 64.
    pub core_count: u32,
    /// Processor numbers to pin the engine's own threads to, one thread each; threads beyond `core_count`
    /// are not pinned. NULL pins none.
    pub cores: *const u32,
    /// Lends the host's threads, which compute in place of the engine's own; or NULL. Only with
    /// `UMO_ENGINE_POLLED`.
    pub jobs: *const UmoJobs,
    /// Log callback for this engine and its sessions, or NULL.
    pub log: *const UmoLog,
    /// Priority of the engine's own threads: one of `UMO_PRIORITY_…`. If the system refuses it, they run at
    /// `UMO_PRIORITY_NORMAL`, and `log` gets a warning that says what would permit it.
    pub priority: u32,
    /// Batching window, milliseconds: the longest that a due chunk waits for others to be computed with. With 50 ms,
    /// 32 avatars take about a fifth less processor time, and frames come later by the wait. A chunk does not wait at the
    /// start of a stream, once at most half of its length is left until it would be late, or if all sessions are due.
    /// 0: no chunk waits.
    pub batch_window_ms: u32,
    /// Kinds of cores that the engine's own threads run on if `core_count` is 0: one of `UMO_CORES_…`. All but
    /// `UMO_CORES_SYSTEM` start at most as many threads as the kind has cores. No effect where all cores are of one kind.
    pub core_kinds: u32,
}

// SAFETY: `repr(C)`, starts with its size, integers and pointers that may be NULL.
unsafe impl Sized32 for UmoEngineConfig {
    const FIRST: usize = 32 + 4 * size_of::<*const u32>();
}

/// Object of an engine's handle.
pub(crate) struct EngineHandle {
    /// Dropped by hand, and never in a forked child of the engine's process.
    engine: ManuallyDrop<Engine>,
    pub(crate) model: Arc<ModelHandle>,
    pub(crate) log: Log,
    /// Gestures for sessions that are created later.
    pub(crate) gestures: Known,
    /// Word rules for sessions that are created later.
    pub(crate) words: Words,
    process: u32,
}

/// Maximum number of engines at once.
const MAX_ENGINES: usize = 1024;
static ENGINES: Table<EngineHandle, MAX_ENGINES> = Table::new(2, "engine");

pub(crate) fn get(engine: *const UmoEngine) -> Result<Guard<'static, EngineHandle>, Failure> {
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

/// Id of this process. Only engines with threads need it; WebAssembly in a browser has one process.
fn process() -> u32 {
    #[cfg(all(feature = "threads", not(all(target_family = "wasm", target_os = "unknown"))))]
    return std::process::id();
    #[cfg(not(all(feature = "threads", not(all(target_family = "wasm", target_os = "unknown")))))]
    return 0;
}

impl Drop for EngineHandle {
    fn drop(&mut self) {
        // A forked child has the engine's memory but not its threads, so it must not wait for them.
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
            batch_window_ms: 0,
            core_kinds: UMO_CORES_AUTO,
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
            (UMO_ENGINE_POLLED, 0) => {
                return Err(Failure::argument("threads 0: expected at least 1, as the polling thread counts"));
            }
            (mode, _) => return Err(Failure::argument(format_args!("mode {mode} is not one of UMO_ENGINE_…"))),
        };
        let priority = match self.priority {
            UMO_PRIORITY_NORMAL => Priority::Normal,
            UMO_PRIORITY_HIGH => Priority::High,
            UMO_PRIORITY_LOW => Priority::Low,
            other => return Err(Failure::argument(format_args!("priority {other} is not one of UMO_PRIORITY_…"))),
        };
        let core_kinds = match self.core_kinds {
            UMO_CORES_AUTO => CoreKinds::Auto,
            UMO_CORES_SYSTEM => CoreKinds::System,
            UMO_CORES_PERFORMANCE => CoreKinds::Performance,
            UMO_CORES_EFFICIENCY => CoreKinds::Efficiency,
            other => return Err(Failure::argument(format_args!("core_kinds {other} is not one of UMO_CORES_…"))),
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        let jobs = match (self.mode, unsafe { crate::read_if_given(self.jobs, "config.jobs")? }) {
            (_, None) => None,
            (UMO_ENGINE_POLLED, Some(UmoJobs { submit: None, .. })) => {
                return Err(Failure::null("config.jobs->submit"));
            }
            (UMO_ENGINE_POLLED, Some(jobs)) => {
                let (jobs, handle) = (Jobs(jobs), Arc::clone(handle));
                let lend = move |count| (0..count).for_each(|_| jobs.submit(handle.load(Ordering::Relaxed)));
                Some(SubmitJobs(Arc::new(lend)))
            }
            _ => return Err(Failure::argument("jobs need a polled engine: UMO_ENGINE_POLLED")),
        };
        Ok(EngineConfig {
            threads,
            jobs,
            cores: cores.iter().map(|&core| core as usize).collect(),
            priority,
            core_kinds,
            batch_window: Duration::from_millis(self.batch_window_ms.into()),
            max_sessions: self.max_sessions as usize,
            max_batch: self.max_batch as usize,
            ..EngineConfig::default()
        })
    }
}

/// Job system of a host.
#[derive(Clone, Copy)]
struct Jobs(UmoJobs);

// SAFETY: `UmoJobs` says which thread calls it; the host's pointer is only passed back.
unsafe impl Send for Jobs {}
// SAFETY: as above.
unsafe impl Sync for Jobs {}

impl Jobs {
    /// Submits one job, which refers to its engine by handle: a late job finds it freed and returns.
    fn submit(&self, engine: usize) {
        let UmoJobs { userdata, submit: Some(submit) } = self.0 else { return };
        // SAFETY: the host's function, called as documented.
        unsafe { submit(userdata, Some(work), std::ptr::without_provenance_mut(engine)) };
    }
}

/// Job for one of the host's threads; computes until the poll is over.
unsafe extern "C" fn work(context: *mut c_void) {
    // Errors of the work are reported by the poll.
    guard(|| {
        if let Ok(engine) = ENGINES.get(context.addr()) {
            engine.engine().run_job();
        }
        Ok(())
    });
}

/// Fills an engine configuration with its defaults: two threads of its own (one on a single core), 64
/// sessions, batches of up to 8. In a library built without threads: one thread, polled by the host.
/// `size` is `sizeof *config`.
///
/// Threads: any but the audio thread. Asks the system for the number of processors, which may allocate for a
/// moment and read files.
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

/// Creates an engine for a model. The model may be freed before the engine. `config` may be NULL.
///
/// Threads: any but the audio thread. Allocates everything that computing will need, and starts the
/// engine's threads.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
/// number), `STRUCT_SIZE`, `THREAD`, `MODEL` (the model has no rest pose), `FULL` (1,024
/// engines), `OUT_OF_MEMORY`, `UNSUPPORTED` (threads of its own, in a library built without threads).
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
            let handle =
                EngineHandle { engine, model, log, gestures: Known::new(), words: Words::new(), process: process() };
            Ok::<_, Failure>((handle::boxed(handle)?, known, wanted.priority))
        })??;
        if made.engine.priority() != wanted {
            let advice = Priority::remedy();
            log.say(UMO_LOG_WARNING, format_args!("priority {}: the system refuses it: {advice}", config.priority));
        }
        let name = &made.model.model.config().name;
        log.say(UMO_LOG_INFO, format_args!("engine of {name} with {} threads", made.engine.threads()));
        let handle = ENGINES.insert(made)?;
        known.store(handle, Ordering::Relaxed);
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(engine, "engine", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Stops an engine's threads and frees it. Its sessions remain: frames that were ready can still be
/// pulled, then calls return `CLOSED`. NULL is fine.
///
/// Threads: any but the audio thread. Waits for the layer that is being computed, a few
/// milliseconds at most.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is in progress, such as `umo_engine_poll`, or a job
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

/// Sets the overload policy: while chunks start more than `seconds` behind real time, a growing share of
/// them skips the language model, at a quarter of the cost. In these chunks the body holds its pose, and
/// the mouth comes from the model's mouth network, if it has one; sessions take turns. The share shrinks
/// again once chunks are in time; `umo_stats.held_chunks` counts them. While the engine keeps up, frames
/// are bit-identical to those without a limit.
///
/// A negative number, the default, never holds the body: frames then come later and later, up to the ten
/// seconds of audio that a session queues. Keep the default if audio is pushed faster than real time.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (not finite).
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_engine_set_late_limit(engine: *mut UmoEngine, seconds: f64) -> UmoStatus {
    guard(|| {
        let engine = get(engine)?;
        if !seconds.is_finite() {
            return Err(Failure::argument("`seconds` is not finite: give a time; a negative one turns holding off"));
        }
        let limit = (seconds >= 0.0).then(|| Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX));
        engine.engine().set_late_limit(limit);
        Ok(())
    })
}

/// Computes on the calling thread, for an engine made with `UMO_ENGINE_POLLED`: until nothing is due, or until the next
/// layer would exceed `budget` microseconds, judged by the last one of its kind. It computes at least one layer; with
/// a budget of 0, exactly one. `more`, which may be NULL, becomes 1 if the budget left due work, else 0. A session is
/// due when the audio of its next chunk was pushed and its queue of frames has room. A session with a full queue is due
/// again once frames are pulled.
///
/// Threads: one at a time, with at least 1 MiB of stack; not the audio thread. Never allocates;
/// waits only for the engine's own threads and for work that lent threads have begun.
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
