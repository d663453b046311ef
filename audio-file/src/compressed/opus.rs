//! Opus: packets are decoded by `ropus`; Ogg Opus (RFC 7845) is split into packets by `ogg`.

use std::io::ErrorKind;

use ogg::{OggReadError, Packet, PacketReader};
use ropus::{Channels, DecodeMode, Decoder};
use umo_core_base::defect;

use crate::blocks::{Blocks, Spec};
use crate::bytes::Bytes;
use crate::error::{AudioError, Note};
use crate::format::Format;

/// Output rate of the decoder and unit of granule positions, whatever the original rate.
const RATE: u32 = 48_000;
/// Samples of the longest packet, 120 ms.
const LONGEST: usize = 5760;
/// Number of damaged pages after which a file is not treated as a recording.
const MOST_DAMAGED: usize = 10_000;
/// Granule position of a page on which no packet ends.
const NO_POSITION: u64 = u64::MAX;
/// Upper bound on the samples of each channel of a page: 255 packets of 120 ms, since no more packets can end on one.
const LONGEST_PAGE: usize = 255 * LONGEST;

fn damaged(cause: &str) -> AudioError {
    AudioError::Damaged { name: Format::OggOpus.name(), cause: cause.to_owned() }
}

/// The header of a stream.
#[derive(Clone, Copy, Debug)]
pub(super) struct Head {
    channels: u8,
    /// Pre-skip: samples of each channel that the decoder needs to settle, and that are discarded.
    skip: usize,
    /// In 256ths of a decibel.
    gain: i16,
    /// Channel mapping family; 0 is mono and stereo.
    family: u8,
}

impl Head {
    /// Reads "OpusHead", version, channels, pre-skip, original rate, gain, mapping family. In MPEG-4 (`is_mpeg_4`),
    /// numbers are big-endian and an edit list replaces the pre-skip.
    pub(super) fn parse(head: &[u8], is_mpeg_4: bool) -> Result<Self, AudioError> {
        let head: &[u8; 19] = head.first_chunk().ok_or_else(|| damaged("its header is shorter than 19 bytes"))?;
        let [.., version, channels, skip_low, skip_high, _, _, _, _, gain_low, gain_high, family] = *head;
        if version & 0xF0 != 0 {
            return Err(damaged(&format!("its header has version {version}: expected 1")));
        }
        let (skip, gain) = ([skip_low, skip_high], [gain_low, gain_high]);
        Ok(match is_mpeg_4 {
            true => Self { channels, skip: 0, gain: i16::from_be_bytes(gain), family },
            false => Self { channels, skip: u16::from_le_bytes(skip).into(), gain: i16::from_le_bytes(gain), family },
        })
    }

    /// Substitute for a stream without a header.
    pub(super) fn plain(channels: usize, skip: u32) -> Self {
        Self { channels: u8::try_from(channels).unwrap_or(0), skip: skip as usize, gain: 0, family: 0 }
    }
}

/// A decoder of packets.
pub(super) struct Packets {
    decoder: Decoder,
    /// Linear factor applied to all samples.
    gain: f32,
    width: usize,
    /// Samples of each channel that remain to be skipped.
    skip: usize,
    room: Box<[f32]>,
    /// Samples of each channel in the last packet.
    last: usize,
}

impl Packets {
    pub(super) fn new(head: &Head) -> Result<Self, AudioError> {
        // Surround families need several decoders.
        let width = match (head.family, head.channels) {
            (0, 1) => Channels::Mono,
            (0, 2) => Channels::Stereo,
            (0, channels) => {
                return Err(damaged(&format!("its header says {channels} channels of family 0: expected 1 or 2")));
            }
            _ => return Err(AudioError::OtherCodec("Opus in surround sound,")),
        };
        let decoder = Decoder::new(RATE, width).map_err(|error| damaged(&error.to_string()))?;
        // The decoder is not given the gain because it would clip.
        let gain = 10_f32.powf(f32::from(head.gain) / (20.0 * 256.0));
        let width = usize::from(head.channels);
        Ok(Self { decoder, gain, width, skip: head.skip, room: vec![0.0; LONGEST * width].into(), last: 0 })
    }

    pub(super) fn spec(&self) -> Spec {
        Spec { sample_rate: RATE, channels: if self.width == 2 { 2 } else { 1 }, centre: None }
    }

    /// Appends a packet's samples to `block`. If the packet cannot be decoded, appends concealment audio, so that
    /// later packets keep their time, and returns false.
    pub(super) fn decode(&mut self, packet: &[u8], block: &mut Vec<f32>) -> bool {
        let is_whole = self.append(packet, block);
        if !is_whole {
            self.append(&[], block);
        }
        is_whole
    }

    fn append(&mut self, packet: &[u8], block: &mut Vec<f32>) -> bool {
        let Self { decoder, room, width, last, gain, skip } = self;
        let most = if packet.is_empty() { *last } else { LONGEST } * *width;
        // A panic means that the packet is damaged.
        match defect::contain_quietly(|| decoder.decode_float(packet, &mut room[..most], DecodeMode::Normal)) {
            Ok(Ok(frames)) => {
                *last = frames;
                let skipped = frames.min(*skip);
                *skip -= skipped;
                block.extend(room[skipped * *width..frames * *width].iter().map(|sample| sample * *gain));
                true
            }
            Ok(Err(_)) | Err(_) => false,
        }
    }
}

/// An Ogg Opus file. Streams that follow the first one are appended to it; parallel streams are ignored.
pub(super) struct OggOpus {
    reader: PacketReader<Bytes>,
    stream: Option<Stream>,
    spec: Option<Spec>,
    lost: usize,
    is_over: bool,
}

impl OggOpus {
    pub(super) fn new(bytes: Bytes) -> Self {
        Self { reader: PacketReader::new(bytes), stream: None, spec: None, lost: 0, is_over: false }
    }

    /// The next packet; `None` at the end.
    fn packet(&mut self) -> Option<Packet> {
        loop {
            match self.reader.read_packet() {
                Ok(packet) => return packet,
                Err(OggReadError::ReadError(error)) if error.kind() == ErrorKind::UnexpectedEof => return None,
                // The next page may be intact.
                Err(OggReadError::HashMismatch(..)) if self.lost < MOST_DAMAGED => self.lost += 1,
                Err(_) => {
                    self.lost += 1;
                    return None;
                }
            }
        }
    }
}

impl Blocks for OggOpus {
    fn next(&mut self, block: &mut Vec<f32>) -> Result<Option<Spec>, AudioError> {
        while !self.is_over {
            let Some(packet) = self.packet() else {
                self.is_over = true;
                let stream = self.stream.as_mut().ok_or_else(|| damaged("its first page is damaged"))?;
                block.append(&mut stream.page);
                break;
            };
            if packet.first_in_stream() && packet.data.starts_with(b"OpusHead") {
                // A parallel stream: another serial number before the first stream has ended.
                if self.stream.as_ref().is_some_and(|stream| !stream.is_over) {
                    continue;
                }
                let next = Stream::new(&packet)?;
                if *self.spec.get_or_insert(next.packets.spec()) != next.packets.spec() {
                    return Err(damaged("its number of channels changes"));
                }
                self.stream = Some(next);
            } else if let Some(stream) = self.stream.as_mut()
                && stream.serial == packet.stream_serial()
            {
                self.lost += usize::from(!stream.take(&packet, block)?);
            }
            if !block.is_empty() {
                break;
            }
        }
        Ok(self.spec.filter(|_| !block.is_empty()))
    }

    fn notes(&self) -> Vec<Note> {
        Vec::from_iter((self.lost > 0).then_some(Note::Lost { packets: self.lost }))
    }
}

/// A logical stream.
struct Stream {
    serial: u32,
    packets: Packets,
    has_tags: bool,
    /// Interleaved samples of a page whose end has not been seen yet.
    page: Vec<f32>,
    /// Samples of each channel decoded so far, including those to skip.
    count: u64,
    /// Granule position of the first decoded sample, once a page has defined it.
    start: Option<u64>,
    is_over: bool,
}

impl Stream {
    fn new(packet: &Packet) -> Result<Self, AudioError> {
        let packets = Packets::new(&Head::parse(&packet.data, false)?)?;
        let (serial, page) = (packet.stream_serial(), Vec::new());
        Ok(Self { serial, packets, has_tags: false, page, count: 0, start: None, is_over: false })
    }

    /// Decodes the next packet and, at the end of a page, moves its samples to `block`. Returns false if the packet
    /// cannot be decoded.
    fn take(&mut self, packet: &Packet, block: &mut Vec<f32>) -> Result<bool, AudioError> {
        if !self.has_tags {
            self.has_tags = true;
            if packet.data.starts_with(b"OpusTags") {
                return Ok(true);
            }
        }
        let is_whole = self.packets.decode(&packet.data, &mut self.page);
        self.count += self.packets.last as u64;
        if packet.last_in_page() && packet.absgp_page() != NO_POSITION {
            // A stream cut out of another one begins at a position above 0. A single-page stream whose position is
            // below its sample count is trimmed at the end.
            let start = *self.start.get_or_insert(packet.absgp_page().saturating_sub(self.count));
            if packet.last_in_stream() {
                let end = packet.absgp_page().saturating_sub(start);
                let added = usize::try_from(self.count.saturating_sub(end)).unwrap_or(usize::MAX);
                let added = added.saturating_mul(self.packets.width);
                self.page.truncate(self.page.len().saturating_sub(added));
            }
            block.append(&mut self.page);
        } else if self.page.len() > LONGEST_PAGE * self.packets.width {
            block.append(&mut self.page);
        }
        self.is_over = packet.last_in_stream();
        Ok(is_whole)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use ogg::{PacketWriteEndInfo, PacketWriter};

    use super::*;
    use crate::{Recording, parse};

    fn decode(bytes: Vec<u8>) -> Result<Recording, AudioError> {
        parse(&bytes)
    }

    /// Pre-skip of the file, in samples of each channel.
    const SKIP: usize = 312;

    fn packets() -> Vec<Vec<u8>> {
        let bytes = include_bytes!("../../test-files/hello.opus");
        let mut reader = PacketReader::new(Cursor::new(&bytes[..]));
        std::iter::from_fn(|| reader.read_packet().unwrap()).map(|packet| packet.data).collect()
    }

    /// A stream of the packets, with three audio packets per page. Granule positions begin at `first`; the last one
    /// is lower by `cut`.
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
        // Cut out of a longer stream, with positions that continue.
        let late = decode(stream(7, &packets, 1_000_000, 500)).unwrap();
        assert_eq!(late.samples, cut.samples);
        // An end position before the last page's start drops that page.
        let early = decode(stream(7, &packets, 1_000_000, 1_000_000)).unwrap();
        assert_eq!(early.samples, whole.samples[..early.samples.len()]);
        assert!(early.samples.len() >= whole.samples.len() - 3 * 960, "{}", early.samples.len());
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
        // Mono packets are decoded to both channels.
        let (pairs, []) = stereo.samples.as_chunks::<2>() else { panic!("an odd number") };
        assert!(pairs.iter().all(|[left, right]| left == right));
    }

    #[test]
    fn streams_that_follow_are_joined_and_those_beside_left_out() {
        let packets = packets();
        let one = decode(stream(7, &packets, 0, 500)).unwrap();
        let both = decode([stream(7, &packets, 0, 500), stream(8, &packets, 0, 500)].concat()).unwrap();
        assert_eq!(both.samples, [one.samples.clone(), one.samples.clone()].concat());
        // The parallel stream's first page is between pages of the other.
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
        assert_eq!(error, AudioError::Empty.to_string());
    }

    #[test]
    fn damage_is_noted_and_the_rest_stays_in_time() {
        defect::keep_quiet(&[]);
        let mut packets = packets();
        let whole = decode(stream(7, &packets, 0, 0)).unwrap();
        // Code 3 with zero frames.
        packets[20] = vec![0x0B, 0x00];
        let hurt = decode(stream(7, &packets, 0, 0)).unwrap();
        assert_eq!(hurt.notes, [Note::Lost { packets: 1 }]);
        assert_eq!(hurt.samples.len(), whole.samples.len());
        let start = 18 * 960 - SKIP;
        assert_eq!(hurt.samples[..start], whole.samples[..start]);
        assert_ne!(hurt.samples[start..start + 960], whole.samples[start..start + 960]);
        // A page with a wrong checksum, and a truncated file.
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
