//! WAV files, by `hound` behind a layer that repairs their headers.
//!
//! A header is never trusted about lengths: what the file holds decides what is read, and nothing
//! is allocated from a number in the header. [`parse`] is a pure function of the bytes.

use std::fmt;
use std::io::{self, Read};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use hound::{Sample, SampleFormat, WavReader, WavSpec};
use umo_core::audio::{self, resample::mix};

use crate::compressed;

/// Sample rates that are read, in Hz.
pub const SAMPLE_RATES: RangeInclusive<u32> = 1_000..=768_000;
/// Most channels that are read.
pub const MAX_CHANNELS: u16 = 8;

const TAG_PCM: u16 = 1;
const TAG_FLOAT: u16 = 3;
const TAG_EXTENSIBLE: u16 = 0xFFFE;
/// Frames that `hound` reads at a time: of eight channels of 32 bits, less than 4 GiB.
const PIECE_FRAMES: usize = 1 << 24;
/// The last 14 bytes of a `WAVE_FORMAT_EXTENSIBLE` sub-format whose first two bytes are a plain
/// tag.
const SUBFORMAT_SUFFIX: [u8; 14] = [0, 0, 0, 0, 0x10, 0, 0x80, 0, 0, 0xAA, 0, 0x38, 0x9B, 0x71];

/// The audio of a WAV file. Full scale is -1..=1; every sample is finite.
#[derive(Clone, Debug, PartialEq)]
pub struct Wav {
    /// Samples per second of one channel.
    pub sample_rate: u32,
    /// Number of channels, 1..=8.
    pub channels: u16,
    /// `[frames, channels]`, interleaved.
    pub samples: Vec<f32>,
    /// What was not as it should be; each is worth one line of warning.
    pub notes: Vec<Note>,
}

impl Wav {
    /// Averages the channels. `[frames]`.
    pub fn mono(&self) -> Vec<f32> {
        let mut mono = vec![0.0; self.frames()];
        mix(&self.samples, self.channels.into(), &mut mono);
        mono
    }

    /// Samples of each channel.
    pub fn frames(&self) -> usize {
        self.samples.len() / usize::from(self.channels)
    }

    /// Length in seconds.
    pub fn seconds(&self) -> f64 {
        self.frames() as f64 / f64::from(self.sample_rate)
    }
}

/// Something wrong with a WAV file that does not stop it from being read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Note {
    /// Samples that were no number, or louder than any sound ([`audio::MAX_AMPLITUDE`]), now silence.
    Unusable {
        /// How many.
        samples: usize,
    },
    /// The header's length of the audio is not what the file holds.
    Length {
        /// Bytes that the header claims.
        claimed: u64,
        /// Bytes that are there, which were read.
        found: u64,
    },
    /// Packets of compressed audio that cannot be decoded.
    Lost {
        /// How many.
        packets: usize,
    },
    /// The file holds fewer samples than it claims.
    Short {
        /// Samples of each channel that it claims.
        claimed: u64,
        /// Those that are there, which were read.
        found: u64,
    },
}

impl fmt::Display for Note {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unusable { samples } => {
                write!(f, "{samples} samples are not usable numbers")
            }
            Self::Length { claimed, found } => {
                write!(f, "the header claims {claimed} bytes of audio, the file holds {found}")
            }
            Self::Lost { packets } => write!(f, "{packets} packets of audio cannot be decoded"),
            Self::Short { claimed, found } => {
                write!(f, "the file claims {claimed} samples of audio and holds {found}")
            }
        }
    }
}

/// Why bytes are not a usable WAV file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum WavError {
    /// No `RIFF….WAVE` at the start.
    NotWav,
    /// The start of another audio format, which is named.
    OtherFormat(&'static str),
    /// The audio comes before its format, or there is no format.
    NoFormat,
    /// The format chunk contradicts itself or is cut.
    BadFormat(&'static str),
    /// An encoding that is not read.
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
    /// A data chunk without one whole frame.
    Empty,
    /// What `hound` says of audio that passed every check here.
    Unread(String),
    /// A format that is read, damaged beyond reading.
    Damaged {
        /// The format.
        name: &'static str,
        /// What is wrong.
        cause: String,
    },
    /// A format that is read, with a codec that is not.
    OtherCodec(&'static str),
    /// More audio than is read.
    Long,
}

impl fmt::Display for WavError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotWav => f.write_str("not a WAV file: it does not start with RIFF and WAVE"),
            Self::OtherFormat(name) => write!(f, "it is {name}, and umo reads {READ}: convert it first"),
            Self::NoFormat => f.write_str("no format chunk before the audio"),
            Self::BadFormat(what) => write!(f, "bad format chunk: {what}"),
            Self::Encoding { tag, bits } => {
                write!(f, "encoding {tag:#06x} with {bits} bits: expected 8 to 32-bit integers, or 32 or 64-bit floats")
            }
            Self::SampleRate(rate) => {
                write!(f, "sample rate {rate} Hz: expected {} to {}", SAMPLE_RATES.start(), SAMPLE_RATES.end())
            }
            Self::Channels(count) => {
                write!(f, "{count} channels: expected 1 to {MAX_CHANNELS}")
            }
            Self::NoData => f.write_str("no data chunk: the file ends before its audio"),
            Self::Empty => f.write_str("the recording is empty: it holds no samples"),
            Self::Unread(cause) => write!(f, "its audio cannot be read: {cause}"),
            Self::Damaged { name, cause } => write!(f, "not a whole {name} file: {cause}"),
            Self::OtherCodec(name) => {
                write!(f, "its audio is {name} of a kind that umo does not read: convert it first")
            }
            Self::Long => f.write_str("the recording is too long: it has more than 2^31 samples"),
        }
    }
}

impl std::error::Error for WavError {}

/// Why a WAV file could not be read.
#[derive(Debug)]
pub enum ReadError {
    /// The file system's answer.
    Io(PathBuf, io::Error),
    /// The file's contents.
    Wav(PathBuf, WavError),
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Io(path, cause) if cause.kind() == io::ErrorKind::NotFound => {
                write!(f, "cannot read `{}`: no such file", path.display())
            }
            Self::Io(path, cause) => write!(f, "cannot read `{}`: {cause}", path.display()),
            Self::Wav(path, cause @ (WavError::OtherFormat(_) | WavError::OtherCodec(_))) => {
                let (from, to) = (path.display(), path.with_extension("wav"));
                let cause = cause.to_string();
                let cause = cause.trim_end_matches(": convert it first");
                write!(f, "cannot read `{from}`: {cause}: convert it with `ffmpeg -i {from} {}`", to.display())
            }
            Self::Wav(path, cause) => write!(f, "cannot read `{}`: {cause}", path.display()),
        }
    }
}

impl std::error::Error for ReadError {}

/// Formats that are read.
const READ: &str = "WAV, FLAC, MP3, Ogg Vorbis, Ogg Opus and AAC";

/// Reads a recording: WAV, FLAC, MP3, Ogg Vorbis or Opus, or AAC, plain or in MPEG-4 (`.m4a`).
///
/// # Errors
/// [`ReadError`] naming the path and the cause.
pub fn read(path: &Path) -> Result<Wav, ReadError> {
    let io = |cause| ReadError::Io(path.to_owned(), cause);
    let wav = |cause| ReadError::Wav(path.to_owned(), cause);
    let mut file = umo_core::file::open(path).map_err(io)?;
    // The start alone first: a huge file that is no recording must not fill the memory.
    let mut bytes = Vec::new();
    file.by_ref().take(64).read_to_end(&mut bytes).map_err(io)?;
    let other = match check_start(&bytes) {
        Ok(()) => None,
        Err(WavError::OtherFormat(name)) => Some(name),
        Err(error) => Some(named_by_extension(path).ok_or(error).map_err(wav)?),
    };
    if let Some(name) = other.filter(|name| !COMPRESSED.contains(name)) {
        return Err(wav(WavError::OtherFormat(name)));
    }
    file.read_to_end(&mut bytes).map_err(io)?;
    match other {
        None => parse(&bytes),
        Some(name) => compressed::parse(name, bytes),
    }
    .map_err(wav)
}

/// Reads a WAV file's bytes.
///
/// A data chunk that claims more than is there, or leaves its length open (0 or all ones, as
/// programs do that write to a pipe), is read to the end of the bytes and noted. A last frame that
/// is cut is dropped.
///
/// # Errors
/// [`WavError`] where nothing can be read.
pub fn parse(bytes: &[u8]) -> Result<Wav, WavError> {
    check_start(bytes)?;
    let (format, data, length) = find_audio(bytes)?;
    let frame = format.encoding.bytes() * usize::from(format.channels);
    let data = &data[..data.len() / frame * frame];
    if data.is_empty() {
        return Err(WavError::Empty);
    }
    let mut samples = format.decode(data)?;
    let mut notes: Vec<Note> = length.into_iter().collect();
    let silenced = audio::silence_unusable(&mut samples);
    if silenced > 0 {
        notes.push(Note::Unusable { samples: silenced });
    }
    Ok(Wav { sample_rate: format.sample_rate, channels: format.channels, samples, notes })
}

fn check_start(bytes: &[u8]) -> Result<(), WavError> {
    let form = bytes.get(..4).ok_or(WavError::NotWav)?;
    let kind = bytes.get(8..12).ok_or(WavError::NotWav)?;
    if matches!(form, b"RIFF" | b"RF64" | b"BW64") && kind == b"WAVE" {
        return Ok(());
    }
    Err(other_format(bytes).map_or(WavError::NotWav, WavError::OtherFormat))
}

const FLAC: &str = "FLAC";
const OGG: &str = "Ogg";
const MP3: &str = "MP3";
const AAC: &str = "AAC";
const MPEG_4: &str = "MPEG-4 audio";
pub(crate) const OPUS: &str = "Ogg Opus";
const AIFF: &str = "AIFF";
const CAF: &str = "Core Audio (CAF)";
const MATROSKA: &str = "WebM or Matroska";
/// What `compressed` reads.
const COMPRESSED: [&str; 6] = [FLAC, OGG, OPUS, MP3, AAC, MPEG_4];

/// The audio format, not WAV, that a file starts as.
fn other_format(start: &[u8]) -> Option<&'static str> {
    Some(match start {
        [b'f', b'L', b'a', b'C', ..] => FLAC,
        // A page's first packet names its codec.
        [b'O', b'g', b'g', b'S', rest @ ..] if rest.get(24..32) == Some(b"OpusHead") => OPUS,
        [b'O', b'g', b'g', b'S', ..] => OGG,
        [b'I', b'D', b'3', ..] => MP3,
        // An MPEG audio frame without tags: eleven bits of synchronisation and a layer that there
        // is; AAC's layer is 0.
        [0xFF, second, ..] if second & 0xE0 == 0xE0 && second & 0x06 != 0 => MP3,
        [0xFF, second, ..] if second & 0xF6 == 0xF0 => AAC,
        [_, _, _, _, b'f', b't', b'y', b'p', ..] => MPEG_4,
        [b'F', b'O', b'R', b'M', _, _, _, _, b'A', b'I', b'F', b'F' | b'C', ..] => AIFF,
        [b'c', b'a', b'f', b'f', ..] => CAF,
        [0x1A, 0x45, 0xDF, 0xA3, ..] => MATROSKA,
        [b'#', b'!', b'A', b'M', b'R', ..] => "AMR",
        [b'.', b's', b'n', b'd', ..] => "AU",
        _ => return None,
    })
}

/// What a file's extension says that it is, where its start does not.
fn named_by_extension(path: &Path) -> Option<&'static str> {
    let extension = path.extension()?.to_str()?.to_ascii_lowercase();
    Some(match extension.as_str() {
        "flac" => FLAC,
        "mp3" => MP3,
        "ogg" | "oga" => OGG,
        "opus" => OPUS,
        "m4a" | "mp4" | "alac" => MPEG_4,
        "aac" => AAC,
        "aif" | "aiff" | "aifc" => AIFF,
        "caf" => CAF,
        "webm" | "mkv" => MATROSKA,
        "wma" => "Windows Media Audio",
        _ => return None,
    })
}

/// Walks the chunks to the format and the audio's bytes, with a note where their length is not as
/// claimed.
fn find_audio(bytes: &[u8]) -> Result<(Format, &[u8], Option<Note>), WavError> {
    let mut format = None;
    let mut long_size = None;
    let mut empty = false;
    let mut rest = &bytes[12..];
    while let Some((id, size, body)) = split_chunk(rest) {
        let whole = usize::try_from(size).map_or(body, |size| &body[..size.min(body.len())]);
        match &id {
            b"fmt " => format = Some(Format::parse(whole)?),
            // RF64 keeps the sizes that do not fit 32 bits here: the file's, then the data chunk's.
            b"ds64" => long_size = whole.get(8..16).map(|at| u64::from_le_bytes(array(at))),
            b"data" => {
                let format = format.ok_or(WavError::NoFormat)?;
                let claimed = match long_size {
                    Some(long) if size == u32::MAX => long,
                    _ => u64::from(size),
                };
                if claimed == 0 && is_chunk_list(body) {
                    empty = true;
                } else {
                    let (data, note) = audio_bytes(body, claimed);
                    return Ok((format, data, note));
                }
            }
            _ => {}
        }
        rest = after(body, size);
    }
    Err(match (format, empty) {
        (Some(_), true) => WavError::Empty,
        (Some(_), false) => WavError::NoData,
        (None, _) => WavError::NoFormat,
    })
}

/// Lengths from here on are those of programs that write to a pipe and cannot know: some of them
/// write 2^31 - 1 rounded down, others 2^32 - 1.
const OPEN_LENGTH: u64 = 0x7FFF_0000;

/// The claimed part of what follows a data chunk's header, or all of it where the length was left
/// open or is a lie.
fn audio_bytes(body: &[u8], claimed: u64) -> (&[u8], Option<Note>) {
    match usize::try_from(claimed) {
        Ok(size) if size > 0 && size <= body.len() => (&body[..size], None),
        _ if claimed == 0 || claimed >= OPEN_LENGTH => (body, None),
        _ => {
            let found = body.len() as u64;
            (body, Some(Note::Length { claimed, found }))
        }
    }
}

/// Splits a chunk's header off: its name, its claimed size and everything after the header.
fn split_chunk(bytes: &[u8]) -> Option<([u8; 4], u32, &[u8])> {
    let (header, body) = bytes.split_first_chunk::<8>()?;
    let [a, b, c, d, size @ ..] = *header;
    Some(([a, b, c, d], u32::from_le_bytes(size), body))
}

/// What follows a chunk of `size` bytes and its padding to an even length.
fn after(body: &[u8], size: u32) -> &[u8] {
    let next = u64::from(size) + u64::from(size & 1);
    usize::try_from(next).ok().and_then(|next| body.get(next..)).unwrap_or_default()
}

/// Whether the bytes are nothing but whole, plainly named chunks: what follows an honestly empty
/// data chunk, where audio of unknown length would not look so.
fn is_chunk_list(mut bytes: &[u8]) -> bool {
    while let Some((id, size, body)) = split_chunk(bytes) {
        let named = id.iter().all(|c| c.is_ascii_graphic() || *c == b' ');
        if !named || u64::from(size) > body.len() as u64 {
            return false;
        }
        bytes = after(body, size);
    }
    bytes.is_empty()
}

/// What the format chunk says.
#[derive(Clone, Copy)]
struct Format {
    channels: u16,
    sample_rate: u32,
    encoding: Encoding,
}

impl Format {
    fn parse(chunk: &[u8]) -> Result<Self, WavError> {
        let short = WavError::BadFormat("it is shorter than 16 bytes");
        let fixed = chunk.first_chunk::<16>().ok_or(short)?;
        let word = |at: usize| u16::from_le_bytes([fixed[at], fixed[at + 1]]);
        let (channels, block, bits) = (word(2), word(12), word(14));
        let sample_rate = u32::from_le_bytes(array(&fixed[4..8]));
        let tag = match word(0) {
            TAG_EXTENSIBLE => extensible_tag(chunk)?,
            tag => tag,
        };
        if !(1..=MAX_CHANNELS).contains(&channels) {
            return Err(WavError::Channels(channels));
        }
        if !SAMPLE_RATES.contains(&sample_rate) {
            return Err(WavError::SampleRate(sample_rate));
        }
        if block == 0 || block % channels != 0 {
            return Err(WavError::BadFormat("its frame size is not a multiple of its channels"));
        }
        let encoding = Encoding::choose(tag, bits, block / channels)?;
        Ok(Self { channels, sample_rate, encoding })
    }
}

fn extensible_tag(chunk: &[u8]) -> Result<u16, WavError> {
    let short = WavError::BadFormat("its extension is cut");
    let guid = chunk.get(24..40).ok_or(short)?;
    let tag = u16::from_le_bytes([guid[0], guid[1]]);
    if guid[2..] == SUBFORMAT_SUFFIX { Ok(tag) } else { Err(WavError::BadFormat("its sub-format is not known")) }
}

/// How one sample is stored, little-endian.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Encoding {
    /// Integers of 8, 16, 24 or 32 bits in as many.
    Int(u16),
    /// 24 bits in the low three of four bytes.
    Int24In32,
    /// Floats of 32 bits.
    F32,
    /// Floats of 64 bits, which `hound` does not read.
    F64,
}

impl Encoding {
    /// Integers of odd widths sit at the top of their container, so the container sets the scale.
    fn choose(tag: u16, bits: u16, container: u16) -> Result<Self, WavError> {
        match (tag, bits, container) {
            (TAG_PCM, 1..=8, 1) | (TAG_PCM, 9..=16, 2) | (TAG_PCM, 17..=24, 3) | (TAG_PCM, 25..=32, 4) => {
                Ok(Self::Int(8 * container))
            }
            (TAG_PCM, 24, 4) => Ok(Self::Int24In32),
            (TAG_FLOAT, 32, 4) => Ok(Self::F32),
            (TAG_FLOAT, 64, 8) => Ok(Self::F64),
            (TAG_PCM, 1..=32, _) | (TAG_FLOAT, 32 | 64, _) => {
                Err(WavError::BadFormat("its frame size does not fit its bits per sample"))
            }
            _ => Err(WavError::Encoding { tag, bits }),
        }
    }

    /// Bytes of one sample.
    fn bytes(self) -> usize {
        match self {
            Self::Int(bits) => usize::from(bits / 8),
            Self::Int24In32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

impl Format {
    /// Samples of whole frames.
    fn decode(self, data: &[u8]) -> Result<Vec<f32>, WavError> {
        match self.encoding {
            Encoding::Int(bits) => {
                let full_scale = (1_u64 << (bits - 1)) as f32;
                self.by_hound(data, bits, SampleFormat::Int, |x: i32| x as f32 / full_scale)
            }
            // As 32 bits, of which the highest eight may be anything.
            Encoding::Int24In32 => {
                self.by_hound(data, 32, SampleFormat::Int, |x: i32| (x << 8) as f32 / 2_147_483_648.0)
            }
            Encoding::F32 => self.by_hound(data, 32, SampleFormat::Float, |x: f32| x),
            Encoding::F64 => Ok(data.as_chunks().0.iter().map(|&bytes| narrow(f64::from_le_bytes(bytes))).collect()),
        }
    }

    /// Samples of whole frames, read by `hound` behind a header that is right: it refuses what is
    /// not, and some headers that are.
    fn by_hound<S: Sample>(
        self,
        data: &[u8],
        bits_per_sample: u16,
        sample_format: SampleFormat,
        convert: impl Fn(S) -> f32,
    ) -> Result<Vec<f32>, WavError> {
        let spec = WavSpec { channels: self.channels, sample_rate: self.sample_rate, bits_per_sample, sample_format };
        let mut header = spec.into_header_for_infinite_file();
        let length_at = header.len() - 4;
        let mut samples = Vec::with_capacity(data.len() / self.encoding.bytes());
        // A header's length has 32 bits, RF64's audio may be longer.
        for piece in data.chunks(PIECE_FRAMES * usize::from(self.channels) * self.encoding.bytes()) {
            let length = u32::try_from(piece.len()).expect("a piece is shorter than 4 GiB");
            header[length_at..].copy_from_slice(&length.to_le_bytes());
            let reader = WavReader::new(header.chain(piece)).map_err(|error| unread(&error))?;
            for sample in reader.into_samples() {
                samples.push(convert(sample.map_err(|error| unread(&error))?));
            }
        }
        Ok(samples)
    }
}

/// `hound`'s error, which a header of its own and whole frames do not give.
fn unread(error: &hound::Error) -> WavError {
    WavError::Unread(error.to_string())
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "samples are f32; a value outside its range becomes infinite and is then silenced"
)]
fn narrow(x: f64) -> f32 {
    x as f32
}

fn array<const N: usize>(bytes: &[u8]) -> [u8; N] {
    bytes.try_into().expect("the caller slices exactly N bytes")
}

#[cfg(test)]
mod tests;
