//! WAV, RF64, RIFX and Wave64; samples are decoded by `symphonia`.
//!
//! Lengths in headers are untrusted: the bytes present decide how much is read, and no allocation depends on a number
//! in the header.

use std::collections::VecDeque;
use std::ops::Range;

use symphonia::core::codecs::audio::{AudioDecoder, AudioDecoderOptions};
use symphonia::core::packet::PacketRef;
use symphonia::core::units::{Duration, Timestamp};

use crate::blocks::{Blocks, Spec};
use crate::bytes::Bytes;
use crate::error::{AudioError, Note};
use chunks::{Chunk, Layout};
use format::{Encoding, Format};

mod chunks;
mod format;

/// Bytes decoded at a time, unless a codec's block is larger.
const PIECE: usize = 1 << 14;
/// Bytes of a format chunk that are inspected.
const FORMAT_BYTES: usize = 64;

/// Content of a WAV file.
pub(crate) enum Content {
    Samples(Box<Wav>),
    /// An MP3 file in a data chunk.
    Mpeg(Bytes),
}

/// Decoder state of a WAV file.
pub(crate) struct Wav {
    bytes: Bytes,
    spec: Spec,
    encoding: Encoding,
    decoder: Box<dyn AudioDecoder>,
    /// Audio that has not been decoded yet.
    data: VecDeque<Range<u64>>,
    /// Remaining samples of each channel; a codec's last block may hold more.
    left: u64,
    notes: Vec<Note>,
    piece: Vec<u8>,
}

impl Wav {
    /// Finds format and audio. A data chunk that claims more bytes than are present, or leaves its length open (0 or
    /// all ones, written by programs that write to a pipe), is read to the end. A truncated last frame is dropped.
    ///
    /// # Errors
    /// [`AudioError`] if the file cannot be decoded.
    pub(crate) fn open(bytes: &Bytes) -> Result<Content, AudioError> {
        let Found { format, data, samples, notes } = find_audio(bytes)?;
        if let Encoding::Mpeg = format.encoding {
            let start = data.front().map_or(0, |range| range.start);
            let end = data.back().map_or(0, |range| range.end);
            return Ok(Content::Mpeg(bytes.part(start..end)));
        }
        let decoder = symphonia::default::get_codecs()
            .make_audio_decoder(&format.parameters(), &AudioDecoderOptions::default())
            .map_err(|error| AudioError::Damaged { name: "WAV", cause: error.to_string() })?;
        Ok(Content::Samples(Box::new(Self {
            bytes: bytes.clone(),
            spec: format.spec,
            encoding: format.encoding,
            decoder,
            data,
            left: samples.filter(|_| format.encoding.is_padded()).unwrap_or(u64::MAX),
            notes,
            piece: Vec::new(),
        })))
    }

    /// Reads the next bytes, whole frames or blocks, and returns their number of samples of each channel.
    fn read_piece(&mut self) -> Result<Option<usize>, AudioError> {
        let unit = self.encoding.unit(self.spec.width());
        while let Some(range) = self.data.front_mut() {
            let size = (PIECE / unit).max(1) * unit;
            self.piece =
                self.bytes.peek(range.start, size.min(usize::try_from(range.end - range.start).unwrap_or(size)))?;
            range.start += self.piece.len() as u64;
            if self.piece.len() < size {
                self.data.pop_front();
            }
            let frames = self.encoding.frames(self.piece.len(), self.spec.width());
            if frames > 0 {
                // A block may be truncated.
                self.piece.resize(self.piece.len().next_multiple_of(unit), 0);
                return Ok(Some(frames));
            }
        }
        Ok(None)
    }
}

impl Blocks for Wav {
    fn next(&mut self, block: &mut Vec<f32>) -> Result<Option<Spec>, AudioError> {
        let Some(frames) = self.read_piece()? else { return Ok(None) };
        let frames = (frames as u64).min(self.left);
        if frames == 0 {
            return Ok(None);
        }
        self.left -= frames;
        self.encoding.prepare(&mut self.piece);
        let whole = self.encoding.frames(self.piece.len(), self.spec.width()) as u64;
        let packet = PacketRef::new(0, Timestamp::ZERO, Duration::from(whole), &self.piece);
        let decoded = self
            .decoder
            .decode_ref(&packet)
            .map_err(|error| AudioError::Damaged { name: "WAV", cause: error.to_string() })?;
        decoded.copy_to_vec_interleaved(block);
        block.truncate(usize::try_from(frames).unwrap_or(usize::MAX).saturating_mul(self.spec.width()));
        Ok(Some(self.spec))
    }

    fn notes(&self) -> Vec<Note> {
        self.notes.clone()
    }
}

/// Contents of the chunks.
struct Found {
    format: Format,
    data: VecDeque<Range<u64>>,
    /// Number of samples of each channel, if a chunk states it.
    samples: Option<u64>,
    notes: Vec<Note>,
}

/// Walks the chunks to find the format and all audio.
fn find_audio(bytes: &Bytes) -> Result<Found, AudioError> {
    let layout = Layout::of_start(&bytes.peek(0, 16)?);
    let (mut format, mut long_size, mut samples) = (None, None, None);
    let (mut data, mut notes, mut has_data) = (VecDeque::new(), Vec::new(), false);
    let mut at = layout.first();
    while let Some(chunk) = layout.chunk(bytes, at)? {
        let Chunk { body, size, .. } = chunk;
        if !chunk.is_named() && !data.is_empty() {
            notes.push(Note::Trailing { bytes: bytes.len() - at });
            break;
        }
        let head = |count: u64| bytes.peek(body, usize::try_from(size.min(count)).unwrap_or(0));
        match &chunk.id {
            b"fmt " if data.is_empty() => format = Some(Format::parse(&head(FORMAT_BYTES as u64)?, layout.is_big())?),
            b"fact" => samples = layout.number(&head(8)?).filter(|&count| count > 0),
            // RF64 stores 64-bit sizes here: the file's, then the data chunk's.
            b"ds64" => long_size = head(16)?.get(8..16).map(|at| u64::from_le_bytes(at.try_into().unwrap_or_default())),
            b"data" => {
                if format.is_none() {
                    return Err(AudioError::NoFormat);
                }
                has_data = true;
                let claimed = long_size.filter(|_| size == u64::from(u32::MAX)).unwrap_or(size);
                if claimed > 0 || !layout.is_chunk_list(bytes, body)? {
                    let (end, note) = audio_end(body, claimed, bytes.len());
                    data.push_back(body..end);
                    notes.extend(note);
                    if end == bytes.len() {
                        break;
                    }
                    at = layout.after(bytes, body, end - body, &mut notes)?;
                    continue;
                }
            }
            _ => {}
        }
        at = layout.after(bytes, body, size, &mut notes)?;
    }
    let format: Format = format.ok_or(AudioError::NoFormat)?;
    let unit = format.encoding.least(format.spec.width()) as u64;
    data.retain(|range: &Range<u64>| range.end - range.start >= unit);
    match (data.is_empty(), has_data) {
        (false, _) => Ok(Found { format, data, samples, notes }),
        (true, true) => Err(AudioError::Empty),
        (true, false) => Err(AudioError::NoData),
    }
}

/// Lengths from here on are written by programs that write to a pipe and do not know the length: some write 2^31 - 1
/// rounded down, others 2^32 - 1.
const OPEN_LENGTH: u64 = 0x7FFF_0000;

/// End of a data chunk, or of the file if the length is open or wrong.
fn audio_end(body: u64, claimed: u64, end: u64) -> (u64, Option<Note>) {
    match body.checked_add(claimed) {
        Some(claimed_end) if claimed > 0 && claimed_end <= end => (claimed_end, None),
        _ if claimed == 0 || claimed >= OPEN_LENGTH => (end, None),
        _ => (end, Some(Note::Length { claimed, found: end - body })),
    }
}

#[cfg(test)]
mod tests;
