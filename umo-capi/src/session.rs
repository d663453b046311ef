//! Sessions: one avatar each, audio in and frames out.

use std::cell::UnsafeCell;
use std::ffi::{c_char, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use umo_core::session::{Pushed, Session, SessionConfig};

use crate::engine::{self, EngineHandle, UmoEngine};
use crate::ffi::{self, Sized32, guard, put, put_if_wanted, wanted};
use crate::frame::{self, UmoFrameLayout};
use crate::handle::{Held, Table};
use crate::log::{Log, UMO_LOG_ERROR};
use crate::memory::{self, Making, UmoAllocator};
use crate::model::{self, ModelHandle, UmoModel};
use crate::parameter;
use crate::status::{
    Failure, Text, UMO_STATUS_BUSY, UMO_STATUS_NULL_POINTER, UMO_STATUS_OK, UMO_STATUS_PANIC, UmoStatus,
};

/// A session: one avatar. A handle, never a pointer to memory.
pub struct UmoSession {
    _opaque: [u8; 0],
}

/// What a session is made with. Start it with `umo_session_config_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoSessionConfig {
    /// `sizeof(umo_session_config)`.
    pub struct_size: u32,
    /// Samples per second of the audio that is pushed, 8,000 to 192,000.
    pub sample_rate: u32,
    /// Interleaved channels of that audio, 1 to 64; they are mixed.
    pub channels: u32,
    /// Keyframes predicted per chunk, 1 to `umo_model_info.max_target`: fewer answer sooner, more see more at once.
    pub target: u32,
    /// Frames held back until the next chunk, for smoother seams: that much later, too.
    pub lookahead: u32,
    /// What is shown while no audio comes: one of `UMO_IDLE_…`.
    pub idle: u32,
    /// Milliseconds without audio after which that begins.
    pub idle_after_ms: u32,
    /// Milliseconds that an ease to rest takes, and the way back.
    pub ease_ms: u32,
    /// Frames that wait for the host before the engine stops computing: at least two chunks' worth.
    pub queue_frames: u32,
    /// Zero.
    pub reserved: u32,
    /// Seed of all draws: the same seed and audio give the same frames.
    pub seed: u64,
    /// Which of the model's templates: NULL for `audio_to_motion`; `text_to_motion` needs no audio.
    pub template_name: *const c_char,
    /// Where the session's memory comes from, or NULL for the system's. Read while the session is made; what it names must
    /// live until the engine is freed.
    pub allocator: *const UmoAllocator,
}

// SAFETY: `repr(C)`, starts with its size, integers and pointers that may be NULL.
unsafe impl Sized32 for UmoSessionConfig {
    const FIRST: usize = 48 + 2 * size_of::<*const c_char>();
}

/// How far motion is behind speech. Set `struct_size`, the rest is written by `umo_session_latency`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoLatency {
    /// `sizeof(umo_latency)`.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Samples of future audio, at the session's rate, that a frame needs at most: what no processor can shorten.
    pub algorithmic_samples: u64,
    /// Seconds from a chunk's last sample, or the end of the chunk before where that is later, to its frames: median.
    pub compute_p50: f64,
    /// Its 99th percentile.
    pub compute_p99: f64,
    /// Its 99.9th percentile.
    pub compute_p999: f64,
    /// Its largest.
    pub compute_max: f64,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoLatency {
    const FIRST: usize = 48;
}

/// What a session went through. Set `struct_size`, the rest is written by `umo_session_stats`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoStats {
    /// `sizeof(umo_stats)`.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Chunks computed.
    pub chunks: u64,
    /// Frames computed.
    pub frames: u64,
    /// Frames whose chunk was done later than real time needs it.
    pub late_frames: u64,
    /// Frames that an interrupt or a reset dropped before they were shown.
    pub dropped_frames: u64,
    /// Samples of each channel that were not taken because there was no room.
    pub overruns: u64,
    /// Samples that were no usable number and became silence.
    pub silenced: u64,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoStats {
    const FIRST: usize = 56;
}

/// Which times `umo_session_sample_pose` could choose from. Set `struct_size`, the rest is written.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoSampled {
    /// `sizeof(umo_sampled)`.
    pub struct_size: u32,
    /// 1 where the time asked for was later than the newest frame.
    pub is_ahead: u32,
    /// Seconds of the oldest frame that is still there.
    pub oldest: f64,
    /// Seconds of the newest frame that is ready.
    pub newest: f64,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoSampled {
    const FIRST: usize = 24;
}

/// Most sessions at once, of all engines.
pub(crate) const MAX_HANDLES: usize = 16_384;
static SESSIONS: Table<SessionHandle, MAX_HANDLES> = Table::new(3, "session");

/// What a session's handle stands for.
struct SessionHandle {
    session: Session,
    model: Arc<ModelHandle>,
    log: Log,
    /// A panic was caught in a call on it.
    poisoned: AtomicBool,
    detail: Detail,
}

/// The detail of a session's last failure, kept without waiting: of two that fail at once, one is kept.
struct Detail {
    taken: AtomicBool,
    text: UnsafeCell<Text>,
}

// SAFETY: the text is touched by whoever set `taken`, alone.
unsafe impl Sync for Detail {}

impl Detail {
    fn with<T>(&self, touch: impl FnOnce(&mut Text) -> T) -> Option<T> {
        if self.taken.swap(true, Ordering::Acquire) {
            return None;
        }
        // SAFETY: `taken` was false, so nobody else is here.
        let result = touch(unsafe { &mut *self.text.get() });
        self.taken.store(false, Ordering::Release);
        Some(result)
    }
}

fn get(session: *const UmoSession) -> Result<Held<'static, SessionHandle>, UmoStatus> {
    if session.is_null() {
        return Err(UMO_STATUS_NULL_POINTER);
    }
    SESSIONS.get(session.addr()).map_err(|failure| failure.status)
}

/// Runs a call on a session; its failure's detail is kept with the session. Touches nothing that belongs to a thread, so
/// that the first call on an audio thread makes the system allocate nothing.
fn on(session: *const UmoSession, call: impl FnOnce(&SessionHandle) -> Result<(), Failure>) -> UmoStatus {
    let handle = match get(session) {
        Ok(handle) => handle,
        Err(status) => return status,
    };
    if handle.poisoned.load(Ordering::Relaxed) {
        return UMO_STATUS_PANIC;
    }
    let failure = match catch_unwind(AssertUnwindSafe(|| call(&handle))) {
        Ok(Ok(())) => return UMO_STATUS_OK,
        Ok(Err(failure)) => failure,
        Err(_) => {
            handle.poisoned.store(true, Ordering::Relaxed);
            Failure::plain(UMO_STATUS_PANIC)
        }
    };
    handle.detail.with(|text| *text = failure.detail);
    failure.status
}

impl UmoSessionConfig {
    fn defaults(model: &ModelHandle) -> Self {
        let SessionConfig { avatar, sample_rate, channels, idle, idle_after, ease, queue_frames } =
            SessionConfig::new(model.model.config());
        let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        let ms = |time: Duration| u32::try_from(time.as_millis()).unwrap_or(u32::MAX);
        Self {
            struct_size: 0,
            sample_rate: count(sample_rate),
            channels: count(channels),
            target: count(avatar.target),
            lookahead: count(avatar.lookahead),
            idle: idle as u32,
            idle_after_ms: ms(idle_after),
            ease_ms: ms(ease),
            queue_frames: count(queue_frames),
            reserved: 0,
            seed: avatar.sampler.seed,
            template_name: std::ptr::null(),
            allocator: std::ptr::null(),
        }
    }
}

/// # Safety
/// `config` is NULL or as long as its `struct_size` says; its template ends with a zero byte, its allocator is readable.
unsafe fn read_config(
    config: *const UmoSessionConfig,
    model: &ModelHandle,
) -> Result<(SessionConfig, Option<UmoAllocator>), Failure> {
    let given = if config.is_null() {
        UmoSessionConfig::defaults(model)
    } else {
        // SAFETY: by this function's own clause.
        unsafe { ffi::read(config, "config")? }
    };
    if given.reserved != 0 {
        return Err(Failure::argument("`config.reserved` is not 0"));
    }
    let mut wanted = SessionConfig::new(model.model.config());
    (wanted.sample_rate, wanted.channels) = (given.sample_rate as usize, given.channels as usize);
    (wanted.avatar.target, wanted.avatar.lookahead) = (given.target as usize, given.lookahead as usize);
    wanted.avatar.sampler.seed = given.seed;
    wanted.idle = parameter::idle(given.idle)?;
    wanted.idle_after = Duration::from_millis(given.idle_after_ms.into());
    wanted.ease = Duration::from_millis(given.ease_ms.into());
    wanted.queue_frames = given.queue_frames as usize;
    if !given.template_name.is_null() {
        // SAFETY: by this function's own clause.
        let name = unsafe { ffi::string(given.template_name, "config.template_name")? };
        name.clone_into(&mut wanted.avatar.template);
    }
    // SAFETY: by this function's own clause.
    Ok((wanted, unsafe { crate::read_if_given(given.allocator, "config.allocator")? }))
}

/// A session in a block of its own.
fn make(
    engine: &EngineHandle,
    config: &SessionConfig,
    hooks: Option<UmoAllocator>,
) -> Result<Box<SessionHandle>, Failure> {
    let layout = memory::measure(|| Ok(engine.engine().check(config)?))?;
    let making = Making::new(layout, hooks)?;
    making.run(|| {
        Ok(Box::new(SessionHandle {
            session: engine.engine().session(config)?,
            model: Arc::clone(&engine.model),
            log: engine.log,
            poisoned: AtomicBool::new(false),
            detail: Detail { taken: AtomicBool::new(false), text: UnsafeCell::new(Text::EMPTY) },
        }))
    })
}

/// Fills a session configuration with the model's defaults: mono audio at the model's rate. `size` is `sizeof *config`.
///
/// Threads: any. Allocates for a moment.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `config` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_config_init(
    config: *mut UmoSessionConfig,
    size: usize,
    model: *const UmoModel,
) -> UmoStatus {
    guard(|| {
        let defaults = UmoSessionConfig::defaults(&*model::get(model)?);
        // SAFETY: by this function's own clause.
        unsafe { ffi::initialise(config, size, "config", &defaults) }
    })
}

/// How much memory `umo_session_new` takes from the allocator for such a session, in one piece: bytes and alignment. Either
/// may be NULL.
///
/// Threads: any but the audio thread. Allocates as much for a moment.
/// Errors: as `umo_session_new`.
///
/// # Safety
/// As `umo_session_new`; `size` and `alignment` are NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_memory(
    engine: *const UmoEngine,
    config: *const UmoSessionConfig,
    size: *mut usize,
    alignment: *mut usize,
) -> UmoStatus {
    guard(|| {
        let engine = engine::get(engine)?;
        // SAFETY: by this function's own clause.
        let (config, _) = unsafe { read_config(config, &engine.model)? };
        let layout = memory::measure(|| Ok(engine.engine().check(&config)?))?;
        // SAFETY: by this function's own clause.
        unsafe { put_if_wanted(size, "size", layout.size())? };
        // SAFETY: by this function's own clause.
        unsafe { put_if_wanted(alignment, "alignment", layout.align()) }
    })
}

/// Makes a session: one avatar at the start of its stream. `config` may be NULL.
///
/// Threads: any but the audio thread. Allocates everything that the session will ever need, in one piece from the
/// configuration's allocator (and as much from the system for a moment, to find out how much that is).
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which number), `STRUCT_SIZE`,
/// `FULL` (the engine's places, or 16,384 sessions in all), `OUT_OF_MEMORY`.
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says, with `template_name` and `allocator` as described; `session` is
/// NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_new(
    engine: *mut UmoEngine,
    config: *const UmoSessionConfig,
    session: *mut *mut UmoSession,
) -> UmoStatus {
    guard(|| {
        wanted(session, "session")?;
        let engine = engine::get(engine)?;
        // SAFETY: by this function's own clause.
        let (config, hooks) = unsafe { read_config(config, &engine.model)? };
        let handle = make(&engine, &config, hooks).and_then(|made| SESSIONS.insert(made));
        let handle = handle.inspect_err(|failure| {
            let detail = String::from_utf8_lossy(failure.detail.as_bytes());
            engine.log.say(UMO_LOG_ERROR, format_args!("no session: {detail}"));
        })?;
        // SAFETY: by this function's own clause.
        unsafe { put(session, "session", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Frees a session. NULL is fine.
///
/// Threads: any but the audio thread. Never waits: where a chunk of it is just computed, its memory goes back with the next
/// session that is made or freed, or with the engine.
/// Errors: `INVALID_HANDLE`, `BUSY` (another thread is in a call on it: free it when that has returned).
#[unsafe(no_mangle)]
pub extern "C" fn umo_session_free(session: *mut UmoSession) -> UmoStatus {
    guard(|| {
        if session.is_null() {
            return Ok(());
        }
        let freed = SESSIONS.remove(session.addr())?;
        if freed.poisoned.load(Ordering::Relaxed) {
            freed.log.say(UMO_LOG_ERROR, "freed a session in which a defect of this library was caught");
        }
        Ok(())
    })
}

/// The detail of the last call on the session that failed, from whatever thread: a copy in `buffer`, which has `size`
/// bytes; `UMO_ERROR_SIZE` are enough. `length`, which may be NULL, gets its length without the end.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is just failing).
///
/// # Safety
/// `buffer` is NULL or has `size` writable bytes; `length` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_last_error(
    session: *const UmoSession,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
) -> UmoStatus {
    let handle = match get(session) {
        Ok(handle) => handle,
        Err(status) => return status,
    };
    // SAFETY: by this function's own clause.
    let copied = handle.detail.with(|text| unsafe { ffi::copy_text(text, buffer, size, length) });
    match copied {
        Some(Ok(())) => UMO_STATUS_OK,
        Some(Err(failure)) => failure.status,
        None => UMO_STATUS_BUSY,
    }
}

/// Takes audio for the avatar to speak: `count` interleaved samples, full scale 1, a whole number of the session's
/// channels. `taken`, which may be NULL, gets how many of them there was room for: the rest is to be pushed again later.
/// Samples that are no number, or beyond 1e6, become silence.
///
/// Threads: one at a time, meant for the audio thread. Never allocates, never waits; at most one system call, to wake the
/// engine.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no whole number of channels), `BUSY` (another thread
/// pushes), `FINISHED`, `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `samples` is NULL or has `count` readable values; `taken` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_push_audio(
    session: *mut UmoSession,
    samples: *const f32,
    count: usize,
    taken: *mut usize,
) -> UmoStatus {
    // SAFETY: by this function's own clause.
    unsafe { push(session, samples, count, taken, Session::push_audio) }
}

/// The same for 16-bit samples, whose full scale is 32,768.
///
/// Threads, errors: as `umo_session_push_audio`.
///
/// # Safety
/// As `umo_session_push_audio`.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_push_audio_i16(
    session: *mut UmoSession,
    samples: *const i16,
    count: usize,
    taken: *mut usize,
) -> UmoStatus {
    // SAFETY: by this function's own clause.
    unsafe { push(session, samples, count, taken, Session::push_audio_i16) }
}

/// # Safety
/// As `umo_session_push_audio`.
unsafe fn push<T>(
    session: *mut UmoSession,
    samples: *const T,
    count: usize,
    taken: *mut usize,
    push: impl FnOnce(&Session, &[T]) -> Result<Pushed, umo_core::session::SessionError>,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        let samples = unsafe { ffi::slice(samples, count, "samples")? };
        let pushed = push(&handle.session, samples)?;
        // SAFETY: by this function's own clause.
        unsafe { put_if_wanted(taken, "taken", pushed.taken * handle.session.channels()) }
    })
}

/// No more audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second call changes nothing.
///
/// Threads: any; not beside a push. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pushes), `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_finish(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.finish()?))
}

/// Drops everything that is not shown yet and eases to the rest pose within `ease_ms` milliseconds, at most 10,000:
/// somebody has interrupted the avatar. Audio pushed from now on starts a new stream, whose frames follow the ease; the
/// frame index goes on, and the avatar stays where it stands: the new stream's first frame is number `last + 1 + ease`,
/// where `last` is the last frame that was handed out, by a pull or by a sample, and the ease takes
/// `ceil(ease_ms * frame_rate / 1000)` frames. Sample from that time on to see it from its start.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_interrupt(session: *mut UmoSession, ease_ms: u32) -> UmoStatus {
    on(session, |handle| Ok(handle.session.interrupt(Duration::from_millis(ease_ms.into()))?))
}

/// Back to the start: everything that was pushed and not shown is dropped, the frame index starts at 0, and what follows is
/// what a new session with the same settings gives.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_reset(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.reset()?))
}

/// Takes frames that are ready, in order, each once: as many as there are and as `size` bytes have room for in `layout`.
/// `count` gets how many there were, 0 where none is ready.
///
/// Threads: one at a time, beside any other call. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the layout), `UNSUPPORTED` (the layout
/// wants visemes that the model does not have), `BUFFER_TOO_SMALL` (not one frame fits), `BUSY` (another thread pulls);
/// `FAILED`, `CLOSED`, `PANIC` when all that was ready has been pulled.
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or has `size` writable bytes; `count` is NULL or
/// writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_pull_frames(
    session: *mut UmoSession,
    layout: *const UmoFrameLayout,
    frames: *mut c_void,
    size: usize,
    count: *mut usize,
) -> UmoStatus {
    on(session, |handle| {
        wanted(count, "count")?;
        // SAFETY: by this function's own clause.
        let layout = unsafe { frame::read(layout, &handle.model)? };
        layout.check_room(size)?;
        let frames = frame::one(frames)?;
        let mut written = 0;
        let pulled = handle.session.pull_frames(layout.room(size), |frame| {
            // SAFETY: `frames` has `size` writable bytes by this function's own clause, and no more frames are given than
            // they have room for.
            unsafe { layout.write(frames, written, frame) };
            written += 1;
        })?;
        // SAFETY: by this function's own clause.
        unsafe { put(count, "count", pulled) }
    })
}

/// How many frames `umo_session_pull_frames` would give.
///
/// Threads: any; not beside a pull. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls), `PANIC`.
///
/// # Safety
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_ready_frames(session: *mut UmoSession, count: *mut usize) -> UmoStatus {
    on(session, |handle| {
        wanted(count, "count")?;
        // SAFETY: by this function's own clause.
        unsafe { put(count, "count", handle.session.ready_frames()?) }
    })
}

/// Whether the stream has ended: `done` becomes 1 when `umo_session_finish` was called and every frame was handed out, by
/// pulls or by samples; before that 0. A session whose frames are only sampled learns here that no more will come.
///
/// Threads: any; not beside a pull. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls); `FAILED`, `CLOSED`, `PANIC` where the rest will
/// never come.
///
/// # Safety
/// `done` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_is_done(session: *mut UmoSession, done: *mut u32) -> UmoStatus {
    on(session, |handle| {
        wanted(done, "done")?;
        // SAFETY: by this function's own clause.
        unsafe { put(done, "done", u32::from(handle.session.is_done()?)) }
    })
}

/// The pose at `seconds` of the motion (frame index / 30), for a renderer at a rate of its own: rotations turn the shorter
/// way, all else is linear. Frames before that time are taken as `umo_session_pull_frames` takes them. A time that is
/// earlier than the oldest frame gives the oldest; one that is later than the newest gives what the idle mode says; times
/// that go back are held. `sampled` may be NULL.
///
/// Threads: one at a time, beside any other call but a pull. Never allocates, never waits.
/// Errors: as `umo_session_pull_frames`, and `INVALID_ARGUMENT` for a time that is no number; but a session that failed, or
/// whose engine is gone, goes on to give its last pose: `umo_session_is_done` says so.
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says; `frame` is NULL or has `size` writable bytes; `sampled` is NULL or
/// as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_sample_pose(
    session: *mut UmoSession,
    seconds: f64,
    layout: *const UmoFrameLayout,
    frame: *mut c_void,
    size: usize,
    sampled: *mut UmoSampled,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        let layout = unsafe { frame::read(layout, &handle.model)? };
        layout.check_room(size)?;
        let frame = frame::one(frame)?;
        let found = handle.session.sample_pose(seconds, |view| {
            // SAFETY: `frame` has `size` writable bytes by this function's own clause, enough for one.
            unsafe { layout.write(frame, 0, view) };
        })?;
        if sampled.is_null() {
            return Ok(());
        }
        let value = UmoSampled {
            struct_size: 0,
            is_ahead: u32::from(found.is_ahead),
            oldest: found.oldest,
            newest: found.newest,
        };
        // SAFETY: by this function's own clause.
        unsafe { ffi::write(sampled, "sampled", &value) }
    })
}

/// What the avatar is told, from the next chunk on: `length` bytes of UTF-8, at most 128 ids' worth. No bytes end it.
///
/// Threads: any but the audio thread. Allocates: `umo_session_set_prompt_ids` does not.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts), `INVALID_ARGUMENT` (no UTF-8, too
/// long), `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `text` is NULL or has `length` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_set_prompt(
    session: *mut UmoSession,
    text: *const c_char,
    length: usize,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        let text = unsafe { ffi::slice(text.cast::<u8>(), length, "text")? };
        Ok(handle.session.set_prompt(&model::encode(&handle.model.model, text)?)?)
    })
}

/// The same as ids, as `umo_model_encode_text` gives them.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too many, or one that the model does not have), `BUSY`,
/// `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `ids` is NULL or has `count` readable values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_set_prompt_ids(
    session: *mut UmoSession,
    ids: *const u32,
    count: usize,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        let ids = unsafe { ffi::slice(ids, count, "ids")? };
        let limit = handle.model.model.config().vocab.size;
        if let Some(id) = ids.iter().find(|&&id| id as usize >= limit) {
            return Err(Failure::argument(format_args!("id {id}: the model has {limit}")));
        }
        Ok(handle.session.set_prompt(ids)?)
    })
}

/// The seed of draws from the next chunk on.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_seed(session: *mut UmoSession, seed: u64) -> UmoStatus {
    on(session, |handle| Ok(handle.session.set_seed(seed)?))
}

/// Sets a parameter, one of `UMO_PARAMETER_…`, within the range that `umo_parameter_get_info` says. Sampling changes with
/// the next chunk, the idle mode and gains with the next frame that is handed out.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_parameter(session: *mut UmoSession, parameter: u32, value: f64) -> UmoStatus {
    on(session, |handle| parameter::set(&handle.session, parameter, value))
}

/// A parameter's value.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `PANIC`.
///
/// # Safety
/// `value` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_get_parameter(
    session: *const UmoSession,
    parameter: u32,
    value: *mut f64,
) -> UmoStatus {
    on(session, |handle| {
        let found = parameter::get(&handle.session, parameter)?;
        // SAFETY: by this function's own clause.
        unsafe { put(value, "value", found) }
    })
}

/// How far motion is behind speech.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `PANIC`.
///
/// # Safety
/// `latency` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_latency(session: *const UmoSession, latency: *mut UmoLatency) -> UmoStatus {
    on(session, |handle| {
        let found = handle.session.latency();
        let value = UmoLatency {
            struct_size: 0,
            reserved: 0,
            algorithmic_samples: found.algorithmic_samples as u64,
            compute_p50: found.compute_p50.as_secs_f64(),
            compute_p99: found.compute_p99.as_secs_f64(),
            compute_p999: found.compute_p999.as_secs_f64(),
            compute_max: found.compute_max.as_secs_f64(),
        };
        // SAFETY: by this function's own clause.
        unsafe { ffi::write(latency, "latency", &value) }
    })
}

/// What the session went through so far.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `PANIC`.
///
/// # Safety
/// `stats` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_stats(session: *const UmoSession, stats: *mut UmoStats) -> UmoStatus {
    on(session, |handle| {
        let found = handle.session.stats();
        let value = UmoStats {
            struct_size: 0,
            reserved: 0,
            chunks: found.chunks,
            frames: found.frames,
            late_frames: found.late_frames,
            dropped_frames: found.dropped_frames,
            overruns: found.overruns,
            silenced: found.silenced,
        };
        // SAFETY: by this function's own clause.
        unsafe { ffi::write(stats, "stats", &value) }
    })
}

/// Most bytes that a state of the session can have: the same for as long as it lives.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PANIC`.
///
/// # Safety
/// `size` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_state_size(session: *const UmoSession, size: *mut usize) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        unsafe { put(size, "size", handle.session.state_size()) }
    })
}

/// Writes everything that the session is to `state`, which has `size` bytes, at least `umo_session_state_size`: audio that
/// waits, frames that wait, history, settings. `written` gets how many bytes that took. They hold no address: they can be
/// kept in a file, sent, and restored in another process. The session goes on as if nothing had happened.
///
/// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too few bytes), `BUSY` (a chunk of the session is just
/// computed, or another thread is in a call on it: save again later), `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `state` is NULL or has `size` writable bytes; `written` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_save(
    session: *mut UmoSession,
    state: *mut c_void,
    size: usize,
    written: *mut usize,
) -> UmoStatus {
    on(session, |handle| {
        wanted(written, "written")?;
        // SAFETY: by this function's own clause.
        let bytes = unsafe { ffi::slice_mut(state.cast::<u8>(), size, "state")? };
        let saved = handle.session.save(bytes)?;
        // SAFETY: by this function's own clause.
        unsafe { put(written, "written", saved) }
    })
}

/// Makes the session what it, or another one of the same model and configuration, was when it was saved: the same calls
/// then give the same frames, bit for bit, on any number of threads. `size` is what `umo_session_save` wrote.
///
/// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (the bytes are no state of such a session: `umo_session_last_error`
/// says what disagrees), `BUSY` (as `umo_session_save`), `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `state` is NULL or has `size` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_restore(session: *mut UmoSession, state: *const c_void, size: usize) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: by this function's own clause.
        let bytes = unsafe { ffi::slice(state.cast::<u8>(), size, "state")? };
        Ok(handle.session.restore(bytes)?)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{UMO_ENGINE_POLLED, UmoEngineConfig, umo_engine_config_init, umo_engine_free, umo_engine_new};
    use crate::model::{umo_model_free, umo_model_load_memory};
    use std::ptr::{null, null_mut};

    static MODEL: &[u8] = include_bytes!("../../models/umo-small/model.safetensors");

    #[test]
    fn a_panic_becomes_a_status_and_poisons_that_session_alone() {
        let (mut model, mut engine, mut first, mut second) = (null_mut(), null_mut(), null_mut(), null_mut());
        let (abi, data) = (crate::UMO_ABI_VERSION, MODEL.as_ptr().cast());
        // SAFETY: the bytes are what they say, and the pointer is to a value of this function.
        assert_eq!(unsafe { umo_model_load_memory(abi, data, MODEL.len(), null(), &raw mut model) }, UMO_STATUS_OK);
        // SAFETY: integers and pointers, zero in each of which is a value.
        let mut config: UmoEngineConfig = unsafe { std::mem::zeroed() };
        // SAFETY: the size is the value's.
        assert_eq!(unsafe { umo_engine_config_init(&raw mut config, size_of::<UmoEngineConfig>()) }, UMO_STATUS_OK);
        (config.mode, config.threads) = (UMO_ENGINE_POLLED, 1);
        // SAFETY: the configuration was initialised, and the pointer is to a value of this function.
        assert_eq!(unsafe { umo_engine_new(model, &raw const config, &raw mut engine) }, UMO_STATUS_OK);
        for session in [&mut first, &mut second] {
            // SAFETY: the pointer is to a value of this function.
            assert_eq!(unsafe { umo_session_new(engine, null(), &raw mut *session) }, UMO_STATUS_OK);
        }

        assert_eq!(on(first, |_| panic!("planned")), UMO_STATUS_PANIC);
        assert_eq!(umo_session_finish(first), UMO_STATUS_PANIC);
        let (mut text, mut length) = ([0_u8; 512], 0);
        // SAFETY: the buffer is as long as it says.
        let asked = unsafe { umo_session_last_error(first, text.as_mut_ptr().cast(), text.len(), &raw mut length) };
        assert_eq!(asked, UMO_STATUS_OK);
        assert!(String::from_utf8_lossy(&text[..length]).contains("defect"));
        assert_eq!(umo_session_finish(second), UMO_STATUS_OK);

        assert_eq!(guard(|| panic!("planned")), UMO_STATUS_PANIC);
        // SAFETY: never NULL, and it ends.
        let last = unsafe { std::ffi::CStr::from_ptr(crate::status::umo_last_error()) };
        assert!(last.to_string_lossy().contains("defect"));

        assert_eq!(umo_session_free(first), UMO_STATUS_OK);
        assert_eq!(umo_session_free(second), UMO_STATUS_OK);
        assert_eq!(umo_engine_free(engine), UMO_STATUS_OK);
        assert_eq!(umo_model_free(model), UMO_STATUS_OK);
    }
}
