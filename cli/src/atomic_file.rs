//! Files that appear whole or not at all, with the program's messages.

use std::fs::File;
use std::io::{self, BufWriter};
use std::path::Path;

use umo_core::file::AtomicFile;

use crate::failure::Failure;

/// [`AtomicFile::create`] with the program's message.
pub(crate) fn create(path: &Path) -> Result<AtomicFile, Failure> {
    AtomicFile::create(path).map_err(|cause| Failure::input(format!("cannot write `{}`: {cause}", path.display())))
}

/// [`AtomicFile::commit`] with the program's message.
pub(crate) fn commit(
    whole: AtomicFile,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), Failure> {
    let path = whole.path().to_owned();
    whole.commit(write).map_err(|cause| Failure::environment(format!("cannot write `{}`: {cause}", path.display())))
}
