//! Products with weights in bf16 beyond what they share with f32: what is not finite, and rows that are bf16 already.

use proptest::prelude::*;
use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, split_bf16x2};
use umo_kernels::pack::{PANEL, pack_bf16, packed_len_bf16};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16};

use crate::support::{Guarded, Numbers, Shifted, config, for_each_isa, isa, near};

/// An infinity and what is no number reach the outputs of their own row alone; the largest number is no infinity.
fn bf16_products_carry_what_is_not_finite(isa: Isa) {
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

/// Rows that are bf16 already, cut in two or rounded, overlapping or apart. Where there are tiles: any values, and the
/// bits of the product of the rows as they were, or of what they were rounded to; elsewhere integers, whose sums are exact.
fn rows_in_bf16_give_the_same(isa: Isa) {
    // Of whole steps and others, some more than the steps that are cut at once.
    let inputs = prop_oneof![4 => near(32, 4), 2 => (1_usize..4).prop_map(|steps| 32 * steps), 1 => 2047_usize..2082];
    let shape = (0_usize..70, near(PANEL, 6), inputs, any::<u64>(), 0_usize..64);
    proptest!(config(128), |((m, n, k, seed, offset) in shape, gap in prop_oneof![Just(-1_i8), Just(0), Just(1)])| {
        let mut numbers = Numbers(seed);
        let number = if isa.has_tiles() { Numbers::real } else { Numbers::integer };
        let stride = match gap { -1 => k.div_ceil(2), 0 => k, _ => k + 3 };
        let len = if m * k == 0 { 0 } else { (m - 1) * stride + k };
        let x: Vec<f32> = (0..len).map(|_| number(&mut numbers)).collect();
        let w: Vec<f32> = (0..n * k).map(|_| numbers.integer()).collect();
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
        let parts = [(high, offset), (low, offset + 1), (nearest, offset)].map(|(part, at)| Shifted::new(&part, at));
        let [high, low, nearest] = parts.each_ref().map(|part| Mat::with_stride(part.get(), m, k, stride).unwrap());
        for (rows, whole) in [(Bf16Rows::split(high, low).unwrap(), &x), (Bf16Rows::rounded(nearest), &rounded)] {
            let (mut y, mut want) = (Guarded::new(m, n, 1, offset, 3.0), Guarded::new(m, n, 1, offset, 3.0));
            matmul_bf16_rows(isa, rows, w, Epilogue::ADD, y.view()).unwrap();
            let whole = Input::all(Mat::with_stride(whole, m, k, stride).unwrap());
            matmul_bf16(isa, whole, w, Epilogue::ADD, want.view()).unwrap();
            prop_assert_eq!(y.bits(), want.bits());
        }
    });
}

/// Rows that were rounded, of any values: within the bound of their sums, the same alone and among others, and for any cut of
/// the outputs.
fn rounded_rows_stand_alone(isa: Isa) {
    let shape = (1_usize..40, near(PANEL, 6), prop_oneof![near(8, 6), 2047_usize..2082], any::<u64>(), 0_usize..64);
    proptest!(config(128), |((m, n, k, seed, offset) in shape, overlap in any::<bool>(), cut in 0_usize..7)| {
        let mut numbers = Numbers(seed);
        let stride = if overlap { k.div_ceil(3) } else { k + 1 };
        let x: Vec<Bf16> = (0..(m - 1) * stride + k).map(|_| Bf16::from_f32(numbers.real())).collect();
        let w: Vec<f32> = (0..n * k).map(|_| Bf16::from_f32(numbers.real()).to_f32()).collect();
        let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
        pack_bf16(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
        let packed = PackedBf16::new(&packed, n, k).unwrap();
        let shifted = Shifted::new(&x, offset);
        let all = Mat::with_stride(shifted.get(), m, k, stride).unwrap();
        let mut whole = Guarded::new(m, n, 1, offset, 3.0);
        matmul_bf16_rows(isa, Bf16Rows::rounded(all), packed, Epilogue::STORE, whole.view()).unwrap();

        for (t, row) in whole.bits().iter().enumerate() {
            for (o, y) in row.iter().enumerate() {
                let terms = all.row(t).iter().zip(&w[o * k..]).map(|(x, w)| f64::from(x.to_f32()) * f64::from(*w));
                let (sum, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
                let off = (f64::from(f32::from_bits(*y)) - sum).abs();
                prop_assert!(off <= k as f64 * 2.0_f64.powi(-23) * size, "{off} where terms have {size}");
            }
        }

        let mut alone = Guarded::new(m, n, 1, offset, 3.0);
        for t in 0..m {
            let (_, mut y) = alone.view().split_rows(t);
            let row = Bf16Rows::rounded(all.row_range(t..t + 1));
            matmul_bf16_rows(isa, row, packed, Epilogue::STORE, y.reborrow().split_rows(1).0).unwrap();
        }
        prop_assert_eq!(whole.bits(), alone.bits());
        let mut pieces = Guarded::new(m, n, 1, offset, 3.0);
        let cut = (cut * PANEL).min(n / PANEL * PANEL);
        let (left, right) = pieces.view().split_columns(cut);
        for (range, y) in [(0..cut, left), (cut..n, right)] {
            matmul_bf16_rows(isa, Bf16Rows::rounded(all), packed.outputs(range), Epilogue::STORE, y).unwrap();
        }
        prop_assert_eq!(whole.bits(), pieces.bits());
    });
}

/// As [`bf16_products_carry_what_is_not_finite`], of rows that were rounded.
fn rounded_rows_carry_what_is_not_finite(isa: Isa) {
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

for_each_isa!(rounded_rows_stand_alone => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(rounded_rows_carry_what_is_not_finite => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(rows_in_bf16_give_the_same => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(bf16_products_carry_what_is_not_finite => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
