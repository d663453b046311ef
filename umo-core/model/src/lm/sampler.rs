//! Selection of a code from logits: greedy, or sampled by a counter-based generator. A draw depends on (seed,
//! chunk, position) alone, so threads, other sessions and the splitting of the audio do not change it (SPEC
//! 2.5).

use umo_core_base::functions::Functions;
use umo_core_base::random::philox;
use umo_core_base::state::{StateError, StatePass};

use crate::config::Sampling;

/// Number of weights that a draw computes only once: enough for the codes usually kept.
const HELD: usize = 64;

/// Samples codes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampler {
    /// Temperature, top-k, top-p.
    pub sampling: Sampling,
    /// Seed of the draws.
    pub seed: u64,
    /// Frequency of gestures, 0 to 1: 0.25 leaves the model as it is.
    pub activity: f32,
    /// How far the motion follows the voice's arousal, 0 to 1; 0 leaves the model as it is.
    pub expression: f32,
}

/// The [`Sampler::activity`] of the people that a model learned from.
pub(crate) const USUAL_ACTIVITY: f32 = 0.25;

impl Sampler {
    /// Always selects the code with the largest logit.
    pub const GREEDY: Self = Self {
        sampling: Sampling { temperature: 0.0, top_k: 0, top_p: 1.0 },
        seed: 0,
        activity: USUAL_ACTIVITY,
        expression: 0.0,
    };

    /// Returns the sampler of a part that may have its own `sampling`. That replaces this sampler's, unless
    /// this one is greedy.
    #[must_use]
    pub fn of(self, own: Option<Sampling>) -> Self {
        match own {
            Some(sampling) if self.sampling.temperature > 0.0 => Self { sampling, ..self },
            _ => self,
        }
    }

    /// Describes the sampler's state; all values are valid.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "the bits of a float fit 32, and no more codes are kept than there are"
    )]
    #[doc(hidden)]
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("seed", &mut self.seed, u64::MAX)?;
        let Sampling { temperature, top_k, top_p } = &mut self.sampling;
        pass.f32s(std::slice::from_mut(temperature))?;
        pass.f32s(std::slice::from_mut(top_p))?;
        let kept = pass.word(*top_k as u64)?;
        if pass.loads() {
            *top_k = kept as usize;
        }
        pass.within(&mut self.activity, 0.0..=1.0)?;
        pass.within(&mut self.expression, 0.0..=1.0)
    }

    /// Samples a code from `logits`; ties go to the lower code. `ranks` is scratch of at least the length of
    /// `logits`.
    ///
    /// Applies temperature, then top-k (ties with the k-th logit stay), then top-p (the smallest set of
    /// likeliest codes whose sum reaches it), in the order of Hugging Face's `generate`.
    #[doc(hidden)]
    pub fn sample(&self, logits: &[f32], ranks: &mut [Rank], chunk: u64, position: u32) -> usize {
        self.sample_at(logits, ranks, chunk, [position, 0])
    }

    /// Like [`Self::sample`], with a draw identified by two numbers within the chunk.
    pub(crate) fn sample_at(&self, logits: &[f32], ranks: &mut [Rank], chunk: u64, place: [u32; 2]) -> usize {
        let Sampling { temperature, top_k, top_p } = self.sampling;
        let ranks = &mut ranks[..logits.len()];
        ranks.iter_mut().zip(logits).enumerate().for_each(|(code, (rank, &logit))| *rank = Rank::new(code, logit));
        if temperature <= 0.0 || ranks.is_empty() {
            return ranks.iter().min().copied().map_or(0, Rank::code);
        }
        let mut kept = ranks.len();
        if (1..kept).contains(&top_k) {
            // Sorting all codes would take as long as a product of the depth network.
            let last = *ranks.select_nth_unstable(top_k - 1).1;
            let is_zero = |rank: Rank| logits[rank.code()] == 0.0;
            kept = top_k;
            for at in top_k..ranks.len() {
                // The rest of the codes have no larger logit.
                if ranks[at].order() == last.order() || (is_zero(last) && is_zero(ranks[at])) {
                    ranks.swap(kept, at);
                    kept += 1;
                }
            }
        }
        let ranks = &mut ranks[..kept];
        ranks.sort_unstable();
        let largest = f64::from(logits[ranks[0].code()]);
        let computed =
            |rank: &Rank| ((f64::from(logits[rank.code()]) - largest) / f64::from(temperature)).exponential();
        let mut held = [0.0; HELD];
        held.iter_mut().zip(&*ranks).for_each(|(held, rank)| *held = computed(rank));
        let weight = |at: usize| held.get(at).copied().unwrap_or_else(|| computed(&ranks[at]));
        let mut total = (0..kept).map(weight).sum::<f64>();
        if top_p < 1.0 {
            let (wanted, mut sum, mut count) = (f64::from(top_p) * total, 0.0, 0);
            while count < kept && (count == 0 || sum < wanted) {
                sum += weight(count);
                count += 1;
            }
            (kept, total) = (count, sum);
        }
        let draw = uniform(self.seed, chunk, place) * total;
        let mut sum = 0.0;
        for (at, rank) in ranks[..kept].iter().enumerate() {
            sum += weight(at);
            if draw < sum {
                return rank.code();
            }
        }
        ranks[kept - 1].code()
    }
}

/// Sort key of a code: ascending keys are descending logits, in the order of [`f32::total_cmp`]; ties go to
/// the lower code.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
#[doc(hidden)]
pub struct Rank(u64);

impl Rank {
    #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
    fn new(code: usize, logit: f32) -> Self {
        let bits = logit.to_bits();
        let descending = if logit.is_sign_negative() { bits } else { !bits & !(1 << 31) };
        Self(u64::from(descending) << 32 | u64::from(code as u32))
    }

    /// Position of the logit in the order of all floats, largest first.
    fn order(self) -> u64 {
        self.0 >> 32
    }

    #[expect(clippy::cast_possible_truncation, reason = "the lower half is the code")]
    fn code(self) -> usize {
        self.0 as u32 as usize
    }
}

/// A uniform number in `0..1` with 53 bits that depends on its arguments alone: Philox 4x32-10 (Salmon et al.
/// 2011), with the seed as key, and chunk and place as counter.
#[expect(clippy::cast_possible_truncation, reason = "taking halves of 64-bit words is intended")]
#[expect(clippy::cast_precision_loss, reason = "53 bits fit an f64")]
fn uniform(seed: u64, chunk: u64, place: [u32; 2]) -> f64 {
    const SCALE: f64 = 1.0 / (1_u64 << 53) as f64;
    let counter = [chunk as u32, (chunk >> 32) as u32, place[0], place[1]];
    let [low, high, ..] = philox(counter, [seed as u32, (seed >> 32) as u32]);
    let bits = ((u64::from(high) << 32) | u64::from(low)) >> 11;
    bits as f64 * SCALE
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greedy_takes_the_lowest_of_equals() {
        let mut ranks = [Rank::default(); 4];
        assert_eq!(Sampler::GREEDY.sample(&[0.0, 2.0, 2.0, 1.0], &mut ranks, 0, 0), 1);
    }

    /// Reference implementation of a draw: sorts all codes, then selects the kept ones.
    fn sorted(sampler: &Sampler, logits: &[f32], chunk: u64, place: [u32; 2]) -> usize {
        let Sampling { temperature, top_k, top_p } = sampler.sampling;
        let mut order: Vec<usize> = (0..logits.len()).collect();
        order.sort_by(|&a, &b| logits[b].total_cmp(&logits[a]).then(a.cmp(&b)));
        if temperature <= 0.0 {
            return order[0];
        }
        if (1..order.len()).contains(&top_k) {
            let least = logits[order[top_k - 1]];
            order.retain(|&code| logits[code] >= least);
        }
        let largest = f64::from(logits[order[0]]);
        let weight = |&code: &usize| ((f64::from(logits[code]) - largest) / f64::from(temperature)).exp();
        let wanted = f64::from(top_p) * order.iter().map(weight).sum::<f64>();
        let (mut sum, mut count) = (0.0, 0);
        while top_p < 1.0 && count < order.len() && (count == 0 || sum < wanted) {
            sum += weight(&order[count]);
            count += 1;
        }
        order.truncate(if top_p < 1.0 { count } else { order.len() });
        let draw = uniform(sampler.seed, chunk, place) * order.iter().map(weight).sum::<f64>();
        let mut sum = 0.0;
        let found = order.iter().find(|code| {
            sum += weight(code);
            draw < sum
        });
        *found.unwrap_or(&order[order.len() - 1])
    }

    #[test]
    fn draws_are_those_of_all_codes_in_order() {
        let mut bits = [1, 2, 3, 4];
        let mut next = |limit: u32| {
            bits = philox(bits, [5, 6]);
            bits[0] % limit
        };
        for case in 0..3000 {
            let count = 1 + next(130) as usize;
            // More codes than `HELD`, with few distinct values, so that many are equal, including zeros of
            // both signs.
            let logits: Vec<f32> = (0..count).map(|_| (next(9) as f32 - 4.0) * [1.0, -1.0][next(2) as usize]).collect();
            let sampling = Sampling {
                temperature: [0.0, 0.7, 1.0][next(3) as usize],
                top_k: next(135) as usize,
                top_p: [1.0, 0.9, 0.4][next(3) as usize],
            };
            let (sampler, mut ranks) =
                (Sampler { sampling, seed: u64::from(next(100)), ..Sampler::GREEDY }, vec![Rank::default(); count]);
            let found = sampler.sample_at(&logits, &mut ranks, case, [7, 8]);
            assert_eq!(found, sorted(&sampler, &logits, case, [7, 8]), "{sampling:?}, {logits:?}");
        }
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
            let (mut counts, mut ranks) = ([0_u32; 5], [Rank::default(); 5]);
            for draw in 0..DRAWS {
                let sampler = Sampler { sampling, seed: 7, ..Sampler::GREEDY };
                counts[sampler.sample(&logits, &mut ranks, u64::from(draw / 20), draw % 20)] += 1;
            }
            for (count, wanted) in counts.iter().zip(wanted) {
                let share = f64::from(*count) / f64::from(DRAWS);
                // Four standard deviations of a share of `DRAWS` draws.
                assert!((share - wanted).abs() <= 4.0 * (0.25 / f64::from(DRAWS)).sqrt(), "{sampling:?}: {counts:?}");
            }
        }
    }
}
