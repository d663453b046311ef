//! Properties of a model: numbers, texts, skeleton; ids of prompts.

use std::ffi::c_char;

use umo_core::{JOINT_NAMES, JOINTS, VISEME_NAMES, VISEMES};
use umo_core_base::memory;
use umo_core_pose::axes::Axes;

use super::{ModelHandle, UmoModel, UmoModelInfo, get};
use crate::axes;
use crate::ffi::{self, guard, put, wanted};
use crate::log::{Log, UMO_LOG_WARNING};
use crate::status::{Failure, UMO_STATUS_BUFFER_TOO_SMALL, UMO_STATUS_UNSUPPORTED, UmoStatus};

/// Zero-terminated names of the joints.
static JOINT_TEXTS: [Name; JOINTS] = names(JOINT_NAMES);
/// Zero-terminated names of the visemes.
static VISEME_TEXTS: [Name; VISEMES] = names(VISEME_NAMES);

/// A short zero-terminated text.
pub(crate) type Name = [u8; 24];

pub(crate) const fn names<const N: usize>(texts: [&str; N]) -> [Name; N] {
    let mut names = [[0; 24]; N];
    let mut i = 0;
    while i < N {
        let (text, mut at) = (texts[i].as_bytes(), 0);
        assert!(text.len() < 24);
        while at < text.len() {
            names[i][at] = text[at];
            at += 1;
        }
        i += 1;
    }
    names
}

/// Gets the properties of a model.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`.
///
/// # Safety
/// `info` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_get_info(model: *const UmoModel, info: *mut UmoModelInfo) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::write(info, "info", &get(model)?.info) })
}

/// Gets one of the model's texts, UTF-8, valid until the model is freed. `which` is one of `UMO_MODEL_…`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`.
///
/// # Safety
/// `text` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_get_text(model: *const UmoModel, which: u32, text: *mut *const c_char) -> UmoStatus {
    guard(|| {
        let model = get(model)?;
        let unknown = || Failure::argument(format_args!("text {which} is not one of UMO_MODEL_…"));
        let found = (which as usize).checked_sub(1).and_then(|index| model.texts.get(index)).ok_or_else(unknown)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(text, "text", found.as_ptr()) }
    })
}

/// Gets the name of a face channel, such as `jawOpen`, valid until the model is freed. `index` is below
/// `umo_model_info.channels`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT`.
///
/// # Safety
/// `name` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_get_channel_name(
    model: *const UmoModel,
    index: u32,
    name: *mut *const c_char,
) -> UmoStatus {
    guard(|| {
        let model = get(model)?;
        let none = || Failure::argument(format_args!("channel {index}: there are {}", model.channels.len()));
        let found = model.channels.get(index as usize).ok_or_else(none)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(name, "name", found.as_ptr()) }
    })
}

/// Returns the name of a joint, such as `left_elbow`: static, or NULL if `index` is not below
/// `UMO_JOINT_COUNT`.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_joint_name(index: u32) -> *const c_char {
    JOINT_TEXTS.get(index as usize).map_or(std::ptr::null(), |name| name.as_ptr().cast())
}

/// Returns the name of a viseme of the Oculus set, such as `PP`: static, or NULL if `index` is not below
/// `UMO_VISEME_COUNT`.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_viseme_name(index: u32) -> *const c_char {
    VISEME_TEXTS.get(index as usize).map_or(std::ptr::null(), |name| name.as_ptr().cast())
}

/// Gets the skeleton: for each joint its parent's index, -1 for the first, and its rest position in its
/// parent's frame, x y z, in the axes and units of `which` (one of `UMO_AXES_…`). Either array may be
/// NULL; `joints` is their capacity in joints, at least `UMO_JOINT_COUNT`. If all rotations are the
/// identity, the body stands in a T-pose.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT`, `BUFFER_TOO_SMALL`.
///
/// # Safety
/// `parents` is NULL or has room for `joints` values; `offsets` is NULL or has room for
/// `3 * joints` values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_get_skeleton(
    model: *const UmoModel,
    which: u32,
    parents: *mut i32,
    offsets: *mut f32,
    joints: usize,
) -> UmoStatus {
    guard(|| {
        let (model, axes) = (get(model)?, axes(which)?);
        if joints < JOINTS {
            let what = format_args!("there is room for {joints} joints, the body has {JOINTS}");
            return Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what));
        }
        let skeleton = &model.model.config().skeleton;
        if !parents.is_null() {
            // SAFETY: guaranteed by the caller (see # Safety).
            unsafe { ffi::slice_mut(parents, JOINTS, "parents")? }.copy_from_slice(&skeleton.parents);
        }
        if !offsets.is_null() {
            // SAFETY: guaranteed by the caller (see # Safety).
            let offsets = unsafe { ffi::slice_mut(offsets, 3 * JOINTS, "offsets")? };
            for (slot, &offset) in offsets.as_chunks_mut().0.iter_mut().zip(&skeleton.offsets_m) {
                *slot = Axes::place(axes, offset);
            }
        }
        Ok(())
    })
}

/// Encodes a prompt as ids for `umo_session_set_prompt_ids`, at most `umo_model_info.max_prompt` of
/// them. `count` is written even if `capacity` is too small. The model's log gets a warning if the model has a
/// list of prompts that lacks `text`.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `UNSUPPORTED` (the model takes no texts),
/// `INVALID_ARGUMENT` (too long), `OUT_OF_MEMORY`, `BUFFER_TOO_SMALL`.
///
/// # Safety
/// `text` is NULL or has `length` readable bytes; `ids` is NULL or has room for `capacity` values;
/// `count` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_model_encode_text(
    model: *const UmoModel,
    text: *const c_char,
    length: usize,
    ids: *mut u32,
    capacity: usize,
    count: *mut usize,
) -> UmoStatus {
    guard(|| {
        wanted(count, "count")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let text = unsafe { ffi::slice(text.cast::<u8>(), length, "text")? };
        let model = get(model)?;
        let found = encode(&model, model.log, text)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(count, "count", found.len())? };
        if found.len() > capacity {
            let what = format_args!("the text has {} ids, there is room for {capacity}", found.len());
            return Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what));
        }
        // SAFETY: guaranteed by the caller (see # Safety), as there are at most `capacity` ids.
        unsafe { ffi::slice_mut(ids, found.len(), "ids")? }.copy_from_slice(&found);
        Ok(())
    })
}

/// Encodes a text as ids; refuses bytes that are not UTF-8. `log` gets a warning if the model was not trained with it.
pub(crate) fn encode(model: &ModelHandle, log: Log, text: &[u8]) -> Result<Vec<u32>, Failure> {
    if text.len() > ffi::MAX_TEXT {
        return Err(Failure::argument(format_args!("`text` has more than {} bytes", ffi::MAX_TEXT)));
    }
    let text = std::str::from_utf8(text).map_err(|_| Failure::argument("`text` is not UTF-8"))?;
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let none = || Failure::new(UMO_STATUS_UNSUPPORTED, "this model takes no texts");
    let model = &model.model;
    let (ids, unknown) = memory::catch(|| {
        // The encoder allocates the normalised text, and a step of its search for each byte of it.
        memory::check(128 * text.len() + memory::SPARE)?;
        let ids = model.text().ok_or_else(none)?.encode(text).map_err(Failure::argument)?;
        Ok::<_, Failure>((ids, model.config().unknown_prompt(text)))
    })??;
    if let Some(prompts) = unknown {
        log.say(UMO_LOG_WARNING, format_args!("the model was not trained with the prompt `{text}`: {prompts}"));
    }
    Ok(ids)
}
