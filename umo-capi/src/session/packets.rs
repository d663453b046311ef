//! Packets: chunks out of a session on one side, into a decoder on another.

use std::cell::UnsafeCell;
use std::ffi::c_void;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use umo_core::memory;
use umo_core::session::Session;

use super::{Detail, SESSIONS, SessionHandle, UmoSession, UmoSessionConfig, on, read_config};
use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::handle;
use crate::log::UMO_LOG_ERROR;
use crate::model::{self, UmoModel};
use crate::status::{Failure, Text, UMO_STATUS_BUFFER_TOO_SMALL, UmoStatus};

/// What came of a decoder's packets. Set `struct_size`, the rest is written by `umo_decoder_stats`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoReceived {
    /// `sizeof(umo_received)`.
    pub struct_size: u32,
    /// Zero.
    pub reserved: u32,
    /// Packets that were taken.
    pub packets: u64,
    /// Packets that came after their time or a second time: they changed nothing.
    pub late: u64,
    /// Chunks whose packet did not come in time.
    pub lost: u64,
    /// Keyframes of these that no other packet said: the last one was held.
    pub held: u64,
}

// SAFETY: `repr(C)`, starts with its size, integers.
unsafe impl Sized32 for UmoReceived {
    const FIRST: usize = 40;
}

/// Bytes of the longest packet of the session; 0 where it was made without packets.
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

/// Takes packets that are ready, in order, each once, of a session whose configuration has `packets`:
/// as many as there are, as `bytes` has room for and at most `most`, back to back. `lengths[i]` gets
/// the bytes of each, `count` how many there were. `size` is at least what `umo_session_packet_size`
/// says. Each packet is to be sent to the decoders as it is; what of it is lost, doubled or out of
/// order they make good.
///
/// Threads: one at a time, beside any other call. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (a session without packets),
/// `BUFFER_TOO_SMALL`, `BUSY` (another thread pulls packets); `FAILED`, `CLOSED`, `PANIC` when all
/// that was ready has been pulled.
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
            let what = format_args!("a packet may take {least} bytes, {size} were given");
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

/// Creates a decoder: a session whose frames come of packets, on the side where an avatar is seen. It
/// needs no engine. Every `umo_session_…` call works on it but those that take audio, texts or a
/// state, and `umo_session_interrupt`: these are for its sender. `umo_session_free` frees it. Of
/// `config`, which may be NULL, `target`, `lookahead` and `smoothing` are the sender's, and the model is
/// the same file at the same precision; layers, seed, idle mode, ease, queue and `patience` are its own.
/// `allocator` is NULL: its memory comes from the system.
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
    guard(|| {
        wanted(decoder, "decoder")?;
        let model = model::get(model)?;
        let made = memory::watch(|| {
            // SAFETY: guaranteed by the caller (see # Safety).
            let (config, allocator) = unsafe { read_config(config, &model)? };
            if allocator.is_some() {
                return Err(Failure::argument("`config.allocator`: a decoder's memory comes from the system"));
            }
            handle::boxed(SessionHandle {
                session: Session::decoder(&model.model, &config)?,
                model: Arc::clone(&model),
                log: model.log,
                poisoned: AtomicBool::new(false),
                detail: Detail { taken: AtomicBool::new(false), text: UnsafeCell::new(Text::EMPTY) },
            })
        });
        let made = made.map_err(Failure::from).flatten();
        let handle = made.and_then(|made| SESSIONS.insert(made)).inspect_err(|failure| {
            let detail = String::from_utf8_lossy(failure.detail.as_bytes());
            model.log.say(UMO_LOG_ERROR, format_args!("no decoder: {detail}"));
        })?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(decoder, "decoder", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Takes a packet of `size` bytes, and computes the frames that it makes final. Packets may be lost,
/// come twice, late and in any order: what is missing when a later one has come, and `patience` more,
/// is made up for, and the next packet leads back. A refused packet changes nothing.
///
/// Threads: one at a time, beside any other call; meant for the thread that receives. Never
/// allocates, never waits; takes the time of a chunk's motion decoders.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `PACKET` (`umo_session_last_error` says what is wrong
/// with it), `INVALID_ARGUMENT` (a session that is no decoder), `BUSY` (another thread pushes, or
/// the queue of frames is full: take some, then push it again), `FAILED`, `PANIC`.
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

/// What came of a decoder's packets.
///
/// Threads: any; not beside a push. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (a session that is no
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
