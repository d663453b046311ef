//! Each thread's share of a job, in proportion to the speed of its core. The unit is the even share.

use std::time::Duration;

/// Shortest time of a piece that shows a thread's speed: shorter ones are below the clock's resolution.
const MIN_MEASURABLE: Duration = Duration::from_micros(5);
/// Step of one job from a thread's share towards the one that would have ended all pieces at once; small, because a
/// job may have been interrupted.
const LEARNING_RATE: f32 = 0.0625;
/// Lower bound of a thread's share, in even shares, so that a return to speed can be measured.
const MIN_SHARE: f32 = 0.2;
/// Ratio of shares below which they count as equal: an even division, the same every time, is worth a few percent.
const IMBALANCE_THRESHOLD: f32 = 1.25;

/// Computes where each thread's piece of `granules` ends, from the shares.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "no more than `granules`")]
#[expect(clippy::cast_precision_loss, reason = "granules are far below 2^24")]
pub(super) fn cut(shares: &[f32], granules: usize, ends: &mut [usize]) {
    let threads = shares.len();
    let (least, most) = shares.iter().fold((f32::MAX, 0.0_f32), |(least, most), &s| (least.min(s), most.max(s)));
    if most < least * IMBALANCE_THRESHOLD {
        let share = granules.div_ceil(threads);
        return ends.iter_mut().enumerate().for_each(|(i, end)| *end = ((i + 1) * share).min(granules));
    }
    let (all, mut sum) = (shares.iter().sum::<f32>(), 0.0);
    for (end, share) in ends.iter_mut().zip(shares) {
        sum += share;
        *end = ((granules as f32 * (sum / all)).round() as usize).min(granules);
    }
    ends[threads - 1] = granules;
}

/// Granules per piece of a dynamic schedule, out of `granules`; 0 if there are too few.
pub(super) fn dynamic_chunk(granules: usize) -> usize {
    if granules < 12 { 0 } else { (granules / 24).max(1) }
}

/// Moves shares towards those that would have made all of `times` equal; threads without a piece have time zero.
/// Returns whether the times were long enough to learn from.
pub(super) fn learn(shares: &mut [f32], times: &[Duration]) -> bool {
    if times.iter().all(|&time| time < MIN_MEASURABLE) {
        return false;
    }
    let worked = || times.iter().filter(|time| !time.is_zero());
    let mean = worked().map(Duration::as_secs_f32).sum::<f32>() / worked().count().max(1) as f32;
    for (share, time) in shares.iter_mut().zip(times).filter(|(_, time)| !time.is_zero()) {
        *share *= 1.0 + LEARNING_RATE * ((mean / time.as_secs_f32()).clamp(0.5, 2.0) - 1.0);
    }
    let all = shares.iter().sum::<f32>() / shares.len() as f32;
    shares.iter_mut().for_each(|share| *share = (*share / all).max(MIN_SHARE));
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_cut_by_shares() {
        let cut = |shares: &[f32], granules| {
            let mut ends = vec![0; shares.len()];
            super::cut(shares, granules, &mut ends);
            ends
        };
        assert_eq!(cut(&[1.0, 1.0], 24), [12, 24]);
        assert_eq!(cut(&[1.1, 0.9], 24), [12, 24]);
        assert_eq!(cut(&[1.5, 0.5], 24), [18, 24]);
        assert_eq!(cut(&[0.2, 1.8], 4), [0, 4]);
        assert_eq!(cut(&[1.0; 4], 6), [2, 4, 6, 6]);
        assert_eq!(cut(&[0.5, 1.0, 1.5], 12), [2, 6, 12]);
        assert_eq!(cut(&[1.5, 0.5], 0), [0, 0]);
        let shares: Vec<f32> = (1..=64).map(|i| i as f32 / 32.5).collect();
        for granules in 0..300 {
            let ends = cut(&shares, granules);
            assert!(ends.is_sorted() && ends[63] == granules);
        }
    }

    #[test]
    fn shares_follow_the_threads_speeds() {
        // Thread 1 runs at half speed, then at full speed again.
        let mut shares = [1.0; 2];
        for (speed, want) in [(0.5, 4.0 / 3.0), (1.0, 1.0)] {
            for _ in 0..200 {
                let times = [shares[0], shares[1] / speed].map(|time| Duration::from_secs_f32(1e-4 * time));
                learn(&mut shares, &times);
            }
            assert!((shares[0] - want).abs() < 0.01, "{shares:?}");
        }
        // An interruption, however long, costs at most a 32nd before normalization, and a share never vanishes.
        learn(&mut shares, &[Duration::from_micros(10), Duration::from_secs(10)]);
        assert!(shares[1] > 0.9, "{shares:?}");
        for _ in 0..400 {
            learn(&mut shares, &[Duration::from_nanos(1), Duration::from_secs(10)]);
        }
        assert!(shares[1] >= MIN_SHARE / 2.0, "{shares:?}");
        // A thread that had nothing to do keeps its share.
        shares = [1.25, 0.75];
        learn(&mut shares, &[Duration::from_micros(10), Duration::ZERO]);
        assert_eq!(shares, [1.25, 0.75]);
    }
}
