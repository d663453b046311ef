//! Gestures on command: built-in ones, the host's own, and playback options.

use std::ffi::{c_char, c_void};

#[cfg(feature = "retarget")]
use umo_core::LoadError;
use umo_core::{Gesture, GestureOptions, GestureParts, JOINTS, MAX_GESTURE_FRAMES, Side};
use umo_core_base::memory;

use crate::engine::gestures::refused;
use crate::engine::{self, EngineHandle, UmoEngine};
use crate::ffi::{self, Sized32, guard, put};
use crate::status::{Failure, UmoStatus};

/// The right hand; for a gesture with a target, the hand nearer to it.
pub const UMO_SIDE_AUTO: u32 = 0;
/// The left hand: the whole gesture is mirrored.
pub const UMO_SIDE_LEFT: u32 = 1;
/// The right hand.
pub const UMO_SIDE_RIGHT: u32 = 2;
/// Both hands if the gesture supports it, otherwise as `UMO_SIDE_AUTO`.
pub const UMO_SIDE_BOTH: u32 = 3;

/// Neck and head.
pub const UMO_GESTURE_HEAD: u32 = 1;
/// Spine.
pub const UMO_GESTURE_TRUNK: u32 = 2;
/// Left arm, from collar to fingers.
pub const UMO_GESTURE_LEFT_ARM: u32 = 4;
/// Right arm, from collar to fingers.
pub const UMO_GESTURE_RIGHT_ARM: u32 = 8;

/// Playback options of a gesture. Initialise them with `umo_gesture_options_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoGestureOptions {
    /// `sizeof(umo_gesture_options)`.
    pub struct_size: u32,
    /// The hand: one of `UMO_SIDE_…`.
    pub side: u32,
    /// Axes and units of `target`: one of `UMO_AXES_…`.
    pub axes: u32,
    /// 1 if `target` is set, else 0.
    pub has_target: u32,
    /// Time of the stroke, in seconds of the motion; the preparation begins correspondingly earlier.
    /// Negative: as soon as no other gesture uses its parts.
    pub at: f64,
    /// Playback speed, 0.5 to 2.
    pub speed: f32,
    /// Strength, 0 to 1: lower values stay closer to the model's motion.
    pub strength: f32,
    /// Point in the avatar's space, for pointing gestures; without one they point ahead.
    pub target: [f32; 3],
    /// Variant, 0 to 255: 0 is the gesture as drawn; others go through its poses in turn, and each number has a
    /// size, height and speed of its own.
    pub variant: u32,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoGestureOptions {
    const FIRST: usize = 48;
}

/// A clip of the host's to make a gesture from. Initialise it with `umo_gesture_clip_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoGestureClip {
    /// `sizeof(umo_gesture_clip)`.
    pub struct_size: u32,
    /// Axes of the rotations: one of `UMO_AXES_…`.
    pub axes: u32,
    /// Parts of the body that it moves: a sum of `UMO_GESTURE_…`. The position and walking of the body stay
    /// the model's.
    pub parts: u32,
    /// Number of frames, 2 to 3,600.
    pub frame_count: u32,
    /// Frames per second, 1 to 240.
    pub rate: f32,
    /// Seconds from the first frame to the stroke.
    pub stroke: f32,
    /// `float[frame_count][UMO_JOINT_COUNT][4]`: rotation of each joint in its parent's frame, a quaternion
    /// x, y, z, w; identity in all joints is a T-pose. Read during the call.
    pub rotations: *const f32,
}

// SAFETY: `repr(C)`, starts with its size, numbers and a pointer that may be NULL.
unsafe impl Sized32 for UmoGestureClip {
    const FIRST: usize = 24 + size_of::<*const f32>();
}

impl UmoGestureOptions {
    fn defaults() -> Self {
        let GestureOptions { speed, strength, side, variant, .. } = GestureOptions::default();
        Self {
            struct_size: 0,
            side: side as u32,
            axes: crate::UMO_AXES_GLTF,
            has_target: 0,
            at: -1.0,
            speed,
            strength,
            target: [0.0; 3],
            variant: variant.into(),
        }
    }

    fn read(&self) -> Result<GestureOptions, Failure> {
        let Self { side, axes, has_target, at, speed, strength, target, variant, .. } = *self;
        let axes = crate::axes(axes)?;
        let unknown = || Failure::argument(format_args!("side {side} is not one of UMO_SIDE_…"));
        let side = Side::ALL.get(side as usize).copied().ok_or_else(unknown)?;
        let unknown = |_| Failure::argument(format_args!("variant {variant}: expected 0 to 255"));
        let variant = u8::try_from(variant).map_err(unknown)?;
        let mut options = GestureOptions { speed, strength, side, variant, ..GestureOptions::default() };
        // A NaN stays, and is refused later.
        options.at = if at < 0.0 { None } else { Some(at) };
        options.target = match has_target {
            0 => None,
            1 => Some(axes.place_from(target)),
            _ => return Err(Failure::argument(format_args!("has_target {has_target}: expected 0 or 1"))),
        };
        Ok(options)
    }
}

/// Reads the options of a call; the defaults for NULL.
///
/// # Safety
/// `options` is NULL or as long as its `struct_size` says.
pub(crate) unsafe fn options(options: *const UmoGestureOptions) -> Result<GestureOptions, Failure> {
    if options.is_null() {
        return Ok(GestureOptions::default());
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { ffi::read(options, "options")? }.read()
}

/// Fills gesture options with their defaults: as soon as possible, at normal speed and full strength.
/// `size` is `sizeof *options`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `options` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_gesture_options_init(options: *mut UmoGestureOptions, size: usize) -> UmoStatus {
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(options, size, "options", &UmoGestureOptions::defaults()) })
}

/// Fills a clip with its defaults: all parts, 30 frames per second, no frames. `size` is `sizeof *clip`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `clip` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_gesture_clip_init(clip: *mut UmoGestureClip, size: usize) -> UmoStatus {
    let defaults = UmoGestureClip {
        struct_size: 0,
        axes: crate::UMO_AXES_GLTF,
        parts: GestureParts::ALL.bits(),
        frame_count: 0,
        rate: 30.0,
        stroke: 0.0,
        rotations: std::ptr::null(),
    };
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(clip, size, "clip", &defaults) })
}

/// Adds a gesture of the host's to an engine, for sessions that are created later; a gesture of the same
/// name is replaced. `name` is 1 to 64 letters, digits, `_`, `-` and spaces. The clip fades in over its
/// first 0.4 seconds, or up to its stroke if that is earlier, and fades out over its last 0.55 seconds. An
/// engine holds 256 added gestures.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `OUT_OF_MEMORY`, `INVALID_ARGUMENT`
/// (`umo_last_error` says which field).
///
/// # Safety
/// `name` is NULL or ends with a zero byte; `clip` is NULL or as long as its `struct_size` says,
/// with `rotations` as described.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_add_gesture(
    engine: *mut UmoEngine,
    name: *const c_char,
    clip: *const UmoGestureClip,
) -> UmoStatus {
    guard(|| {
        let engine = engine::get(engine)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let name = unsafe { ffi::string(name, "name")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let clip = unsafe { ffi::read(clip, "clip")? };
        let axes = crate::axes(clip.axes)?;
        let parts = parts(clip.parts)?;
        let count = clip.frame_count as usize;
        if !(2..=MAX_GESTURE_FRAMES).contains(&count) {
            let what = format_args!("`clip.frame_count` is {count}: expected 2 to {MAX_GESTURE_FRAMES}");
            return Err(Failure::argument(what));
        }
        // SAFETY: guaranteed by the caller (see # Safety).
        let values = unsafe { ffi::slice(clip.rotations, count * 4 * JOINTS, "clip.rotations")? };
        let (values, _) = values.as_chunks::<4>();
        let (frames, _) = values.as_chunks::<JOINTS>();
        let gesture = memory::catch(|| {
            let frames = memory::collected(frames.iter().map(|frame| frame.map(|q| axes.rotation_from(q))));
            Gesture::new(name, clip.rate, &frames, clip.stroke, parts)
        });
        engine.gestures.add(gesture?.map_err(refused)?)
    })
}

#[cfg(feature = "files")]
fn read(path: &str) -> Result<Vec<u8>, Failure> {
    // Without retargeting, `File::gesture` refuses every file.
    #[cfg(not(feature = "retarget"))]
    use umo_core_base::file::read;
    #[cfg(feature = "retarget")]
    use umo_core_rig::glb::read;
    let unread = |cause| Failure::io(&cause, format_args!("cannot read {path}: {cause}"));
    umo_core_base::memory::catch(|| read(path.as_ref()))?.map_err(unread)
}

#[cfg(not(feature = "files"))]
fn read(path: &str) -> Result<Vec<u8>, Failure> {
    Err(Failure::no_files(path, "umo_engine_add_gesture_memory"))
}

/// Adds a gesture, as `umo_engine_add_gesture` does, from the animation in a `.glb`, `.gltf` or `.vrm`
/// file of any humanoid character: bone names of Mixamo, VRM, Unreal, Unity, Godot and `umo animate` are
/// recognised. Files that a `.gltf` names are read from its folder. The motion is retargeted to the
/// model's skeleton.
///
/// `path` is UTF-8. `animation` is the name of an animation in the file, or NULL for the first; it may
/// last two minutes at most. `parts` is a sum of `UMO_GESTURE_…`. `stroke` is the time of the stroke in
/// seconds from the start; if negative, the middle.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `IO`, `OUT_OF_MEMORY`, `INVALID_ARGUMENT`
/// (`umo_last_error` says which part of the file is wrong, which bones were not found, or which
/// argument), `UNSUPPORTED` (the library was built without files, or without umo-capi's feature
/// `retarget`).
///
/// # Safety
/// `name` and `path` are NULL or end with a zero byte; so does `animation`.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_add_gesture_file(
    engine: *mut UmoEngine,
    name: *const c_char,
    path: *const c_char,
    animation: *const c_char,
    parts: u32,
    stroke: f32,
) -> UmoStatus {
    guard(|| {
        let engine = engine::get(engine)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let path = unsafe { ffi::string(path, "path")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let wanted = unsafe { File::read(name, animation, parts, stroke)? };
        let gesture = memory::watch(|| wanted.gesture(&engine, &read(path)?, path))??;
        engine.gestures.add(gesture)
    })
}

/// Adds a gesture, as `umo_engine_add_gesture_file` does, from a file's `size` bytes in memory, read
/// during the call. A `.gltf` must then embed its data.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: as `umo_engine_add_gesture_file`, except `IO`.
///
/// # Safety
/// `name` is NULL or ends with a zero byte; so does `animation`. `data` is NULL or has `size`
/// readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_add_gesture_memory(
    engine: *mut UmoEngine,
    name: *const c_char,
    data: *const c_void,
    size: usize,
    animation: *const c_char,
    parts: u32,
    stroke: f32,
) -> UmoStatus {
    guard(|| {
        let engine = engine::get(engine)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let wanted = unsafe { File::read(name, animation, parts, stroke)? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice(data.cast::<u8>(), size, "data")? };
        let gesture = memory::watch(|| wanted.gesture(&engine, bytes, "data"))??;
        engine.gestures.add(gesture)
    })
}

/// Arguments for making a gesture from a file.
#[cfg_attr(not(feature = "retarget"), expect(dead_code, reason = "files are refused"))]
struct File<'a> {
    name: &'a str,
    animation: Option<&'a str>,
    parts: GestureParts,
    stroke: Option<f32>,
}

impl<'a> File<'a> {
    /// # Safety
    /// `name` and `animation` are NULL or end with a zero byte, for as long as the result lives.
    unsafe fn read(name: *const c_char, animation: *const c_char, bits: u32, stroke: f32) -> Result<File<'a>, Failure> {
        // SAFETY: guaranteed by the caller (see # Safety).
        let name = unsafe { ffi::string(name, "name")? };
        let animation = match animation.is_null() {
            true => None,
            // SAFETY: guaranteed by the caller (see # Safety).
            false => Some(unsafe { ffi::string(animation, "animation")? }),
        };
        // A NaN stays, and is refused later.
        let stroke = if stroke < 0.0 { None } else { Some(stroke) };
        Ok(File { name, animation, parts: parts(bits)?, stroke })
    }

    #[cfg(not(feature = "retarget"))]
    #[expect(clippy::unused_self, reason = "of each build")]
    fn gesture(&self, _: &EngineHandle, _: &[u8], from: &str) -> Result<Gesture, Failure> {
        let what = format_args!(
            "{from}: this library was built without the reader of characters: build umo-capi with its feature `retarget`, or \
             give the frames to umo_engine_add_gesture"
        );
        Err(Failure::new(crate::status::UMO_STATUS_UNSUPPORTED, what))
    }

    #[cfg(feature = "retarget")]
    fn gesture(&self, engine: &EngineHandle, bytes: &[u8], from: &str) -> Result<Gesture, Failure> {
        let Self { name, animation, parts, stroke } = *self;
        let skeleton = &engine.model.model.config().skeleton;
        let refused = |error: LoadError| match error {
            LoadError::Argument { problem, .. } => Failure::argument(format_args!("{from}: {problem}")),
            error => error.into(),
        };
        Gesture::from_glb(name, bytes, animation, skeleton, stroke, parts).map_err(refused)
    }
}

fn parts(bits: u32) -> Result<GestureParts, Failure> {
    let none = || Failure::argument(format_args!("parts {bits}: expected a sum of UMO_GESTURE_…"));
    GestureParts::from_bits(bits).ok_or_else(none)
}

/// Gets the name of a gesture that an engine's sessions know: built-in ones first, in a fixed order, then
/// the host's. Valid until the engine is freed. To list all, count `index` up from 0 until
/// `INVALID_ARGUMENT`.
///
/// Threads: any but the audio thread. Waits for another thread's `umo_engine_add_gesture`.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such index).
///
/// # Safety
/// `name` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_engine_get_gesture_name(
    engine: *const UmoEngine,
    index: u32,
    name: *mut *const c_char,
) -> UmoStatus {
    guard(|| {
        let engine = engine::get(engine)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(name, "name", engine.gestures.name(index)?) }
    })
}
