//! NumPy archives with SMPL-X motion.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::Path;

use npyz::{DType, NpyFile, NpyHeader, TypeChar};
use umo_core::config::{Face, FaceKind, Skeleton};
use umo_core::motion::clip::Clip;
use umo_core::motion::pose::Pose;
use umo_core::motion::rotation::axis_angle_to_quat;
use umo_core::motion::skeleton::JOINTS;
use zip::ZipArchive;

/// Most values of one array: an hour of poses at 240 a second.
const MAX_VALUES: u64 = 240 * 3600 * 165;
/// Most bytes of a list of names.
const MAX_NAMES: u64 = 1 << 20;

type Archive = ZipArchive<BufReader<File>>;

/// Shape and values.
type Array = (Vec<usize>, Vec<f32>);

/// The motion in a file, with the bones and the face of `empty`, at the file's own frame rate where it says one: `poses`
/// and, where there, `trans`, `expressions` or `arkit`, the frame rate.
pub(crate) fn read(path: &Path, empty: Clip) -> Result<Clip, String> {
    motion(&mut open(path)?, empty)
}

/// The motion in a file that this program wrote, with the face that it has.
pub(crate) fn read_own(path: &Path, skeleton: &Skeleton) -> Result<Clip, String> {
    let mut archive = open(path)?;
    let face = match names(&mut archive, "arkit_names")? {
        Some(names) => Face { kind: FaceKind::Arkit, names },
        None => {
            let coefficients =
                array(&mut archive, "expressions")?.map_or(0, |(shape, _)| shape.get(1).copied().unwrap_or(0));
            let names = (0..coefficients).map(|i| format!("expression_{i}")).collect();
            Face { kind: FaceKind::SmplxExpression, names }
        }
    };
    let empty = Clip {
        frame_rate: 30.0,
        skeleton: skeleton.clone(),
        face,
        rotations: Vec::new(),
        translation: Vec::new(),
        face_values: Vec::new(),
    };
    motion(&mut archive, empty)
}

fn open(path: &Path) -> Result<Archive, String> {
    let file = File::open(path).map_err(|error| error.to_string())?;
    ZipArchive::new(BufReader::new(file)).map_err(|error| format!("not an npz file: {error}"))
}

fn motion(archive: &mut Archive, mut clip: Clip) -> Result<Clip, String> {
    let (shape, poses) = array(archive, "poses")?.ok_or("it has no array `poses`")?;
    if shape.len() != 2 || shape[1] != 3 * JOINTS || poses.is_empty() {
        return Err(format!("array `poses`: expected [frames, {}], got {shape:?}", 3 * JOINTS));
    }
    let frames = shape[0];
    let translation = rows(archive, "trans", frames, 3)?;
    let name = if clip.face.kind == FaceKind::Arkit { "arkit" } else { "expressions" };
    let width = clip.face.names.len();
    let face = rows(archive, name, frames, width)?;
    for frame in 0..frames {
        let pose = &poses[frame * 3 * JOINTS..(frame + 1) * 3 * JOINTS];
        let rotations = std::array::from_fn(|j| axis_angle_to_quat([pose[3 * j], pose[3 * j + 1], pose[3 * j + 2]]));
        let place = &translation[3 * frame..];
        let pose = Pose { rotations, translation: [place[0], place[1], place[2]] };
        clip.push(&pose, &face[frame * width..(frame + 1) * width]);
    }
    if let Some((_, rate)) = array(archive, "mocap_frame_rate")? {
        let rate = rate.first().copied().filter(|rate| (1.0..=1000.0).contains(rate));
        clip.frame_rate = rate.ok_or("array `mocap_frame_rate`: expected 1 to 1000")?;
    }
    Ok(clip)
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

/// NumPy's fixed-width strings: UTF-32, padded with zeros.
fn names(archive: &mut Archive, name: &str) -> Result<Option<Vec<String>>, String> {
    let wrong = |problem: &str| format!("array `{name}`: {problem}");
    let Ok(entry) = archive.by_name(&format!("{name}.npy")) else { return Ok(None) };
    let mut bytes = Vec::new();
    entry.take(MAX_NAMES).read_to_end(&mut bytes).map_err(|error| wrong(&error.to_string()))?;
    let mut rest = bytes.as_slice();
    let header = NpyHeader::from_reader(&mut rest).map_err(|error| wrong(&error.to_string()))?;
    let kind = header.dtype().descr();
    let width = kind.trim_matches('\'').strip_prefix("<U").and_then(|width| width.parse::<usize>().ok());
    let width = width.filter(|&width| width > 0).ok_or_else(|| wrong("expected strings"))?;
    let codes = rest.as_chunks::<4>().0.iter().map(|&code| char::from_u32(u32::from_le_bytes(code)));
    let codes: Vec<char> = codes.collect::<Option<_>>().ok_or_else(|| wrong("it holds no text"))?;
    Ok(Some(codes.chunks(width).map(|row| row.iter().filter(|&&c| c != '\0').collect()).collect()))
}
