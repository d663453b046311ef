//! Audio in, frames out.

use std::ffi::c_void;
use std::time::Duration;

use umo_core::session::{Pushed, Session, SessionError};

use super::{UmoSampled, UmoSession, on};
use crate::ffi::{self, put, put_if_wanted, wanted};
use crate::frame::{self, UmoFrameLayout};
use crate::status::UmoStatus;

/// Takes audio for the avatar to speak: `count` interleaved samples, full scale 1, a multiple
/// of the session's channel count. `taken`, which may be NULL, gets how many of them there was room for:
/// the rest is to be pushed again later. Samples that are NaN, or beyond 1e6, become silence.
///
/// Threads: one at a time, meant for the audio thread. Never allocates, never waits; at most one
/// system call, to wake the engine.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not a multiple of the channel count),
/// `BUSY` (another thread pushes), `FINISHED`, `FAILED`, `CLOSED`, `PANIC`.
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
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { push(session, samples, count, taken, Session::push_audio) }
}

/// `umo_session_push_audio` for 16-bit samples, whose full scale is 32,768.
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
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { push(session, samples, count, taken, Session::push_audio_i16) }
}

/// # Safety
/// As `umo_session_push_audio`.
unsafe fn push<T>(
    session: *mut UmoSession,
    samples: *const T,
    count: usize,
    taken: *mut usize,
    push: impl FnOnce(&Session, &[T]) -> Result<Pushed, SessionError>,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let samples = unsafe { ffi::slice(samples, count, "samples")? };
        let pushed = push(&handle.session, samples)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put_if_wanted(taken, "taken", pushed.taken * handle.session.channels()) }
    })
}

/// Takes audio of who speaks to the avatar, so that it listens: `count` interleaved samples at the
/// session's rate and channels, full scale 1. Only their loudness is used; samples that are no
/// number count as silence.
///
/// Threads: one at a time, beside any other call; meant for the thread that records. Never
/// allocates, never waits, makes no system call.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not a multiple of the channel
/// count), `BUSY` (another thread is in this call), `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `samples` is NULL or has `count` readable values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_push_other_audio(
    session: *mut UmoSession,
    samples: *const f32,
    count: usize,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let samples = unsafe { ffi::slice(samples, count, "samples")? };
        Ok(handle.session.push_other_audio(samples)?)
    })
}

/// No more audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second
/// call changes nothing.
///
/// Threads: any; not beside a push. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pushes), `FAILED`, `CLOSED`,
/// `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_finish(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.finish()?))
}

/// Drops everything that is not shown yet and eases to the rest pose within `ease_ms` milliseconds,
/// at most 10,000: barge-in. Audio pushed from now on starts a new
/// stream, whose frames follow the ease; the frame index goes on, and the avatar stays where it
/// stands: the new stream's first frame is number `last + 1 + ease`, where `last` is the last frame
/// that was handed out, by a pull or by a sample, and the ease takes
/// `ceil(ease_ms * frame_rate / 1000)` frames. Sample from that time on to see it from its start.
/// As many frames of the new stream, at most the session's `ease_ms`, come out of the rest pose, the face
/// in a quarter of them.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_interrupt(session: *mut UmoSession, ease_ms: u32) -> UmoStatus {
    on(session, |handle| Ok(handle.session.interrupt(Duration::from_millis(ease_ms.into()))?))
}

/// Back to the start: everything that was pushed and not shown is dropped, the frame index starts
/// at 0, and what follows is what a new session with the same settings gives.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_reset(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.reset()?))
}

/// Takes frames that are ready, in order, each once: as many as there are and as `size` bytes have
/// room for in `layout`. `count` gets how many there were, 0 where none is ready.
///
/// Threads: one at a time, beside any other call. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the layout),
/// `UNSUPPORTED` (the layout wants visemes that the model does not have), `BUFFER_TOO_SMALL` (not
/// one frame fits), `BUSY` (another thread pulls); `FAILED`, `CLOSED`, `PANIC` when all that was
/// ready has been pulled.
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says; `frames` is NULL or has `size` writable
/// bytes; `count` is NULL or writable.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        let layout = unsafe { frame::read(layout, &handle.model)? };
        layout.check_room(size)?;
        let frames = frame::one(frames)?;
        let mut written = 0;
        let pulled = handle.session.pull_frames(layout.room(size), |frame| {
            // SAFETY: `frames` has `size` writable bytes guaranteed by the caller (see # Safety),
            // and no more frames are given than they have room for.
            unsafe { layout.write(frames, written, frame) };
            written += 1;
        })?;
        // SAFETY: guaranteed by the caller (see # Safety).
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
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(count, "count", handle.session.ready_frames()?) }
    })
}

/// Whether the stream has ended: `done` becomes 1 when `umo_session_finish` was called and every
/// frame was handed out, by pulls or by samples; before that 0. A session whose frames are only
/// sampled learns here that no more will come.
///
/// Threads: any; not beside a pull. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls); `FAILED`, `CLOSED`,
/// `PANIC` where the rest will never come.
///
/// # Safety
/// `done` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_is_done(session: *mut UmoSession, done: *mut u32) -> UmoStatus {
    on(session, |handle| {
        wanted(done, "done")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(done, "done", u32::from(handle.session.is_done()?)) }
    })
}

/// What time it is for the host, in seconds from any moment on, 0 to 1e9: from the first call on, what
/// moves while no frames come, eases to it and back, and `idle_after_ms` go by this time, and no
/// longer by the system's clock. For hosts that render slower or faster than real time, pause, or
/// replay: call it with every picture, before `umo_session_sample_pose`. Times that go back are
/// held; `umo_session_restore` goes back to the state's.
///
/// Threads: one at a time, beside any other call but a pull or a sample. Never allocates, never
/// waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not in 0 to 1e9), `BUSY` (another
/// thread pulls), `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_clock(session: *mut UmoSession, seconds: f64) -> UmoStatus {
    on(session, |handle| Ok(handle.session.set_clock(seconds)?))
}

/// The pose at `seconds` of the motion (frame index / 30), less `UMO_PARAMETER_OUTPUT_DELAY`, for a
/// renderer at a rate of its own: rotations turn the shorter way, all else is linear. Frames before
/// that time are taken as `umo_session_pull_frames` takes them. A time that is earlier than the oldest
/// frame gives the oldest; one that is later than the newest gives what the idle mode says; times that
/// go back are held. `sampled` may be NULL.
///
/// Threads: one at a time, beside any other call but a pull. Never allocates, never waits.
/// Errors: as `umo_session_pull_frames`, and `INVALID_ARGUMENT` for a time that is NaN or infinite;
/// but a session that failed, or whose engine is gone, goes on to give its last pose:
/// `umo_session_is_done` says so.
///
/// # Safety
/// `layout` is NULL or as long as its `struct_size` says; `frame` is NULL or has `size` writable
/// bytes; `sampled` is NULL or as long as its `struct_size` says, and writable.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        let layout = unsafe { frame::read(layout, &handle.model)? };
        layout.check_room(size)?;
        let frame = frame::one(frame)?;
        let found = handle.session.sample_pose(seconds, |view| {
            // SAFETY: `frame` has `size` writable bytes guaranteed by the caller (see # Safety),
            // enough for one.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(sampled, "sampled", &value) }
    })
}
