//! Low-pass filter of the body's motion (SPEC 2.8): a Gaussian over decoded rows.

use std::ops::Range;
use umo_core_base::functions::Functions;

use umo_core_base::error::LoadError;

/// Radius of the widest filter in frames: the maximum latency that smoothing adds.
const MAX_RADIUS: usize = 3;
/// Upper bound on the rows that smoothing reads before the last emitted row, and on the rows that it holds
/// back.
pub(super) const MAX_PAST: usize = MAX_RADIUS + 1;

/// Largest standard deviation, in frames. Above it, truncation at a radius of 3 would be noticeable.
pub const MAX_SMOOTHING: f32 = 1.5;

/// A Gaussian truncated at two standard deviations. Near the ends of a stream, the weights of the existing
/// rows are scaled to sum to 1.
#[derive(Clone, Copy, Debug)]
pub struct Smoothing {
    /// Unnormalised weights by distance in frames; the centre's is 1.
    weights: [f32; MAX_RADIUS + 1],
    radius: usize,
}

impl Smoothing {
    /// No smoothing: rows stay unchanged.
    pub const OFF: Self = Self { weights: [1.0, 0.0, 0.0, 0.0], radius: 0 };

    /// Creates a filter with a standard deviation of `sigma` frames; 0 gives [`Self::OFF`].
    ///
    /// # Errors
    /// [`LoadError::Argument`] if `sigma` is not within 0 to [`MAX_SMOOTHING`].
    pub fn new(sigma: f32) -> Result<Self, LoadError> {
        if !(0.0..=MAX_SMOOTHING).contains(&sigma) {
            let found = format!("expected 0 to {MAX_SMOOTHING}, got {sigma}");
            return Err(LoadError::argument("smoothing", found));
        }
        if sigma == 0.0 {
            return Ok(Self::OFF);
        }
        let sigma = f64::from(sigma);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 3, and weights up to 1")]
        Ok(Self {
            weights: std::array::from_fn(|distance| (-0.5 * (distance as f64 / sigma).powi(2)).exponential() as f32),
            radius: ((2.0 * sigma).ceil() as usize).clamp(1, MAX_RADIUS),
        })
    }

    /// Number of rows on each side that a row depends on. At least as many frames are held back.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Number of rows before the last emitted row that a seam reads. They are the ones that the row before it
    /// depends on, and give the rate of the seam's growth.
    pub(super) fn past(&self) -> usize {
        if self.radius == 0 { 0 } else { self.radius + 1 }
    }

    /// Sets `out` to the weighted mean of the rows around `index` that lie within `there`. If smoothing is
    /// off, `out` is the row itself, bit for bit.
    pub fn apply<'a>(&self, index: usize, there: Range<usize>, row: impl Fn(usize) -> &'a [f32], out: &mut [f32]) {
        out.copy_from_slice(&row(index)[..out.len()]);
        let mut sum = self.weights[0];
        for distance in 1..=self.radius {
            let weight = self.weights[distance];
            for other in [index.checked_sub(distance), Some(index + distance)].into_iter().flatten() {
                if there.contains(&other) {
                    sum += weight;
                    out.iter_mut().zip(row(other)).for_each(|(out, &value)| *out += weight * value);
                }
            }
        }
        if self.radius > 0 {
            let scale = 1.0 / sum;
            out.iter_mut().for_each(|out| *out *= scale);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filtered(sigma: f32, rows: &[[f32; 2]]) -> Vec<[f32; 2]> {
        let smoothing = Smoothing::new(sigma).unwrap();
        let one = |index| {
            let mut out = [0.0; 2];
            smoothing.apply(index, 0..rows.len(), |row| &rows[row], &mut out);
            out
        };
        (0..rows.len()).map(one).collect()
    }

    /// Standard deviation of the third difference.
    fn jerk(rows: &[[f32; 2]]) -> f32 {
        let third = rows.windows(4).map(|w| w[3][0] - 3.0 * w[2][0] + 3.0 * w[1][0] - w[0][0]);
        (third.map(|v| v * v).sum::<f32>() / rows.len() as f32).sqrt()
    }

    #[test]
    fn off_keeps_every_bit() {
        let rows = [[0.1, f32::MIN_POSITIVE], [-0.0, 3.0], [7.25, -1e30]];
        assert_eq!(filtered(0.0, &rows).as_flattened(), rows.as_flattened());
        assert_eq!(Smoothing::new(0.0).unwrap().radius(), 0);
    }

    #[test]
    fn noise_loses_the_jerk_that_the_filter_says() {
        let mut state = 1_u32;
        let mut noise = || {
            state = state.wrapping_mul(747_796_405).wrapping_add(2_891_336_453);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        let rows: Vec<[f32; 2]> = (0..4000).map(|_| [noise(), 0.0]).collect();
        // Remaining fraction of white noise's third difference: the root of the sum of squares of the
        // kernel's third difference, over that of (1, -3, 3, -1), which is 20.
        for (sigma, most) in [(0.5_f32, 0.7), (1.0, 0.13), (1.5, 0.05)] {
            let radius = Smoothing::new(sigma).unwrap().radius();
            let kernel: Vec<f64> = (0..2 * radius + 7)
                .map(|i| i as f64 - radius as f64 - 3.0)
                .map(|d| if d.abs() <= radius as f64 { (-0.5 * (d / f64::from(sigma)).powi(2)).exp() } else { 0.0 })
                .collect();
            let sum: f64 = kernel.iter().sum();
            let third = kernel.windows(4).map(|w| (w[3] - 3.0 * w[2] + 3.0 * w[1] - w[0]) / sum);
            let wanted = (third.map(|v| v * v).sum::<f64>() / 20.0).sqrt();
            let found = f64::from(jerk(&filtered(sigma, &rows)) / jerk(&rows));
            assert!((found / wanted - 1.0).abs() < 0.1, "sigma {sigma}: {found}, not {wanted}");
            assert!(found < most, "sigma {sigma}: {found}");
        }
    }

    #[test]
    fn constants_and_ends_keep_their_level() {
        let mut rows = vec![[2.0, -0.5]; 9];
        for row in filtered(1.5, &rows) {
            assert!((row[0] - 2.0).abs() < 1e-6 && (row[1] + 0.5).abs() < 1e-6);
        }
        // One row differs: its neighbours move towards it, equally on both sides. Rows beyond the radius do
        // not.
        rows[4][0] = 3.0;
        let out = filtered(1.0, &rows);
        assert!(out[4][0] > out[3][0] && out[3][0] > out[2][0] && out[2][0] > 2.01);
        assert!((out[3][0] - out[5][0]).abs() < 1e-6 && (out[1][0] - 2.0).abs() < 1e-6);
    }

    #[test]
    fn a_width_that_is_none_is_refused() {
        for sigma in [-0.1, 1.6, f32::NAN, f32::INFINITY] {
            assert!(Smoothing::new(sigma).unwrap_err().to_string().contains("smoothing"), "{sigma}");
        }
    }
}
