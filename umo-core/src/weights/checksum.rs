//! The checksum of a model file: whether its bytes are those that were written.
//!
//! `__metadata__` holds `checksum = "crc32:XXXXXXXX"`: CRC-32 of the text of `config`, then of
//! every byte behind the header, in eight hexadecimal digits. A file without the key is read as
//! ever.

use std::io::{self, Write};

use crc32fast::Hasher;

use crate::error::LoadError;

/// The key in the metadata.
pub(super) const KEY: &str = "checksum";
const PREFIX: &str = "crc32:";

/// The value of the key.
pub(super) fn text(sum: u32) -> String {
    format!("{PREFIX}{sum:08x}")
}

/// The sum that the metadata says.
///
/// # Errors
/// [`LoadError::File`] where the text is of another form.
pub(super) fn parse(text: &str) -> Result<u32, LoadError> {
    let digits = text.strip_prefix(PREFIX).filter(|digits| digits.len() == 8);
    digits.and_then(|digits| u32::from_str_radix(digits, 16).ok()).ok_or_else(|| {
        LoadError::File(format!("metadata `{KEY}`: expected \"{PREFIX}\" and eight hexadecimal digits, got {text:?}"))
    })
}

/// The sum of a config's text and the data behind the header. On the calling thread: a process that
/// was forked has no others.
pub(super) fn sum(config: &str, data: &[u8]) -> u32 {
    let mut sum = Hasher::new();
    sum.update(config.as_bytes());
    sum.update(data);
    sum.finalize()
}

/// Sums what is written through it.
#[derive(Debug)]
pub(super) struct Summed<W> {
    out: W,
    sum: Hasher,
}

impl<W: Write> Summed<W> {
    /// A sum that begins with a config's text.
    pub(super) fn new(out: W, config: &str) -> Self {
        let mut sum = Hasher::new();
        sum.update(config.as_bytes());
        Self { out, sum }
    }

    /// The sum of all that was written.
    pub(super) fn finish(self) -> u32 {
        self.sum.finalize()
    }
}

impl<W: Write> Write for Summed<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.out.write(bytes)?;
        self.sum.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}
