//! The reference: one row at a time.

/// Quantizes one row and returns its scale.
pub(crate) fn quantize(row: &[f32], codes: &mut [i8]) -> f32 {
    let Some((per_unit, scale)) = per_unit(largest(row)) else {
        codes.fill(0);
        return 1.0;
    };
    round(row, per_unit, codes);
    scale
}

/// The largest absolute value.
pub(super) fn largest(row: &[f32]) -> f32 {
    row.iter().fold(0.0, |max, x| max.max(x.abs()))
}

/// The nearest codes, ties to even.
#[expect(clippy::cast_possible_truncation, reason = "rounded values lie in -127..=127")]
pub(super) fn round(row: &[f32], per_unit: f32, codes: &mut [i8]) {
    for (code, x) in codes.iter_mut().zip(row) {
        *code = (x * per_unit).round_ties_even() as i8;
    }
}

/// The reciprocal of the scale, and the scale, of a row whose largest absolute value is `max`;
/// `None` for a row of zeros.
#[inline]
pub(super) fn per_unit(max: f32) -> Option<(f32, f32)> {
    let per_unit = 127.0 / max;
    // Also `None` if a denormal maximum makes the quotient infinite: such a row is zero to any
    // relevant precision.
    per_unit.is_finite().then_some((per_unit, max / 127.0))
}
