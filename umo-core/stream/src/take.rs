//! Takes: a motion as a file, of its packets, its sound as the layers hear it, and what its host asked for (SPEC
//! 2.24).
//!
//! | module | contents |
//! |---|---|
//! | `log` | records of a take, as it is made |
//! | `edits` | what was changed in a take |
//! | `draw` | changing a take: chunks drawn anew |
//! | `join` | from changed frames back to the motion's own |
//! | `record` | the take of a session that runs |
//! | `event` | what a host asks for, as bytes and for the layers |
//! | `reader` | fields out of bytes |
//! | `play` | the cursor of a take that is played |

mod draw;
mod edits;
mod event;
mod join;
mod log;
mod play;
mod reader;
mod record;

use std::fmt;
use std::sync::Arc;

use umo_core_layers::{Controls, Gestures, LAYERS, Layer, LayerGains, WordRules};
use umo_core_model::avatar::AvatarConfig;
use umo_core_model::config::Sampling;
use umo_core_model::lm::sampler::Sampler;
use umo_core_model::model::Model;

use crate::packet::{PacketError, PacketLayout, SOUND};
use crate::session::SessionError;
pub(crate) use draw::Redrawn;
pub use draw::{Edit, EditError};

use edits::Edits;
pub use event::Event;
pub(crate) use event::{Known, Passed};
pub(crate) use join::{Join, Patch};
pub(crate) use log::{Head, Log};
pub(crate) use play::{Packets, Play};
use play::{Record, Records};
use reader::Reader;
pub(crate) use record::Recorder;

/// First bytes of a take.
const MAGIC: &[u8; 8] = b"umo take";
/// The version that this library writes; it reads all up to it.
const VERSION: u32 = 6;
/// The version of a take without edits. Odd versions have none, and the even ones after them are the same with edits.
const UNEDITED: u32 = 5;
/// The first version that has the gain of the layer body, and hands at rest between gestures.
const FIRST_WITH_BODY: u32 = 3;
/// Where the fields of the head are; the checksum is over everything after it.
const CHECKSUM: usize = 12;
const LENGTH: usize = 16;
const FRAMES: usize = 24;
const AUDIO: usize = 32;
const RULES: usize = 56;

/// Why bytes are not a take, or a take cannot be played.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum TakeError {
    /// The bytes are not a take.
    Foreign,
    /// Made by a later version of this library.
    Version(u32),
    /// Cut short or continued.
    Length {
        /// Bytes there are.
        got: u64,
        /// Bytes that the take says it has.
        want: u64,
    },
    /// Some byte is damaged.
    Checksum,
    /// A field is out of range; names it.
    Field(&'static str),
    /// Made with another model.
    Model,
    /// A packet is not one of the model's.
    Packet {
        /// Its number.
        number: u32,
        /// The reason.
        error: PacketError,
    },
    /// Something that the host asked for is refused.
    Event {
        /// Frame at which it was asked for.
        frame: u64,
        /// The request.
        what: String,
        /// The reason.
        error: SessionError,
    },
}

impl fmt::Display for TakeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Foreign => write!(f, "not a take: it does not begin with `umo take`"),
            Self::Version(got) => {
                write!(f, "a take of version {got}; this library reads up to {VERSION}: use a later version of umo")
            }
            Self::Length { got, want } => write!(f, "a take of {want} bytes, of which there are {got}: it is damaged"),
            Self::Checksum => write!(f, "its checksum is wrong: the take is damaged"),
            Self::Field(what) => write!(f, "its {what} is out of range: the take is damaged"),
            Self::Model => write!(f, "made with another model: load the one that the take was made with"),
            Self::Packet { number, error } => write!(f, "packet {number}: {error}"),
            Self::Event { frame, what, error } => write!(f, "{what} at frame {frame}: {error}"),
        }
    }
}

impl std::error::Error for TakeError {}

/// Properties of a take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct TakeInfo {
    /// Version of its format.
    pub version: u32,
    /// Number of frames.
    pub frames: u32,
    /// Number of packets.
    pub packets: u32,
    /// Frames a second.
    pub frame_rate: u32,
    /// Sample frames a second of the host's audio.
    pub sample_rate: u32,
    /// Fingerprint of its model.
    pub model: u64,
    /// Fingerprint of the audio that the avatar heard, mono at the model's rate: FNV-1a of 64 bits over the bytes of
    /// its samples.
    pub audio: u64,
    /// Number of those samples.
    pub samples: u64,
    /// Fingerprint of its word rules.
    pub rules: u64,
}

/// A motion that was made: its packets, the sound of its frames, and what its host asked for, in time. A session made
/// by [`Session::of_take`](crate::session::Session::of_take) plays it without audio and without the language model,
/// with the same bits. A clone is cheap and shares the bytes.
#[derive(Clone, Debug)]
pub struct Take {
    bytes: Arc<[u8]>,
    info: TakeInfo,
    avatar: AvatarConfig,
    layers: LayerGains,
    /// Codes of the keyframes before its start; empty for rest.
    history: Arc<[u16]>,
    /// Where the records begin.
    body: usize,
    edits: Arc<Edits>,
}

impl Take {
    /// Reads a take.
    ///
    /// # Errors
    /// [`TakeError`] if the bytes are not a whole take of a version that this library knows.
    pub fn new(bytes: &[u8]) -> Result<Self, TakeError> {
        let mut head = Reader::new(bytes);
        if head.bytes(MAGIC.len()).map_or(true, |magic| magic != MAGIC) {
            return Err(TakeError::Foreign);
        }
        let length = bytes.len() as u64;
        let cut = |_| TakeError::Length { got: length, want: LENGTH as u64 + 8 };
        let version = head.u32("version").map_err(cut)?;
        if version == 0 || version > VERSION {
            return Err(TakeError::Version(version));
        }
        let (sum, want) = (head.u32("checksum").map_err(cut)?, head.u64("length").map_err(cut)?);
        if want != length {
            return Err(TakeError::Length { got: length, want });
        }
        if sum != crc32fast::hash(&bytes[LENGTH..]) {
            return Err(TakeError::Checksum);
        }
        let mut take = Self::read_head(bytes, version, head)?;
        take.edits = take.read_records()?.into();
        Ok(take)
    }

    /// Reads the head after its length.
    fn read_head(bytes: &[u8], version: u32, mut head: Reader) -> Result<Self, TakeError> {
        let (frames, packets) = (head.u32("number of frames")?, head.u32("number of packets")?);
        let (audio, samples) = (head.u64("audio")?, head.u64("audio")?);
        let (model, rules, seed) = (head.u64("model")?, head.u64("word rules")?, head.u64("seed")?);
        let (frame_rate, sample_rate) = (head.u32("frame rate")?, head.u32("sample rate")?);
        if !(1..=1000).contains(&frame_rate) || !(1..=1 << 20).contains(&sample_rate) {
            return Err(TakeError::Field("rate"));
        }
        let [target, lookahead, horizon] = [head.small("target")?, head.small("lookahead")?, head.small("horizon")?];
        let (smoothing, guidance) = (head.within("smoothing", 0.0, 10.0)?, head.within("guidance", 0.0, 10.0)?);
        let sampling = Sampling {
            temperature: head.within("temperature", 0.0, 100.0)?,
            top_k: head.small("top_k")?,
            top_p: head.share("top_p")?,
        };
        let (activity, expression) = (head.share("activity")?, head.share("expression")?);
        let mut layers = LayerGains::OFF;
        for layer in Layer::ALL.into_iter().filter(|&layer| layer != Layer::Body || version >= FIRST_WITH_BODY) {
            layers = layers.with(layer, head.share("gain of a layer")?);
        }
        let template = head.text("template")?.to_owned();
        let text = head.list("prompt", u32::from_le_bytes)?;
        let history = head.list("history", u16::from_le_bytes)?.into();
        let sampler = Sampler { sampling, seed, activity, expression };
        let avatar = AvatarConfig { target, lookahead, smoothing, sampler, template, text, horizon, guidance };
        let info = TakeInfo { version, frames, packets, frame_rate, sample_rate, model, audio, samples, rules };
        Ok(Self { bytes: bytes.into(), info, avatar, layers, history, body: head.at(), edits: Arc::default() })
    }

    /// Version of this take with edits, or without.
    fn version(&self, is_edited: bool) -> u32 {
        (self.info.version - 1) / 2 * 2 + if is_edited { 2 } else { 1 }
    }

    /// Checks that every record can be read, and their numbers; returns the edits.
    fn read_records(&self) -> Result<Edits, TakeError> {
        let (mut frames, mut packets, mut records) = (0, 0, Records::new(&self.bytes, self.body));
        while let Some(record) = records.next()? {
            match record {
                Record::Frame => frames += 1,
                Record::Packet(_) => packets += 1,
                Record::Event(_) => {}
            }
        }
        match (frames, packets) == (self.info.frames, self.info.packets) {
            true => Edits::read(&self.bytes, records.at(), frames, self.info.version),
            false => Err(TakeError::Field("number of frames or packets")),
        }
    }

    /// Records of the motion, without its edits.
    fn records(&self) -> Records<'_> {
        Records::new(&self.bytes[..self.edits.at], self.body)
    }

    /// The bytes of the file.
    pub fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Its properties.
    pub fn info(&self) -> &TakeInfo {
        &self.info
    }

    /// Settings of the avatar at the start.
    pub fn avatar(&self) -> &AvatarConfig {
        &self.avatar
    }

    /// Gains of the layers at the start.
    pub fn layers(&self) -> LayerGains {
        self.layers
    }

    /// Requests to the layers at the start.
    pub(crate) fn controls(&self) -> Controls {
        let controls = crate::playback::controls(&self.avatar.sampler, self.layers);
        // Before, hands rested where the model has them.
        if self.info.version < FIRST_WITH_BODY { Controls { activity: 1.0, ..controls } } else { controls }
    }

    /// Codes of the keyframes before the start.
    pub(crate) fn history(&self) -> &[u16] {
        &self.history
    }

    /// The host's requests in order, each with the first frame that it was in force at.
    pub fn events(&self) -> impl Iterator<Item = (u64, Event<'_>)> {
        let (mut records, mut frame) = (self.records(), 0);
        let mut edited = self.edits.requests(&self.bytes);
        std::iter::from_fn(move || {
            // Every record was read once.
            if let Some(edited) = &mut edited {
                return edited.next().ok().flatten();
            }
            while let Ok(Some(record)) = records.next() {
                match record {
                    Record::Event(event) => return Some((frame, event)),
                    Record::Frame => frame += 1,
                    Record::Packet(_) => {}
                }
            }
            None
        })
    }

    /// Whether there are words among them.
    pub fn has_words(&self) -> bool {
        self.events().any(|(_, event)| matches!(event, Event::Words { .. }))
    }

    /// Its packets, in order; of one that was edited, those of the motion before.
    pub fn packets(&self) -> impl Iterator<Item = &[u8]> {
        let mut records = self.records();
        std::iter::from_fn(move || {
            while let Ok(Some(record)) = records.next() {
                if let Record::Packet(bytes) = record {
                    return Some(bytes);
                }
            }
            None
        })
    }

    /// Checks that a session with this model, and with the host's gestures and word rules, can play it.
    ///
    /// # Errors
    /// [`TakeError`] that names what does not fit.
    pub fn check(&self, model: &Model, gestures: &Gestures, rules: &WordRules) -> Result<(), TakeError> {
        let config = model.config();
        if self.info.model != model.fingerprint() {
            return Err(TakeError::Model);
        }
        if self.info.frame_rate as usize != config.frame_rate {
            return Err(TakeError::Field("frame rate"));
        }
        self.avatar.check(config).map_err(|_| TakeError::Field("settings"))?;
        self.check_codes(model)?;
        let known =
            Known { gestures, rules, frame_rate: config.frame_rate, sample_rate: self.info.sample_rate as usize };
        let mut controls = self.controls();
        for (number, (frame, event)) in self.events().enumerate() {
            // As if each found an empty queue: that there is room was checked when it was asked for.
            let passed = Passed::all(number as u64 * umo_core_layers::MAX_PENDING_WORDS as u64);
            let refused = |error| TakeError::Event { frame, what: event.to_string(), error: SessionError::from(error) };
            event.apply(&mut controls, &known, (0, passed)).map_err(refused)?;
        }
        Ok(())
    }

    /// Checks packets and history.
    fn check_codes(&self, model: &Model) -> Result<(), TakeError> {
        let config = model.config();
        let layout = PacketLayout::new(model);
        let mut sounds = vec![[0; SOUND]; layout.max_keyframes()];
        let mut codes = vec![0; layout.max_keyframes() * layout.codes()];
        let mut mouth = vec![0; layout.max_mouth_frames() * layout.mouth()];
        for (number, bytes) in (0..).zip(self.packets()) {
            let wrong = |error| TakeError::Packet { number, error };
            let head = layout.decode(bytes, &mut sounds, &mut codes, &mut mouth).map_err(wrong)?;
            let is_last = number + 1 == self.info.packets;
            // Only the stream's last packet may have no keyframes of its own.
            let has_target = head.keyframes == self.avatar.target || head.keyframes == 0;
            if head.sequence != number || head.history != 0 || head.stream != 0 || !has_target {
                return Err(wrong(PacketError::Malformed("it does not follow the one before")));
            }
            if head.total.is_some() && !is_last {
                return Err(wrong(PacketError::Malformed("it ends the stream before the last one")));
            }
        }
        let limits = layout.limits();
        let is_code = |(code, limit): (&u16, &u16)| code < limit;
        let are_codes = self.history.iter().zip(limits.iter().cycle()).all(is_code);
        let is_whole = self.history.is_empty() || self.history.len() == config.prefix * layout.codes();
        if are_codes && is_whole { Ok(()) } else { Err(TakeError::Field("history")) }
    }
}

/// Number of layers whose gains a head has.
const _: () = assert!(LAYERS == 7, "another number of layers is another version of the format");
