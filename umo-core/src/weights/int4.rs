//! Int4 weights of a model file: how rows are quantized, and what a file says of them.
//!
//! ```text
//! weight[row, i] = scale[row] * multiplier[row, i / 32] * code[row, i]     -15..=15, -8..=7
//! ```
//! The product of multiplier and code is an int8 value: a product computes with these, whether they
//! are stored as int4 or int8.

use umo_kernels::pack::{CODES_I4, GROUP, MAX_MULTIPLIER, NIBBLE_OFFSET};

/// Fractions of the step with which a group's largest value is the last code: smaller steps clip it,
/// and are finer for all others.
const FRACTIONS: [f32; 11] = [1.15, 1.07, 1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7, 0.65, 0.6];

/// Multipliers that the row's largest step may have: others than the largest may fit the other groups
/// better.
const LARGEST: [f32; 3] = [15.0, 14.5, 14.0];

/// Groups of a row of `inputs` weights.
pub(super) const fn groups(inputs: usize) -> usize {
    inputs.div_ceil(GROUP)
}

/// Bytes of the codes of a row of `inputs` weights.
pub(super) const fn row_bytes(inputs: usize) -> usize {
    inputs.div_ceil(2)
}

/// Two codes as a byte of the file, the first in the low nibble.
pub(super) fn byte(codes: &[i8]) -> u8 {
    let nibble = |code: i8| (code + NIBBLE_OFFSET).cast_unsigned();
    codes.iter().rev().fold(0, |byte, &code| byte << 4 | nibble(code))
}

/// Code `i` of a row.
pub(super) fn code(row: &[u8], i: usize) -> i8 {
    (row[i / 2] >> (4 * (i % 2)) & 15).cast_signed() - NIBBLE_OFFSET
}

/// Quantizes one row, so that the sum of the squares of its errors is small, each times the `importance` of its
/// input: every group has a step of its own, and the row's scale is the one that fits all codes best. Returns
/// the scale; that of an all-zero row is 1.
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

/// Values of a group with the importance of each.
type Group<'a> = (&'a [f32], &'a [f32]);

/// The step, of either sign, whose codes are nearest to the values of a group; 0 of a group of zeros.
fn best_step(group: Group) -> f32 {
    let (mut positive, mut negative) = (0.0_f32, 0.0_f32);
    for &value in group.0 {
        (positive, negative) = (positive.max(value), negative.max(-value));
    }
    let largest = positive.max(negative);
    // The negative codes reach further: to the side of the largest value, unless the other wins.
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

/// The scale that fits the codes which `scale` would give best, in least squares.
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

/// The multiplier beside `step / scale` with the least error, and the error.
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

/// Sum of the squares of a group's errors at one step, times their importance.
fn error((group, importance): Group, step: f32) -> f32 {
    let per_step = reciprocal(step);
    let square = |(&value, &importance): (&f32, &f32)| {
        let error = value - step * round(value * per_step);
        importance * (error * error)
    };
    // Eight sums, which the compiler computes side by side.
    let ((eights, tail), (importances, rest)) = (group.as_chunks::<8>(), importance.as_chunks::<8>());
    let mut sums = [0.0; 8];
    for (values, importances) in eights.iter().zip(importances) {
        for ((sum, value), importance) in sums.iter_mut().zip(values).zip(importances) {
            *sum += square((value, importance));
        }
    }
    sums.iter().sum::<f32>() + tail.iter().zip(rest).map(square).sum::<f32>()
}

/// 0 of 0: all codes are 0 then.
fn reciprocal(step: f32) -> f32 {
    let reciprocal = step.recip();
    if reciprocal.is_finite() { reciprocal } else { 0.0 }
}

/// The nearest code to `value`, ties to even.
fn round(value: f32) -> f32 {
    // Numbers of this size are a unit apart.
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

    /// Rounding normal values with one step of 16 codes per group of 32 costs 8 to 9 %; with one step per
    /// row, as int8 has, twice as much.
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

    /// Where some values matter more, they get the finer steps at the cost of the others.
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
