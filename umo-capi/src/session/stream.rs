//! Audio in, frames out.

use std::ffi::c_void;
use std::time::Duration;

use umo_core::{Pushed, Session, SessionError};

use super::{UmoSampled, UmoSession, on};
use crate::ffi::{self, put, put_if_wanted, wanted};
use crate::frame::{self, UmoFrameLayout};
use crate::status::UmoStatus;

/// Pushes audio for the avatar to speak: `count` interleaved samples, full scale 1, a multiple of the
/// session's channel count. `taken`, which may be NULL, gets the number of samples that there was room
/// for: push the rest again later. Samples that are NaN, infinite or beyond 1e6 become silence.
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

/// Pushes 16-bit samples, with a full scale of 32,768, as `umo_session_push_audio` does.
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

/// Feeds the voice of a person at a microphone: `count` interleaved samples at the session's rate and
/// channels, full scale 1. From then on the person stands 1.5 m ahead of the avatar, until a reset, and the
/// two are as in a scene: the avatar looks there and away, listens, nods, and gives way. In a scene of the
/// host's, its members count instead. Only the loudness is used; NaN and infinite samples count as silence.
///
/// Threads: one at a time, concurrently with any other call; meant for the recording thread. Never
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

/// Ends the audio: the tail is completed, and `floor(seconds * 30)` frames come out in all. A second
/// call is a no-op.
///
/// Threads: any; not during a push. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pushes), `FAILED`, `CLOSED`,
/// `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_finish(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.finish()?))
}

/// Barge-in: drops everything not shown yet and eases to the rest pose within `ease_ms` milliseconds, at
/// most 10,000. Audio pushed from now on starts a new stream, whose frames follow the ease. The frame
/// index continues, and the avatar stays where it stands. The new stream's first frame is number
/// `last + 1 + ease`: `last` is the last frame handed out by a pull or a sample, and the ease takes
/// `ceil(ease_ms * frame_rate / 1000)` frames. Sample from that time on to see the stream from its start.
/// The new stream blends out of the rest pose over the same number of frames, limited by the session's
/// `ease_ms`; the face takes a quarter of them.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_interrupt(session: *mut UmoSession, ease_ms: u32) -> UmoStatus {
    on(session, |handle| Ok(handle.session.interrupt(Duration::from_millis(ease_ms.into()))?))
}

/// Resets the session to its start: everything pushed and not shown is dropped, the frame index starts
/// at 0, and the output is that of a new session with the same settings.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_reset(session: *mut UmoSession) -> UmoStatus {
    on(session, |handle| Ok(handle.session.reset()?))
}

/// Takes ready frames in order, each once, up to the number that fit in `size` bytes in `layout`. `count`
/// gets the number of frames, 0 if none is ready.
///
/// Threads: one at a time, concurrently with any other call. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (the layout),
/// `UNSUPPORTED` (the layout has visemes, but the model does not), `BUFFER_TOO_SMALL` (not one frame
/// fits), `BUSY` (another thread pulls); `FAILED`, `CLOSED`, `PANIC` once all ready frames have been
/// pulled.
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
            // and at most as many frames are given as fit.
            unsafe { layout.write(frames, written, frame) };
            written += 1;
        })?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(count, "count", pulled) }
    })
}

/// Gets the number of frames that `umo_session_pull_frames` would give.
///
/// Threads: any; not during a pull. Never allocates, never waits.
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

/// Gets the arousal of the voice at the newest frame that was pulled or sampled: how lively it speaks, 0 to 1, ten
/// times a second. It is 0.5 for an ordinary voice, and without one. `trend` is its change per second over the last
/// seconds. `UMO_PARAMETER_EXPRESSION` changes neither.
///
/// Threads: any; not during a pull. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls), `PANIC`.
///
/// # Safety
/// `arousal` and `trend` are NULL or writable; `trend` may be NULL.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_arousal(
    session: *mut UmoSession,
    arousal: *mut f32,
    trend: *mut f32,
) -> UmoStatus {
    on(session, |handle| {
        wanted(arousal, "arousal")?;
        let (value, change) = handle.session.arousal()?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(arousal, "arousal", value)? };
        if !trend.is_null() {
            // SAFETY: guaranteed by the caller (see # Safety).
            unsafe { put(trend, "trend", change)? };
        }
        Ok(())
    })
}

/// Whether the stream has ended: `done` becomes 1 once `umo_session_finish` was called and all frames
/// were handed out by pulls or samples; before that it is 0. This is how a host that only samples learns
/// that no more frames will come.
///
/// Threads: any; not during a pull. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY` (another thread pulls); `FAILED`, `CLOSED`,
/// `PANIC` if the remaining frames will never come.
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

/// Sets the host's time, in seconds from any origin, 0 to 1e9. From the first call on, motion while no
/// frames come, eases to it and back, and `idle_after_ms` follow this time instead of the system's clock.
/// For hosts that render slower or faster than real time, pause, or replay: call it for every picture,
/// before `umo_session_sample_pose`. The time never goes back: an earlier value counts as the latest so
/// far. Only `umo_session_restore` goes back, to the state's time.
///
/// Threads: one at a time, concurrently with any other call except a pull or a sample. Never allocates,
/// never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not in 0 to 1e9), `BUSY` (another
/// thread pulls), `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_clock(session: *mut UmoSession, seconds: f64) -> UmoStatus {
    on(session, |handle| Ok(handle.session.set_clock(seconds)?))
}

/// Interpolates the pose at `seconds` of the motion (frame index / 30), less `UMO_PARAMETER_OUTPUT_DELAY`,
/// for renderers at any rate: rotations take the shorter way, all other values are linear. Frames before
/// that time are consumed, as by `umo_session_pull_frames`. A time before the oldest frame gives the
/// oldest frame; a time after the newest frame gives the pose of the idle mode. The time never goes back:
/// an earlier value counts as the latest so far. `sampled` may be NULL.
///
/// Threads: one at a time, concurrently with any other call except a pull. Never allocates, never waits.
/// Errors: as `umo_session_pull_frames`, and `INVALID_ARGUMENT` for a time that is NaN or infinite.
/// However, a session that failed, or whose engine was freed, continues to give its last pose, and
/// `umo_session_is_done` returns the error.
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
