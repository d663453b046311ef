//! `.csv`: the face in the Live Link Face app's recording format.

use super::{FaceError, rotation};
use std::io::{self, Write};
use umo_core::{Face, FaceKind, JOINT_NAMES, JOINTS};
use umo_core_pose::clip::Clip;

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
    let places = columns(&clip.face)?;
    let mut rows = ::csv::Writer::from_writer(out);
    let start = ["Timecode", "BlendShapeCount"];
    rows.write_record(start.iter().chain(&COLUMNS).chain(&ANGLES))?;
    let count = (COLUMNS.len() + ANGLES.len()).to_string();
    for (frame, rotations) in clip.rotations.iter().enumerate() {
        rows.write_field(timecode(frame, clip.frame_rate))?;
        rows.write_field(&count)?;
        let values = clip.face(frame);
        for &place in &places {
            rows.write_field(format!("{:.6}", values[place]))?;
        }
        for angle in angles(rotations) {
            rows.write_field(format!("{angle:.6}"))?;
        }
        rows.write_record(None::<&[u8]>)?;
    }
    rows.flush()
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
