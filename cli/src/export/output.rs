//! An animation file to be written in one of the formats.

use super::{ExportError, Format, bvh, csv, jsonl, npz};
use std::io;
use std::path::Path;
use umo_core_base::file::AtomicFile;
use umo_core_pose::clip::Clip;
use umo_figure::Figure;
use umo_gltf::glb::BuiltFigure;
use umo_gltf::keys::Keying;
use umo_gltf::vrma;

/// A figure, built when the first animation needs it, and rebuilt for an animation with another skeleton.
#[derive(Debug)]
pub struct FigureCache {
    figure: Figure,
    built: Option<BuiltFigure>,
}

impl From<Figure> for FigureCache {
    fn from(figure: Figure) -> Self {
        Self { figure, built: None }
    }
}

impl FigureCache {
    fn on(&mut self, clip: &Clip) -> io::Result<&BuiltFigure> {
        let built = match self.built.take().filter(|built| built.fits(clip)) {
            Some(built) => built,
            None => BuiltFigure::new(self.figure, clip)?,
        };
        Ok(self.built.insert(built))
    }
}

/// A file to be written. Creating it before a long run reveals immediately whether the path is writable.
/// If dropped without [`Output::write`], it leaves no file behind.
#[derive(Debug)]
pub struct Output {
    format: Format,
    file: AtomicFile,
}

impl Output {
    /// Creates an empty temporary file beside `path`.
    ///
    /// # Errors
    /// [`ExportError::Io`] if no file can be created at `path`.
    pub fn create(path: &Path, format: Format) -> Result<Self, ExportError> {
        let file = AtomicFile::create(path).map_err(|cause| ExportError::Io(path.to_owned(), cause))?;
        Ok(Self { format, file })
    }

    /// Writes the animation, with the figure if the format includes one, and moves the file into place.
    ///
    /// # Errors
    /// [`ExportError`] if the animation is inconsistent or does not fit the format, or if the file system
    /// fails. An existing file at the path is then unchanged.
    pub fn write(self, clip: &Clip, figure: Figure) -> Result<(), ExportError> {
        self.write_with(clip, &mut FigureCache::from(figure))
    }

    /// Like [`Self::write`], with a figure cached for further animations.
    ///
    /// # Errors
    /// See [`Self::write`].
    pub fn write_with(self, clip: &Clip, figure: &mut FigureCache) -> Result<(), ExportError> {
        self.write_as(clip, figure, None)
    }

    /// Like [`Self::write_with`]; with a `keying`, with as few keys as it allows, and its markers.
    ///
    /// # Errors
    /// See [`Self::write`]; also if the format [has no keys](Format::is_keyed).
    pub(crate) fn write_as(
        self,
        clip: &Clip,
        figure: &mut FigureCache,
        keying: Option<&Keying>,
    ) -> Result<(), ExportError> {
        clip.check().map_err(ExportError::Clip)?;
        if keying.is_some() && !self.format.is_keyed() {
            return Err(ExportError::NoKeys(self.format));
        }
        self.format.check_face(&clip.face)?;
        let path = self.file.path().to_owned();
        let written = self.file.commit(|out| match self.format {
            Format::Npz => npz::write(clip, out),
            Format::Bvh => bvh::write_keyed(clip, keying, out),
            Format::Glb => figure.on(clip)?.write_keyed(clip, keying, out),
            Format::Vrma => vrma::write_keyed(clip, keying, out),
            Format::Csv => csv::write_keyed(clip, keying, out),
            Format::Jsonl => jsonl::write(clip, out),
        });
        written.map_err(|cause| ExportError::Io(path, cause))
    }
}
