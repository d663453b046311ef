//! Sessions: one avatar each, audio in and frames out.

// The order of the modules is that of umo.h.
pub mod stream;

pub mod settings;

pub mod state;

pub mod packets;

pub mod takes;

use std::alloc::Layout;
use std::cell::UnsafeCell;
use std::ffi::c_char;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use umo_core::{PacketConfig, Session, SessionConfig, Voice};
use umo_core_base::defect::contain;
use umo_core_base::memory::{self, Arena, Boxed, HostMemory};

use crate::engine::{self, EngineHandle, UmoEngine};
use crate::ffi::{self, Sized32, guard, put, put_if_wanted, wanted};
use crate::handle::{Guard, MAX_SESSIONS, Table};
use crate::log::{Log, UMO_LOG_ERROR};
use crate::memory::UmoAllocator;
use crate::model::{self, ModelHandle, UmoModel};
use crate::parameter;
use crate::status::{
    Failure, Text, UMO_STATUS_BUSY, UMO_STATUS_NULL_POINTER, UMO_STATUS_OK, UMO_STATUS_PANIC, UmoStatus,
};

/// The mouth moves with the body, later than the sound by the session's latency.
pub const UMO_VOICE_DELAYED: u32 = 0;
/// The mouth follows the sound after `umo_latency.mouth_samples`: with the default model 11 ms at 16 kHz,
/// 18 ms at 48 kHz. The body follows after the session's latency, and the stream has correspondingly more
/// frames at its end. For a microphone, or a voice that is played as it arrives.
pub const UMO_VOICE_LIVE: u32 = 1;
/// The mouth alone, timed as with `UMO_VOICE_LIVE`: no chunk is computed, and the engine has nothing to do. The body is at
/// rest, with the layers over it: it breathes, looks, nods and gestures as asked. For voice chat; the one voice of a model
/// loaded with `UMO_PARTS_MOUTH`.
pub const UMO_VOICE_MOUTH: u32 = 2;

/// Chunks are output as frames only.
pub const UMO_PACKETS_NONE: u32 = 0;
/// Chunks are output as frames and as packets: pull both.
pub const UMO_PACKETS_BESIDE_FRAMES: u32 = 1;
/// Chunks are output as packets only, for a server whose avatars are shown elsewhere.
pub const UMO_PACKETS_ONLY: u32 = 2;

/// A session: one avatar. A handle, never a pointer to memory.
pub struct UmoSession {
    _opaque: [u8; 0],
}

/// Configuration of a session. Initialise it with `umo_session_config_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoSessionConfig {
    /// `sizeof(umo_session_config)`.
    pub struct_size: u32,
    /// Sample rate of the pushed audio in Hz, 8,000 to 192,000.
    pub sample_rate: u32,
    /// Interleaved channels of the pushed audio, 1 to 64; they are mixed.
    pub channels: u32,
    /// Keyframes predicted per chunk, 1 to `umo_model_info.max_target`: fewer respond sooner, more give each
    /// chunk more context.
    pub target: u32,
    /// Frames held back until the next chunk, for smoother seams; they add to the latency.
    pub lookahead: u32,
    /// Behaviour during silence: one of `UMO_IDLE_…`.
    pub idle: u32,
    /// Milliseconds without audio after which `idle` begins.
    pub idle_after_ms: u32,
    /// Duration in milliseconds of the ease to rest, and of the way back.
    pub ease_ms: u32,
    /// Capacity of the queue of frames, at least two chunks' worth: the engine pauses while it is full.
    pub queue_frames: u32,
    /// Timing of the mouth, and whether there is a body: one of `UMO_VOICE_…`.
    pub voice: u32,
    /// Seed of all sampling: equal seeds and audio give equal frames.
    pub seed: u64,
    /// Template of the model: NULL for `audio_to_motion`; `text_to_motion` needs no audio. For the latter,
    /// `umo text` uses a `guidance` of 2.5 and a temperature of at most 0.7 (`UMO_PARAMETER_TEMPERATURE`);
    /// the defaults here are for speech.
    pub template_name: *const c_char,
    /// Allocator of the session's memory, or NULL for the system's. Read while the session is made; its
    /// functions and `userdata` must stay valid until the engine is freed.
    pub allocator: *const UmoAllocator,
    /// Standard deviation, in frames, of a low-pass over the body's motion, 0 to 1.5; 0 for none. If
    /// `lookahead` is less, it looks two standard deviations ahead, 3 frames at most.
    pub smoothing: f32,
    /// Strength of the prompt's guidance, 1 to 3, for models of layout `frames`: 1 uses the prompt alone, at
    /// half the cost of other values. Other models: 1.
    pub guidance: f32,
    /// Keyframes of audio behind a chunk that the chunk waits for, if the model was trained to hear ahead;
    /// they add to the latency. Otherwise 0.
    pub horizon: u32,
    /// Output of chunks as packets: one of `UMO_PACKETS_…`.
    pub packets: u32,
    /// Keyframes before its chunk that a packet repeats, as many as fit the model's history. With a chunk's
    /// worth of them, the loss of one packet changes nothing.
    pub packet_history: u32,
    /// Decoders only: packets that may arrive before a missing one counts as lost, 0 to 4.
    pub reorder_window: u32,
    /// Bytes of memory for a take that is recorded while the session runs (`umo_session_take`), some 700 a second; 0 for none.
    /// Not with `UMO_VOICE_LIVE`, `UMO_VOICE_MOUTH`, `UMO_PACKETS_ONLY` or decoders.
    pub take_bytes: u64,
}

// SAFETY: `repr(C)`, starts with its size, numbers and pointers that may be NULL.
unsafe impl Sized32 for UmoSessionConfig {
    const FIRST: usize = 80 + 2 * size_of::<*const c_char>();
}

/// Delay of motion behind speech. Set `struct_size`; `umo_session_latency` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoLatency {
    /// `sizeof(umo_latency)`.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Upper bound on the future audio that a frame needs, in samples at the session's rate: no processor
    /// can shorten it. It follows from the configuration's `target`, `lookahead`, `smoothing`, `horizon`
    /// and `sample_rate`.
    pub algorithmic_samples: u64,
    /// Median computing time in seconds: from a chunk's last sample, or from the end of the previous chunk
    /// if that is later, to the chunk's frames.
    pub compute_p50: f64,
    /// 99th percentile of the computing time.
    pub compute_p99: f64,
    /// 99.9th percentile of the computing time.
    pub compute_p999: f64,
    /// Largest computing time.
    pub compute_max: f64,
    /// Current delay of the newest frame behind the newest audio, beyond `algorithmic_samples`, in samples
    /// at the session's rate: 0 while the engine keeps up.
    pub backlog_samples: u64,
    /// The largest backlog since the session was made.
    pub backlog_max_samples: u64,
    /// Upper bound on the future audio that a frame's mouth needs, in samples at the session's rate:
    /// `algorithmic_samples`, or less with `UMO_VOICE_LIVE`.
    pub mouth_samples: u64,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoLatency {
    const FIRST: usize = 72;
}

/// Statistics of a session. Set `struct_size`; `umo_session_stats` writes the rest.
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
    /// Frames whose chunk was computed too late for real time.
    pub late_frames: u64,
    /// Frames that an interrupt or a reset dropped before they were shown.
    pub dropped_frames: u64,
    /// Samples per channel that were not taken because there was no room.
    pub overruns: u64,
    /// Samples that were NaN, infinite or beyond 1e6, and were replaced by silence.
    pub silenced: u64,
    /// Chunks whose body was held because the engine did not keep up (`umo_engine_set_late_limit`).
    pub held_chunks: u64,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoStats {
    const FIRST: usize = 64;
}

/// Range of times available to `umo_session_sample_pose`. Set `struct_size`; the call writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoSampled {
    /// `sizeof(umo_sampled)`.
    pub struct_size: u32,
    /// 1 if the requested time was later than the newest frame.
    pub is_ahead: u32,
    /// Time in seconds of the oldest frame that is still available.
    pub oldest: f64,
    /// Time in seconds of the newest frame that is ready.
    pub newest: f64,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoSampled {
    const FIRST: usize = 24;
}

static SESSIONS: Table<SessionHandle, MAX_SESSIONS> = Table::new(3, "session");

/// Object of a session's handle.
struct SessionHandle {
    session: Session,
    model: Arc<ModelHandle>,
    log: Log,
    /// Whether a panic was caught in a call on it.
    poisoned: AtomicBool,
    detail: Detail,
}

/// Detail of a session's last failure, kept without waiting: of two failures at once, one is kept.
pub(crate) struct Detail {
    taken: AtomicBool,
    text: UnsafeCell<Text>,
}

// SAFETY: only the thread that set `taken` accesses the text.
unsafe impl Sync for Detail {}

impl Detail {
    pub(crate) fn new() -> Self {
        Self { taken: AtomicBool::new(false), text: UnsafeCell::new(Text::EMPTY) }
    }

    pub(crate) fn keep(&self, detail: &Text) {
        self.with(|text| *text = *detail);
    }

    /// Copies it to a buffer of the host's.
    ///
    /// # Safety
    /// As [`ffi::copy_text`].
    pub(crate) unsafe fn copy(&self, buffer: *mut c_char, size: usize, length: *mut usize) -> UmoStatus {
        // SAFETY: guaranteed by the caller (see # Safety).
        match self.with(|text| unsafe { ffi::copy_text(text, buffer, size, length) }) {
            Some(Ok(())) => UMO_STATUS_OK,
            Some(Err(failure)) => failure.status,
            None => UMO_STATUS_BUSY,
        }
    }

    fn with<T>(&self, touch: impl FnOnce(&mut Text) -> T) -> Option<T> {
        if self.taken.swap(true, Ordering::Acquire) {
            return None;
        }
        // SAFETY: `taken` was false, so no other thread is here.
        let result = touch(unsafe { &mut *self.text.get() });
        self.taken.store(false, Ordering::Release);
        Some(result)
    }
}

fn get(session: *const UmoSession) -> Result<Guard<'static, SessionHandle>, UmoStatus> {
    if session.is_null() {
        return Err(UMO_STATUS_NULL_POINTER);
    }
    SESSIONS.get(session.addr()).map_err(|failure| failure.status)
}

/// Checks that a handle is that of a session.
pub(crate) fn check(session: *const UmoSession) -> Result<(), Failure> {
    SESSIONS.get(session.addr()).map(drop)
}

/// Calls `call` with the session of a handle, unless it was freed or has a defect.
pub(crate) fn with<R>(handle: usize, call: impl FnOnce(&Session) -> R) -> Option<R> {
    let handle = SESSIONS.get(handle).ok()?;
    (!handle.poisoned.load(Ordering::Relaxed)).then(|| call(&handle.session))
}

/// Runs a call on a session; the detail of a failure is kept with the session. Uses no thread-local
/// storage, so that the first call on an audio thread does not make the system allocate.
fn on(session: *const UmoSession, call: impl FnOnce(&SessionHandle) -> Result<(), Failure>) -> UmoStatus {
    let handle = match get(session) {
        Ok(handle) => handle,
        Err(status) => return status,
    };
    if handle.poisoned.load(Ordering::Relaxed) {
        return UMO_STATUS_PANIC;
    }
    let failure = match contain(|| call(&handle)) {
        Ok(Ok(())) => return UMO_STATUS_OK,
        // The panic was on the engine's thread, and the session has its details.
        Ok(Err(failure)) if failure.status == UMO_STATUS_PANIC => {
            handle.session.defect().map_or(failure, Failure::defect)
        }
        Ok(Err(failure)) => failure,
        Err(defect) => {
            handle.poisoned.store(true, Ordering::Relaxed);
            Failure::defect(&defect)
        }
    };
    handle.detail.keep(&failure.detail);
    failure.status
}

impl UmoSessionConfig {
    fn defaults(model: &ModelHandle) -> Self {
        let SessionConfig {
            avatar,
            layers: _,
            gestures: _,
            words: _,
            sample_rate,
            channels,
            voice,
            idle,
            idle_after,
            ease,
            queue_frames,
            packets: _,
            take_bytes,
            reorder_window,
        } = SessionConfig::new(model.model.config());
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
            voice: voice as u32,
            seed: avatar.sampler.seed,
            template_name: std::ptr::null(),
            allocator: std::ptr::null(),
            smoothing: avatar.smoothing,
            guidance: avatar.guidance,
            horizon: count(avatar.horizon),
            packets: UMO_PACKETS_NONE,
            packet_history: count(PacketConfig::new(avatar.target).history),
            reorder_window: count(reorder_window),
            take_bytes: take_bytes as u64,
        }
    }
}

/// Reads a configuration; the defaults for NULL.
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says; its template ends with a zero byte, its
/// allocator is readable.
unsafe fn read_config(
    config: *const UmoSessionConfig,
    model: &ModelHandle,
) -> Result<(SessionConfig, Option<HostMemory>), Failure> {
    let given = if config.is_null() {
        UmoSessionConfig::defaults(model)
    } else {
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::read(config, "config")? }
    };
    let mut wanted = SessionConfig::new(model.model.config());
    (wanted.sample_rate, wanted.channels) = (given.sample_rate as usize, given.channels as usize);
    (wanted.avatar.target, wanted.avatar.lookahead) = (given.target as usize, given.lookahead as usize);
    (wanted.avatar.smoothing, wanted.avatar.guidance) = (given.smoothing, given.guidance);
    (wanted.avatar.horizon, wanted.reorder_window) = (given.horizon as usize, given.reorder_window as usize);
    let mut packets = PacketConfig::new(wanted.avatar.target);
    packets.history = given.packet_history as usize;
    packets.with_frames = given.packets == UMO_PACKETS_BESIDE_FRAMES;
    wanted.packets = match given.packets {
        UMO_PACKETS_NONE => None,
        UMO_PACKETS_BESIDE_FRAMES | UMO_PACKETS_ONLY => Some(packets),
        packets => return Err(Failure::argument(format_args!("packets {packets} is not one of UMO_PACKETS_…"))),
    };
    wanted.avatar.sampler.seed = given.seed;
    wanted.voice = match given.voice {
        UMO_VOICE_DELAYED => Voice::Delayed,
        UMO_VOICE_LIVE => Voice::Live,
        UMO_VOICE_MOUTH => Voice::Mouth,
        voice => return Err(Failure::argument(format_args!("voice {voice} is not one of UMO_VOICE_…"))),
    };
    wanted.idle = parameter::idle(given.idle)?;
    wanted.idle_after = Duration::from_millis(given.idle_after_ms.into());
    wanted.ease = Duration::from_millis(given.ease_ms.into());
    wanted.queue_frames = given.queue_frames as usize;
    wanted.take_bytes = usize::try_from(given.take_bytes)
        .map_err(|_| Failure::argument(format_args!("take_bytes {}: more than there is memory", given.take_bytes)))?;
    if !given.template_name.is_null() {
        // SAFETY: guaranteed by the caller (see # Safety).
        let name = unsafe { ffi::string(given.template_name, "config.template_name")? };
        name.clone_into(&mut wanted.avatar.template);
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let allocator = unsafe { crate::read_if_given::<UmoAllocator>(given.allocator, "config.allocator")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let allocator = allocator.map(|allocator| unsafe { allocator.host_memory() }).transpose()?;
    Ok((wanted, allocator))
}

/// Computes the memory block that a session needs.
fn plan(engine: &EngineHandle, config: &SessionConfig) -> Result<Layout, Failure> {
    let plan = Arena::plan();
    engine.engine().plan_session(config, &plan)?;
    plan.plan_boxed::<SessionHandle>();
    Ok(plan.layout()?)
}

/// Creates a session in its own block.
fn make(
    engine: &EngineHandle,
    config: &SessionConfig,
    allocator: Option<HostMemory>,
) -> Result<Boxed<SessionHandle>, Failure> {
    let layout = plan(engine, config)?;
    let block = match allocator {
        Some(allocator) => Arena::host_block(layout, allocator)?,
        None => Arena::block(layout)?,
    };
    Ok(block.boxed(SessionHandle {
        session: engine.engine().session_in(config, &block)?,
        model: Arc::clone(&engine.model),
        log: engine.log,
        poisoned: AtomicBool::new(false),
        detail: Detail::new(),
    }))
}

/// Fills a session configuration with the model's defaults, for mono audio at the model's rate. `size`
/// is `sizeof *config`.
///
/// Threads: any. Allocates for a moment.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned),
/// `OUT_OF_MEMORY`.
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
        let model = model::get(model)?;
        let defaults = memory::watch(|| UmoSessionConfig::defaults(&model))?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::initialise(config, size, "config", &defaults) }
    })
}

/// Gets the size and alignment, in bytes, of the single block that `umo_session_new` takes from the
/// allocator for this configuration. Either may be NULL.
///
/// Threads: any but the audio thread. Allocates what `umo_session_new` takes from the system.
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
        let layout = memory::watch(|| {
            // SAFETY: guaranteed by the caller (see # Safety).
            let (mut config, _) = unsafe { read_config(config, &engine.model)? };
            config.gestures = engine.gestures.gestures();
            config.words = engine.words.rules();
            plan(&engine, &config)
        })??;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put_if_wanted(size, "size", layout.size())? };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put_if_wanted(alignment, "alignment", layout.align()) }
    })
}

/// Creates a session: one avatar at the start of its stream. `config` may be NULL.
///
/// Threads: any but the audio thread. Allocates everything that the session will ever need, in one
/// piece from the configuration's allocator, of the size that `umo_session_memory` gives. From the system
/// it takes less than 1 KiB for the duration of the call. The first session of a `sample_rate` that is
/// not the model's also takes the filter that converts it, which the engine keeps: to 16,000 samples per
/// second 3 KiB from 48,000, 390 KiB from 44,100, and at most 1 MiB from any rate.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
/// number), `STRUCT_SIZE`, `FULL` (the engine's `max_sessions`, or 16,384 sessions in all),
/// `OUT_OF_MEMORY`.
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says, with `template_name` and `allocator` as
/// described; `session` is NULL or writable.
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
        let made = memory::watch(|| {
            // SAFETY: guaranteed by the caller (see # Safety).
            let (mut config, allocator) = unsafe { read_config(config, &engine.model)? };
            config.gestures = engine.gestures.gestures();
            config.words = engine.words.rules();
            make(&engine, &config, allocator)
        });
        let handle = made.map_err(Failure::from).flatten().and_then(|made| SESSIONS.insert(made));
        let handle = handle.inspect_err(|failure| {
            let detail = String::from_utf8_lossy(failure.detail.as_bytes());
            engine.log.say(UMO_LOG_ERROR, format_args!("no session: {detail}"));
        })?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(session, "session", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Frees a session. NULL is fine. From here on other calls on it get `INVALID_HANDLE`, so that
/// threads that call it without a pause cannot keep it alive.
///
/// Threads: any but the audio thread. Waits a millisecond or so for calls in progress. If a chunk of it
/// is being computed, its memory is released when the next session is made or freed, or with the
/// engine.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_session_free`
/// again; nothing was freed).
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

/// Copies the detail of the last failed call on the session, from any thread, to `buffer`, which has
/// `size` bytes; `UMO_ERROR_SIZE` is enough. `length`, which may be NULL, gets its length without the
/// terminating zero.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is failing at this moment).
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
    match get(session) {
        // SAFETY: guaranteed by the caller (see # Safety).
        Ok(handle) => unsafe { handle.detail.copy(buffer, size, length) },
        Err(status) => status,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::{UMO_ENGINE_POLLED, UmoEngineConfig, umo_engine_config_init, umo_engine_free, umo_engine_new};
    use crate::model::{umo_model_free, umo_model_load_memory};
    use std::ptr::{null, null_mut};

    static MODEL: &[u8] = include_bytes!("../../models/umo-people/model.safetensors");

    #[test]
    fn a_panic_becomes_a_status_and_poisons_that_session_alone() {
        let (mut model, mut engine, mut first, mut second) = (null_mut(), null_mut(), null_mut(), null_mut());
        let (abi, data) = (crate::UMO_ABI_VERSION, MODEL.as_ptr().cast());
        // SAFETY: the length is that of the bytes, and the pointer is to a value of this function.
        assert_eq!(unsafe { umo_model_load_memory(abi, data, MODEL.len(), null(), &raw mut model) }, UMO_STATUS_OK);
        // SAFETY: integers and pointers, for which zero is valid.
        let mut config: UmoEngineConfig = unsafe { std::mem::zeroed() };
        // SAFETY: the size is the value's.
        assert_eq!(unsafe { umo_engine_config_init(&raw mut config, size_of::<UmoEngineConfig>()) }, UMO_STATUS_OK);
        (config.mode, config.threads) = (UMO_ENGINE_POLLED, 1);
        // SAFETY: the configuration was initialised, and the pointer is to a value of this
        // function.
        assert_eq!(unsafe { umo_engine_new(model, &raw const config, &raw mut engine) }, UMO_STATUS_OK);
        for session in [&mut first, &mut second] {
            // SAFETY: the pointer is to a value of this function.
            assert_eq!(unsafe { umo_session_new(engine, null(), &raw mut *session) }, UMO_STATUS_OK);
        }

        assert_eq!(on(first, |_| panic!("planned")), UMO_STATUS_PANIC);
        assert_eq!(stream::umo_session_finish(first), UMO_STATUS_PANIC);
        let (mut text, mut length) = ([0_u8; 512], 0);
        // SAFETY: the size is the buffer's.
        let asked = unsafe { umo_session_last_error(first, text.as_mut_ptr().cast(), text.len(), &raw mut length) };
        assert_eq!(asked, UMO_STATUS_OK);
        let text = String::from_utf8_lossy(&text[..length]).into_owned();
        assert!(text.contains("defect") && text.contains("session.rs:") && text.contains("planned"), "{text}");
        assert_eq!(stream::umo_session_finish(second), UMO_STATUS_OK);

        assert_eq!(guard(|| panic!("planned")), UMO_STATUS_PANIC);
        // SAFETY: never NULL, and zero-terminated.
        let last = unsafe { std::ffi::CStr::from_ptr(crate::status::umo_last_error()) };
        let last = last.to_string_lossy();
        assert!(last.contains("defect") && last.contains("session.rs:") && last.contains("planned"), "{last}");

        assert_eq!(umo_session_free(first), UMO_STATUS_OK);
        assert_eq!(umo_session_free(second), UMO_STATUS_OK);
        assert_eq!(umo_engine_free(engine), UMO_STATUS_OK);
        assert_eq!(umo_model_free(model), UMO_STATUS_OK);
    }

    #[test]
    fn a_panic_prints_nothing() {
        let this = std::env::current_exe().unwrap();
        let name = "session::tests::a_panic_becomes_a_status_and_poisons_that_session_alone";
        let output = std::process::Command::new(this).args(["--exact", name, "--nocapture"]).output().unwrap();
        let (printed, errors) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(output.status.success() && printed.contains("1 passed"), "{printed}{errors}");
        assert!(!errors.contains("panicked") && !printed.contains("panicked"), "{printed}{errors}");
    }
}
