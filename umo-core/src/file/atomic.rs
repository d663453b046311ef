//! A file that appears whole or not at all.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Longest name of a temporary file whose target's own name is shorter.
const SHORT: usize = 64;

/// The temporary files that are there.
static PARTS: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn parts() -> MutexGuard<'static, Vec<PathBuf>> {
    PARTS.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Removes the temporary files of all outputs under way; a thread that makes or finishes one after this waits
/// for ever. For a program that ends in the next moment, told by a signal.
pub fn remove_parts() {
    let parts = parts();
    for path in parts.iter() {
        // The program ends: there is nobody to tell.
        let _ = fs::remove_file(path);
    }
    std::mem::forget(parts);
}

/// Bytes that are collected before they are written.
const BUFFER: usize = 64 << 10;

/// A file to be written. Made before a long run, it tells at once that the path cannot be written;
/// dropped without [`AtomicFile::commit`], it leaves nothing behind.
#[derive(Debug)]
pub struct AtomicFile {
    /// As it was given, for messages.
    path: PathBuf,
    /// Where the file goes; `path` with links followed.
    target: PathBuf,
    part: Part,
}

impl AtomicFile {
    /// Makes an empty temporary file beside `path`.
    ///
    /// # Errors
    /// What the system says where `path` is no place for a file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let target = resolve(path)?;
        let part = Part::create(&target)?;
        Ok(Self { path: path.to_owned(), target, part })
    }

    /// The path as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes the contents and puts the file in its place.
    ///
    /// # Errors
    /// Those of `write`, or the file system's; then an earlier file of that name is as it was.
    pub fn commit(self, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
        let mut out = BufWriter::with_capacity(BUFFER, &self.part.file);
        write(&mut out)?;
        out.flush()?;
        drop(out);
        self.part.file.sync_all()?;
        fs::rename(&self.part.path.0, &self.target)
    }
}

/// A file for the program alone, beside another; gone when dropped.
#[derive(Debug)]
pub struct TemporaryFile(Removed);

impl TemporaryFile {
    /// One in the folder of `path`, with what `write` writes. It is closed, so that it can be opened on Windows too.
    ///
    /// # Errors
    /// Those of `write`, and what the system says where `path` is no place for a file.
    pub fn beside(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<Self> {
        let Part { file, path } = Part::create(path)?;
        let mut out = BufWriter::with_capacity(BUFFER, &file);
        write(&mut out)?;
        out.flush()?;
        drop(out);
        Ok(Self(path))
    }

    /// Where it is.
    pub fn path(&self) -> &Path {
        &self.0.0
    }
}

/// Follows links, and refuses what a file must not replace.
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

/// A temporary file, closed and removed when dropped (after a rename there is nothing left to remove).
#[derive(Debug)]
struct Part {
    file: File,
    path: Removed,
}

/// The path of a file, which is removed when this is dropped.
#[derive(Debug)]
struct Removed(PathBuf);

impl Part {
    fn create(target: &Path) -> io::Result<Self> {
        let name = target.file_name().unwrap_or_default();
        let id = process::id();
        for attempt in 0..100 {
            let path = target.with_file_name(temporary_name(name, &format!(".{id}-{attempt}.part")));
            // Held from before the file is there until it is listed: none is overlooked.
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
        // Nothing can be done about a failure here, and the first error is the one worth telling.
        let _ = fs::remove_file(&self.0);
        parts.retain(|path| *path != self.0);
        if parts.is_empty() {
            // A library that is done keeps no memory.
            *parts = Vec::new();
        }
    }
}

/// A hidden name that says whose it is, and is no longer than the name itself, which the file system takes,
/// unless that one is short.
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
