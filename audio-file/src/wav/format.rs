//! The format chunk of a WAV file.

use symphonia::core::audio::Channels;
use symphonia::core::codecs::audio::well_known::{
    CODEC_ID_ADPCM_IMA_WAV, CODEC_ID_ADPCM_MS, CODEC_ID_PCM_ALAW, CODEC_ID_PCM_F32BE, CODEC_ID_PCM_F32LE,
    CODEC_ID_PCM_F64BE, CODEC_ID_PCM_F64LE, CODEC_ID_PCM_MULAW, CODEC_ID_PCM_S16BE, CODEC_ID_PCM_S16LE,
    CODEC_ID_PCM_S24BE, CODEC_ID_PCM_S24LE, CODEC_ID_PCM_S32BE, CODEC_ID_PCM_S32LE, CODEC_ID_PCM_U8,
};
use symphonia::core::codecs::audio::{AudioCodecId, AudioCodecParameters};

use super::PIECE;
use crate::blocks::Spec;
use crate::error::AudioError;

const TAG_PCM: u16 = 1;
const TAG_MS_ADPCM: u16 = 2;
const TAG_FLOAT: u16 = 3;
const TAG_A_LAW: u16 = 6;
const TAG_MU_LAW: u16 = 7;
const TAG_IMA_ADPCM: u16 = 0x11;
const TAG_MPEG: u16 = 0x50;
const TAG_MP3: u16 = 0x55;
const TAG_EXTENSIBLE: u16 = 0xFFFE;
/// The last 14 bytes of a `WAVE_FORMAT_EXTENSIBLE` sub-format whose first two bytes are a plain format tag.
const SUBFORMAT_SUFFIX: [u8; 14] = [0, 0, 0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71];
/// Bit of the centre speaker in a channel mask.
const CENTRE: u32 = 4;

/// The content of a format chunk.
#[derive(Clone, Copy)]
pub(super) struct Format {
    pub(super) spec: Spec,
    pub(super) encoding: Encoding,
}

impl Format {
    /// Parses a chunk; RIFX is big-endian.
    ///
    /// # Errors
    /// [`AudioError`] if the chunk is truncated, inconsistent, or of an unsupported encoding.
    pub(super) fn parse(chunk: &[u8], is_big: bool) -> Result<Self, AudioError> {
        let word = |at: usize| {
            let bytes = chunk.get(at..at + 2).map_or([0; 2], |bytes| [bytes[0], bytes[1]]);
            if is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
        };
        let long = |at: usize| {
            let (low, high) = if is_big { (word(at + 2), word(at)) } else { (word(at), word(at + 2)) };
            u32::from(high) << 16 | u32::from(low)
        };
        if chunk.len() < 16 {
            return Err(AudioError::BadFormat("it is shorter than 16 bytes"));
        }
        let (channels, block, bits) = (word(2), word(12), word(14));
        let (tag, mask) = match word(0) {
            TAG_EXTENSIBLE => (extensible_tag(chunk, word(24))?, Some(long(20)).filter(|&mask| mask > 0)),
            tag => (tag, None),
        };
        // Without a mask, five or more channels are in the order of a mask.
        let mask = mask.unwrap_or(if channels >= 5 { 0x3F } else { 0 });
        let centre = (mask & CENTRE > 0).then(|| (mask & (CENTRE - 1)).count_ones() as usize);
        let spec = Spec::new(long(4), channels.into(), centre)?;
        if block == 0 || block % channels != 0 {
            return Err(AudioError::BadFormat("its frame size is not a multiple of its channels"));
        }
        let encoding = Encoding::choose((tag, bits), block, channels, is_big)?;
        Ok(Self { spec, encoding })
    }

    /// Parameters of the `symphonia` decoder.
    pub(super) fn parameters(&self) -> AudioCodecParameters {
        let (codec, frames) = match self.encoding {
            Encoding::Samples { codec, .. } => (codec, 1),
            Encoding::Int24In32 { is_big } => (if is_big { CODEC_ID_PCM_S32BE } else { CODEC_ID_PCM_S32LE }, 1),
            Encoding::Adpcm { codec, frames, .. } => (codec, frames),
            Encoding::Mpeg => unreachable!("read as a separate file"),
        };
        let mut parameters = AudioCodecParameters::new();
        parameters
            .for_codec(codec)
            .with_sample_rate(self.spec.sample_rate)
            .with_channels(Channels::Discrete(self.spec.channels))
            .with_max_frames_per_packet(PIECE.max(frames) as u64 * 2)
            .with_frames_per_block(frames as u64);
        parameters
    }
}

fn extensible_tag(chunk: &[u8], tag: u16) -> Result<u16, AudioError> {
    let suffix = chunk.get(26..40).ok_or(AudioError::BadFormat("its extension is cut"))?;
    if suffix == SUBFORMAT_SUFFIX { Ok(tag) } else { Err(AudioError::BadFormat("its sub-format is not known")) }
}

/// Storage format of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Individual samples of `bytes` each.
    Samples { codec: AudioCodecId, bytes: usize },
    /// 24 bits in the low three of four bytes.
    Int24In32 { is_big: bool },
    /// Blocks of `bytes` for all channels, with `frames` samples of each.
    Adpcm { codec: AudioCodecId, bytes: usize, frames: usize },
    /// MP3.
    Mpeg,
}

impl Encoding {
    /// Integers of odd widths are left-aligned in their container, so the container sets the scale.
    fn choose((tag, bits): (u16, u16), block: u16, channels: u16, is_big: bool) -> Result<Self, AudioError> {
        let container = block / channels;
        let samples = |little, big, bytes| Ok(Self::Samples { codec: if is_big { big } else { little }, bytes });
        match (tag, bits, container) {
            (TAG_PCM, 1..=8, 1) => samples(CODEC_ID_PCM_U8, CODEC_ID_PCM_U8, 1),
            (TAG_PCM, 9..=16, 2) => samples(CODEC_ID_PCM_S16LE, CODEC_ID_PCM_S16BE, 2),
            (TAG_PCM, 17..=24, 3) => samples(CODEC_ID_PCM_S24LE, CODEC_ID_PCM_S24BE, 3),
            (TAG_PCM, 24, 4) => Ok(Self::Int24In32 { is_big }),
            (TAG_PCM, 25..=32, 4) => samples(CODEC_ID_PCM_S32LE, CODEC_ID_PCM_S32BE, 4),
            (TAG_FLOAT, 32, 4) => samples(CODEC_ID_PCM_F32LE, CODEC_ID_PCM_F32BE, 4),
            (TAG_FLOAT, 64, 8) => samples(CODEC_ID_PCM_F64LE, CODEC_ID_PCM_F64BE, 8),
            (TAG_A_LAW, _, 1) => samples(CODEC_ID_PCM_ALAW, CODEC_ID_PCM_ALAW, 1),
            (TAG_MU_LAW, _, 1) => samples(CODEC_ID_PCM_MULAW, CODEC_ID_PCM_MULAW, 1),
            (TAG_MS_ADPCM, 4, 8..) if channels <= 2 => {
                let frames = usize::from(container - 7) * 2 + 2;
                Ok(Self::Adpcm { codec: CODEC_ID_ADPCM_MS, bytes: block.into(), frames })
            }
            (TAG_IMA_ADPCM, 4, 8..) if channels <= 2 && container.is_multiple_of(4) => {
                let frames = usize::from(container - 4) * 2 + 1;
                Ok(Self::Adpcm { codec: CODEC_ID_ADPCM_IMA_WAV, bytes: block.into(), frames })
            }
            (TAG_MPEG | TAG_MP3, ..) => Ok(Self::Mpeg),
            (TAG_PCM, 1..=32, _)
            | (TAG_FLOAT, 32 | 64, _)
            | (TAG_A_LAW | TAG_MU_LAW, ..)
            | (TAG_MS_ADPCM | TAG_IMA_ADPCM, 4, _) => {
                Err(AudioError::BadFormat("its frame size does not fit its bits per sample"))
            }
            _ => Err(AudioError::Encoding { tag, bits }),
        }
    }

    /// Whether the last block may hold more samples than the recording.
    pub(super) fn is_padded(self) -> bool {
        matches!(self, Self::Adpcm { .. })
    }

    /// Size of a frame or block in bytes.
    pub(super) fn unit(self, channels: usize) -> usize {
        match self {
            Self::Samples { bytes, .. } => bytes * channels,
            Self::Int24In32 { .. } => 4 * channels,
            Self::Adpcm { bytes, .. } => bytes,
            Self::Mpeg => 1,
        }
    }

    /// Minimum number of bytes that hold a frame.
    pub(super) fn least(self, channels: usize) -> usize {
        if self.is_padded() { 8 * channels } else { self.unit(channels) }
    }

    /// Number of samples of each channel in `count` bytes, including those of a truncated block.
    pub(super) fn frames(self, count: usize, channels: usize) -> usize {
        let unit = self.unit(channels);
        match self {
            Self::Adpcm { frames, bytes, .. } => {
                let rest = count % unit;
                let left = (bytes - rest) / channels * 2;
                count / unit * frames + if rest < 8 * channels { 0 } else { frames.saturating_sub(left) }
            }
            _ => count / unit,
        }
    }

    /// Prepares samples for the decoder.
    pub(super) fn prepare(self, piece: &mut [u8]) {
        // The fourth byte is undefined.
        let Self::Int24In32 { is_big } = self else { return };
        for sample in piece.as_chunks_mut::<4>().0 {
            let [a, b, c, d] = *sample;
            *sample = if is_big { [b, c, d, 0] } else { [0, a, b, c] };
        }
    }
}
