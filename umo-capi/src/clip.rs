//! Export of frames to files: glTF, with or without a figure, and VRM Animation.

use std::ffi::{c_char, c_void};

use umo_core::FaceKind;

use crate::ffi::{self, Sized32, guard};
use crate::frame::UmoFrameLayout;
use crate::model::{self, UmoModel};
#[cfg(not(feature = "gltf"))]
use crate::status::Failure;
use crate::status::UmoStatus;

#[cfg(feature = "gltf")]
mod write;

/// Binary glTF 2.0, `.glb`: a skinned figure, or the skeleton alone.
pub const UMO_FORMAT_GLB: u32 = 1;
/// VRM Animation 1.0, `.vrma`, for any VRM avatar.
pub const UMO_FORMAT_VRMA: u32 = 2;

/// Frames to export, with their skeleton and channels. `umo_clip_init` fills in the model's fields; the
/// host sets `layout`, `frames` and `frame_count`. The memory that it points to is read only during the
/// call that takes the clip.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoClip {
    /// `sizeof(umo_clip)`.
    pub struct_size: u32,
    /// Same as `umo_model_info.is_arkit`.
    pub is_arkit: u32,
    /// Number of face channels, at most 1,024.
    pub channel_count: u32,
    /// Number of frames in `frames`.
    pub frame_count: u32,
    /// Frames per second.
    pub rate: f32,
    /// Zero.
    pub reserved: u32,
    /// Names of the face channels, UTF-8, as from `umo_model_get_channel_name`. `[channel_count]`
    pub channels: *const *const c_char,
    /// `int32_t[UMO_JOINT_COUNT]`: index of each joint's parent, as from `umo_model_get_skeleton`.
    pub parents: *const i32,
    /// `float[UMO_JOINT_COUNT][3]`: rest position of each joint in its parent's frame, metres in
    /// `UMO_AXES_GLTF`, whatever the axes of the frames.
    pub offsets: *const f32,
    /// Layout and axes of the frames. It must have translation, rotations and channels.
    pub layout: *const UmoFrameLayout,
    /// The first frame, at second 0 of the file.
    pub frames: *const c_void,
    /// Figure to skin in `UMO_FORMAT_GLB`: a name from `umo_figure_name`. NULL: the skeleton alone, without
    /// a face.
    pub figure: *const c_char,
}

// SAFETY: `repr(C)`, starts with its size, numbers and pointers that may be NULL.
unsafe impl Sized32 for UmoClip {
    const FIRST: usize = 24 + 6 * size_of::<*const c_void>();
}

/// Destination of a file's bytes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoOutput {
    /// Passed to `write`.
    pub userdata: *mut c_void,
    /// Takes the next bytes of the file, at least one; they are valid until it returns. Returns 0 to go on,
    /// any other number to stop. Called on the thread that called `umo_clip_write`. Must not throw.
    pub write: Option<unsafe extern "C" fn(userdata: *mut c_void, bytes: *const c_void, size: usize) -> i32>,
}

/// Zero-terminated names of the figures.
#[cfg(feature = "gltf")]
static FIGURES: [model::inspect::Name; umo_figure::Figure::ALL.len()] = {
    let mut names = [""; umo_figure::Figure::ALL.len()];
    let mut i = 0;
    while i < names.len() {
        names[i] = umo_figure::Figure::ALL[i].name();
        i += 1;
    }
    model::inspect::names(names)
};

/// Returns the name of a figure, such as `alex`: static, or NULL if `index` is past the last one. The
/// first is the default. Always NULL in a library built without the glTF writer.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_figure_name(index: u32) -> *const c_char {
    #[cfg(feature = "gltf")]
    let name = FIGURES.get(index as usize).map(|name| name.as_ptr().cast());
    #[cfg(not(feature = "gltf"))]
    let name = None.filter(|_: &*const c_char| index == 0);
    name.unwrap_or(std::ptr::null())
}

/// Fills a clip with the model's skeleton, face channels and frame rate, and the default figure. Its
/// pointers are valid until the model is freed. `size` is `sizeof *clip`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `clip` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_clip_init(clip: *mut UmoClip, size: usize, model: *const UmoModel) -> UmoStatus {
    guard(|| {
        let model = model::get(model)?;
        let config = model.model.config();
        let count = |value: usize| u32::try_from(value).unwrap_or(u32::MAX);
        let filled = UmoClip {
            struct_size: 0,
            is_arkit: u32::from(config.face.kind == FaceKind::Arkit),
            channel_count: count(config.face.names.len()),
            frame_count: 0,
            rate: config.frame_rate as f32,
            reserved: 0,
            channels: model.channel_texts.0.as_ptr(),
            parents: config.skeleton.parents.as_ptr(),
            offsets: config.skeleton.offsets_m.as_ptr().cast(),
            layout: std::ptr::null(),
            frames: std::ptr::null(),
            figure: umo_figure_name(0),
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::initialise(clip, size, "clip", &filled) }
    })
}

/// Writes frames as a file of `format`, one of `UMO_FORMAT_…`, piece by piece: the same bytes as
/// `umo animate` writes. `umo_clip_write_file` writes to disk.
///
/// Threads: any but the audio thread. Allocates up to six times the frames' size and 16 MB; a figure
/// takes some 0.7 s of a core, half of it on a second thread if the system can start one.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (`umo_last_error` says which part of the
/// clip is wrong), `IO` (`output` stopped it), `OUT_OF_MEMORY`, `UNSUPPORTED` (the library was built
/// without the glTF writer).
///
/// # Safety
/// `clip` is NULL or as long as its `struct_size` says, and its pointers are as described; `output` is
/// NULL or readable, and its `write` is NULL or as described.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_clip_write(clip: *const UmoClip, format: u32, output: *const UmoOutput) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { to_output(clip, format, output) })
}

/// Writes frames to a file, as `umo_clip_write` does. The file appears complete or not at all: after an
/// error, an existing file of that name is unchanged. `path` is UTF-8 on every system.
///
/// Threads: any but the audio thread. Allocates, writes the file, and waits until it is on the disk.
/// Errors: as `umo_clip_write`; `IO` (`umo_last_error` has the path and the system's message),
/// `UNSUPPORTED` also if the library was built without files.
///
/// # Safety
/// As `umo_clip_write`; `path` is NULL or ends with a zero byte.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_clip_write_file(clip: *const UmoClip, format: u32, path: *const c_char) -> UmoStatus {
    guard(|| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let path = unsafe { ffi::string(path, "path")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { to_file(clip, format, path) }
    })
}

#[cfg(feature = "gltf")]
use write::{to_file, to_output};

#[cfg(not(feature = "gltf"))]
unsafe fn to_output(_: *const UmoClip, _: u32, _: *const UmoOutput) -> Result<(), Failure> {
    Err(no_gltf())
}

#[cfg(not(feature = "gltf"))]
unsafe fn to_file(_: *const UmoClip, _: u32, _: &str) -> Result<(), Failure> {
    Err(no_gltf())
}

#[cfg(not(feature = "gltf"))]
fn no_gltf() -> Failure {
    let what = "this library was built without the writer of glTF: build umo-capi with its feature `gltf`";
    Failure::new(crate::status::UMO_STATUS_UNSUPPORTED, what)
}
