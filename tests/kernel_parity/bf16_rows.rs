//! Products with weights in bf16, properties that f32 does not share: non-finite values, and rows
//! that are bf16 already.

use proptest::prelude::*;
use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, split_bf16x2, tiling};
use umo_kernels::pack::{PANEL, pack_bf16, packed_len_bf16};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16};
use umo_tests::{Guarded, Noise, Placed, bits, cases, for_each_isa, offset};

use crate::products::shape;

/// An infinity or NaN reaches only the outputs of its own row; the largest finite number does not
/// become infinite.
fn bf16_products_propagate_nonfinite_values(isa: Isa) {
    const ROWS: usize = 5;
    for (k, at) in [(1, 0), (33, 32), (70, 3)] {
        let mut packed = vec![Bf16::default(); packed_len_bf16(3, k)];
        let w: Vec<f32> = (0..3 * k).map(|i| [1.0, -2.0, 0.5][i / k]).collect();
        pack_bf16(Mat::new(&w, 3, k).unwrap(), &mut packed).unwrap();
        let mut x = vec![0.25; ROWS * k];
        let smallest_nan = f32::from_bits(0x7f80_0001);
        for (t, v) in [f32::INFINITY, f32::NEG_INFINITY, smallest_nan, f32::MAX].into_iter().enumerate() {
            x[t * k + at] = v;
        }
        let (input, w) = (Input::all(Mat::new(&x, ROWS, k).unwrap()), PackedBf16::new(&packed, 3, k).unwrap());
        let mut y = [0.0; ROWS * 3];
        matmul_bf16(isa, input, w, Epilogue::STORE, MatMut::new(&mut y, ROWS, 3).unwrap()).unwrap();
        let (y, _) = y.as_chunks::<3>();
        assert_eq!(y[0], [f32::INFINITY, f32::NEG_INFINITY, f32::INFINITY], "{k}");
        assert_eq!(y[1], [f32::NEG_INFINITY, f32::INFINITY, f32::NEG_INFINITY], "{k}");
        assert!(y[2].iter().all(|v| v.is_nan()), "{k}: {:?}", y[2]);
        let share = y[3][2] / f32::MAX;
        assert!((share - 0.5).abs() <= 1.0 / 65536.0 && y[3][1] == f32::NEG_INFINITY, "{k}: {:?}", y[3]);
        let sum = 0.25 * k as f32;
        assert_eq!(y[4], [sum, -2.0 * sum, 0.5 * sum], "{k}");
    }
}

/// Rows that are bf16 already, split in two or rounded, overlapping or apart. With tiles: any
/// values, and the bits of the product of the original rows, or of the rounded ones; elsewhere
/// integers, whose sums are exact.
fn rows_in_bf16_give_the_same(isa: Isa) {
    let gap = prop_oneof![Just(-1_i8), Just(0), Just(1)];
    proptest!(cases(128), |((m, n, k) in shape(tiling(isa)), seed in any::<u64>(), offset in offset(), gap in gap)| {
        let mut noise = Noise::new(seed);
        let number = |noise: &mut Noise| if isa.has_tiles() { noise.float(1.0) } else { noise.integer(16) };
        let stride = match gap { -1 => k.div_ceil(2), 0 => k, _ => k + 3 };
        let len = if m * k == 0 { 0 } else { (m - 1) * stride + k };
        let x: Vec<f32> = (0..len).map(|_| number(&mut noise)).collect();
        let w: Vec<f32> = (0..n * k).map(|_| noise.integer(16)).collect();
        let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
        pack_bf16(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
        let w = PackedBf16::new(&packed, n, k).unwrap();

        let nearest: Vec<Bf16> = x.iter().map(|&x| Bf16::from_f32(x)).collect();
        let (mut high, mut low) = (vec![Bf16(0); len], vec![Bf16(0); len]);
        split_bf16x2(isa, &x, &mut high, &mut low).unwrap();
        for ((&x, high), low) in x.iter().zip(&high).zip(&low) {
            let rest = f64::from(x) - f64::from(high.to_f32()) - f64::from(low.to_f32());
            prop_assert!(rest.abs() <= f64::from(x.abs()) * f64::from(2.0_f32.powi(-16)) + f64::from(f32::MIN_POSITIVE));
        }
        let rounded: Vec<f32> = nearest.iter().map(|value| value.to_f32()).collect();
        let parts = [(high, offset), (low, offset + 1), (nearest, offset)].map(|(part, at)| Placed::copy_of(&part, at));
        let [high, low, nearest] = parts.each_ref().map(|part| Mat::with_stride(part.row(), m, k, stride).unwrap());
        for (rows, whole) in [(Bf16Rows::split(high, low).unwrap(), &x), (Bf16Rows::rounded(nearest), &rounded)] {
            let (mut y, mut want) = (Guarded::filled(m, n, 1, offset, 3.0), Guarded::filled(m, n, 1, offset, 3.0));
            matmul_bf16_rows(isa, rows, w, Epilogue::ADD, y.mat()).unwrap();
            let whole = Input::all(Mat::with_stride(whole, m, k, stride).unwrap());
            matmul_bf16(isa, whole, w, Epilogue::ADD, want.mat()).unwrap();
            prop_assert_eq!(bits(&y.checked()), bits(&want.checked()));
        }
    });
}

/// Rounded rows of any values: within the bound of their sums, with the same bits alone and among
/// others, and for any split of the outputs.
fn rounded_rows_stand_alone(isa: Isa) {
    let (place, split) = ((any::<bool>(), offset()), 0_usize..7);
    proptest!(cases(128), |((m, n, k) in shape(tiling(isa)), seed in any::<u64>(), (overlap, offset) in place, split in split)| {
        let mut noise = Noise::new(seed);
        let m = m.max(1);
        let stride = if overlap { k.div_ceil(3) } else { k + 1 };
        let x: Vec<Bf16> = (0..(m - 1) * stride + k).map(|_| Bf16::from_f32(noise.float(1.0))).collect();
        let w: Vec<f32> = (0..n * k).map(|_| Bf16::from_f32(noise.float(1.0)).to_f32()).collect();
        let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
        pack_bf16(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
        let packed = PackedBf16::new(&packed, n, k).unwrap();
        let shifted = Placed::copy_of(&x, offset);
        let all = Mat::with_stride(shifted.row(), m, k, stride).unwrap();
        let mut whole = Guarded::filled(m, n, 1, offset, 3.0);
        matmul_bf16_rows(isa, Bf16Rows::rounded(all), packed, Epilogue::STORE, whole.mat()).unwrap();

        for (t, row) in whole.checked().iter().enumerate() {
            for (o, y) in row.iter().enumerate() {
                let terms = all.row(t).iter().zip(&w[o * k..]).map(|(x, w)| f64::from(x.to_f32()) * f64::from(*w));
                let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
                let off = (f64::from(*y) - sum).abs();
                prop_assert!(off <= k as f64 * 2.0_f64.powi(-23) * size, "{off} where terms have {size}");
            }
        }

        let mut alone = Guarded::filled(m, n, 1, offset, 3.0);
        for t in 0..m {
            let (_, mut y) = alone.mat().split_rows(t);
            let row = Bf16Rows::rounded(all.row_range(t..t + 1));
            matmul_bf16_rows(isa, row, packed, Epilogue::STORE, y.reborrow().split_rows(1).0).unwrap();
        }
        prop_assert_eq!(bits(&whole.checked()), bits(&alone.checked()));
        let mut pieces = Guarded::filled(m, n, 1, offset, 3.0);
        let at = (split * PANEL).min(n / PANEL * PANEL);
        let (left, right) = pieces.mat().split_columns(at);
        for (range, y) in [(0..at, left), (at..n, right)] {
            matmul_bf16_rows(isa, Bf16Rows::rounded(all), packed.outputs(range), Epilogue::STORE, y).unwrap();
        }
        prop_assert_eq!(bits(&whole.checked()), bits(&pieces.checked()));
    });
}

/// As [`bf16_products_propagate_nonfinite_values`], for rounded rows.
fn rounded_rows_propagate_nonfinite_values(isa: Isa) {
    for (k, at) in [(1, 0), (33, 32), (70, 3)] {
        let mut packed = vec![Bf16::default(); packed_len_bf16(2, k)];
        let w: Vec<f32> = (0..2 * k).map(|i| [1.0, -2.0][i / k]).collect();
        pack_bf16(Mat::new(&w, 2, k).unwrap(), &mut packed).unwrap();
        let w = PackedBf16::new(&packed, 2, k).unwrap();
        let mut x = vec![Bf16::from_f32(0.25); 4 * k];
        for (t, v) in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN].into_iter().enumerate() {
            x[t * k + at] = Bf16::from_f32(v);
        }
        let mut y = [0.0; 8];
        let rows = Bf16Rows::rounded(Mat::new(&x, 4, k).unwrap());
        matmul_bf16_rows(isa, rows, w, Epilogue::STORE, MatMut::new(&mut y, 4, 2).unwrap()).unwrap();
        assert_eq!(y[..4], [f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY, f32::INFINITY], "{k}");
        assert!(y[4..6].iter().all(|v| v.is_nan()), "{k}: {:?}", &y[4..6]);
        assert_eq!(y[6..], [0.25 * k as f32, -0.5 * k as f32], "{k}");
    }
}

for_each_isa!(
    rounded_rows_stand_alone,
    rounded_rows_propagate_nonfinite_values,
    rows_in_bf16_give_the_same,
    bf16_products_propagate_nonfinite_values
    => every
);
