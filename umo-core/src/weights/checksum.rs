//! The checksums of a model file: whether its bytes are those that were written.
//!
//! `__metadata__` holds `checksum = "crc32:XXXXXXXX"`: CRC-32 of the text of `config`, then of
//! every byte behind the header, in eight hexadecimal digits; and `header_checksum`, of the same
//! form: CRC-32 of the header and the eight bytes of its length before it, with zeros for its own
//! digits. A file without these keys is read, too.

use std::io::{self, Write};
use std::ops::Range;

use crc32fast::Hasher;

use crate::error::LoadError;

/// The key in the metadata.
pub(super) const KEY: &str = "checksum";
/// The key of the header's own.
pub(super) const HEADER_KEY: &str = "header_checksum";
const PREFIX: &str = "crc32:";
/// The header's text before the digits of its own checksum. In the config, a text in this text, quotes are escaped.
const BEFORE: &[u8] = b"\"header_checksum\":\"crc32:";
/// Digits of a checksum.
const DIGITS: usize = 8;

/// The value of the key.
pub(super) fn text(sum: u32) -> String {
    format!("{PREFIX}{sum:08x}")
}

/// The sum that the metadata says.
///
/// # Errors
/// [`LoadError::File`] where the text is of another form.
pub(super) fn parse(text: &str) -> Result<u32, LoadError> {
    let digits = text.strip_prefix(PREFIX).filter(|digits| digits.len() == DIGITS);
    digits.and_then(|digits| u32::from_str_radix(digits, 16).ok()).ok_or_else(|| wrong(KEY, text))
}

/// The error of a text of another form.
pub(super) fn wrong(key: &str, text: &str) -> LoadError {
    LoadError::File(format!("metadata `{key}`: expected \"{PREFIX}\" and eight hexadecimal digits, got {text:?}"))
}

/// Where the digits of a header's own checksum are; none where it has none.
fn place(header: &[u8]) -> Option<Range<usize>> {
    let start = header.windows(BEFORE.len()).position(|text| text == BEFORE)? + BEFORE.len();
    (start + DIGITS <= header.len()).then_some(start..start + DIGITS)
}

/// The header's own checksum, whose digits have that place.
fn sum_header(header: &[u8], place: Range<usize>) -> u32 {
    let mut sum = Hasher::new();
    sum.update(&(header.len() as u64).to_le_bytes());
    sum.update(&header[..place.start]);
    sum.update(&[b'0'; DIGITS]);
    sum.update(&header[place.end..]);
    sum.finalize()
}

/// Puts a header's own checksum in its place.
pub(super) fn seal(header: &mut String) {
    let place = place(header.as_bytes()).expect("the header is written with a place for it");
    let sum = sum_header(header.as_bytes(), place.clone());
    header.replace_range(place, &format!("{sum:08x}"));
}

/// Compares a header with its own checksum; whether it has one.
///
/// # Errors
/// [`LoadError::File`] where the bytes are not those that were written.
pub(super) fn check_header(header: &[u8]) -> Result<bool, LoadError> {
    let Some(place) = place(header) else { return Ok(false) };
    let said = &header[place.clone()];
    let found = format!("{:08x}", sum_header(header, place));
    if said == found.as_bytes() {
        return Ok(true);
    }
    let said = String::from_utf8_lossy(said);
    Err(LoadError::File(format!(
        "it is damaged: its header's checksum is {PREFIX}{found}, where {PREFIX}{said} was written; copy or download it again"
    )))
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
