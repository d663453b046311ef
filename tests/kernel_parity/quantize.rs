//! Quantising rows to int8: the same bits on every back-end.

use proptest::prelude::*;
use umo_kernels::quantize::{quantization_scale, quantize_columns, quantize_rows, row_maxima};
use umo_kernels::tiling::LANES;
use umo_kernels::{Isa, Mat, MatMut};
use umo_tests::{Fill, Guarded, Noise, Placed, cases, fill, for_each_isa, near, offset};

/// Codes of every row, and the bits of its scale.
fn run(isa: Isa, x: Mat<f32>, gap: usize, offset: usize) -> Vec<(Vec<i8>, u32)> {
    let mut steps = Guarded::new(x.rows(), x.cols(), gap, offset);
    let mut scale = Guarded::slice(x.rows(), offset);
    quantize_rows(isa, x, steps.mat(), scale.first_row()).expect("shapes agree");
    let scale = scale.checked().remove(0);
    steps.checked().into_iter().zip(scale.iter().map(|scale| scale.to_bits())).collect()
}

fn values() -> impl Strategy<Value = Fill> {
    let extreme = [0.0, -0.0, f32::MAX, f32::MIN, f32::MIN_POSITIVE, 1e-40, -1e-45, 127.0, 0.5];
    prop_oneof![fill(), Just(Fill::Integer(127)), prop::sample::select(extreme.to_vec()).prop_map(Fill::Constant)]
}

fn quantize_rows_has_the_scalar_bits(isa: Isa) {
    let dim = prop_oneof![near(LANES, 5), near(4 * LANES, 3), Just(768)];
    let place = (prop_oneof![Just(0), 0..40_usize], offset());
    proptest!(cases(96), |(rows in near(4, 2), dim in dim, (gap, offset) in place, fill in values(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x = Placed::new(rows, dim, gap, offset, || fill.next(&mut noise));
        prop_assert_eq!(run(isa, x.mat(), gap, offset), run(Isa::SCALAR, x.mat(), 0, 0));
    });
}

/// Two roundings between `x` and `x / scale`, and one in `scale`; then half a step.
fn quantize_rows_is_within_half_a_step(isa: Isa) {
    proptest!(cases(96), |(dim in near(LANES, 9), fill in fill(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x = Placed::new(2, dim, 0, 0, || fill.next(&mut noise));
        for (t, (steps, scale)) in run(isa, x.mat(), 0, 0).into_iter().enumerate() {
            let scale = f64::from(f32::from_bits(scale));
            for (step, &x) in steps.into_iter().zip(x.mat().row(t)) {
                let error = (f64::from(x) - f64::from(step) * scale).abs();
                prop_assert!(step != i8::MIN && error <= scale * (0.5 + 127.0 * 4.0 * umo_tests::EPSILON));
            }
        }
    });
}

/// A row whose largest value is 127 has scale 1: halves are exact.
fn quantize_rows_rounds_halves_to_even(isa: Isa) {
    let (row, want): (Vec<f32>, Vec<i8>) =
        (-127..=126_i8).flat_map(|i| [(f32::from(i), i), (f32::from(i) + 0.5, i + (i & 1))]).unzip();
    assert_eq!(run(isa, Mat::new(&row, 1, row.len()).expect("one row"), 0, 0), [(want, 1.0_f32.to_bits())]);
}

fn quantize_rows_of_a_row_are_the_same_among_500(isa: Isa) {
    let mut noise = Noise::new(11);
    let x = Placed::new(500, 99, 1, 3, || Fill::Outliers.next(&mut noise));
    let alone: Vec<_> = (0..500).map(|t| run(isa, x.mat().row_range(t..t + 1), 0, 0).remove(0)).collect();
    assert_eq!(run(isa, x.mat(), 0, 0), alone);
}

/// Pieces of columns, each with the largest value of all pieces, give the codes of the whole rows.
fn quantize_columns_has_the_bits_of_rows(isa: Isa) {
    let dim = prop_oneof![near(LANES, 5), near(4 * LANES, 3), Just(768)];
    proptest!(cases(96), |(rows in near(4, 2), dim in dim, cut in any::<prop::sample::Index>(), fill in values(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x = Placed::new(rows, dim, 0, 0, || fill.next(&mut noise));
        let mut copy = Guarded::new(rows, dim, 0, 0);
        for t in 0..rows {
            copy.mat().row_mut(t).copy_from_slice(x.mat().row(t));
        }
        let at = cut.index(dim + 1);
        let (left, right) = copy.mat().split_columns(at);
        let mut largest = [Guarded::slice(rows, 3), Guarded::slice(rows, 1)];
        for (piece, largest) in [&left, &right].into_iter().zip(&mut largest) {
            row_maxima(isa, piece, largest.first_row()).expect("shapes agree");
        }
        let [a, b] = largest.map(|largest| largest.checked().remove(0));
        let largest: Vec<f32> = a.iter().zip(&b).map(|(a, b)| a.max(*b)).collect();
        let mut steps = Guarded::new(rows, dim, 0, 0);
        let (to_left, to_right) = steps.mat().split_columns(at);
        quantize_columns(isa, &left, &largest, to_left).expect("shapes agree");
        quantize_columns(isa, &right, &largest, to_right).expect("shapes agree");
        let scale = largest.iter().map(|&largest| quantization_scale(largest).to_bits());
        let got: Vec<_> = steps.checked().into_iter().zip(scale).collect();
        prop_assert_eq!(got, run(Isa::SCALAR, x.mat(), 0, 0));
    });
}

/// Wrong lengths are errors, and nothing is written.
#[test]
fn quantize_columns_says_which_length_disagrees() {
    let mut x = [1.0_f32, 2.0, 3.0, 4.0];
    let mut steps = [9_i8; 4];
    let x = MatMut::new(&mut x, 2, 2).expect("four values");
    let isa = Isa::SCALAR;
    assert_eq!(row_maxima(isa, &x, &mut [0.0]).map_err(|e| e.arg), Err("largest"));
    let to = MatMut::new(&mut steps, 2, 2).expect("four values");
    assert_eq!(quantize_columns(isa, &x, &[4.0], to).map_err(|e| e.arg), Err("largest"));
    let to = MatMut::new(&mut steps, 1, 2).expect("two values");
    assert_eq!(quantize_columns(isa, &x, &[4.0, 4.0], to).map_err(|e| e.arg), Err("codes"));
    let to = MatMut::new(&mut steps, 2, 1).expect("two values");
    assert_eq!(quantize_columns(isa, &x, &[4.0, 4.0], to).map_err(|e| e.arg), Err("codes"));
    assert_eq!(steps, [9; 4]);
}

for_each_isa!(quantize_rows_has_the_scalar_bits => vector);
for_each_isa!(
    quantize_columns_has_the_bits_of_rows,
    quantize_rows_is_within_half_a_step,
    quantize_rows_rounds_halves_to_even,
    quantize_rows_of_a_row_are_the_same_among_500
    => every
);
