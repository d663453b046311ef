//! Storage of a model's bytes. The memory map is one of the places outside the kernels that contain `unsafe`.
#![expect(unsafe_code, reason = "a memory map is shared with other processes, which may change the file")]

#[cfg(feature = "files")]
use std::{fs::File, io, path::Path};

#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
use memmap2::Mmap;
#[cfg(all(feature = "mmap", unix))]
use memmap2::UncheckedAdvice;

#[cfg(feature = "files")]
use umo_core_base::error::LoadError;
#[cfg(feature = "files")]
use umo_core_base::memory::OutOfMemory;

/// A memory-mapped file.
#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
#[derive(Debug)]
pub(super) struct Mapped {
    map: Mmap,
    /// Prevents writes to the file while it is open.
    #[cfg(windows)]
    _file: File,
}

/// Bytes of a model.
#[derive(Debug)]
pub(super) enum Source {
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    Mapped(Mapped),
    Owned(Vec<u8>),
    Static(&'static [u8]),
}

impl Source {
    #[cfg(feature = "files")]
    pub(super) fn open(path: &Path) -> Result<Self, LoadError> {
        let io = |cause: io::Error| match cause.kind() {
            io::ErrorKind::OutOfMemory => LoadError::Memory(OutOfMemory { bytes: file_len(path) }),
            _ => LoadError::Io { path: path.to_owned(), cause },
        };
        #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
        let file = umo_core_base::file::open_unchanging(path).map_err(io)?;
        #[cfg(not(all(feature = "mmap", not(target_family = "wasm"))))]
        let file = umo_core_base::file::open(path).map_err(io)?;
        if file.metadata().map_err(io)?.len() == 0 {
            return Err(LoadError::File("the file is empty".to_owned()));
        }
        Self::of_file(file, path).map_err(io)
    }

    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    fn of_file(file: File, _: &Path) -> io::Result<Self> {
        // SAFETY: the map is read-only and private to this process. On Windows nobody can write to the file while it
        // is open, which is as long as the map. Elsewhere another process that rewrites the file in place could
        // change what we read. Every value is checked as it is read, no index is read from it later, and the
        // documentation of the model file says to replace model files by renaming.
        let map = unsafe { Mmap::map(&file) }?;
        Ok(Self::Mapped(Mapped {
            map,
            #[cfg(windows)]
            _file: file,
        }))
    }

    #[cfg(all(feature = "files", not(all(feature = "mmap", not(target_family = "wasm")))))]
    fn of_file(mut file: File, path: &Path) -> io::Result<Self> {
        let mut bytes = Vec::new();
        bytes.try_reserve_exact(file_len(path) + 1).map_err(|_| io::ErrorKind::OutOfMemory)?;
        io::Read::read_to_end(&mut file, &mut bytes)?;
        Ok(Self::Owned(bytes))
    }

    pub(super) fn bytes(&self) -> &[u8] {
        match self {
            #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
            Self::Mapped(mapped) => &mapped.map,
            Self::Owned(bytes) => bytes,
            Self::Static(bytes) => bytes,
        }
    }

    /// Lets the system drop the pages within `offset..offset + len` from this process; they are read again when
    /// needed.
    #[cfg(all(feature = "mmap", unix))]
    pub(super) fn release(&self, offset: usize, len: usize) {
        const PAGE: usize = 4096;
        let Self::Mapped(Mapped { map, .. }) = self else { return };
        let start = offset.next_multiple_of(PAGE);
        let end = (offset + len) / PAGE * PAGE;
        if start < end {
            // SAFETY: the map is read-only and backed by the file, so dropped pages come back with the same bytes.
            let dropped = unsafe { map.unchecked_advise_range(UncheckedAdvice::DontNeed, start, end - start) };
            // Only a hint: a system that ignores it keeps the pages.
            drop(dropped);
        }
    }

    /// No-op: the bytes are in memory, or the system has no such hint.
    #[cfg(not(all(feature = "mmap", unix)))]
    pub(super) fn release(&self, _: usize, _: usize) {}
}

/// Size of a file that cannot be mapped, bytes.
#[cfg(feature = "files")]
fn file_len(path: &Path) -> usize {
    path.metadata().ok().and_then(|found| usize::try_from(found.len()).ok()).unwrap_or_default()
}

/// Reinterprets bytes as signed.
pub(super) fn signed(bytes: &[u8]) -> &[i8] {
    // SAFETY: both types have size and alignment 1 and accept every value; length and lifetime are unchanged.
    unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast(), bytes.len()) }
}
