//! Interpolation between keys.

/// Minimum-jerk step from 0 to 1: speed and acceleration are 0 at both ends.
pub(super) fn ease(t: f32) -> f32 {
    let t = t.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

/// Returns the value at `t` of `N` curves through keys in order of time; before the first and after the
/// last key, that key's value.
///
/// A curve stops at a key where it changes direction, and passes other keys at the harmonic mean of the
/// adjacent slopes, so that no value leaves the range of the keys around it. Speed is continuous, and
/// acceleration is 0 at keys.
pub(super) fn through<const N: usize, K>(
    keys: &[K],
    time: impl Fn(&K) -> f32,
    values: impl Fn(&K) -> [f32; N],
    t: f32,
) -> [f32; N] {
    let after = keys.iter().position(|key| time(key) > t).unwrap_or(keys.len());
    let (Some(from), Some(to)) = (after.checked_sub(1).and_then(|at| keys.get(at)), keys.get(after)) else {
        let nearest = keys.get(after.min(keys.len().saturating_sub(1)));
        return nearest.map_or([0.0; N], values);
    };
    let length = time(to) - time(from);
    let s = (t - time(from)) / length;
    let before = after.checked_sub(2).and_then(|at| keys.get(at));
    let beyond = keys.get(after + 1);
    let slope = |a: &K, b: &K| -> [f32; N] {
        let (from, to, seconds) = (values(a), values(b), time(b) - time(a));
        std::array::from_fn(|i| (to[i] - from[i]) / seconds)
    };
    let here = slope(from, to);
    let start = before.map_or([0.0; N], |key| joined(slope(key, from), here));
    let end = beyond.map_or([0.0; N], |key| joined(here, slope(to, key)));
    let (a, b) = (values(from), values(to));
    let (cube, fourth, fifth) = (s * s * s, s * s * s * s, s * s * s * s * s);
    let rise = 10.0 * cube - 15.0 * fourth + 6.0 * fifth;
    let leave = s - 6.0 * cube + 8.0 * fourth - 3.0 * fifth;
    let arrive = -4.0 * cube + 7.0 * fourth - 3.0 * fifth;
    std::array::from_fn(|i| a[i] + (b[i] - a[i]) * rise + length * (start[i] * leave + end[i] * arrive))
}

/// Returns the speed at a key between two slopes: their harmonic mean, 0 if their signs differ.
fn joined<const N: usize>(before: [f32; N], after: [f32; N]) -> [f32; N] {
    std::array::from_fn(|i| {
        let product = before[i] * after[i];
        if product > 0.0 { 2.0 * product / (before[i] + after[i]) } else { 0.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(keys: &[(f32, f32)], t: f32) -> f32 {
        through(keys, |key| key.0, |key| [key.1], t)[0]
    }

    #[test]
    fn curves_pass_their_keys_and_stay_between_them() {
        let keys = [(0.0, 0.0), (0.2, 1.0), (0.5, 3.0), (0.9, 2.0), (1.0, 2.0)];
        for (t, value) in keys {
            assert!((at(&keys, t) - value).abs() < 1e-5);
        }
        assert_eq!((at(&keys, -1.0), at(&keys, 2.0)), (0.0, 2.0));
        for pair in keys.windows(2) {
            let (low, high) = (pair[0].1.min(pair[1].1), pair[0].1.max(pair[1].1));
            for step in 0..=20 {
                let t = pair[0].0 + (pair[1].0 - pair[0].0) * step as f32 / 20.0;
                assert!((low - 1e-4..=high + 1e-4).contains(&at(&keys, t)), "{t}: {}", at(&keys, t));
            }
        }
        // Speed has no jumps.
        let speed = |t: f32| (at(&keys, t + 5e-4) - at(&keys, t - 5e-4)) / 1e-3;
        let speeds: Vec<f32> = (1..999).map(|i| speed(i as f32 / 1000.0)).collect();
        assert!(speeds.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.5));
        assert_eq!(at(&[], 0.3), 0.0);
    }

    #[test]
    fn an_ease_has_level_ends() {
        assert_eq!((ease(-1.0), ease(0.0), ease(0.5), ease(1.0), ease(3.0)), (0.0, 0.0, 0.5, 1.0, 1.0));
        assert!(ease(0.01) < 2e-5 && ease(0.99) > 1.0 - 2e-5);
    }
}
