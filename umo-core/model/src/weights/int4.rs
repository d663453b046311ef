//! Int4 weights of a model file: quantization of rows, and their encoding.
//!
//! ```text
//! weight[row, i] = scale[row] * multiplier[row, i / 32] * code[row, i]     -15..=15, -8..=7
//! ```
//! The product of multiplier and code is an int8 value: products compute with these, whether weights are stored as
//! int4 or int8.

use umo_kernels::pack::{CODES_I4, GROUP, MAX_MULTIPLIER, NIBBLE_OFFSET};

/// Candidate steps, as fractions of the step that maps a group's largest value to the last code: smaller ones clip
/// it, and are finer for all other values.
const FRACTIONS: [f32; 11] = [1.15, 1.07, 1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6];

/// Candidate multipliers of the row's largest step: one below the maximum may suit the other groups better.
const LARGEST: [f32; 3] = [15.0, 14.5, 14.0];

/// Number of groups in a row of `inputs` weights.
pub(super) const fn groups(inputs: usize) -> usize {
    inputs.div_ceil(GROUP)
}

/// Bytes of the codes of a row of `inputs` weights.
pub(super) const fn row_bytes(inputs: usize) -> usize {
    inputs.div_ceil(2)
}

/// Packs two codes into a byte of the file, the first in the low nibble.
pub(super) fn byte(codes: &[i8]) -> u8 {
    let nibble = |code: i8| (code + NIBBLE_OFFSET).cast_unsigned();
    codes.iter().rev().fold(0, |byte, &code| byte << 4 | nibble(code))
}

/// Code `i` of a row.
pub(super) fn code(row: &[u8], i: usize) -> i8 {
    (row[i / 2] >> (4 * (i % 2)) & 15).cast_signed() - NIBBLE_OFFSET
}

/// Quantizes one row so that the sum of squared errors, each weighted by the `importance` of its input, is small.
/// Every group has its own step; the row's scale is the one that fits all codes best. Returns the scale; 1 for an
/// all-zero row.
pub fn quantize_row(row: &[f32], importance: &[f32], codes: &mut [i8], multipliers: &mut [i8]) -> f32 {
    assert!(codes.len() == row.len() && multipliers.len() == groups(row.len()), "a row with its groups");
    assert!(importance.len() == row.len(), "an importance of every input");
    let parts = || row.chunks(GROUP).zip(importance.chunks(GROUP));
    let mut steps = Vec::with_capacity(multipliers.len());
    steps.extend(parts().map(best_step));
    let largest = steps.iter().fold(0.0_f32, |largest, step| largest.max(step.abs()));
    if largest == 0.0 {
        codes.fill(0);
        multipliers.fill(0);
        return 1.0;
    }
    let mut least = f32::INFINITY;
    let mut scale = 1.0;
    for multiplier in LARGEST {
        let (first, refined) = (largest / multiplier, fitted_scale(parts(), &steps, largest / multiplier));
        for candidate in [first, refined] {
            let error = parts().zip(&steps).map(|(group, &step)| best_multiplier(group, step, candidate).1);
            let error = error.sum();
            if error < least {
                (least, scale) = (error, candidate);
            }
        }
    }
    let groups = parts().zip(codes.chunks_mut(GROUP)).zip(multipliers).zip(&steps);
    for (((group, codes), multiplier), &step) in groups {
        (*multiplier, _) = best_multiplier(group, step, scale);
        let per_step = reciprocal(scale * f32::from(*multiplier));
        for (code, &value) in codes.iter_mut().zip(group.0) {
            *code = to_code(value * per_step);
        }
    }
    scale
}

/// Values of a group, and the importance of each.
type Group<'a> = (&'a [f32], &'a [f32]);

/// The step, of either sign, whose codes approximate a group best; 0 for a group of zeros.
fn best_step(group: Group) -> f32 {
    let (mut positive, mut negative) = (0.0_f32, 0.0_f32);
    for &value in group.0 {
        (positive, negative) = (positive.max(value), negative.max(-value));
    }
    let largest = positive.max(negative);
    // Negative codes reach further: they go to the side of the largest value, unless the other sign fits better.
    let sign = if negative >= positive { 1.0 } else { -1.0 };
    let (mut least, mut best) = (f32::INFINITY, 0.0);
    for fraction in FRACTIONS {
        for (sign, last) in [(sign, CODES_I4.0), (-sign, CODES_I4.1)] {
            let step = sign * fraction * largest / f32::from(last.unsigned_abs());
            let error = error(group, step);
            if error < least {
                (least, best) = (error, step);
            }
        }
    }
    best
}

/// The scale that best fits, in least squares, the codes that `scale` gives.
fn fitted_scale<'a>(groups: impl Iterator<Item = Group<'a>>, steps: &[f32], scale: f32) -> f32 {
    let (mut product, mut square) = (0.0, 0.0);
    for (group, &step) in groups.zip(steps) {
        let (multiplier, _) = best_multiplier(group, step, scale);
        let multiplier = f32::from(multiplier);
        let per_step = reciprocal(scale * multiplier);
        for (&value, importance) in group.0.iter().zip(group.1) {
            let units = multiplier * round(value * per_step);
            (product, square) = (product + importance * value * units, square + importance * units * units);
        }
    }
    if square > 0.0 { product / square } else { scale }
}

/// The multiplier near `step / scale` with the least error, and that error.
#[expect(clippy::cast_possible_truncation, reason = "clamped to the range of a multiplier")]
fn best_multiplier(group: Group, step: f32, scale: f32) -> (i8, f32) {
    let limit = f32::from(MAX_MULTIPLIER);
    let near = (step / scale).clamp(-limit, limit);
    let mut best = (0, f32::INFINITY);
    for multiplier in [near.floor(), near.ceil()] {
        let error = error(group, scale * multiplier);
        if error < best.1 {
            best = (multiplier as i8, error);
        }
    }
    best
}

/// Sum of a group's squared errors for one step, weighted by importance.
fn error((group, importance): Group, step: f32) -> f32 {
    let per_step = reciprocal(step);
    let square = |(&value, &importance): (&f32, &f32)| {
        let error = value - step * round(value * per_step);
        importance * (error * error)
    };
    // Eight sums, so that it vectorizes.
    let ((eights, tail), (importances, rest)) = (group.as_chunks::<8>(), importance.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (values, importances) in eights.iter().zip(importances) {
        for ((sum, value), importance) in sums.iter_mut().zip(values).zip(importances) {
            *sum += square((value, importance));
        }
    }
    sums.iter().sum::<f32>() + tail.iter().zip(rest).map(square).sum::<f32>()
}

/// Reciprocal of a step; 0 for 0, since all codes are then 0.
fn reciprocal(step: f32) -> f32 {
    let reciprocal = step.recip();
    if reciprocal.is_finite() { reciprocal } else { 0.0 }
}

/// The nearest code to `value`, ties to even.
fn round(value: f32) -> f32 {
    // Floats of this magnitude are spaced by one.
    const UNIT: f32 = 12_582_912.0;
    value.clamp(f32::from(CODES_I4.0), f32::from(CODES_I4.1)) + UNIT - UNIT
}

#[expect(clippy::cast_possible_truncation, reason = "rounded to a code")]
fn to_code(value: f32) -> i8 {
    round(value) as i8
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dequantized(row: &[f32]) -> Vec<f32> {
        let (mut codes, mut multipliers) = (vec![0; row.len()], vec![0; groups(row.len())]);
        let scale = quantize_row(row, &vec![1.0; row.len()], &mut codes, &mut multipliers);
        assert!(codes.iter().all(|code| (CODES_I4.0..=CODES_I4.1).contains(code)));
        assert!(multipliers.iter().all(|multiplier| multiplier.abs() <= MAX_MULTIPLIER));
        let value = |(i, &code): (usize, &i8)| scale * f32::from(multipliers[i / GROUP]) * f32::from(code);
        codes.iter().enumerate().map(value).collect()
    }

    fn noise(len: usize) -> Vec<f32> {
        let mut state = 1_u32;
        let mut uniform = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / 8_388_608.0 - 1.0
        };
        (0..len).map(|_| (0..6).map(|_| uniform()).sum::<f32>()).collect()
    }

    fn relative_error(row: &[f32], back: &[f32]) -> f32 {
        let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| v * v).sum::<f32>();
        (squares(&mut row.iter().zip(back).map(|(a, b)| a - b)) / squares(&mut row.iter().copied())).sqrt()
    }

    #[test]
    fn bytes_hold_two_codes() {
        let codes = [-8, 7, 0, -1, 5];
        let bytes: Vec<u8> = codes.chunks(2).map(byte).collect();
        assert_eq!(bytes, [0xf0, 0x78, 0x0d]);
        assert_eq!([0, 1, 2, 3, 4].map(|i| code(&bytes, i)), codes);
        assert_eq!((groups(65), row_bytes(65)), (3, 33));
    }

    #[test]
    fn values_that_are_codes_are_kept() {
        let row: Vec<f32> =
            (0..96).map(|i| [0.5, -0.25, 0.75][i / 32] * ((i * 7) % 16) as f32 - [4.0, -2.0, 6.0][i / 32]).collect();
        assert!(relative_error(&row, &dequantized(&row)) < 1e-6);
        assert_eq!(dequantized(&[0.0; 40]), [0.0; 40]);
        assert!(dequantized(&[]).is_empty());
        // A group of zeros beside others, and a row of one value.
        let row = [[0.0; GROUP], [1.0; GROUP]].concat();
        assert_eq!(dequantized(&row), row);
        assert!((dequantized(&[3.0])[0] - 3.0).abs() < 1e-6);
    }

    /// Rounding normal values with one 16-code step per group of 32 has an error of 8 to 9 %; with one step per row,
    /// as int8 has, twice that.
    #[test]
    fn errors_are_those_of_four_bits() {
        let row = noise(4096);
        let error = relative_error(&row, &dequantized(&row));
        assert!((0.07..0.09).contains(&error), "{error}");
        // Groups whose ranges differ by a factor of 8.
        let row: Vec<f32> = row.iter().enumerate().map(|(i, v)| v * [1.0, 2.0, 4.0, 8.0][i / GROUP % 4]).collect();
        let error = relative_error(&row, &dequantized(&row));
        assert!((0.07..0.1).contains(&error), "{error}");
    }

    /// More important values get the finer steps, at the cost of the others.
    #[test]
    fn important_values_have_smaller_errors() {
        let row = noise(512);
        let importance: Vec<f32> = (0..512).map(|i| if i % 8 == 0 { 100.0 } else { 1.0 }).collect();
        let errors = |importance: &[f32]| {
            let (mut codes, mut multipliers) = (vec![0; row.len()], vec![0; groups(row.len())]);
            let scale = quantize_row(&row, importance, &mut codes, &mut multipliers);
            let mut sums = [0.0, 0.0];
            for (i, (&value, &code)) in row.iter().zip(&codes).enumerate() {
                let error = value - scale * f32::from(multipliers[i / GROUP]) * f32::from(code);
                sums[usize::from(i % 8 == 0)] += error * error;
            }
            sums
        };
        let (even, weighted) = (errors(&[1.0; 512]), errors(&importance));
        assert!(weighted[1] < 0.7 * even[1] && weighted[0] > even[0], "{even:?} {weighted:?}");
    }

    #[test]
    fn extreme_rows_stay_finite() {
        for size in [f32::MIN_POSITIVE, 1e-40, 1e-20, 1e20, 1e38] {
            let row: Vec<f32> = noise(64).iter().map(|v| v * size).collect();
            assert!(dequantized(&row).iter().all(|v| v.is_finite()), "{size}");
        }
    }
}
