//! Decodes the data of an `AudioStreamWAV`, in every format in which the editor imports a WAV file.

/// Samples per channel that are decoded at a time: one QOA frame.
const BLOCK: usize = 5120;

/// Sample format, numbered as in Godot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Coding {
    /// Signed bytes.
    Bits8,
    /// Little-endian.
    Bits16,
    /// Four bits per sample, as Godot writes them: one block, channels byte by byte, with a header that decodes to
    /// silence.
    ImaAdpcm,
    /// A file of the Quite OK Audio format: the editor's default.
    Qoa,
}

impl Coding {
    /// From `AudioStreamWAV.format`; `None` for formats of later versions.
    pub(crate) fn of(format: i64) -> Option<Self> {
        match format {
            0 => Some(Self::Bits8),
            1 => Some(Self::Bits16),
            2 => Some(Self::ImaAdpcm),
            3 => Some(Self::Qoa),
            _ => None,
        }
    }
}

/// Reads samples from data that the caller passes in, always the same data.
#[derive(Clone, Debug)]
pub(crate) struct Wave {
    coding: Coding,
    channels: usize,
    /// Number of samples per channel.
    frames: usize,
    /// Index of the next sample.
    at: usize,
    ima: [Ima; 2],
}

impl Wave {
    /// Starts at the beginning. `channels` is 1 or 2.
    ///
    /// # Errors
    ///
    /// QOA data without its header.
    pub(crate) fn new(coding: Coding, channels: usize, data: &[u8]) -> Result<Self, String> {
        let frames = match coding {
            Coding::Bits8 => data.len() / channels,
            Coding::Bits16 => data.len() / 2 / channels,
            Coding::ImaAdpcm => data.len() / channels * 2,
            Coding::Qoa => qoa::samples(data)?,
        };
        Ok(Self { coding, channels, frames, at: 0, ima: [Ima::default(); 2] })
    }

    pub(crate) fn channels(&self) -> usize {
        self.channels
    }

    /// Number of samples per channel.
    pub(crate) fn frames(&self) -> usize {
        self.frames
    }

    /// Continues at `frame`.
    pub(crate) fn seek(&mut self, frame: usize, data: &[u8]) {
        if self.coding == Coding::ImaAdpcm {
            self.ima = [Ima::default(); 2];
            (0..frame.min(self.frames)).for_each(|at| self.ima_frame(at, data, |_| ()));
        }
        self.at = frame.min(self.frames);
    }

    /// Appends the next samples, interleaved; none at the end.
    ///
    /// # Errors
    ///
    /// QOA data that is cut short or damaged.
    pub(crate) fn read(&mut self, data: &[u8], out: &mut Vec<i16>) -> Result<(), String> {
        let end = self.frames.min(self.at + BLOCK);
        let (from, to) = (self.at * self.channels, end * self.channels);
        match self.coding {
            _ if self.at == end => return Ok(()),
            Coding::Bits8 => out.extend(data[from..to].iter().map(|&byte| i16::from(byte.cast_signed()) << 8)),
            Coding::Bits16 => {
                let (pairs, _) = data[2 * from..2 * to].as_chunks();
                out.extend(pairs.iter().map(|&pair| i16::from_le_bytes(pair)));
            }
            Coding::ImaAdpcm => (self.at..end).for_each(|at| self.ima_frame(at, data, |sample| out.push(sample))),
            Coding::Qoa => {
                let frame = self.at / BLOCK;
                let wanted = BLOCK.min(self.frames - frame * BLOCK);
                let before = out.len();
                qoa::decode(data, frame, wanted, self.channels, out)?;
                out.drain(before..before + (self.at - frame * BLOCK) * self.channels);
                self.at = frame * BLOCK + wanted;
                return Ok(());
            }
        }
        self.at = end;
        Ok(())
    }

    fn ima_frame(&mut self, at: usize, data: &[u8], mut take: impl FnMut(i16)) {
        for (channel, state) in self.ima.iter_mut().enumerate().take(self.channels) {
            let byte = data[at / 2 * self.channels + channel];
            take(state.next(if at.is_multiple_of(2) { byte & 15 } else { byte >> 4 }));
        }
    }
}

/// Decoder state of one IMA-ADPCM channel.
#[derive(Clone, Copy, Debug, Default)]
struct Ima {
    predictor: i32,
    step: usize,
}

#[rustfmt::skip]
const IMA_STEPS: [i32; 89] = [
    7, 8, 9, 10, 11, 12, 13, 14, 16, 17, 19, 21, 23, 25, 28, 31, 34, 37, 41, 45, 50, 55, 60, 66, 73, 80, 88, 97, 107, 118,
    130, 143, 157, 173, 190, 209, 230, 253, 279, 307, 337, 371, 408, 449, 494, 544, 598, 658, 724, 796, 876, 963, 1060,
    1166, 1282, 1411, 1552, 1707, 1878, 2066, 2272, 2499, 2749, 3024, 3327, 3660, 4026, 4428, 4871, 5358, 5894, 6484, 7132,
    7845, 8630, 9493, 10442, 11487, 12635, 13899, 15289, 16818, 18500, 20350, 22385, 24623, 27086, 29794, 32767,
];

impl Ima {
    /// Decodes a sample of four bits: three of magnitude, one of sign.
    fn next(&mut self, bits: u8) -> i16 {
        let step = IMA_STEPS[self.step];
        let shares = [(4, step), (2, step >> 1), (1, step >> 2)];
        let by = shares.into_iter().filter(|(bit, _)| bits & bit != 0).fold(step >> 3, |sum, (_, share)| sum + share);
        let [least, most] = [i16::MIN, i16::MAX].map(i32::from);
        self.predictor = (self.predictor + if bits & 8 == 0 { by } else { -by }).clamp(least, most);
        self.step = match bits & 7 {
            0..4 => self.step.saturating_sub(1),
            larger => (self.step + 2 * usize::from(larger - 3)).min(IMA_STEPS.len() - 1),
        };
        to_i16(self.predictor)
    }
}

#[expect(clippy::cast_possible_truncation, reason = "clamped to 16 bits")]
fn to_i16(sample: i32) -> i16 {
    sample.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16
}

/// The Quite OK Audio format, <https://qoaformat.org>: all numbers big-endian.
mod qoa {
    use super::{BLOCK, to_i16};

    const FILE_HEAD: usize = 8;
    const FRAME_HEAD: usize = 8;
    /// Bytes of a channel's history and weights.
    const STATE: usize = 16;
    const SLICE: usize = 8;
    /// Samples per slice.
    const SLICE_SAMPLES: usize = 20;
    const SCALES: [i32; 16] = [1, 7, 21, 45, 84, 138, 211, 304, 421, 562, 731, 928, 1157, 1419, 1715, 2048];
    /// Quarters of a scale.
    const RESIDUALS: [i32; 4] = [3, 10, 18, 28];

    /// Predicts the next sample of a channel from its last four.
    #[derive(Clone, Copy, Default)]
    struct Filter {
        history: [i32; 4],
        weights: [i32; 4],
    }

    impl Filter {
        fn read(state: &[u8; STATE]) -> Self {
            let number = |at: usize| i32::from(i16::from_be_bytes([state[at], state[at + 1]]));
            Self { history: [0, 2, 4, 6].map(number), weights: [8, 10, 12, 14].map(number) }
        }

        fn next(&mut self, residual: i32) -> i16 {
            let products = self.history.iter().zip(self.weights).map(|(h, w)| i64::from(*h) * i64::from(w));
            let [least, most] = [i16::MIN, i16::MAX].map(i64::from);
            // Damaged data may give any weights.
            let predicted = ((products.sum::<i64>() >> 13) + i64::from(residual)).clamp(least, most);
            let sample = i16::try_from(predicted).unwrap_or_default();
            for (weight, history) in self.weights.iter_mut().zip(self.history) {
                let by = residual >> 4;
                *weight = weight.wrapping_add(if history < 0 { -by } else { by });
            }
            self.history.rotate_left(1);
            self.history[3] = i32::from(sample);
            to_i16(self.history[3])
        }
    }

    /// Number of samples per channel in a file.
    pub(super) fn samples(file: &[u8]) -> Result<usize, String> {
        match file.first_chunk::<FILE_HEAD>() {
            Some([b'q', b'o', b'a', b'f', a, b, c, d]) => Ok(u32::from_be_bytes([*a, *b, *c, *d]) as usize),
            _ => Err("its data has no QOA header".to_owned()),
        }
    }

    /// Appends the first `count` samples of each channel of a frame, interleaved.
    pub(super) fn decode(
        file: &[u8],
        frame: usize,
        count: usize,
        channels: usize,
        out: &mut Vec<i16>,
    ) -> Result<(), String> {
        let wrong = || format!("its QOA data is damaged or cut short in frame {frame}");
        let full = FRAME_HEAD + channels * (STATE + SLICE * BLOCK.div_ceil(SLICE_SAMPLES));
        let rest = frame.checked_mul(full).and_then(|at| file.get(FILE_HEAD + at..)).ok_or_else(wrong)?;
        let (head, rest) = rest.split_first_chunk::<FRAME_HEAD>().ok_or_else(wrong)?;
        let held = usize::from(u16::from_be_bytes([head[4], head[5]]));
        let (states, slices) = rest.split_at_checked(channels * STATE).ok_or_else(wrong)?;
        let (slices, _) = slices.as_chunks::<SLICE>();
        let needed = count.div_ceil(SLICE_SAMPLES);
        if usize::from(head[0]) != channels || held < count || slices.len() < needed * channels {
            return Err(wrong());
        }
        let (states, _) = states.as_chunks();
        let mut filters = [Filter::default(); 2];
        filters.iter_mut().zip(states).for_each(|(filter, state)| *filter = Filter::read(state));
        for (number, slices) in slices.chunks_exact(channels).take(needed).enumerate() {
            let mut slices = [slices[0], slices[channels - 1]].map(u64::from_be_bytes);
            let scales = slices.map(|slice| SCALES[(slice >> 60) as usize]);
            slices.iter_mut().for_each(|slice| *slice <<= 4);
            for _ in 0..SLICE_SAMPLES.min(count - number * SLICE_SAMPLES) {
                for channel in 0..channels {
                    let bits = slices[channel] >> 61;
                    let size = (scales[channel] * RESIDUALS[(bits >> 1) as usize] + 2) / 4;
                    out.push(filters[channel].next(if bits & 1 == 0 { size } else { -size }));
                    slices[channel] <<= 3;
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(coding: Coding, channels: usize, data: &[u8], from: usize) -> Result<Vec<i16>, String> {
        let mut wave = Wave::new(coding, channels, data)?;
        wave.seek(from, data);
        let mut samples = Vec::new();
        loop {
            let before = samples.len();
            wave.read(data, &mut samples)?;
            if samples.len() == before {
                return Ok(samples);
            }
        }
    }

    #[test]
    fn plain_samples_are_read_as_they_are() {
        assert_eq!(all(Coding::Bits8, 1, &[0, 1, 127, 128, 255], 0).unwrap(), [0, 256, 32512, -32768, -256]);
        assert_eq!(all(Coding::Bits16, 2, &[1, 0, 255, 255, 0, 128, 7], 0).unwrap(), [1, -1]);
        assert_eq!(all(Coding::Bits16, 1, &[1, 0, 2, 0, 3, 0], 2).unwrap(), [3]);
        assert_eq!((0..5).map(Coding::of).filter(Option::is_some).count(), 4);
    }

    #[test]
    fn ima_adpcm_grows_and_shrinks_its_steps() {
        // Computed by hand: 7/8 of 7, then 7 itself; then the step is 16, and falls again.
        assert_eq!(all(Coding::ImaAdpcm, 1, &[0x07, 0x08], 0).unwrap(), [11, 13, 12, 13]);
        // Channels alternate byte by byte; a start in the middle decodes everything before it.
        let data = [0x07, 0x0f, 0x08, 0x00];
        assert_eq!(all(Coding::ImaAdpcm, 2, &data, 0).unwrap(), [11, -11, 13, -9, 12, -8, 13, -7]);
        assert_eq!(all(Coding::ImaAdpcm, 2, &data, 2).unwrap(), [12, -8, 13, -7]);
    }

    /// A file of noise: every slice is valid.
    fn noise(samples: u32, channels: u8) -> Vec<u8> {
        let mut file = b"qoaf".to_vec();
        file.extend(samples.to_be_bytes());
        let mut seed = 1_u64;
        for start in (0..samples).step_by(BLOCK) {
            let held = (samples - start).min(5120);
            file.extend([channels, 0, 62, 128]);
            file.extend(u16::try_from(held).unwrap().to_be_bytes());
            file.extend([0, 0]);
            for _ in 0..channels {
                file.extend([0, 1, 0, 2, 0, 3, 0, 4, 0, 0, 0, 0, 0xe0, 0, 0x40, 0]);
            }
            for _ in 0..held.div_ceil(20) * u32::from(channels) {
                seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                file.extend(seed.to_be_bytes());
            }
        }
        file
    }

    #[test]
    fn qoa_starts_anywhere_with_the_same_samples() {
        for channels in [1, 2] {
            let file = noise(12_345, channels);
            let channels = usize::from(channels);
            let samples = all(Coding::Qoa, channels, &file, 0).unwrap();
            assert_eq!(samples.len(), 12_345 * channels);
            for from in [1, 5119, 5120, 5121, 12_344, 12_345, 99_999] {
                let start = (from * channels).min(samples.len());
                assert_eq!(all(Coding::Qoa, channels, &file, from).unwrap(), samples[start..], "from {from}");
            }
        }
    }

    #[test]
    fn qoa_decodes_a_slice_as_the_format_says() {
        let mut file = noise(3, 1);
        // Scale 7; residuals 5, -18, 49. From (1, 2, 3, 4) the filter predicts 2 * 4 - 3 = 5, then 2 * 10 - 4 = 16; the
        // second residual takes 2 of 8192 from each weight, so that -14 becomes slightly less and is rounded down to
        // -15.
        let start = file.len() - 8;
        file[start..].copy_from_slice(&(1_u64 << 60 | 0b000_011_110_u64 << 51).to_be_bytes());
        assert_eq!(all(Coding::Qoa, 1, &file, 0).unwrap(), [10, -2, 34]);
    }

    #[test]
    fn damaged_qoa_does_not_panic() {
        let file = noise(300, 2);
        assert!(all(Coding::Qoa, 2, b"RIFF....", 0).unwrap_err().contains("header"));
        assert!(all(Coding::Qoa, 1, &file, 0).unwrap_err().contains("damaged"));
        for cut in 0..file.len() {
            assert!(all(Coding::Qoa, 2, &file[..cut], 0).is_err(), "cut to {cut}");
        }
        let mut file = file;
        for at in 0..file.len() {
            file[at] ^= 0xff;
            let _ = all(Coding::Qoa, 2, &file, 0);
            file[at] ^= 0xff;
        }
    }
}
