//! The int8 products at shapes drawn from each back-end's own tiles: up to ten blocks of rows, whole ones and others, inputs of
//! whole steps and others, rows that tiles are loaded from in place (aligned, whole tiles, no index) and rows that are gathered,
//! several blocks at once.

use proptest::prelude::*;
use umo_kernels::activation::Activation;
use umo_kernels::gemm::{Epilogue, Scatter};
use umo_kernels::matmul_i8::{Tiling, matmul_gated_i8, matmul_i8, tiling};
use umo_kernels::pack::{PANEL, pack_i8, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::{Isa, Mat, PackedI8};

use crate::support::{Guarded, Numbers, Shifted, config, for_each_isa, isa, near};

/// Most rows of a drawn case.
const MOST_ROWS: usize = 300;
/// Most multiply-adds of a drawn case: the scalar reference does as many.
const MOST_WORK: usize = 3_000_000;

#[derive(Clone, Copy, Debug)]
enum Values {
    Random,
    /// -128 by -128, the largest product.
    Least,
    Greatest,
}

#[derive(Clone, Debug)]
struct Case {
    m: usize,
    n: usize,
    k: usize,
    /// Elements between the end of a row of inputs and the next.
    gap: usize,
    /// Elements from a cache line's start to the first input.
    offset: usize,
    gather: bool,
    scatter: bool,
    add: bool,
    bias: bool,
    values: Values,
    seed: u64,
}

fn case(Tiling { rows, inputs }: Tiling) -> impl Strategy<Value = Case> {
    let most = MOST_ROWS / rows;
    let m = prop_oneof![
        2 => (1..=most).prop_map(move |blocks| blocks * rows),
        1 => (1..=MOST_ROWS / 16).prop_map(|tiles| tiles * 16),
        1 => near(rows, most),
    ];
    let n = prop_oneof![3 => near(PANEL, 4), 1 => near(16 * PANEL, 1)];
    let whole = inputs.max(64);
    let k =
        prop_oneof![3 => (1_usize..=6).prop_map(move |steps| steps * whole), 1 => near(inputs, 9), 1 => near(whole, 4)];
    let shape = (m, n, k).prop_filter("a case of moderate size", |(m, n, k)| m * n * k <= MOST_WORK);
    // Whole cache lines between rows keep them aligned.
    let place = (
        prop_oneof![3 => Just(0_usize), 1 => Just(64), 1 => 1_usize..64],
        prop_oneof![2 => Just(0_usize), 1 => 1_usize..64],
    );
    let values = prop_oneof![6 => Just(Values::Random), 1 => Just(Values::Least), 1 => Just(Values::Greatest)];
    let flags = (prop::bool::weighted(0.4), any::<bool>(), any::<bool>(), any::<bool>());
    (shape, place, flags, values, any::<u64>()).prop_map(
        |((m, n, k), (gap, offset), (gather, scatter, add, bias), values, seed)| Case {
            m,
            n,
            k,
            gap,
            offset,
            gather,
            scatter,
            add,
            bias,
            values,
            seed,
        },
    )
}

/// Packed weights, and what goes with them.
struct Weights {
    packed: Shifted<i8>,
    sum: Vec<i32>,
    scale: Vec<f32>,
}

impl Weights {
    fn new(n: usize, k: usize, mut value: impl FnMut() -> i8, mut scale: impl FnMut() -> f32) -> Self {
        let w: Vec<i8> = (0..n * k).map(|_| value()).collect();
        let (mut packed, mut sum) = (vec![0; packed_len_i8(n, k)], vec![0; n]);
        pack_i8(Mat::new(&w, n, k).unwrap(), &mut packed, &mut sum).unwrap();
        Self { packed: Shifted::new(&packed, 0), sum, scale: (0..n).map(|_| scale()).collect() }
    }

    fn get(&self, n: usize, k: usize) -> PackedI8<'_> {
        PackedI8::new(self.packed.get(), &self.scale, &self.sum, n, k).unwrap()
    }
}

/// Bits of the plain and the gated product on each of `isas`.
fn run<const N: usize>(case: &Case, isas: [Isa; N]) -> [[Vec<Vec<u32>>; 2]; N] {
    let &Case { m, n, k, gap, offset, gather, .. } = case;
    let numbers = std::cell::RefCell::new(Numbers(case.seed));
    let value = || match case.values {
        Values::Random => numbers.borrow_mut().step(),
        Values::Least => i8::MIN,
        Values::Greatest => i8::MAX,
    };
    let real = || numbers.borrow_mut().real();
    let sources = if gather { m + 3 } else { m };
    let stride = k + gap;
    let x: Vec<i8> = (0..sources * stride).map(|_| value()).collect();
    let x = Shifted::new(&x, offset);
    let x_scale: Vec<f32> = (0..sources).map(|_| real()).collect();
    let index: Vec<u32> = (0..m).map(|_| numbers.borrow_mut().below(sources) as u32).collect();
    let [w, gate] = [(); 2].map(|()| Weights::new(n, k, value, real));
    let bias: Vec<f32> = (0..n).map(|_| numbers.borrow_mut().integer()).collect();
    let rows: Vec<u32> = (0..m).map(|t| (t * 7 % (m + 2)) as u32).collect();
    let weight: Vec<f32> = (0..m).map(|_| numbers.borrow_mut().integer() / 4.0).collect();
    let epilogue = Epilogue {
        bias: case.bias.then_some(&bias[..]),
        activation: Activation::None,
        add: case.add,
        scatter: case.scatter.then_some(Scatter { rows: &rows, weight: &weight }),
    };
    let index = gather.then_some(&index[..]);
    isas.map(|isa| {
        let x = QuantRows::new(Mat::with_stride(x.get(), sources, k, stride).unwrap(), &x_scale).unwrap();
        let mut y = Guarded::new(if case.scatter { m + 2 } else { m }, n, 1, 0, 3.0);
        matmul_i8(isa, x, index, w.get(n, k), epilogue, y.view()).unwrap();
        let mut gated = Guarded::new(m, n, 0, 0, 3.0);
        matmul_gated_i8(isa, x, index, gate.get(n, k), w.get(n, k), gated.view()).unwrap();
        [y.bits(), gated.bits()]
    })
}

/// All bits, at shapes of the back-end's own tiles.
fn tiles_match_scalar(isa: Isa) {
    proptest!(config(160), |(case in case(tiling(isa)))| {
        let [found, wanted] = run(&case, [isa, Isa::SCALAR]);
        prop_assert!(found == wanted, "{}", difference(&found, &wanted));
    });
}

/// The base model's shapes: more panels than fit L2 at once, more blocks of rows than are gathered at once.
fn large_products_match_scalar(isa: Isa) {
    for (m, n, k, gap, gather) in [
        (300, 80, 768, 0, false),
        (256, 80, 768, 64, false),
        (96, 64, 2048, 0, true),
        (288, 48, 768, 0, true),
        (64, 832, 1024, 0, false),
        (80, 832, 1024, 0, true),
        (32, 48, 8192, 0, false),
    ] {
        let flags = (gather, m == 300, m == 96, true);
        let (gather, scatter, add, bias) = flags;
        let seed = (m * n + k) as u64;
        let case = Case { m, n, k, gap, offset: 0, gather, scatter, add, bias, values: Values::Random, seed };
        let [found, wanted] = run(&case, [isa, Isa::SCALAR]);
        assert!(found == wanted, "{case:?}: {}", difference(&found, &wanted));
    }
}

/// Where two results differ first, and in how many rows: whole matrices are too long to print.
fn difference(found: &[Vec<Vec<u32>>; 2], wanted: &[Vec<Vec<u32>>; 2]) -> String {
    let mut text = String::new();
    for ((name, found), wanted) in ["plain", "gated"].iter().zip(found).zip(wanted) {
        let rows: Vec<usize> = (0..wanted.len()).filter(|&t| found[t] != wanted[t]).collect();
        if let Some(&t) = rows.first() {
            let column = (0..wanted[t].len()).find(|&c| found[t][c] != wanted[t][c]).unwrap_or(0);
            let (found, wanted) = (f32::from_bits(found[t][column]), f32::from_bits(wanted[t][column]));
            text += &format!("{name}: {} rows differ, first [{t}, {column}]: {found}, not {wanted}. ", rows.len());
        }
    }
    text
}

for_each_isa!(tiles_match_scalar => avx2, avxvnni, avx512vnni, avx512bf16, amx);
for_each_isa!(large_products_match_scalar => avx2, avxvnni, avx512vnni, avx512bf16, amx);
