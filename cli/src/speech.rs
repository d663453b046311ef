//! A recording to animate: a first pass determines its length, level and damage, and a second pass delivers it
//! block by block as needed.

use std::path::{Path, PathBuf};

use umo_audio_file::{ReadError, Reader};
use umo_core::{AudioSource, Resampler, StepError};
use umo_core_base::level::{Gains, Meter};
use umo_core_base::samples::mix;

use crate::failure::Failure;

/// A recording after its first pass.
pub(crate) struct Speech {
    path: PathBuf,
    sample_rate: usize,
    frames: usize,
    gains: Gains,
}

impl Speech {
    /// Reads a recording. Refuses damage, or only warns with `repair`. Prints notes about other peculiarities of
    /// the file and about the level.
    pub(crate) fn open(path: &Path, repair: bool) -> Result<Self, Failure> {
        let mut reader = Reader::open(path).map_err(Failure::input)?;
        let mut meter = Meter::new(reader.channels().into(), reader.sample_rate() as usize);
        while let Some(block) = reader.next_block().map_err(|error| Failure::input(ReadError::new(path, error)))? {
            meter.push(block);
        }
        for note in reader.notes() {
            let problem = format!("{}: {note}", path.display());
            match note.is_damage() {
                true if !repair => {
                    return Err(Failure::Input(format!("{problem} (--repair uses the readable part)")));
                }
                true => eprintln!("warning: {problem}"),
                false => eprintln!("note: {problem}"),
            }
        }
        let gains = meter.gains(reader.centre());
        for finding in &gains.findings {
            eprintln!("note: {}: {finding}", path.display());
        }
        let frames = usize::try_from(reader.frames()).map_err(Failure::input)?;
        Ok(Self { path: path.to_owned(), sample_rate: reader.sample_rate() as usize, frames, gains })
    }

    /// Returns the sample rate in Hz.
    pub(crate) fn sample_rate(&self) -> usize {
        self.sample_rate
    }

    /// Returns the length in seconds.
    pub(crate) fn seconds(&self) -> f64 {
        self.frames as f64 / self.sample_rate as f64
    }

    /// Returns the number of animation frames at `frame_rate`, at least one.
    pub(crate) fn frames(&self, frame_rate: usize) -> Result<usize, Failure> {
        let frames = usize::try_from(self.frames as u128 * frame_rate as u128 / self.sample_rate as u128);
        match frames.map_err(Failure::input)? {
            0 => {
                let milliseconds = 1e3 * self.seconds();
                let problem = format!("{}: {milliseconds:.1} ms of audio is less than one frame", self.path.display());
                Err(Failure::Input(problem))
            }
            frames => Ok(frames),
        }
    }

    /// Returns a source of the recording's samples, mono, at `rate`.
    pub(crate) fn samples(&self, rate: usize) -> Result<Samples, Failure> {
        Ok(Samples {
            reader: Reader::open(&self.path).map_err(Failure::input)?,
            gains: self.gains.clone(),
            resampler: Resampler::new(self.sample_rate, rate)?,
            mono: Vec::new(),
            expected: (self.sample_rate, self.frames),
        })
    }

    /// Reads all samples of every channel, with the level that they have in the file.
    pub(crate) fn channels(&self) -> Result<Vec<Vec<f32>>, Failure> {
        let mut reader = Reader::open(&self.path).map_err(Failure::input)?;
        let mut channels = vec![Vec::new(); reader.channels().into()];
        while let Some(block) =
            reader.next_block().map_err(|error| Failure::input(ReadError::new(&self.path, error)))?
        {
            for frame in block.chunks_exact(channels.len()) {
                channels.iter_mut().zip(frame).for_each(|(channel, sample)| channel.push(*sample));
            }
        }
        Ok(channels)
    }

    /// Reads all samples, mono, at `rate`.
    pub(crate) fn mono(&self, rate: usize) -> Result<Vec<f32>, Failure> {
        let (mut samples, mut all) = (self.samples(rate)?, Vec::new());
        while samples.pull(&mut all)? {}
        Ok(all)
    }
}

/// A source of a recording's samples, decoded on demand.
pub(crate) struct Samples {
    reader: Reader,
    gains: Gains,
    resampler: Resampler,
    mono: Vec<f32>,
    /// Sample rate, and samples per channel, found by the first pass.
    expected: (usize, usize),
}

impl AudioSource for Samples {
    fn pull(&mut self, samples: &mut Vec<f32>) -> Result<bool, StepError> {
        let changed = StepError::Order("the recording was changed while it was read");
        let Self { reader, gains, resampler, mono, expected } = self;
        let channels = usize::from(reader.channels());
        if channels != gains.channels().len() || reader.sample_rate() as usize != expected.0 {
            return Err(changed);
        }
        let Some(block) = reader.next_block().map_err(|_| changed)? else {
            resampler.finish(|piece| samples.extend_from_slice(piece));
            return if reader.frames() == expected.1 as u64 { Ok(false) } else { Err(changed) };
        };
        gains.apply(block);
        mono.clear();
        mono.resize(block.len() / channels, 0.0);
        mix(block, channels, mono);
        resampler.push(mono, |piece| samples.extend_from_slice(piece));
        Ok(true)
    }
}
