//! Opening files that callers name: regular ones only.
//!
//! Opening a FIFO waits until somebody writes to it, and a device may never end. A caller who names
//! one by mistake gets an error at once.

use std::fs::{File, FileType, OpenOptions};
use std::io::{self, Read};
use std::path::Path;

/// Opens a regular file for reading.
///
/// # Errors
/// What the system says; [`io::ErrorKind::InvalidInput`], with a text that says what it is, where
/// the path names a directory, a FIFO, a socket or a device. Never waits for another program.
pub fn open(path: &Path) -> io::Result<File> {
    let mut options = OpenOptions::new();
    options.read(true);
    // A FIFO that nobody writes to is opened, and seen to be one, instead of waited for. Regular
    // files are read as ever.
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::custom_flags(&mut options, libc::O_NONBLOCK);
    let file = match options.open(path) {
        Ok(file) => file,
        // What cannot be opened may still say what it is: a socket, a directory on Windows.
        Err(error) => return Err(path.metadata().ok().and_then(|found| refused(found.file_type())).unwrap_or(error)),
    };
    match refused(file.metadata()?.file_type()) {
        Some(error) => Err(error),
        None => Ok(file),
    }
}

/// The bytes of a regular file.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    open(path)?.read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a regular file.
///
/// # Errors
/// As [`open`], and where the file is not UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    let mut text = String::new();
    open(path)?.read_to_string(&mut text)?;
    Ok(text)
}

/// Why a file of this type is not read.
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
    Some(io::Error::new(io::ErrorKind::InvalidInput, format!("it is {what}, not a regular file")))
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
            // Without a writer: an ordinary open would wait for one for ever.
            assert!(wrong(&fifo).contains("a FIFO"));
            assert!(wrong(Path::new("/dev/zero")).contains("a character device"));
            let socket = folder.join("socket");
            let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
            assert!(wrong(&socket).contains("a socket"));
        }
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
