//! Chunks of RIFF, RF64, RIFX and Wave64.

use std::io;

use crate::bytes::Bytes;
use crate::error::Note;

/// Chunks that may follow one without its padding byte.
const KNOWN: [&[u8; 4]; 12] =
    [b"data", b"fmt ", b"LIST", b"fact", b"bext", b"junk", b"JUNK", b"id3 ", b"cue ", b"smpl", b"iXML", b"PEAK"];
/// The last 12 bytes of Wave64's identifiers of chunks that WAV has, too.
const W64_NAME: [u8; 12] = *b"\xf3\xac\xd3\x11\x8c\xd1\x00\xc0\x4f\x8e\xdb\x8a";

/// Layout of chunks.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Layout {
    Riff,
    /// Like RIFF, but big-endian.
    Rifx,
    /// Identifiers of 16 bytes; lengths of 8 bytes that include the header; alignment to 8 bytes.
    Wave64,
}

/// A chunk header.
#[derive(Clone, Copy)]
pub(super) struct Chunk {
    pub(super) id: [u8; 4],
    /// Offset of the content.
    pub(super) body: u64,
    /// Claimed length of the content.
    pub(super) size: u64,
}

impl Chunk {
    /// Whether the identifier consists of printable characters.
    pub(super) fn is_named(&self) -> bool {
        self.id.iter().all(|c| c.is_ascii_graphic() || *c == b' ')
    }
}

impl Layout {
    pub(super) fn of_start(start: &[u8]) -> Self {
        match start {
            [b'r', ..] => Self::Wave64,
            [b'R', b'I', b'F', b'X', ..] => Self::Rifx,
            _ => Self::Riff,
        }
    }

    pub(super) fn is_big(self) -> bool {
        self == Self::Rifx
    }

    /// Offset of the first chunk.
    pub(super) fn first(self) -> u64 {
        if self == Self::Wave64 { 40 } else { 12 }
    }

    /// The first number of a chunk's content.
    pub(super) fn number(self, content: &[u8]) -> Option<u64> {
        Some(match self {
            Self::Riff => u32::from_le_bytes(*content.first_chunk()?).into(),
            Self::Rifx => u32::from_be_bytes(*content.first_chunk()?).into(),
            Self::Wave64 => u64::from_le_bytes(*content.first_chunk()?),
        })
    }

    /// Reads the chunk header at an offset; `None` if it is truncated.
    pub(super) fn chunk(self, bytes: &Bytes, at: u64) -> io::Result<Option<Chunk>> {
        let header = bytes.peek(at, if self == Self::Wave64 { 24 } else { 8 })?;
        let [a, b, c, d, ..] = header[..] else { return Ok(None) };
        Ok(match (self, &header[4..]) {
            (Self::Wave64, [name @ .., _, _, _, _, _, _, _, _]) if name.len() == 12 => {
                let size = self.number(&header[16..]).unwrap_or(0);
                // Chunks that WAV does not have are skipped.
                let id = if name == W64_NAME { [a, b, c, d] } else { *b"    " };
                Some(Chunk { id, body: at + 24, size: size.saturating_sub(24) })
            }
            (Self::Wave64, _) => None,
            (_, size) => self.number(size).map(|size| Chunk { id: [a, b, c, d], body: at + 8, size }),
        })
    }

    /// Returns the offset after a content of `size` bytes and its padding. If the padding is missing, adds a note.
    pub(super) fn after(self, bytes: &Bytes, body: u64, size: u64, notes: &mut Vec<Note>) -> io::Result<u64> {
        let end = body.saturating_add(size);
        if self == Self::Wave64 {
            return Ok(end.checked_next_multiple_of(8).unwrap_or(u64::MAX));
        }
        let padded = end.saturating_add(size & 1);
        let is_known = |at: u64| -> io::Result<bool> {
            Ok(self.chunk(bytes, at)?.is_some_and(|chunk| KNOWN.contains(&&chunk.id)))
        };
        if padded > end && !is_known(padded)? && is_known(end)? {
            notes.push(Note::Unpadded);
            return Ok(end);
        }
        Ok(padded)
    }

    /// Whether only complete chunks with printable names follow. That holds after a truly empty data chunk; audio of
    /// unknown length would not look like this.
    pub(super) fn is_chunk_list(self, bytes: &Bytes, mut at: u64) -> io::Result<bool> {
        while let Some(chunk) = self.chunk(bytes, at)? {
            if !chunk.is_named() || chunk.size > bytes.len().saturating_sub(chunk.body) {
                return Ok(false);
            }
            at = self.after(bytes, chunk.body, chunk.size, &mut Vec::new())?;
        }
        Ok(at >= bytes.len())
    }
}
