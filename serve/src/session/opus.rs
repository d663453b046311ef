//! Opus: one packet per message, and concealment of packets that the client did not receive.

use std::fmt;

use ropus::{Channels, DecodeMode, Decoder};
use umo_core::defect;

/// Sample rates that Opus decodes to, in Hz.
const RATES: [usize; 5] = [8_000, 12_000, 16_000, 24_000, 48_000];
/// Maximum number of packets that one message may report lost: one second of 20 ms packets.
const MOST_LOST: u32 = 50;

/// Decoder from packets to mono samples.
pub(super) struct Packets {
    decoder: Decoder,
    /// Buffer for the longest packet, 120 ms.
    room: Box<[i16]>,
    /// Number of samples in the last packet; 20 ms before the first.
    last: usize,
    /// Whether the packet before the next one is missing; the next one may hold a redundant copy of it.
    is_one_lost: bool,
}

impl Packets {
    /// Creates a decoder for a sample rate, one of [`RATES`].
    pub(super) fn new(rate: usize) -> Result<Self, String> {
        let wrong = || format!("rate {rate}: Opus decodes to 8000, 12000, 16000, 24000 and 48000");
        let hertz = u32::try_from(rate).ok().filter(|_| RATES.contains(&rate)).ok_or_else(wrong)?;
        // The decoder downmixes stereo packets.
        let decoder = Decoder::new(hertz, Channels::Mono).map_err(|error| format!("rate {rate}: {error}"))?;
        Ok(Self { decoder, room: vec![0; rate * 12 / 100].into(), last: rate / 50, is_one_lost: false })
    }

    /// Passes the samples of a pending lost packet, then of this packet, to `take`.
    pub(super) fn packet(&mut self, packet: &[u8], mut take: impl FnMut(&[i16])) -> Result<(), String> {
        if packet.is_empty() {
            return Err("an empty message is not an Opus packet: report missing packets with `lost`".to_owned());
        }
        if self.is_one_lost {
            // If the packet has no redundant copy of the one before it, this conceals it.
            let copied = self.decode(packet, self.last, DecodeMode::Fec)?;
            take(&self.room[..copied]);
            self.is_one_lost = false;
        }
        self.last = self.decode(packet, self.room.len(), DecodeMode::Normal)?;
        take(&self.room[..self.last]);
        Ok(())
    }

    /// Conceals `packets` lost before the next one.
    pub(super) fn lose(&mut self, packets: u32, mut take: impl FnMut(&[i16])) -> Result<(), String> {
        if !(1..=MOST_LOST).contains(&packets) {
            return Err(format!("lost {packets}: expected 1 to {MOST_LOST} packets; a longer gap is a pause"));
        }
        // The last lost packet waits for the next one, which may hold a copy.
        self.conceal(u32::from(self.is_one_lost) + packets - 1, &mut take)?;
        self.is_one_lost = true;
        Ok(())
    }

    /// Conceals a pending lost packet: no packet follows that may hold a copy.
    pub(super) fn finish(&mut self, mut take: impl FnMut(&[i16])) -> Result<(), String> {
        let is_one_lost = std::mem::take(&mut self.is_one_lost);
        self.conceal(is_one_lost.into(), &mut take)
    }

    /// Forgets a pending lost packet.
    pub(super) fn clear(&mut self) {
        self.is_one_lost = false;
    }

    fn conceal(&mut self, packets: u32, take: &mut impl FnMut(&[i16])) -> Result<(), String> {
        for _ in 0..packets {
            let made = self.decode(&[], self.last, DecodeMode::Normal)?;
            take(&self.room[..made]);
        }
        Ok(())
    }

    /// Decodes into the first `most` samples of `room`; returns the number of samples.
    fn decode(&mut self, packet: &[u8], most: usize, mode: DecodeMode) -> Result<usize, String> {
        let Self { decoder, room, .. } = self;
        // A third-party decoder on untrusted bytes: a panic counts as a damaged packet.
        match defect::contain_quietly(|| decoder.decode(packet, &mut room[..most], mode)) {
            Ok(Ok(samples)) => Ok(samples),
            Ok(Err(error)) => Err(format!("not an Opus packet: {error}")),
            Err(defect) => Err(format!("this Opus packet cannot be decoded: {}", defect.message())),
        }
    }
}

impl fmt::Debug for Packets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Packets")
            .field("last", &self.last)
            .field("is_one_lost", &self.is_one_lost)
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use proptest::prelude::*;

    use super::*;

    fn file(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/opus").join(name)
    }

    fn packets(name: &str) -> Vec<Vec<u8>> {
        let bytes = std::fs::read(file(&format!("{name}.packets"))).unwrap();
        let (mut rest, mut packets) = (bytes.as_slice(), Vec::new());
        while let Some((length, after)) = rest.split_first_chunk() {
            let (packet, after) = after.split_at(u16::from_le_bytes(*length).into());
            packets.push(packet.to_vec());
            rest = after;
        }
        packets
    }

    fn decoded(rate: usize, packets: &[Vec<u8>]) -> Vec<i16> {
        let (mut decoder, mut samples) = (Packets::new(rate).unwrap(), Vec::new());
        for packet in packets {
            decoder.packet(packet, |more| samples.extend(more)).unwrap();
        }
        samples
    }

    /// Signal-to-difference ratio in dB.
    fn ratio(of: &[i16], to: &[i16]) -> f64 {
        assert_eq!(of.len(), to.len());
        let power = |values: &mut dyn Iterator<Item = f64>| values.map(|value| value * value).sum::<f64>();
        let difference = power(&mut of.iter().zip(to).map(|(&a, &b)| f64::from(a) - f64::from(b)));
        10.0 * (power(&mut of.iter().map(|&a| f64::from(a))) / difference.max(1e-3)).log10()
    }

    #[test]
    fn packets_decode_to_what_libopus_makes_of_them() {
        // The decoder here computes with integers, the reference with floats. The stereo file holds the mean of the
        // two decoded channels, from which libopus' own decoding to mono is 22.3 dB away.
        for (name, least) in [("voice", 70.0), ("narrow", 70.0), ("stereo", 20.0)] {
            let mut wav = hound::WavReader::open(file(&format!("{name}.wav"))).unwrap();
            let expected: Vec<i16> = wav.samples().map(Result::unwrap).collect();
            let ratio = ratio(&expected, &decoded(48_000, &packets(name)));
            assert!(ratio >= least, "{name}: {ratio:.1} dB");
        }
    }

    #[test]
    fn every_rate_gives_the_time_of_the_packets() {
        for rate in RATES {
            assert_eq!(decoded(rate, &packets("voice")).len(), rate * 6 / 10, "{rate}");
        }
        for rate in [0, 11_025, 44_100, 96_000, usize::MAX] {
            assert!(Packets::new(rate).unwrap_err().contains("48000"), "{rate}");
        }
    }

    #[test]
    fn lost_packets_keep_their_time_and_copies_in_the_next_ones_are_used() {
        let (all, size) = (packets("voice"), 320);
        let whole = decoded(16_000, &all);
        // One packet in ten, then the last three.
        let is_lost = |index: usize| index % 10 == 4 || index >= all.len() - 3;
        let (mut decoder, mut plain) = (Packets::new(16_000).unwrap(), Packets::new(16_000).unwrap());
        let (mut healed, mut concealed) = (Vec::new(), Vec::new());
        for (index, packet) in all.iter().enumerate() {
            if is_lost(index) {
                decoder.lose(1, |more| healed.extend(more)).unwrap();
                plain.conceal(1, &mut |more: &[i16]| concealed.extend(more)).unwrap();
            } else {
                decoder.packet(packet, |more| healed.extend(more)).unwrap();
                plain.packet(packet, |more| concealed.extend(more)).unwrap();
            }
        }
        decoder.finish(|more| healed.extend(more)).unwrap();
        assert_eq!((healed.len(), concealed.len()), (whole.len(), whole.len()));
        let of_lost = |samples: &[i16]| -> Vec<i16> {
            let pieces = samples.chunks(size).enumerate().filter(|&(index, _)| is_lost(index) && index < all.len() - 3);
            pieces.flat_map(|(_, piece)| piece.to_vec()).collect()
        };
        let (with, without) =
            (ratio(&of_lost(&whole), &of_lost(&healed)), ratio(&of_lost(&whole), &of_lost(&concealed)));
        assert!(with > without + 3.0, "{with:.1} dB with copies, {without:.1} without");
        // The concealed gap at the end fades.
        let loudest = |samples: &[i16]| samples.iter().map(|sample| sample.unsigned_abs()).max();
        assert!(loudest(&healed[healed.len() - size / 2..]) <= loudest(&healed[healed.len() - 4 * size..]));
    }

    #[test]
    fn gaps_are_counted_in_packets_and_bounded() {
        let all = packets("voice");
        let mut decoder = Packets::new(16_000).unwrap();
        let mut count = 0;
        // Before the first packet, a lost one counts as 20 ms. The last one stays pending.
        decoder.lose(3, |more| count += more.len()).unwrap();
        assert_eq!(count, 2 * 320);
        decoder.packet(&all[0], |more| count += more.len()).unwrap();
        assert_eq!(count, 4 * 320);
        decoder.lose(MOST_LOST, |more| count += more.len()).unwrap();
        decoder.clear();
        decoder.finish(|more| count += more.len()).unwrap();
        assert_eq!(count, (4 + MOST_LOST as usize - 1) * 320);
        for wrong in [0, MOST_LOST + 1, u32::MAX] {
            assert!(decoder.lose(wrong, |_| ()).unwrap_err().contains("1 to 50"), "{wrong}");
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(400))]

        #[test]
        fn no_bytes_do_harm(
            rate in prop::sample::select(RATES.to_vec()),
            cut in 0_usize..200,
            noise in prop::collection::vec(any::<u8>(), 0..200),
            events in prop::collection::vec((0_usize..5, 0_usize..60), 1..30),
        ) {
            let all: Vec<_> = ["voice", "narrow", "stereo"].into_iter().flat_map(packets).collect();
            let mut decoder = Packets::new(rate).unwrap();
            let most = rate * 12 / 100;
            for (kind, index) in events {
                let mut packet = all[index % all.len()].clone();
                match kind {
                    1 => packet.truncate(cut % (packet.len() + 1)),
                    2 => packet.iter_mut().zip(&noise).skip(index % 9).for_each(|(byte, noise)| *byte ^= noise),
                    3 => packet.clone_from(&noise),
                    _ => {}
                }
                if kind == 4 {
                    let lost = u32::try_from(index).unwrap();
                    let (mut count, result) = (0, decoder.lose(lost, |_| ()));
                    prop_assert_eq!(result.is_ok(), (1..=MOST_LOST).contains(&lost));
                    decoder.finish(|more| count += more.len()).unwrap();
                    prop_assert!(count <= most);
                } else {
                    let mut longest = 0;
                    let result = decoder.packet(&packet, |more| longest = longest.max(more.len()));
                    prop_assert!(longest <= most);
                    // The client is told of an error, and the decoder continues.
                    prop_assert!(result.is_ok() || kind != 0, "{:?}", result);
                    if let Err(reason) = result {
                        prop_assert!(reason.contains("not an Opus packet"), "{}", reason);
                    }
                }
            }
        }
    }
}
