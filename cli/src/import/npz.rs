//! Reader of `.npz` files written by `umo` and other SMPL-X tools.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use npyz::{DType, NpyFile, TypeChar};
use umo_core::{Face, FaceKind, JOINTS, Pose};
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, product, rotate};
use zip::ZipArchive;

/// Upper bound on the values of one array: an hour of poses at 240 a second.
const MAX_VALUES: u64 = 240 * 3600 * 165;
/// Number of SMPL-H joints: SMPL-X's without jaw and eyes.
const SMPL_H: usize = 52;
const WAY_OUT: &str =
    "the axis-angles of SMPL-X's 55 joints are read, and SMPL-H's 52: AMASS offers its motions as SMPL-X";
/// Names of the frame rate in files.
const RATES: [&str; 3] = ["mocap_frame_rate", "mocap_framerate", "fps"];
/// Threshold on the mean component of the body's up direction along an axis, above which that axis is up.
const UPRIGHT: f32 = 0.7;
/// Minimum mean height of the hips of a body that is not lying down, metres.
const LOWEST: f32 = 0.4;
/// Number of coefficients of an SMPL-X face.
const EXPRESSIONS: usize = 100;

/// An open `.npz` file.
pub(crate) type Archive = ZipArchive<BufReader<File>>;

/// Shape and values of an array.
type Array = (Vec<usize>, Vec<f32>);

/// Opens an `.npz` file.
///
/// # Errors
/// A description of the file system's error, or that the file is not a zip archive.
pub(crate) fn open(path: &Path) -> Result<Archive, String> {
    let file = umo_core_base::file::open(path).map_err(|error| error.to_string())?;
    ZipArchive::new(BufReader::new(file)).map_err(|error| format!("not an npz file: {error}"))
}

/// Reads the motion on the default model's skeleton: `poses` and, if present, `trans`, `arkit` or `expressions`, and
/// the frame rate. Also returns notes about assumed values and about values that were converted.
pub(super) fn read(path: &Path) -> Result<(Clip, Vec<String>), String> {
    let mut archive = open(path)?;
    let skeleton = crate::model::skeleton().map_err(|error| error.to_string())?;
    let face = match names(&mut archive, "arkit_names")? {
        Some(names) => super::face(names),
        None => {
            let names = (0..EXPRESSIONS).map(|i| format!("expression_{i}")).collect();
            Face { kind: FaceKind::SmplxExpression, names }
        }
    };
    let (rotations, translation, face_values) = Default::default();
    fill(&mut archive, Clip { frame_rate: 30.0, skeleton, face, rotations, translation, face_values })
}

/// Appends the file's motion to `clip`, which has no frames and provides the skeleton, the face and the
/// default frame rate. Also returns notes.
pub(crate) fn fill(archive: &mut Archive, mut clip: Clip) -> Result<(Clip, Vec<String>), String> {
    let mut notes = Vec::new();
    let (shape, poses) = array(archive, "poses")?.ok_or("it has no array `poses`")?;
    let joints = match shape.get(1) {
        Some(&values) if shape.len() == 2 && values == 3 * JOINTS => JOINTS,
        Some(&values) if shape.len() == 2 && values == 3 * SMPL_H => SMPL_H,
        _ => return Err(format!("array `poses`: expected [frames, {}], got {shape:?}; {WAY_OUT}", 3 * JOINTS)),
    };
    if poses.is_empty() {
        return Err("array `poses`: it has no frames".to_owned());
    }
    if joints == SMPL_H {
        notes.push("the motion is SMPL-H with 52 joints: jaw and eyes stay at rest".to_owned());
    }
    let (frames, width) = (shape[0], clip.face.names.len());
    let translation = rows(archive, "trans", frames, 3)?;
    let name = if clip.face.kind == FaceKind::Arkit { "arkit" } else { "expressions" };
    let face = rows(archive, name, frames, width)?;
    for frame in 0..frames {
        let (pose, _) = poses[frame * 3 * joints..(frame + 1) * 3 * joints].as_chunks::<3>();
        let rotations = std::array::from_fn(|joint| match joint {
            // The jaw and the eyes precede the hands.
            22..25 if joints == SMPL_H => IDENTITY,
            25.. => axis_angle_to_quat(pose[joint + joints - JOINTS]),
            _ => axis_angle_to_quat(pose[joint]),
        });
        let place = &translation[3 * frame..];
        let pose = Pose { rotations, translation: [place[0], place[1], place[2]] };
        clip.push(&pose, &face[frame * width..(frame + 1) * width]);
    }
    match rate(archive)? {
        Some(rate) => clip.frame_rate = rate,
        None => notes.push(format!(
            "the file has no frame rate (`{}`): {} frames a second are assumed",
            RATES[0], clip.frame_rate
        )),
    }
    if is_z_up(&clip) {
        turn_upright(&mut clip);
        notes.push("the motion has Z up, as in AMASS: it was rotated to Y up".to_owned());
    }
    Ok((clip, notes))
}

/// Returns frames per second, if the file states them.
fn rate(archive: &mut Archive) -> Result<Option<f32>, String> {
    for name in RATES {
        if let Some((_, rate)) = array(archive, name)? {
            let rate = rate.first().copied().filter(|rate| (1.0..=1000.0).contains(rate));
            return rate.map(Some).ok_or_else(|| format!("array `{name}`: expected 1 to 1000"));
        }
    }
    Ok(None)
}

/// Whether Z is the up axis of a motion: on average, the body's up direction is along Z more than along Y,
/// and the hips are high along Z. The height excludes a body that lies down.
fn is_z_up(clip: &Clip) -> bool {
    let count = clip.len() as f32;
    let mean = |of: &dyn Fn(usize) -> f32| (0..clip.len()).map(of).sum::<f32>() / count;
    let up = |axis: usize| mean(&|frame| rotate(clip.rotations[frame][0], [0.0, 1.0, 0.0])[axis]);
    let hips = mean(&|frame| clip.translation[frame][2]);
    up(2) > UPRIGHT && up(1).abs() < up(2) && hips > LOWEST
}

/// Rotates a motion from Z up to Y up, keeping X.
fn turn_upright(clip: &mut Clip) {
    let quarter = axis_angle_to_quat([-std::f32::consts::FRAC_PI_2, 0.0, 0.0]);
    let offset = clip.skeleton.offsets_m[0];
    for (rotations, place) in clip.rotations.iter_mut().zip(&mut clip.translation) {
        rotations[0] = product(quarter, rotations[0]);
        let turned = rotate(quarter, std::array::from_fn(|i| place[i] + offset[i]));
        *place = std::array::from_fn(|i| turned[i] - offset[i]);
    }
}

/// Returns `width` values per frame from an array, truncated or padded with zeros; all zeros if the array is missing.
fn rows(archive: &mut Archive, name: &str, frames: usize, width: usize) -> Result<Vec<f32>, String> {
    let mut values = vec![0.0; frames * width];
    let Some((shape, array)) = array(archive, name)? else { return Ok(values) };
    if shape.len() != 2 || shape[0] != frames {
        return Err(format!("array `{name}`: expected [{frames}, …], got {shape:?}"));
    }
    let have = shape[1];
    for (out, row) in values.chunks_exact_mut(width.max(1)).zip(array.chunks_exact(have.max(1))) {
        let count = width.min(have);
        out[..count].copy_from_slice(&row[..count]);
    }
    Ok(values)
}

/// Reads shape and values of an array of numbers; `None` if it is missing.
fn array(archive: &mut Archive, name: &str) -> Result<Option<Array>, String> {
    let wrong = |problem: String| format!("array `{name}`: {problem}");
    let Ok(entry) = archive.by_name(&format!("{name}.npy")) else { return Ok(None) };
    let npy = NpyFile::new(entry).map_err(|error| wrong(error.to_string()))?;
    let shape: Vec<usize> = npy.shape().iter().map(|&n| usize::try_from(n).unwrap_or(usize::MAX)).collect();
    let count = npy.shape().iter().try_fold(1_u64, |product, &n| product.checked_mul(n));
    if count.is_none_or(|count| count > MAX_VALUES) {
        return Err(wrong(format!("{shape:?} is too large")));
    }
    if npy.order() == npyz::Order::Fortran && shape.len() > 1 {
        return Err(wrong("expected C order, got Fortran order".to_owned()));
    }
    let values = numbers(npy).map_err(wrong)?;
    match values.iter().all(|v| v.is_finite()) {
        true => Ok(Some((shape, values))),
        false => Err(wrong("it holds a value that is not a finite number".to_owned())),
    }
}

/// Converts values of a number type to f32.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is intended")]
#[expect(clippy::cast_precision_loss, reason = "rounding to f32 is intended")]
fn numbers<R: Read>(npy: NpyFile<R>) -> Result<Vec<f32>, String> {
    fn all<R: Read, T: npyz::Deserialize>(npy: NpyFile<R>, f: impl Fn(T) -> f32) -> Result<Vec<f32>, String> {
        let values = npy.into_vec::<T>().map_err(|error| error.to_string())?;
        Ok(values.into_iter().map(f).collect())
    }
    let DType::Plain(kind) = npy.dtype() else { return Err("expected numbers, got a record".to_owned()) };
    match (kind.type_char(), kind.size_field()) {
        (TypeChar::Float, 4) => all(npy, |v: f32| v),
        (TypeChar::Float, 8) => all(npy, |v: f64| v as f32),
        (TypeChar::Int, 4) => all(npy, |v: i32| v as f32),
        (TypeChar::Int, 8) => all(npy, |v: i64| v as f32),
        _ => Err(format!("expected 32- or 64-bit numbers, got {kind}")),
    }
}

/// Reads an array of strings; `None` if it is missing.
fn names(archive: &mut Archive, name: &str) -> Result<Option<Vec<String>>, String> {
    let wrong = |problem: String| format!("array `{name}`: {problem}");
    let Ok(entry) = archive.by_name(&format!("{name}.npy")) else { return Ok(None) };
    let npy = NpyFile::new(entry).map_err(|error| wrong(error.to_string()))?;
    let DType::Plain(kind) = npy.dtype() else { return Err(wrong("expected texts, got a record".to_owned())) };
    if kind.type_char() != TypeChar::UnicodeStr || kind.size_field() > 256 || npy.len() > 4096 {
        return Err(wrong(format!("expected up to 4096 texts of up to 256 characters, got {} of {kind}", npy.len())));
    }
    npy.into_vec::<String>().map(Some).map_err(|error| wrong(error.to_string()))
}
