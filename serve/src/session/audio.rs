//! A client's audio that waits for the engine, and its pacing.

use std::collections::VecDeque;
use std::time::Duration;

use tokio::time::Instant;

use super::opus::Packets;

/// Format of a client's binary messages.
#[derive(Debug)]
enum Input {
    /// Samples, split at any byte.
    Pcm {
        /// First byte of a sample whose second byte has not arrived.
        half: Option<u8>,
    },
    /// One packet per message.
    Opus(Box<Packets>),
}

/// Buffer of samples from a client's messages.
#[derive(Debug)]
pub(super) struct Audio {
    input: Input,
    waiting: VecDeque<i16>,
    /// Leading samples still to drop, as a restored session already has them.
    skip: usize,
    /// Number of buffered samples at which reading stops.
    room: usize,
    rate_limit: Option<RateLimit>,
    /// Number of samples that the session took, that an interrupt dropped, or that were skipped.
    pub(super) used: u64,
}

impl Audio {
    /// Creates a buffer for audio of `rate` Hz: Opus if a decoder is given, otherwise PCM.
    pub(super) fn new((rate, opus): (usize, Option<Packets>), buffer: Duration, ahead: Duration, now: Instant) -> Self {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a day at most, and positive")]
        let room = (buffer.as_secs_f64() * rate as f64) as usize;
        let rate_limit = (!ahead.is_zero()).then(|| RateLimit::new(rate, ahead, now));
        let input = opus.map_or(Input::Pcm { half: None }, |packets| Input::Opus(Box::new(packets)));
        Self { input, waiting: VecDeque::new(), skip: 0, room, rate_limit, used: 0 }
    }

    /// Sets the number of leading samples to drop.
    pub(super) fn skip(mut self, samples: usize) -> Self {
        self.skip = samples;
        self
    }

    /// Adds the bytes of a message.
    pub(super) fn extend(&mut self, bytes: &[u8]) -> Result<(), String> {
        let waiting = &mut self.waiting;
        match &mut self.input {
            Input::Pcm { half } => {
                let mut bytes = bytes.iter().copied();
                while let Some(low) = half.take().or_else(|| bytes.next()) {
                    let Some(high) = bytes.next() else {
                        *half = Some(low);
                        break;
                    };
                    waiting.push_back(i16::from_le_bytes([low, high]));
                }
            }
            Input::Opus(packets) => packets.packet(bytes, |samples| waiting.extend(samples))?,
        }
        self.drop_skipped();
        Ok(())
    }

    /// Conceals `packets` lost before the next one.
    pub(super) fn lose(&mut self, packets: u32) -> Result<(), String> {
        let waiting = &mut self.waiting;
        match &mut self.input {
            Input::Pcm { .. } => return Err("lost: only Opus has packets that can be lost".to_owned()),
            Input::Opus(decoder) => decoder.lose(packets, |samples| waiting.extend(samples))?,
        }
        self.drop_skipped();
        Ok(())
    }

    /// Marks the end of the audio.
    pub(super) fn finish(&mut self) -> Result<(), String> {
        let waiting = &mut self.waiting;
        if let Input::Opus(packets) = &mut self.input {
            packets.finish(|samples| waiting.extend(samples))?;
        }
        self.drop_skipped();
        Ok(())
    }

    fn drop_skipped(&mut self) {
        let dropped = self.skip.min(self.waiting.len());
        self.waiting.drain(..dropped);
        self.skip -= dropped;
        self.used += dropped as u64;
    }

    /// Whether there is room for more audio.
    pub(super) fn has_room(&self) -> bool {
        self.waiting.len() < self.room
    }

    pub(super) fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Drops all buffered samples.
    pub(super) fn clear(&mut self) {
        self.used += self.waiting.len() as u64;
        self.waiting.clear();
        match &mut self.input {
            Input::Pcm { half } => *half = None,
            Input::Opus(packets) => packets.clear(),
        }
    }

    /// Passes the samples that may be computed now to `push`, which returns the number it took. Returns their
    /// total.
    pub(super) fn push<E>(
        &mut self,
        now: Instant,
        mut push: impl FnMut(&[i16]) -> Result<usize, E>,
    ) -> Result<usize, E> {
        let mut all = 0;
        let mut allowed = self.rate_limit.as_mut().map_or(usize::MAX, |rate_limit| rate_limit.allowed(now));
        while allowed > 0 && !self.waiting.is_empty() {
            let samples = self.waiting.as_slices().0;
            let samples = &samples[..samples.len().min(allowed)];
            let (offered, taken) = (samples.len(), push(samples)?);
            self.waiting.drain(..taken);
            if let Some(rate_limit) = &mut self.rate_limit {
                rate_limit.spend(taken);
            }
            self.used += taken as u64;
            all += taken;
            allowed -= taken;
            if taken < offered {
                break;
            }
        }
        Ok(all)
    }
}

/// Rate limit of computing: real time, with an allowance ahead.
#[derive(Debug)]
struct RateLimit {
    rate: f64,
    most: f64,
    credit: f64,
    at: Instant,
}

impl RateLimit {
    fn new(rate: usize, ahead: Duration, now: Instant) -> Self {
        let most = ahead.as_secs_f64() * rate as f64;
        Self { rate: rate as f64, most, credit: most, at: now }
    }

    fn allowed(&mut self, now: Instant) -> usize {
        let passed = now.saturating_duration_since(self.at).as_secs_f64();
        self.at = now;
        self.credit = (self.credit + passed * self.rate).min(self.most);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a day at most; never below 0")]
        let allowed = self.credit.max(0.0) as usize;
        allowed
    }

    fn spend(&mut self, samples: usize) {
        self.credit -= samples as f64;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SECOND: Duration = Duration::from_secs(1);

    fn take_all(audio: &mut Audio, now: Instant) -> Vec<i16> {
        let mut taken = Vec::new();
        audio
            .push(now, |samples| {
                taken.extend_from_slice(samples);
                Ok::<_, ()>(samples.len())
            })
            .unwrap();
        taken
    }

    #[test]
    fn bytes_are_samples_in_whatever_pieces_they_come() {
        let now = Instant::now();
        let samples: Vec<i16> = (0..400).map(|i| i * 81 - 16_000).collect();
        let bytes: Vec<u8> = samples.iter().flat_map(|sample| sample.to_le_bytes()).collect();
        for piece in [1, 2, 3, 7, 800] {
            let mut audio = Audio::new((16_000, None), SECOND, Duration::ZERO, now);
            bytes.chunks(piece).for_each(|piece| audio.extend(piece).unwrap());
            assert_eq!(take_all(&mut audio, now), samples, "pieces of {piece}");
            assert_eq!(audio.used, 400);
            assert!(matches!(audio.input, Input::Pcm { half: None }));
        }
    }

    #[test]
    fn a_recording_that_comes_at_once_is_computed_at_its_own_pace() {
        let now = Instant::now();
        let mut audio = Audio::new((8_000, None), 30 * SECOND, 2 * SECOND, now);
        audio.extend(&vec![0; 2 * 80_000]).unwrap();
        assert_eq!(take_all(&mut audio, now).len(), 16_000);
        assert_eq!(take_all(&mut audio, now).len(), 0);
        assert_eq!(take_all(&mut audio, now + SECOND / 2).len(), 4_000);
        // A pause earns no more credit than the allowance ahead.
        assert_eq!(take_all(&mut audio, now + 60 * SECOND).len(), 16_000);
        assert!(!audio.is_empty());
        audio.clear();
        assert_eq!(audio.used, 80_000);
    }

    #[test]
    fn what_the_engine_does_not_take_waits_and_what_waits_is_bounded() {
        let now = Instant::now();
        let mut audio = Audio::new((8_000, None), SECOND, Duration::ZERO, now);
        audio.extend(&vec![0; 2 * 7_999]).unwrap();
        assert!(audio.has_room());
        audio.extend(&[0; 2]).unwrap();
        assert!(!audio.has_room());
        assert_eq!(audio.push(now, |_| Ok::<_, ()>(100)), Ok(100));
        assert_eq!((audio.waiting.len(), audio.used), (7_900, 100));
        assert_eq!(audio.push(now, |_| Err(())), Err(()));
        assert_eq!(audio.waiting.len(), 7_900);
    }

    #[test]
    fn samples_that_a_state_knows_are_skipped_and_count_as_used() {
        let now = Instant::now();
        let mut audio = Audio::new((8_000, None), SECOND, Duration::ZERO, now).skip(5);
        for sample in 0_i16..8 {
            audio.extend(&sample.to_le_bytes()).unwrap();
        }
        assert_eq!((take_all(&mut audio, now), audio.used), (vec![5, 6, 7], 8));
        assert!(audio.lose(1).unwrap_err().contains("Opus"));
    }
}
