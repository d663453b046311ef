//! The part of `umo.h` that this extension uses, and the library itself. It is opened while the game runs: a project
//! without it still starts, and its avatars report what is missing.
//!
//! `tests/layout.c` checks the sizes and offsets at the end of this file against the header.

use std::ffi::{CStr, c_char, c_void};
use std::path::{Path, PathBuf};

mod generated;

pub(crate) use generated::*;

pub(crate) type Status = i32;
/// `umo_model`, `umo_engine`, `umo_session`, `umo_take`, `umo_scene`, `umo_retarget`: opaque handles, never pointers to memory.
pub(crate) type Handle = *mut c_void;

/// The library's functions by their names in `umo.h`, without `umo_`.
macro_rules! library {
    ($($name:ident($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The opened library.
        pub(crate) struct Library {
            $(pub(crate) $name: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
            _file: libloading::Library,
        }

        impl Library {
            fn open(path: &Path) -> Result<Self, String> {
                // SAFETY: opening libumo runs no initialisation code.
                let file = unsafe { libloading::Library::new(path) }.map_err(|error| error.to_string())?;
                Ok(Self {
                    $($name: {
                        let name = concat!("umo_", stringify!($name), "\0").as_bytes();
                        // SAFETY: `umo.h` declares the function with these types; versions are
                        // checked before any call.
                        *unsafe { file.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>(name) }
                            .map_err(|error| error.to_string())?
                    },)*
                    _file: file,
                })
            }
        }
    };
}

library! {
    abi_version() -> u32;
    status_message(Status) -> *const c_char;
    last_error() -> *const c_char;
    joint_name(u32) -> *const c_char;
    viseme_name(u32) -> *const c_char;
    engine_config_init(*mut EngineConfig, usize) -> Status;
    engine_new(Handle, *const EngineConfig, *mut Handle) -> Status;
    engine_free(Handle) -> Status;
    engine_add_gesture_memory(Handle, *const c_char, *const u8, usize, *const c_char, u32, f32) -> Status;
    engine_set_word_rules(Handle, *const c_char, *const c_char) -> Status;
    engine_get_gesture_name(Handle, u32, *mut *const c_char) -> Status;
    gesture_options_init(*mut GestureOptions, usize) -> Status;
    model_load_memory(u32, *const u8, usize, *const c_void, *mut Handle) -> Status;
    model_free(Handle) -> Status;
    model_get_info(Handle, *mut ModelInfo) -> Status;
    model_get_text(Handle, u32, *mut *const c_char) -> Status;
    model_get_channel_name(Handle, u32, *mut *const c_char) -> Status;
    model_get_skeleton(Handle, u32, *mut i32, *mut f32, usize) -> Status;
    session_config_init(*mut SessionConfig, usize, Handle) -> Status;
    session_new(Handle, *const SessionConfig, *mut Handle) -> Status;
    session_free(Handle) -> Status;
    session_last_error(Handle, *mut c_char, usize, *mut usize) -> Status;
    session_push_audio(Handle, *const f32, usize, *mut usize) -> Status;
    session_push_audio_i16(Handle, *const i16, usize, *mut usize) -> Status;
    session_push_other_audio(Handle, *const f32, usize) -> Status;
    session_finish(Handle) -> Status;
    session_interrupt(Handle, u32) -> Status;
    session_reset(Handle) -> Status;
    session_pull_frames(Handle, *const FrameLayout, *mut f32, usize, *mut usize) -> Status;
    session_ready_frames(Handle, *mut usize) -> Status;
    session_arousal(Handle, *mut f32, *mut f32) -> Status;
    session_is_done(Handle, *mut u32) -> Status;
    session_set_clock(Handle, f64) -> Status;
    session_sample_pose(Handle, f64, *const FrameLayout, *mut f32, usize, *mut Sampled) -> Status;
    session_set_prompt(Handle, *const u8, usize) -> Status;
    session_set_seed(Handle, u64) -> Status;
    session_look_at(Handle, u32, *const f32, f32) -> Status;
    session_set_mood(Handle, u32, f32) -> Status;
    session_hint_lips(Handle, u32, f64, f64) -> Status;
    session_hint_words(Handle, *const c_char, f64, f64) -> Status;
    session_play_gesture(Handle, *const c_char, *const GestureOptions) -> Status;
    session_set_parameter(Handle, u32, f64) -> Status;
    session_state_size(Handle, *mut usize) -> Status;
    session_save(Handle, *mut u8, usize, *mut usize) -> Status;
    session_restore(Handle, *const u8, usize) -> Status;
    take_new(*const u8, usize, *mut Handle) -> Status;
    take_free(Handle) -> Status;
    decoder_new_of_take(Handle, Handle, *const SessionConfig, *mut Handle) -> Status;
    decoder_push_take(Handle, *mut u32) -> Status;
    session_latency(Handle, *mut Latency) -> Status;
    session_stats(Handle, *mut Stats) -> Status;
    rig_init(*mut Rig, usize) -> Status;
    retarget_new(Handle, *const Rig, *mut Handle) -> Status;
    retarget_free(Handle) -> Status;
    retarget_set_step(Handle, f32) -> Status;
    retarget_apply(Handle, *const f32, *const f32, u32, *mut f32, *mut f32) -> Status;
    scene_new(u64, *mut Handle) -> Status;
    scene_free(Handle) -> Status;
    scene_last_error(Handle, *mut c_char, usize, *mut usize) -> Status;
    scene_add(Handle, Handle, *const Place, *mut u32) -> Status;
    scene_remove(Handle, u32) -> Status;
    scene_set_place(Handle, u32, *const Place) -> Status;
    scene_set_target(Handle, u32, u32, u32, *const f32) -> Status;
    scene_set_allowed(Handle, u32, u32) -> Status;
    scene_push_audio(Handle, u32, *const f32, usize) -> Status;
    scene_update(Handle, f64) -> Status;
    scene_floor(Handle, *mut u32) -> Status;
    scene_member(Handle, u32, *mut Member) -> Status;
    scene_state_size(Handle, *mut usize) -> Status;
    scene_save(Handle, *mut u8, usize, *mut usize) -> Status;
    scene_restore(Handle, *const u8, usize) -> Status;
}

impl Library {
    /// Opens the first of `places` that has our version; it stays open.
    pub(crate) fn find(places: &[PathBuf]) -> Result<&'static Self, String> {
        let mut tried = String::new();
        for place in places {
            match Self::open(place) {
                Ok(library) => {
                    // SAFETY: takes nothing.
                    let version = unsafe { (library.abi_version)() };
                    if version >> 16 == ABI_VERSION >> 16 && version & 0xffff >= ABI_VERSION & 0xffff {
                        return Ok(Box::leak(Box::new(library)));
                    }
                    tried += &format!("\n    {}: has interface {version:#x}, not {ABI_VERSION:#x}", place.display());
                }
                Err(error) => tried += &format!("\n    {error}"),
            }
        }
        Err(format!("umo's library was not found or cannot be used:{tried}"))
    }
}

/// Value of a structure's `struct_size`.
#[expect(clippy::cast_possible_truncation, reason = "a structure has a few bytes")]
pub(crate) const fn size<T>() -> u32 {
    size_of::<T>() as u32
}

/// Copies a text of the library, empty if it is NULL.
///
/// # Safety
///
/// `text` is NULL or ends with a zero byte, and lives until this returns.
pub(crate) unsafe fn text(text: *const c_char) -> String {
    if text.is_null() {
        return String::new();
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}
