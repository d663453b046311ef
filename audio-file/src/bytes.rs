//! Random access to a file's bytes, or to a range of them.

use std::fs::File;
use std::io::{self, Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

use symphonia::core::io::MediaSource;

trait ReadSeek: Read + Seek + Send {}
impl<T: Read + Seek + Send> ReadSeek for T {}

/// A range of a file that is shared with other readers.
#[derive(Clone)]
pub(crate) struct Bytes {
    file: Arc<Mutex<dyn ReadSeek>>,
    /// The range in the file.
    range: Range<u64>,
    /// Read position, in the file.
    at: u64,
    /// Whether `symphonia` may seek and is told the length, from which it estimates a recording's duration.
    is_seekable: bool,
}

impl Bytes {
    /// A whole file, at its present length.
    ///
    /// # Errors
    /// The I/O error.
    pub(crate) fn of_file(file: File) -> io::Result<Self> {
        let length = file.metadata()?.len();
        Ok(Self { file: Arc::new(Mutex::new(file)), range: 0..length, at: 0, is_seekable: true })
    }

    pub(crate) fn of_memory(bytes: Vec<u8>) -> Self {
        let range = 0..bytes.len() as u64;
        Self { file: Arc::new(Mutex::new(Cursor::new(bytes))), range, at: 0, is_seekable: true }
    }

    /// A sub-range, with the read position at its start.
    pub(crate) fn part(&self, part: Range<u64>) -> Self {
        let place = |at: u64| self.range.start.saturating_add(at).min(self.range.end);
        let range = place(part.start)..place(part.end);
        Self { file: Arc::clone(&self.file), at: range.start, range, is_seekable: self.is_seekable }
    }

    /// The same range, without length and seeking.
    pub(crate) fn unseekable(self) -> Self {
        Self { is_seekable: false, ..self }
    }

    pub(crate) fn len(&self) -> u64 {
        self.range.end.saturating_sub(self.range.start)
    }

    /// Returns up to `count` bytes starting at `at`; fewer at the end.
    pub(crate) fn peek(&self, at: u64, count: usize) -> io::Result<Vec<u8>> {
        let mut bytes = Vec::new();
        self.part(at..self.len()).take(count as u64).read_to_end(&mut bytes)?;
        Ok(bytes)
    }
}

impl Read for Bytes {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = usize::try_from(self.range.end.saturating_sub(self.at)).unwrap_or(usize::MAX);
        let room = buffer.len().min(left);
        if room == 0 {
            return Ok(0);
        }
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.seek(SeekFrom::Start(self.at))?;
        let count = file.read(&mut buffer[..room])?;
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for Bytes {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        let at = match to {
            SeekFrom::Start(at) => self.range.start.checked_add(at),
            SeekFrom::End(by) => self.range.end.checked_add_signed(by),
            SeekFrom::Current(by) => self.at.checked_add_signed(by),
        };
        self.at = at.filter(|&at| at >= self.range.start).ok_or(io::ErrorKind::InvalidInput)?;
        Ok(self.at - self.range.start)
    }
}

impl MediaSource for Bytes {
    fn is_seekable(&self) -> bool {
        self.is_seekable
    }

    fn byte_len(&self) -> Option<u64> {
        self.is_seekable.then(|| self.len())
    }
}
