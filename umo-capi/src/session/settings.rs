//! What is set and asked while a session runs.

use std::ffi::c_char;

use super::{UmoLatency, UmoSession, UmoStats, on};
use crate::ffi::{self, put};
use crate::status::{Failure, UmoStatus};
use crate::{model, parameter};

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
        Ok(handle.session.set_prompt(&model::inspect::encode(&handle.model.model, text)?)?)
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
            backlog_samples: found.backlog_samples,
            backlog_max_samples: found.backlog_max_samples,
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
