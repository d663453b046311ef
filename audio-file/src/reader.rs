//! Reads a recording of any format in blocks.

use std::path::Path;

use umo_core_base::defect;
use umo_core_base::samples::{self, mix};

use crate::blocks::{Blocks, Spec};
use crate::bytes::Bytes;
use crate::compressed;
use crate::error::{AudioError, Note, ReadError};
use crate::format::{Format, START};
use crate::wav::{Content, Wav};

/// Upper bound on the samples of a recording that is read as a whole: six hours in stereo at 48 kHz. A few bytes may
/// claim any number.
const MAX_SAMPLES: usize = 1 << 31;

/// Reads a recording in blocks, with memory use independent of its length.
pub struct Reader {
    blocks: Box<dyn Blocks>,
    name: &'static str,
    spec: Spec,
    block: Vec<f32>,
    /// The first block has been decoded but not returned yet.
    is_first: bool,
    unusable: u64,
    frames: u64,
}

impl Reader {
    /// Opens a file and decodes its first block. The format is detected from its first bytes, or else from its
    /// extension.
    ///
    /// # Errors
    /// [`ReadError`] naming the path and the cause.
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let io = |cause| ReadError::Io(path.to_owned(), cause);
        let bytes = umo_core_base::file::open(path).and_then(Bytes::of_file).map_err(io)?;
        let start = bytes.peek(0, START).map_err(io)?;
        let format = Format::of_start(&start).or_else(|| Format::of_extension(path));
        Self::new(bytes, format).map_err(|error| ReadError::new(path, error))
    }

    fn new(bytes: Bytes, format: Option<Format>) -> Result<Self, AudioError> {
        let format = format.ok_or(AudioError::NotWav)?;
        if let Format::Other(name) = format {
            return Err(AudioError::OtherFormat(name));
        }
        let blocks = contain(format.name(), || -> Result<Box<dyn Blocks>, AudioError> {
            Ok(match format {
                Format::Wav => match Wav::open(&bytes)? {
                    Content::Samples(wav) => wav,
                    Content::Mpeg(part) => compressed::open(Format::Mpeg, part)?,
                },
                format => compressed::open(format, bytes)?,
            })
        })?;
        let spec = Spec { sample_rate: 0, channels: 0, centre: None };
        let mut reader =
            Self { blocks, name: format.name(), spec, block: Vec::new(), is_first: false, unusable: 0, frames: 0 };
        reader.spec = reader.decode()?.ok_or_else(|| {
            let lost = reader.blocks.notes().iter().any(|note| matches!(note, Note::Lost { .. }));
            let cause = || "no part of its audio can be decoded".to_owned();
            if lost { AudioError::Damaged { name: reader.name, cause: cause() } } else { AudioError::Empty }
        })?;
        reader.is_first = true;
        Ok(reader)
    }

    fn decode(&mut self) -> Result<Option<Spec>, AudioError> {
        let Self { blocks, block, name, .. } = self;
        block.clear();
        let spec = contain(name, || blocks.next(block))?;
        self.unusable += samples::silence_unusable(&mut self.block) as u64;
        Ok(spec)
    }

    /// Returns the next samples, `[frames, channels]`, interleaved; `None` at the end. Full scale is -1..=1; every
    /// sample is finite.
    ///
    /// # Errors
    /// [`AudioError`] if the rest cannot be read.
    pub fn next_block(&mut self) -> Result<Option<&mut [f32]>, AudioError> {
        if !std::mem::take(&mut self.is_first) && self.decode()?.is_none() {
            return Ok(None);
        }
        self.frames += (self.block.len() / self.spec.width()) as u64;
        Ok(Some(&mut self.block))
    }

    /// Samples per second of one channel.
    pub fn sample_rate(&self) -> u32 {
        self.spec.sample_rate
    }

    /// Number of channels, 1..=8.
    pub fn channels(&self) -> u16 {
        self.spec.channels
    }

    /// Index of the centre channel of a surround recording.
    pub fn centre(&self) -> Option<usize> {
        self.spec.centre
    }

    /// Samples of each channel returned so far.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Problems found so far; each is worth one line of warning.
    pub fn notes(&self) -> Vec<Note> {
        let mut notes = self.blocks.notes();
        if self.unusable > 0 {
            notes.push(Note::Unusable { samples: self.unusable });
        }
        notes
    }
}

/// Contains panics of third-party decoders on untrusted bytes: a panic means that the file is damaged.
fn contain<T>(name: &'static str, work: impl FnOnce() -> Result<T, AudioError>) -> Result<T, AudioError> {
    defect::contain_quietly(work)
        .unwrap_or_else(|defect| Err(AudioError::Damaged { name, cause: defect.message().to_owned() }))
}

/// A whole recording.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Samples per second of one channel.
    pub sample_rate: u32,
    /// Number of channels, 1..=8.
    pub channels: u16,
    /// `[frames, channels]`, interleaved. Full scale is -1..=1; every sample is finite.
    pub samples: Vec<f32>,
    /// Problems found; each is worth one line of warning.
    pub notes: Vec<Note>,
}

impl Recording {
    fn new(mut reader: Reader) -> Result<Self, AudioError> {
        let mut samples = Vec::new();
        while let Some(block) = reader.next_block()? {
            if samples.len() + block.len() > MAX_SAMPLES {
                return Err(AudioError::Long);
            }
            samples.extend_from_slice(block);
        }
        Ok(Self { sample_rate: reader.sample_rate(), channels: reader.channels(), samples, notes: reader.notes() })
    }

    /// Averages the channels. `[frames]`.
    pub fn mono(&self) -> Vec<f32> {
        let mut mono = vec![0.0; self.frames()];
        mix(&self.samples, self.channels.into(), &mut mono);
        mono
    }

    /// Number of samples of each channel.
    pub fn frames(&self) -> usize {
        self.samples.len() / usize::from(self.channels)
    }

    /// Duration in seconds.
    pub fn seconds(&self) -> f64 {
        self.frames() as f64 / f64::from(self.sample_rate)
    }
}

/// Reads a whole recording into memory.
///
/// # Errors
/// [`ReadError`] naming the path and the cause.
pub fn read(path: &Path) -> Result<Recording, ReadError> {
    Recording::new(Reader::open(path)?).map_err(|error| ReadError::new(path, error))
}

/// Decodes a whole file from memory.
///
/// # Errors
/// [`AudioError`] if the file cannot be decoded.
pub fn parse(bytes: &[u8]) -> Result<Recording, AudioError> {
    let format = Format::of_start(&bytes[..bytes.len().min(START)]);
    Recording::new(Reader::new(Bytes::of_memory(bytes.to_vec()), format)?)
}
