//! Every product on every back-end against its scalar reference and against f64: shapes around the
//! back-end's own tile sizes, any alignment and the one that tiles are loaded in place from,
//! gathered and scattered rows, all epilogues, extremes; and the two promises that callers build
//! on, that a row's bits depend neither on the rows beside it nor on how the outputs are split.

use proptest::prelude::*;
use proptest::strategy::ValueTree;
use proptest::test_runner::{RngAlgorithm, TestRng, TestRunner};
use umo_kernels::activation::Activation;
use umo_kernels::gemm::{Epilogue, Input, Scatter};
use umo_kernels::matmul_bf16::{matmul_bf16, matmul_gated_bf16};
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i4::{matmul_gated_i4, matmul_i4};
use umo_kernels::matmul_i8::{MAX_K, matmul_gated_i8, matmul_i8};
use umo_kernels::pack::{
    CODES_I4, GROUP, MAX_MULTIPLIER, PANEL, pack, pack_bf16, pack_i8, pack_row_i4, packed_len, packed_len_bf16,
    packed_len_i4, packed_len_i8,
};
use umo_kernels::quantize::QuantRows;
use umo_kernels::tiling::Tiling;
use umo_kernels::tuning::Tuning;
use umo_kernels::{
    Bf16, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI4, PackedI8, matmul_bf16, matmul_f32, matmul_i4, matmul_i8,
};
use umo_tests::{Guarded, LINE, Noise, Placed, around, bits, cases, for_each_isa, offset};

/// Most multiply-adds of a drawn case: the scalar reference does as many.
const MAX_WORK: usize = 4_000_000;

/// The element type of the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    I4,
    I8,
    F32,
    Bf16,
}

use Kind::{F32, I4, I8};

const KINDS: [Kind; 4] = [I4, I8, F32, Kind::Bf16];

impl Kind {
    fn tiling(self, isa: Isa) -> Tiling {
        match self {
            I4 => matmul_i4::tiling(isa),
            I8 => matmul_i8::tiling(isa),
            F32 => matmul_f32::tiling(isa),
            Kind::Bf16 => matmul_bf16::tiling(isa),
        }
    }
}

/// What inputs and weights are made of.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Values {
    /// Any int8; floats that are integers of at most 16, so that every partial sum is exact.
    Exact,
    /// The most negative of those: -128 by -128 is the largest product of int8.
    Least,
    Greatest,
    /// Any int8; floats in -1..1.
    Real,
}

impl Values {
    fn code(self, noise: &mut Noise) -> i8 {
        match self {
            Self::Exact | Self::Real => noise.code(),
            Self::Least => i8::MIN,
            Self::Greatest => i8::MAX,
        }
    }

    fn int4_code(self, noise: &mut Noise) -> i8 {
        match self {
            Self::Exact | Self::Real => noise.code() >> 4,
            Self::Least => CODES_I4.0,
            Self::Greatest => CODES_I4.1,
        }
    }

    fn multiplier(self, noise: &mut Noise) -> i8 {
        match self {
            Self::Exact | Self::Real => noise.code() % (MAX_MULTIPLIER + 1),
            Self::Least => -MAX_MULTIPLIER,
            Self::Greatest => MAX_MULTIPLIER,
        }
    }

    fn float(self, noise: &mut Noise) -> f32 {
        match self {
            Self::Exact => noise.integer(16),
            Self::Real => noise.float(1.0),
            Self::Least => -16.0,
            Self::Greatest => 16.0,
        }
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Case {
    kind: Kind,
    pub(crate) m: usize,
    pub(crate) n: usize,
    pub(crate) k: usize,
    /// Of inputs: elements between the end of a row and the next, and from a cache line's start to
    /// the first.
    gap: usize,
    offset: usize,
    /// Between rows of outputs.
    y_gap: usize,
    pub(crate) gather: bool,
    pub(crate) scatter: bool,
    bias: bool,
    add: bool,
    activation: Activation,
    values: Values,
    pub(crate) seed: u64,
}

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
    // Whole tiles of rows that start at cache lines are loaded in place: as a third of all cases.
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

impl Case {
    /// One of real values that follows from `seed`, at the sizes of one of this processor's
    /// back-ends.
    pub(crate) fn sample(kind: Kind, seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let isas: Vec<Isa> = Isa::available().collect();
        Self::sample_around(kind, kind.tiling(isas[noise.below(isas.len())]), noise)
    }

    /// The same on every processor. Not from a strategy: those draw other sizes where `usize` has 32
    /// bits.
    pub(crate) fn portable_sample(kind: Kind, seed: u64) -> Self {
        const ACTIVATIONS: [Activation; 5] =
            [Activation::None, Activation::Relu, Activation::LeakyRelu(0.25), Activation::Gelu, Activation::GeluTanh];
        let mut noise = Noise::new(seed);
        let mut around = |tiles: &[usize]| {
            let size = tiles[noise.below(tiles.len())] * (1 + noise.below(3));
            size + 1 - noise.below(3)
        };
        let (m, n, k) = (around(&[1, 6, 12]), around(&[16, 32, 64]), around(&[4, 16, 64, 256]));
        let (gap, offset, y_gap) = (noise.below(2 * LINE), noise.below(64), noise.below(3));
        let activation = ACTIVATIONS[noise.below(ACTIVATIONS.len())];
        let [gather, scatter, bias, add] = [3, 2, 2, 2].map(|end| noise.below(end) == 0);
        let (values, seed) = (Values::Real, noise.bits());
        Case { kind, m, n, k, gap, offset, y_gap, gather, scatter, bias, add, activation, values, seed }
    }

    fn sample_around(kind: Kind, tiling: Tiling, mut noise: Noise) -> Self {
        let bytes: Vec<u8> = (0..4).flat_map(|_| noise.bits().to_le_bytes()).collect();
        let rng = TestRng::from_seed(RngAlgorithm::ChaCha, &bytes);
        let tree = case(kind, tiling).new_tree(&mut TestRunner::new_with_rng(cases(1), rng));
        Self { values: Values::Real, ..tree.expect("few shapes are too large").current() }
    }
}

/// Inputs, or packed weights.
enum Elements {
    I4(Placed<u8>),
    I8(Placed<i8>),
    F32(Placed<f32>),
    Bf16(Placed<Bf16>),
}

/// The operands of one case.
pub(crate) struct Operands {
    case: Case,
    x: Elements,
    /// One for each row, and one for each output; all 1 for floats.
    x_scale: Vec<f32>,
    w_scale: Vec<f32>,
    index: Vec<u32>,
    packed: [Elements; 2],
    /// Of the codes of each output.
    sum: [Vec<i32>; 2],
    /// The weights of the plain product before they were packed, `[n][k]`.
    w: Vec<f32>,
    bias: Placed<f32>,
    rows: Vec<u32>,
    weight: Vec<f32>,
}

impl Operands {
    pub(crate) fn new(case: &Case) -> Self {
        let &Case { kind, m, n, k, gap, offset, values, .. } = case;
        let noise = &mut Noise::new(case.seed);
        let sources = if case.gather { m + 3 } else { m };
        let x = match kind {
            I4 | I8 => Elements::I8(Placed::new(sources, k, gap, offset, || values.code(noise))),
            _ => Elements::F32(Placed::new(sources, k, gap, offset, || values.float(noise))),
        };
        let mut sum = [vec![0; n], vec![0; n]];
        let mut w = vec![];
        let packed = [1, 0].map(|i| match kind {
            I4 => {
                let groups = k.div_ceil(GROUP);
                let codes: Vec<i8> = (0..n * k).map(|_| values.int4_code(noise)).collect();
                let multipliers: Vec<i8> = (0..n * groups).map(|_| values.multiplier(noise)).collect();
                w = (0..n * k)
                    .map(|i| f32::from(codes[i]) * f32::from(multipliers[i / k * groups + i % k / GROUP]))
                    .collect();
                let (mut packed, panel) = (vec![0; packed_len_i4(n, k)], packed_len_i4(1, k));
                for o in 0..n {
                    let (codes, multipliers) = (&codes[o * k..][..k], &multipliers[o * groups..][..groups]);
                    pack_row_i4(codes, multipliers, o % PANEL, &mut packed[o / PANEL * panel..][..panel]).unwrap();
                }
                Elements::I4(Placed::copy_of(&packed, offset))
            }
            I8 => {
                let codes: Vec<i8> = (0..n * k).map(|_| values.code(noise)).collect();
                w = codes.iter().map(|&code| code.into()).collect();
                let mut packed = vec![0; packed_len_i8(n, k)];
                pack_i8(Mat::new(&codes, n, k).unwrap(), &mut packed, &mut sum[i]).unwrap();
                Elements::I8(Placed::copy_of(&packed, offset))
            }
            F32 => {
                w = (0..n * k).map(|_| values.float(noise)).collect();
                let mut packed = vec![0.0; packed_len(n, k)];
                pack(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
                Elements::F32(Placed::copy_of(&packed, offset))
            }
            Kind::Bf16 => {
                w = (0..n * k).map(|_| Bf16::from_f32(values.float(noise)).to_f32()).collect();
                let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
                pack_bf16(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
                Elements::Bf16(Placed::copy_of(&packed, offset))
            }
        });
        let [gate, plain] = packed;
        let y_rows = m.max(1) + 2;
        let mut scales =
            |count| (0..count).map(|_| if matches!(kind, I4 | I8) { noise.float(1.0) } else { 1.0 }).collect();
        let (x_scale, w_scale) = (scales(sources), scales(n));
        Self {
            case: case.clone(),
            x,
            x_scale,
            w_scale,
            index: (0..m).map(|_| u32::try_from(noise.below(sources)).unwrap()).collect(),
            packed: [plain, gate],
            sum,
            w,
            bias: Placed::new(1, n, 0, offset, || noise.integer(16)),
            rows: (0..m).map(|_| u32::try_from(noise.below(y_rows)).unwrap()).collect(),
            weight: (0..m).map(|_| noise.integer(16) / 4.0).collect(),
        }
    }

    fn epilogue(&self) -> Epilogue<'_> {
        Epilogue {
            bias: self.case.bias.then(|| self.bias.row()),
            activation: self.case.activation,
            add: self.case.add,
            scatter: self.case.scatter.then_some(Scatter { rows: &self.rows, weight: &self.weight }),
        }
    }

    fn index(&self) -> Option<&[u32]> {
        self.case.gather.then_some(&self.index)
    }

    fn output(&self, scatter: bool) -> Guarded<f32> {
        let rows = if scatter { self.case.m.max(1) + 2 } else { self.case.m };
        Guarded::filled(rows, self.case.n, self.case.y_gap, self.case.offset, 3.0)
    }

    /// The rows `rows` of the product with the outputs `outputs`, all of them gathered if any are.
    fn plain(
        &self,
        isa: Isa,
        rows: core::ops::Range<usize>,
        outputs: core::ops::Range<usize>,
        epilogue: Epilogue,
        y: MatMut<f32>,
    ) {
        let Case { n, k, .. } = self.case;
        let epilogue = epilogue.outputs(outputs.clone());
        match (&self.x, &self.packed[0]) {
            (Elements::I8(_), Elements::I4(w)) => {
                let w = PackedI4::new(w.row(), &self.w_scale, n, k).unwrap();
                matmul_i4(isa, self.codes(rows), self.index(), w.outputs(outputs), epilogue, y).unwrap();
            }
            (Elements::I8(_), Elements::I8(w)) => {
                let w = PackedI8::new(w.row(), &self.w_scale, &self.sum[0], n, k).unwrap();
                matmul_i8(isa, self.codes(rows), self.index(), w.outputs(outputs), epilogue, y).unwrap();
            }
            (Elements::F32(_), Elements::F32(w)) => {
                let w = PackedF32::new(w.row(), n, k).unwrap();
                matmul_f32(isa, self.floats(rows), w.outputs(outputs), epilogue, y).unwrap();
            }
            (Elements::F32(_), Elements::Bf16(w)) => {
                let w = PackedBf16::new(w.row(), n, k).unwrap();
                matmul_bf16(isa, self.floats(rows), w.outputs(outputs), epilogue, y).unwrap();
            }
            _ => unreachable!("inputs are made for their weights"),
        }
    }

    fn gated(&self, isa: Isa, y: MatMut<f32>) {
        let Case { m, n, k, .. } = self.case;
        match [&self.packed[1], &self.packed[0]] {
            [Elements::I4(gate), Elements::I4(up)] => {
                let [gate, up] = [gate, up].map(|w| PackedI4::new(w.row(), &self.w_scale, n, k).unwrap());
                matmul_gated_i4(isa, self.codes(0..m), self.index(), gate, up, y).unwrap();
            }
            [Elements::I8(gate), Elements::I8(up)] => {
                let gate = PackedI8::new(gate.row(), &self.w_scale, &self.sum[1], n, k).unwrap();
                let up = PackedI8::new(up.row(), &self.w_scale, &self.sum[0], n, k).unwrap();
                matmul_gated_i8(isa, self.codes(0..m), self.index(), gate, up, y).unwrap();
            }
            [Elements::F32(gate), Elements::F32(up)] => {
                let [gate, up] = [gate, up].map(|w| PackedF32::new(w.row(), n, k).unwrap());
                matmul_gated_f32(isa, self.floats(0..m), gate, up, y).unwrap();
            }
            [Elements::Bf16(gate), Elements::Bf16(up)] => {
                let [gate, up] = [gate, up].map(|w| PackedBf16::new(w.row(), n, k).unwrap());
                matmul_gated_bf16(isa, self.floats(0..m), gate, up, y).unwrap();
            }
            _ => unreachable!("both weights are of one kind"),
        }
    }

    /// These rows, or all that rows are gathered from.
    fn codes(&self, rows: core::ops::Range<usize>) -> QuantRows<'_> {
        let Elements::I8(x) = &self.x else { unreachable!("codes") };
        match self.case.gather {
            true => QuantRows::new(x.mat(), &self.x_scale).unwrap(),
            false => QuantRows::new(x.mat().row_range(rows.clone()), &self.x_scale[rows]).unwrap(),
        }
    }

    fn floats(&self, rows: core::ops::Range<usize>) -> Input<'_, f32> {
        let Elements::F32(x) = &self.x else { unreachable!("floats") };
        self.index().map_or(Input::all(x.mat().row_range(rows)), |index| Input::gather(x.mat(), index).unwrap())
    }

    /// The plain and the gated product.
    fn run(&self, isa: Isa) -> [Vec<Vec<f32>>; 2] {
        let Case { m, n, scatter, .. } = self.case;
        let mut plain = self.output(scatter);
        self.plain(isa, 0..m, 0..n, self.epilogue(), plain.mat());
        let mut gated = self.output(false);
        self.gated(isa, gated.mat());
        [plain.checked(), gated.checked()]
    }

    /// The bits of one product: plain, or gated.
    pub(crate) fn bits(&self, isa: Isa, gated: bool) -> Vec<u64> {
        bits(&self.run(isa)[usize::from(gated)]).concat().into_iter().map(u64::from).collect()
    }

    /// The sum that output `o` of row `t` is before its scale, in f64, and the sum of its terms'
    /// sizes.
    fn sum(&self, t: usize, o: usize) -> (f64, f64) {
        let k = self.case.k;
        let w = &self.w[o * k..][..k];
        let add = |(sum, size): (f64, f64), term: f64| (sum + term, size + term.abs());
        let source = self.source(t);
        match &self.x {
            Elements::I8(x) => {
                x.mat().row(source).iter().zip(w).map(|(&x, &w)| f64::from(x) * f64::from(w)).fold((0.0, 0.0), add)
            }
            Elements::F32(x) => {
                x.mat().row(source).iter().zip(w).map(|(&x, &w)| f64::from(x) * f64::from(w)).fold((0.0, 0.0), add)
            }
            Elements::I4(_) | Elements::Bf16(_) => unreachable!("inputs are int8 or f32"),
        }
    }

    /// The row of inputs that row `t` of the outputs is made of.
    fn source(&self, t: usize) -> usize {
        self.index().map_or(t, |index| index[t] as usize)
    }

    /// All bits of both products, with every tuning profile: a profile changes the order of memory
    /// accesses and of exact operations only. Says where they differ first, and in how many rows:
    /// whole matrices are too long to print.
    fn match_scalar(&self, isa: Isa) -> Result<(), String> {
        let ([plain, gated], mut text) = (self.run(Isa::SCALAR), String::new());
        let results = Tuning::ALL.map(|tuning| self.run(isa.with_tuning(tuning)));
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
        if text.is_empty() { Ok(()) } else { Err(format!("{:?}: {text}", self.case)) }
    }
}

/// int4 and int8 on any values, floats on integers: all bits, with every epilogue.
fn products_match_scalar(isa: Isa) {
    for kind in KINDS {
        proptest!(cases(256), |(case in case(kind, kind.tiling(isa)))| {
            prop_assert_eq!(Operands::new(&case).match_scalar(isa), Ok(()));
        });
    }
}

/// More weights than a chunk that stays in cache, more rows than are held at once, and longer rows
/// than any buffer, each beside the largest tile and one row more.
fn large_products_match_scalar(isa: Isa) {
    for kind in KINDS {
        let Tiling { rows, outputs, inputs, held, chunk } = kind.tiling(isa);
        let most = |sizes: &[usize]| *sizes.iter().max().unwrap();
        let tile = *rows.iter().filter(|rows| **rows < 100).max().unwrap();
        let (group, long) = (most(outputs), most(inputs));
        // The base model's rows of inputs, in whole steps and not.
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
                Operands::new(&case).match_scalar(isa).unwrap();
            }
        }
    }
}

/// Against f64, so that scalar and vectors cannot be wrong together: int4 and int8 exactly, floats of any
/// values within the bound that their order of additions cannot exceed.
#[expect(clippy::cast_possible_truncation, reason = "the sum is rounded once, as the kernel rounds its own")]
fn sums_are_near_f64(isa: Isa) {
    for kind in KINDS {
        proptest!(cases(64), |(case in case(kind, kind.tiling(isa)), real in any::<bool>())| {
            let case = if real { Case { values: Values::Real, ..case } } else { case };
            let operands = Operands::new(&case);
            let mut y = operands.output(false);
            operands.plain(isa, 0..case.m, 0..case.n, Epilogue::STORE, y.mat());
            // Tiles take two bf16 values for each f32, which together are within 2^-16 of it.
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

/// The longest sum of the greatest products, which is one below the limit of 32 bits, in tiles of
/// one and of many rows.
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

/// The same of int4: the greatest weight is 120.
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

/// What is no int4 code or multiplier is refused.
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
            // Of many rows some: each of the first blocks, and the last.
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
