//! `--start-pose`: the last keyframes of a real motion as the history.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use npyz::{DType, NpyFile, TypeChar};
use umo_core::config::FaceKind;
use umo_core::motion::clip::{Clip, MotionEncoder};
use umo_core::motion::pose::Pose;
use umo_core::motion::rotation::axis_angle_to_quat;
use umo_core::motion::skeleton::JOINTS;
use umo_core::weights::Loader;
use umo_core::{Compute, Config, Part, PerPart, Precision};
use zip::ZipArchive;

use crate::failure::Failure;

/// Most values of one array: an hour of poses at 240 a second.
const MAX_VALUES: u64 = 240 * 3600 * 165;

type Archive = ZipArchive<BufReader<File>>;

/// Shape and values.
type Array = (Vec<usize>, Vec<f32>);

/// Codes of the keyframes that end with the file's last frame, oldest first.
pub(crate) fn codes(cx: Compute, loader: &Loader, path: &Path) -> Result<PerPart<Vec<u16>>, Failure> {
    let config = loader.file().config();
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    // A choice among codes, like the tokenizer's, is made in full precision.
    let loader = Loader::new(loader.file(), Precision::F32, loader.isa());
    let encoder = MotionEncoder::load(&loader)?
        .ok_or_else(|| Failure::input("this model cannot start from a pose: it has no `vq.*.encoder` tensors"))?;
    let clip = read(path, config).map_err(wrong)?;
    let codes = encoder.encode_clip(cx, &clip)?;
    let stride = config.keyframe_stride;
    Ok(PerPart::from_fn(|part| {
        let mut keyframes: Vec<u16> = codes[part].iter().rev().step_by(stride).take(config.prefix).copied().collect();
        keyframes.reverse();
        keyframes
    }))
}

/// The motion in an SMPL-X `.npz` file: `poses` and, where there, `trans`, `expressions` or `arkit`, the frame rate.
fn read(path: &Path, config: &Config) -> Result<Clip, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    let mut archive = ZipArchive::new(BufReader::new(file)).map_err(|error| format!("not an npz file: {error}"))?;
    let (shape, poses) = array(&mut archive, "poses")?.ok_or("it has no array `poses`")?;
    if shape.len() != 2 || shape[1] != 3 * JOINTS || poses.is_empty() {
        return Err(format!("array `poses`: expected [frames, {}], got {shape:?}", 3 * JOINTS));
    }
    let frames = shape[0];
    let translation = rows(&mut archive, "trans", frames, 3)?;
    let name = if config.face.kind == FaceKind::Arkit { "arkit" } else { "expressions" };
    let face = rows(&mut archive, name, frames, config.face.names.len())?;
    let mut clip = Clip::new(config);
    for frame in 0..frames {
        let pose = &poses[frame * 3 * JOINTS..(frame + 1) * 3 * JOINTS];
        let rotations = std::array::from_fn(|j| axis_angle_to_quat([pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]]));
        let place = &translation[3 * frame..];
        let pose = Pose { rotations, translation: [place[0], place[1], place[2]] };
        let width = config.face.names.len();
        clip.push(&pose, &face[frame * width..(frame + 1) * width]);
    }
    let wanted = clip.frame_rate;
    if let Some((_, rate)) = array(&mut archive, "mocap_frame_rate")? {
        let rate = rate.first().copied().filter(|rate| (1.0..=1000.0).contains(rate));
        clip.frame_rate = rate.ok_or("array `mocap_frame_rate`: expected 1 to 1000")?;
    }
    Ok(clip.at_rate(wanted))
}

/// `width` values per frame: those of an array, cut or padded with zeros; all zeros where it is missing.
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

/// Shape and values of an array of numbers.
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

/// Values of any number type as f32.
#[expect(clippy::cast_possible_truncation, reason = "rounding to f32 is what is wanted")]
#[expect(clippy::cast_precision_loss, reason = "rounding to f32 is what is wanted")]
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

/// The codes of every part as slices.
pub(crate) fn as_slices(codes: &PerPart<Vec<u16>>) -> PerPart<&[u16]> {
    PerPart::from_fn(|part: Part| codes[part].as_slice())
}
