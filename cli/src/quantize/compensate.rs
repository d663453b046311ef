//! Rounding with error compensation: the rounding error of one input's weight is subtracted from the weights of
//! the inputs not yet rounded, in proportion to their correlation with it.
//!
//! The correlations come from the Gram matrix `H` of the product's inputs. With the upper triangular
//! `U` of `U^T U = (H + damping)^-1`, after input `i` of a row `w` is rounded to `q`,
//! ```text
//! w[j] -= (w[i] - q) / U[i, i] * U[i, j]        j > i
//! ```
//! minimises the sum of the squared errors of the output (Frantar et al. 2023, "GPTQ: Accurate
//! Post-Training Quantization for Generative Pre-trained Transformers", section 3.3). The scales are chosen
//! beforehand, so the file and its products have the same format as with plain rounding.

/// Damping added to the diagonal, as a share of its mean. It keeps directions absent from the calibration
/// from absorbing all errors.
pub(super) const DAMPING: f64 = 0.01;

/// Rounding order of a product's inputs, and the factor of their inverse Gram matrix.
#[derive(Debug)]
pub(super) struct Compensation {
    order: Vec<usize>,
    /// `[inputs, inputs]`, upper triangular, in the rounding order.
    factor: Vec<f64>,
}

impl Compensation {
    /// Factors the Gram matrix `[order.len(), order.len()]`; `None` if it is all zeros because the product read
    /// nothing, not finite, or not positive definite.
    pub(super) fn new(gram: &[f64], order: Vec<usize>, damping: f64) -> Option<Self> {
        let k = order.len();
        let mean = (0..k).map(|i| gram[i * k + i]).sum::<f64>() / k as f64;
        // The negated comparison also catches NaN.
        if !(mean > 0.0 && mean.is_finite()) {
            return None;
        }
        let mut factor = vec![0.0; k * k];
        for (row, &i) in factor.chunks_exact_mut(k).zip(&order) {
            row.iter_mut().zip(&order).for_each(|(v, &j)| *v = gram[i * k + j]);
        }
        for i in 0..k {
            factor[i * k + i] += damping * mean;
        }
        decompose(&mut factor, k).then(|| invert(&mut factor, k))?;
        Some(Self { order, factor })
    }

    /// Like [`Self::new`], in descending order of input energy: the errors of the largest inputs weigh most, so
    /// more inputs remain to compensate them.
    pub(super) fn largest_first(gram: &[f64], inputs: usize, damping: f64) -> Option<Self> {
        let mut order: Vec<usize> = (0..inputs).collect();
        order.sort_by(|&a, &b| gram[b * inputs + b].total_cmp(&gram[a * inputs + a]));
        Self::new(gram, order, damping)
    }

    /// Returns the cost of each input's squared error, normalised to a mean of 1.
    #[expect(clippy::cast_possible_truncation, reason = "a weight among others")]
    pub(super) fn importance(&self) -> Vec<f32> {
        let k = self.order.len();
        let costs: Vec<f64> = (0..k).map(|at| self.factor[at * k + at].powi(-2)).collect();
        let mean = costs.iter().sum::<f64>() / k as f64;
        let mut importance = vec![0.0; k];
        self.order.iter().zip(costs).for_each(|(&input, cost)| importance[input] = (cost / mean) as f32);
        importance
    }

    /// Rounds one row of weights: `round` receives each input and its compensated weight, and returns the stored value.
    pub(super) fn round(&self, row: &[f32], mut round: impl FnMut(usize, f64) -> f64) {
        let k = self.order.len();
        let mut left: Vec<f64> = self.order.iter().map(|&i| f64::from(row[i])).collect();
        for (at, (&input, factors)) in self.order.iter().zip(self.factor.chunks_exact(k)).enumerate() {
            let error = (left[at] - round(input, left[at])) / factors[at];
            left[at + 1..].iter_mut().zip(&factors[at + 1..]).for_each(|(v, factor)| *v -= error * factor);
        }
    }
}

/// Replaces `matrix` by the upper triangular `R` of `R R^T = matrix`: a Cholesky decomposition from the last
/// row up. The inverse of `R` is the factor `U`. Returns false if the matrix is not positive definite.
fn decompose(matrix: &mut [f64], k: usize) -> bool {
    for j in (0..k).rev() {
        let pivot = matrix[j * k + j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        // Column j of R, above the diagonal, is read from row j of the symmetric matrix.
        let (above, rest) = matrix.split_at_mut(j * k);
        let column: Vec<f64> = rest[..j].iter().map(|v| v / root).collect();
        rest[j] = root;
        rest[..j].fill(0.0);
        for (i, row) in above.chunks_exact_mut(k).enumerate() {
            // Only the lower triangle of the remaining rows is kept up to date.
            row[..=i].iter_mut().zip(&column).for_each(|(v, other)| *v -= column[i] * other);
            row[j] = column[i];
        }
    }
    true
}

/// Inverts an upper triangular matrix in place.
fn invert(matrix: &mut [f64], k: usize) {
    let mut sum = vec![0.0; k];
    for i in (0..k).rev() {
        let (above, below) = matrix.split_at_mut((i + 1) * k);
        let row = &mut above[i * k..];
        // Row i of the inverse is a combination of the inverse's rows below.
        sum[i..].fill(0.0);
        for (j, other) in (i + 1..k).zip(below.chunks_exact(k)) {
            let factor = row[j];
            sum[j..].iter_mut().zip(&other[j..]).for_each(|(sum, v)| *sum += factor * v);
        }
        let pivot = row[i].recip();
        row[i] = pivot;
        row[i + 1..].iter_mut().zip(&sum[i + 1..]).for_each(|(v, sum)| *v = -pivot * sum);
    }
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    /// Results of `training/golden/compensation.py`, which computes the paper's formulas in PyTorch.
    #[derive(Deserialize)]
    struct Golden {
        inputs: usize,
        damping: f64,
        gram: Vec<f64>,
        weights: Vec<Vec<f32>>,
        steps: Vec<Vec<f64>>,
        cases: Vec<Case>,
    }

    #[derive(Deserialize)]
    struct Case {
        order: Option<Vec<usize>>,
        factor: Vec<f64>,
        codes: Vec<Vec<i32>>,
    }

    fn golden() -> Golden {
        serde_json::from_str(include_str!("compensate.json")).unwrap()
    }

    fn code(value: f64, step: f64) -> f64 {
        (value / step).round_ties_even().clamp(-8.0, 7.0)
    }

    #[test]
    fn codes_are_those_of_the_papers_formulas() {
        let golden = golden();
        let k = golden.inputs;
        let mut differ = 0;
        for case in golden.cases {
            let compensation = match case.order {
                Some(order) => {
                    let largest = Compensation::largest_first(&golden.gram, k, golden.damping).unwrap();
                    assert_eq!(largest.order, order);
                    largest
                }
                None => Compensation::new(&golden.gram, (0..k).collect(), golden.damping).unwrap(),
            };
            for (got, wanted) in compensation.factor.iter().zip(&case.factor) {
                assert!((got - wanted).abs() < 1e-9 * wanted.abs().max(1.0), "{got} {wanted}");
            }
            for ((row, steps), wanted) in golden.weights.iter().zip(&golden.steps).zip(&case.codes) {
                let mut codes = vec![0.0; k];
                compensation.round(row, |i, value| {
                    codes[i] = code(value, steps[i]);
                    codes[i] * steps[i]
                });
                let plain = row.iter().zip(steps).map(|(&v, &step)| code(v.into(), step));
                differ += plain.zip(&codes).filter(|(plain, code)| plain != *code).count();
                assert_eq!(codes, wanted.iter().copied().map(f64::from).collect::<Vec<_>>());
            }
        }
        assert!(differ > k, "plain rounding would pass: {differ} codes differ");
    }

    /// For correlated inputs, the output error is well below plain rounding's.
    #[test]
    fn errors_of_outputs_shrink() {
        let golden = golden();
        let k = golden.inputs;
        let compensation = Compensation::largest_first(&golden.gram, k, golden.damping).unwrap();
        let error = |row: &[f32], values: &[f64]| {
            let e: Vec<f64> = row.iter().zip(values).map(|(&a, b)| f64::from(a) - b).collect();
            (0..k * k).map(|at| e[at / k] * golden.gram[at] * e[at % k]).sum::<f64>()
        };
        let (mut plain, mut compensated) = (0.0, 0.0);
        for (row, steps) in golden.weights.iter().zip(&golden.steps) {
            let mut values: Vec<f64> = row.iter().zip(steps).map(|(&v, &step)| step * code(v.into(), step)).collect();
            plain += error(row, &values);
            compensation.round(row, |i, value| {
                values[i] = steps[i] * code(value, steps[i]);
                values[i]
            });
            compensated += error(row, &values);
        }
        assert!(compensated < 0.6 * plain, "{compensated} {plain}");
    }

    #[test]
    fn a_product_that_read_nothing_is_not_compensated() {
        assert!(Compensation::largest_first(&[0.0; 9], 3, DAMPING).is_none());
        assert!(Compensation::largest_first(&[f64::NAN; 9], 3, DAMPING).is_none());
        // Not positive definite.
        assert!(Compensation::largest_first(&[1.0, 3.0, 3.0, 1.0], 2, DAMPING).is_none());
    }
}
