//! Equalization of the channels between two products, so that one channel with a large range does not coarsen
//! the int8 codes of all others.
//!
//! If a channel passes from the rows of one weight to the columns of the next through nothing but products and sums
//! (T5's `wi_1` to `wo`, and values to the attention's output), its rows may be divided and its columns multiplied by
//! any factor without changing the function. The factor that makes both ranges equal balances their errors (Nagel et
//! al. 2019, "Data-Free Quantization Through Weight Equalization and Bias Correction", section 4.1). Powers of two
//! leave the mantissas of float weights unchanged.

use umo_core::LoadError;

/// Reads a tensor by name and shape.
type Read<'a> = &'a dyn Fn(&str, &[usize]) -> Result<Vec<f32>, LoadError>;

/// Limit of the factors, `2^-LIMIT..=2^LIMIT`, so that nearly unused channels are not amplified.
const LIMIT: i32 = 12;

/// Prefixes of the networks whose layers have such pairs.
const NETWORKS: [&str; 2] = ["lm.", "depth."];

/// Suffixes of the weight that produces the channels and of the one that consumes them.
const PAIRS: [(&str, &str); 2] = [(".wi_1.weight", ".wo.weight"), (".v.weight", ".o.weight")];

/// Equalizes `values`, the tensor `name`, if it belongs to a pair whose second weight will be int8; `read`
/// reads the other weight.
pub(super) fn apply(
    read: Read<'_>,
    name: &str,
    shape: &[usize],
    int8: &dyn Fn(&str) -> bool,
    values: &mut [f32],
) -> Result<(), LoadError> {
    if !NETWORKS.iter().any(|network| name.starts_with(network)) || shape.len() != 2 {
        return Ok(());
    }
    let other = |from: &str, to: &str| name.strip_suffix(from).map(|stem| format!("{stem}{to}"));
    for (generator, taker) in PAIRS {
        if let Some(taker) = other(generator, taker).filter(|taker| int8(taker)) {
            let taken = read(&taker, &[shape[1], shape[0]])?;
            let factors = factors(values, &taken, shape[0]);
            for (row, factor) in values.chunks_exact_mut(shape[1]).zip(factors) {
                row.iter_mut().for_each(|v| *v *= factor);
            }
        } else if let Some(generator) = other(taker, generator).filter(|_| int8(name)) {
            let made = read(&generator, &[shape[1], shape[0]])?;
            let factors = factors(&made, values, shape[1]);
            for row in values.chunks_exact_mut(shape[1]) {
                row.iter_mut().zip(&factors).for_each(|(v, factor)| *v /= factor);
            }
        }
    }
    Ok(())
}

/// Returns the factors that multiply the rows of `made [channels, _]` and divide the columns of `taken [_, channels]`.
fn factors(made: &[f32], taken: &[f32], channels: usize) -> Vec<f32> {
    let mut ranges = vec![0.0_f32; channels];
    for row in taken.chunks_exact(channels) {
        ranges.iter_mut().zip(row).for_each(|(range, v)| *range = range.max(v.abs()));
    }
    let rows = made.chunks_exact((made.len() / channels.max(1)).max(1));
    let range = |row: &[f32]| row.iter().fold(0.0_f32, |a, v| a.max(v.abs()));
    rows.zip(ranges).map(|(row, taken)| factor(range(row), taken)).collect()
}

/// Returns the power of two nearest to `sqrt(taken / made)`.
#[expect(clippy::cast_possible_truncation, reason = "an exponent of a float")]
fn factor(made: f32, taken: f32) -> f32 {
    if made == 0.0 || taken == 0.0 {
        return 1.0;
    }
    let exponent = 0.5 * (f64::from(taken).log2() - f64::from(made).log2());
    2.0_f32.powi((exponent.round() as i32).clamp(-LIMIT, LIMIT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_make_ranges_equal() {
        assert_eq!(factor(8.0, 2.0), 0.5);
        assert_eq!(factor(0.25, 64.0), 16.0);
        assert_eq!(factor(1.0, 1.3), 1.0);
        assert_eq!(factor(0.0, 3.0), 1.0);
        assert_eq!(factor(1e-30, 1e30), 4096.0);
        // Three channels: produced by rows of two, consumed by columns of two.
        assert_eq!(factors(&[1.0, -4.0, 0.5, 0.0, 0.0, 2.0], &[1.0, 8.0, 0.0, -0.5, 4.0, 0.0], 3), [0.5, 4.0, 1.0]);
    }
}
