//! Saving and restoring a session.

use std::ffi::c_void;

use super::{UmoSession, on};
use crate::ffi::{self, put, wanted};
use crate::status::UmoStatus;

/// Gets the maximum size of a state of the session, in bytes; it is constant for the session's lifetime.
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

/// Saves the session's whole state to `state`, which has `size` bytes, at least `umo_session_state_size`:
/// queued audio, queued frames, history, settings. `written` gets the number of bytes used. They hold no
/// addresses: they can be kept in a file, sent, and restored in another process. The session continues
/// as if nothing had happened. A chunk that is being computed is computed again by the restored session,
/// which then gives the frames that the state does not have.
///
/// Threads: one at a time; not during a push, a pull or a setter. Never allocates, never waits for a chunk.
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

/// Restores a state that was saved from this session or from another one of the same model and
/// configuration: equal calls then give equal frames, bit for bit, on any number of threads, whatever seed
/// the session was made with. `size` is the length that `umo_session_save` wrote.
///
/// Threads: one at a time; not during a push, a pull or a setter. Never allocates, never waits for a chunk.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (not a state of a session with this configuration:
/// `umo_session_last_error` says what disagrees), `BUSY` (as `umo_session_save`, or a chunk of this
/// session is being computed: restore again later, or into a session to which no audio was pushed),
/// `FAILED`, `CLOSED`, `PANIC`.
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
