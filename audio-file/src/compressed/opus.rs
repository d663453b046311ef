//! Opus in Ogg (RFC 7845): packets by `ogg`, samples by `ropus`.

use std::io::{Cursor, ErrorKind};

use ogg::{OggReadError, Packet, PacketReader};
use ropus::{Channels, DecodeMode, Decoder};
use umo_core::{audio, defect};

use super::MAX_SAMPLES;
use crate::wav::{Note, OPUS, Wav, WavError};

/// Opus is decoded to this rate, and granule positions count by it, whatever was encoded.
const RATE: u32 = 48_000;
/// Samples of the longest packet, 120 ms.
const LONGEST: usize = 5760;
/// Damaged pages of a file, after which it is no recording.
const MOST_DAMAGED: usize = 10_000;
/// The granule position of a page on which no packet ends.
const NO_POSITION: u64 = u64::MAX;

/// Decodes a whole file. Streams that follow the first one are joined to it; others beside it are left out.
///
/// # Errors
/// [`WavError`] where nothing can be read.
pub(super) fn decode(bytes: Vec<u8>) -> Result<Wav, WavError> {
    let mut reader = PacketReader::new(Cursor::new(bytes));
    let (mut stream, mut samples, mut lost, mut width) = (None::<Stream>, Vec::new(), 0, 0);
    loop {
        let packet = match reader.read_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            Err(OggReadError::ReadError(error)) if error.kind() == ErrorKind::UnexpectedEof => break,
            // The next page may be whole.
            Err(OggReadError::HashMismatch(..)) if lost < MOST_DAMAGED => {
                lost += 1;
                continue;
            }
            Err(_) => {
                lost += 1;
                break;
            }
        };
        if packet.first_in_stream() && packet.data.starts_with(b"OpusHead") {
            // One beside the first has another serial number before that has ended.
            if stream.as_ref().is_some_and(|stream| !stream.is_over) {
                continue;
            }
            finish(&mut stream, &mut samples)?;
            let next = Stream::new(&packet)?;
            if width != 0 && width != next.width {
                return Err(damaged("its number of channels changes"));
            }
            width = next.width;
            stream = Some(next);
        } else if let Some(stream) = stream.as_mut().filter(|stream| stream.serial == packet.stream_serial()) {
            lost += usize::from(!stream.take(&packet)?);
        }
    }
    if stream.is_none() {
        return Err(damaged("its first page is damaged"));
    }
    finish(&mut stream, &mut samples)?;
    if samples.is_empty() {
        return Err(if lost > 0 { damaged("none of its audio can be decoded") } else { WavError::Empty });
    }
    let mut notes = Vec::new();
    if lost > 0 {
        notes.push(Note::Lost { packets: lost });
    }
    let silenced = audio::silence_unusable(&mut samples);
    if silenced > 0 {
        notes.push(Note::Unusable { samples: silenced });
    }
    let channels = if width == 2 { 2 } else { 1 };
    Ok(Wav { sample_rate: RATE, channels, samples, notes })
}

fn finish(stream: &mut Option<Stream>, samples: &mut Vec<f32>) -> Result<(), WavError> {
    if let Some(stream) = stream.take() {
        samples.extend_from_slice(stream.samples());
    }
    if samples.len() > MAX_SAMPLES { Err(WavError::Long) } else { Ok(()) }
}

fn damaged(cause: &str) -> WavError {
    WavError::Damaged { name: OPUS, cause: cause.to_owned() }
}

/// A logical stream.
struct Stream {
    serial: u32,
    decoder: Decoder,
    /// What the samples are multiplied by.
    gain: f32,
    width: usize,
    /// Samples of each channel that the decoder needs to settle, which are not heard.
    skip: usize,
    has_tags: bool,
    /// Interleaved, all that was decoded.
    decoded: Vec<f32>,
    room: Box<[f32]>,
    /// Samples of each channel of the last packet.
    last: usize,
    /// The granule position of the first sample that was decoded, once a page has told it.
    start: Option<u64>,
    /// Samples of each channel of which the last page says that they are all, those to skip among them.
    end: Option<usize>,
    is_over: bool,
}

impl Stream {
    /// Reads the first packet: "OpusHead", version, channels, samples to skip, rate before encoding, gain, mapping family.
    fn new(packet: &Packet) -> Result<Self, WavError> {
        let head: &[u8; 19] =
            packet.data.first_chunk().ok_or_else(|| damaged("its header is shorter than 19 bytes"))?;
        let [.., version, channels, skip_low, skip_high, _, _, _, _, gain_low, gain_high, family] = *head;
        if version & 0xF0 != 0 {
            return Err(damaged(&format!("its header has version {version}: expected 1")));
        }
        // Families for surround sound have several decoders.
        let width = match (family, channels) {
            (0, 1) => Channels::Mono,
            (0, 2) => Channels::Stereo,
            (0, _) => {
                return Err(damaged(&format!("its header says {channels} channels of family 0: expected 1 or 2")));
            }
            _ => return Err(WavError::OtherCodec("Ogg Opus in surround sound,")),
        };
        let decoder = Decoder::new(RATE, width).map_err(|error| damaged(&error.to_string()))?;
        // In 256ths of a decibel. Not by the decoder, which would clip.
        let gain = 10_f32.powf(f32::from(i16::from_le_bytes([gain_low, gain_high])) / (20.0 * 256.0));
        let width = usize::from(channels);
        Ok(Self {
            serial: packet.stream_serial(),
            decoder,
            gain,
            width,
            skip: u16::from_le_bytes([skip_low, skip_high]).into(),
            has_tags: false,
            decoded: Vec::new(),
            room: vec![0.0; LONGEST * width].into(),
            last: 0,
            start: None,
            end: None,
            is_over: false,
        })
    }

    /// Takes the next packet; whether it could be decoded.
    fn take(&mut self, packet: &Packet) -> Result<bool, WavError> {
        if !self.has_tags {
            self.has_tags = true;
            if packet.data.starts_with(b"OpusTags") {
                return Ok(true);
            }
        }
        let is_whole = self.decode(&packet.data);
        if !is_whole {
            // What follows stays at its time.
            self.decode(&[]);
        }
        if self.decoded.len() > MAX_SAMPLES {
            return Err(WavError::Long);
        }
        if packet.last_in_page() && packet.absgp_page() != NO_POSITION {
            let (position, count) = (packet.absgp_page(), (self.decoded.len() / self.width) as u64);
            // A stream that was cut out of another one begins later than 0; one of a single page that says less than there is, is
            // trimmed.
            let start = *self.start.get_or_insert(position.saturating_sub(count));
            if packet.last_in_stream() {
                self.end = usize::try_from(position.saturating_sub(start)).ok();
            }
        }
        self.is_over = packet.last_in_stream();
        Ok(is_whole)
    }

    /// Decodes a packet, or guesses one that is missing where that is empty.
    fn decode(&mut self, packet: &[u8]) -> bool {
        let Self { decoder, room, width, last, gain, .. } = self;
        let most = if packet.is_empty() { *last } else { LONGEST } * *width;
        // A panic is damage of the packet.
        match defect::contain_quietly(|| decoder.decode_float(packet, &mut room[..most], DecodeMode::Normal)) {
            Ok(Ok(frames)) => {
                *last = frames;
                self.decoded.extend(room[..frames * *width].iter().map(|sample| sample * *gain));
                true
            }
            Ok(Err(_)) | Err(_) => false,
        }
    }

    /// What is heard of it.
    fn samples(&self) -> &[f32] {
        let count = self.decoded.len() / self.width;
        let end = self.end.unwrap_or(count).min(count);
        &self.decoded[self.skip.min(end) * self.width..end * self.width]
    }
}

#[cfg(test)]
mod tests {
    use ogg::{PacketWriteEndInfo, PacketWriter};

    use super::*;

    /// Samples of each channel that the file's encoder says to skip, and of all its packets.
    const SKIP: usize = 312;

    fn packets() -> Vec<Vec<u8>> {
        let bytes = include_bytes!("../../test-files/hello.opus");
        let mut reader = PacketReader::new(Cursor::new(&bytes[..]));
        std::iter::from_fn(|| reader.read_packet().unwrap()).map(|packet| packet.data).collect()
    }

    /// A stream of the packets: those of audio on pages of three; the granule positions begin at `first`, and the last is `cut` less.
    fn stream(serial: u32, packets: &[Vec<u8>], first: u64, cut: u64) -> Vec<u8> {
        let mut writer = PacketWriter::new(Vec::new());
        let mut position = first;
        for (at, packet) in packets.iter().enumerate() {
            let is_last = at + 1 == packets.len();
            let info = match at {
                _ if is_last => PacketWriteEndInfo::EndStream,
                0 | 1 => PacketWriteEndInfo::EndPage,
                _ if at % 3 == 1 => PacketWriteEndInfo::EndPage,
                _ => PacketWriteEndInfo::NormalPacket,
            };
            // Packets of 20 ms.
            position += if at < 2 { 0 } else { 960 };
            let granule = if at < 2 { 0 } else { position - if is_last { cut } else { 0 } };
            writer.write_packet(packet.clone(), serial, info, granule).unwrap();
        }
        writer.into_inner()
    }

    fn with_header(change: impl FnOnce(&mut Vec<u8>)) -> Vec<u8> {
        let mut packets = packets();
        change(&mut packets[0]);
        stream(7, &packets, 0, 0)
    }

    #[test]
    fn what_encoders_added_is_cut_at_both_ends() {
        let packets = packets();
        let all = (packets.len() - 2) * 960;
        let whole = decode(stream(7, &packets, 0, 0)).unwrap();
        assert_eq!((whole.sample_rate, whole.channels, whole.samples.len()), (48_000, 1, all - SKIP));
        let cut = decode(stream(7, &packets, 0, 500)).unwrap();
        assert_eq!(cut.samples, whole.samples[..all - SKIP - 500]);
        // Cut out of a longer one, whose positions go on.
        let late = decode(stream(7, &packets, 1_000_000, 500)).unwrap();
        assert_eq!(late.samples, cut.samples);
        // An end that no file can have.
        assert_eq!(
            decode(stream(7, &packets, 1_000_000, 1_000_000)).unwrap_err().to_string(),
            WavError::Empty.to_string()
        );
        let skipped = decode(with_header(|head| head[10..12].copy_from_slice(&2000_u16.to_le_bytes()))).unwrap();
        assert_eq!(skipped.samples, whole.samples[2000 - SKIP..]);
    }

    #[test]
    fn the_header_s_gain_counts() {
        let whole = decode(with_header(|_| ())).unwrap();
        // In 256ths of a decibel.
        let louder = decode(with_header(|head| head[16..18].copy_from_slice(&(6 * 256_i16).to_le_bytes()))).unwrap();
        let factor = 10_f32.powf(6.0 / 20.0);
        assert_eq!(louder.samples.len(), whole.samples.len());
        let worst =
            louder.samples.iter().zip(&whole.samples).map(|(&a, &b)| (a - factor * b).abs()).fold(0.0, f32::max);
        assert!(worst < 1e-4, "{worst}");
    }

    #[test]
    fn a_decoder_of_two_channels_gives_both() {
        let mono = decode(with_header(|_| ())).unwrap();
        let stereo = decode(with_header(|head| head[9] = 2)).unwrap();
        assert_eq!((stereo.channels, stereo.samples.len()), (2, 2 * mono.samples.len()));
        // Packets in mono are both channels'.
        let (pairs, []) = stereo.samples.as_chunks::<2>() else { panic!("an odd number") };
        assert!(pairs.iter().all(|[left, right]| left == right));
    }

    #[test]
    fn streams_that_follow_are_joined_and_those_beside_left_out() {
        let packets = packets();
        let one = decode(stream(7, &packets, 0, 500)).unwrap();
        let both = decode([stream(7, &packets, 0, 500), stream(8, &packets, 0, 500)].concat()).unwrap();
        assert_eq!(both.samples, [one.samples.clone(), one.samples.clone()].concat());
        // Its first page stands between those of the other.
        let (a, b) = (stream(7, &packets, 0, 500), stream(8, &packets, 0, 500));
        let page = |bytes: &[u8]| bytes.windows(4).skip(1).position(|at| at == b"OggS").unwrap() + 1;
        let beside = [&a[..page(&a)], &b[..page(&b)], &a[page(&a)..], &b[page(&b)..]].concat();
        assert_eq!(decode(beside).unwrap().samples, one.samples);
        let mut other = packets.clone();
        other[0][9] = 2;
        let error = decode([a, stream(8, &other, 0, 0)].concat()).unwrap_err().to_string();
        assert!(error.contains("number of channels changes"), "{error}");
    }

    #[test]
    fn headers_that_are_not_read_say_why() {
        for (change, reason) in [
            ((18, 1), "surround"),
            ((18, 255), "surround"),
            ((9, 3), "3 channels of family 0: expected 1 or 2"),
            ((9, 0), "0 channels of family 0"),
            ((8, 0x10), "version 16"),
        ] {
            let error = decode(with_header(|head| head[change.0] = change.1)).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
        let error = decode(with_header(|head| head.truncate(12))).unwrap_err().to_string();
        assert!(error.contains("shorter than 19 bytes"), "{error}");
        let error = decode(stream(7, &packets()[..2], 0, 0)).unwrap_err().to_string();
        assert_eq!(error, WavError::Empty.to_string());
    }

    #[test]
    fn damage_is_noted_and_the_rest_stays_in_time() {
        defect::keep_quiet(&[]);
        let mut packets = packets();
        let whole = decode(stream(7, &packets, 0, 0)).unwrap();
        // Code 3 with no frames at all.
        packets[20] = vec![0x0B, 0x00];
        let hurt = decode(stream(7, &packets, 0, 0)).unwrap();
        assert_eq!(hurt.notes, [Note::Lost { packets: 1 }]);
        assert_eq!(hurt.samples.len(), whole.samples.len());
        let start = 18 * 960 - SKIP;
        assert_eq!(hurt.samples[..start], whole.samples[..start]);
        assert_ne!(hurt.samples[start..start + 960], whole.samples[start..start + 960]);
        // A page whose sum is wrong, and a file that ends in the middle.
        let mut bytes = stream(7, &packets, 0, 0);
        let middle = bytes.len() / 2;
        bytes[middle] ^= 0x55;
        let hurt = decode(bytes.clone()).unwrap();
        assert!(matches!(hurt.notes[..], [Note::Lost { packets: 1.. }]), "{:?}", hurt.notes);
        bytes.truncate(middle - 10);
        let half = decode(bytes).unwrap();
        assert!(half.samples.len() > 10_000 && half.samples.len() < whole.samples.len());
    }
}
