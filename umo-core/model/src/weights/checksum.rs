//! Checksums of a model file, which detect changed bytes.
//!
//! `__metadata__` holds two. `checksum = "crc32:XXXXXXXX"` is the CRC-32, in eight hexadecimal digits, of the text of
//! `config` and then of every byte after the header. `header_checksum`, in the same form, is the CRC-32 of the header
//! and the eight bytes of its length before it, with zeros for its own digits. Files without these keys are accepted,
//! too.

use std::io::{self, Write};
use std::ops::Range;

use crc32fast::Hasher;

use umo_core_base::error::LoadError;

/// Metadata key of the checksum.
pub(super) const KEY: &str = "checksum";
/// Metadata key of the header's checksum.
pub(super) const HEADER_KEY: &str = "header_checksum";
const PREFIX: &str = "crc32:";
/// Text before the digits of the header's checksum. It cannot occur inside the config, a JSON string, where quotes
/// are escaped.
const BEFORE: &[u8] = b"\"header_checksum\":\"crc32:";
/// Digits of a checksum.
const DIGITS: usize = 8;

/// Formats a checksum.
pub(super) fn text(sum: u32) -> String {
    format!("{PREFIX}{sum:08x}")
}

/// Parses a checksum.
///
/// # Errors
/// [`LoadError::File`] if the text has another form.
pub(super) fn parse(text: &str) -> Result<u32, LoadError> {
    let digits = text.strip_prefix(PREFIX).filter(|digits| digits.len() == DIGITS);
    digits.and_then(|digits| u32::from_str_radix(digits, 16).ok()).ok_or_else(|| wrong(KEY, text))
}

/// Error for a text of another form.
pub(super) fn wrong(key: &str, text: &str) -> LoadError {
    LoadError::File(format!("metadata `{key}`: expected \"{PREFIX}\" and eight hexadecimal digits, got {text:?}"))
}

/// Range of the digits of a header's own checksum; `None` if it has none.
fn place(header: &[u8]) -> Option<Range<usize>> {
    let start = header.windows(BEFORE.len()).position(|text| text == BEFORE)? + BEFORE.len();
    (start + DIGITS <= header.len()).then_some(start..start + DIGITS)
}

/// Checksum of a header whose own digits are at `place`.
fn sum_header(header: &[u8], place: Range<usize>) -> u32 {
    let mut sum = Hasher::new();
    sum.update(&(header.len() as u64).to_le_bytes());
    sum.update(&header[..place.start]);
    sum.update(&[b'0'; DIGITS]);
    sum.update(&header[place.end..]);
    sum.finalize()
}

/// Writes a header's own checksum into its place.
pub(super) fn seal(header: &mut String) {
    let place = place(header.as_bytes()).expect("the header is written with a place for it");
    let sum = sum_header(header.as_bytes(), place.clone());
    header.replace_range(place, &format!("{sum:08x}"));
}

/// Verifies a header's own checksum; returns whether it has one.
///
/// # Errors
/// [`LoadError::File`] if the bytes were changed after writing.
pub(super) fn check_header(header: &[u8]) -> Result<bool, LoadError> {
    let Some(place) = place(header) else { return Ok(false) };
    let said = &header[place.clone()];
    let found = format!("{:08x}", sum_header(header, place));
    if said == found.as_bytes() {
        return Ok(true);
    }
    let said = String::from_utf8_lossy(said);
    Err(LoadError::File(format!(
        "it is damaged: its header's checksum is {PREFIX}{found}, expected {PREFIX}{said}; copy or download it again"
    )))
}

/// Checksum of a config's text and the data after the header. Runs on the calling thread, because a forked process
/// has no others.
pub(super) fn sum(config: &str, data: &[u8]) -> u32 {
    let mut sum = Hasher::new();
    sum.update(config.as_bytes());
    sum.update(data);
    sum.finalize()
}

/// Writer that computes the checksum of everything written through it.
#[derive(Debug)]
pub(super) struct Summed<W> {
    out: W,
    sum: Hasher,
}

impl<W: Write> Summed<W> {
    /// Starts with the checksum of a config's text.
    pub(crate) fn new(out: W, config: &str) -> Self {
        let mut sum = Hasher::new();
        sum.update(config.as_bytes());
        Self { out, sum }
    }

    /// Checksum of everything written.
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
