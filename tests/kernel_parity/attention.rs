//! Attention against f64, exactly if the result can be known exactly; and the same bits for a query
//! alone and among others.

use proptest::prelude::*;
use umo_kernels::attention::{
    HeadCache, Operands, RelativeBias, Visible, attention_bf16, attention_f32, attention_heads_f32,
    encoder_attention_bf16, encoder_attention_f32, heads_tiling, tilings,
};
use umo_kernels::tiling::Tiling;
use umo_kernels::tuning::Tuning;
use umo_kernels::{Bf16, Isa, Mat, PrefetchHint, ShapeError};
use umo_tests::{EPSILON, Fill, Guarded, Noise, Placed, around, bits, cases, fill, for_each_isa, offset};

/// The operands of one call.
#[derive(Clone, Debug)]
struct Case {
    q: Placed<f32>,
    k: Placed<f32>,
    v: Placed<f32>,
    scale: f32,
    bias: Option<(Vec<f32>, usize)>,
    visible: Visible,
    /// Computed by [`encoder_attention_f32`].
    encoder: bool,
}

/// Sizes, masks and offsets; the values come from `seed`.
#[derive(Clone, Debug)]
struct Shape {
    m: usize,
    n: usize,
    dim: usize,
    mask: Mask,
    biased: bool,
    gap: usize,
    offset: usize,
    seed: u64,
}

/// Keys that a query sees, and the function under test.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mask {
    Causal,
    All,
    Encoder,
}

fn mask() -> impl Strategy<Value = Mask> {
    prop_oneof![Just(Mask::Causal), Just(Mask::All), Just(Mask::Encoder)]
}

/// Most multiply-adds of a drawn case: the f64 reference costs a little more.
const MAX_WORK: usize = 800_000;

/// Sizes around the tiles of all functions of the back-end; the model's head width more often than
/// not.
fn shape(isa: Isa) -> impl Strategy<Value = Shape> {
    let sizes =
        prop::sample::select(tilings(isa).to_vec()).prop_flat_map(|Tiling { rows, outputs, inputs, .. }| {
            let dim = prop_oneof![1 => Just(64), 1 => around(inputs)];
            (around(rows), around(outputs), dim)
                .prop_filter("a case of moderate size", |(m, n, dim)| m * n * dim <= MAX_WORK)
        });
    let place = (prop_oneof![Just(0), 0..40_usize], offset());
    (sizes, mask(), any::<bool>(), place, any::<u64>()).prop_map(|((m, n, dim), mask, biased, (gap, offset), seed)| {
        let n = if mask == Mask::Causal { n.max(m) } else { n }.max(1);
        Shape { m, n, dim, mask, biased, gap, offset, seed }
    })
}

impl Shape {
    fn case(&self, scores: Fill, values: Fill, scale: f32, bias: impl Fn(&mut Noise) -> f32) -> Case {
        let mut noise = Noise::new(self.seed);
        let place = |rows, fill: Fill, noise: &mut Noise| {
            Placed::new(rows, self.dim, self.gap, self.offset, || fill.next(noise))
        };
        let q = place(self.m, scores, &mut noise);
        let k = place(self.n, scores, &mut noise);
        let v = place(self.n, values, &mut noise);
        let origin = self.m + noise.below(5);
        let bias = self.biased.then(|| ((0..origin + self.n).map(|_| bias(&mut noise)).collect(), origin));
        let causal = self.mask == Mask::Causal;
        let slack = if causal { self.n - self.m } else { 0 };
        let first = noise.below(slack + 1);
        // Half of the time, the last visible key crosses a multiple of 16 among the first queries.
        let first = if noise.below(2) == 0 { first } else { (first / 16 * 16 + 14).min(slack) };
        let visible = if causal { Visible::Causal { first } } else { Visible::All };
        Case { q, k, v, scale, bias, visible, encoder: self.mask == Mask::Encoder }
    }
}

/// Queries, keys and values.
type Qkv<'a> = (Mat<'a, f32>, Mat<'a, f32>, Mat<'a, f32>);

/// Bound on the terms that tiles may leave out of a product, relative to its size: the second part of one
/// factor is below 2^-7 of it, the third of the other below 2^-15, both ways; and the third parts of both.
const SPLIT: f64 = 2.0 / 4_194_304.0 + 1.0 / 1_073_741_824.0;

impl Case {
    fn run(&self, isa: Isa, gap: usize, offset: usize) -> Vec<Vec<f32>> {
        let (q, k, v) = (self.q.mat(), self.k.mat(), self.v.mat());
        let mut y = Guarded::new(q.rows(), q.cols(), gap, offset);
        self.call(isa, (q, k, v), 0, self.visible, &mut y);
        y.checked()
    }

    /// Calls the kernel for the queries `q`, the first of which is query `i` of this case.
    fn call(&self, isa: Isa, (q, k, v): Qkv, i: usize, visible: Visible, y: &mut Guarded<f32>) {
        let bias = self.bias.as_ref().map(|(values, origin)| RelativeBias { values, origin: origin - i });
        let operands = Operands::new(q, k, v, self.scale).biased(bias).seeing(visible);
        let attention = if self.encoder { encoder_attention_f32 } else { attention_f32 };
        attention(isa, operands, y.mat()).expect("shapes agree");
    }

    /// Result of query `i` alone.
    fn run_alone(&self, isa: Isa, i: usize) -> Vec<f32> {
        let (q, k, v) = (self.q.mat().row_range(i..i + 1), self.k.mat(), self.v.mat());
        let mut y = Guarded::new(1, q.cols(), 0, 0);
        let visible = match self.visible {
            Visible::All => Visible::All,
            Visible::Causal { first } => Visible::Causal { first: first + i },
        };
        self.call(isa, (q, k, v), i, visible, &mut y);
        y.checked().remove(0)
    }

    /// Scores of query `i` in f64 for each key that it sees, with `scale * sum(abs(q * k)) +
    /// abs(bias)`.
    fn scores(&self, i: usize) -> Vec<(f64, f64)> {
        let keys = match self.visible {
            Visible::All => self.k.mat().rows(),
            Visible::Causal { first } => first + i + 1,
        };
        let score = |j: usize| {
            let products = self.q.mat().row(i).iter().zip(self.k.mat().row(j));
            let products = products.map(|(&q, &k)| f64::from(q) * f64::from(k) * f64::from(self.scale));
            let bias = self.bias.as_ref().map_or(0.0, |(values, origin)| f64::from(values[origin + j - i]));
            products.fold((bias, bias.abs()), |(sum, size), product| (sum + product, size + product.abs()))
        };
        (0..keys).map(score).collect()
    }

    /// Row `i` in f64, each value with the error bound of f32.
    ///
    /// A score is a sum of `dim + 2` terms; its error `d` changes its weight by the factor
    /// `exp(d)`, and so does the rounding of the difference from the maximum. Each tile of at least
    /// 16 keys may rescale once more: two roundings and one `exp`, whose error is below 3 units.
    /// Weights and weighted values are then sums of `keys` terms. Tiles add six products for one,
    /// which is off by [`SPLIT`].
    fn exact(&self, isa: Isa, i: usize) -> Vec<(f64, f64)> {
        let (parts, split) = if self.encoder && isa.name() == "amx" { (6.0, SPLIT) } else { (1.0, 0.0) };
        let (scores, dim) = (self.scores(i), self.q.mat().cols());
        let keys = scores.len() as f64;
        let tiles = 1.0 + keys / 16.0;
        let max = scores.iter().fold(f64::NEG_INFINITY, |max, score| max.max(score.0));
        let size = scores.iter().fold(0.0_f64, |size, score| size.max(score.1));
        let weights: Vec<f64> = scores.iter().map(|score| (score.0 - max).exp()).collect();
        let total: f64 = weights.iter().sum();
        let score_error = ((parts * dim as f64 + 4.0) * EPSILON + split) * size + 5.0 * tiles * EPSILON;
        let relative = (2.0 * score_error).exp_m1() + ((1.0 + parts) * keys + 4.0) * EPSILON + split;
        (0..dim)
            .map(|c| {
                let terms = weights.iter().enumerate().map(|(j, w)| w / total * f64::from(self.v.mat().row(j)[c]));
                let (sum, sizes) = terms.fold((0.0, 0.0), |(sum, sizes), term| (sum + term, sizes + term.abs()));
                let largest = (0..scores.len()).map(|j| f64::from(self.v.mat().row(j)[c]).abs()).fold(0.0, f64::max);
                (sum, relative * sizes + 4.0 * parts * keys * f64::from(f32::MIN_POSITIVE) * (1.0 + largest))
            })
            .collect()
    }
}

fn attention_is_near_f64(isa: Isa) {
    let scores =
        prop_oneof![Just(Fill::Uniform(1.0)), Just(Fill::Uniform(0.2)), Just(Fill::Integer(2)), Just(Fill::Tiny)];
    let scale = prop_oneof![Just(1.0_f32), Just(0.125)];
    proptest!(cases(48), |(shape in shape(isa), scores in scores, values in fill(), scale in scale)| {
        let case = shape.case(scores, values, scale, |noise| noise.float(4.0));
        for (i, row) in case.run(isa, shape.gap, shape.offset).iter().enumerate() {
            for (c, (&got, (want, tolerance))) in row.iter().zip(case.exact(isa, i)).enumerate() {
                let error = (f64::from(got) - want).abs();
                prop_assert!(error <= tolerance, "y[{i}][{c}] = {got}, not {want}: off by {error:e} > {tolerance:e}");
            }
        }
    });
}

/// Scores are multiples of 128, so that every weight is exactly 0 or 1, and the result is the mean
/// of the best keys' values: an integer sum, exact in any order, divided once.
fn attention_is_exact_where_weights_are_0_or_1(isa: Isa) {
    proptest!(cases(48), |(shape in shape(isa))| {
        let case = shape.case(Fill::Integer(2), Fill::Integer(16), 128.0, |noise| 128.0 * noise.integer(9));
        for (i, row) in case.run(isa, shape.gap, shape.offset).iter().enumerate() {
            let scores = case.scores(i);
            let max = scores.iter().fold(f64::NEG_INFINITY, |max, score| max.max(score.0));
            let best: Vec<usize> = (0..scores.len()).filter(|&j| scores[j].0 == max).collect();
            for (c, &got) in row.iter().enumerate() {
                let sum: f32 = best.iter().map(|&j| case.v.mat().row(j)[c]).sum();
                prop_assert_eq!(got, sum / best.len() as f32, "y[{}][{}], best keys {:?}", i, c, best);
            }
        }
    });
}

/// Factors with all mantissa bits of f32, in either operand and in both: biases cancel all but a
/// small integer, so that a score that lost its last bits would give very different weights.
/// Values have all their bits too.
fn encoder_attention_keeps_every_bit(isa: Isa) {
    const KEYS: usize = 100;
    let mut noise = Noise::new(11);
    let wide = |noise: &mut Noise, bits: u32| (noise.below(1 << bits) as f32 + 1.0) * [-1.0, 1.0][noise.below(2)];
    for (q_bits, k_bits) in [(23, 0), (0, 23), (12, 11), (11, 12), (6, 17), (17, 6)] {
        for dim in [1, 20, 64] {
            let (at, scale) = (noise.below(dim), wide(&mut noise, q_bits));
            let keys: Vec<f32> = (0..KEYS).map(|_| wide(&mut noise, k_bits)).collect();
            let rests: Vec<f32> = (0..KEYS).map(|_| -noise.integer(4).abs()).collect();
            let mut element = 0..;
            let mut one = |value: &dyn Fn(usize) -> f32| {
                let i: usize = element.next().expect("endless");
                if i % dim == at { value(i / dim) } else { 0.0 }
            };
            let q = Placed::new(1, dim, 0, 0, || one(&|_| scale));
            let k = Placed::new(KEYS, dim, 0, 0, || one(&|row| keys[row - 1]));
            let v = Placed::new(KEYS, dim, 0, 0, || noise.float(1.0));
            let bias: Vec<f32> = keys.iter().zip(&rests).map(|(key, rest)| rest - scale * key).collect();
            let mut y = Guarded::new(1, dim, 0, 0);
            let relative = RelativeBias { values: &bias, origin: 0 };
            let operands = Operands::new(q.mat(), k.mat(), v.mat(), 1.0).biased(relative);
            encoder_attention_f32(isa, operands, y.mat()).expect("shapes agree");
            let weights: Vec<f64> = rests.iter().map(|&rest| f64::from(rest).exp()).collect();
            let total: f64 = weights.iter().sum();
            for (c, got) in y.checked()[0].iter().enumerate() {
                let terms = weights.iter().enumerate().map(|(j, w)| w / total * f64::from(v.mat().row(j)[c]));
                let (want, size) = terms.fold((0.0, 0.0), |(sum, size), term| (sum + term, size + term.abs()));
                let error = (f64::from(*got) - want).abs();
                assert!(
                    error <= 16.0 * EPSILON * size,
                    "{q_bits} x {k_bits} bits, {dim} wide, y[{c}]: off by {error:e}"
                );
            }
        }
    }
}

fn attention_rows_are_independent(isa: Isa) {
    proptest!(cases(32), |(shape in shape(isa))| {
        let case = shape.case(Fill::Uniform(1.0), Fill::Uniform(1.0), 1.0, |noise| noise.float(4.0));
        let together = case.run(isa, 0, 0);
        let alone: Vec<_> = (0..shape.m).map(|i| case.run_alone(isa, i)).collect();
        prop_assert_eq!(bits(&together), bits(&alone));
        for tuning in Tuning::ALL {
            let tuned = case.run(isa.with_tuning(tuning), shape.gap, shape.offset);
            prop_assert_eq!(bits(&together), bits(&tuned), "with {:?}", tuning);
        }
    });
}

/// More queries than one block holds.
fn attention_row_is_the_same_among_many(isa: Isa) {
    let most = tilings(isa).iter().flat_map(|tiling| tiling.rows).copied().max().expect("three lists");
    let count = most.max(467) + 33;
    for mask in [Mask::Causal, Mask::All, Mask::Encoder] {
        let shape = Shape { m: count, n: count, dim: 64, mask, biased: true, gap: 3, offset: 1, seed: 7 };
        let case = shape.case(Fill::Uniform(1.0), Fill::Uniform(1.0), 1.0, |noise| noise.float(4.0));
        let together = case.run(isa, 0, 0);
        let some = (0..shape.m).step_by(7);
        let alone: Vec<_> = some.clone().map(|i| case.run_alone(isa, i)).collect();
        let together: Vec<_> = some.map(|i| together[i].clone()).collect();
        assert_eq!(bits(&together), bits(&alone));
    }
}

/// A key that no query sees may have any values.
fn attention_ignores_hidden_keys(isa: Isa) {
    proptest!(cases(24), |(shape in shape(isa), junk in prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(-1e38)])| {
        let shape = Shape { mask: Mask::Causal, n: shape.n.max(shape.m) + 70, ..shape };
        let mut case = shape.case(Fill::Uniform(1.0), Fill::Uniform(1.0), 1.0, |noise| noise.float(4.0));
        let first = Noise::new(shape.seed).below(60);
        case.visible = Visible::Causal { first };
        let clean = case.run(isa, 0, 0);
        let seen = first + shape.m;
        let spoil = |from: &Placed<f32>| {
            let mut at = 0;
            let stride = shape.dim + shape.gap;
            Placed::new(shape.n, shape.dim, shape.gap, 0, || {
                let (row, column) = (at / stride.max(1), at % stride.max(1));
                at += 1;
                if row >= seen || column >= shape.dim { junk } else { from.mat().row(row)[column] }
            })
        };
        (case.k, case.v) = (spoil(&case.k), spoil(&case.v));
        prop_assert_eq!(bits(&clean), bits(&case.run(isa, 0, 0)));
    });
}

/// Half a unit in the last place of bfloat16, relative.
const HALF_UNIT: f64 = 1.0 / 256.0;

/// [`encoder_attention_bf16`] of the queries `rows` of a case made for [`Mask::Encoder`].
fn run_rounded(case: &Case, isa: Isa, rows: core::ops::Range<usize>, (gap, offset): (usize, usize)) -> Vec<Vec<f32>> {
    let bias = case.bias.as_ref().map(|(values, origin)| RelativeBias { values, origin: origin - rows.start });
    let (q, k, v) = (case.q.mat().row_range(rows), case.k.mat(), case.v.mat());
    let mut y = Guarded::new(q.rows(), q.cols(), gap, offset);
    encoder_attention_bf16(isa, Operands::new(q, k, v, case.scale).biased(bias), y.mat()).expect("shapes agree");
    y.checked()
}

/// The case with every factor rounded to bfloat16, a fixed point of the kernel's own rounding.
fn rounded(case: &Case, shape: &Shape) -> Case {
    let rounded = |from: &Placed<f32>| {
        let rows = from.mat().rows();
        let mut elements = (0..rows).flat_map(|i| from.mat().row(i)).map(|&v| Bf16::from_f32(v).to_f32());
        Placed::new(rows, shape.dim, 0, 0, || elements.next().unwrap_or(0.0))
    };
    Case { q: rounded(&case.q), k: rounded(&case.k), v: rounded(&case.v), ..case.clone() }
}

/// Against f64 over rounded factors: the remaining errors are f32's own, and half a unit of bfloat16
/// for each weight.
fn encoder_attention_bf16_is_near_f64(isa: Isa) {
    let scores = prop_oneof![Just(Fill::Uniform(1.0)), Just(Fill::Uniform(0.2)), Just(Fill::Integer(2))];
    let scale = prop_oneof![Just(1.0_f32), Just(0.125)];
    proptest!(cases(48), |(shape in shape(isa), scores in scores, values in fill(), scale in scale)| {
        let shape = Shape { mask: Mask::Encoder, ..shape };
        let case = shape.case(scores, values, scale, |noise| noise.float(4.0));
        let exact = rounded(&case, &shape);
        for (i, row) in run_rounded(&case, isa, 0..shape.m, (shape.gap, shape.offset)).iter().enumerate() {
            for (c, (&got, (want, tolerance))) in row.iter().zip(exact.exact(isa, i)).enumerate() {
                let weights: Vec<f64> = exact.scores(i).iter().map(|score| score.0).collect();
                let max = weights.iter().fold(f64::NEG_INFINITY, |max, &score| max.max(score));
                let weights: Vec<f64> = weights.iter().map(|score| (score - max).exp()).collect();
                let value = |j: usize| f64::from(exact.v.mat().row(j)[c]).abs();
                let sizes: f64 = weights.iter().enumerate().map(|(j, weight)| weight * value(j)).sum();
                let sizes = sizes / weights.iter().sum::<f64>();
                // The polynomial's error is in a weight and in the sum of all weights; the logarithm's base
                // costs a score two roundings.
                let tolerance = 2.0 * tolerance + (HALF_UNIT + 2.0 * 1.04e-4 + 2e-5) * sizes * 1.01;
                let error = (f64::from(got) - want).abs();
                prop_assert!(error <= tolerance, "y[{i}][{c}] = {got}, not {want}: off by {error:e} > {tolerance:e}");
            }
        }
    });
}

/// The bits of the scalar back-end for any shape, and of a row alone. Denormal results may be
/// flushed to 0.
fn encoder_attention_bf16_has_scalar_bits(isa: Isa) {
    // Also scores within a few tenths of their maximum: there the fraction of a power of 2 has more
    // bits than f32 keeps, and its rounding is visible. With scores further apart the fraction is
    // exact, or the weights are too small to see it.
    let scores = prop_oneof![
        2 => Just(Fill::Uniform(0.2)),
        1 => Just(Fill::Uniform(1.0)),
        1 => Just(Fill::Uniform(9.0)),
        1 => fill(),
    ];
    let bias = prop_oneof![Just(0.01_f32), Just(0.5), Just(40.0)];
    let cases = cases(96);
    proptest!(cases, |(shape in shape(isa), scores in scores, values in fill(), long in any::<bool>(), bias in bias)| {
        let n = if long && shape.n > 100 { shape.n + 256 } else { shape.n };
        let shape = Shape { mask: Mask::Encoder, n, ..shape };
        let case = shape.case(scores, values, 0.7, |noise| noise.float(bias));
        let got = run_rounded(&case, isa, 0..shape.m, (shape.gap, shape.offset));
        let want = run_rounded(&case, Isa::SCALAR, 0..shape.m, (0, 0));
        for (i, (got, want)) in got.iter().zip(&want).enumerate() {
            for (c, (&got, &want)) in got.iter().zip(want).enumerate() {
                let same = got == want || !(got.is_finite() || want.is_finite());
                prop_assert!(same || (got - want).abs() < 1e-36, "y[{i}][{c}] = {got:e}, not {want:e}");
            }
            if i % 5 == 0 {
                let alone = run_rounded(&case, isa, i..i + 1, (0, 0));
                prop_assert_eq!(bits(&alone), bits(core::slice::from_ref(got)));
            }
        }
    });
}

/// One query and two keys whose scores differ by less than 1: the fraction of the smaller weight's
/// exponent is rounded to the nearest float.
fn encoder_attention_bf16_rounds_to_nearest(isa: Isa) {
    let q = Mat::new(&[0.084_338_43], 1, 1).unwrap();
    let (k, v) = ([0.040_887_237, 0.125_846_5], [-0.984_375, -0.746_093_75]);
    let (k, v) = (Mat::new(&k, 2, 1).unwrap(), Mat::new(&v, 2, 1).unwrap());
    let mut y = Guarded::new(1, 1, 0, 0);
    encoder_attention_bf16(isa, Operands::new(q, k, v, 1.0), y.mat()).unwrap();
    assert_eq!(y.checked(), [[-0.864_481_7]]);
}

/// Non-finite inputs make the dependent outputs non-finite, and change nothing else.
fn encoder_attention_bf16_propagates_nonfinite_values(isa: Isa) {
    proptest!(cases(24), |(shape in shape(isa), junk in prop_oneof![Just(f32::NAN), Just(f32::INFINITY), Just(f32::NEG_INFINITY)])| {
        let shape = Shape { mask: Mask::Encoder, m: shape.m.max(1), dim: shape.dim.max(2), ..shape };
        let case = shape.case(Fill::Uniform(1.0), Fill::Uniform(1.0), 1.0, |noise| noise.float(4.0));
        let clean = run_rounded(&case, isa, 0..shape.m, (0, 0));
        let mut noise = Noise::new(shape.seed);
        let spoil = |from: &Placed<f32>, row: usize, column: usize| {
            let mut at = 0;
            Placed::new(from.mat().rows(), shape.dim, 0, 0, || {
                let (r, c) = (at / shape.dim, at % shape.dim);
                at += 1;
                if (r, c) == (row, column) || r >= from.mat().rows() { junk } else { from.mat().row(r)[c] }
            })
        };
        let (row, key, column) = (noise.below(shape.m), noise.below(shape.n), noise.below(shape.dim));
        let spoiled = Case { q: spoil(&case.q, row, column), ..case.clone() };
        for (i, (got, clean)) in run_rounded(&spoiled, isa, 0..shape.m, (0, 0)).iter().zip(&clean).enumerate() {
            if i == row {
                prop_assert!(got.iter().all(|y| y.is_nan()), "query {i} is not NaN: {got:?}");
            } else {
                prop_assert_eq!(got, clean, "query {} has nothing to do with query {}", i, row);
            }
        }
        let spoiled = Case { v: spoil(&case.v, key, column), ..case.clone() };
        for (got, clean) in run_rounded(&spoiled, isa, 0..shape.m, (0, 0)).iter().zip(&clean) {
            for (c, (got, clean)) in got.iter().zip(clean).enumerate() {
                prop_assert_eq!(got == clean, c != column, "value {}, column {}: {}", key, c, got);
                prop_assert!(c != column || !got.is_finite());
            }
        }
    });
}

/// Keys and values stored as bfloat16 give the bits of the same numbers stored as f32, for any
/// number of queries, so the other tests apply to them too.
fn attention_bf16_is_attention_over_widened_keys_and_values(isa: Isa) {
    proptest!(cases(48), |(shape in shape(isa), values in fill())| {
        let shape = Shape { mask: if shape.mask == Mask::Encoder { Mask::All } else { shape.mask }, ..shape };
        let case = shape.case(Fill::Uniform(1.0), values, 1.0, |noise| noise.float(4.0));
        let mut noise = Noise::new(shape.seed);
        let mut stored = |fill: Fill| {
            Placed::new(shape.n, shape.dim, shape.gap, shape.offset, || Bf16::from_f32(fill.next(&mut noise)))
        };
        let (k, v) = (stored(Fill::Uniform(1.0)), stored(values));
        let widen = |from: &Placed<Bf16>| {
            let mut elements = (0..shape.n).flat_map(|i| from.mat().row(i)).map(|v| v.to_f32());
            Placed::new(shape.n, shape.dim, 0, 0, || elements.next().expect("as many as there are"))
        };
        let widened = Case { k: widen(&k), v: widen(&v), ..case.clone() }.run(isa, 0, 0);
        let q = case.q.mat();
        let bias = |i| case.bias.as_ref().map(|(values, origin)| RelativeBias { values, origin: origin - i });
        // A prefetch hint changes nothing, whatever it names.
        let ahead = PrefetchHint::new(k.mat().elements(), v.mat().elements());
        let mut together = Guarded::new(shape.m, shape.dim, shape.gap, shape.offset);
        for tuning in Tuning::ALL {
            let isa = isa.with_tuning(tuning);
            let operands = Operands::new(q, k.mat(), v.mat(), case.scale).biased(bias(0)).seeing(case.visible);
            attention_bf16(isa, operands.hinting(ahead), together.mat()).expect("shapes agree");
            prop_assert_eq!(bits(&together.checked()), bits(&widened), "with {:?}", tuning);
        }
        for (i, want) in widened.iter().enumerate() {
            let visible = match case.visible {
                Visible::All => Visible::All,
                Visible::Causal { first } => Visible::Causal { first: first + i },
            };
            let mut alone = Guarded::new(1, shape.dim, 0, 0);
            let q = q.row_range(i..i + 1);
            let operands = Operands::new(q, k.mat(), v.mat(), case.scale).biased(bias(i)).seeing(visible);
            attention_bf16(isa, operands.hinting(ahead), alone.mat()).expect("shapes agree");
            prop_assert_eq!(bits(&alone.checked()), bits(core::slice::from_ref(want)));
        }
    });
}

/// All heads of some rows in one call give the bits of one call for each, whatever the places
/// without a key hold.
fn attention_heads_are_those_of_calls_of_their_own(isa: Isa) {
    let Tiling { rows: heads, outputs, inputs, .. } = heads_tiling(isa);
    let dim = prop_oneof![3 => prop::sample::select(vec![32_usize, 48, 64]), 2 => around(inputs)];
    let sizes = (0..4_usize, around(heads), around(outputs), dim, 0..6_usize);
    let fills = prop_oneof![Just(Fill::Uniform(1.0)), Just(Fill::Uniform(0.2)), Just(Fill::Uniform(9.0))];
    let places = (0..40_usize, offset(), any::<u64>());
    proptest!(cases(96), |(sizes in sizes, scores in fills, values in fill(), (gap, offset, seed) in places)| {
        let (rows, heads, filled, dim, spare) = (sizes.0, sizes.1.max(1), sizes.2.max(1), sizes.3.max(1), sizes.4);
        let (places, mut noise) = (filled + spare, Noise::new(seed));
        let q = Placed::new(rows, heads * dim, gap, offset, || scores.next(&mut noise));
        let mut kept = |fill: Fill| {
            let mut at = 0;
            Placed::new(rows * heads * places, dim, 0, offset, || {
                at += 1;
                let value = fill.next(&mut noise);
                if (at - 1) / dim % places < filled { value } else { f32::NAN }
            })
        };
        let (k, v) = (kept(scores), kept(values));
        let cache = HeadCache { keys: k.elements(), values: v.elements(), heads, places, filled };
        let mut y = Guarded::new(rows, heads * dim, gap, offset);
        attention_heads_f32(isa, q.mat(), cache, 0.125, y.mat()).expect("shapes agree");
        for (row, got) in y.checked().iter().enumerate() {
            for (head, got) in got.chunks_exact(dim).enumerate() {
                let first = (row * heads + head) * places;
                let [k, v] = [&k, &v].map(|kept| kept.mat().row_range(first..first + filled));
                let q = q.mat().row_range(row..row + 1).columns(head * dim..(head + 1) * dim);
                let mut alone = Guarded::new(1, dim, 0, 0);
                attention_f32(isa, Operands::new(q, k, v, 0.125), alone.mat()).expect("shapes agree");
                prop_assert_eq!(bits(&[got.to_vec()]), bits(&alone.checked()), "row {}, head {}", row, head);
            }
        }
    });
}

for_each_isa!(
    attention_heads_are_those_of_calls_of_their_own,
    attention_is_near_f64,
    attention_is_exact_where_weights_are_0_or_1,
    encoder_attention_keeps_every_bit,
    encoder_attention_bf16_is_near_f64,
    encoder_attention_bf16_has_scalar_bits,
    encoder_attention_bf16_rounds_to_nearest,
    encoder_attention_bf16_propagates_nonfinite_values,
    attention_bf16_is_attention_over_widened_keys_and_values,
    attention_rows_are_independent,
    attention_row_is_the_same_among_many,
    attention_ignores_hidden_keys
    => every
);

#[test]
fn attention_rejects_shapes_that_disagree() {
    let input = Placed::new(3, 4, 0, 0, || 1.0_f32);
    let (three, two, narrow) = (input.mat(), input.mat().row_range(0..2), input.mat().columns(0..3));
    let none = input.mat().row_range(0..0);
    let call = |q, k, v, bias, visible| {
        let mut y = Guarded::new(3, 4, 0, 0);
        let operands = Operands::new(q, k, v, 1.0).biased(bias).seeing(visible);
        attention_f32(Isa::SCALAR, operands, y.mat()).map_err(|error: ShapeError| error.arg)
    };
    let short = Some(RelativeBias { values: &[0.0; 4], origin: 2 });
    let late = Some(RelativeBias { values: &[0.0; 9], origin: 1 });
    assert_eq!(call(three, three, three, None, Visible::All), Ok(()));
    assert_eq!(call(three, narrow, three, None, Visible::All), Err("k"));
    assert_eq!(call(three, three, two, None, Visible::All), Err("v"));
    assert_eq!(call(three, three, narrow, None, Visible::All), Err("v"));
    assert_eq!(call(two, three, three, None, Visible::All), Err("y"));
    assert_eq!(call(three, none, none, None, Visible::All), Err("k"));
    assert_eq!(call(three, three, three, None, Visible::Causal { first: 1 }), Err("k"));
    assert_eq!(call(three, three, three, short, Visible::All), Err("bias.values"));
    assert_eq!(call(three, three, three, late, Visible::All), Err("bias.origin"));
}

#[test]
fn attention_of_heads_rejects_shapes_that_disagree() {
    let (input, kept) = (Placed::new(2, 6, 0, 0, || 1.0_f32), [1.0_f32; 36]);
    let call = |(heads, places, filled), keys: &[f32], values: &[f32], rows| {
        let mut y = Guarded::new(rows, 6, 0, 0);
        let cache = HeadCache { keys, values, heads, places, filled };
        attention_heads_f32(Isa::SCALAR, input.mat(), cache, 1.0, y.mat()).map_err(|error: ShapeError| error.arg)
    };
    assert_eq!(call((2, 3, 3), &kept, &kept, 2), Ok(()));
    assert_eq!(call((2, 3, 3), &kept, &kept, 1), Err("y"));
    assert_eq!(call((0, 3, 3), &kept, &kept, 2), Err("cache.heads"));
    assert_eq!(call((4, 3, 3), &kept, &kept, 2), Err("cache.heads"));
    assert_eq!(call((2, 3, 0), &kept, &kept, 2), Err("cache.filled"));
    assert_eq!(call((2, 3, 4), &kept, &kept, 2), Err("cache.filled"));
    assert_eq!(call((2, 3, 3), &kept[1..], &kept, 2), Err("cache.keys"));
    assert_eq!(call((2, 3, 3), &kept, &kept[1..], 2), Err("cache.values"));
}
