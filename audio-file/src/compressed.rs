//! Formats other than WAV: containers by `symphonia`, codecs by `symphonia` and, for Opus, `ropus`; Ogg Opus in
//! `opus`.

use std::io::ErrorKind;

use symphonia::core::audio::{Channels, Position};
use symphonia::core::codecs::audio::well_known::CODEC_ID_OPUS;
use symphonia::core::codecs::audio::{AudioCodecParameters, AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error;
use symphonia::core::formats::probe::Hint;
use symphonia::core::formats::{FormatReader, Track, TrackType};
use symphonia::core::io::MediaSourceStream;
use symphonia::core::packet::Packet;
use symphonia::core::units::{Duration, TimeBase};

use crate::blocks::{Blocks, Spec};
use crate::bytes::Bytes;
use crate::error::{AudioError, Note};
use crate::format::{Format, START};
use edits::{Edits, List};
use opus::{Head, OggOpus, Packets};

mod edits;
mod opus;
mod parts;

/// Upper bound on the packets that encoders add after the end that a file claims; more of them are another recording
/// that follows.
const MOST_ADDED: usize = 3;
/// Upper bound on the size of an MPEG-4 index whose edit list is read.
const MOST_INDEX: u64 = 256 << 20;

/// Opens the decoder of a format.
///
/// # Errors
/// [`AudioError`] if the file cannot be decoded.
pub(crate) fn open(format: Format, bytes: Bytes) -> Result<Box<dyn Blocks>, AudioError> {
    if format == Format::OggOpus {
        return Ok(Box::new(OggOpus::new(bytes)));
    }
    // A tag may precede other formats than MP3.
    let (format, bytes) = match format {
        Format::Mpeg => {
            let bytes = bytes.part(parts::tags(&bytes)?..bytes.len());
            if bytes.len() == 0 {
                let cause = "it ends after its tag, before any audio".to_owned();
                return Err(AudioError::Damaged { name: format.name(), cause });
            }
            (Format::of_start(&bytes.peek(0, START)?).filter(|found| found.is_bare()).unwrap_or(format), bytes)
        }
        format => (format, bytes),
    };
    let list = if format == Format::Mpeg4 { edit_list(&bytes)? } else { None };
    let mut decoder = Compressed {
        format,
        rest: bytes,
        list,
        file: None,
        spec: None,
        decoded: Vec::new(),
        lost: 0,
        counts: Counts::default(),
        is_cut: false,
        is_out_of_order: false,
    };
    decoder.file = decoder.next_file()?;
    Ok(Box::new(decoder))
}

/// Reads the edit list of an MPEG-4 file.
fn edit_list(bytes: &Bytes) -> Result<Option<List>, AudioError> {
    let mut at = 0;
    while let Some((kind, header, size)) = edits::header(&bytes.peek(at, 16)?) {
        let size = if size == 0 { bytes.len() - at } else { size };
        if size < header as u64 {
            break;
        }
        if &kind == b"moov" {
            let content =
                bytes.peek(at + header as u64, usize::try_from(size.min(MOST_INDEX)).unwrap_or(0) - header)?;
            return Ok(List::of_movie(&content));
        }
        at = at.saturating_add(size);
    }
    Ok(None)
}

/// Samples of each channel, over all joined files.
#[derive(Default)]
struct Counts {
    claimed: u64,
    found: u64,
}

/// One or more concatenated files.
struct Compressed {
    format: Format,
    /// Files that have not been opened yet.
    rest: Bytes,
    list: Option<List>,
    file: Option<File>,
    spec: Option<Spec>,
    /// Decoded samples that must wait for a pause.
    decoded: Vec<f32>,
    lost: usize,
    counts: Counts,
    is_cut: bool,
    is_out_of_order: bool,
}

/// One of the concatenated files.
struct File {
    reader: Box<dyn FormatReader>,
    decoder: Decoder,
    track: u32,
    format: Format,
    /// Samples of each channel that the file claims.
    claimed: Option<u64>,
    found: u64,
    /// Samples of each channel by which the last packet falls short of its duration.
    unfilled: u64,
    edits: Option<Edits>,
    /// Decoded packets after the claimed end.
    added: Vec<f32>,
    added_packets: usize,
}

enum Decoder {
    Symphonia(Box<dyn AudioDecoder>),
    Opus(Box<Packets>),
}

impl Compressed {
    /// Opens the next of the concatenated files.
    fn next_file(&mut self) -> Result<Option<File>, AudioError> {
        let start = parts::tags(&self.rest)?;
        self.rest = self.rest.part(start..self.rest.len());
        if self.rest.len() == 0 {
            return Ok(None);
        }
        let length = parts::first(self.format, &self.rest)?;
        let bytes = self.rest.part(0..length);
        self.rest = self.rest.part(length..self.rest.len());
        let name = self.format.name();
        let damaged = |error: Error| AudioError::Damaged { name, cause: error.to_string() };
        // Do not let `symphonia` guess the length of a stream; AIFF's chunks after the audio may be truncated.
        let reader = match self.format {
            Format::Mpeg | Format::Adts | Format::Flac => probe(bytes.unseekable()),
            Format::Aiff => probe(bytes.clone().unseekable()).or_else(|_| probe(bytes)),
            // If the end is known, a file that ends within its last element is rejected.
            Format::Matroska => probe(bytes.clone()).or_else(|error| {
                self.is_cut = true;
                probe(bytes.unseekable()).map_err(|_| error)
            }),
            _ => probe(bytes),
        };
        File::new(self.format, reader.map_err(damaged)?).map(Some)
    }

    /// Decodes the next packet into `self.decoded`.
    fn decode(&mut self) -> Result<Option<Spec>, AudioError> {
        while let Some(file) = &mut self.file {
            let packet = match file.reader.next_packet() {
                Ok(Some(packet)) => Some(packet),
                Ok(None) => None,
                // Another stream follows the first; streams are concatenated.
                Err(Error::ResetRequired) => {
                    let (track, decoder) = select(self.format, file.reader.as_ref())?;
                    (file.track, file.decoder, file.claimed) = (track.id, decoder, None);
                    continue;
                }
                Err(Error::IoError(error)) if error.kind() == ErrorKind::UnexpectedEof => None,
                Err(_) => {
                    self.lost += 1;
                    None
                }
            };
            let Some(packet) = packet else {
                self.counts.found += file.found;
                // The claim holds if it counts whole packets, the last of which is shorter.
                let claimed = file.claimed.filter(|&claimed| claimed > file.found + file.unfilled);
                self.counts.claimed += claimed.unwrap_or(file.found);
                self.file = loop {
                    match self.next_file() {
                        Ok(file) => break file,
                        Err(_) if self.spec.is_some() => self.lost += 1,
                        Err(error) => return Err(error),
                    }
                };
                continue;
            };
            if packet.track_id != file.track {
                continue;
            }
            let length = packet.dur.get();
            match file.decode(packet, &mut self.decoded, &mut self.lost)? {
                Some(spec) if !self.decoded.is_empty() => {
                    let first = *self.spec.get_or_insert(spec);
                    if (first.sample_rate, first.channels) != (spec.sample_rate, spec.channels) {
                        let cause = "its sample rate or its number of channels changes".to_owned();
                        return Err(AudioError::Damaged { name: self.format.name(), cause });
                    }
                    if file.found == 0
                        && let Some(list) = self.list.take()
                    {
                        file.edits = list.edits(spec.sample_rate, file.claimed);
                        self.is_out_of_order = file.edits.is_none();
                    }
                    let count = (self.decoded.len() / spec.width()) as u64;
                    file.found += count;
                    file.unfilled = length.saturating_sub(count);
                    return Ok(Some(spec));
                }
                _ => {}
            }
        }
        Ok(None)
    }
}

impl Blocks for Compressed {
    fn next(&mut self, block: &mut Vec<f32>) -> Result<Option<Spec>, AudioError> {
        loop {
            if self.decoded.is_empty() && self.decode()?.is_none() {
                return Ok(None);
            }
            let Some(spec) = self.spec else { return Ok(None) };
            let width = spec.width();
            let taken = match self.file.as_mut().and_then(|file| file.edits.as_mut()) {
                None => {
                    std::mem::swap(block, &mut self.decoded);
                    self.decoded.clear();
                    return Ok(Some(spec));
                }
                Some(edits) => {
                    edits.pause(block, width);
                    if block.is_empty() { edits.take(&self.decoded, block, width) } else { 0 }
                }
            };
            self.decoded.drain(..taken * width);
            if !block.is_empty() {
                return Ok(Some(spec));
            }
        }
    }

    fn notes(&self) -> Vec<Note> {
        let mut notes = Vec::new();
        if self.lost > 0 {
            notes.push(Note::Lost { packets: self.lost });
        }
        let Counts { claimed, found } = self.counts;
        if claimed > found && found > 0 {
            notes.push(Note::Short { claimed, found });
        }
        if self.is_cut {
            notes.push(Note::Cut);
        }
        if self.is_out_of_order {
            notes.push(Note::Edits);
        }
        notes
    }
}

impl File {
    fn new(format: Format, reader: Box<dyn FormatReader>) -> Result<Self, AudioError> {
        let (track, decoder) = select(format, reader.as_ref())?;
        let claimed = track.num_frames.filter(|&count| count > 0).map(|count| samples(track, count));
        // CAF decoders do not remove the encoder's delay and padding.
        let delay = u64::from(track.delay.unwrap_or(0));
        let is_trimmed = format == Format::Caf && delay + u64::from(track.padding.unwrap_or(0)) > 0;
        let edits = is_trimmed.then(|| Edits::range(delay, delay.saturating_add(claimed.unwrap_or(u64::MAX))));
        let track = track.id;
        let (added, added_packets) = (Vec::new(), 0);
        Ok(Self { reader, decoder, track, format, claimed, found: 0, unfilled: 0, edits, added, added_packets })
    }

    /// Appends a packet's samples to `block`, or counts the packet as lost.
    fn decode(
        &mut self,
        mut packet: Packet,
        block: &mut Vec<f32>,
        lost: &mut usize,
    ) -> Result<Option<Spec>, AudioError> {
        block.clear();
        let decoder = match &mut self.decoder {
            Decoder::Opus(packets) => {
                *lost += usize::from(!packets.decode(&packet.data, block));
                return Ok(Some(packets.spec()));
            }
            Decoder::Symphonia(decoder) => decoder,
        };
        let is_behind = self.format == Format::Mpeg && packet.trim_end >= packet.dur && packet.dur > Duration::ZERO;
        if is_behind {
            packet.trim_end = Duration::ZERO;
        }
        let Ok(decoded) = decoder.decode(&packet) else {
            *lost += 1;
            return Ok(None);
        };
        let (rate, channels) = (decoded.spec().rate(), decoded.spec().channels().count());
        let spec = Spec::new(rate, channels, centre(decoded.spec().channels()))?;
        decoded.copy_to_vec_interleaved(block);
        if is_behind {
            self.added_packets += 1;
            self.added.append(block);
            if self.added_packets > MOST_ADDED {
                std::mem::swap(block, &mut self.added);
            }
        }
        Ok(Some(spec))
    }
}

fn probe(bytes: Bytes) -> Result<Box<dyn FormatReader>, Error> {
    let source = MediaSourceStream::new(Box::new(bytes), Default::default());
    symphonia::default::get_probe().probe(&Hint::new(), source, Default::default(), Default::default())
}

/// Converts a track's time units to samples of each channel.
fn samples(track: &Track, units: u64) -> u64 {
    let rate = audio(track).and_then(|parameters| parameters.sample_rate);
    let (Some(TimeBase { numer, denom }), Some(rate)) = (track.time_base, rate) else { return units };
    let samples = u128::from(units) * u128::from(numer.get()) * u128::from(rate);
    u64::try_from(samples / u128::from(denom.get())).unwrap_or(u64::MAX)
}

fn audio(track: &Track) -> Option<&AudioCodecParameters> {
    track.codec_params.as_ref()?.audio()
}

/// Selects the audio track of a file and creates its decoder.
fn select(format: Format, reader: &dyn FormatReader) -> Result<(&Track, Decoder), AudioError> {
    let name = format.name();
    let other = || AudioError::OtherCodec(name);
    let track = reader.default_track(TrackType::Audio).ok_or_else(other)?;
    let parameters = audio(track).ok_or_else(other)?;
    if parameters.codec == CODEC_ID_OPUS {
        let head = match &parameters.extra_data {
            Some(head) => Head::parse(head, format == Format::Mpeg4)?,
            None => Head::plain(parameters.channels.as_ref().map_or(1, Channels::count), track.delay.unwrap_or(0)),
        };
        return Ok((track, Decoder::Opus(Box::new(Packets::new(&head)?))));
    }
    let decoder = symphonia::default::get_codecs().make_audio_decoder(parameters, &AudioDecoderOptions::default());
    match decoder {
        Ok(decoder) => Ok((track, Decoder::Symphonia(decoder))),
        Err(Error::Unsupported(_)) => Err(other()),
        Err(error) => Err(AudioError::Damaged { name, cause: error.to_string() }),
    }
}

/// Index of the centre channel.
fn centre(channels: &Channels) -> Option<usize> {
    channels.get_canonical_index_for_positioned_channel(Position::FRONT_CENTER)
}

#[cfg(test)]
mod tests;
