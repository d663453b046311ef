//! Packets: chunks from a session on one side to a decoder on the other.

use std::ffi::c_void;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use umo_core::{Session, Take};
use umo_core_base::memory;

use super::{Detail, SESSIONS, SessionHandle, UmoSession, UmoSessionConfig, on, read_config};
use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::handle;
use crate::log::UMO_LOG_ERROR;
use crate::model::{self, UmoModel};
use crate::status::{Failure, UMO_STATUS_BUFFER_TOO_SMALL, UmoStatus};

/// Statistics of a decoder's packets. Set `struct_size`; `umo_decoder_stats` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoReceived {
    /// `sizeof(umo_received)`.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Packets accepted.
    pub packets: u64,
    /// Packets that arrived too late or a second time and were ignored.
    pub late: u64,
    /// Chunks whose packet did not arrive in time.
    pub lost: u64,
    /// Keyframes of lost chunks that no other packet repeated, so that the last pose was held.
    pub held: u64,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoReceived {
    const FIRST: usize = 40;
}

/// Gets the maximum size of a packet of the session, in bytes; 0 for a session made without packets.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PANIC`.
///
/// # Safety
/// `size` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_packet_size(session: *const UmoSession, size: *mut usize) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(size, "size", handle.session.packet_size()) }
    })
}

/// Takes ready packets in order, each once, of a session whose configuration has `packets`: at most
/// `most`, and as many as fit in `bytes`, back to back. `lengths[i]` gets the length of each in bytes,
/// `count` their number. `size` is at least `umo_session_packet_size`. Send each packet to the decoders
/// unchanged; they tolerate loss, duplicates and reordering.
///
/// Threads: one at a time, concurrently with any other call. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a session without packets),
/// `BUFFER_TOO_SMALL`, `BUSY` (another thread pulls packets); `FAILED`, `CLOSED`, `PANIC` once all
/// ready packets have been pulled.
///
/// # Safety
/// `bytes` is NULL or has `size` writable bytes; `lengths` is NULL or has `most` writable values;
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_pull_packets(
    session: *mut UmoSession,
    bytes: *mut c_void,
    size: usize,
    lengths: *mut usize,
    most: usize,
    count: *mut usize,
) -> UmoStatus {
    on(session, |handle| {
        wanted(count, "count")?;
        let least = handle.session.packet_size();
        if size < least {
            let what = format_args!("a packet may need {least} bytes, {size} were given");
            return Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what));
        }
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice_mut(bytes.cast::<u8>(), size, "bytes")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let lengths = unsafe { ffi::slice_mut(lengths, most, "lengths")? };
        let pulled = handle.session.pull_packets(bytes, lengths)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(count, "count", pulled) }
    })
}

/// Creates a decoder: a session that gets its frames from packets, where the avatar is shown. It needs no
/// engine. All `umo_session_…` calls work on it except those that take audio, texts or a state, and
/// `umo_session_interrupt`: these are for the sender. Free it with `umo_session_free`. In `config`, which
/// may be NULL, `target`, `lookahead` and `smoothing` must equal the sender's, and the model must be the
/// same file at the same precision; layers, seed, idle mode, ease, queue and `reorder_window` are the decoder's
/// own. `allocator` must be NULL: its memory comes from the system.
///
/// Threads: any but the audio thread. Allocates everything that the decoder will ever need.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (`umo_last_error` says which
/// number), `STRUCT_SIZE`, `FULL` (16,384 sessions in all), `OUT_OF_MEMORY`.
///
/// # Safety
/// `config` is NULL or as long as its `struct_size` says; `decoder` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_decoder_new(
    model: *const UmoModel,
    config: *const UmoSessionConfig,
    decoder: *mut *mut UmoSession,
) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { new_decoder(model, None, config, decoder) })
}

/// Creates a decoder of packets that come, or of a take's.
///
/// # Safety
/// As [`umo_decoder_new`].
pub(super) unsafe fn new_decoder(
    model: *const UmoModel,
    take: Option<&Take>,
    config: *const UmoSessionConfig,
    decoder: *mut *mut UmoSession,
) -> Result<(), Failure> {
    wanted(decoder, "decoder")?;
    let model = model::get(model)?;
    let made = memory::watch(|| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let (config, allocator) = unsafe { read_config(config, &model)? };
        if allocator.is_some() {
            return Err(Failure::argument("`config.allocator`: a decoder's memory comes from the system"));
        }
        handle::boxed(SessionHandle {
            session: match take {
                Some(take) => Session::of_take(&model.model, take, &config)?,
                None => Session::decoder(&model.model, &config)?,
            },
            model: Arc::clone(&model),
            log: model.log,
            poisoned: AtomicBool::new(false),
            detail: Detail::new(),
        })
    });
    let made = made.map_err(Failure::from).flatten();
    let handle = made.and_then(|made| SESSIONS.insert(made)).inspect_err(|failure| {
        let detail = String::from_utf8_lossy(failure.detail.as_bytes());
        model.log.say(UMO_LOG_ERROR, format_args!("no decoder: {detail}"));
    })?;
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { put(decoder, "decoder", std::ptr::without_provenance_mut(handle)) }
}

/// Decodes a packet of `size` bytes, and computes the frames that become final. Packets may be lost,
/// duplicated, late and in any order. A packet that is missing after a later one and `reorder_window` more have
/// arrived is concealed, and the next packet leads back to the sender's motion. A refused packet changes
/// nothing.
///
/// Threads: one at a time, concurrently with any other call; meant for the receiving thread. Never
/// allocates, never waits; takes the time of a chunk's motion decoders.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PACKET` (`umo_session_last_error` has the reason),
/// `INVALID_ARGUMENT` (the session is not a decoder), `BUSY` (another thread pushes, or the queue of
/// frames is full: pull some, then push the packet again), `FAILED`, `PANIC`.
///
/// # Safety
/// `packet` is NULL or has `size` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_decoder_push_packet(
    decoder: *mut UmoSession,
    packet: *const c_void,
    size: usize,
) -> UmoStatus {
    on(decoder, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let packet = unsafe { ffi::slice(packet.cast::<u8>(), size, "packet")? };
        Ok(handle.session.push_packet(packet)?)
    })
}

/// Gets statistics of a decoder's packets.
///
/// Threads: any; not during a push. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the session is not a
/// decoder), `BUSY` (another thread pushes), `PANIC`.
///
/// # Safety
/// `stats` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_decoder_stats(decoder: *const UmoSession, stats: *mut UmoReceived) -> UmoStatus {
    on(decoder, |handle| {
        let found = handle.session.received()?;
        let value = UmoReceived {
            struct_size: 0,
            reserved: 0,
            packets: found.packets,
            late: found.late,
            lost: found.lost,
            held: found.held,
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(stats, "stats", &value) }
    })
}
