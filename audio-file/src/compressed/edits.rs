//! Trims decoded audio to the recording. `symphonia` does not apply an MPEG-4 file's edit list, and encoders put 1024
//! to some 2000 samples before the recording.

use std::collections::VecDeque;

/// Samples of each channel written per piece of a pause.
const PIECE: u64 = 1 << 13;

/// Part of a recording, in samples of each channel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Pause(u64),
    /// Range of the decoded audio.
    Audio(u64, u64),
}

/// The parts of a recording, in order.
#[derive(Debug, Default)]
pub(super) struct Edits {
    parts: VecDeque<Part>,
    /// Index of the next decoded sample.
    at: u64,
}

impl Edits {
    /// A recording that is one range of the decoded audio.
    pub(super) fn range(start: u64, end: u64) -> Self {
        Self { parts: [Part::Audio(start, end)].into(), at: 0 }
    }

    /// Appends a piece of a pause, if one is due.
    pub(super) fn pause(&mut self, block: &mut Vec<f32>, width: usize) {
        if let Some(Part::Pause(left)) = self.parts.front_mut() {
            let count = PIECE.min(*left);
            *left -= count;
            if *left == 0 {
                self.parts.pop_front();
            }
            block.resize(block.len() + usize::try_from(count).unwrap_or(0) * width, 0.0);
        }
    }

    /// Consumes decoded samples up to the next pause, and appends those of the recording to `block`. Returns the
    /// number of samples of each channel consumed.
    pub(super) fn take(&mut self, decoded: &[f32], block: &mut Vec<f32>, width: usize) -> usize {
        let count = (decoded.len() / width) as u64;
        let mut taken = 0;
        while taken < count {
            let Some(&Part::Audio(start, end)) = self.parts.front() else { break };
            let at = self.at + taken;
            let until = (self.at + count).min(if at < start { start } else { end });
            if at >= start {
                let place = |at: u64| usize::try_from(at - self.at).unwrap_or(usize::MAX).saturating_mul(width);
                block.extend_from_slice(&decoded[place(at)..place(until.max(at))]);
            }
            taken = until.max(at) - self.at;
            if until == end || at >= end {
                self.parts.pop_front();
            }
        }
        if self.parts.is_empty() {
            taken = count;
        }
        self.at += taken;
        usize::try_from(taken).unwrap_or(usize::MAX)
    }
}

/// An entry of an edit list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Entry {
    /// In units of the whole file; 0 means to the end.
    length: u64,
    /// In units of the track; `None` for a pause.
    start: Option<u64>,
}

/// The edit list of an MPEG-4 file's first audio track.
#[derive(Debug)]
pub(super) struct List {
    entries: Vec<Entry>,
    /// Units per second of the track and of the whole file.
    scales: (u32, u32),
}

impl List {
    /// Reads the content of a `moov` box.
    pub(super) fn of_movie(movie: &[u8]) -> Option<Self> {
        let length_scale = scale(child(movie, b"mvhd")?)?;
        boxes(movie).filter(|(kind, _)| kind == b"trak").find_map(|(_, track)| {
            let media = child(track, b"mdia")?;
            (child(media, b"hdlr")?.get(8..12)? == b"soun").then_some(())?;
            let list = child(child(track, b"edts")?, b"elst")?;
            let entries = entries(list)?;
            (!entries.is_empty()).then_some(Self { entries, scales: (scale(child(media, b"mdhd")?)?, length_scale) })
        })
    }

    /// Converts the list to samples of each channel, of which the file claims `claimed`; `None` if parts are out of
    /// order.
    pub(super) fn edits(&self, sample_rate: u32, claimed: Option<u64>) -> Option<Edits> {
        let frames = |time: u64, scale: u32| {
            let frames = (u128::from(time) * u128::from(sample_rate)).div_ceil(u128::from(scale));
            u64::try_from(frames).unwrap_or(u64::MAX)
        };
        let (start_scale, length_scale) = self.scales;
        let (mut parts, mut before) = (VecDeque::new(), 0);
        for &Entry { length, start } in &self.entries {
            let Some(start) = start else {
                parts.push_back(Part::Pause(frames(length, length_scale)));
                continue;
            };
            let start = frames(start, start_scale);
            // A length is rounded to its scale, which may be coarse.
            let end = match length {
                0 | u64::MAX => u64::MAX,
                length => start.saturating_add(frames(length + 1, length_scale)),
            };
            let end = end.min(claimed.unwrap_or(u64::MAX)).max(start);
            if start < before && !parts.is_empty() {
                return None;
            }
            before = end.saturating_sub(frames(1, length_scale));
            parts.push_back(Part::Audio(start, end));
        }
        parts.retain(|part| *part != Part::Pause(0));
        Some(Edits { parts, at: 0 })
    }
}

fn entries(list: &[u8]) -> Option<Vec<Entry>> {
    let is_wide = *list.first()? == 1;
    let entries = list.get(8..)?.chunks_exact(if is_wide { 20 } else { 12 });
    // A negative start is a pause.
    let entry = |bytes: &[u8]| {
        Some(match is_wide {
            true => {
                let (length, rest) = bytes.split_first_chunk()?;
                let start = i64::from_be_bytes(*rest.first_chunk()?);
                Entry { length: u64::from_be_bytes(*length), start: u64::try_from(start).ok() }
            }
            false => {
                let start = i64::from(number(bytes.get(4..)?)?.cast_signed());
                Entry { length: number(bytes)?.into(), start: u64::try_from(start).ok() }
            }
        })
    };
    entries.map(entry).collect()
}

/// Units per second of an `mvhd` or `mdhd` box, not 0.
fn scale(header: &[u8]) -> Option<u32> {
    let at = if *header.first()? == 1 { 20 } else { 12 };
    number(header.get(at..)?).filter(|&scale| scale > 0)
}

fn number(bytes: &[u8]) -> Option<u32> {
    bytes.first_chunk().map(|&bytes| u32::from_be_bytes(bytes))
}

/// Content of the first box of a type.
fn child<'a>(bytes: &'a [u8], wanted: &[u8; 4]) -> Option<&'a [u8]> {
    boxes(bytes).find(|(kind, _)| kind == wanted).map(|(_, body)| body)
}

/// Type and content of the boxes in a box or file.
fn boxes(mut bytes: &[u8]) -> impl Iterator<Item = ([u8; 4], &[u8])> {
    std::iter::from_fn(move || {
        let (kind, header, size) = header(bytes)?;
        let size = if size == 0 { bytes.len() } else { usize::try_from(size).ok()? };
        let body = bytes.get(header..size)?;
        bytes = &bytes[size..];
        Some((kind, body))
    })
}

/// Type, header length and total length of a box; the latter is 0 for a box that extends to the end.
pub(super) fn header(bytes: &[u8]) -> Option<([u8; 4], usize, u64)> {
    let kind = *bytes.get(4..)?.first_chunk::<4>()?;
    Some(match number(bytes)? {
        1 => (kind, 16, u64::from_be_bytes(*bytes.get(8..)?.first_chunk()?)),
        size => (kind, 8, size.into()),
    })
}
