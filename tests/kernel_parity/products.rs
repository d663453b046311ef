//! Every product on every back-end against its scalar reference and against f64: shapes around the
//! back-end's own tile sizes, any alignment and the tile-loadable one, gathered and scattered rows,
//! all epilogues, extremes; and the two guarantees that callers rely on: a row's bits depend
//! neither on the rows beside it nor on the split of the outputs.

use proptest::prelude::*;
use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::matmul_i4::matmul_i4;
use umo_kernels::matmul_i8::{MAX_K, matmul_i8};
use umo_kernels::pack::{GROUP, PANEL, pack_i8, pack_row_i4, packed_len_i4, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::tiling::Tiling;
use umo_kernels::tuning::Tuning;
use umo_kernels::{Isa, Mat, MatMut, PackedI4, PackedI8};
use umo_self_test::kernels::products::Kind::{self, I4, I8};
use umo_self_test::kernels::products::{Case, KINDS, Operands, Values};
use umo_tests::{LINE, around, bits, cases, for_each_isa, offset};

/// Most multiply-adds of a drawn case: the scalar reference has the same cost.
const MAX_WORK: usize = 4_000_000;

fn activation() -> impl Strategy<Value = Activation> {
    prop_oneof![
        4 => Just(Activation::None),
        1 => Just(Activation::Relu),
        1 => Just(Activation::LeakyRelu(0.25)),
        1 => Just(Activation::Gelu),
        1 => Just(Activation::GeluTanh),
    ]
}

/// Rows, outputs and inputs around the multiples of a back-end's sizes, [`MAX_WORK`] at most.
pub(crate) fn shape(tiling: Tiling) -> impl Strategy<Value = (usize, usize, usize)> {
    let sizes = (around(tiling.rows), around(tiling.outputs), around(tiling.inputs));
    sizes.prop_filter("a case of moderate size", |(m, n, k)| m * n * k <= MAX_WORK)
}

fn case(kind: Kind, tiling: Tiling) -> impl Strategy<Value = Case> {
    // Whole tiles of rows that start at cache lines are loaded in place: a third of all cases.
    let in_place = prop_oneof![2 => Just(None), 1 => prop_oneof![Just(Some(0)), Just(Some(LINE))]];
    let tile = tiling.rows.iter().copied().filter(|rows| *rows < 100).max().unwrap_or(1);
    let place = (0..2 * LINE, offset(), in_place);
    let values = prop_oneof![6 => Just(Values::Exact), 1 => Just(Values::Least), 1 => Just(Values::Greatest)];
    let flags = (prop::bool::weighted(0.35), any::<bool>(), any::<bool>(), any::<bool>());
    (shape(tiling), place, 0..3_usize, flags, activation(), values, any::<u64>()).prop_map(
        move |((m, n, k), (gap, offset, in_place), y_gap, (gather, scatter, bias, add), activation, values, seed)| {
            let case = Case { kind, m, n, k, gap, offset, y_gap, gather, scatter, bias, add, activation, values, seed };
            let Some(gap) = in_place else { return case };
            let (m, k) = (m.next_multiple_of(tile), k.next_multiple_of(LINE));
            Case { m, k, gap, offset: 0, gather: false, ..case }
        },
    )
}

/// Compares all bits of both products, with every tuning profile: a profile only changes the order of
/// memory accesses and of exact operations. The error has the first difference and the number of rows
/// that differ: whole matrices are too long to print.
fn match_scalar(case: &Case, isa: Isa) -> Result<(), String> {
    let operands = Operands::new(case);
    let ([plain, gated], mut text) = (operands.run(Isa::SCALAR), String::new());
    let results = Tuning::ALL.map(|tuning| operands.run(isa.with_tuning(tuning)));
    let pairs = results.iter().flat_map(|[p, g]| [("plain", p, &plain), ("gated", g, &gated)]);
    for (name, found, wanted) in pairs {
        let (f, w) = (bits(found), bits(wanted));
        let rows: Vec<usize> = (0..w.len()).filter(|&t| f[t] != w[t]).collect();
        if let Some(&t) = rows.first() {
            let c = (0..w[t].len()).find(|&c| f[t][c] != w[t][c]).unwrap_or(0);
            let (rows, found, wanted) = (rows.len(), found[t][c], wanted[t][c]);
            text += &format!("{name}: {rows} rows differ, first [{t}, {c}]: {found}, not {wanted}. ");
        }
    }
    if text.is_empty() { Ok(()) } else { Err(format!("{:?}: {text}", case)) }
}

/// int4 and int8 on any values, floats on integers: all bits, with every epilogue.
fn products_match_scalar(isa: Isa) {
    for kind in KINDS {
        proptest!(cases(256), |(case in case(kind, kind.tiling(isa)))| {
            prop_assert_eq!(match_scalar(&case, isa), Ok(()));
        });
    }
}

/// More weights than a cached chunk, more rows than are held at once, and longer rows than any
/// buffer, each with the largest tile and with one row more.
fn large_products_match_scalar(isa: Isa) {
    for kind in KINDS {
        let Tiling { rows, outputs, inputs, held, chunk } = kind.tiling(isa);
        let most = |sizes: &[usize]| *sizes.iter().max().unwrap();
        let tile = *rows.iter().filter(|rows| **rows < 100).max().unwrap();
        let (group, long) = (most(outputs), most(inputs));
        // Row lengths of the base model, in whole steps and with a tail.
        let mut shapes = vec![(tile + 1, group + 1, 2 * long + 3), (1, group, long + 1), (2 * tile, PANEL, long + 64)];
        for k in [768, 770] {
            if chunk > 0 {
                let more = (chunk / k / PANEL + 2) * PANEL;
                shapes.extend([(2 * tile, more, k), (tile + 3, more + 5, k), (1, 2 * more, k)]);
            }
            if held > 0 {
                shapes.extend([(held / k + tile, group, k), (held / k / 2 + 1, group + 3, 2 * k)]);
            }
        }
        for (i, (m, n, k)) in shapes.into_iter().enumerate() {
            for gather in [false, true] {
                let case = Case {
                    kind,
                    m,
                    n,
                    k,
                    gap: if k % 2 == 0 { 0 } else { LINE },
                    offset: 0,
                    y_gap: 0,
                    gather,
                    scatter: i % 3 == 1,
                    bias: true,
                    add: i % 2 == 1,
                    activation: Activation::None,
                    values: Values::Exact,
                    seed: i as u64,
                };
                match_scalar(&case, isa).unwrap();
            }
        }
    }
}

/// Against f64, so that scalar and vector code cannot share an error: int4 and int8 exactly, floats of any
/// values within the bound for any order of additions.
#[expect(clippy::cast_possible_truncation, reason = "the sum is rounded once, as the kernel rounds its own")]
fn sums_are_near_f64(isa: Isa) {
    for kind in KINDS {
        proptest!(cases(64), |(case in case(kind, kind.tiling(isa)), real in any::<bool>())| {
            let case = if real { Case { values: Values::Real, ..case } } else { case };
            let operands = Operands::new(&case);
            let mut y = operands.output(false);
            operands.plain(isa, 0..case.m, 0..case.n, Epilogue::STORE, y.mat());
            // Tiles use two bf16 values for each f32, whose sum is within 2^-16 of it.
            let rounding = if kind == Kind::Bf16 && isa.name() == "amx" { 2.0_f64.powi(-16) } else { 0.0 };
            for (t, row) in y.checked().iter().enumerate() {
                let x_scale = operands.x_scale[operands.source(t)];
                for (o, &got) in row.iter().enumerate() {
                    let (sum, sizes) = operands.sum(t, o);
                    if matches!(kind, I4 | I8) {
                        prop_assert_eq!(got, sum as f32 * (x_scale * operands.w_scale[o]), "[{}, {}]", t, o);
                        continue;
                    }
                    let k = case.k as f64;
                    let bound = (k * 2.0_f64.powi(-23) + rounding) * sizes + 4.0 * k * f64::from(f32::MIN_POSITIVE);
                    let error = (f64::from(got) - sum).abs();
                    prop_assert!(error <= bound, "[{t}, {o}]: off by {error}, allowed {bound}");
                }
            }
        });
    }
}

/// The longest sum of the largest products, one below the 32-bit limit, in tiles of one and of many
/// rows.
fn int8_sums_reach_the_limit(isa: Isa) {
    for (x_code, w_code) in [(i8::MIN, i8::MIN), (i8::MIN, i8::MAX), (i8::MAX, i8::MIN), (i8::MAX, i8::MAX)] {
        for m in [1, if isa == Isa::SCALAR { 2 } else { 19 }] {
            let (x, w) = (vec![x_code; m * MAX_K], vec![w_code; MAX_K]);
            let (mut packed, mut sum) = (vec![0; packed_len_i8(1, MAX_K)], [0]);
            pack_i8(Mat::new(&w, 1, MAX_K).unwrap(), &mut packed, &mut sum).unwrap();
            let scale = vec![1.0; m];
            let rows = QuantRows::new(Mat::new(&x, m, MAX_K).unwrap(), &scale).unwrap();
            let w = PackedI8::new(&packed, &[1.0], &sum, 1, MAX_K).unwrap();
            let mut y = vec![0.0; m];
            matmul_i8(isa, rows, None, w, Epilogue::STORE, MatMut::new(&mut y, m, 1).unwrap()).unwrap();
            assert_eq!(y, vec![(MAX_K as i64 * i64::from(x_code) * i64::from(w_code)) as f32; m]);
        }
    }
}

/// The same for int4: the largest weight is 120.
fn int4_sums_reach_the_limit(isa: Isa) {
    for (x_code, multiplier, code) in [(-128, 15, -8), (-128, -15, -8), (127, 15, 7), (127, -15, -8)] {
        for m in [1, 2, if isa == Isa::SCALAR { 3 } else { 7 }] {
            let (x, codes, multipliers) =
                (vec![x_code; m * MAX_K], vec![code; MAX_K], vec![multiplier; MAX_K.div_ceil(GROUP)]);
            let mut packed = vec![0; packed_len_i4(1, MAX_K)];
            pack_row_i4(&codes, &multipliers, 0, &mut packed).unwrap();
            let scale = vec![1.0; m];
            let rows = QuantRows::new(Mat::new(&x, m, MAX_K).unwrap(), &scale).unwrap();
            let w = PackedI4::new(&packed, &[1.0], 1, MAX_K).unwrap();
            let mut y = vec![0.0; m];
            matmul_i4(isa, rows, None, w, Epilogue::STORE, MatMut::new(&mut y, m, 1).unwrap()).unwrap();
            let weight = i64::from(code) * i64::from(multiplier);
            assert_eq!(y, vec![(MAX_K as i64 * i64::from(x_code) * weight) as f32; m]);
        }
    }
}

/// An int4 product has the bits of the int8 product with the same weights.
fn int4_matches_int8(isa: Isa) {
    proptest!(cases(64), |(case in case(I4, I4.tiling(isa)))| {
        let operands = Operands::new(&case);
        let (Case { m, n, k, scatter, .. }, epilogue) = (case, operands.epilogue());
        #[expect(clippy::cast_possible_truncation, reason = "products of codes and multipliers are integers up to 120")]
        let w: Vec<i8> = operands.w.iter().map(|&w| w as i8).collect();
        let (mut packed, mut sum) = (vec![0; packed_len_i8(n, k)], vec![0; n]);
        pack_i8(Mat::new(&w, n, k).unwrap(), &mut packed, &mut sum).unwrap();
        let (mut int4, mut int8) = (operands.output(scatter), operands.output(scatter));
        operands.plain(isa, 0..m, 0..n, epilogue, int4.mat());
        let w = PackedI8::new(&packed, &operands.w_scale, &sum, n, k).unwrap();
        matmul_i8(isa, operands.codes(0..m), operands.index(), w, epilogue, int8.mat()).unwrap();
        prop_assert!(bits(&int4.checked()) == bits(&int8.checked()));
    });
}

/// Values that are not int4 codes or multipliers are refused.
#[test]
fn int4_values_are_checked() {
    let mut panel = vec![0; packed_len_i4(1, 40)];
    let mut pack = |code, multiplier| {
        let (mut codes, mut multipliers) = ([0; 40], [1; 2]);
        (codes[39], multipliers[1]) = (code, multiplier);
        pack_row_i4(&codes, &multipliers, 15, &mut panel).map_err(|error| error.arg)
    };
    assert_eq!(pack(-8, 15), Ok(()));
    assert_eq!(pack(7, -15), Ok(()));
    assert_eq!([pack(8, 1), pack(-9, 1), pack(i8::MIN, 1)], [Err("codes"); 3]);
    assert_eq!([pack(0, 16), pack(0, -16), pack(0, i8::MIN)], [Err("multipliers"); 3]);
    assert_eq!(pack_row_i4(&[0; 40], &[1; 1], 0, &mut panel).map_err(|error| error.arg), Err("multipliers"));
    assert_eq!(pack_row_i4(&[0; 40], &[1; 2], 16, &mut panel).map_err(|error| error.arg), Err("lane"));
    assert_eq!(pack_row_i4(&[0; 400], &[1; 13], 0, &mut panel).map_err(|error| error.arg), Err("panel"));
}

/// Real values: a row alone, and the outputs in two pieces, have the bits of the whole.
fn rows_and_outputs_stand_alone(isa: Isa) {
    for kind in KINDS {
        proptest!(cases(64), |(case in case(kind, kind.tiling(isa)), split in any::<prop::sample::Index>())| {
            let case = Case { scatter: false, gather: false, values: Values::Real, ..case };
            let operands = Operands::new(&case);
            let (Case { m, n, .. }, epilogue) = (case, operands.epilogue());
            let mut results = [(); 3].map(|()| operands.output(false));
            let [whole, alone, pieces] = &mut results;
            operands.plain(isa, 0..m, 0..n, epilogue, whole.mat());
            // A sample of many rows: each of the first blocks, and the last.
            let some = (0..m).filter(|&t| t < 70 || t + 3 > m || t % 11 == 0);
            for t in some.clone() {
                operands.plain(isa, t..t + 1, 0..n, epilogue, alone.mat().split_rows(t).1.split_rows(1).0);
            }
            let at = (split.index(n / PANEL + 1) * PANEL).min(n);
            operands.plain(isa, 0..m, 0..at, epilogue, pieces.mat().split_columns(at).0);
            operands.plain(isa, 0..m, at..n, epilogue, pieces.mat().split_columns(at).1);
            let [whole, alone, pieces] = results.map(|y| bits(&y.checked()));
            prop_assert!(some.clone().all(|t| whole[t] == alone[t]), "rows alone: {:?}", some.clone().find(|&t| whole[t] != alone[t]));
            prop_assert!(whole == pieces, "in two pieces: row {:?}", (0..m).find(|&t| whole[t] != pieces[t]));
        });
    }
}

for_each_isa!(products_match_scalar, large_products_match_scalar => vector);
for_each_isa!(
    sums_are_near_f64,
    int4_sums_reach_the_limit,
    int4_matches_int8,
    int8_sums_reach_the_limit,
    rows_and_outputs_stand_alone
    => every
);
