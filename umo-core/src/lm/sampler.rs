//! Which code follows from logits: greedy, or drawn by a generator that depends on (seed, chunk, position) alone, so
//! that neither threads nor other sessions nor the split of the audio change it (SPEC 2.5).

use crate::config::Sampling;
use crate::state::{StateError, StatePass};

/// Draws codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampler {
    /// Temperature, top-k, top-p.
    pub sampling: Sampling,
    /// Seed of the draws.
    pub seed: u64,
}

impl Sampler {
    /// The likeliest code, always.
    pub const GREEDY: Self = Self { sampling: Sampling { temperature: 0.0, top_k: 0, top_p: 1.0 }, seed: 0 };

    /// Describes the sampler; it takes numbers of any value.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the bits of a float fit 32, and no more codes are kept than there are"
    )]
    pub(crate) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("seed", &mut self.seed, u64::MAX)?;
        let Sampling { temperature, top_k, top_p } = &mut self.sampling;
        pass.f32s(std::slice::from_mut(temperature))?;
        pass.f32s(std::slice::from_mut(top_p))?;
        let kept = pass.word(*top_k as u64)?;
        if pass.loads() {
            *top_k = kept as usize;
        }
        Ok(())
    }

    /// The code for `logits`, ties to the lower one. `order` is scratch, as long as `logits`.
    ///
    /// Temperature, then top-k (logits equal to the k-th stay), then top-p (the likeliest whose sum reaches it), as
    /// Hugging Face's `generate` orders them.
    #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
    pub fn sample(&self, logits: &[f32], order: &mut [u16], chunk: u64, position: u32) -> usize {
        let Sampling { temperature, top_k, top_p } = self.sampling;
        let order = &mut order[..logits.len()];
        order.iter_mut().enumerate().for_each(|(i, slot)| *slot = i as u16);
        let logit = |code: u16| logits[usize::from(code)];
        order.sort_unstable_by(|&a, &b| logit(b).total_cmp(&logit(a)).then(a.cmp(&b)));
        let Some(&best) = order.first() else { return 0 };
        if temperature <= 0.0 {
            return usize::from(best);
        }
        let mut kept = order.len();
        if (1..kept).contains(&top_k) {
            let least = logit(order[top_k - 1]);
            kept = order.partition_point(|&code| logit(code) >= least);
        }
        let weight = |code: u16| ((f64::from(logit(code)) - f64::from(logit(best))) / f64::from(temperature)).exp();
        let mut total: f64 = order[..kept].iter().map(|&code| weight(code)).sum();
        if top_p < 1.0 {
            let (wanted, mut sum, mut count) = (f64::from(top_p) * total, 0.0, 0);
            while count < kept && (count == 0 || sum < wanted) {
                sum += weight(order[count]);
                count += 1;
            }
            (kept, total) = (count, sum);
        }
        let draw = uniform(self.seed, chunk, position) * total;
        let mut sum = 0.0;
        for &code in &order[..kept] {
            sum += weight(code);
            if draw < sum {
                return usize::from(code);
            }
        }
        usize::from(order[kept - 1])
    }
}

/// A number in `0..1` of 53 bits that depends on its arguments alone: Philox 4x32-10 (Salmon et al. 2011) with the seed
/// as key and chunk and position as counter.
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64-bit words are what is wanted")]
#[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64")]
fn uniform(seed: u64, chunk: u64, position: u32) -> f64 {
    const SCALE: f64 = 1.0 / (1_u64 << 53) as f64;
    let counter = [chunk as u32, (chunk >> 32) as u32, position, 0];
    let [low, high, ..] = philox(counter, [seed as u32, (seed >> 32) as u32]);
    let bits = ((u64::from(high) << 32) | u64::from(low)) >> 11;
    bits as f64 * SCALE
}

/// Ten rounds of Philox 4x32.
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64-bit products are what is wanted")]
fn philox(mut c: [u32; 4], mut key: [u32; 2]) -> [u32; 4] {
    for _ in 0..10 {
        let first = u64::from(c[0]) * 0xD251_1F53;
        let second = u64::from(c[2]) * 0xCD9E_8D57;
        c = [(second >> 32) as u32 ^ c[1] ^ key[0], second as u32, (first >> 32) as u32 ^ c[3] ^ key[1], first as u32];
        key = [key[0].wrapping_add(0x9E37_79B9), key[1].wrapping_add(0xBB67_AE85)];
    }
    c
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The known answers that Random123 publishes for philox4x32-10.
    #[test]
    fn philox_gives_the_published_answers() {
        assert_eq!(philox([0; 4], [0; 2]), [0x6627_e8d5, 0xe169_c58d, 0xbc57_ac4c, 0x9b00_dbd8]);
        assert_eq!(philox([u32::MAX; 4], [u32::MAX; 2]), [0x408f_276d, 0x41c8_3b0e, 0xa20b_c7c6, 0x6d54_51fd]);
        let counter = [0x243f_6a88, 0x85a3_08d3, 0x1319_8a2e, 0x0370_7344];
        assert_eq!(philox(counter, [0xa409_3822, 0x299f_31d0]), [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
    }

    #[test]
    fn greedy_takes_the_lowest_of_equals() {
        let mut order = [0; 4];
        assert_eq!(Sampler::GREEDY.sample(&[0.0, 2.0, 2.0, 1.0], &mut order, 0, 0), 1);
    }

    #[test]
    fn draws_follow_the_probabilities_of_the_kept_codes() {
        const DRAWS: u32 = 40_000;
        let logits = [0.3_f32, 0.1, 0.4, 0.15, 0.05].map(f32::ln);
        let cases = [
            (Sampling { temperature: 1.0, top_k: 0, top_p: 1.0 }, [0.3, 0.1, 0.4, 0.15, 0.05]),
            (Sampling { temperature: 1.0, top_k: 2, top_p: 1.0 }, [3.0 / 7.0, 0.0, 4.0 / 7.0, 0.0, 0.0]),
            (Sampling { temperature: 1.0, top_k: 0, top_p: 0.8 }, [6.0 / 17.0, 0.0, 8.0 / 17.0, 3.0 / 17.0, 0.0]),
            (Sampling { temperature: 0.5, top_k: 2, top_p: 1.0 }, [9.0 / 25.0, 0.0, 16.0 / 25.0, 0.0, 0.0]),
        ];
        for (sampling, wanted) in cases {
            let (mut counts, mut order) = ([0_u32; 5], [0; 5]);
            for draw in 0..DRAWS {
                let sampler = Sampler { sampling, seed: 7 };
                counts[sampler.sample(&logits, &mut order, u64::from(draw / 20), draw % 20)] += 1;
            }
            for (count, wanted) in counts.iter().zip(wanted) {
                let share = f64::from(*count) / f64::from(DRAWS);
                // Four standard deviations of a share of that many draws.
                assert!((share - wanted).abs() <= 4.0 * (0.25 / f64::from(DRAWS)).sqrt(), "{sampling:?}: {counts:?}");
            }
        }
    }
}
