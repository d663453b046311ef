//! Every product on every back-end against its scalar reference: sizes around all tile edges, any alignment, gathered and
//! scattered rows, all ends, extremes; and the two promises that callers build on, that a row's bits depend neither on
//! the rows beside it nor on how the outputs are cut. Shapes of the int8 product's own tiles are in `tiles`.
#![expect(clippy::cast_possible_truncation, reason = "sizes of cases are far below 2^32")]

mod bf16;
mod support;
mod tiles;

use proptest::prelude::*;
use umo_kernels::activation::Activation;
use umo_kernels::gemm::{Epilogue, Input, Scatter};
use umo_kernels::matmul_bf16::{matmul_bf16, matmul_gated_bf16};
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i8::{MAX_K, matmul_gated_i8, matmul_i8};
use umo_kernels::pack::{PANEL, pack, pack_bf16, pack_i8, packed_len, packed_len_bf16, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI8};

use support::{Guarded, Numbers, Shifted, config, for_each_isa, isa, near};

#[derive(Clone, Copy, Debug)]
enum Fill {
    Random,
    Least,
    Greatest,
}

#[derive(Clone, Debug)]
struct Case {
    m: usize,
    n: usize,
    k: usize,
    seed: u64,
    offset: usize,
    gap: usize,
    gather: bool,
    scatter: bool,
    bias: bool,
    add: bool,
    activation: Activation,
    fill: Fill,
}

fn activation() -> impl Strategy<Value = Activation> {
    prop_oneof![
        3 => Just(Activation::None),
        1 => Just(Activation::Relu),
        1 => Just(Activation::LeakyRelu(0.25)),
        1 => Just(Activation::Gelu),
        1 => Just(Activation::GeluTanh),
    ]
}

fn case() -> impl Strategy<Value = Case> {
    // Rows around the tiles of float products and of 16; outputs around panels, a chunk of 16 panels too; inputs around quads,
    // registers and the blocks of 512 and 2048.
    let m = prop_oneof![4 => 0_usize..=17, 1 => near(14, 2), 1 => near(16, 5)];
    let n = prop_oneof![4 => near(PANEL, 4), 1 => near(16 * PANEL, 1)];
    let k = prop_oneof![2 => near(4, 6), 4 => near(64, 3), 1 => near(512, 1), 1 => near(2048, 1)];
    let shape = (m, n, k).prop_filter("a case of moderate size", |(m, n, k)| m * n * k <= 300_000);
    let fill = prop_oneof![6 => Just(Fill::Random), 1 => Just(Fill::Least), 1 => Just(Fill::Greatest)];
    let flags = (any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>());
    (shape, any::<u64>(), 0_usize..64, 0_usize..3, flags, activation(), fill).prop_map(
        |((m, n, k), seed, offset, gap, (gather, scatter, bias, add), activation, fill)| Case {
            m,
            n,
            k,
            seed,
            offset,
            gap,
            gather,
            scatter,
            bias,
            add,
            activation,
            fill,
        },
    )
}

/// Operands of one case.
struct Operands {
    case: Case,
    x: Shifted<i8>,
    x_f32: Shifted<f32>,
    x_scale: Vec<f32>,
    index: Vec<u32>,
    w: [Vec<i8>; 2],
    packed: [Shifted<i8>; 2],
    sum: [Vec<i32>; 2],
    w_scale: Shifted<f32>,
    w_f32: [Vec<f32>; 2],
    packed_f32: [Shifted<f32>; 2],
    packed_bf16: [Shifted<Bf16>; 2],
    bias: Shifted<f32>,
    rows: Vec<u32>,
    weight: Vec<f32>,
}

impl Operands {
    /// Floats are integers of at most 16, so that every partial sum is exact.
    fn new(case: &Case) -> Self {
        Self::with(case, Numbers::integer)
    }

    fn with(case: &Case, float: fn(&mut Numbers) -> f32) -> Self {
        let &Case { m, n, k, seed, offset, .. } = case;
        let mut numbers = Numbers(seed);
        let sources = if case.gather { m + 3 } else { m };
        let step = |numbers: &mut Numbers| match case.fill {
            Fill::Random => numbers.step(),
            Fill::Least => i8::MIN,
            Fill::Greatest => i8::MAX,
        };
        let x: Vec<i8> = (0..sources * k).map(|_| step(&mut numbers)).collect();
        let x_f32: Vec<f32> = (0..sources * k).map(|_| float(&mut numbers)).collect();
        let w: [Vec<i8>; 2] = std::array::from_fn(|_| (0..n * k).map(|_| step(&mut numbers)).collect());
        let w_f32: [Vec<f32>; 2] = std::array::from_fn(|_| (0..n * k).map(|_| float(&mut numbers)).collect());
        let mut sum = [vec![0; n], vec![0; n]];
        let packed = std::array::from_fn(|i| {
            let mut packed = vec![0; packed_len_i8(n, k)];
            pack_i8(Mat::new(&w[i], n, k).unwrap(), &mut packed, &mut sum[i]).unwrap();
            Shifted::new(&packed, offset)
        });
        let packed_f32 = std::array::from_fn(|i| {
            let mut packed = vec![0.0; packed_len(n, k)];
            pack(Mat::new(&w_f32[i], n, k).unwrap(), &mut packed).unwrap();
            Shifted::new(&packed, offset)
        });
        let packed_bf16 = std::array::from_fn(|i| {
            let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
            pack_bf16(Mat::new(&w_f32[i], n, k).unwrap(), &mut packed).unwrap();
            Shifted::new(&packed, offset)
        });
        let y_rows = m.max(1) + 2;
        Self {
            x: Shifted::new(&x, offset),
            x_f32: Shifted::new(&x_f32, offset),
            x_scale: (0..sources).map(|_| numbers.real()).collect(),
            index: (0..m).map(|_| numbers.below(sources) as u32).collect(),
            w,
            packed,
            sum,
            w_scale: Shifted::new(&(0..n).map(|_| numbers.real()).collect::<Vec<_>>(), offset),
            w_f32,
            packed_f32,
            packed_bf16,
            bias: Shifted::new(&(0..n).map(|_| numbers.integer()).collect::<Vec<_>>(), offset),
            rows: (0..m).map(|_| numbers.below(y_rows) as u32).collect(),
            weight: (0..m).map(|_| numbers.integer() / 4.0).collect(),
            case: case.clone(),
        }
    }

    fn end(&self) -> Epilogue<'_> {
        Epilogue {
            bias: self.case.bias.then(|| self.bias.get()),
            activation: self.case.activation,
            add: self.case.add,
            scatter: self.case.scatter.then(|| Scatter { rows: &self.rows, weight: &self.weight }),
        }
    }

    fn index(&self) -> Option<&[u32]> {
        self.case.gather.then_some(&self.index[..])
    }

    fn output(&self, scatter: bool) -> Guarded {
        let rows = if scatter { self.case.m.max(1) + 2 } else { self.case.m };
        Guarded::new(rows, self.case.n, self.case.gap, self.case.offset, 3.0)
    }

    fn input_f32(&self) -> Input<'_, f32> {
        let mat = Mat::new(self.x_f32.get(), self.x_scale.len(), self.case.k).unwrap();
        self.index().map_or(Input::all(mat), |index| Input::gather(mat, index).unwrap())
    }

    fn input_i8(&self) -> QuantRows<'_> {
        QuantRows::new(Mat::new(self.x.get(), self.x_scale.len(), self.case.k).unwrap(), &self.x_scale).unwrap()
    }

    fn w_i8(&self, i: usize) -> PackedI8<'_> {
        let Case { n, k, .. } = self.case;
        PackedI8::new(self.packed[i].get(), self.w_scale.get(), &self.sum[i], n, k).unwrap()
    }

    fn w_f32(&self, i: usize) -> PackedF32<'_> {
        PackedF32::new(self.packed_f32[i].get(), self.case.n, self.case.k).unwrap()
    }

    fn w_bf16(&self, i: usize) -> PackedBf16<'_> {
        PackedBf16::new(self.packed_bf16[i].get(), self.case.n, self.case.k).unwrap()
    }

    /// Bits of every product of this case.
    fn run(&self, isa: Isa) -> Vec<(&'static str, Vec<Vec<u32>>)> {
        let (end, index) = (self.end(), self.index());
        let mut results = Vec::new();
        let mut product = |name, scatter, product: &dyn Fn(MatMut<f32>)| {
            let mut y = self.output(scatter);
            product(y.view());
            results.push((name, y.bits()));
        };
        let scatter = self.case.scatter;
        product("i8", scatter, &|y| matmul_i8(isa, self.input_i8(), index, self.w_i8(0), end, y).unwrap());
        product("f32", scatter, &|y| matmul_f32(isa, self.input_f32(), self.w_f32(0), end, y).unwrap());
        product("bf16", scatter, &|y| matmul_bf16(isa, self.input_f32(), self.w_bf16(0), end, y).unwrap());
        product("gated i8", false, &|y| {
            matmul_gated_i8(isa, self.input_i8(), index, self.w_i8(0), self.w_i8(1), y).unwrap();
        });
        product("gated f32", false, &|y| {
            matmul_gated_f32(isa, self.input_f32(), self.w_f32(0), self.w_f32(1), y).unwrap();
        });
        product("gated bf16", false, &|y| {
            matmul_gated_bf16(isa, self.input_f32(), self.w_bf16(0), self.w_bf16(1), y).unwrap();
        });
        results
    }
}

/// int8 on any values, floats on integers: all bits, with every end.
fn products_match_scalar(isa: Isa) {
    proptest!(config(256), |(case in case())| {
        let operands = Operands::new(&case);
        prop_assert_eq!(operands.run(isa), operands.run(Isa::SCALAR));
    });
}

/// int8 sums against 64-bit arithmetic, so that scalar and vectors cannot be wrong together.
fn int8_sums_are_exact(isa: Isa) {
    proptest!(config(128), |(case in case())| {
        let operands = Operands::new(&case);
        let x = operands.x.get();
        let mut y = operands.output(false);
        matmul_i8(isa, operands.input_i8(), operands.index(), operands.w_i8(0), Epilogue::STORE, y.view()).unwrap();
        for (t, row) in y.bits().iter().enumerate() {
            let source = operands.index().map_or(t, |index| index[t] as usize);
            for (o, &bits) in row.iter().enumerate() {
                let pairs = x[source * case.k..][..case.k].iter().zip(&operands.w[0][o * case.k..][..case.k]);
                let sum: i64 = pairs.map(|(&x, &w)| i64::from(x) * i64::from(w)).sum();
                let want = sum as f32 * (operands.x_scale[source] * operands.w_scale.get()[o]);
                prop_assert_eq!(f32::from_bits(bits), want);
            }
        }
    });
}

/// The longest sum of the greatest products, which is one below the limit of 32 bits, in tiles of one and of many rows.
fn int8_sums_reach_the_limit(isa: Isa) {
    for (x_step, w_step) in [(i8::MIN, i8::MIN), (i8::MIN, i8::MAX), (i8::MAX, i8::MIN), (i8::MAX, i8::MAX)] {
        for m in [1, if isa == Isa::SCALAR { 2 } else { 19 }] {
            let (x, w) = (vec![x_step; m * MAX_K], vec![w_step; MAX_K]);
            let (mut packed, mut sum) = (vec![0; packed_len_i8(1, MAX_K)], [0]);
            pack_i8(Mat::new(&w, 1, MAX_K).unwrap(), &mut packed, &mut sum).unwrap();
            let scale = vec![1.0; m];
            let rows = QuantRows::new(Mat::new(&x, m, MAX_K).unwrap(), &scale).unwrap();
            let w = PackedI8::new(&packed, &[1.0], &sum, 1, MAX_K).unwrap();
            let mut y = vec![0.0; m];
            matmul_i8(isa, rows, None, w, Epilogue::STORE, MatMut::new(&mut y, m, 1).unwrap()).unwrap();
            assert_eq!(y, vec![(MAX_K as i64 * i64::from(x_step) * i64::from(w_step)) as f32; m]);
        }
    }
}

/// Rows longer than what any back-end converts at once, in tiles of every height.
fn long_rows_match_scalar(isa: Isa) {
    for (m, k) in [(1, 2049), (3, 4097), (9, 4160), (20, 4100), (33, 8193)] {
        let case = Case {
            m,
            n: 37,
            k,
            seed: k as u64,
            offset: 3,
            gap: 1,
            gather: m > 3,
            scatter: m == 9,
            bias: true,
            add: false,
            activation: Activation::None,
            fill: Fill::Random,
        };
        let operands = Operands::new(&case);
        assert_eq!(operands.run(isa), operands.run(Isa::SCALAR), "{m} rows of {k}");
    }
}

/// Float sums of random values against f64, within the bound that their order of additions cannot exceed.
fn float_sums_keep_their_bound(isa: Isa) {
    proptest!(config(96), |(case in case())| {
        let operands = Operands::with(&case, Numbers::real);
        let input = operands.input_f32();
        let mut y = operands.output(false);
        matmul_f32(isa, input, operands.w_f32(0), Epilogue::STORE, y.view()).unwrap();
        let mut y_bf16 = operands.output(false);
        matmul_bf16(isa, input, operands.w_bf16(0), Epilogue::STORE, y_bf16.view()).unwrap();
        let (y, y_bf16) = (y.bits(), y_bf16.bits());
        let x = operands.x_f32.get();
        for t in 0..case.m {
            let source = operands.index().map_or(t, |index| index[t] as usize);
            let x = &x[source * case.k..][..case.k];
            for o in 0..case.n {
                let column = |i: usize| operands.w_f32[0][o * case.k + i];
                // Tiles take bf16 inputs: two for each, which together round it to 2^-16 of its size.
                let rounding = if isa.name() == "amx" { f64::from(2.0_f32.powi(-16)) } else { 0.0 };
                for (bits, w, rounding) in [
                    (y[t][o], &column as &dyn Fn(usize) -> f32, 0.0),
                    (y_bf16[t][o], &|i| Bf16::from_f32(column(i)).to_f32(), rounding),
                ] {
                    let products = || x.iter().enumerate().map(|(i, &x)| f64::from(x) * f64::from(w(i)));
                    let k = case.k as f64;
                    let sizes: f64 = products().map(f64::abs).sum();
                    let order = k * f64::from(2.0_f32.powi(-23));
                    let bound = (order + rounding) * sizes + 4.0 * k * f64::from(f32::MIN_POSITIVE);
                    let error = (f64::from(f32::from_bits(bits)) - products().sum::<f64>()).abs();
                    prop_assert!(error <= bound, "[{t}, {o}]: off by {error}, allowed {bound}");
                }
            }
        }
    });
}

/// Random values: a row alone, and the outputs in two pieces, have the bits of the whole.
fn rows_and_outputs_stand_alone(isa: Isa) {
    proptest!(config(96), |(case in case(), cut in any::<prop::sample::Index>())| {
        let case = Case { scatter: false, gather: false, ..case };
        let operands = Operands::with(&case, Numbers::real);
        let Case { m, n, k, .. } = case;
        let (x, steps) = (operands.x_f32.get(), operands.x.get());
        let all = |rows: std::ops::Range<usize>, outputs: std::ops::Range<usize>, y: [MatMut<f32>; 3]| {
            let end = operands.end().outputs(outputs.clone());
            let count = rows.len();
            let rows_f32 = Input::all(Mat::new(&x[rows.start * k..], count, k).unwrap());
            let rows_i8 = Mat::new(&steps[rows.start * k..], count, k).unwrap();
            let rows_i8 = QuantRows::new(rows_i8, &operands.x_scale[rows]).unwrap();
            let [y_i8, y_f32, y_bf16] = y;
            matmul_i8(isa, rows_i8, None, operands.w_i8(0).outputs(outputs.clone()), end, y_i8).unwrap();
            matmul_f32(isa, rows_f32, operands.w_f32(0).outputs(outputs.clone()), end, y_f32).unwrap();
            matmul_bf16(isa, rows_f32, operands.w_bf16(0).outputs(outputs), end, y_bf16).unwrap();
        };
        let outputs = || [(); 3].map(|()| operands.output(false));
        let (mut whole, mut alone, mut pieces) = (outputs(), outputs(), outputs());
        all(0..m, 0..n, whole.each_mut().map(Guarded::view));
        for t in 0..m {
            let rows = alone.each_mut().map(|y| y.view().split_rows(t).1.split_rows(1).0);
            all(t..t + 1, 0..n, rows);
        }
        let at = (cut.index(n / PANEL + 1) * PANEL).min(n);
        all(0..m, 0..at, pieces.each_mut().map(|y| y.view().split_columns(at).0));
        all(0..m, at..n, pieces.each_mut().map(|y| y.view().split_columns(at).1));
        for i in 0..3 {
            prop_assert_eq!(whole[i].bits(), alone[i].bits());
            prop_assert_eq!(whole[i].bits(), pieces[i].bits());
        }
    });
}

for_each_isa!(products_match_scalar => avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(int8_sums_are_exact => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(int8_sums_reach_the_limit => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(long_rows_match_scalar => avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(float_sums_keep_their_bound => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(rows_and_outputs_stand_alone => scalar, avx2, avxvnni, avx512vnni, avx512bf16, amx);
