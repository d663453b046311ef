//! What was changed in a take: frames that differ, chunks that were drawn anew, and requests (SPEC 2.25).

use std::ops::Range;

use super::event::Event;
use super::log::Put;
use super::reader::Reader;
use super::{CHECKSUM, LENGTH, Take, TakeError, TakeInfo};

/// Tags of the records.
const WINDOW: u8 = 0x4B;
const DRAWN: u8 = 0x4C;
const AT: u8 = 0x4D;

/// Places of a take's edits, which follow its frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Edits {
    /// Where they begin: the end of the motion that was edited.
    pub(super) at: usize,
    /// Frames that may differ from that motion, in order.
    pub(super) windows: Vec<Range<u64>>,
    /// Where the requests begin, if they take the place of the motion's own.
    requests: Option<usize>,
}

/// Requests of an edit, in order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Requests<'a> {
    from: Reader<'a>,
    frame: u64,
}

/// Where a request is, and its frame unless it says another.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    at: usize,
    frame: u64,
}

impl<'a> Requests<'a> {
    /// The requests from a place on.
    pub(super) fn at(bytes: &'a [u8], Place { at, frame }: Place) -> Self {
        Self { from: Reader::from(bytes, at), frame }
    }

    /// Where the next one is.
    pub(super) fn place(self) -> Place {
        Place { at: self.from.at(), frame: self.frame }
    }

    /// The next request, and its frame.
    pub(super) fn next(&mut self) -> Result<Option<(u64, Event<'a>)>, TakeError> {
        while !self.from.is_at_end() {
            match self.from.u8("record")? {
                AT => self.frame = self.from.u32("frame of a request")?.into(),
                tag => return Event::read(tag, &mut self.from).map(|event| Some((self.frame, event))),
            }
        }
        Ok(None)
    }
}

impl Edits {
    /// Whether a record with this tag is of an edit.
    pub(super) fn begin(tag: u8) -> bool {
        (WINDOW..=AT).contains(&tag)
    }

    /// Reads the edits that begin at `at`.
    pub(super) fn read(bytes: &[u8], at: usize, frames: u32, version: u32) -> Result<Self, TakeError> {
        let mut edits = Self { at, ..Self::default() };
        let mut from = Reader::from(bytes, at);
        // Even versions have edits, odd ones none.
        if (version % 2 == 1) != from.is_at_end() {
            return Err(TakeError::Field("kind of record"));
        }
        while !from.is_at_end() {
            let start = from.at();
            match from.u8("record")? {
                WINDOW => {
                    let window = u64::from(from.u32("changed frames")?)..u64::from(from.u32("changed frames")?);
                    let end = edits.windows.last().map_or(0, |before| before.end);
                    if window.start < end || window.is_empty() || window.end > frames.into() {
                        return Err(TakeError::Field("changed frames"));
                    }
                    edits.windows.push(window);
                }
                DRAWN => {
                    let count = usize::from(from.u16("packet")?);
                    from.bytes(count)?;
                }
                AT => {
                    edits.requests = Some(start);
                    let (mut requests, mut last) = (Requests { from: Reader::from(bytes, start), frame: 0 }, 0);
                    while let Some((frame, _)) = requests.next()? {
                        if frame < last || frame > frames.into() {
                            return Err(TakeError::Field("frame of a request"));
                        }
                        last = frame;
                    }
                    break;
                }
                _ => return Err(TakeError::Field("kind of record")),
            }
        }
        match edits.windows.is_empty() && at < bytes.len() {
            true => Err(TakeError::Field("changed frames")),
            false => Ok(edits),
        }
    }

    /// Whether its requests take the place of the motion's own.
    pub(super) fn has_requests(&self) -> bool {
        self.requests.is_some()
    }

    /// The requests, if they take the place of the motion's own.
    pub(super) fn requests<'a>(&self, bytes: &'a [u8]) -> Option<Requests<'a>> {
        self.requests.map(|at| Requests { from: Reader::from(bytes, at), frame: 0 })
    }

    /// The packets that were drawn anew, in order.
    pub(super) fn packets<'a>(&self, bytes: &'a [u8]) -> impl Iterator<Item = &'a [u8]> + use<'a> {
        let mut from = Reader::from(&bytes[..self.requests.unwrap_or(bytes.len())], self.at);
        // Every record was read once.
        std::iter::from_fn(move || {
            loop {
                match from.u8("").ok()? {
                    DRAWN => {
                        let count = usize::from(from.u16("").ok()?);
                        return from.bytes(count).ok();
                    }
                    _ => drop(from.bytes(8).ok()?),
                }
            }
        })
    }

    /// Writes edits: `events` with their frames are all of the take's, if they differ from the motion's own.
    pub(super) fn write(out: &mut Put, windows: &[Range<u32>], packets: &[Vec<u8>], events: Option<&[(u64, Event)]>) {
        for window in windows {
            out.tag(WINDOW).bytes(&window.start.to_le_bytes()).bytes(&window.end.to_le_bytes());
        }
        for packet in packets {
            out.tag(DRAWN).count(packet.len()).bytes(packet);
        }
        let Some(events) = events else { return };
        let at = |out: &mut Put, frame: u64| {
            out.tag(AT).bytes(&u32::try_from(frame).unwrap_or(u32::MAX).to_le_bytes());
        };
        at(out, 0);
        let mut last = 0;
        for (frame, event) in events {
            if *frame != last {
                at(out, *frame);
                last = *frame;
            }
            event.write(out);
        }
    }
}

impl Take {
    /// The motion that was edited; the take itself if none was.
    pub(crate) fn original(&self) -> Self {
        Self { edits: Edits { at: self.edits.at, ..Edits::default() }.into(), ..self.clone() }
    }

    /// The take as it was before its edits; the same bytes if it was not edited.
    #[must_use]
    pub fn unedited(&self) -> Self {
        if !self.is_edited() {
            return self.clone();
        }
        let mut bytes = self.bytes[..self.edits.at].to_vec();
        let version = self.version(false);
        bytes[CHECKSUM - 4..CHECKSUM].copy_from_slice(&version.to_le_bytes());
        let length = bytes.len() as u64;
        bytes[LENGTH..LENGTH + 8].copy_from_slice(&length.to_le_bytes());
        let sum = crc32fast::hash(&bytes[LENGTH..]);
        bytes[CHECKSUM..LENGTH].copy_from_slice(&sum.to_le_bytes());
        let info = TakeInfo { version, ..self.info };
        Self { bytes: bytes.into(), info, ..self.original() }
    }

    /// Whether it was edited.
    pub fn is_edited(&self) -> bool {
        !self.edits.windows.is_empty()
    }

    /// The frames that may differ from the motion that was edited, in order.
    pub fn changed(&self) -> &[Range<u64>] {
        &self.edits.windows
    }
}
