//! The records of a take, and the cursor of one that is played.

use std::sync::Arc;

use umo_core_base::arousal::ORDINARY;
use umo_core_layers::Controls;
use umo_core_pose::frame::{Cue, OwnedFrame};

use super::edits::{Edits, Place, Requests};
use super::event::Event;
use super::join::{Offset, Patch};
use super::reader::Reader;
use super::{Take, TakeError};
use crate::playback::LayersState;

/// Tag of a packet's record.
pub(super) const PACKET: u8 = 0x40;
/// A frame's record is a byte of these flags, and a number for each; the others are the frame before's.
pub(super) const LEVEL: u8 = 1;
pub(super) const AROUSAL: u8 = 2;
pub(super) const ONSET: u8 = 4;
pub(super) const OTHER: u8 = 8;

/// Level of a voice that is not heard.
pub(super) const NOT_HEARD: f32 = -1.0;

/// Sound of a frame, as the layers hear it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sound {
    pub(super) level: f32,
    pub(super) arousal: f32,
    pub(super) onset: f32,
    /// Level of the other's voice, or [`NOT_HEARD`].
    pub(super) other: f32,
}

impl Sound {
    /// Before the first frame.
    pub(super) const START: Self = Self { level: 0.0, arousal: ORDINARY, onset: 0.0, other: NOT_HEARD };
}

/// A record.
#[derive(Clone, Copy, Debug)]
pub(super) enum Record<'a> {
    Packet(&'a [u8]),
    Event(Event<'a>),
    /// The next frame, whose sound [`Records::sound`] is.
    Frame,
}

/// Reads records in order.
#[derive(Clone, Copy, Debug)]
pub(super) struct Records<'a> {
    from: Reader<'a>,
    pub(super) sound: Sound,
}

impl<'a> Records<'a> {
    pub(super) fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { from: Reader::from(bytes, at), sound: Sound::START }
    }

    /// Position of the next record.
    pub(super) fn at(&self) -> usize {
        self.from.at()
    }

    /// The next record; `None` after the last.
    pub(super) fn next(&mut self) -> Result<Option<Record<'a>>, TakeError> {
        if self.from.is_at_end() {
            return Ok(None);
        }
        let mut from = self.from;
        let tag = from.u8("record")?;
        if Edits::begin(tag) {
            return Ok(None);
        }
        self.from = from;
        if tag == PACKET {
            let count = usize::from(self.from.u16("packet")?);
            return Ok(Some(Record::Packet(self.from.bytes(count)?)));
        }
        if tag > LEVEL | AROUSAL | ONSET | OTHER {
            return Event::read(tag, &mut self.from).map(|event| Some(Record::Event(event)));
        }
        let Self { from, sound } = self;
        let mut read = |flag: u8, what: &'static str, field: &mut f32, least: f32, most: f32| {
            if tag & flag != 0 {
                *field = from.within(what, least, most)?;
            }
            Ok::<_, TakeError>(())
        };
        read(LEVEL, "level", &mut sound.level, 0.0, 1e9)?;
        read(AROUSAL, "arousal", &mut sound.arousal, 0.0, 1.0)?;
        read(ONSET, "onset", &mut sound.onset, -1.0, 1.0)?;
        read(OTHER, "other's level", &mut sound.other, NOT_HEARD, 1e9)?;
        Ok(Some(Record::Frame))
    }
}

/// The frame side of a take that is played: each frame's sound, and what the host asked for before it.
#[derive(Debug)]
pub(crate) struct Play {
    take: Take,
    /// Where the next record is, the sound so far, and the frame that [`Self::advance`] was called for last.
    at: usize,
    sound: Sound,
    frame: Option<u64>,
    /// Where the next request of an edit is.
    request: Option<Place>,
    patches: Option<Arc<[Patch]>>,
    /// What fades after changed frames.
    pub(crate) fading: Offset,
    /// The host's requests as the take left them, and whether the present host asked for anything.
    left: Option<Controls>,
    is_asked: bool,
}

impl Play {
    /// `face` is the number of face values.
    pub(crate) fn new(take: Take, patches: Option<Arc<[Patch]>>, face: usize) -> Self {
        let (at, request) = (take.body, take.edits.requests(&take.bytes).map(Requests::place));
        let fading = Offset::new(face);
        Self { at, take, sound: Sound::START, frame: None, request, patches, fading, left: None, is_asked: false }
    }

    /// Returns to the start.
    pub(crate) fn reset(&mut self) {
        (self.at, self.sound, self.frame) = (self.take.body, Sound::START, None);
        self.request = self.take.edits.requests(&self.take.bytes).map(Requests::place);
        (self.left, self.is_asked) = (None, false);
        self.fading.reset();
    }

    /// Advances to a frame of the stream, and calls `event` with what the host asked for before it.
    pub(crate) fn advance(&mut self, frame: u64, mut event: impl FnMut(Event)) {
        let Self { take, request, .. } = self;
        let mut records = Records { from: Reader::from(&take.bytes[..take.edits.at], self.at), sound: self.sound };
        while self.frame.is_none_or(|last| last < frame) {
            // Every record was read once.
            match records.next() {
                Ok(Some(Record::Frame)) => self.frame = Some(self.frame.map_or(0, |last| last + 1)),
                Ok(Some(Record::Event(asked))) if request.is_none() => event(asked),
                Ok(Some(_)) => {}
                Ok(None) | Err(_) => break,
            }
        }
        (self.at, self.sound) = (records.from.at(), records.sound);
        while let Some(place) = request {
            let mut requests = Requests::at(&take.bytes, *place);
            match requests.next() {
                Ok(Some((at, asked))) if at <= frame => event(asked),
                _ => break,
            }
            *place = requests.place();
        }
    }

    /// Puts the frame's sound in place of what its packet says.
    pub(crate) fn cue(&self, cue: &mut Cue) {
        let Sound { level, arousal, onset, .. } = self.sound;
        *cue = Cue { level, arousal, onset, ..*cue };
    }

    /// Level of the other's voice at the frame, if one is heard.
    pub(crate) fn other(&self) -> Option<f32> {
        (self.sound.other >= 0.0).then_some(self.sound.other)
    }

    /// Puts a frame that was drawn anew in place of the motion's own.
    pub(crate) fn patch(&self, frame: &mut OwnedFrame) {
        let index = frame.index;
        let patch = self.patches().iter().find(|patch| patch.frames.contains(&index));
        let drawn = patch.and_then(|patch| patch.drawn.get(usize::try_from(index - patch.frames.start).ok()?));
        if let Some(drawn) = drawn {
            frame.pose_of(drawn);
            (frame.cue.contacts, frame.cue.prompted) = (drawn.cue.contacts, drawn.cue.prompted);
        }
    }

    /// Returns to the motion's own layers by `back`, if `frame` is the first after changed ones: their difference then
    /// fades from the frame that was shown last. `now` is what the host asks for before the take does; where the present host
    /// has asked for something of its own, layers go on as they are.
    pub(crate) fn rejoin(
        &mut self,
        frame: u64,
        now: &Controls,
        shown: &OwnedFrame,
        back: impl FnOnce(&LayersState) -> bool,
    ) {
        let of_take = self.take.controls();
        self.is_asked |= match &self.left {
            Some(left) => left != now,
            None => !now.stands_as(&of_take),
        };
        let patches = self.patches.as_deref().unwrap_or_default();
        let patch = patches.iter().find(|patch| patch.frames.end == frame).filter(|_| !self.is_asked);
        if let Some(join) = patch.and_then(|patch| patch.join.as_ref())
            && back(&join.layers)
        {
            self.fading.begin(shown, &join.shown);
        }
    }

    /// Takes note of what the host asks for once the take has; `None` if that cannot be read now.
    pub(crate) fn leave(&mut self, now: Option<Controls>) {
        self.is_asked |= now.is_none();
        self.left = now;
    }

    fn patches(&self) -> &[Patch] {
        self.patches.as_deref().unwrap_or_default()
    }

    /// Whether there are changed frames.
    pub(crate) fn has_joins(&self) -> bool {
        !self.patches().is_empty()
    }
}

/// The packets of a take, one after the other.
#[derive(Debug)]
pub(crate) struct Packets {
    take: Take,
    at: usize,
}

impl Packets {
    pub(crate) fn new(take: Take) -> Self {
        Self { at: take.body, take }
    }

    /// Returns to the first.
    pub(crate) fn reset(&mut self) {
        self.at = self.take.body;
    }

    /// Calls `push` with the next packet, which is passed unless that returns `None`; `None` after the last.
    pub(crate) fn next<R>(&mut self, push: impl FnOnce(&[u8]) -> Option<R>) -> Option<Option<R>> {
        let mut records = Records::new(&self.take.bytes[..self.take.edits.at], self.at);
        loop {
            match records.next() {
                Ok(Some(Record::Packet(packet))) => {
                    let pushed = push(packet);
                    if pushed.is_some() {
                        self.at = records.from.at();
                    }
                    return Some(pushed);
                }
                Ok(Some(_)) => self.at = records.from.at(),
                Ok(None) | Err(_) => return None,
            }
        }
    }
}
