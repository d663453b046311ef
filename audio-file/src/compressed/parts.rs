//! Finds the end of the first of several concatenated files, as `cat` and speech services produce them. `symphonia`
//! reads one file at a time.

use std::io;

use crate::bytes::Bytes;
use crate::format::Format;

/// Bytes searched at a time.
const WINDOW: usize = 1 << 16;
/// Length of the longest marker, in bytes.
const MARK: usize = 64;

/// Length of the ID3 tags at the start.
pub(super) fn tags(bytes: &Bytes) -> io::Result<u64> {
    let mut from = 0;
    while let Some(length) = id3_length(&bytes.peek(from, MARK)?) {
        from += length;
    }
    Ok(from)
}

/// Length of the first of the joined files; of all bytes if there is only one.
pub(super) fn first(format: Format, bytes: &Bytes) -> io::Result<u64> {
    let is_start: fn(&[u8]) -> bool = match format {
        Format::Mpeg => |at| id3_length(at).is_some() || is_information(at),
        Format::Flac => |at| id3_length(at).is_some() || matches!(at, [b'f', b'L', b'a', b'C', 0 | 0x80, 0, 0, 34, ..]),
        _ => return Ok(bytes.len()),
    };
    // Zeros may precede the first frame, which may be an information frame of this file.
    let is_frame = |at: &[u8]| format != Format::Mpeg || side_information(at).is_some();
    let from = search(bytes, 0, is_frame)?.unwrap_or(0);
    Ok(search(bytes, from + 4, is_start)?.unwrap_or(bytes.len()))
}

/// Returns the first offset, not below `from`, at which the bytes match.
fn search(bytes: &Bytes, mut from: u64, is_wanted: impl Fn(&[u8]) -> bool) -> io::Result<Option<u64>> {
    loop {
        let window = bytes.peek(from, WINDOW + MARK)?;
        let starts = window.len().min(WINDOW);
        if let Some(place) = (0..starts).find(|&at| is_wanted(&window[at..])) {
            return Ok(Some(from + place as u64));
        }
        if starts < WINDOW {
            return Ok(None);
        }
        from += WINDOW as u64;
    }
}

/// Length of the ID3v2 tag that starts here.
fn id3_length(bytes: &[u8]) -> Option<u64> {
    let [b'I', b'D', b'3', 2..=4, 0, flags, size @ ..] = bytes else { return None };
    let size: [u8; 4] = *size.first_chunk()?;
    let length = size.iter().try_fold(0_u64, |length, &byte| (byte < 0x80).then(|| length << 7 | u64::from(byte)))?;
    let footer = if flags & 0x10 > 0 { 10 } else { 0 };
    (flags & 0x0F == 0).then_some(10 + length + footer)
}

/// End of the side information of the MPEG frame that starts here.
fn side_information(bytes: &[u8]) -> Option<usize> {
    let [0xFF, second, third, fourth, ..] = *bytes else { return None };
    let is_layer_3 = second & 0xE6 == 0xE2;
    let is_usual = third & 0xF0 != 0xF0 && third & 0x0C != 0x0C && second & 0x18 != 0x08;
    let (is_first, is_mono) = (second & 0x18 == 0x18, fourth & 0xC0 == 0xC0);
    (is_layer_3 && is_usual).then_some(match (is_first, is_mono) {
        (true, false) => 36,
        (true, true) | (false, false) => 21,
        (false, true) => 13,
    })
}

/// Whether a silent frame with information about the following frames starts here.
fn is_information(bytes: &[u8]) -> bool {
    let Some(end) = side_information(bytes) else { return false };
    let is_silent = |end: usize| bytes[6..end].iter().all(|&byte| byte == 0);
    let is_mark = |at: usize, marks: &[&[u8; 4]]| {
        bytes.get(at..at + 4).is_some_and(|found| marks.iter().any(|mark| *mark == found)) && is_silent(at)
    };
    is_mark(end, &[b"Xing", b"Info"]) || is_mark(36, &[b"VBRI"])
}
