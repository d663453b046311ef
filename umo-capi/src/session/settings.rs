//! Settings and statistics of a running session.

use std::ffi::c_char;

use umo_core::SessionError;

use super::{UmoLatency, UmoSession, UmoStats, on};
use crate::ffi::{self, put};
use crate::gesture::{self, UmoGestureOptions};
use crate::status::{Failure, UmoStatus};
use crate::{model, parameter};

/// Sets the prompt from the next chunk on: `length` bytes of UTF-8, at most 128 ids' worth. An empty text
/// removes the prompt. The engine's log gets a warning if the model has a list of prompts that lacks `text`.
///
/// Threads: any but the audio thread. Allocates: `umo_session_set_prompt_ids` does not.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts),
/// `INVALID_ARGUMENT` (not UTF-8, too long), `OUT_OF_MEMORY`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        let text = unsafe { ffi::slice(text.cast::<u8>(), length, "text")? };
        let ids = model::inspect::encode(&handle.model, handle.log, text)?;
        Ok(handle.session.set_prompt(&ids)?)
    })
}

/// Sets the prompt from the next chunk on, as ids from `umo_model_encode_text`.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (too many, or one that the model
/// does not have), `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        let ids = unsafe { ffi::slice(ids, count, "ids")? };
        let limit = handle.model.model.config().vocab.size;
        if let Some(id) = ids.iter().find(|&&id| id as usize >= limit) {
            return Err(Failure::argument(format_args!("id {id}: the model has {limit}")));
        }
        Ok(handle.session.set_prompt(ids)?)
    })
}

/// Sets the seed of sampling from the next chunk on.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_seed(session: *mut UmoSession, seed: u64) -> UmoStatus {
    on(session, |handle| Ok(handle.session.set_seed(seed)?))
}

/// Sets a parameter, one of `UMO_PARAMETER_…`, within its range from `umo_parameter_get_info`. Sampling
/// changes with the next chunk, the idle mode and gains with the next frame that is handed out.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `FAILED`, `CLOSED`,
/// `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_parameter(session: *mut UmoSession, parameter: u32, value: f64) -> UmoStatus {
    on(session, |handle| parameter::set(&handle.session, parameter, value))
}

/// Gets a parameter's value.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(value, "value", found) }
    })
}

/// Looks at a point from the next frame on: `point` is three coordinates in the avatar's space, in
/// the axes and units of `axes` (`UMO_AXES_…`), `strength` 0 to 1. The eyes turn first, then the
/// head, then the trunk, within the limits of the body. A strength of 0 ends it. The point may be set
/// again for every frame.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (unknown axes, a coordinate that is
/// not finite or beyond 10 km, a strength outside 0 to 1), `BUSY`, `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `point` is NULL or has three readable values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_look_at(
    session: *mut UmoSession,
    axes: u32,
    point: *const f32,
    strength: f32,
) -> UmoStatus {
    on(session, |handle| {
        let axes = crate::axes(axes)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let point = unsafe { ffi::slice(point, 3, "point")? };
        Ok(handle.session.look_at(axes.place_from([point[0], point[1], point[2]]), strength)?)
    })
}

/// Sets the mood of face and posture from the next frame on: `mood` is one of `UMO_MOOD_…`,
/// `strength` 0 to 1. Changes are blended over a second.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUSY`, `FAILED`, `CLOSED`,
/// `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_set_mood(session: *mut UmoSession, mood: u32, strength: f32) -> UmoStatus {
    on(session, |handle| Ok(handle.session.set_mood(parameter::mood(mood)?, strength)?))
}

/// Schedules a viseme hint, for a sound that is visible on the lips (bilabial, labiodental, rounded):
/// `shape` is one of `UMO_LIPS_…`, `start` and `duration` are seconds of the audio pushed since the
/// session began or was reset. The lips are in the shape during that time, and reach and leave it within
/// 60 ms, whatever the model does. Models without ARKit blendshapes ignore hints. Hints may come in any
/// order, before or after their audio; a hint whose frames were pulled already has no effect.
/// `umo_session_interrupt` drops pending hints.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (an unknown shape, a start that is
/// negative or not a number, or a duration outside 0 to 2), `BUSY` (64 hints are pending: call again
/// when the time of one has passed; or another thread is in a setter), `FAILED`, `CLOSED`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_session_hint_lips(session: *mut UmoSession, shape: u32, start: f64, duration: f64) -> UmoStatus {
    on(session, |handle| Ok(handle.session.hint_lips(parameter::lips(shape)?, start, duration)?))
}

/// Gives the words of `text` and their time, `start` to `end` in seconds of the audio pushed since the session
/// began or was reset: usually one word with its punctuation; several share the time by their syllables. By the
/// engine's rules (`umo_engine_set_word_rules`) some words become gestures, whose stroke falls on the stressed
/// vowel; those of `umo_session_play_gesture` come first. Words may come in any order, before or after their
/// audio; one that comes less than 1.6 seconds before its frame may be gestured late or not at all.
/// `umo_session_interrupt` drops pending words.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (not UTF-8, more than 64 words, a start that is
/// negative or not a number, or an end that is not 0 to 30 seconds later), `BUSY` (more than 64 words would be
/// pending: call again when the time of some has come; or another thread is in a setter), `FAILED`, `CLOSED`,
/// `PANIC`.
///
/// # Safety
/// `text` is NULL or ends with a zero byte.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_hint_words(
    session: *mut UmoSession,
    text: *const c_char,
    start: f64,
    end: f64,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let text = unsafe { ffi::string(text, "text")? };
        Ok(handle.session.hint_words(text, start, end)?)
    })
}

/// Plays a gesture over the model's motion: the parts of the body that it moves ease to it and back, the
/// others continue. `name` is one that `umo_engine_get_gesture_name` lists; upper case counts as lower
/// case, and spaces and hyphens as underscores. Gestures of the same parts follow each other in the order
/// of the calls; one with a time takes their place. `umo_session_interrupt` releases the playing gesture
/// and drops pending ones. `options` may be NULL.
///
/// Threads: any. Never allocates; waits at most for another thread's setter.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (unknown name, or an
/// option out of range), `BUSY` (eight gestures are pending: call again when one has begun; or another
/// thread is in a setter), `FAILED`, `CLOSED`, `PANIC`.
///
/// # Safety
/// `name` is NULL or ends with a zero byte; `options` is NULL or as long as its `struct_size` says.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_session_play_gesture(
    session: *mut UmoSession,
    name: *const c_char,
    options: *const UmoGestureOptions,
) -> UmoStatus {
    on(session, |handle| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let name = unsafe { ffi::string(name, "name")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let options = unsafe { gesture::options(options)? };
        match handle.session.play_gesture(name, &options) {
            Err(SessionError::UnknownGesture) => Err(Failure::argument(format_args!(
                "unknown gesture `{name}`: umo_engine_get_gesture_name lists the names"
            ))),
            other => Ok(other?),
        }
    })
}

/// Gets the delay of motion behind speech.
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
            backlog_samples: found.backlog_samples,
            backlog_max_samples: found.backlog_max_samples,
            mouth_samples: found.mouth_samples as u64,
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(latency, "latency", &value) }
    })
}

/// Gets statistics of the session.
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
            held_chunks: found.held_chunks,
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(stats, "stats", &value) }
    })
}
