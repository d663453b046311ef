//! Writing an animation to a file: one module per format; `.glb` and `.vrma` are in crate `umo_gltf`.
//!
//! | module | file |
//! | --- | --- |
//! | `npz` | NumPy arrays for SMPL-X and BEAT2 tools |
//! | `bvh` | skeleton motion for Blender, MotionBuilder and others |
//! | `csv` | the face in the Live Link Face app's recording format |
//! | `jsonl` | the whole animation, one frame a line |
//! | `output` | an atomically written file |
//! | `rotation` | conversion of quaternions to the formats' rotations |

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use umo_core::Face;
use umo_core_pose::clip::Clip;
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
    /// All formats.
    pub const ALL: [Self; 6] = [Self::Npz, Self::Bvh, Self::Glb, Self::Vrma, Self::Csv, Self::Jsonl];

    /// Returns the name, which is also the file extension.
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

    /// Returns the format named `name`, in any case.
    ///
    /// # Errors
    /// [`ExportError::UnknownFormat`].
    pub fn parse(name: &str) -> Result<Self, ExportError> {
        Self::ALL
            .into_iter()
            .find(|format| format.name().eq_ignore_ascii_case(name))
            .ok_or_else(|| ExportError::UnknownFormat(name.to_owned()))
    }

    /// Returns the format that a path's extension names.
    ///
    /// # Errors
    /// [`ExportError::NoExtension`] or [`ExportError::UnknownFormat`].
    pub fn from_extension(path: &Path) -> Result<Self, ExportError> {
        let extension = path.extension().ok_or_else(|| ExportError::NoExtension(path.to_owned()))?;
        Self::parse(&extension.to_string_lossy())
    }

    /// Checks whether a face can be written in this format; call it before a long run.
    ///
    /// # Errors
    /// [`ExportError::Face`] if the face lacks a channel that the format needs.
    pub fn check_face(self, face: &Face) -> Result<(), ExportError> {
        match self {
            Self::Csv => csv::columns(face).map(drop).map_err(ExportError::Face),
            Self::Npz | Self::Bvh | Self::Glb | Self::Vrma | Self::Jsonl => Ok(()),
        }
    }

    /// Whether the format can be written with fewer keys.
    pub const fn is_keyed(self) -> bool {
        !matches!(self, Self::Npz | Self::Jsonl)
    }
}

/// Writes an animation with the default figure; without a `format`, the extension determines it.
///
/// The file is written atomically.
///
/// # Errors
/// [`ExportError`]; file system errors name the path.
pub fn write(path: &Path, format: Option<Format>, clip: &Clip) -> Result<(), ExportError> {
    let format = format.map_or_else(|| Format::from_extension(path), Ok)?;
    format.check_face(&clip.face)?;
    Output::create(path, format)?.write(clip, Figure::default())
}

/// Error of writing an animation.
#[derive(Debug)]
pub enum ExportError {
    /// Unknown format name.
    UnknownFormat(String),
    /// The path has no extension to determine the format.
    NoExtension(PathBuf),
    /// The format has a value for every frame.
    NoKeys(Format),
    /// The face lacks channels that the format needs.
    Face(FaceError),
    /// The animation is inconsistent; names the field and its problem.
    Clip(&'static str),
    /// Error of the file system, and the path.
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
            Self::NoKeys(format) => {
                write!(f, "--reduce: .{} has every frame; .glb, .vrma, .bvh and .csv take fewer keys", format.name())
            }
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

/// Reason why a face does not fit Live Link Face files and packets.
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

/// Returns the end of a childless joint's bone, relative to the joint: half the offset from its parent,
/// or 2 cm forward if that is shorter than 1 mm.
fn tip(clip: &Clip, joint: usize) -> [f32; 3] {
    let half = clip.skeleton.offsets_m[joint].map(|x| x * 0.5);
    let length = half.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length < 1e-3 { [0.0, 0.0, 0.02] } else { half }
}

#[cfg(test)]
mod tests;
