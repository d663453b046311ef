//! Random numbers and smooth noise, determined by a seed, a stream and a counter or time.

use umo_core_base::functions::Functions;
use umo_core_base::random::philox;

/// Purpose of a draw: draws of different streams are independent.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stream(pub(super) u32);

/// Returns a number in `0..1` that depends only on the arguments.
#[expect(clippy::cast_possible_truncation, reason = "taking halves of 64-bit words is intended")]
pub(super) fn uniform(seed: u64, stream: Stream, counter: u64) -> f32 {
    // The last word is 0 in the sampler's draws, and 1 here.
    let words = [counter as u32, (counter >> 32) as u32, stream.0, 1];
    let [bits, ..] = philox(words, [seed as u32, (seed >> 32) as u32]);
    (bits >> 8) as f32 / (1 << 24) as f32
}

/// Returns four numbers in `0..1`, as [`uniform`].
#[expect(clippy::cast_possible_truncation, reason = "taking halves of 64-bit words is intended")]
fn uniforms(seed: u64, stream: Stream, counter: u64) -> [f32; 4] {
    let words = [counter as u32, (counter >> 32) as u32, stream.0, 1];
    philox(words, [seed as u32, (seed >> 32) as u32]).map(|bits| (bits >> 8) as f32 / (1 << 24) as f32)
}

/// Returns a number of mean 0 and standard deviation 1, from two uniform numbers of the counter.
pub(super) fn normal(seed: u64, stream: Stream, counter: u64) -> f32 {
    let [a, b, ..] = uniforms(seed, stream, counter);
    (-2.0 * a.max(1e-6).logarithm()).sqrt() * (std::f32::consts::TAU * b).cosine()
}

/// Returns four smooth noise values at a time: mean 0, standard deviation 0.4, at most 1 in magnitude,
/// with about `rate` direction changes per second.
pub(super) fn smooth(seed: u64, stream: Stream, seconds: f64, rate: f64) -> [f32; 4] {
    let at = seconds * rate;
    let cell = at.floor();
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a stream is shorter than 2^63 cells")]
    let knots = |offset: f64| uniforms(seed, stream, (cell + offset + 4.0) as u64);
    #[expect(clippy::cast_possible_truncation, reason = "a share")]
    let t = (at - cell) as f32;
    // Uniform cubic B-spline: continuous up to the second derivative.
    let (t2, t3, u) = (t * t, t * t * t, 1.0 - t);
    let weights =
        [u * u * u, 3.0 * t3 - 6.0 * t2 + 4.0, -3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0, t3].map(|weight| weight / 6.0);
    let mut sums = [0.0; 4];
    for (weight, offset) in weights.into_iter().zip([-1.0, 0.0, 1.0, 2.0]) {
        let knots = knots(offset);
        for (sum, knot) in sums.iter_mut().zip(knots) {
            *sum += weight * (2.0 * knot - 1.0);
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_depends_on_its_arguments_alone_and_is_continuous() {
        let value = |i: u32| smooth(7, Stream(3), f64::from(i) / 300.0, 1.0)[0];
        let values: Vec<f32> = (0..30_000).map(value).collect();
        assert_eq!(value(1234).to_bits(), values[1234].to_bits());
        assert!(values.windows(2).all(|pair| (pair[1] - pair[0]).abs() < 0.02));
        let mean = values.iter().sum::<f32>() / values.len() as f32;
        assert!(mean.abs() < 0.1, "{mean}");
        assert!(values.iter().any(|&v| v > 0.3) && values.iter().any(|&v| v < -0.3));
        let variance = values.iter().map(|v| v * v).sum::<f32>() / values.len() as f32;
        assert!((variance.sqrt() - 0.4).abs() < 0.06, "{variance}");
        let [a, b, c, d] = smooth(7, Stream(3), 1.5, 1.0);
        assert!(a != b && b != c && c != d);
        assert!(smooth(8, Stream(3), 1.5, 1.0) != smooth(7, Stream(3), 1.5, 1.0));
        assert!(smooth(7, Stream(4), 1.5, 1.0) != smooth(7, Stream(3), 1.5, 1.0));
    }
}
