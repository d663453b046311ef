//! The low-pass of the body's motion (SPEC 2.8): a Gaussian over decoded rows.

use std::ops::Range;

use crate::error::LoadError;

/// Frames on each side that the widest filter reads: what smoothing can add to the latency.
const MAX_RADIUS: usize = 3;
/// Most rows that smoothing reads before the row that was put out last, and holds back.
pub(super) const MAX_PAST: usize = MAX_RADIUS + 1;

/// Widest standard deviation, frames: beyond it the tails that a radius of 3 cuts off count.
pub const MAX_SMOOTHING: f32 = 1.5;

/// A Gaussian that is cut off at two standard deviations. Near the ends of a stream the weights of
/// the rows that exist are scaled to sum to 1.
#[derive(Clone, Copy, Debug)]
pub struct Smoothing {
    /// By distance in frames; the middle's is 1.
    weights: [f32; MAX_RADIUS + 1],
    radius: usize,
}

impl Smoothing {
    /// Rows as they are.
    pub const OFF: Self = Self { weights: [1.0, 0.0, 0.0, 0.0], radius: 0 };

    /// With a standard deviation of `sigma` frames, 0 for [`Self::OFF`].
    ///
    /// # Errors
    /// [`LoadError::Config`] if `sigma` is not within 0 to [`MAX_SMOOTHING`].
    pub fn new(sigma: f32) -> Result<Self, LoadError> {
        if !(0.0..=MAX_SMOOTHING).contains(&sigma) {
            let found = format!("expected 0 to {MAX_SMOOTHING}, got {sigma}");
            return Err(LoadError::config("smoothing", found));
        }
        if sigma == 0.0 {
            return Ok(Self::OFF);
        }
        let sigma = f64::from(sigma);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "1 to 3, and weights up to 1")]
        Ok(Self {
            weights: std::array::from_fn(|distance| (-0.5 * (distance as f64 / sigma).powi(2)).exp() as f32),
            radius: ((2.0 * sigma).ceil() as usize).clamp(1, MAX_RADIUS),
        })
    }

    /// Rows on each side that a row depends on: so many frames are held back at least.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Rows before the row that was put out last that a seam reads: those that the row before it
    /// depends on, for how fast the seam grows.
    pub(super) fn past(&self) -> usize {
        if self.radius == 0 { 0 } else { self.radius + 1 }
    }

    /// Makes `out` the weighted mean of the rows around `index` out of those in `there`; the row
    /// itself, to the last bit, where smoothing is off.
    pub(super) fn apply<'a>(
        &self,
        index: usize,
        there: Range<usize>,
        row: impl Fn(usize) -> &'a [f32],
        out: &mut [f32],
    ) {
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
        // What is left of white noise's third difference: the root of the sum of squares of the
        // kernel's third difference over that of (1, -3, 3, -1), which is 20.
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
        // One row differs: its neighbours move towards it, equally on both sides; rows beyond the
        // radius do not.
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
