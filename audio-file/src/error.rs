//! Notes on problems of files that are readable all the same, and errors for others.

use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use crate::format::READ;
use crate::{MAX_CHANNELS, SAMPLE_RATES};

/// A problem of a file that does not prevent reading.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// Samples that were NaN or above the amplitude limit ([`umo_core_base::samples::MAX_AMPLITUDE`]), replaced by silence.
    Unusable {
        /// Number of samples.
        samples: u64,
    },
    /// The header's audio length differs from the file's.
    Length {
        /// Bytes that the header claims.
        claimed: u64,
        /// Bytes present, which were read.
        found: u64,
    },
    /// Compressed packets that could not be decoded.
    Lost {
        /// Number of packets.
        packets: usize,
    },
    /// The file holds fewer samples than it claims.
    Short {
        /// Samples of each channel that the header claims.
        claimed: u64,
        /// Samples present, which were read.
        found: u64,
    },
    /// The file is truncated.
    Cut,
    /// The edit list reorders parts of the file; all of it was read, in file order.
    Edits,
    /// A chunk of odd length lacks its padding byte.
    Unpadded,
    /// Bytes after the audio that are not chunks were ignored.
    Trailing {
        /// Number of bytes.
        bytes: u64,
    },
}

impl Note {
    /// Whether audio is missing, wrong or at the wrong time; otherwise all of it was read.
    pub fn is_damage(&self) -> bool {
        !matches!(self, Self::Unpadded | Self::Trailing { .. })
    }
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unusable { samples } => write!(f, "{samples} samples are not usable numbers"),
            Self::Length { claimed, found } => {
                write!(f, "the header claims {claimed} bytes of audio, the file holds {found}")
            }
            Self::Lost { packets } => write!(f, "{packets} packets of audio cannot be decoded"),
            Self::Short { claimed, found } => {
                write!(f, "the file claims {claimed} samples of audio and holds {found}")
            }
            Self::Cut => f.write_str("the file is cut: it ends before the end that it claims"),
            Self::Edits => f.write_str("its edit list plays parts out of order, which umo does not follow"),
            Self::Unpadded => f.write_str("a chunk of odd length has no padding byte: read without it"),
            Self::Trailing { bytes } => write!(f, "{bytes} bytes behind the audio are not chunks: left out"),
        }
    }
}

/// Reason why bytes are not a usable recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AudioError {
    /// No known format starts like this.
    NotWav,
    /// A known format that is not supported.
    OtherFormat(&'static str),
    /// The audio precedes its format, or there is no format.
    NoFormat,
    /// The format chunk is inconsistent or truncated.
    BadFormat(&'static str),
    /// An unsupported encoding.
    Encoding {
        /// The format tag.
        tag: u16,
        /// Bits per sample.
        bits: u16,
    },
    /// A sample rate outside [`SAMPLE_RATES`].
    SampleRate(u32),
    /// A channel count outside 1..=[`MAX_CHANNELS`].
    Channels(u16),
    /// No data chunk.
    NoData,
    /// No audio.
    Empty,
    /// A supported format, damaged beyond reading.
    Damaged {
        /// The format.
        name: &'static str,
        /// The cause.
        cause: String,
    },
    /// A supported format with an unsupported codec.
    OtherCodec(&'static str),
    /// More audio than fits in memory.
    Long,
    /// I/O error in the middle of the file.
    Io(String),
}

impl AudioError {
    /// Whether another program can convert the file to a supported format.
    fn is_convertible(&self) -> bool {
        matches!(self, Self::OtherFormat(_) | Self::OtherCodec(_) | Self::Encoding { .. })
    }
}

impl From<io::Error> for AudioError {
    fn from(error: io::Error) -> Self {
        Self::Io(error.to_string())
    }
}

impl fmt::Display for AudioError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotWav => f.write_str("not a WAV file: it does not start with RIFF and WAVE"),
            Self::OtherFormat(name) => write!(f, "it is {name}, and umo reads {READ}"),
            Self::NoFormat => f.write_str("no format chunk before the audio"),
            Self::BadFormat(what) => write!(f, "bad format chunk: {what}"),
            Self::Encoding { tag, bits } => write!(
                f,
                "encoding {tag:#06x} with {bits} bits: expected 8 to 32-bit integers, 32 or 64-bit floats, \
                 A-law, µ-law, MS or IMA ADPCM"
            ),
            Self::SampleRate(rate) => {
                write!(f, "sample rate {rate} Hz: expected {} to {}", SAMPLE_RATES.start(), SAMPLE_RATES.end())
            }
            Self::Channels(count) => write!(f, "{count} channels: expected 1 to {MAX_CHANNELS}"),
            Self::NoData => f.write_str("no data chunk: the file ends before its audio"),
            Self::Empty => f.write_str("the recording is empty: it holds no samples"),
            Self::Damaged { name, cause } => write!(f, "not a whole {name} file: {cause}"),
            Self::OtherCodec(name) => write!(f, "its audio is {name} of a kind that umo does not read"),
            Self::Long => f.write_str("the recording is too long for the memory: it has more than 2^31 samples"),
            Self::Io(cause) => f.write_str(cause),
        }
    }
}

impl std::error::Error for AudioError {}

/// Reason why a file could not be read.
#[derive(Debug)]
pub enum ReadError {
    /// I/O error.
    Io(PathBuf, io::Error),
    /// Invalid or unsupported contents.
    Audio(PathBuf, AudioError),
}

impl ReadError {
    /// An error of the file at `path`.
    pub fn new(path: &Path, error: AudioError) -> Self {
        Self::Audio(path.to_owned(), error)
    }
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(path, cause) if cause.kind() == io::ErrorKind::NotFound => {
                write!(f, "cannot read `{}`: no such file", path.display())
            }
            Self::Io(path, cause) => write!(f, "cannot read `{}`: {cause}", path.display()),
            Self::Audio(path, cause) => {
                write!(f, "cannot read `{}`: {cause}", path.display())?;
                if !cause.is_convertible() {
                    return Ok(());
                }
                // The suggested name must differ if the file already ends in `.wav`.
                let mut to = path.with_extension("wav");
                if to == *path {
                    to.set_extension("pcm.wav");
                }
                write!(f, ": convert it with `ffmpeg -i {} {}`", path.display(), to.display())
            }
        }
    }
}

impl std::error::Error for ReadError {}
