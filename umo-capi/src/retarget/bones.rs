//! Characters behind their handles.

use std::ffi::c_char;
use std::sync::{Mutex, MutexGuard, TryLockError};

use umo_core::{
    Bone, Floor, JOINT_NAMES, JOINTS, Mapping, Pose, Retarget, RetargetError, RetargetScratch, Rig, Skeleton,
    SurfacePoint, Volume,
};
use umo_core_base::memory;
use umo_core_pose::axes::Axes;
use umo_core_pose::rotation::{IDENTITY, Quat, inverse, normalized, product, rotate};
use umo_core_rig::glb::spread;

use super::UmoRig;
use crate::ffi;
use crate::handle::{self, Table};
use crate::status::{Failure, UMO_STATUS_BUSY};

/// Maximum number of characters at once.
const MAX_CHARACTERS: usize = 4096;

/// Parts of a body whose girth has a factor, in the order of [`UmoRig::girths`].
const PARTS: [&str; 9] = ["pelvis", "belly", "chest", "neck", "head", "upper_arms", "forearms", "hands", "thighs"];

struct Character {
    axes: Axes,
    retarget: Retarget,
    joints: Vec<i32>,
    /// Rest place and rotation of the parent of the bone that moves.
    above: ([f32; 3], Quat),
    room: Mutex<(RetargetScratch, Vec<Quat>)>,
}

impl Character {
    /// Its memory, which one call at a time may use.
    fn enter(&self) -> Result<MutexGuard<'_, (RetargetScratch, Vec<Quat>)>, Failure> {
        match self.room.try_lock() {
            Ok(room) => Ok(room),
            Err(TryLockError::Poisoned(room)) => Ok(room.into_inner()),
            Err(TryLockError::WouldBlock) => {
                Err(Failure::new(UMO_STATUS_BUSY, "another thread is in a call on this character"))
            }
        }
    }
}

static CHARACTERS: Table<Character, MAX_CHARACTERS> = Table::new(7, "character");

impl From<RetargetError> for Failure {
    fn from(error: RetargetError) -> Self {
        Self::argument(error)
    }
}

/// Makes a character, and returns its handle.
///
/// # Safety
/// The pointers of `rig` are as described there.
pub(super) unsafe fn make(skeleton: &Skeleton, rig: &UmoRig) -> Result<usize, Failure> {
    // SAFETY: guaranteed by the caller (see # Safety).
    let character = memory::watch(|| unsafe { character(skeleton, rig) })??;
    CHARACTERS.insert(handle::boxed(character)?)
}

/// # Safety
/// See [`make`].
unsafe fn character(skeleton: &Skeleton, given: &UmoRig) -> Result<Character, Failure> {
    let axes = crate::axes(given.axes)?;
    if !(0.0..=1.0).contains(&given.gain) {
        return Err(Failure::argument(format_args!("`rig.gain` is {}: expected 0 to 1", given.gain)));
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let rig = unsafe { read_rig(given, axes)? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let mapping = unsafe { read_mapping(given, &rig)? };
    let mut retarget = Retarget::new(skeleton, &rig, &mapping, Floor::AtRest)?;
    // SAFETY: guaranteed by the caller (see # Safety).
    let points = unsafe { read_points(given, axes, &rig)? };
    if let Some(mut volume) = Volume::measure(&rig, &mapping, &points) {
        for (part, factor) in PARTS.into_iter().zip(given.girths) {
            volume.scale(part, factor).map_err(Failure::argument)?;
        }
        retarget.set_volume(&rig, &mapping, &volume, given.gain)?;
    }
    let mut joints = vec![-1; rig.len()];
    for follow in mapping.follows() {
        joints[follow.bone] = i32::try_from(follow.joints[1]).unwrap_or(-1);
    }
    let parent = rig.bones()[retarget.hips()].parent;
    let above = parent.map_or(([0.0; 3], IDENTITY), |bone| (rig.place(bone), rig.rotation(bone)));
    let room = Mutex::new((retarget.scratch(), vec![IDENTITY; rig.len()]));
    Ok(Character { axes, retarget, joints, above, room })
}

/// Bones relative to their parents, in metres and umo's axes.
///
/// # Safety
/// See [`make`].
unsafe fn read_rig(given: &UmoRig, axes: Axes) -> Result<Rig, Failure> {
    let count = given.bone_count as usize;
    if !(1..=umo_core::MAX_BONES).contains(&count) {
        let what = format_args!("`rig.bone_count` is {count}: expected 1 to {}", umo_core::MAX_BONES);
        return Err(Failure::argument(what));
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let parents = unsafe { ffi::slice(given.parents, count, "rig.parents")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let places = unsafe { ffi::slice(given.places, 3 * count, "rig.places")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let rotations = unsafe { ffi::slice(given.rotations, 4 * count, "rig.rotations")? };
    let names: &[*const c_char] = match given.names.is_null() {
        true => &[],
        // SAFETY: guaranteed by the caller (see # Safety).
        false => unsafe { ffi::slice(given.names, count, "rig.names")? },
    };
    let rest = |bone: usize| {
        let place = axes.place_from(std::array::from_fn(|i| places[3 * bone + i]));
        let rotation: Quat = std::array::from_fn(|i| rotations[4 * bone + i]);
        let is_rotation = rotation.iter().map(|x| x * x).sum::<f32>() > 0.0;
        if !is_rotation || !place.iter().chain(&rotation).all(|x| x.is_finite()) {
            let what = format_args!("bone {bone}: its rest is {place:?} {rotation:?}, not a place and a rotation");
            return Err(Failure::argument(what));
        }
        Ok((place, normalized(axes.rotation_from(rotation))))
    };
    let mut bones = Vec::with_capacity(count);
    for (at, &parent) in parents.iter().enumerate() {
        let parent = match usize::try_from(parent) {
            Ok(parent) if parent < count => Some(parent),
            Err(_) if parent == -1 => None,
            _ => {
                let what = format_args!("bone {at}: parent {parent} is neither -1 nor one of {count} bones");
                return Err(Failure::argument(what));
            }
        };
        let (place, rotation) = rest(at)?;
        let (from, above) = parent.map_or(Ok(([0.0; 3], IDENTITY)), rest)?;
        let name = match names.get(at) {
            // SAFETY: guaranteed by the caller (see # Safety).
            Some(&name) => unsafe { ffi::string(name, "rig.names")? }.to_owned(),
            None => format!("bone {at}"),
        };
        let step = std::array::from_fn(|i| place[i] - from[i]);
        let mut bone = Bone::new(name, parent, rotate(inverse(above), step));
        bone.rotation = product(inverse(above), rotation);
        bones.push(bone);
    }
    Ok(Rig::new(bones)?)
}

/// # Safety
/// See [`make`].
unsafe fn read_mapping(given: &UmoRig, rig: &Rig) -> Result<Mapping, Failure> {
    if given.joints.is_null() {
        if given.names.is_null() {
            return Err(Failure::null("rig.names` or `rig.joints"));
        }
        return Ok(Mapping::guess(rig)?.0);
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let joints = unsafe { ffi::slice(given.joints, rig.len(), "rig.joints")? };
    let (mut mapping, mut of) = (Mapping::default(), [const { Vec::new() }; JOINTS]);
    for (bone, &joint) in joints.iter().enumerate() {
        match usize::try_from(joint) {
            Ok(3 | 6 | 9) => of[3].push(bone),
            Ok(joint) if joint < JOINTS => of[joint].push(bone),
            Err(_) if joint == -1 => {}
            _ => {
                let what = format_args!("bone {bone}: joint {joint} is neither -1 nor one of {JOINTS}");
                return Err(Failure::argument(what));
            }
        }
    }
    let depth = |&bone: &usize| std::iter::successors(Some(bone), |&at| rig.bones()[at].parent).count();
    for (joint, bones) in of.iter_mut().enumerate().filter(|(_, bones)| !bones.is_empty()) {
        bones.sort_by_key(depth);
        let name = match joint {
            3 => "spine",
            12 => "neck",
            joint => JOINT_NAMES[joint],
        };
        mapping.put(name, bones)?;
    }
    Ok(mapping)
}

/// # Safety
/// See [`make`].
unsafe fn read_points(given: &UmoRig, axes: Axes, rig: &Rig) -> Result<Vec<SurfacePoint>, Failure> {
    let (count, corners) = (given.vertex_count as usize, given.index_count as usize);
    if !corners.is_multiple_of(3) {
        return Err(Failure::argument(format_args!(
            "`rig.index_count` is {corners}: expected three for each triangle"
        )));
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let places = unsafe { ffi::slice(given.vertices, 3 * count, "rig.vertices")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let bones = unsafe { ffi::slice(given.vertex_bones, count, "rig.vertex_bones")? };
    // SAFETY: guaranteed by the caller (see # Safety).
    let indices = unsafe { ffi::slice(given.indices, corners, "rig.indices")? };
    let point = |(at, place): (usize, &[f32; 3])| {
        let bone = match usize::try_from(bones[at]) {
            Ok(bone) if bone < rig.len() => Some(bone),
            Err(_) if bones[at] == -1 => None,
            _ => {
                let what = format_args!("point {at}: bone {} is neither -1 nor one of {}", bones[at], rig.len());
                return Err(Failure::argument(what));
            }
        };
        match place.iter().all(|x| x.is_finite()) {
            true => Ok((axes.place_from(*place), bone)),
            false => Err(Failure::argument(format_args!("point {at}: {place:?} is not a place"))),
        }
    };
    let points = places.as_chunks::<3>().0.iter().enumerate().map(point).collect::<Result<Vec<_>, _>>()?;
    if corners == 0 {
        let points =
            points.into_iter().filter_map(|(place, bone)| Some(SurfacePoint { bone: bone?, place, area: 1.0 }));
        return Ok(points.collect());
    }
    if let Some(index) = indices.iter().find(|&&index| index as usize >= count) {
        return Err(Failure::argument(format_args!("`rig.indices` has {index}: there are {count} points")));
    }
    Ok(spread(&points, indices.as_chunks::<3>().0.iter().map(|corners| corners.map(|x| x as usize)).collect()))
}

pub(super) fn free(handle: usize) -> Result<(), Failure> {
    CHARACTERS.remove(handle).map(drop)
}

pub(super) fn joints(handle: usize, joints: &mut [i32]) -> Result<(), Failure> {
    let character = CHARACTERS.get(handle)?;
    check(&character, joints.len())?;
    joints.copy_from_slice(&character.joints);
    Ok(())
}

fn check(character: &Character, count: usize) -> Result<(), Failure> {
    match character.joints.len() {
        own if own == count => Ok(()),
        own => Err(Failure::argument(format_args!("`bone_count` is {count}: the character has {own} bones"))),
    }
}

/// Sets the time from a pose to the next.
pub(super) fn set_step(handle: usize, seconds: f32) -> Result<(), Failure> {
    if !(seconds >= 0.0 && seconds.is_finite()) {
        return Err(Failure::argument(format_args!(
            "`seconds` is {seconds}: expected the time from a pose to the next"
        )));
    }
    let character = CHARACTERS.get(handle)?;
    character.enter()?.0.set_step(seconds);
    Ok(())
}

/// Puts a pose on a character.
pub(super) fn apply(
    handle: usize,
    turns: &[f32],
    translation: &[f32],
    rotations: &mut [f32],
    place: Option<&mut [f32]>,
) -> Result<(), Failure> {
    let character = CHARACTERS.get(handle)?;
    check(&character, rotations.len() / 4)?;
    if !turns.iter().chain(translation).all(|x| x.is_finite()) {
        return Err(Failure::argument("the pose has a number that is not finite"));
    }
    let axes = character.axes;
    let mut pose = Pose::REST;
    for (own, turn) in pose.rotations.iter_mut().zip(turns.as_chunks::<4>().0) {
        *own = axes.rotation_from(*turn);
    }
    pose.translation = axes.place_from([translation[0], translation[1], translation[2]]);
    let mut room = character.enter()?;
    let (scratch, turned) = &mut *room;
    let hips = character.retarget.apply(scratch, &pose, turned).map_err(Failure::argument)?;
    for (out, turn) in rotations.as_chunks_mut::<4>().0.iter_mut().zip(turned.iter()) {
        *out = axes.rotation(*turn);
    }
    if let Some(out) = place {
        let (from, above) = character.above;
        let step = rotate(above, hips);
        out.copy_from_slice(&axes.place(std::array::from_fn(|i| from[i] + step[i])));
    }
    Ok(())
}
