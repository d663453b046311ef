//! The C interface of umo: what `include/umo.h` declares.
//!
//! | module | what it holds |
//! |---|---|
//! | [`model`] | models: loading, what they have |
//! | [`engine`] | engines: who computes |
//! | [`session`] | sessions: audio in, frames out |
//! | [`recording`] | whole recordings: their level |
//! | [`frame`] | where a frame's values go in the host's memory |
//! | [`clip`] | frames as a file |
//! | [`gesture`] | gestures on command |
//! | [`parameter`] | what can be set while a session runs |
//! | [`self_test`] | whether this machine computes rightly |
//! | [`status`], [`log`] | what went wrong, and who is told |
//! | [`memory`] | one block of memory for each session; the host's allocator |
//! | `reserve` | the library's own allocator: memory for small pieces where the system has none |
//! | `web` | memory for a page, in WebAssembly alone |
//! | `handle`, `ffi` | handles; pointers, structures and panics at the boundary |
#![expect(clippy::result_large_err, reason = "an audio thread's failure may not allocate its detail")]

pub mod engine;
mod ffi;
pub mod frame;
pub mod gesture;
mod handle;
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

// After what it names: umo.h has this order.
pub mod clip;

use std::ffi::c_char;

use umo_core::motion::axes::Axes;

use status::Failure;

/// The version of this interface: its major number in the upper 16 bits, its minor number in the
/// lower. A library serves programs of the same major number and no larger minor one.
pub const UMO_ABI_VERSION: u32 = 1;

/// Y up, right-handed, metres; the avatar looks along +Z, its left hand is towards +X. glTF's and
/// Godot's.
pub const UMO_AXES_GLTF: u32 = 0;
/// Z up, left-handed, centimetres; the avatar looks along +X, its right hand is towards +Y.
/// Unreal's.
pub const UMO_AXES_UNREAL: u32 = 1;
/// Y up, left-handed, metres; the avatar looks along +Z, its right hand is towards +X. Unity's.
pub const UMO_AXES_UNITY: u32 = 2;

pub(crate) fn axes(which: u32) -> Result<Axes, Failure> {
    match which {
        UMO_AXES_GLTF => Ok(Axes::Gltf),
        UMO_AXES_UNREAL => Ok(Axes::Unreal),
        UMO_AXES_UNITY => Ok(Axes::Unity),
        _ => Err(Failure::argument(format_args!("axes {which} are none of UMO_AXES_…"))),
    }
}

/// A plain structure of the host's, where there is one.
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

/// `UMO_ABI_VERSION` of the library, for programs that look it up while they run.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_abi_version() -> u32 {
    UMO_ABI_VERSION
}

/// The library's version, as `0.1.0`: static.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_version() -> *const c_char {
    concat!(env!("CARGO_PKG_VERSION"), "\0").as_ptr().cast()
}
