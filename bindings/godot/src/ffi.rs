//! The part of `umo.h` that this extension uses, and the library itself. It is opened while the game runs: a project
//! without it still starts, and its avatars report what is missing.
//!
//! `tests/layout.c` checks the sizes and offsets at the end of this file against the header.

use std::ffi::{CStr, c_char, c_void};
use std::path::{Path, PathBuf};

/// `UMO_ABI_VERSION` of the header that this file follows.
pub(crate) const ABI_VERSION: u32 = 1;
/// `UMO_STATUS_BUSY`.
pub(crate) const STATUS_BUSY: Status = -11;
pub(crate) const AXES_GLTF: u32 = 0;
pub(crate) const ABSENT: u32 = u32::MAX;
pub(crate) const MODEL_NOTICE: u32 = 3;
pub(crate) const PARAMETER_IDLE: u32 = 4;
pub(crate) const PARAMETER_ATTENTION: u32 = 5;
pub(crate) const PARAMETER_OUTPUT_DELAY: u32 = 6;
pub(crate) const PARAMETER_GAIN_FACE: u32 = 16;
pub(crate) const PARAMETER_GAIN_HANDS: u32 = 17;
pub(crate) const PARAMETER_GAIN_UPPER: u32 = 18;
pub(crate) const PARAMETER_GAIN_LOWER: u32 = 19;
pub(crate) const PARAMETER_LAYER_GAZE: u32 = 32;
pub(crate) const PARAMETER_LAYER_IDLE: u32 = 33;
pub(crate) const PARAMETER_LAYER_ASYMMETRY: u32 = 34;
pub(crate) const PARAMETER_LAYER_NODS: u32 = 35;
pub(crate) const PARAMETER_LAYER_MOOD: u32 = 36;
pub(crate) const PARAMETER_LAYER_FEET: u32 = 37;
pub(crate) const VOICE_DELAYED: u32 = 0;
pub(crate) const VOICE_LIVE: u32 = 1;
pub(crate) const JOINTS: usize = 55;
pub(crate) const VISEMES: usize = 15;
pub(crate) const ERROR_SIZE: usize = 512;

pub(crate) type Status = i32;
/// `umo_model`, `umo_engine`, `umo_session`: opaque handles, never pointers to memory.
pub(crate) type Handle = *mut c_void;

#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct EngineConfig {
    pub(crate) struct_size: u32,
    pub(crate) mode: u32,
    pub(crate) threads: u32,
    pub(crate) max_sessions: u32,
    pub(crate) max_batch: u32,
    pub(crate) core_count: u32,
    pub(crate) cores: *const u32,
    pub(crate) jobs: *const c_void,
    pub(crate) log: *const c_void,
    pub(crate) priority: u32,
    pub(crate) gather_ms: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct FrameLayout {
    pub(crate) struct_size: u32,
    pub(crate) axes: u32,
    pub(crate) frame_stride: u32,
    pub(crate) index: u32,
    pub(crate) sample: u32,
    pub(crate) translation: u32,
    pub(crate) rotations: u32,
    pub(crate) rotation_stride: u32,
    pub(crate) channels: u32,
    pub(crate) channel_stride: u32,
    pub(crate) visemes: u32,
    pub(crate) reserved: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct ModelInfo {
    pub(crate) struct_size: u32,
    pub(crate) frame_rate: u32,
    pub(crate) sample_rate: u32,
    pub(crate) joints: u32,
    pub(crate) channels: u32,
    pub(crate) is_arkit: u32,
    pub(crate) keyframe_stride: u32,
    pub(crate) target: u32,
    pub(crate) max_target: u32,
    pub(crate) lookahead: u32,
    pub(crate) latency_frames: u32,
    pub(crate) max_prompt: u32,
    pub(crate) has_text: u32,
    pub(crate) has_notice: u32,
    pub(crate) file_size: u64,
    pub(crate) has_mouth: u32,
    pub(crate) max_horizon: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct SessionConfig {
    pub(crate) struct_size: u32,
    pub(crate) sample_rate: u32,
    pub(crate) channels: u32,
    pub(crate) target: u32,
    pub(crate) lookahead: u32,
    pub(crate) idle: u32,
    pub(crate) idle_after_ms: u32,
    pub(crate) ease_ms: u32,
    pub(crate) queue_frames: u32,
    pub(crate) voice: u32,
    pub(crate) seed: u64,
    pub(crate) template_name: *const c_char,
    pub(crate) allocator: *const c_void,
    pub(crate) smoothing: f32,
    pub(crate) guidance: f32,
    pub(crate) horizon: u32,
    pub(crate) packets: u32,
    pub(crate) packet_history: u32,
    pub(crate) patience: u32,
}

#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct GestureOptions {
    pub(crate) struct_size: u32,
    pub(crate) side: u32,
    pub(crate) axes: u32,
    pub(crate) has_target: u32,
    pub(crate) at: f64,
    pub(crate) speed: f32,
    pub(crate) strength: f32,
    pub(crate) target: [f32; 3],
    pub(crate) reserved: u32,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Sampled {
    pub(crate) struct_size: u32,
    pub(crate) is_ahead: u32,
    pub(crate) oldest: f64,
    pub(crate) newest: f64,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Latency {
    pub(crate) struct_size: u32,
    pub(crate) reserved: u32,
    pub(crate) algorithmic_samples: u64,
    pub(crate) compute_p50: f64,
    pub(crate) compute_p99: f64,
    pub(crate) compute_p999: f64,
    pub(crate) compute_max: f64,
    pub(crate) backlog_samples: u64,
    pub(crate) backlog_max_samples: u64,
    pub(crate) mouth_samples: u64,
}

#[repr(C)]
#[derive(Clone, Copy, Default)]
pub(crate) struct Stats {
    pub(crate) struct_size: u32,
    pub(crate) reserved: u32,
    pub(crate) chunks: u64,
    pub(crate) frames: u64,
    pub(crate) late_frames: u64,
    pub(crate) dropped_frames: u64,
    pub(crate) overruns: u64,
    pub(crate) silenced: u64,
    pub(crate) held_chunks: u64,
}

/// Declares the library's functions by their names in `umo.h`, without `umo_`.
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
    session_is_done(Handle, *mut u32) -> Status;
    session_set_clock(Handle, f64) -> Status;
    session_sample_pose(Handle, f64, *const FrameLayout, *mut f32, usize, *mut Sampled) -> Status;
    session_set_prompt(Handle, *const u8, usize) -> Status;
    session_set_seed(Handle, u64) -> Status;
    session_look_at(Handle, u32, *const f32, f32) -> Status;
    session_set_mood(Handle, u32, f32) -> Status;
    session_hint_lips(Handle, u32, f64, f64) -> Status;
    session_play_gesture(Handle, *const c_char, *const GestureOptions) -> Status;
    session_set_parameter(Handle, u32, f64) -> Status;
    session_state_size(Handle, *mut usize) -> Status;
    session_save(Handle, *mut u8, usize, *mut usize) -> Status;
    session_restore(Handle, *const u8, usize) -> Status;
    session_latency(Handle, *mut Latency) -> Status;
    session_stats(Handle, *mut Stats) -> Status;
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

#[cfg(target_pointer_width = "64")]
const _: () = {
    use std::mem::{offset_of, size_of};
    assert!(size_of::<EngineConfig>() == 56 && offset_of!(EngineConfig, priority) == 48);
    assert!(size_of::<FrameLayout>() == 48 && offset_of!(FrameLayout, visemes) == 40);
    assert!(size_of::<ModelInfo>() == 72 && offset_of!(ModelInfo, has_mouth) == 64);
    assert!(size_of::<SessionConfig>() == 88 && offset_of!(SessionConfig, seed) == 40);
    assert!(offset_of!(SessionConfig, voice) == 36 && offset_of!(SessionConfig, horizon) == 72);
    assert!(size_of::<GestureOptions>() == 48 && offset_of!(GestureOptions, target) == 32);
    assert!(size_of::<Sampled>() == 24 && offset_of!(Sampled, newest) == 16);
    assert!(size_of::<Latency>() == 72 && offset_of!(Latency, mouth_samples) == 64);
    assert!(size_of::<Stats>() == 64 && offset_of!(Stats, held_chunks) == 56);
};
