//! Format detection, by the first bytes of a file or else by its name.

use std::path::Path;

/// Bytes of a file's start that are inspected.
pub(crate) const START: usize = 512;

/// A file format.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    /// WAV, RF64, RIFX and Wave64.
    Wav,
    Flac,
    /// MP3, and layers 1 and 2.
    Mpeg,
    /// AAC without a container.
    Adts,
    Ogg,
    OggOpus,
    Mpeg4,
    Aiff,
    Caf,
    Matroska,
    /// A known but unsupported format.
    Other(&'static str),
}

/// Supported formats.
pub(crate) const READ: &str =
    "WAV, Wave64, AIFF, CAF, FLAC, MP3, Ogg Vorbis and Opus, AAC and ALAC (M4A), WebM and Matroska";

/// The first 16 bytes of Wave64: the identifier of its RIFF chunk.
const W64: [u8; 16] = *b"riff\x2e\x91\xcf\x11\xa5\xd6\x28\xdb\x04\xc1\x00\x00";

/// Extensions of supported files.
const EXTENSIONS: [&str; 22] = [
    "wav", "wave", "w64", "rf64", "bwf", "aif", "aiff", "aifc", "caf", "flac", "mp3", "mp2", "ogg", "oga", "opus",
    "m4a", "mp4", "alac", "aac", "webm", "mkv", "mka",
];

/// Whether a path has the extension of a supported file.
pub fn has_extension(path: &Path) -> bool {
    path.extension().is_some_and(|end| EXTENSIONS.iter().any(|known| end.eq_ignore_ascii_case(known)))
}

impl Format {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Wav => "WAV",
            Self::Flac => "FLAC",
            Self::Mpeg => "MP3",
            Self::Adts => "AAC",
            Self::Ogg => "Ogg",
            Self::OggOpus => "Ogg Opus",
            Self::Mpeg4 => "MPEG-4 audio",
            Self::Aiff => "AIFF",
            Self::Caf => "Core Audio (CAF)",
            Self::Matroska => "WebM or Matroska",
            Self::Other(name) => name,
        }
    }

    /// Whether this is a stream without a container, which tags may precede.
    pub(crate) fn is_bare(self) -> bool {
        matches!(self, Self::Flac | Self::Mpeg | Self::Adts)
    }

    /// Detects the format from the start of a file.
    pub(crate) fn of_start(start: &[u8]) -> Option<Self> {
        if start.starts_with(&W64) {
            return Some(Self::Wav);
        }
        // Transport stream: packets of 188 bytes, or of 192 with a timestamp before each.
        let is_transport = |at: usize, by: usize| [at, at + by].iter().all(|&at| start.get(at) == Some(&0x47));
        Some(match start {
            [b'R', b'I', b'F', b'F' | b'X', _, _, _, _, b'W', b'A', b'V', b'E', ..] => Self::Wav,
            [b'R', b'F', b'6', b'4', _, _, _, _, b'W', b'A', b'V', b'E', ..] => Self::Wav,
            [b'B', b'W', b'6', b'4', _, _, _, _, b'W', b'A', b'V', b'E', ..] => Self::Wav,
            [b'R', b'I', b'F', b'F', _, _, _, _, b'A', b'V', b'I', b' ', ..] => Self::Other("AVI"),
            [b'f', b'L', b'a', b'C', ..] => Self::Flac,
            // The first packet of a page identifies the codec.
            [b'O', b'g', b'g', b'S', rest @ ..] if rest.get(24..32) == Some(b"OpusHead") => Self::OggOpus,
            [b'O', b'g', b'g', b'S', rest @ ..] if rest.get(24..32) == Some(b"Speex   ") => Self::Other("Speex"),
            [b'O', b'g', b'g', b'S', ..] => Self::Ogg,
            [b'I', b'D', b'3', ..] => Self::Mpeg,
            // An MPEG audio frame without tags: eleven sync bits and a valid layer. AAC's layer is 0.
            [0xFF, second, ..] if second & 0xE0 == 0xE0 && second & 0x06 != 0 => Self::Mpeg,
            [0xFF, second, ..] if second & 0xF6 == 0xF0 => Self::Adts,
            [_, _, _, _, b'f', b't', b'y', b'p', ..] => Self::Mpeg4,
            [b'F', b'O', b'R', b'M', _, _, _, _, b'A', b'I', b'F', b'F' | b'C', ..] => Self::Aiff,
            [b'c', b'a', b'f', b'f', ..] => Self::Caf,
            [0x1A, 0x45, 0xDF, 0xA3, ..] => Self::Matroska,
            [0x30, 0x26, 0xB2, 0x75, ..] => Self::Other("Windows Media Audio"),
            [b'#', b'!', b'A', b'M', b'R', ..] => Self::Other("AMR"),
            [b'.', b's', b'n', b'd', ..] => Self::Other("AU"),
            _ if is_transport(0, 188) || is_transport(4, 192) => Self::Other("MPEG-TS"),
            _ => return None,
        })
    }

    /// Guesses the format from a file's extension.
    pub(crate) fn of_extension(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "flac" => Self::Flac,
            "mp3" | "mp2" => Self::Mpeg,
            "ogg" | "oga" => Self::Ogg,
            "opus" => Self::OggOpus,
            "m4a" | "mp4" | "alac" => Self::Mpeg4,
            "aac" => Self::Adts,
            "aif" | "aiff" | "aifc" => Self::Aiff,
            "caf" => Self::Caf,
            "webm" | "mkv" | "mka" => Self::Matroska,
            "wma" => Self::Other("Windows Media Audio"),
            "spx" => Self::Other("Speex"),
            "ts" | "m2ts" => Self::Other("MPEG-TS"),
            _ => return None,
        })
    }
}
