//! Voices of a recording with a channel for each speaker: what a channel picks up of the other channels' speakers is
//! lowered (docs/converse.md).

/// Hops per second in which levels are compared.
const HOPS: usize = 100;
/// Hops over which a level is averaged.
const SPAN: usize = 5;
/// Level of a channel, relative to its loud parts, from which its speaker is certainly heard.
const LOUD: f64 = 0.03;
/// Share of the hops below a channel's loud parts.
const LOUD_SHARE: f64 = 0.95;
/// Share of the hops of a loud speaker in which the others are expected to be silent.
const SILENT_SHARE: f64 = 0.25;
/// Power above the leak, as a factor, that is a voice of the channel's own: 6 dB.
const OWN: f64 = 4.0;
/// Greatest power of a leak, relative to its source: -6 dB. A louder one means that both channels hear one room.
const MOST_LEAK: f64 = 0.25;
/// Hops for which a channel is open before and after loud parts of its own voice.
const BEFORE: usize = 5;
const AFTER: usize = 15;
/// Gain of a closed channel: -40 dB.
const CLOSED: f32 = 0.01;

/// Lowers the parts of each channel that are only the leak of another.
pub(super) fn attenuate(channels: &mut [Vec<f32>], rate: usize) {
    let hop = (rate / HOPS).max(1);
    let powers: Vec<Vec<f64>> = channels.iter().map(|channel| powers(channel, hop)).collect();
    let open: Vec<Vec<bool>> = (0..channels.len()).map(|own| held(&open(&powers, own), &powers[own])).collect();
    for (channel, open) in channels.iter_mut().zip(&open) {
        let gain = |hop: usize| if open.get(hop).or(open.last()).is_none_or(|open| *open) { 1.0 } else { CLOSED };
        for (at, sample) in channel.iter_mut().enumerate() {
            let (from, to) = (gain(at / hop), gain(at / hop + 1));
            *sample *= from + (to - from) * (at % hop) as f32 / hop as f32;
        }
    }
}

/// Mean power around each hop.
fn powers(channel: &[f32], hop: usize) -> Vec<f64> {
    let power = |samples: &[f32]| samples.iter().map(|x| f64::from(*x).powi(2)).sum::<f64>() / samples.len() as f64;
    let hops: Vec<f64> = channel.chunks(hop).map(power).collect();
    let around = |at: usize| &hops[at.saturating_sub(SPAN / 2)..(at + SPAN / 2 + 1).min(hops.len())];
    (0..hops.len()).map(|at| around(at).iter().sum::<f64>() / around(at).len() as f64).collect()
}

/// The hops in which a channel has a voice of its own, or nobody speaks.
fn open(powers: &[Vec<f64>], own: usize) -> Vec<bool> {
    let mut open = vec![true; powers[own].len()];
    for other in (0..powers.len()).filter(|&other| other != own) {
        let loud = LOUD * quantile(powers[other].clone(), LOUD_SHARE);
        let pairs = || powers[own].iter().zip(&powers[other]);
        let ratios: Vec<f64> = pairs().filter(|(_, other)| **other > loud).map(|(own, other)| own / other).collect();
        let leak = (OWN * quantile(ratios, SILENT_SHARE)).min(MOST_LEAK);
        for (open, (own, other)) in open.iter_mut().zip(pairs()) {
            *open &= *own >= leak * other;
        }
    }
    open
}

/// The value below which this share of the values is; 0 of none.
fn quantile(mut values: Vec<f64>, share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a length")]
    let at = (share * values.len() as f64) as usize;
    values.get(at).copied().unwrap_or(0.0)
}

/// Opens before and after loud parts of the own voice; between parts of a leak the channel stays closed.
fn held(open: &[bool], powers: &[f64]) -> Vec<bool> {
    let loud = LOUD * quantile(powers.to_vec(), LOUD_SHARE);
    let near = |at: usize, before: usize, after: usize| at.saturating_sub(before)..(at + after + 1).min(open.len());
    let is_voice = |at: usize| open[at] && powers[at] > loud;
    let is_held = |at: usize| near(at, AFTER, BEFORE).any(is_voice) || near(at, 1, 1).all(|at| open[at]);
    (0..open.len()).map(is_held).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: usize = 8000;

    /// Seconds of noise in words of 0.3 s with gaps of 0.1 s, of this size.
    fn voice(from: f32, to: f32, size: f32, seed: u32) -> Vec<f32> {
        let mut state = seed;
        let mut noise = move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        };
        let sample = |at: usize| {
            let (seconds, x) = (at as f32 / RATE as f32, noise());
            if (from..to).contains(&seconds) && seconds % 0.4 < 0.3 { size * x } else { 1e-4 * x }
        };
        (0..10 * RATE).map(sample).collect()
    }

    fn mixed(a: &[f32], b: &[f32], leak: f32) -> Vec<f32> {
        a.iter().zip(b).map(|(a, b)| a + leak * b).collect()
    }

    /// Level between two times, relative to the other signal's, dB.
    fn change(after: &[f32], before: &[f32], from: f32, to: f32) -> f64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place in ten seconds")]
        let [from, to] = [from, to].map(|seconds| (seconds * RATE as f32) as usize);
        let power = |x: &[f32]| x[from..to].iter().map(|x| f64::from(*x).powi(2)).sum::<f64>();
        10.0 * (power(after) / power(before)).log10()
    }

    #[test]
    fn a_leak_is_lowered_and_a_voice_is_kept() {
        let first = voice(0.0, 5.5, 0.3, 1);
        // A turn that overlaps, and a short word at a third of the size while the other speaks.
        let turn = voice(5.0, 10.0, 0.2, 2);
        let second: Vec<f32> = turn.iter().zip(voice(2.0, 2.3, 0.07, 3)).map(|(a, b)| a + b).collect();
        for leak in [0.02, 0.1, 0.2] {
            let before = [mixed(&first, &second, leak), mixed(&second, &first, leak)];
            let mut after = before.clone();
            attenuate(&mut after, RATE);
            let change = |channel: usize, from: f32, to: f32| change(&after[channel], &before[channel], from, to);
            assert!(change(1, 0.1, 1.8) < -30.0 && change(1, 2.7, 4.8) < -30.0, "{leak}: the leak of the first");
            assert!(change(0, 5.8, 9.9) < -30.0, "{leak}: the leak of the second");
            assert!(change(0, 0.0, 5.5).abs() < 0.1 && change(1, 5.0, 9.9).abs() < 0.1, "{leak}: the turns");
            if leak < 0.15 {
                assert!(change(1, 2.0, 2.3) > -1.0, "{leak}: the short word");
            }
        }
    }

    #[test]
    fn channels_of_one_signal_stay_as_they_are() {
        let one = voice(0.0, 10.0, 0.2, 5);
        let mut both = [one.clone(), one.clone()];
        attenuate(&mut both, RATE);
        assert!(both[0] == one && both[1] == one);
        let mut alone = [one.clone()];
        attenuate(&mut alone, RATE);
        assert!(alone[0] == one);
        attenuate(&mut [Vec::new(), Vec::new()], RATE);
    }
}
