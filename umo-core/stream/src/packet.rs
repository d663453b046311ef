//! Network format for chunk codes: encoder and decoder (SPEC 2.18).
//!
//! The sender runs the language model; [`Decoder`] runs the stages after it, interpolation and motion decoders, at a
//! fraction of the cost. Without packet loss, its frames are bit-identical to the sender's.

mod decoder;
mod lips;
mod room;

use std::fmt;
use umo_core_base::functions::Functions;

pub(crate) use decoder::PacketSink;
pub use decoder::{Decoder, Received};
pub(crate) use room::PacketRoom;

use umo_core_base::error::StepError;
use umo_core_model::model::Model;

/// The version of packets without a mouth, and of those with one.
const VERSION: u8 = 2;
const WITH_MOUTH: u8 = 3;
/// Flag in the first byte, beside the version: this is the last packet of the stream.
const LAST: u8 = 0x10;
/// Flag in the first byte: a prompt is in force.
const PROMPTED: u8 = 0x20;
/// Size of the head, bytes, in packets before the last; what it has in addition with a mouth.
const HEAD: usize = 26;
const MOUTH: usize = 4;
/// Upper bound of a root coordinate, metres, so that sums of positions stay finite.
const MAX_PLACE: f32 = 1e7;
/// Bytes of the frame count, in the last packet.
const TOTAL: usize = 4;
/// Bytes of a new keyframe's sound: its audio level and its arousal.
pub const SOUND: usize = 2;

/// Error from pushing a packet. The decoder is unchanged, except after [`Self::Step`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PacketError {
    /// Not a packet of this version; names the problem.
    Malformed(&'static str),
    /// Made with another model, or for another target; names the difference.
    Other(&'static str),
    /// No room for its frames: it may be pushed again after some were taken.
    Full,
    /// Its frames could not be computed; the decoder needs [`Decoder::reset`].
    Step(StepError),
}

impl fmt::Display for PacketError {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::Malformed(what) => write!(f, "not a packet: {what}"),
            Self::Other(what) => write!(f, "packet of another {what}: create both sides with the same one"),
            Self::Full => write!(f, "the queue is full: take frames, then push the packet again"),
            Self::Step(error) => error.fmt(f),
        }
    }
}

impl std::error::Error for PacketError {}

impl From<StepError> for PacketError {
    fn from(error: StepError) -> Self {
        Self::Step(error)
    }
}

/// Contents of a packet other than its codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PacketHead {
    /// Number of the stream, modulo 256; incremented by every reset and interrupt of the sender.
    pub stream: u8,
    /// Number of the packet in its stream, which is its chunk's number.
    pub sequence: u32,
    /// Position in the stream of the first new keyframe, samples at the model's rate.
    pub sample: u64,
    /// Position of the root in the last frame that the chunk makes final: x and z, metres.
    pub root: [f32; 2],
    /// Number of new keyframes: the target, or 0 if the stream ended after its last chunk was sent.
    pub keyframes: usize,
    /// Number of earlier keyframes repeated before the new ones.
    pub history: usize,
    /// Frames of the whole stream, in its last packet only.
    pub total: Option<u32>,
    /// Whether a prompt says what the frames show that the packet makes final.
    pub is_prompted: bool,
    /// Number of frames that the packet has the mouth of.
    pub mouth_frames: usize,
    /// How many frames the first of them is before that of the chunk's first keyframe.
    pub mouth_back: u16,
}

/// Packet layout of a model.
#[derive(Clone, Debug)]
pub struct PacketLayout {
    /// Low bits of the model's fingerprint.
    model: u16,
    /// Number of values of each code of a keyframe.
    limits: Box<[u16]>,
    /// Bits of each code.
    bits: Box<[u8]>,
    keyframe_bits: usize,
    prefix: usize,
    /// Channels of the mouth, and frames that a packet can have it of.
    mouth: usize,
    mouth_frames: usize,
}

impl PacketLayout {
    /// Layout of the packets of a model's avatars.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "codes fit 16 bits by the config's checks; a tell-tale is short"
    )]
    pub fn new(model: &Model) -> Self {
        let (config, id) = (model.config(), model.fingerprint());
        let places =
            config.part_list().into_iter().flat_map(|part| std::iter::repeat_n(part.codes as u16, part.levels));
        let id = id ^ (id >> 16) ^ (id >> 32) ^ (id >> 48);
        let channels = model.mouth().filter(|mouth| mouth.behind().is_some()).map_or(0, |mouth| mouth.channels().len());
        // New ones, and those held back.
        let frames = (2 * config.prefix * config.keyframe_stride).min(u8::MAX.into());
        Self::of(places.collect(), config.prefix, id as u16).with_mouth(channels, frames)
    }

    fn with_mouth(self, mouth: usize, mouth_frames: usize) -> Self {
        Self { mouth, mouth_frames: if mouth > 0 { mouth_frames } else { 0 }, ..self }
    }

    /// Layout for keyframes with these numbers of values per code.
    #[expect(clippy::cast_possible_truncation, reason = "at most 16")]
    fn of(limits: Box<[u16]>, prefix: usize, model: u16) -> Self {
        let bits: Box<[u8]> = limits.iter().map(|&codes| (u16::BITS - (codes - 1).leading_zeros()) as u8).collect();
        let keyframe_bits = bits.iter().map(|&bits| usize::from(bits)).sum();
        Self { model, limits, bits, keyframe_bits, prefix, mouth: 0, mouth_frames: 0 }
    }

    /// Size of the longest packet, bytes.
    pub fn most_bytes(&self) -> usize {
        self.most_bytes_of(self.mouth_frames)
    }

    /// Size of the longest packet of avatars whose chunks make at most `frames` frames final, bytes.
    pub(crate) fn most_bytes_of(&self, frames: usize) -> usize {
        HEAD + MOUTH
            + TOTAL
            + SOUND * self.prefix
            + (self.prefix * self.keyframe_bits).div_ceil(8)
            + self.mouth_frames.min(frames) * self.mouth
    }

    /// Channels of the mouth in a packet; 0 for a model whose mouth is in the codes.
    pub fn mouth(&self) -> usize {
        self.mouth
    }

    /// Most frames that a packet has the mouth of.
    pub fn max_mouth_frames(&self) -> usize {
        self.mouth_frames
    }

    /// Codes per keyframe.
    pub fn codes(&self) -> usize {
        self.limits.len()
    }

    /// Number of values of each code of a keyframe.
    pub(crate) fn limits(&self) -> &[u16] {
        &self.limits
    }

    /// Maximum number of keyframes in a packet.
    pub fn max_keyframes(&self) -> usize {
        self.prefix
    }

    /// Size of a packet without a mouth, with this number of new and of repeated keyframes, bytes.
    pub fn bytes(&self, keyframes: usize, history: usize, is_last: bool) -> usize {
        let total = if is_last { TOTAL } else { 0 };
        HEAD + total + SOUND * keyframes + ((keyframes + history) * self.keyframe_bits).div_ceil(8)
    }

    /// Writes a packet with the `sounds` of the new keyframes, level and arousal as SPEC 2.18 defines them, `codes
    /// [history + keyframes, codes of a keyframe]`, oldest first, and `mouth [mouth_frames, channels]`; returns its length.
    /// Never allocates.
    ///
    /// # Errors
    /// [`StepError`] if `out` is too small, the numbers of keyframes disagree or exceed the model's `prefix`, a code is out
    /// of range, or there are more frames of a mouth than [`Self::max_mouth_frames`].
    pub fn encode(
        &self,
        head: &PacketHead,
        sounds: &[[u8; SOUND]],
        codes: &[u16],
        mouth: &[u8],
        out: &mut [u8],
    ) -> Result<usize, StepError> {
        let keyframes = head.history + head.keyframes;
        let limit = self.prefix.min(u8::MAX.into());
        if keyframes > limit {
            return Err(StepError::TooLong { what: "keyframes of a packet", got: keyframes, limit });
        }
        if codes.len() != keyframes * self.codes() || sounds.len() != head.keyframes {
            return Err(StepError::Disagree("a packet's codes or sounds and its number of keyframes"));
        }
        let wrong = codes.iter().zip(self.limits.iter().cycle()).find(|(code, limit)| code >= limit);
        if let Some((&code, &limit)) = wrong {
            return Err(StepError::OutOfRange { what: "code", got: code.into(), limit: limit.into() });
        }
        if head.mouth_frames > self.mouth_frames {
            let (got, limit) = (head.mouth_frames, self.mouth_frames);
            return Err(StepError::TooLong { what: "frames of a packet's mouth", got, limit });
        }
        if mouth.len() != head.mouth_frames * self.mouth {
            return Err(StepError::Disagree("a packet's mouth and its number of frames"));
        }
        let (coding, bytes_of_mouth) = lips::coding(mouth, self.mouth);
        let more = if head.mouth_frames > 0 { MOUTH } else { 0 };
        let plain = more + self.bytes(head.keyframes, head.history, head.total.is_some());
        let (want, limit) = (plain + bytes_of_mouth, out.len());
        let out = out.get_mut(..want).ok_or(StepError::TooLong { what: "bytes of a packet", got: want, limit })?;
        out.fill(0);
        #[expect(clippy::cast_possible_truncation, reason = "at most 255 by the checks above")]
        let counts = [head.keyframes as u8, head.history as u8, head.mouth_frames as u8, coding];
        out[0] = if more > 0 { WITH_MOUTH } else { VERSION };
        out[0] |= if head.total.is_some() { LAST } else { 0 } | if head.is_prompted { PROMPTED } else { 0 };
        out[1] = head.stream;
        out[2..4].copy_from_slice(&self.model.to_le_bytes());
        out[4..8].copy_from_slice(&head.sequence.to_le_bytes());
        out[8..16].copy_from_slice(&head.sample.to_le_bytes());
        out[16..20].copy_from_slice(&head.root[0].to_le_bytes());
        out[20..24].copy_from_slice(&head.root[1].to_le_bytes());
        out[24..26].copy_from_slice(&counts[..2]);
        let mut start = HEAD + more;
        if more > 0 {
            out[26..28].copy_from_slice(&counts[2..]);
            out[28..30].copy_from_slice(&head.mouth_back.to_le_bytes());
        }
        if let Some(total) = head.total {
            out[start..start + TOTAL].copy_from_slice(&total.to_le_bytes());
            start += TOTAL;
        }
        let sounds = sounds.as_flattened();
        out[start..start + sounds.len()].copy_from_slice(sounds);
        start += sounds.len();
        let mut at = 8 * start;
        for (&code, &bits) in codes.iter().zip(self.bits.iter().cycle()) {
            for bit in 0..bits {
                out[at / 8] |= ((code >> bit & 1) as u8) << (at % 8);
                at += 1;
            }
        }
        lips::write(mouth, self.mouth, coding, &mut out[plain..]);
        Ok(want)
    }

    /// Reads a packet. Writes its sounds, codes and mouth to the start of `sounds`, `codes` and `mouth`, which have room for
    /// [`Self::max_keyframes`] and [`Self::max_mouth_frames`]. Never allocates.
    ///
    /// # Errors
    /// [`PacketError`] if it is not a packet of a known version and this model; the contents of `sounds`, `codes` and
    /// `mouth` are then unspecified.
    pub fn decode(
        &self,
        bytes: &[u8],
        sounds: &mut [[u8; SOUND]],
        codes: &mut [u16],
        mouth: &mut [u8],
    ) -> Result<PacketHead, PacketError> {
        let more = match bytes.first().map(|first| first & 0x0F) {
            None | Some(VERSION) => 0,
            Some(WITH_MOUTH) => MOUTH,
            _ => {
                return Err(PacketError::Malformed(
                    "its version is not 2 or 3: use the same version of umo on both sides",
                ));
            }
        };
        let Some((head, rest)) = bytes.split_at_checked(HEAD + more) else {
            return Err(PacketError::Malformed("it is too short"));
        };
        if head[0] & !(0x0F | LAST | PROMPTED) != 0 {
            return Err(PacketError::Malformed("it has flags that its version does not have"));
        }
        if u16::from_le_bytes(field(head, 2)) != self.model {
            return Err(PacketError::Other("model"));
        }
        let (keyframes, history) = (usize::from(head[24]), usize::from(head[25]));
        let (count, is_last) = (keyframes + history, head[0] & LAST != 0);
        if count > self.prefix || count * self.codes() > codes.len() || keyframes > sounds.len() {
            return Err(PacketError::Malformed("it has more keyframes than the model's history"));
        }
        let (mouth_frames, coding, mouth_back) = match head[HEAD..] {
            [frames, coding, low, high] => (usize::from(frames), coding, u16::from_le_bytes([low, high])),
            _ => (0, 0, 0),
        };
        let is_mouth = (1..=self.mouth_frames).contains(&mouth_frames) && mouth_frames * self.mouth <= mouth.len();
        if more > 0 && !is_mouth {
            return Err(PacketError::Malformed("it has the mouth of no frame, or of more than a chunk has"));
        }
        let plain = more + self.bytes(keyframes, history, is_last);
        if bytes.len() < plain || more == 0 && bytes.len() != plain {
            return Err(PacketError::Malformed("its length is not that of its keyframes"));
        }
        let root = [f32::from_le_bytes(field(head, 16)), f32::from_le_bytes(field(head, 20))];
        if !root.iter().all(|v| v.abs() <= MAX_PLACE) {
            return Err(PacketError::Malformed("its root is out of range"));
        }
        if head[4..8] == [0xFF; 4] {
            return Err(PacketError::Malformed("its sequence number is the last one, but it does not end the stream"));
        }
        if keyframes == 0 && !is_last {
            return Err(PacketError::Malformed("it has no keyframes and does not end the stream"));
        }
        let total = is_last.then(|| u32::from_le_bytes(field(rest, 0)));
        let (rest, lips) = rest.split_at(plain - HEAD - more);
        let (heard, packed) = rest[if is_last { TOTAL } else { 0 }..].split_at(SOUND * keyframes);
        sounds[..keyframes].as_flattened_mut().copy_from_slice(heard);
        if !lips::read(lips, self.mouth, coding, &mut mouth[..mouth_frames * self.mouth]) {
            return Err(PacketError::Malformed("its mouth is not that of its frames"));
        }
        self.unpack(packed, &mut codes[..count * self.codes()])?;
        Ok(PacketHead {
            stream: head[1],
            sequence: u32::from_le_bytes(field(head, 4)),
            sample: u64::from_le_bytes(field(head, 8)),
            root,
            keyframes,
            history,
            total,
            is_prompted: head[0] & PROMPTED != 0,
            mouth_frames,
            mouth_back,
        })
    }

    /// Reads the codes of whole keyframes.
    fn unpack(&self, packed: &[u8], codes: &mut [u16]) -> Result<(), PacketError> {
        let mut at = 0;
        for ((code, &bits), &limit) in codes.iter_mut().zip(self.bits.iter().cycle()).zip(self.limits.iter().cycle()) {
            *code = 0;
            for bit in 0..bits {
                *code |= u16::from(packed[at / 8] >> (at % 8) & 1) << bit;
                at += 1;
            }
            if *code >= limit {
                return Err(PacketError::Malformed("a code is out of range"));
            }
        }
        if packed.last().is_some_and(|last| at % 8 != 0 && last >> (at % 8) != 0) {
            return Err(PacketError::Malformed("bits after the codes are not 0"));
        }
        Ok(())
    }
}

/// Steps of a level byte per factor of ten.
const LEVEL_STEPS: f32 = 50.0;
/// Steps of an arousal byte from 0 to 1.
const AROUSAL_STEPS: f32 = 254.0;

/// Whether a well-formed packet is the last of its stream.
pub(crate) fn is_last(packet: &[u8]) -> bool {
    packet.first().is_some_and(|first| first & LAST != 0)
}

/// Encodes an audio level as a byte: 255 for a root mean square of full scale, 0.4 dB a step, 0 for silence.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
pub fn level_byte(level: f32) -> u8 {
    if level > 0.0 { (255.0 + LEVEL_STEPS * level.logarithm_10()).round().clamp(0.0, 255.0) as u8 } else { 0 }
}

/// Decodes a level byte to the root mean square.
pub fn byte_level(byte: u8) -> f32 {
    if byte == 0 { 0.0 } else { 10.0_f32.power((f32::from(byte) - 255.0) / LEVEL_STEPS) }
}

/// Encodes an arousal of 0 to 1 as a byte, so that an ordinary one is exact: 254 for 1.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
pub fn arousal_byte(arousal: f32) -> u8 {
    (AROUSAL_STEPS * arousal).round().clamp(0.0, AROUSAL_STEPS) as u8
}

/// Decodes an arousal byte.
pub fn byte_arousal(byte: u8) -> f32 {
    (f32::from(byte) / AROUSAL_STEPS).min(1.0)
}

/// Reads `N` bytes at `at`; the caller has checked the length.
fn field<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    *bytes[at..].first_chunk().expect("lengths were checked")
}

#[cfg(test)]
mod tests;
