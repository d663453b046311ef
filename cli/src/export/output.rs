//! An animation file that is to be written in one of the formats.

use super::{ExportError, Format, bvh, csv, jsonl, npz};
use std::io;
use std::path::Path;
use umo_core::file::AtomicFile;
use umo_core::motion::clip::Clip;
use umo_figure::Figure;
use umo_gltf::glb::BuiltFigure;
use umo_gltf::vrma;

/// A figure, built when the first animation needs it, and again where one has another skeleton.
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

/// A file to be written. Made before a long run, it tells at once that the path cannot be written;
/// dropped without [`Output::write`], it leaves nothing behind.
#[derive(Debug)]
pub struct Output {
    format: Format,
    file: AtomicFile,
}

impl Output {
    /// Makes an empty temporary file beside `path`.
    ///
    /// # Errors
    /// [`ExportError::Io`] where `path` is no place for a file.
    pub fn create(path: &Path, format: Format) -> Result<Self, ExportError> {
        let file = AtomicFile::create(path).map_err(|cause| ExportError::Io(path.to_owned(), cause))?;
        Ok(Self { format, file })
    }

    /// Writes the animation, worn by the figure where the format holds one, and puts the file in its place.
    ///
    /// # Errors
    /// [`ExportError`] where the animation contradicts itself or does not suit the format, or the
    /// file system fails; then an earlier file of that name is as it was.
    pub fn write(self, clip: &Clip, figure: Figure) -> Result<(), ExportError> {
        self.write_with(clip, &mut FigureCache::from(figure))
    }

    /// As [`Self::write`], with a figure that is kept for further animations.
    ///
    /// # Errors
    /// As those of [`Self::write`].
    pub fn write_with(self, clip: &Clip, figure: &mut FigureCache) -> Result<(), ExportError> {
        clip.check().map_err(ExportError::Clip)?;
        self.format.check_face(&clip.face)?;
        let path = self.file.path().to_owned();
        let written = self.file.commit(|out| match self.format {
            Format::Npz => npz::write(clip, out),
            Format::Bvh => bvh::write(clip, out),
            Format::Glb => figure.on(clip)?.write(clip, out),
            Format::Vrma => vrma::write(clip, out),
            Format::Csv => csv::write(clip, out),
            Format::Jsonl => jsonl::write(clip, out),
        });
        written.map_err(|cause| ExportError::Io(path, cause))
    }
}
