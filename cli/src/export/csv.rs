//! `.csv`: the face in the Live Link Face app's recording format.

use super::{FaceError, rotation};
use std::io::{self, Write};
use umo_core::{Face, FaceKind, JOINT_NAMES, JOINTS};
use umo_core_pose::clip::Clip;
use umo_gltf::keys::{Keying, MarkerKind};

/// Names of the blendshape columns, in the app's order (which swaps some of Apple's left and right).
const COLUMNS: [&str; 52] = [
    "EyeBlinkLeft",
    "EyeLookDownLeft",
    "EyeLookInLeft",
    "EyeLookOutLeft",
    "EyeLookUpLeft",
    "EyeSquintLeft",
    "EyeWideLeft",
    "EyeBlinkRight",
    "EyeLookDownRight",
    "EyeLookInRight",
    "EyeLookOutRight",
    "EyeLookUpRight",
    "EyeSquintRight",
    "EyeWideRight",
    "JawForward",
    "JawRight",
    "JawLeft",
    "JawOpen",
    "MouthClose",
    "MouthFunnel",
    "MouthPucker",
    "MouthRight",
    "MouthLeft",
    "MouthSmileLeft",
    "MouthSmileRight",
    "MouthFrownLeft",
    "MouthFrownRight",
    "MouthDimpleLeft",
    "MouthDimpleRight",
    "MouthStretchLeft",
    "MouthStretchRight",
    "MouthRollLower",
    "MouthRollUpper",
    "MouthShrugLower",
    "MouthShrugUpper",
    "MouthPressLeft",
    "MouthPressRight",
    "MouthLowerDownLeft",
    "MouthLowerDownRight",
    "MouthUpperUpLeft",
    "MouthUpperUpRight",
    "BrowDownLeft",
    "BrowDownRight",
    "BrowInnerUp",
    "BrowOuterUpLeft",
    "BrowOuterUpRight",
    "CheekPuff",
    "CheekSquintLeft",
    "CheekSquintRight",
    "NoseSneerLeft",
    "NoseSneerRight",
    "TongueOut",
];

/// Columns after the blendshapes: angles in radians.
const ANGLES: [&str; 9] = [
    "HeadYaw",
    "HeadPitch",
    "HeadRoll",
    "LeftEyeYaw",
    "LeftEyePitch",
    "LeftEyeRoll",
    "RightEyeYaw",
    "RightEyePitch",
    "RightEyeRoll",
];

/// Columns of a file with few rows, after the angles.
const MARKERS: [(MarkerKind, &str); 2] = [(MarkerKind::Stroke, "Stroke"), (MarkerKind::Word, "Word")];

/// Returns the index of each blendshape column among the face's channels.
///
/// # Errors
/// See [`places`].
pub(super) fn columns(face: &Face) -> Result<Vec<usize>, FaceError> {
    places(face, &COLUMNS)
}

/// Returns the index of each of ARKit's `shapes`, in any case, among the face's channels.
///
/// # Errors
/// [`FaceError`] if the face is not ARKit's or lacks a blendshape.
pub(crate) fn places(face: &Face, shapes: &[&'static str]) -> Result<Vec<usize>, FaceError> {
    if face.kind != FaceKind::Arkit {
        return Err(FaceError::NotArkit);
    }
    let place = |&shape: &&'static str| {
        let mut names = face.names.iter();
        names.position(|name| name.eq_ignore_ascii_case(shape)).ok_or(FaceError::Missing(shape))
    };
    shapes.iter().map(place).collect()
}

/// Returns a pose's angles in radians: yaw about Y, pitch about X and roll about Z of the head, the left
/// eye and the right eye. Each rotation is `yaw * pitch * roll`. The head's rotation combines neck and head
/// and is relative to the chest.
pub(crate) fn angles(rotations: &[[f32; 4]; JOINTS]) -> [f64; 9] {
    let joint = |name| {
        let joint = JOINT_NAMES.iter().position(|&joint| joint == name).expect("a name of SMPL-X's joints");
        rotation::matrix(rotations[joint])
    };
    let head = rotation::product(&joint("neck"), &joint("head"));
    let turned = [head, joint("left_eye"), joint("right_eye")].map(|part| rotation::euler_yxz(&part));
    std::array::from_fn(|i| turned[i / 3][i % 3])
}

/// Writes one row per frame, with head and eye angles in radians.
///
/// # Errors
/// Errors of `out`, and an error wrapping [`FaceError`] if the face is unsuitable.
pub fn write<W: Write>(clip: &Clip, out: W) -> io::Result<()> {
    write_keyed(clip, None, out)
}

/// [`write()`], with only those rows that hold every column within the bound, and markers in two more columns.
///
/// # Errors
/// As for [`write()`].
pub fn write_keyed<W: Write>(clip: &Clip, keying: Option<&Keying>, out: W) -> io::Result<()> {
    let places = columns(&clip.face)?;
    let mut rows = ::csv::Writer::from_writer(out);
    let start = ["Timecode", "BlendShapeCount"];
    let end = if keying.is_some() { &MARKERS.map(|(_, column)| column)[..] } else { &[] };
    rows.write_record(start.iter().chain(&COLUMNS).chain(&ANGLES).chain(end))?;
    let count = (COLUMNS.len() + ANGLES.len()).to_string();
    let frames = keying.map_or_else(|| (0..clip.len()).collect(), |keying| rows_of(clip, &places, keying));
    for frame in frames {
        rows.write_field(timecode(frame, clip.frame_rate))?;
        rows.write_field(&count)?;
        let values = clip.face(frame);
        for &place in &places {
            rows.write_field(format!("{:.6}", values[place]))?;
        }
        for angle in angles(&clip.rotations[frame]) {
            rows.write_field(format!("{angle:.6}"))?;
        }
        for (kind, _) in MARKERS.iter().filter(|_| keying.is_some()) {
            let here = keying.iter().flat_map(|keying| &keying.markers);
            let here = here.filter(|marker| marker.kind == *kind && frame_at(clip, marker.seconds) == frame);
            rows.write_field(here.map(|marker| &*marker.name).collect::<Vec<_>>().join(" "))?;
        }
        rows.write_record(None::<&[u8]>)?;
    }
    rows.flush()
}

/// Frames whose rows hold the others, and the rows of the markers.
#[expect(clippy::cast_possible_truncation, reason = "angles, as the file has them")]
fn rows_of(clip: &Clip, places: &[usize], keying: &Keying) -> Vec<usize> {
    let mut is_marked = vec![false; clip.len()];
    keying.markers.iter().for_each(|marker| is_marked[frame_at(clip, marker.seconds)] = true);
    // A degree weighs as much as what a weight may be off for it.
    let unit = f64::from(keying.bound.amount()) / f64::from(keying.bound.degrees()).to_radians();
    let values: Vec<f32> = (0..clip.len())
        .flat_map(|frame| {
            let face = places.iter().map(move |&place| clip.face(frame)[place]);
            face.chain(angles(&clip.rotations[frame]).map(|angle| (angle * unit) as f32))
        })
        .collect();
    keying.bound.rows(&values, places.len() + ANGLES.len(), |frame| is_marked[frame])
}

/// The frame of a moment.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded below by the cast, above by min")]
fn frame_at(clip: &Clip, seconds: f64) -> usize {
    ((seconds * f64::from(clip.frame_rate)).round() as usize).min(clip.len() - 1)
}

/// Formats `HH:MM:SS:FF.mmm`: frames within the second, then thousandths of a frame.
fn timecode(frame: usize, frame_rate: f32) -> String {
    let rate = f64::from(frame_rate);
    let seconds = (frame as f64 / rate + 1e-9).floor();
    let within = (frame as f64 - seconds * rate).max(0.0);
    let (hours, minutes) = ((seconds / 3600.0).floor(), (seconds / 60.0).floor() % 60.0);
    let seconds = seconds % 60.0;
    format!("{hours:02}:{minutes:02}:{seconds:02}:{within:06.3}")
}
