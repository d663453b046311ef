//! A session as bytes, and back.

use std::ffi::c_void;

use super::{UmoSession, on};
use crate::ffi::{self, put, wanted};
use crate::status::UmoStatus;

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
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(size, "size", handle.session.state_size()) }
    })
}

/// Writes everything that the session is to `state`, which has `size` bytes, at least
/// `umo_session_state_size`: audio that waits, frames that wait, history, settings. `written` gets
/// how many bytes that took. They hold no address: they can be kept in a file, sent, and restored
/// in another process. The session goes on as if nothing had happened. A chunk that is just computed is
/// computed again by the session that is restored, which gives the frames that the state does not have.
///
/// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits for a chunk.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too few bytes), `BUSY` (another
/// thread is in a call on the session: save again later), `FAILED`, `CLOSED`, `PANIC`.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice_mut(state.cast::<u8>(), size, "state")? };
        let saved = handle.session.save(bytes)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(written, "written", saved) }
    })
}

/// Makes the session what it, or another one of the same model and configuration, was when it was
/// saved: the same calls then give the same frames, bit for bit, on any number of threads, whatever
/// seed the session was made with. `size` is what `umo_session_save` wrote.
///
/// Threads: one at a time; not beside a push, a pull or a setter. Never allocates, never waits for a chunk.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (the bytes are no state of such a session:
/// `umo_session_last_error` says what disagrees), `BUSY` (as `umo_session_save`, or a chunk of this
/// session is just computed: restore again later, or into a session to which no audio was pushed), `FAILED`,
/// `CLOSED`, `PANIC`.
///
/// # Safety
/// `state` is NULL or has `size` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_restore(session: *mut UmoSession, state: *const c_void, size: usize) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice(state.cast::<u8>(), size, "state")? };
        Ok(handle.session.restore(bytes)?)
    })
}
