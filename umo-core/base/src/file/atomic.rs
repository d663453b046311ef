//! File that appears completely or not at all.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Maximum length of a temporary file's name, for targets with shorter names.
const SHORT: usize = 64;

/// Existing temporary files.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn parts() -> MutexGuard<'static, Vec<PathBuf>> {
    PARTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the temporary files of all pending outputs; threads that create or finish one afterwards block forever.
/// For a program that is about to end, on a signal.
pub fn remove_parts() {
    let parts = parts();
    for path in parts.iter() {
        // The program ends: nobody handles the error.
        let _ = fs::remove_file(path);
    }
    std::mem::forget(parts);
}

/// Write buffer, bytes.
const BUFFER: usize = 64 << 10;

/// File to be written. Created before a long run, it reports at once that the path cannot be written; dropped without
/// [`AtomicFile::commit`], it leaves nothing behind.
#[derive(Debug)]
pub struct AtomicFile {
    /// Path as given, for messages.
    path: PathBuf,
    /// Destination; `path` with links resolved.
    target: PathBuf,
    part: Part,
}

impl AtomicFile {
    /// Creates an empty temporary file beside `path`.
    ///
    /// # Errors
    /// The system's error if no file can be created at `path`.
    pub fn create(path: &Path) -> io::Result<Self> {
        let target = resolve(path)?;
        let part = Part::create(&target)?;
        Ok(Self { path: path.to_owned(), target, part })
    }

    /// The path as given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the contents and moves the file to its destination.
    ///
    /// # Errors
    /// Errors of `write` or of the file system; an earlier file of that name is then unchanged.
    pub fn commit(self, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
        let mut out = BufWriter::with_capacity(BUFFER, &self.part.file);
        write(&mut out)?;
        out.flush()?;
        drop(out);
        self.part.file.sync_all()?;
        fs::rename(&self.part.path.0, &self.target)
    }
}

/// Private file beside another, removed when dropped.
#[derive(Debug)]
pub struct TemporaryFile(Removed);

impl TemporaryFile {
    /// Creates a file in the directory of `path` and fills it with `write`. It is closed, so that it can be opened on
    /// Windows too.
    ///
    /// # Errors
    /// Errors of `write`; the system's error if no file can be created there.
    pub fn beside(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<Self> {
        let Part { file, path } = Part::create(path)?;
        let mut out = BufWriter::with_capacity(BUFFER, &file);
        write(&mut out)?;
        out.flush()?;
        drop(out);
        Ok(Self(path))
    }

    /// The file's path.
    pub fn path(&self) -> &Path {
        &self.0.0
    }
}

/// Resolves links, and rejects targets that a file must not replace.
fn resolve(path: &Path) -> io::Result<PathBuf> {
    let refuse = |kind, what| Err(io::Error::new(kind, what));
    match fs::metadata(path) {
        Ok(found) if found.is_dir() => refuse(io::ErrorKind::IsADirectory, "it is a directory"),
        Ok(found) if !found.is_file() => refuse(io::ErrorKind::InvalidInput, "it is not a regular file"),
        Ok(found) if found.permissions().readonly() => refuse(io::ErrorKind::PermissionDenied, "it is read-only"),
        Ok(_) => fs::canonicalize(path),
        Err(cause) if cause.kind() == io::ErrorKind::NotFound && path.file_name().is_some() => Ok(path.to_owned()),
        Err(cause) => Err(cause),
    }
}

/// Temporary file, closed and removed when dropped (after a rename there is nothing left to remove).
#[derive(Debug)]
struct Part {
    file: File,
    path: Removed,
}

/// Path of a file that is removed when this is dropped.
#[derive(Debug)]
struct Removed(PathBuf);

impl Part {
    fn create(target: &Path) -> io::Result<Self> {
        let name = target.file_name().unwrap_or_default();
        let id = process::id();
        for attempt in 0..100 {
            let path = target.with_file_name(temporary_name(name, &format!(".{id}-{attempt}.part")));
            // Locked from before the file exists until it is listed, so that none is missed.
            let mut parts = parts();
            parts.push(path.clone());
            let made = File::create_new(&path);
            if made.is_err() {
                parts.pop();
            }
            drop(parts);
            match made {
                Ok(file) => return Ok(Self { file, path: Removed(path) }),
                Err(cause) if cause.kind() == io::ErrorKind::AlreadyExists => {}
                Err(cause) => return Err(cause),
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }
}

impl Drop for Removed {
    fn drop(&mut self) {
        let mut parts = parts();
        // A failure here cannot be handled, and the first error is the one to report.
        let _ = fs::remove_file(&self.0);
        parts.retain(|path| *path != self.0);
        if parts.is_empty() {
            // A library that is done keeps no memory.
            *parts = Vec::new();
        }
    }
}

/// Hidden name that identifies the target. No longer than the target's own name, which the file system accepts,
/// unless that is short.
fn temporary_name(name: &OsStr, end: &str) -> String {
    let room = name.len().max(SHORT) - end.len() - 1;
    let name = name.to_string_lossy();
    format!(".{}{end}", &name[..name.floor_char_boundary(room)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temporary_names_are_no_longer_than_names_may_be() {
        let end = ".4294967295-99.part";
        assert_eq!(temporary_name("o.glb".as_ref(), end), format!(".o.glb{end}"));
        for name in ["字".repeat(80) + ".jsonl", "a".repeat(255), "ab".repeat(30), "é".repeat(33)] {
            let made = temporary_name(name.as_ref(), end);
            assert!(made.len() <= name.len().max(SHORT) && made.ends_with(end), "{made}");
        }
    }
}
