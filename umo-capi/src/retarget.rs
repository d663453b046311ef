//! Poses on the host's characters: bones of any skeleton, and arms that keep out of the body.

use std::ffi::c_char;

use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::model::{self, UmoModel};
use crate::status::UmoStatus;

#[cfg(feature = "retarget")]
mod bones;

/// A character of the host's that poses are put on. A handle, never a pointer to memory.
pub struct UmoRetarget {
    _opaque: [u8; 0],
}

/// A character's skeleton at rest, and its mesh. `umo_rig_init` fills in the defaults. The memory that it points to is
/// read only by `umo_retarget_new`. Places and rotations are in the character's space, not relative to parents, in
/// `axes`; it may face anywhere and stand in any pose between a T and an A. Scale is in the places.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoRig {
    /// `sizeof(umo_rig)`.
    pub struct_size: u32,
    /// Axes of the character's space, and of the poses: one of `UMO_AXES_…`.
    pub axes: u32,
    /// Number of bones, 1 to 65,536.
    pub bone_count: u32,
    /// Number of points of the mesh; 0: the body has a person's proportions.
    pub vertex_count: u32,
    /// Number of `indices`, three for each triangle; 0: the points are spread over the surface by the host.
    pub index_count: u32,
    /// Strength of the body's volume, 0 to 1. 0: arms go through the body. At 1 they keep out of trunk, head, legs and
    /// each other, and touch where the model's do.
    pub gain: f32,
    /// Factors of the measured girth of pelvis, belly, chest, neck, head, upper arms, forearms, hands, thighs: 0 to 10.
    pub girths: [f32; 9],
    /// Zero.
    pub reserved: u32,
    /// Names of the bones, UTF-8; NULL if `joints` is given. `[bone_count]`
    pub names: *const *const c_char,
    /// `int32_t[bone_count]`: index of each bone's parent, -1 for none.
    pub parents: *const i32,
    /// `int32_t[bone_count]`: joint that each bone follows, -1 for none. Bones of the joints 3, 6 and 9 are the spine from
    /// the hips up, whatever their number, bones of joint 12 the neck. NULL: found by `names`.
    pub joints: *const i32,
    /// `float[bone_count][3]`: places of the bones at rest.
    pub places: *const f32,
    /// `float[bone_count][4]`: rotations of the bones at rest, quaternions x, y, z, w.
    pub rotations: *const f32,
    /// `float[vertex_count][3]`: places of the mesh's points at rest.
    pub vertices: *const f32,
    /// `int32_t[vertex_count]`: bone that has at least half of each point's weight, -1 for none.
    pub vertex_bones: *const i32,
    /// `uint32_t[index_count]`: points of the triangles.
    pub indices: *const u32,
}

// SAFETY: `repr(C)`, starts with its size, numbers and pointers that may be NULL.
unsafe impl Sized32 for UmoRig {
    const FIRST: usize = 64 + 8 * size_of::<*const f32>();
}

/// Fills a character with its defaults: no bones, no mesh, a gain of 1, girths of 1. `size` is `sizeof *rig`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `rig` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_rig_init(rig: *mut UmoRig, size: usize) -> UmoStatus {
    let defaults = UmoRig {
        struct_size: 0,
        axes: crate::UMO_AXES_GLTF,
        bone_count: 0,
        vertex_count: 0,
        index_count: 0,
        gain: 1.0,
        girths: [1.0; 9],
        reserved: 0,
        names: std::ptr::null(),
        parents: std::ptr::null(),
        joints: std::ptr::null(),
        places: std::ptr::null(),
        rotations: std::ptr::null(),
        vertices: std::ptr::null(),
        vertex_bones: std::ptr::null(),
        indices: std::ptr::null(),
    };
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(rig, size, "rig", &defaults) })
}

/// Prepares a character for poses of the model's skeleton, which is copied: the model may be freed. The character stands
/// on the floor at rest. Its parts without points, and characters without points, have a person's proportions; a
/// character without arms, hands or legs keeps no volume.
///
/// Threads: any but the audio thread. Allocates. A mesh of 100,000 triangles takes some 50 ms.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STRUCT_SIZE`, `FULL` (4,096 characters), `OUT_OF_MEMORY`,
/// `INVALID_ARGUMENT` (`umo_last_error` says which bone, point or number is wrong, or which joints have no bone),
/// `UNSUPPORTED` (the library was built without umo-capi's feature `retarget`).
///
/// # Safety
/// `rig` is NULL or as long as its `struct_size` says, and its pointers are as described; `retarget` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_retarget_new(
    model: *const UmoModel,
    rig: *const UmoRig,
    retarget: *mut *mut UmoRetarget,
) -> UmoStatus {
    guard(|| {
        wanted(retarget, "retarget")?;
        let model = model::get(model)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let rig = unsafe { ffi::read(rig, "rig")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let handle = unsafe { bones::make(&model.model.config().skeleton, &rig)? };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(retarget, "retarget", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Frees a character. NULL is fine.
///
/// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_retarget_free` again).
#[unsafe(no_mangle)]
pub extern "C" fn umo_retarget_free(retarget: *mut UmoRetarget) -> UmoStatus {
    guard(|| if retarget.is_null() { Ok(()) } else { bones::free(retarget.addr()) })
}

/// Gets the joint that each bone follows, -1 for a bone that keeps its rest rotation: `bone_count` values. The bone of
/// joint 0 is the one that moves; a head without a body has none.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (another number of bones).
///
/// # Safety
/// `joints` is NULL or has room for `bone_count` values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_retarget_get_joints(
    retarget: *const UmoRetarget,
    bone_count: u32,
    joints: *mut i32,
) -> UmoStatus {
    guard(|| {
        wanted(joints, "joints")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let joints = unsafe { ffi::slice_mut(joints, bone_count as usize, "joints")? };
        bones::joints(retarget.addr(), joints)
    })
}

/// Sets the time from the last pose to the next one, in seconds; it holds until it is set again. A character begins with
/// 1/30. A host that applies poses at another rate sets it before every pose, or once if the rate is constant: arms then
/// leave the body and come back as fast as at 30 a second. 0.001 to 0.2 are used as they are, others as the nearer of these.
/// Without volume it has no effect.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: `INVALID_HANDLE`, `INVALID_ARGUMENT` (negative or not finite), `BUSY` (another thread is in a call on the
/// character).
#[unsafe(no_mangle)]
pub extern "C" fn umo_retarget_set_step(retarget: *mut UmoRetarget, seconds: f32) -> UmoStatus {
    guard(|| bones::set_step(retarget.addr(), seconds))
}

/// Puts a pose on a character: `pose_rotations` are a frame's, four values for each of the 55 joints, and
/// `pose_translation` its three; both in the rig's axes. Writes the rotation of each bone relative to its parent, four
/// values for each of `bone_count` bones, and the place of the bone of joint 0 in the character's space, three values
/// (NULL: not wanted). With volume a pose depends on those before it: give the frames of one motion in order, 30 a second or
/// at the times of `umo_retarget_set_step`.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (another number of bones, a number that is not finite),
/// `BUSY` (another thread is in a call on the character), `PANIC`.
///
/// # Safety
/// `pose_rotations` is NULL or has 220 readable values, `pose_translation` three; `rotations` is NULL or has room for four
/// values for each bone, `place` for three.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_retarget_apply(
    retarget: *mut UmoRetarget,
    pose_rotations: *const f32,
    pose_translation: *const f32,
    bone_count: u32,
    rotations: *mut f32,
    place: *mut f32,
) -> UmoStatus {
    guard(|| {
        wanted(rotations, "rotations")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let turns = unsafe { ffi::slice(pose_rotations, 4 * umo_core::JOINTS, "pose_rotations")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let translation = unsafe { ffi::slice(pose_translation, 3, "pose_translation")? };
        // SAFETY: guaranteed by the caller (see # Safety).
        let rotations = unsafe { ffi::slice_mut(rotations, 4 * bone_count as usize, "rotations")? };
        let place = match place.is_null() {
            true => None,
            // SAFETY: guaranteed by the caller (see # Safety).
            false => Some(unsafe { ffi::slice_mut(place, 3, "place")? }),
        };
        bones::apply(retarget.addr(), turns, translation, rotations, place)
    })
}

/// In a library without retargeting there are no characters.
#[cfg(not(feature = "retarget"))]
mod bones {
    use umo_core::Skeleton;

    use super::UmoRig;
    use crate::status::{Failure, UMO_STATUS_INVALID_HANDLE, UMO_STATUS_UNSUPPORTED};

    pub(super) unsafe fn make(_: &Skeleton, _: &UmoRig) -> Result<usize, Failure> {
        let what = "this library was built without retargeting: build umo-capi with its feature `retarget`";
        Err(Failure::new(UMO_STATUS_UNSUPPORTED, what))
    }

    fn none<T>() -> Result<T, Failure> {
        Err(Failure::new(UMO_STATUS_INVALID_HANDLE, "not a character's handle, or the character was freed"))
    }

    pub(super) fn free(_: usize) -> Result<(), Failure> {
        none()
    }

    pub(super) fn joints(_: usize, _: &mut [i32]) -> Result<(), Failure> {
        none()
    }

    pub(super) fn set_step(_: usize, _: f32) -> Result<(), Failure> {
        none()
    }

    pub(super) fn apply(_: usize, _: &[f32], _: &[f32], _: &mut [f32], _: Option<&mut [f32]>) -> Result<(), Failure> {
        none()
    }
}
