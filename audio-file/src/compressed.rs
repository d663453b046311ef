//! FLAC, MP3, Ogg Vorbis and AAC, by `symphonia`; Ogg Opus, in `opus`.

use std::io::{Cursor, ErrorKind};

use symphonia::core::codecs::audio::{AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error;
use symphonia::core::formats::probe::Hint;
use symphonia::core::formats::{FormatReader, TrackType};
use symphonia::core::io::MediaSourceStream;
use umo_core::{audio, defect};

use crate::wav::{MAX_CHANNELS, Note, OPUS, SAMPLE_RATES, Wav, WavError};

mod edits;
mod opus;

/// Most samples of a recording: of six hours in stereo at 48 kHz. A few bytes may claim to be many.
const MAX_SAMPLES: usize = 1 << 31;

/// Reads the bytes of a file that starts as, or is named as, the format `name`.
///
/// # Errors
/// [`WavError`] where nothing can be read.
pub(crate) fn parse(name: &'static str, bytes: Vec<u8>) -> Result<Wav, WavError> {
    // Other people's decoders on anybody's bytes: a panic is damage of the file.
    defect::contain_quietly(|| if name == OPUS { opus::decode(bytes) } else { decode(name, bytes) })
        .unwrap_or_else(|defect| Err(WavError::Damaged { name, cause: defect.message().to_owned() }))
}

fn decode(name: &'static str, bytes: Vec<u8>) -> Result<Wav, WavError> {
    let wrong = |error: Error| match error {
        Error::Unsupported(_) => WavError::OtherCodec(name),
        error => WavError::Damaged { name, cause: error.to_string() },
    };
    let edit = edits::of_audio(&bytes);
    let source = MediaSourceStream::new(Box::new(Cursor::new(bytes)), Default::default());
    let mut reader = symphonia::default::get_probe()
        .probe(&Hint::new(), source, Default::default(), Default::default())
        .map_err(|error| WavError::Damaged { name, cause: error.to_string() })?;
    let (mut track, mut decoder, claimed) = select(name, reader.as_ref()).map_err(|failed| failed.or(wrong))?;
    let (mut samples, mut buffer) = (Vec::new(), Vec::<f32>::new());
    let (mut spec, mut lost, mut joined) = (None, 0, false);
    loop {
        let packet = match reader.next_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            // Another stream after the first, of which recordings are joined.
            Err(Error::ResetRequired) => {
                (track, decoder, _) = select(name, reader.as_ref()).map_err(|failed| failed.or(wrong))?;
                joined = true;
                continue;
            }
            Err(Error::IoError(error)) if error.kind() == ErrorKind::UnexpectedEof => break,
            Err(_) => {
                lost += 1;
                break;
            }
        };
        if packet.track_id != track {
            continue;
        }
        let decoded = match decoder.decode(&packet) {
            Ok(decoded) if decoded.frames() == 0 => continue,
            Ok(decoded) => decoded,
            Err(_) => {
                lost += 1;
                continue;
            }
        };
        let rate = decoded.spec().rate();
        let channels = u16::try_from(decoded.num_planes()).unwrap_or(u16::MAX);
        if *spec.get_or_insert((rate, channels)) != (rate, channels) {
            let cause = "its sample rate or its number of channels changes".to_owned();
            return Err(WavError::Damaged { name, cause });
        }
        if !(1..=MAX_CHANNELS).contains(&channels) {
            return Err(WavError::Channels(channels));
        }
        if !SAMPLE_RATES.contains(&rate) {
            return Err(WavError::SampleRate(rate));
        }
        decoded.copy_to_vec_interleaved(&mut buffer);
        if samples.len() + buffer.len() > MAX_SAMPLES {
            return Err(WavError::Long);
        }
        samples.extend_from_slice(&buffer);
    }
    let Some((sample_rate, channels)) = spec else {
        return Err(match lost {
            0 => WavError::Empty,
            _ => WavError::Damaged { name, cause: "none of its audio can be decoded".to_owned() },
        });
    };
    let width = usize::from(channels);
    let mut notes = Vec::new();
    if lost > 0 {
        notes.push(Note::Lost { packets: lost });
    }
    let found = samples.len() / width;
    match claimed.map(|claimed| (claimed, usize::try_from(claimed))) {
        // What an encoder added to fill its last block.
        Some((_, Ok(claimed))) if !joined && claimed <= found && edit.is_some() => samples.truncate(claimed * width),
        Some((claimed, _)) if !joined && claimed > found as u64 => {
            notes.push(Note::Short { claimed, found: found as u64 });
        }
        _ => {}
    }
    if let Some(edit) = edit.filter(|_| !joined) {
        edit.apply(&mut samples, sample_rate, width);
    }
    if samples.is_empty() {
        return Err(WavError::Empty);
    }
    let silenced = audio::silence_unusable(&mut samples);
    if silenced > 0 {
        notes.push(Note::Unusable { samples: silenced });
    }
    Ok(Wav { sample_rate, channels, samples, notes })
}

/// A track, its decoder, and how many frames the file claims that it has.
type Selected = (u32, Box<dyn AudioDecoder>, Option<u64>);

/// The audio track of a file; an error of its own where there is none.
fn select(name: &'static str, reader: &dyn FormatReader) -> Result<Selected, Failed> {
    let track = reader.default_track(TrackType::Audio).ok_or(Failed::Own(WavError::OtherCodec(name)))?;
    let parameters = track.codec_params.as_ref().and_then(|parameters| parameters.audio());
    let parameters = parameters.ok_or(Failed::Own(WavError::OtherCodec(name)))?;
    let decoder = symphonia::default::get_codecs()
        .make_audio_decoder(parameters, &AudioDecoderOptions::default())
        .map_err(Failed::Theirs)?;
    Ok((track.id, decoder, track.num_frames))
}

enum Failed {
    Own(WavError),
    Theirs(Error),
}

impl Failed {
    fn or(self, convert: impl Fn(Error) -> WavError) -> WavError {
        match self {
            Self::Own(error) => error,
            Self::Theirs(error) => convert(error),
        }
    }
}

#[cfg(test)]
mod tests;
