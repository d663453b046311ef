//! Level and channels of a whole recording: gains that make its speech audible to the model.
//!
//! A stream has the level of its microphone. Of a recording, all samples are known. A recording gets a gain
//! for each channel if its level is far from that of speech, its channels cancel each other, or its speech is
//! in one of many channels. All others get gains of one and keep their bits.

use crate::functions::Functions;
use std::fmt;

use crate::samples::MAX_AMPLITUDE;

/// Maximum number of channels that are measured, the same as for a session.
pub const MAX_CHANNELS: usize = 64;

/// Nominal level of speech in dB of full scale, as in ITU-T P.56 and G.191.
const NOMINAL: f64 = -26.0;
/// Levels in dB of full scale that are not changed: the mouth follows all of them alike.
const PLAIN: std::ops::RangeInclusive<f64> = -42.0..=6.0;
/// Levels in dB of full scale below this are the noise of 16-bit samples.
const SILENT: f64 = -80.0;
/// Minimum distance in dB between speech and its pauses. Steadier sounds are noise, and stay quiet.
const CONTRAST: f64 = 10.0;
/// Factor by which the mean of opposite channels must lose power before one is inverted: correlation below
/// -0.6.
const CANCELLED: f64 = 4.0;
/// Minimum power of a centre channel, relative to the loudest, for it to be the voice's.
const CENTRE: f64 = 0.01;
/// A peak above that of any float samples with full scale 1: the samples are 16-bit integers.
const INTEGER_PEAK: f64 = 256.0;
const INTEGER_SCALE: f32 = 1.0 / 32768.0;
/// Histogram bins per factor of two of power, as a base-2 logarithm.
const BIN_BITS: u32 = 3;
const BINS: usize = 128 << BIN_BITS;
/// Biased exponent of the lowest bin: -193 dB.
const LOWEST: i64 = 1023 - 64;

/// Measures a whole recording, block by block. The result has the same bits for any split into blocks, on
/// every machine.
#[derive(Clone, Debug)]
pub struct Meter {
    channels: usize,
    /// Number of samples per channel in 20 ms.
    hop: usize,
    filled: usize,
    /// Sum and sum of squares of each channel in this hop; the last entry is the mean of all channels.
    sums: [(f64, f64); MAX_CHANNELS + 1],
    hops: u64,
    /// Largest sample.
    peak: f64,
    /// Histogram of hops by power, for each channel; the last entry is the mean of all channels. Hops without
    /// power are not counted.
    bins: Vec<[u64; BINS]>,
    /// Sums of the products of each two channels, after subtracting each channel's mean in a hop.
    products: [[f64; MAX_CHANNELS]; MAX_CHANNELS],
    hop_products: [[f64; MAX_CHANNELS]; MAX_CHANNELS],
}

impl Meter {
    /// Creates a meter of `channels` at `sample_rate` Hz.
    ///
    /// # Panics
    /// If `channels` is not 1..=[`MAX_CHANNELS`].
    pub fn new(channels: usize, sample_rate: usize) -> Self {
        assert!((1..=MAX_CHANNELS).contains(&channels), "1 to {MAX_CHANNELS} channels");
        Self {
            channels,
            hop: (sample_rate / 50).max(1),
            filled: 0,
            sums: [(0.0, 0.0); MAX_CHANNELS + 1],
            hops: 0,
            peak: 0.0,
            bins: vec![[0; BINS]; channels + 1],
            products: [[0.0; MAX_CHANNELS]; MAX_CHANNELS],
            hop_products: [[0.0; MAX_CHANNELS]; MAX_CHANNELS],
        }
    }

    /// Takes interleaved samples of whole frames. Unusable samples count as silence.
    pub fn push(&mut self, interleaved: &[f32]) {
        for frame in interleaved.chunks_exact(self.channels) {
            let mut mean = 0.0;
            for (at, &sample) in frame.iter().enumerate() {
                let sample = usable(sample);
                mean += sample;
                self.peak = self.peak.max(sample.abs());
                add(&mut self.sums[at], sample);
                for (product, &other) in self.hop_products[at].iter_mut().zip(&frame[..at]) {
                    *product += sample * usable(other);
                }
            }
            add(&mut self.sums[self.channels], mean / self.channels as f64);
            self.filled += 1;
            if self.filled == self.hop {
                self.end_hop();
            }
        }
    }

    fn end_hop(&mut self) {
        let count = self.filled as f64;
        for (bins, &(sum, square)) in self.bins.iter_mut().zip(&self.sums) {
            if let Some(bin) = bin((square - sum * sum / count) / count) {
                bins[bin] += 1;
            }
        }
        for at in 0..self.channels {
            let (sum, square) = self.sums[at];
            self.products[at][at] += square - sum * sum / count;
            for other in 0..at {
                self.products[at][other] += self.hop_products[at][other] - sum * self.sums[other].0 / count;
            }
        }
        self.hops += 1;
        self.filled = 0;
        self.sums = [(0.0, 0.0); MAX_CHANNELS + 1];
        for products in &mut self.hop_products[..self.channels] {
            products[..self.channels].fill(0.0);
        }
    }

    /// Returns the gains for all samples pushed so far. `centre` is the channel in front of the listener, if
    /// the recording has one.
    pub fn gains(&self, centre: Option<usize>) -> Gains {
        let mut gains = Gains { gains: [1.0; MAX_CHANNELS], channels: self.channels, findings: Vec::new() };
        let power = |at: usize| self.products[at][at];
        let loudest = (0..self.channels).rev().max_by(|&a, &b| power(a).total_cmp(&power(b))).unwrap_or(0);
        let mut heard = &self.bins[self.channels];
        let mut factor = 1.0;
        if let Some(centre) = centre.filter(|&at| self.channels > 2 && power(at) > CENTRE * power(loudest)) {
            gains.gains = [0.0; MAX_CHANNELS];
            gains.gains[centre] = self.channels as f32;
            gains.findings.push(Finding::Centre { channel: centre });
            heard = &self.bins[centre];
        } else {
            let (plain, signs, turned) = self.turned(loudest);
            if turned > CANCELLED * plain {
                gains.gains = signs;
                gains.findings.push(Finding::Opposite);
                heard = &self.bins[loudest];
                factor = turned / power(loudest);
            }
        }
        if self.peak > INTEGER_PEAK {
            gains.scale(INTEGER_SCALE);
            gains.findings.push(Finding::Integers { peak: self.peak });
            factor *= f64::from(INTEGER_SCALE * INTEGER_SCALE);
        }
        let Some(found) = level(heard, self.hops, factor) else { return gains };
        if !PLAIN.contains(&found.level) {
            let gain = found.gain();
            gains.scale(gain);
            gains.findings.push(Finding::Level { level: found.level, is_heard: gain != 1.0 });
        }
        gains
    }

    /// Returns the power of the plain mean, signs that invert the channels opposite to the loudest one, and
    /// the power of the mean with these signs.
    fn turned(&self, loudest: usize) -> (f64, [f32; MAX_CHANNELS], f64) {
        let product = |a: usize, b: usize| self.products[a.max(b)][a.min(b)];
        let mut signs = [1.0; MAX_CHANNELS];
        for (at, sign) in signs.iter_mut().enumerate().take(self.channels) {
            *sign = if product(at, loudest) < 0.0 { -1.0 } else { 1.0 };
        }
        let power = |signs: &[f32; MAX_CHANNELS]| {
            let pairs = (0..self.channels).flat_map(|a| (0..self.channels).map(move |b| (a, b)));
            let sum: f64 = pairs.map(|(a, b)| f64::from(signs[a] * signs[b]) * product(a, b)).sum();
            (sum / (self.channels * self.channels) as f64).max(0.0)
        };
        (power(&[1.0; MAX_CHANNELS]), signs, power(&signs))
    }
}

/// Returns a sample as [`silence_unusable`](super::silence_unusable) leaves it.
fn usable(sample: f32) -> f64 {
    if (-MAX_AMPLITUDE..=MAX_AMPLITUDE).contains(&sample) { f64::from(sample) } else { 0.0 }
}

fn add(sums: &mut (f64, f64), sample: f64) {
    sums.0 += sample;
    sums.1 += sample * sample;
}

/// Histogram bin of a power. Uses only its bits, not functions that machines round differently.
fn bin(power: f64) -> Option<usize> {
    if power <= 0.0 {
        return None;
    }
    let bin = (power.to_bits() >> (52 - BIN_BITS)).cast_signed() - (LOWEST << BIN_BITS);
    usize::try_from(bin).ok().map(|bin| bin.min(BINS - 1))
}

/// Power at the middle of a bin.
fn power(bin: usize) -> f64 {
    let bits = (((bin as u64) + (LOWEST.cast_unsigned() << BIN_BITS)) << (52 - BIN_BITS)) | 1 << (51 - BIN_BITS);
    f64::from_bits(bits)
}

struct Level {
    /// Level of speech, in dB of full scale.
    level: f64,
    /// Distance of speech to the pauses, in dB.
    contrast: f64,
}

impl Level {
    /// Gain to the nominal level: a power of two, which rounds no sample. Silence and quiet noise get 1.
    #[expect(clippy::cast_possible_truncation, reason = "a power of two of at most 200 dB")]
    fn gain(&self) -> f32 {
        if self.level < SILENT || self.level < NOMINAL && self.contrast < CONTRAST {
            return 1.0;
        }
        2_f32.powi(((NOMINAL - self.level) / 6.020_599_913_279_624).round() as i32)
    }
}

/// Level of the hops within 20 dB of the loud ones. These are the loudest half second, or the loudest tenth
/// of a short recording. `None` without any sound.
fn level(bins: &[u64; BINS], hops: u64, factor: f64) -> Option<Level> {
    let many = (hops / 10).clamp(1, 25);
    let mut count = 0;
    let loud = (0..BINS).rev().find(|&bin| {
        count += bins[bin];
        count >= many
    });
    let loud = loud.or_else(|| (0..BINS).find(|&bin| bins[bin] > 0))?;
    let active = (0..BINS).filter(|&bin| power(bin) >= power(loud) / 100.0);
    let (sum, count) =
        active.fold((0.0, 0), |(sum, count), bin| (sum + power(bin) * bins[bin] as f64, count + bins[bin]));
    let active = sum / count as f64;
    // The quietest tenth. Hops without any sound are not in a bin.
    let silent = hops - bins.iter().sum::<u64>();
    let mut below = silent;
    let floor = (0..BINS).find(|&bin| {
        below += bins[bin];
        10 * below > hops
    });
    let floor = floor.filter(|_| 10 * silent <= hops);
    let contrast = floor.map_or(f64::INFINITY, |floor| decibels(active / power(floor)));
    Some(Level { level: decibels(factor * active), contrast })
}

fn decibels(power: f64) -> f64 {
    10.0 * power.logarithm_10()
}

/// A gain for each channel, and the reasons for gains other than one.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    gains: [f32; MAX_CHANNELS],
    channels: usize,
    /// Differences from a plain recording; each is worth one line of output.
    pub findings: Vec<Finding>,
}

impl Gains {
    fn scale(&mut self, gain: f32) {
        self.gains.iter_mut().for_each(|channel| *channel *= gain);
    }

    /// Factor of each channel, applied before their mean.
    pub fn channels(&self) -> &[f32] {
        &self.gains[..self.channels]
    }

    /// Multiplies interleaved samples by the gains; samples of a plain recording stay unchanged.
    pub fn apply(&self, interleaved: &mut [f32]) {
        if self.channels().iter().all(|&gain| gain == 1.0) {
            return;
        }
        for frame in interleaved.chunks_exact_mut(self.channels) {
            for (sample, gain) in frame.iter_mut().zip(self.gains) {
                *sample *= gain;
            }
        }
    }
}

/// Reason for a channel gain other than one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Finding {
    /// Channels cancel each other in their mean, and some were inverted.
    Opposite,
    /// Only the channel in front of the listener is used.
    Centre {
        /// Number of the channel, from 0.
        channel: usize,
    },
    /// Float samples are at the scale of 16-bit integers.
    Integers {
        /// The largest sample.
        peak: f64,
    },
    /// Speech is far from its nominal level.
    Level {
        /// Measured level, in dB of full scale.
        level: f64,
        /// Whether the level is changed to the nominal one; noise is not changed.
        is_heard: bool,
    },
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Opposite => f.write_str("its channels cancel each other: some have inverted polarity"),
            Self::Centre { channel } => write!(f, "only its centre channel, number {}, is used", channel + 1),
            Self::Integers { peak } => {
                write!(
                    f,
                    "its samples are floats up to {peak:.0}: scaled as 16-bit integers, whose full scale is 32768"
                )
            }
            Self::Level { level, is_heard: true } => {
                write!(f, "its speech is at {level:.0} dB of full scale: adjusted to {NOMINAL:.0} dB")
            }
            Self::Level { level, is_heard: false } => {
                write!(f, "it is quiet, {level:.0} dB of full scale, without distinct speech: level left unchanged")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: usize = 16_000;

    /// Two seconds of syllables and pauses at -20 dB of full scale.
    fn speech() -> Vec<f32> {
        let syllable = |i: usize| if i % 4000 < 2500 { (i as f32 * 0.06).sin() * 0.14 } else { 0.0 };
        (0..2 * RATE).map(|i| syllable(i) + (i as f32 * 1.7).sin() * 1e-4).collect()
    }

    fn noise(i: usize) -> f32 {
        let i = u32::try_from(i).unwrap();
        let bits = i.wrapping_mul(2_654_435_761).wrapping_mul(i | 1);
        (bits >> 8) as f32 / 8_388_608.0 - 1.0
    }

    fn gains<const N: usize>(samples: &[f32], channels: [f32; N], centre: Option<usize>) -> Gains {
        let mut meter = Meter::new(N, RATE);
        let frames = samples.iter().enumerate();
        let all: Vec<f32> = frames.flat_map(|(i, &x)| channels.map(|gain| gain * x + noise(i) * 1e-5)).collect();
        meter.push(&all[..N * 1234]);
        meter.push(&all[N * 1234..]);
        let mut whole = Meter::new(N, RATE);
        whole.push(&all);
        let gains = meter.gains(centre);
        assert_eq!(whole.gains(centre), gains, "cut into two blocks");
        gains
    }

    #[test]
    fn plain_recordings_keep_their_bits() {
        let speech = speech();
        for scale in [0.3, 1.0, 10.0] {
            let loud: Vec<f32> = speech.iter().map(|x| x * scale).collect();
            for found in [gains(&loud, [1.0], None), gains(&loud, [1.0, 0.0], None), gains(&loud, [1.0, 0.8], None)] {
                assert!(found.channels().iter().all(|&gain| gain == 1.0) && found.findings.is_empty(), "{found:?}");
            }
        }
        let silence = gains(&[0.0; RATE], [0.0], None);
        assert_eq!(silence.channels(), [1.0]);
        let mut block = speech.clone();
        gains(&speech, [1.0], None).apply(&mut block);
        assert_eq!(block, speech);
    }

    #[test]
    fn opposite_channels_are_turned_over() {
        let speech = speech();
        for (channels, signs) in [([1.0, -1.0], [1.0, -1.0]), ([-0.7, 0.6], [1.0, -1.0])] {
            let found = gains(&speech, channels, None);
            assert_eq!((found.channels(), &found.findings[..]), (&signs[..], &[Finding::Opposite][..]));
        }
        let quiet: Vec<f32> = speech.iter().map(|x| x / 256.0).collect();
        let found = gains(&quiet, [1.0, -1.0], None);
        assert_eq!(found.channels(), [128.0, -128.0]);
        assert!(matches!(found.findings[..], [Finding::Opposite, Finding::Level { is_heard: true, .. }]));
    }

    #[test]
    fn the_centre_alone_is_heard_where_it_speaks() {
        let speech = speech();
        let found = gains(&speech, [0.1, 0.1, 1.0, 0.0, 0.0, 0.0], Some(2));
        assert_eq!(found.channels(), [0.0, 0.0, 6.0, 0.0, 0.0, 0.0]);
        // A silent centre is not used, and two channels have no centre.
        for found in [gains(&speech, [1.0, 1.0, 0.0], Some(2)), gains(&speech, [1.0, 1.0], Some(1))] {
            assert!(found.findings.is_empty(), "{found:?}");
        }
    }

    #[test]
    fn speech_far_from_its_level_is_brought_there() {
        let speech = speech();
        for (scale, gain) in [(100.0, 1.0 / 256.0), (1.0 / 64.0, 32.0), (1.0 / 256.0, 128.0)] {
            let other: Vec<f32> = speech.iter().map(|x| x * scale).collect();
            let found = gains(&other, [1.0], None);
            assert_eq!(found.channels(), [gain], "{:?}", found.findings);
            assert!(found.findings[0].to_string().ends_with("adjusted to -26 dB"));
        }
        let integers: Vec<f32> = speech.iter().map(|x| x * 32768.0).collect();
        let found = gains(&integers, [1.0], None);
        assert_eq!(found.channels(), [1.0 / 32768.0]);
        assert!(matches!(found.findings[..], [Finding::Integers { peak: 4000.0..5000.0 }]), "{:?}", found.findings);
        // A tenth of the recording speaks.
        let quiet = speech.iter().map(|x| x / 64.0).chain((0..18 * RATE).map(|i| noise(i) * 1e-5)).collect::<Vec<_>>();
        assert_eq!(gains(&quiet, [1.0], None).channels(), [32.0]);
    }

    #[test]
    fn quiet_noise_stays_quiet_and_is_said() {
        let hiss: Vec<f32> = (0..2 * RATE).map(|i| noise(i) * 1e-3).collect();
        let found = gains(&hiss, [1.0], None);
        assert_eq!(found.channels(), [1.0]);
        assert!(found.findings[0].to_string().contains("left unchanged"), "{:?}", found.findings);
    }
}
