use hound::{SampleFormat, WavSpec, WavWriter};
use proptest::prelude::*;
use std::io::Cursor;

use super::PIECE;
use crate::{AudioError, Note, Reader, SAMPLE_RATES, parse, read};

/// A plain 44-byte header followed by `data`; the header claims `claimed` bytes of audio.
fn plain(tag: u16, channels: u16, rate: u32, bits: u16, claimed: u32, data: &[u8]) -> Vec<u8> {
    let block = channels * bits.div_ceil(8);
    let mut bytes = b"RIFF\0\0\0\0WAVEfmt \x10\0\0\0".to_vec();
    bytes.extend(tag.to_le_bytes());
    bytes.extend(channels.to_le_bytes());
    bytes.extend(rate.to_le_bytes());
    bytes.extend(rate.wrapping_mul(u32::from(block)).to_le_bytes());
    bytes.extend(block.to_le_bytes());
    bytes.extend(bits.to_le_bytes());
    bytes.extend(b"data");
    bytes.extend(claimed.to_le_bytes());
    bytes.extend(data);
    bytes
}

fn mono_16(claimed: u32, data: &[u8]) -> Vec<u8> {
    plain(1, 1, 16_000, 16, claimed, data)
}

/// Output of `hound` for `values` (already within the range of `bits`).
fn by_hound(spec: WavSpec, values: &[i32]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut writer = WavWriter::new(&mut bytes, spec).unwrap();
    for &x in values {
        match spec.sample_format {
            SampleFormat::Int => writer.write_sample(x).unwrap(),
            SampleFormat::Float => writer.write_sample(x as f32 / 2_147_483_648.0).unwrap(),
        }
    }
    writer.finalize().unwrap();
    bytes.into_inner()
}

proptest! {
    #[test]
    fn parse_never_panics_on_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = parse(&bytes);
    }

    #[test]
    fn parse_never_panics_on_any_header(
        fmt in prop::collection::vec(any::<u8>(), 0..48),
        ids in prop::collection::vec(prop::sample::select(vec!["fmt ", "data", "LIST", "ds64"]), 0..5),
        sizes in prop::collection::vec(any::<u32>(), 5),
        small in any::<bool>(),
    ) {
        let mut bytes = b"RF64\0\0\0\0WAVE".to_vec();
        for (id, size) in ids.iter().zip(sizes) {
            bytes.extend(id.as_bytes());
            bytes.extend((if small { size % 50 } else { size }).to_le_bytes());
            bytes.extend(&fmt);
        }
        let _ = parse(&bytes);
    }

    #[test]
    fn parse_reads_back_what_hound_writes(
        channels in 1_u16..=8,
        sample_rate in SAMPLE_RATES,
        (bits_per_sample, sample_format) in prop::sample::select(vec![
            (8, SampleFormat::Int), (16, SampleFormat::Int), (24, SampleFormat::Int),
            (32, SampleFormat::Int), (32, SampleFormat::Float),
        ]),
        mut values in prop::collection::vec(any::<i32>(), 8..80),
    ) {
        let float = sample_format == SampleFormat::Float;
        if !float {
            values.iter_mut().for_each(|x| *x >>= 32 - bits_per_sample);
        }
        values.truncate(values.len() / usize::from(channels) * usize::from(channels));
        let spec = WavSpec { channels, sample_rate, bits_per_sample, sample_format };
        let wav = parse(&by_hound(spec, &values)).unwrap();
        let full = if float { 2_147_483_648.0 } else { (1_i64 << (bits_per_sample - 1)) as f32 };
        let want: Vec<f32> = values.iter().map(|&x| x as f32 / full).collect();
        prop_assert_eq!(wav.samples, want);
        prop_assert_eq!((wav.channels, wav.sample_rate), (channels, sample_rate));
        prop_assert!(wav.notes.is_empty());
    }
}

#[test]
fn parse_survives_truncation_at_every_byte() {
    let spec = WavSpec { channels: 3, sample_rate: 44_100, bits_per_sample: 24, sample_format: SampleFormat::Int };
    let whole = by_hound(spec, &(0..30).map(|x| x * 1000).collect::<Vec<_>>());
    let want = parse(&whole).unwrap().samples;
    let data_at = whole.len() - 90;
    for cut in 0..whole.len() {
        match parse(&whole[..cut]) {
            Ok(wav) => {
                assert_eq!(wav.samples, want[..(cut - data_at) / 9 * 3]);
                let found = (cut - data_at) as u64;
                assert_eq!(wav.notes, [Note::Length { claimed: 90, found }]);
            }
            Err(_) => assert!(cut < data_at + 9, "whole frames are there at {cut}"),
        }
    }
}

#[test]
fn parse_reads_streamed_lengths_to_the_end() {
    for claimed in [0, 1000, 0x7FFF_0000, u32::MAX, u32::MAX - 36] {
        let wav = parse(&mono_16(claimed, &[0, 64, 0, 192, 7])).unwrap();
        assert_eq!(wav.samples, [0.5, -0.5]);
        let lie = (claimed == 1000).then_some(Note::Length { claimed: 1000, found: 5 });
        assert_eq!(wav.notes, Vec::from_iter(lie));
    }
}

#[test]
fn parse_refuses_a_recording_without_samples() {
    let followed = mono_16(0, b"LIST\x04\0\0\0INFO");
    for bytes in [mono_16(0, &[]), mono_16(u32::MAX, &[1]), followed] {
        assert_eq!(parse(&bytes), Err(AudioError::Empty));
    }
}

#[test]
fn parse_joins_the_pieces_of_a_long_recording() {
    // One frame more than is decoded at a time.
    let mut data = vec![128; PIECE + 1];
    (data[PIECE - 1], data[PIECE]) = (192, 64);
    let wav = parse(&plain(1, 1, 16_000, 8, 0, &data)).unwrap();
    assert_eq!(wav.samples.len(), data.len());
    assert_eq!(wav.samples[PIECE - 2..], [0.0, 0.5, -0.5]);
}

#[test]
fn parse_stops_at_the_claimed_end() {
    let mut bytes = mono_16(4, &[0, 64, 0, 192]);
    bytes.extend(b"LIST\x04\0\0\0INFO");
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.samples, wav.notes), (vec![0.5, -0.5], vec![]));
}

#[test]
fn parse_skips_other_chunks_with_their_padding() {
    let mut bytes = mono_16(2, &[0, 64]);
    bytes.splice(12..12, *b"junk\x03\0\0\0abc\0");
    assert_eq!(parse(&bytes).unwrap().samples, [0.5]);
}

#[test]
fn parse_reads_the_long_size_of_rf64() {
    let mut bytes = mono_16(u32::MAX, &[0, 64, 0, 192]);
    bytes[..4].copy_from_slice(b"RF64");
    let mut ds64 = b"ds64\x1c\0\0\0".to_vec();
    ds64.extend([0_u64, 2, 1].map(u64::to_le_bytes).concat());
    ds64.extend([0; 4]);
    bytes.splice(12..12, ds64);
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.samples, wav.notes), (vec![0.5], vec![]));
}

#[test]
fn parse_reads_64_bit_floats() {
    let values = [0.25_f64, -1.5, f64::NAN, 1e300];
    let data = values.map(f64::to_le_bytes).concat();
    let wav = parse(&plain(3, 2, 48_000, 64, 32, &data)).unwrap();
    assert_eq!(wav.samples, [0.25, -1.5, 0.0, 0.0]);
    assert_eq!(wav.notes, [Note::Unusable { samples: 2 }]);
}

#[test]
fn parse_silences_and_counts_unusable_samples() {
    // Found by fuzzing: resampling sums over samples near the largest f32 overflowed.
    let values = [f32::NAN, 0.5, f32::INFINITY, -3e38, -0.5];
    let data = values.map(f32::to_le_bytes).concat();
    let wav = parse(&plain(3, 1, 48_000, 32, 20, &data)).unwrap();
    assert_eq!(wav.samples, [0.0, 0.5, 0.0, 0.0, -0.5]);
    assert_eq!(wav.notes, [Note::Unusable { samples: 3 }]);
    assert!(wav.notes[0].to_string().starts_with("3 samples"));
}

#[test]
fn parse_reads_24_bits_in_four_bytes() {
    let mut bytes = plain(1, 1, 16_000, 24, 8, &[0, 0, 0x40, 0x55, 0, 0, 0x80, 0x55]);
    bytes[32] = 4;
    assert_eq!(parse(&bytes).unwrap().samples, [0.5, -1.0]);
}

#[test]
fn parse_refuses_what_it_cannot_read() {
    let data = [0; 16];
    let case = |tag, channels, rate, bits| parse(&plain(tag, channels, rate, bits, 16, &data));
    assert_eq!(case(1, 0, 16_000, 16), Err(AudioError::Channels(0)));
    assert_eq!(case(1, 9, 16_000, 16), Err(AudioError::Channels(9)));
    assert_eq!(case(1, 1, 999, 16), Err(AudioError::SampleRate(999)));
    assert_eq!(case(1, 1, 768_001, 16), Err(AudioError::SampleRate(768_001)));
    let g_726 = AudioError::Encoding { tag: 0x45, bits: 4 };
    assert_eq!(case(0x45, 1, 8_000, 4), Err(g_726));
    let wide = AudioError::Encoding { tag: 1, bits: 64 };
    assert_eq!(case(1, 1, 8_000, 64), Err(wide));
    let zero = AudioError::BadFormat("its frame size is not a multiple of its channels");
    assert_eq!(case(1, 1, 8_000, 0), Err(zero));
    assert_eq!(parse(b"RIFX\0\0\0\0WAVX"), Err(AudioError::NotWav));
    assert_eq!(parse(b"RIFF\0\0\0\0WAVE"), Err(AudioError::NoFormat));
    assert_eq!(parse(&mono_16(2, &[0, 0])[..36]), Err(AudioError::NoData));
}

#[test]
fn parse_refuses_an_unknown_extensible_sub_format() {
    let spec = WavSpec { channels: 1, sample_rate: 16_000, bits_per_sample: 32, sample_format: SampleFormat::Float };
    let mut bytes = by_hound(spec, &[1, 2]);
    assert_eq!(bytes[20..22], [0xFE, 0xFF], "hound writes the extensible form");
    bytes[50] ^= 1;
    let want = AudioError::BadFormat("its sub-format is not known");
    assert_eq!(parse(&bytes), Err(want));
}

#[test]
fn mono_averages_and_stays_finite() {
    let data = [1.0_f32, 0.5, 1e6, 1e6].map(f32::to_le_bytes).concat();
    let wav = parse(&plain(3, 2, 48_000, 32, 16, &data)).unwrap();
    assert_eq!(wav.mono(), [0.75, 1e6]);
    assert_eq!(wav.seconds(), 2.0 / 48_000.0);
}

#[test]
fn read_names_the_path_and_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("no.wav");
    let message = read(&missing).unwrap_err().to_string();
    assert_eq!(message, format!("cannot read `{}`: no such file", missing.display()));
    let message = read(folder.path()).unwrap_err().to_string();
    assert!(message.ends_with("it is a directory, not a regular file"), "{message}");
    let text = folder.path().join("text.wav");
    std::fs::write(&text, "hello").unwrap();
    let message = read(&text).unwrap_err().to_string();
    assert!(message.contains("text.wav") && message.contains("not a WAV file"), "{message}");
    let good = folder.path().join("good.wav");
    std::fs::write(&good, mono_16(2, &[0, 64])).unwrap();
    assert_eq!(read(&good).unwrap().samples, [0.5]);
}

#[test]
fn parse_joins_all_data_chunks() {
    let mut bytes = mono_16(2, &[0, 64]);
    bytes.extend(b"LIST\x04\0\0\0INFOdata\x04\0\0\0\0\xC0\0\x40");
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.samples, wav.notes), (vec![0.5, -0.5, 0.5], vec![]));
    // The last chunk claims more bytes than are present.
    bytes.truncate(bytes.len() - 2);
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.samples, wav.notes), (vec![0.5, -0.5], vec![Note::Length { claimed: 4, found: 2 }]));
}

#[test]
fn parse_finds_the_chunk_behind_one_without_padding() {
    for (chunk, notes) in [(&b"junk\x03\0\0\0abc"[..], vec![Note::Unpadded]), (b"junk\x03\0\0\0abc\0", vec![])] {
        let mut bytes = mono_16(2, &[0, 64]);
        bytes.splice(12..12, chunk.iter().copied());
        let wav = parse(&bytes).unwrap();
        assert_eq!((wav.samples, &wav.notes), (vec![0.5], &notes));
        assert!(wav.notes.iter().all(|note| !note.is_damage()));
    }
}

#[test]
fn parse_says_what_it_leaves_behind_the_audio() {
    let mut bytes = mono_16(2, &[0, 64]);
    bytes.extend([0; 40]);
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.samples, wav.notes), (vec![0.5], vec![Note::Trailing { bytes: 40 }]));
}

#[test]
fn parse_reads_rifx() {
    let mut bytes =
        b"RIFX\0\0\0\0WAVEfmt \0\0\0\x10\0\x01\0\x01\0\0\x3e\x80\0\0\x7d\0\0\x02\0\x10data\0\0\0\x04".to_vec();
    bytes.extend([0x40, 0, 0xC0, 0]);
    let wav = parse(&bytes).unwrap();
    assert_eq!((wav.sample_rate, wav.samples, wav.notes), (16_000, vec![0.5, -0.5], vec![]));
}

#[test]
fn parse_reads_mp3_in_a_data_chunk() {
    let mp3 = include_bytes!("../../test-files/hello.mp3");
    let wav = parse(&plain(0x55, 1, 16_000, 8, u32::try_from(mp3.len()).unwrap(), mp3));
    let wav = wav.map_err(|error| error.to_string());
    assert_eq!(wav, parse(mp3).map_err(|error| error.to_string()));
}

#[test]
fn a_reader_tells_the_channel_in_front() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.wav");
    for (channels, centre) in [(1, None), (2, None), (6, Some(2))] {
        std::fs::write(&path, plain(1, channels, 48_000, 16, 24, &[1; 24])).unwrap();
        assert_eq!(Reader::open(&path).unwrap().centre(), centre);
    }
}
