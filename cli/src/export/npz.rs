//! `.npz`: NumPy arrays for SMPL-X and BEAT2 tools.

use super::rotation;
use npyz::{DType, WriteOptions, WriterBuilder};
use std::io::{self, Cursor, Write};
use umo_core::{FaceKind, JOINTS};
use umo_core_pose::clip::Clip;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// Number of shape coefficients, all 0: the neutral body.
const BETAS: usize = 300;
/// Number of expression coefficients per frame; shorter faces are padded with 0, longer ones truncated.
const EXPRESSIONS: usize = 100;

/// Writes `betas [300]`, `poses [T, 165]` (axis-angle), `expressions [T, 100]`, `trans [T, 3]`, `model`, `gender` and
/// `mocap_frame_rate`; for an ARKit face also `arkit [T, 52]` and `arkit_names [52]`.
///
/// # Errors
/// Errors of `out`.
pub fn write<W: Write>(clip: &Clip, mut out: W) -> io::Result<()> {
    let frames = clip.rotations.len();
    let mut archive = Archive(ZipWriter::new(Cursor::default()));
    archive.floats("betas", &[BETAS], [0.0; BETAS])?;
    archive.floats("poses", &[frames, JOINTS * 3], poses(clip))?;
    let arkit = clip.face.kind == FaceKind::Arkit;
    let coefficients = |frame| {
        let values = if arkit { &[] } else { clip.face(frame) };
        let padding = std::iter::repeat(&0.0);
        values.iter().chain(padding).take(EXPRESSIONS).copied()
    };
    let expressions = (0..frames).flat_map(coefficients);
    archive.floats("expressions", &[frames, EXPRESSIONS], expressions)?;
    let translation = clip.translation.as_flattened().iter().copied();
    archive.floats("trans", &[frames, 3], translation)?;
    archive.strings("model", &[], &["smplx2020"])?;
    archive.strings("gender", &[], &["neutral"])?;
    archive.frame_rate(clip.frame_rate)?;
    if arkit {
        let names: Vec<&str> = clip.face.names.iter().map(String::as_str).collect();
        let values = clip.face_values.iter().copied();
        archive.floats("arkit", &[frames, names.len()], values)?;
        archive.strings("arkit_names", &[names.len()], &names)?;
    }
    out.write_all(archive.0.finish()?.get_ref())
}

#[expect(clippy::cast_possible_truncation, reason = "angles are computed in f64 and stored as f32")]
fn poses(clip: &Clip) -> impl Iterator<Item = f32> {
    let rotations = clip.rotations.as_flattened().iter();
    rotations.flat_map(|&q| rotation::axis_angle(q).map(|x| x as f32))
}

/// A zip file of uncompressed `.npy` files, as NumPy's `savez` writes it. It is built in memory, because
/// `ZipWriter` prints its own message if a file fails.
struct Archive(ZipWriter<Cursor<Vec<u8>>>);

impl Archive {
    fn floats(&mut self, name: &str, shape: &[usize], values: impl IntoIterator<Item = f32>) -> io::Result<()> {
        self.array(name, "<f4", shape, values)
    }

    /// Writes NumPy's fixed-width strings, as wide as the longest.
    fn strings(&mut self, name: &str, shape: &[usize], values: &[&str]) -> io::Result<()> {
        let width = values.iter().map(|s| s.chars().count()).max().unwrap_or(0);
        self.array(name, &format!("<U{width}"), shape, values.iter().copied())
    }

    /// Writes the frame rate as an integer, which tools expect, or as a float if it is fractional.
    fn frame_rate(&mut self, rate: f32) -> io::Result<()> {
        let name = "mocap_frame_rate";
        if rate.fract() == 0.0 && rate < 1e9 {
            #[expect(clippy::cast_possible_truncation, reason = "a whole number far below the limits of i64")]
            let whole = rate as i64;
            self.array(name, "<i8", &[], [whole])
        } else {
            self.array(name, "<f8", &[], [f64::from(rate)])
        }
    }

    /// Writes one array of `dtype`, in NumPy's notation. `values` fill `shape` exactly, in C order.
    fn array<T: Element>(
        &mut self,
        name: &str,
        dtype: &str,
        shape: &[usize],
        values: impl IntoIterator<Item = T>,
    ) -> io::Result<()> {
        let options = SimpleFileOptions::default()
            .compression_method(CompressionMethod::Stored)
            .large_file(u32::try_from(shape.iter().product::<usize>() * size_of::<f64>() + 1024).is_err());
        self.0.start_file(format!("{name}.npy"), options)?;
        let dtype = DType::Plain(dtype.parse().expect("a type in NumPy's notation"));
        let shape: Vec<u64> = shape.iter().map(|&size| size as u64).collect();
        let options = WriteOptions::<T::Stored>::new().dtype(dtype).shape(&shape);
        let mut writer = options.writer(&mut self.0).begin_nd()?;
        values.into_iter().try_for_each(|value| writer.push(value.stored()))?;
        writer.finish()
    }
}

/// A value of an array, in the form that `npyz` accepts.
trait Element {
    /// Type as written.
    type Stored: npyz::Serialize + ?Sized;

    fn stored(&self) -> &Self::Stored;
}

impl Element for &str {
    type Stored = str;

    fn stored(&self) -> &str {
        self
    }
}

macro_rules! number {
    ($($number:ty),*) => {$(
        impl Element for $number {
            type Stored = Self;

            fn stored(&self) -> &Self {
                self
            }
        }
    )*};
}

number!(f32, f64, i64);
