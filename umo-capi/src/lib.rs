//! The C interface of umo, declared in `include/umo.h`.
//!
//! | module | part |
//! |---|---|
//! | [`model`] | models: loading and properties |
//! | [`engine`] | engines: threads and scheduling |
//! | [`session`] | sessions: audio in, frames out |
//! | [`scene`] | scenes: sessions that know each other |
//! | [`recording`] | level of whole recordings |
//! | [`frame`] | layout of frames in the host's memory |
//! | [`clip`] | export of frames to files |
//! | [`gesture`] | gestures on command |
//! | [`retarget`] | poses on the host's characters |
//! | [`parameter`] | parameters of a running session |
//! | [`self_test`] | test of this machine's results and speed |
//! | [`status`], [`log`] | errors and log messages |
//! | [`memory`] | the host's allocator, for one block of memory per session |
//! | `reserve` | the library's own allocator, with a reserve for small pieces when the system has no memory |
//! | `web` | additional functions for WebAssembly |
//! | `handle`, `ffi` | handles; pointers, structures and panics at the boundary |
#![expect(clippy::result_large_err, reason = "an audio thread's failure may not allocate its detail")]

pub mod engine;
mod ffi;
pub mod frame;
pub mod gesture;
mod handle;
#[cfg(all(test, target_pointer_width = "64"))]
mod layout;
pub mod log;
pub mod memory;
pub mod model;
pub mod parameter;
pub mod recording;
#[cfg(feature = "reserve")]
mod reserve;
pub mod self_test;
pub mod session;
pub mod status;
#[cfg(all(target_family = "wasm", target_os = "unknown"))]
pub mod web;

// Last, so that umo.h declares them after the types they use.
pub mod scene;

pub mod clip;
pub mod retarget;

use std::ffi::c_char;

use umo_core_pose::axes::Axes;

use status::Failure;

/// Version of this interface: major number in the upper 16 bits, minor number in the lower. A library
/// serves programs with the same major number and at most its own minor number.
pub const UMO_ABI_VERSION: u32 = 1;

/// glTF and Godot: Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X.
pub const UMO_AXES_GLTF: u32 = 0;
/// Unreal: Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.
pub const UMO_AXES_UNREAL: u32 = 1;
/// Unity: Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X.
pub const UMO_AXES_UNITY: u32 = 2;

pub(crate) fn axes(which: u32) -> Result<Axes, Failure> {
    match which {
        UMO_AXES_GLTF => Ok(Axes::Gltf),
        UMO_AXES_UNREAL => Ok(Axes::Unreal),
        UMO_AXES_UNITY => Ok(Axes::Unity),
        _ => Err(Failure::argument(format_args!("axes {which} is not one of UMO_AXES_…"))),
    }
}

/// Reads an optional plain structure of the host's; `None` for NULL.
///
/// # Safety
/// `from` is NULL or readable.
pub(crate) unsafe fn read_if_given<T: Copy>(from: *const T, what: &str) -> Result<Option<T>, Failure> {
    if from.is_null() {
        return Ok(None);
    }
    // SAFETY: one value is readable guaranteed by the caller (see # Safety).
    Ok(unsafe { ffi::slice(from, 1, what)? }.first().copied())
}

/// Returns the library's `UMO_ABI_VERSION`, for programs that load the library at run time.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_abi_version() -> u32 {
    UMO_ABI_VERSION
}

/// Returns the library's version, such as `0.1.0`, as a static string.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
