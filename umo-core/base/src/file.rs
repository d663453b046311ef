//! Opens files named by callers: regular files only. [`AtomicFile`] writes one.
//!
//! Opening a FIFO blocks until there is a writer, and reading a device may never end. Naming one by mistake is an
//! immediate error instead. On Windows, a name such as `NUL` or `COM1` is a device in every directory, and
//! `\\.\pipe\…` is a pipe.

use std::fs::{File, FileType, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

mod atomic;

pub use atomic::{AtomicFile, TemporaryFile, remove_parts};

/// Opens a regular file for reading. Never waits for another program.
///
/// # Errors
/// The system's error; [`io::ErrorKind::InvalidInput`], with a description, if the path names a directory, a FIFO, a
/// socket or a device.
pub fn open(path: &Path) -> io::Result<File> {
    open_with(path, OpenOptions::new().read(true))
}

/// Like [`open`], but on Windows nobody can write to the file while it is open, and opening fails while somebody has
/// it open for writing. It can still be renamed and replaced. Other systems have no such locks.
#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
pub fn open_unchanging(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    #[cfg(windows)]
    std::os::windows::fs::OpenOptionsExt::share_mode(&mut options, system::READERS);
    open_with(path, options.read(true))
}

fn open_with(path: &Path, options: &mut OpenOptions) -> io::Result<File> {
    // Opens a FIFO without a writer instead of blocking, so that it can be rejected. Regular files are not affected.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(options, libc::O_NONBLOCK);
    // The server of a pipe must not impersonate a caller who only named it.
    #[cfg(windows)]
    std::os::windows::fs::OpenOptionsExt::security_qos_flags(options, system::ANONYMOUS);
    let file = match options.open(path) {
        Ok(file) => file,
        // Files that cannot be opened may still have a type: a socket, a directory on Windows.
        Err(error) => return Err(path.metadata().ok().and_then(|found| refused(found.file_type())).unwrap_or(error)),
    };
    #[cfg(windows)]
    if let Some(what) = system::not_a_file(&file) {
        return Err(is_instead(what));
    }
    match refused(file.metadata()?.file_type()) {
        Some(error) => Err(error),
        None => Ok(file),
    }
}

#[cfg(windows)]
mod system {
    #![expect(unsafe_code, reason = "the standard library does not tell a device from a file")]

    use std::fs::File;
    use std::os::windows::io::AsRawHandle;

    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    use windows_sys::Win32::Storage::FileSystem::{FILE_SHARE_DELETE, FILE_SHARE_READ};
    use windows_sys::Win32::Storage::FileSystem::{
        FILE_TYPE_CHAR, FILE_TYPE_DISK, FILE_TYPE_PIPE, GetFileType, SECURITY_ANONYMOUS,
    };

    pub(super) const ANONYMOUS: u32 = SECURITY_ANONYMOUS;
    /// Allows others to read and rename the file.
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    pub(super) const READERS: u32 = FILE_SHARE_READ | FILE_SHARE_DELETE;

    /// Kind of an open handle that is neither file nor directory.
    pub(super) fn not_a_file(file: &File) -> Option<&'static str> {
        // SAFETY: the handle is open: `file` owns it.
        match unsafe { GetFileType(file.as_raw_handle()) } {
            FILE_TYPE_DISK => None,
            FILE_TYPE_CHAR => Some("a character device"),
            FILE_TYPE_PIPE => Some("a pipe or a socket"),
            _ => Some("of an unknown type"),
        }
    }
}

/// Reads a regular file.
///
/// # Errors
/// As in [`open`].
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a regular file as text.
///
/// # Errors
/// As in [`open`], and if the file is not UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Error for a file of this type, if it is rejected.
fn refused(kind: FileType) -> Option<io::Error> {
    let what = match kind {
        _ if kind.is_file() => return None,
        _ if kind.is_dir() => "a directory",
        #[cfg(unix)]
        _ if std::os::unix::fs::FileTypeExt::is_fifo(&kind) => "a FIFO",
        #[cfg(unix)]
        _ if std::os::unix::fs::FileTypeExt::is_socket(&kind) => "a socket",
        #[cfg(unix)]
        _ if std::os::unix::fs::FileTypeExt::is_char_device(&kind) => "a character device",
        #[cfg(unix)]
        _ if std::os::unix::fs::FileTypeExt::is_block_device(&kind) => "a block device",
        _ => "of an unknown type",
    };
    Some(is_instead(what))
}

fn is_instead(what: &str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, format!("it is {what}, not a regular file"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_regular_files_are_opened() {
        let folder = std::env::temp_dir().join(format!("umo-file-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let regular = folder.join("regular");
        std::fs::write(&regular, "text").unwrap();
        assert_eq!(read(&regular).unwrap(), b"text");
        assert_eq!(read_to_string(&regular).unwrap(), "text");
        assert_eq!(open(&folder.join("missing")).unwrap_err().kind(), io::ErrorKind::NotFound);
        let wrong = |path: &Path| {
            let error = open(path).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::InvalidInput);
            error.to_string()
        };
        assert!(wrong(&folder).contains("a directory"));
        #[cfg(unix)]
        {
            let fifo = folder.join("fifo");
            assert!(std::process::Command::new("mkfifo").arg(&fifo).status().unwrap().success());
            // No writer: an ordinary open would wait forever.
            assert!(wrong(&fifo).contains("a FIFO"));
            assert!(wrong(Path::new("/dev/zero")).contains("a character device"));
            let socket = folder.join("socket");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert!(wrong(&socket).contains("a socket"));
        }
        #[cfg(windows)]
        for device in ["NUL", r"\\.\NUL"] {
            assert!(wrong(Path::new(device)).contains("a character device"), "{device}");
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[cfg(windows)]
    #[test]
    fn paths_may_be_long_and_in_any_language() {
        let base = std::env::temp_dir().join(format!("umo-Größe-日本-{}", std::process::id()));
        let folder = (0..6).fold(base.clone(), |folder, _| folder.join("long ".repeat(9) + "речь"));
        assert!(folder.as_os_str().len() > 260);
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join("модель.safetensors");
        std::fs::write(&file, "text").unwrap();
        assert_eq!(read(&file).unwrap(), b"text");
        // The same file by its extended-length path.
        assert_eq!(read(Path::new(&format!(r"\\?\{}", file.display()))).unwrap(), b"text");
        std::fs::remove_dir_all(&base).unwrap();
    }

    #[cfg(all(windows, feature = "mmap"))]
    #[test]
    fn a_file_that_must_not_change_is_not_written_to() {
        let path = std::env::temp_dir().join(format!("umo-unchanging-{}", std::process::id()));
        let moved = path.with_extension("old");
        std::fs::write(&path, "text").unwrap();
        let write = |path: &Path| OpenOptions::new().write(true).open(path);

        let writer = write(&path).unwrap();
        let error = open_unchanging(&path).unwrap_err();
        assert_eq!(error.raw_os_error(), Some(windows_sys::Win32::Foundation::ERROR_SHARING_VIOLATION.cast_signed()));
        drop(writer);

        let file = open_unchanging(&path).unwrap();
        assert_eq!(read(&path).unwrap(), b"text");
        write(&path).unwrap_err();
        std::fs::rename(&path, &moved).unwrap();
        write(&moved).unwrap_err();
        std::fs::write(&path, "another").unwrap();
        drop(file);
        write(&moved).unwrap();
        for path in [path, moved] {
            std::fs::remove_file(path).unwrap();
        }
    }
}
