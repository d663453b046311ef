//! Scenes: avatars that know each other, and people with microphones.

use std::ffi::{c_char, c_void};
use std::sync::atomic::{AtomicBool, Ordering};

use umo_core::{Allowed, Body, Place, Scene, SceneError, Session, Target};
use umo_core_base::defect::contain;
use umo_core_pose::axes::Axes;

use crate::ffi::{self, Sized32, guard, put, wanted};
use crate::handle::{self, Guard, Table};
use crate::session::{self, Detail, UmoSession};
use crate::status::{
    Failure, UMO_STATUS_BUFFER_TOO_SMALL, UMO_STATUS_BUSY, UMO_STATUS_FULL, UMO_STATUS_NULL_POINTER, UMO_STATUS_OK,
    UMO_STATUS_PANIC, UmoStatus,
};

/// The member's looks: at whom, and away.
pub const UMO_SCENE_LOOK: u32 = 1;
/// Nods and raised brows of the member while it listens.
pub const UMO_SCENE_NOD: u32 = 2;
/// Half smiles of the member while it listens.
pub const UMO_SCENE_SMILE: u32 = 4;
/// Lean and shifts of weight of the member, its own and those that follow another's.
pub const UMO_SCENE_MIRROR: u32 = 8;
/// Giving way to who interrupts the member.
pub const UMO_SCENE_YIELD: u32 = 16;

/// Nobody speaks.
pub const UMO_ROLE_IDLE: u32 = 0;
/// Another member speaks.
pub const UMO_ROLE_LISTENING: u32 = 1;
/// The member speaks.
pub const UMO_ROLE_SPEAKING: u32 = 2;

/// Upper bound on the members of a scene.
pub const UMO_SCENE_MEMBER_COUNT: usize = 32;
const _: () = assert!(UMO_SCENE_MEMBER_COUNT == umo_core::MAX_MEMBERS);

/// Maximum number of scenes at once.
const MAX_SCENES: usize = 1024;

/// A scene: up to `UMO_SCENE_MEMBER_COUNT` members. A handle, never a pointer to memory.
pub struct UmoScene {
    _opaque: [u8; 0],
}

/// Where a member stands. Initialise it with `umo_place_init`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoPlace {
    /// `sizeof(umo_place)`.
    pub struct_size: u32,
    /// Axes and units of the fields below: one of `UMO_AXES_…`.
    pub axes: u32,
    /// Position on the floor, in the scene's space.
    pub position: [f32; 3],
    /// Direction that it faces, in radians about the upward axis: 0 is the axis along which an avatar looks,
    /// and the sign is that of a yaw in these axes: positive to the left in glTF's, to the right in Unity's and
    /// Unreal's.
    pub facing: f32,
    /// Height of the eyes above the position; the default is 1.6 m in glTF's axes.
    pub eye_height: f32,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoPlace {
    const FIRST: usize = 28;
}

/// State of a member of a scene. Set `struct_size`; `umo_scene_member` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoMember {
    /// `sizeof(umo_member)`.
    pub struct_size: u32,
    /// Whether it speaks: one of `UMO_ROLE_…`.
    pub role: u32,
    /// Whom it attends to; 0 for nobody, or for a point of the host's.
    pub attends_to: u32,
    /// 1 if it looks there now, 0 if it looks past.
    pub is_contact: u32,
    /// Nods so far.
    pub nods: u32,
    /// Brow raises so far.
    pub brows: u32,
    /// Half smiles so far.
    pub smiles: u32,
    /// Amount of yielding to another one that interrupts, 0 or 1.
    pub yielding: f32,
    /// Level of its voice, root mean square, full scale 1.
    pub level: f32,
}

// SAFETY: `repr(C)`, starts with its size, numbers.
unsafe impl Sized32 for UmoMember {
    const FIRST: usize = 36;
}

static SCENES: Table<SceneHandle, MAX_SCENES> = Table::new(5, "scene");

/// Object of a scene's handle.
struct SceneHandle {
    scene: Scene<SessionBody>,
    poisoned: AtomicBool,
    detail: Detail,
}

/// Handle of a member's session, which the host may free at any time.
#[derive(Debug)]
struct SessionBody(usize);

impl Body for SessionBody {
    fn with<R>(&self, call: impl FnOnce(&Session) -> R) -> Option<R> {
        session::with(self.0, call)
    }
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        match error {
            SceneError::Session(error) => error.into(),
            SceneError::Busy => Self::new(UMO_STATUS_BUSY, error),
            SceneError::Full => Self::new(UMO_STATUS_FULL, error),
            SceneError::Short { .. } => Self::new(UMO_STATUS_BUFFER_TOO_SMALL, error),
            SceneError::NoMember(_) | SceneError::Place | SceneError::Target | SceneError::Time => {
                Self::argument(error)
            }
        }
    }
}

fn get(scene: *const UmoScene) -> Result<Guard<'static, SceneHandle>, UmoStatus> {
    if scene.is_null() {
        return Err(UMO_STATUS_NULL_POINTER);
    }
    SCENES.get(scene.addr()).map_err(|failure| failure.status)
}

/// Runs a call on a scene; the detail of a failure is kept with the scene, without thread-local storage.
fn on(scene: *const UmoScene, call: impl FnOnce(&Scene<SessionBody>) -> Result<(), Failure>) -> UmoStatus {
    let handle = match get(scene) {
        Ok(handle) => handle,
        Err(status) => return status,
    };
    if handle.poisoned.load(Ordering::Relaxed) {
        return UMO_STATUS_PANIC;
    }
    let failure = match contain(|| call(&handle.scene)) {
        Ok(Ok(())) => return UMO_STATUS_OK,
        Ok(Err(failure)) => failure,
        Err(defect) => {
            handle.poisoned.store(true, Ordering::Relaxed);
            Failure::defect(&defect)
        }
    };
    handle.detail.keep(&failure.detail);
    failure.status
}

/// Reads a place; the default for NULL.
///
/// # Safety
/// `place` is NULL or as long as its `struct_size` says.
unsafe fn read_place(place: *const UmoPlace) -> Result<Place, Failure> {
    if place.is_null() {
        return Ok(Place::default());
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let given = unsafe { ffi::read(place, "place")? };
    let axes = crate::axes(given.axes)?;
    let is_right_handed = axes == Axes::Gltf;
    Ok(Place {
        position: axes.place_from(given.position),
        facing: if is_right_handed { given.facing } else { -given.facing },
        eye_height: given.eye_height / axes.units_per_metre(),
    })
}

/// Fills a place with its defaults: at the origin, in the axes of glTF, eyes at 1.6 m. `size` is `sizeof *place`.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT` (not aligned).
///
/// # Safety
/// `place` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_place_init(place: *mut UmoPlace, size: usize) -> UmoStatus {
    let Place { position, facing, eye_height } = Place::default();
    let defaults = UmoPlace { struct_size: 0, axes: crate::UMO_AXES_GLTF, position, facing, eye_height };
    // SAFETY: guaranteed by the caller (see # Safety).
    guard(|| unsafe { ffi::initialise(place, size, "place", &defaults) })
}

/// Creates an empty scene. Its random choices follow from `seed`: equal seeds, voices and times of updates give equal
/// frames.
///
/// Threads: any but the audio thread. Allocates everything that the scene will ever need.
/// Errors: `NULL_POINTER`, `FULL` (1,024 scenes), `OUT_OF_MEMORY`.
///
/// # Safety
/// `scene` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_new(seed: u64, scene: *mut *mut UmoScene) -> UmoStatus {
    guard(|| {
        wanted(scene, "scene")?;
        let made = SceneHandle { scene: Scene::new(seed)?, poisoned: AtomicBool::new(false), detail: Detail::new() };
        let handle = SCENES.insert(handle::boxed(made)?)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(scene, "scene", std::ptr::without_provenance_mut(handle)) }
    })
}

/// Frees a scene. NULL is fine. Its sessions go on alone: free them before or after.
///
/// Threads: any but the audio thread. Waits a millisecond or so for calls in progress.
/// Errors: `INVALID_HANDLE`, `BUSY` (a call on it is still in progress: call `umo_scene_free` again).
#[unsafe(no_mangle)]
pub extern "C" fn umo_scene_free(scene: *mut UmoScene) -> UmoStatus {
    guard(|| {
        if !scene.is_null() {
            drop(SCENES.remove(scene.addr())?);
        }
        Ok(())
    })
}

/// Adds a member at a place (NULL: the default), and writes its number to `member`: from 1 on, never used again
/// in this scene. `session` is an avatar, of any engine, or a decoder; it may be in one scene at a time. A session that
/// is freed leaves the scene with the next update. With NULL the member has no body: a person, whose voice comes
/// by `umo_scene_push_audio`.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE` (of the scene or the session), `STRUCT_SIZE`, `INVALID_ARGUMENT` (unknown
/// axes, a number that is not finite or too large), `FULL` (`UMO_SCENE_MEMBER_COUNT`), `BUSY` (another thread is in a call
/// on the scene), `PANIC`.
///
/// # Safety
/// `place` is NULL or as long as its `struct_size` says; `member` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_add(
    scene: *mut UmoScene,
    session: *mut UmoSession,
    place: *const UmoPlace,
    member: *mut u32,
) -> UmoStatus {
    on(scene, |scene| {
        wanted(member, "member")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let place = unsafe { read_place(place)? };
        let body = match session.is_null() {
            true => None,
            false => {
                session::check(session)?;
                Some(SessionBody(session.addr()))
            }
        };
        let id = scene.add(body, place)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(member, "member", id) }
    })
}

/// Removes a member. Its session goes on alone, and the others look elsewhere.
///
/// Threads: one at a time. Never allocates; waits at most for a copy of a few bytes.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such member), `BUSY`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_scene_remove(scene: *mut UmoScene, member: u32) -> UmoStatus {
    on(scene, |scene| Ok(scene.remove(member)?))
}

/// Moves a member.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: as `umo_scene_remove`, and `STRUCT_SIZE`, `INVALID_ARGUMENT` (as `umo_scene_add`).
///
/// # Safety
/// `place` is NULL or as long as its `struct_size` says.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_set_place(scene: *mut UmoScene, member: u32, place: *const UmoPlace) -> UmoStatus {
    on(scene, |scene| {
        wanted(place.cast_mut(), "place")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let place = unsafe { read_place(place)? };
        Ok(scene.set_place(member, place)?)
    })
}

/// Sets the target of a member's look, whatever is said: another member, `other`, or a point of the scene in `axes`
/// (`UMO_AXES_…`), three values. With an `other` of 0 and NULL the scene chooses again.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: as `umo_scene_remove`, and `INVALID_ARGUMENT` (both `other` and `point`, the member itself, unknown axes, a
/// point that is not finite or beyond 10 km).
///
/// # Safety
/// `point` is NULL or has three readable values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_set_target(
    scene: *mut UmoScene,
    member: u32,
    other: u32,
    axes: u32,
    point: *const f32,
) -> UmoStatus {
    on(scene, |scene| {
        let target = match (other, point.is_null()) {
            (0, true) => Target::Free,
            (other, true) => Target::Member(other),
            (0, false) => {
                let axes = crate::axes(axes)?;
                // SAFETY: guaranteed by the caller (see # Safety).
                let point = unsafe { ffi::slice(point, 3, "point")? };
                Target::Point(axes.place_from([point[0], point[1], point[2]]))
            }
            (_, false) => return Err(Failure::argument("a target is another member or a point, not both")),
        };
        Ok(scene.set_target(member, target)?)
    })
}

/// Sets the parts that the scene plays of a member: the sum of `UMO_SCENE_…`; all at first. Other parts are
/// the session's own, or the host's; with 0 the session moves as if alone.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: as `umo_scene_remove`, and `INVALID_ARGUMENT` (unknown bits).
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_scene_set_allowed(scene: *mut UmoScene, member: u32, parts: u32) -> UmoStatus {
    on(scene, |scene| {
        let unknown = || Failure::argument(format_args!("parts {parts} are not a sum of UMO_SCENE_…"));
        Ok(scene.set_allowed(member, Allowed::from_bits(parts).ok_or_else(unknown)?)?)
    })
}

/// Feeds the voice of a member without a body: `count` samples, full scale 1, at any rate, of any number of channels.
/// Only their loudness is used; NaN and infinite samples count as silence. A voice without samples for a quarter of a
/// second of the scene is silent.
///
/// Threads: any, concurrently with any other call; meant for the recording thread. Never allocates, never waits, makes no
/// system call.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (no such member, or one with a body), `PANIC`.
///
/// # Safety
/// `samples` is NULL or has `count` readable values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_push_audio(
    scene: *mut UmoScene,
    member: u32,
    samples: *const f32,
    count: usize,
) -> UmoStatus {
    on(scene, |scene| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let samples = unsafe { ffi::slice(samples, count, "samples")? };
        Ok(scene.push_audio(member, samples)?)
    })
}

/// Advances the scene by `seconds`: once per picture, before frames are pulled or sampled. Reads the voice of each
/// session at the frame that was pulled or sampled last, and tells each session what to do from its next frame on. Of a time
/// longer than a second the rest is left out. `umo_session_look_at`, attention, mood and gestures of a session come first.
///
/// Threads: one at a time, meant for the game thread. Never allocates, never waits, makes no system call.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `INVALID_ARGUMENT` (negative or not finite), `BUSY`, `PANIC`.
#[unsafe(no_mangle)]
#[must_use]
pub extern "C" fn umo_scene_update(scene: *mut UmoScene, seconds: f64) -> UmoStatus {
    on(scene, |scene| Ok(scene.update(seconds)?))
}

/// Gets the member that has the floor; 0 for nobody.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `PANIC`.
///
/// # Safety
/// `member` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_floor(scene: *mut UmoScene, member: *mut u32) -> UmoStatus {
    on(scene, |scene| {
        wanted(member, "member")?;
        let floor = scene.floor()?.unwrap_or(0);
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(member, "member", floor) }
    })
}

/// Gets the state of a member.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: as `umo_scene_remove`, and `STRUCT_SIZE`.
///
/// # Safety
/// `info` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_member(scene: *mut UmoScene, member: u32, info: *mut UmoMember) -> UmoStatus {
    on(scene, |scene| {
        let found = scene.member(member)?;
        let [nods, brows, smiles] = found.answers;
        let value = UmoMember {
            struct_size: 0,
            role: found.role as u32,
            attends_to: found.attends_to.unwrap_or(0),
            is_contact: u32::from(found.is_contact),
            nods,
            brows,
            smiles,
            yielding: found.yielding,
            level: found.level,
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(info, "info", &value) }
    })
}

/// Gets the number of bytes that `umo_scene_save` writes at most; it changes with the members.
///
/// Threads: one at a time. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUSY`, `PANIC`.
///
/// # Safety
/// `size` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_state_size(scene: *mut UmoScene, size: *mut usize) -> UmoStatus {
    on(scene, |scene| {
        wanted(size, "size")?;
        let needed = scene.state_size()?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(size, "size", needed) }
    })
}

/// Saves the scene and the sessions of all its members to `state`, which has `size` bytes; `written` gets their
/// number. Decoders have no state: their senders do.
///
/// Threads: one at a time; not during a push, a pull or a setter of a member's session. Never allocates, never waits
/// for a chunk.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (also as `umo_session_save`, of any member), `FAILED`
/// and `CLOSED` of a member's session, `PANIC`. Then the bytes are not a state.
///
/// # Safety
/// `state` is NULL or has `size` writable bytes; `written` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_save(
    scene: *mut UmoScene,
    state: *mut c_void,
    size: usize,
    written: *mut usize,
) -> UmoStatus {
    on(scene, |scene| {
        wanted(written, "written")?;
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice_mut(state.cast::<u8>(), size, "state")? };
        let saved = scene.save(bytes)?;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(written, "written", saved) }
    })
}

/// Restores a state of this scene, or of another one to which the same members were added in the same order, with
/// sessions of the same models and configurations: equal calls then give equal frames. After an error neither the scene
/// nor any session has changed.
///
/// Threads: one at a time; not during a push, a pull or a setter of a member's session. Never allocates, never waits
/// for a chunk.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `STATE` (`umo_scene_last_error` says what disagrees), `BUSY` (also as
/// `umo_session_restore`, of any member), `FAILED` and `CLOSED` of a member's session, `PANIC`.
///
/// # Safety
/// `state` is NULL or has `size` readable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_restore(scene: *mut UmoScene, state: *const c_void, size: usize) -> UmoStatus {
    on(scene, |scene| {
        // SAFETY: guaranteed by the caller (see # Safety).
        let bytes = unsafe { ffi::slice(state.cast::<u8>(), size, "state")? };
        Ok(scene.restore(bytes)?)
    })
}

/// Copies the detail of the last failed call on the scene, from any thread, to `buffer`, which has `size` bytes;
/// `UMO_ERROR_SIZE` is enough. `length`, which may be NULL, gets its length without the terminating zero.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL`, `BUSY` (a call is failing at this moment).
///
/// # Safety
/// `buffer` is NULL or has `size` writable bytes; `length` is NULL or writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_scene_last_error(
    scene: *const UmoScene,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
) -> UmoStatus {
    match get(scene) {
        // SAFETY: guaranteed by the caller (see # Safety).
        Ok(handle) => unsafe { handle.detail.copy(buffer, size, length) },
        Err(status) => status,
    }
}
