//! Writing an animation to a file: one module per format; `.glb` and `.vrma` are crate `umo_gltf`'s.
//!
//! | module | file |
//! | --- | --- |
//! | `npz` | NumPy arrays as SMPL-X and BEAT2 tools read them |
//! | `bvh` | skeleton motion for Blender, MotionBuilder and others |
//! | `csv` | the face as the Live Link Face app records it |
//! | `jsonl` | everything, one frame a line |
//! | `output` | a file that appears whole or not at all |
//! | `rotation` | quaternions to what the formats want |

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use umo_core::config::Face;
use umo_core::motion::clip::Clip;
use umo_figure::Figure;

use crate::failure::Failure;

pub mod bvh;
pub mod csv;
pub mod jsonl;
pub mod npz;
mod output;
pub(crate) mod rotation;

pub use output::{FigureCache, Output};

/// A file format for animations.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// NumPy arrays, SMPL-X.
    Npz,
    /// Biovision hierarchy.
    Bvh,
    /// glTF 2.0, binary.
    Glb,
    /// VRM Animation 1.0.
    Vrma,
    /// Live Link Face.
    Csv,
    /// JSON lines.
    Jsonl,
}

impl Format {
    /// Every format.
    pub const ALL: [Self; 6] = [Self::Npz, Self::Bvh, Self::Glb, Self::Vrma, Self::Csv, Self::Jsonl];

    /// Its name, which is also its extension.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Npz => "npz",
            Self::Bvh => "bvh",
            Self::Glb => "glb",
            Self::Vrma => "vrma",
            Self::Csv => "csv",
            Self::Jsonl => "jsonl",
        }
    }

    /// The format of that name, in any case.
    ///
    /// # Errors
    /// [`ExportError::UnknownFormat`].
    pub fn parse(name: &str) -> Result<Self, ExportError> {
        Self::ALL
            .into_iter()
            .find(|format| format.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| ExportError::UnknownFormat(name.to_owned()))
    }

    /// The format that a path's extension names.
    ///
    /// # Errors
    /// [`ExportError::NoExtension`] or [`ExportError::UnknownFormat`].
    pub fn from_extension(path: &Path) -> Result<Self, ExportError> {
        let extension = path.extension().ok_or_else(|| ExportError::NoExtension(path.to_owned()))?;
        Self::parse(&extension.to_string_lossy())
    }

    /// Whether a face can be written in this format; worth asking before the animation is made.
    ///
    /// # Errors
    /// [`ExportError::Face`] saying what is missing.
    pub fn check_face(self, face: &Face) -> Result<(), ExportError> {
        match self {
            Self::Csv => csv::columns(face).map(drop).map_err(ExportError::Face),
            Self::Npz | Self::Bvh | Self::Glb | Self::Vrma | Self::Jsonl => Ok(()),
        }
    }
}

/// Writes an animation, worn by the default figure; the format is the extension's where none is given.
///
/// The file appears whole or not at all.
///
/// # Errors
/// [`ExportError`] naming the path where there is one.
pub fn write(path: &Path, format: Option<Format>, clip: &Clip) -> Result<(), ExportError> {
    let format = format.map_or_else(|| Format::from_extension(path), Ok)?;
    format.check_face(&clip.face)?;
    Output::create(path, format)?.write(clip, Figure::default())
}

/// Why an animation could not be written.
#[derive(Debug)]
pub enum ExportError {
    /// A format's name that is not known.
    UnknownFormat(String),
    /// A path without an extension, where the extension should name the format.
    NoExtension(PathBuf),
    /// The face has not the channels that the format needs.
    Face(FaceError),
    /// The animation contradicts itself; the field and what is wrong with it.
    Clip(&'static str),
    /// The file system's answer.
    Io(PathBuf, io::Error),
}

impl fmt::Display for ExportError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = Format::ALL.map(Format::name).join(", ");
        match self {
            Self::UnknownFormat(name) => write!(f, "unknown format `{name}`: expected {names}"),
            Self::NoExtension(path) => write!(
                f,
                "cannot tell the format of `{}`: expected an extension or --format, one of {names}",
                path.display()
            ),
            Self::Face(cause) => cause.fmt(f),
            Self::Clip(what) => write!(f, "cannot write the animation: {what}"),
            Self::Io(path, cause) => write!(f, "cannot write `{}`: {cause}", path.display()),
        }
    }
}

impl From<ExportError> for Failure {
    fn from(error: ExportError) -> Self {
        Self::input(error)
    }
}

impl std::error::Error for ExportError {}

/// What keeps a face out of Live Link Face files and packets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FaceError {
    /// The face is not ARKit's.
    NotArkit,
    /// A blendshape that is missing.
    Missing(&'static str),
}

impl fmt::Display for FaceError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotArkit => {
                f.write_str("Live Link Face needs an ARKit face: this model's face is SMPL-X expression coefficients")
            }
            Self::Missing(name) => {
                write!(f, "Live Link Face needs the 52 ARKit blendshapes: this model's face lacks `{name}`")
            }
        }
    }
}

impl std::error::Error for FaceError {}

impl From<FaceError> for io::Error {
    fn from(cause: FaceError) -> Self {
        Self::new(io::ErrorKind::InvalidInput, cause)
    }
}

/// Where a bone without children ends, from its joint: half as long again as the bone that leads
/// there.
fn tip(clip: &Clip, joint: usize) -> [f32; 3] {
    let half = clip.skeleton.offsets_m[joint].map(|x| x * 0.5);
    let length = half.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length < 1e-3 { [0.0, 0.0, 0.02] } else { half }
}

#[cfg(test)]
mod tests;
