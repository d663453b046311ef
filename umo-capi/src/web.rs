//! Additional functions for WebAssembly: memory for the program outside of the module, which has no other
//! allocator there, and characters that follow poses.

use std::alloc::{Layout, alloc, dealloc};
use std::ffi::{CString, c_char};
use std::sync::{Mutex, PoisonError};

use umo_core::{JOINTS, Pose};
use umo_core_rig::glb::{FollowScratch, Follower};

use crate::ffi::{self, guard};
use crate::handle::{self, Table};
use crate::status::{Failure, UmoStatus};

/// Maximum number of characters at once.
const MAX_CHARACTERS: usize = 1024;

/// Alignment of memory from [`umo_web_allocate`].
const ALIGNMENT: usize = 16;

/// Returns `size` bytes aligned to 16, or NULL.
#[unsafe(no_mangle)]
pub extern "C" fn umo_web_allocate(size: usize) -> *mut u8 {
    match Layout::from_size_align(size.max(1), ALIGNMENT) {
        // SAFETY: the size is not 0.
        Ok(layout) => unsafe { alloc(layout) },
        Err(_) => std::ptr::null_mut(),
    }
}

/// Releases memory from [`umo_web_allocate`]. NULL is fine.
///
/// # Safety
/// `memory` is NULL, or from [`umo_web_allocate`] with the same size, and not freed yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn umo_web_free(memory: *mut u8, size: usize) {
    if let (false, Ok(layout)) = (memory.is_null(), Layout::from_size_align(size.max(1), ALIGNMENT)) {
        // SAFETY: it was allocated with this layout, guaranteed by the caller (see # Safety).
        unsafe { dealloc(memory, layout) }
    }
}

/// A character that follows poses, and a buffer for its values.
struct Character {
    follower: Follower,
    /// JSON text, zero-terminated.
    description: CString,
    channels: usize,
    room: Mutex<(FollowScratch, Vec<f32>)>,
}

static CHARACTERS: Table<Character, MAX_CHARACTERS> = Table::new(4, "character");

/// Reads a character from a `.glb` file of `size` bytes, to follow poses of the kind that `source` describes
/// (`umo_core_rig::glb::Follower::read`). Both are read during the call. `description` is JSON, valid
/// until the character is freed.
///
/// # Safety
/// `file` is NULL or has `size` readable bytes; `source` is NULL or ends with a zero byte; the
/// others are NULL or writable.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn umo_web_character_new(
    file: *const u8,
    size: usize,
    source: *const c_char,
    character: *mut usize,
    description: *mut *const c_char,
) -> UmoStatus {
    guard(|| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let file = unsafe { ffi::slice(file, size, "file")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let source = unsafe { ffi::string(source, "source")? };
        let (follower, described) = Follower::read(file, source).map_err(Failure::argument)?;
        let text = CString::new(described.to_string()).map_err(Failure::argument)?;
        let room = Mutex::new((follower.scratch(), Vec::new()));
        let channels =
            usize::try_from(described["channels"].as_u64().unwrap_or_default()).map_err(Failure::argument)?;
        let handle = CHARACTERS.insert(handle::boxed(Character { follower, description: text, channels, room })?)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::put(description, "description", CHARACTERS.get(handle)?.description.as_ptr())? };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::put(character, "character", handle) }
    })
}

/// Applies a pose to a character, `seconds` after the last one: `pose` has the rotations of the 55 joints, the root translation and the
/// face channels. `values` gets the rotations of the moved nodes, the translation of the hips, the weights
/// of each node's morph targets, and the weights of the expressions; `count` must be their number.
///
/// # Safety
/// `pose` has 223 readable floats plus one for each face channel; `values` has `count` writable floats.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn umo_web_character_apply(
    character: usize,
    seconds: f32,
    pose: *const f32,
    values: *mut f32,
    count: usize,
) -> UmoStatus {
    guard(|| {
        let character = CHARACTERS.get(character)?;
        let body = 4 * JOINTS + 3;
        // SAFETY: guaranteed by the caller (see # Safety).
        let pose = unsafe { ffi::slice(pose, body + character.channels, "pose")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let out = unsafe { ffi::slice_mut(values, count, "values")? };
        let (body, face) = pose.split_at(body);
        let mut at = Pose::REST;
        let (rotations, translation) = body.split_at(4 * JOINTS);
        at.rotations.as_flattened_mut().copy_from_slice(rotations);
        at.translation.copy_from_slice(translation);
        let mut room = character.room.lock().unwrap_or_else(PoisonError::into_inner);
        let (scratch, made) = &mut *room;
        scratch.set_step(seconds);
        made.clear();
        character.follower.add(scratch, &at, face, made).map_err(Failure::argument)?;
        made.extend(character.follower.faces().expressions(face).map(|(_, amount)| amount));
        if made.len() != out.len() {
            return Err(Failure::argument(format_args!("{} values, not {}", made.len(), out.len())));
        }
        out.copy_from_slice(made);
        Ok(())
    })
}

/// Frees a character.
#[unsafe(no_mangle)]
pub extern "C" fn umo_web_character_free(character: usize) -> UmoStatus {
    guard(|| CHARACTERS.remove(character).map(drop))
}
