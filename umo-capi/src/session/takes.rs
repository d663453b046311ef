//! Takes: what a session showed as a file, and sessions that play one.

use std::ffi::c_void;

use umo_core::{Take, TakeError};

use super::packets::new_decoder;
use super::{UmoSession, UmoSessionConfig, on};
use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::handle::{self, Table};
use crate::model::UmoModel;
use crate::status::{Failure, UMO_STATUS_BUFFER_TOO_SMALL, UMO_STATUS_TAKE, UmoStatus};

/// Most takes at once.
const MAX_TAKES: usize = 16_384;

/// A take: a motion that was recorded, with what its host asked for. A handle, never a pointer to memory.
pub struct UmoTake {
    _opaque: [u8; 0],
}

/// Properties of a take. Set `struct_size`; `umo_take_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoTakeInfo {
    /// `sizeof(umo_take_info)`.
    pub struct_size: u32,
    /// Version of its format.
    pub version: u32,
    /// Frames.
    pub frames: u32,
    /// Frames per second.
    pub frame_rate: u32,
    /// Packets.
    pub packets: u32,
    /// Sample rate of the host's audio in Hz: that of a frame's sample while the take plays.
    pub sample_rate: u32,
    /// Seed of all sampling.
    pub seed: u64,
    /// Fingerprint of the model.
    pub model: u64,
    /// Fingerprint of the audio that the avatar heard: FNV-1a of 64 bits over its samples, mono floats at
    /// the model's rate.
    pub audio: u64,
    /// Number of those samples.
    pub audio_samples: u64,
    /// Fingerprint of the word rules.
    pub rules: u64,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoTakeInfo {
    const FIRST: usize = 64;
}

static TAKES: Table<Take, MAX_TAKES> = Table::new(6, "take");

impl From<TakeError> for Failure {
    fn from(error: TakeError) -> Self {
        Self::new(UMO_STATUS_TAKE, error)
    }
}

/// Reads a take from memory, as `umo animate` or `umo_session_take` wrote it; copies the bytes. Takes of all
/// earlier versions are read. Free it with `umo_take_free`; sessions that play it go on.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `TAKE` (`umo_last_error` says what is damaged), `FULL` (16,384 takes),
/// `OUT_OF_MEMORY`.
///
/// # Safety
/// `bytes` is NULL or has `size` readable bytes; `take` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_take_new(bytes: *const c_void, size: usize, take: *mut *mut UmoTake) -> UmoStatus {
    guard(|| {
        wanted(take, "take")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice(bytes.cast::<u8>(), size, "bytes")? };
        let read = umo_core_base::memory::watch(|| Take::new(bytes))??;
        let handle = TAKES.insert(handle::boxed(read)?)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(take, "take", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Frees a take. NULL is fine.
///
/// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_take_free` again).
#[unsafe(no_mangle)]
pub extern "C" fn umo_take_free(take: *mut UmoTake) -> UmoStatus {
    guard(|| if take.is_null() { Ok(()) } else { TAKES.remove(take.addr()).map(drop) })
}

/// Gets the properties of a take.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
///
/// # Safety
/// `info` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_take_get_info(take: *const UmoTake, info: *mut UmoTakeInfo) -> UmoStatus {
    guard(|| {
        let take = TAKES.get(take.addr())?;
        let found = take.info();
        let value = UmoTakeInfo {
            struct_size: 0,
            version: found.version,
            frames: found.frames,
            frame_rate: found.frame_rate,
            packets: found.packets,
            sample_rate: found.sample_rate,
            seed: take.avatar().sampler.seed,
            model: found.model,
            audio: found.audio,
            audio_samples: found.samples,
            rules: found.rules,
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(info, "info", &value) }
    })
}

/// Creates a decoder that plays a take, with the model that the take was made with: `umo_decoder_push_take`
/// takes the place of packets, and everything that shows or changes frames works as in any session. Where
/// this host asks for nothing of its own, the frames are the recorded ones, bit for bit; `umo_session_reset`
/// begins the take anew. Of `config`, which may be NULL, the idle mode, the ease and the queue count; the
/// rest is the take's. `allocator` must be NULL.
///
/// Threads: any but the audio thread. Allocates everything that the decoder will ever need.
/// Errors: as `umo_decoder_new`; `INVALID_ARGUMENT` also for a take of another model, or with a gesture that
/// is not built in.
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says; `decoder` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_decoder_new_of_take(
    model: *const UmoModel,
    take: *const UmoTake,
    config: *const UmoSessionConfig,
    decoder: *mut *mut UmoSession,
) -> UmoStatus {
    guard(|| {
        let take = TAKES.get(take.addr())?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { new_decoder(model, Some(&take), config, decoder) }
    })
}

/// Computes the frames of the take's next packet, if the queue has room for them. `more`, which may be NULL,
/// gets 0 once every packet was taken, otherwise 1. Call it more often than chunks begin, for example before
/// each pose: most calls find no room, and return at once.
///
/// Threads: one at a time, concurrently with any other call. Never allocates, never waits; takes the time of
/// a chunk's motion decoders.
/// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session plays no take), `BUSY` (another thread pushes),
/// `PACKET`, `FAILED`, `PANIC`.
///
/// # Safety
/// `more` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_decoder_push_take(decoder: *mut UmoSession, more: *mut u32) -> UmoStatus {
    on(decoder, |handle| {
        let is_more = handle.session.push_take()?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::put_if_wanted(more, "more", u32::from(is_more)) }
    })
}

/// Gets the size in bytes of the take that the session has recorded so far; its configuration has
/// `take_bytes`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session records no take), `BUSY` (the
/// take is being written to), `PANIC`.
///
/// # Safety
/// `size` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_take_size(session: *const UmoSession, size: *mut usize) -> UmoStatus {
    on(session, |handle| {
        let bytes = handle.session.take_size()?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(size, "size", bytes) }
    })
}

/// Writes the take of the frames that the session has shown so far to `take`, which has `size` bytes;
/// `written` gets the number used. The take begins at the session's start or its last reset. It ends at an
/// interrupt, where its memory ends, and at what a take cannot say: a restored state, company in a scene,
/// silence that the engine inserts, a held body, a gap in the frames.
///
/// Threads: any. Never allocates, never waits; calls on the session that show or ask for something wait
/// while it is copied.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (the session records no take),
/// `BUFFER_TOO_SMALL` (fewer than `umo_session_take_size` by now), `BUSY` (the take is being written to),
/// `PANIC`.
///
/// # Safety
/// `take` is NULL or has `size` writable bytes; `written` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_take(
    session: *const UmoSession,
    take: *mut c_void,
    size: usize,
    written: *mut usize,
) -> UmoStatus {
    on(session, |handle| {
        wanted(written, "written")?;
        let needed = handle.session.take_size()?;
        if size < needed {
            let what = format_args!("the take has {needed} bytes, {size} were given");
            return Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what));
        }
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice_mut(take.cast::<u8>(), size, "take")? };
        let count = handle.session.take(bytes)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(written, "written", count) }
    })
}
