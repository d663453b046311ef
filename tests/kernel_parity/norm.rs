//! Norms against f64, with the scalar bits on every back-end, and the same bits alone and among others.

use proptest::prelude::*;
use umo_kernels::norm::{channel_affine, channel_sums, layer_norm, rms_norm};
use umo_kernels::tiling::LANES;
use umo_kernels::{Isa, Mat};
use umo_tests::{EPSILON, Fill, Guarded, Noise, Placed, bits, cases, fill, for_each_isa, near, offset};

#[derive(Clone, Debug)]
struct Case {
    x: Placed<f32>,
    weight: Placed<f32>,
    bias: Placed<f32>,
    gap: usize,
    offset: usize,
}

const EPS: f32 = 1e-5;

fn case() -> impl Strategy<Value = Case> {
    let dim = prop_oneof![near(LANES, 5), near(4 * LANES, 3), Just(512), Just(768)];
    (near(4, 2), dim, prop_oneof![Just(0), 0..40_usize], offset(), fill(), any::<u64>()).prop_map(
        |(rows, dim, gap, offset, fill, seed)| {
            let mut noise = Noise::new(seed);
            let x = Placed::new(rows, dim, gap, offset, || fill.next(&mut noise));
            let weight = Placed::new(1, dim, 0, offset, || noise.float(2.0));
            let bias = Placed::new(1, dim, 0, offset, || noise.float(2.0));
            Case { x, weight, bias, gap, offset }
        },
    )
}

impl Case {
    fn rms(&self, isa: Isa, x: Mat<f32>) -> Vec<Vec<f32>> {
        let mut y = Guarded::new(x.rows(), x.cols(), self.gap, self.offset);
        rms_norm(isa, x, self.weight.row(), EPS, y.mat()).expect("shapes agree");
        y.checked()
    }

    fn layer(&self, isa: Isa, x: Mat<f32>) -> Vec<Vec<f32>> {
        let mut y = Guarded::new(x.rows(), x.cols(), self.gap, self.offset);
        layer_norm(isa, x, self.weight.row(), self.bias.row(), EPS, y.mat()).expect("shapes agree");
        y.checked()
    }

    /// `[time][channel]`, in place.
    fn affine(&self, isa: Isa) -> Vec<Vec<f32>> {
        let mut x = Guarded::copy_of(self.x.mat(), self.gap, self.offset);
        channel_affine(isa, x.mat(), self.weight.row(), self.bias.row()).expect("shapes agree");
        x.checked()
    }

    /// Sums and squares of the rows, added to the initial values of weights and biases.
    fn sums(&self, isa: Isa, pieces: &[Mat<f32>]) -> Vec<Vec<u64>> {
        let mut sum = Guarded::slice(self.x.mat().cols(), self.offset);
        let mut squares = Guarded::slice(self.x.mat().cols(), self.offset);
        for (to, from) in [(&mut sum, &self.weight), (&mut squares, &self.bias)] {
            to.first_row().iter_mut().zip(from.row()).for_each(|(to, &from)| *to = f64::from(from));
        }
        for &piece in pieces {
            channel_sums(isa, piece, sum.first_row(), squares.first_row()).expect("shapes agree");
        }
        [sum, squares].iter().map(|result| result.checked()[0].iter().map(|value| value.to_bits()).collect()).collect()
    }
}

/// The mean of squares is a sum of `dim` terms; its error is halved by the root; four roundings
/// follow.
fn rms_norm_is_near_f64(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let x = case.x.mat();
        let dim = x.cols() as f64;
        for (t, row) in case.rms(isa, x).iter().enumerate() {
            let wide: Vec<f64> = x.row(t).iter().map(|&x| f64::from(x)).collect();
            let mean = wide.iter().map(|x| x * x).sum::<f64>() / dim;
            for (c, &got) in row.iter().enumerate() {
                let want = wide[c] / (mean + f64::from(EPS)).sqrt() * f64::from(case.weight.row()[c]);
                let tolerance = (dim / 2.0 + 5.0) * EPSILON * want.abs() + f64::from(f32::MIN_POSITIVE);
                let error = (f64::from(got) - want).abs();
                prop_assert!(error <= tolerance, "y[{t}][{c}] = {got}, not {want}: {error:e} > {tolerance:e}");
            }
        }
    });
}

/// The mean is off by at most `dim` roundings of the mean size; each difference by that and its own
/// rounding, together `d`; the variance by twice the mean of `difference * d`, by `d * d`, and by its own
/// roundings.
fn layer_norm_is_near_f64(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let x = case.x.mat();
        let dim = x.cols() as f64;
        for (t, row) in case.layer(isa, x).iter().enumerate() {
            let wide: Vec<f64> = x.row(t).iter().map(|&x| f64::from(x)).collect();
            let mean = wide.iter().sum::<f64>() / dim;
            let size = wide.iter().fold(0.0_f64, |size, x| size.max(x.abs()));
            let variance = wide.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / dim + f64::from(EPS);
            let d = (dim + 2.0) * EPSILON * size;
            let mean_difference = wide.iter().map(|x| (x - mean).abs()).sum::<f64>() / dim;
            let variance_error = 2.0 * mean_difference * d + d * d + (dim + 2.0) * EPSILON * variance;
            let relative = variance_error / variance;
            prop_assume!(relative < 0.5);
            for (c, &got) in row.iter().enumerate() {
                let (weight, bias) = (f64::from(case.weight.row()[c]), f64::from(case.bias.row()[c]));
                let scaled = (wide[c] - mean) / variance.sqrt() * weight;
                let want = scaled + bias;
                let tolerance = scaled.abs() * (relative + 5.0 * EPSILON)
                    + 2.0 * d / variance.sqrt() * weight.abs()
                    + EPSILON * (want.abs() + bias.abs());
                let error = (f64::from(got) - want).abs();
                prop_assert!(error <= tolerance, "y[{t}][{c}] = {got}, not {want}: {error:e} > {tolerance:e}");
            }
        }
    });
}

fn norms_have_the_scalar_bits(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let x = case.x.mat();
        prop_assert_eq!(bits(&case.rms(isa, x)), bits(&case.rms(Isa::SCALAR, x)));
        prop_assert_eq!(bits(&case.layer(isa, x)), bits(&case.layer(Isa::SCALAR, x)));
    });
}

fn norms_of_a_row_are_the_same_among_500(isa: Isa) {
    let mut noise = Noise::new(3);
    let x = Placed::new(500, 83, 2, 5, || Fill::Outliers.next(&mut noise));
    let weight = Placed::new(1, 83, 0, 1, || noise.float(1.0));
    let case = Case { bias: weight.clone(), x, weight, gap: 0, offset: 0 };
    let x = case.x.mat();
    let alone: Vec<_> = (0..500).map(|t| case.rms(isa, x.row_range(t..t + 1)).remove(0)).collect();
    assert_eq!(bits(&case.rms(isa, x)), bits(&alone));
    let alone: Vec<_> = (0..500).map(|t| case.layer(isa, x.row_range(t..t + 1)).remove(0)).collect();
    assert_eq!(bits(&case.layer(isa, x)), bits(&alone));
}

fn channel_sums_add_in_time_order(isa: Isa) {
    proptest!(cases(64), |(case in case(), cut in any::<prop::sample::Index>())| {
        let x = case.x.mat();
        let mut want = [vec![], vec![]];
        for c in 0..x.cols() {
            let (mut sum, mut squares) = (f64::from(case.weight.row()[c]), f64::from(case.bias.row()[c]));
            for t in 0..x.rows() {
                let value = f64::from(x.row(t)[c]);
                sum += value;
                squares += value * value;
            }
            want[0].push(sum.to_bits());
            want[1].push(squares.to_bits());
        }
        prop_assert_eq!(&case.sums(isa, &[x])[..], &want[..]);
        let cut = cut.index(x.rows() + 1);
        prop_assert_eq!(&case.sums(isa, &[x.row_range(0..cut), x.row_range(cut..x.rows())])[..], &want[..]);
    });
}

fn channel_affine_rounds_twice(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let parameters = || case.weight.row().iter().zip(case.bias.row());
        let line = |x: &[f32]| x.iter().zip(parameters()).map(|(x, (scale, shift))| x * scale + shift).collect();
        let want: Vec<Vec<f32>> = (0..case.x.mat().rows()).map(|t| line(case.x.mat().row(t))).collect();
        prop_assert_eq!(bits(&case.affine(isa)), bits(&want));
    });
}

for_each_isa!(
    rms_norm_is_near_f64,
    layer_norm_is_near_f64,
    norms_of_a_row_are_the_same_among_500,
    channel_sums_add_in_time_order,
    channel_affine_rounds_twice
    => every
);
for_each_isa!(norms_have_the_scalar_bits => vector);

#[test]
fn norms_reject_shapes_that_disagree() {
    let x = Placed::new(2, 3, 0, 0, || 1.0_f32);
    let mut y = Guarded::new(2, 3, 0, 0);
    let mut short = Guarded::new(1, 3, 0, 0);
    let isa = Isa::SCALAR;
    assert_eq!(rms_norm(isa, x.mat(), &[1.0; 2], EPS, y.mat()).unwrap_err().arg, "weight");
    assert_eq!(rms_norm(isa, x.mat(), &[1.0; 3], EPS, short.mat()).unwrap_err().arg, "y");
    assert_eq!(layer_norm(isa, x.mat(), &[1.0; 3], &[1.0; 4], EPS, y.mat()).unwrap_err().arg, "bias");
    assert_eq!(channel_sums(isa, x.mat(), &mut [0.0; 3], &mut [0.0; 2]).unwrap_err().arg, "squares");
    assert_eq!(channel_affine(isa, y.mat(), &[0.0; 2], &[0.0; 3]).unwrap_err().arg, "scale");
}
