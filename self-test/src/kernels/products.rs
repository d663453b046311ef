//! Products for every kind of weights: sizes around those at which a back-end's loops change, any alignment and
//! stride, gathered and scattered rows, all epilogues.

use umo_kernels::activation::Activation;
use umo_kernels::gemm::{Epilogue, Input, Scatter};
use umo_kernels::matmul_bf16::{matmul_bf16, matmul_gated_bf16};
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i4::{matmul_gated_i4, matmul_i4};
use umo_kernels::matmul_i8::{matmul_gated_i8, matmul_i8};
use umo_kernels::pack::{
    CODES_I4, GROUP, MAX_MULTIPLIER, PANEL, pack, pack_bf16, pack_i8, pack_row_i4, packed_len, packed_len_bf16,
    packed_len_i4, packed_len_i8,
};
use umo_kernels::quantize::QuantRows;
use umo_kernels::tiling::Tiling;
use umo_kernels::{
    Bf16, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI4, PackedI8, matmul_bf16, matmul_f32, matmul_i4, matmul_i8,
};

use super::buffers::{Guarded, LINE, Noise, Placed, bits};

/// Upper bound on the multiply-adds of a sampled case, since the scalar reference repeats them.
const MAX_WORK: usize = 1_000_000;

/// The element type of the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 4-bit codes, with a multiplier for each group.
    I4,
    /// 8-bit codes.
    I8,
    /// 32-bit floats.
    F32,
    /// bfloat16.
    Bf16,
}

use Kind::{F32, I4, I8};

/// All kinds.
pub const KINDS: [Kind; 4] = [I4, I8, F32, Kind::Bf16];

impl Kind {
    /// Sizes at which the product's loops change on a back-end.
    pub fn tiling(self, isa: Isa) -> Tiling {
        match self {
            I4 => matmul_i4::tiling(isa),
            I8 => matmul_i8::tiling(isa),
            F32 => matmul_f32::tiling(isa),
            Kind::Bf16 => matmul_bf16::tiling(isa),
        }
    }
}

/// Distribution of the values of inputs and weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Values {
    /// Any int8; floats are integers of magnitude at most 16, so every partial sum is exact.
    Exact,
    /// The most negative value: -128 by -128 is the largest product of int8.
    Least,
    /// The largest value.
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

    /// Draws one value.
    pub fn float(self, noise: &mut Noise) -> f32 {
        match self {
            Self::Exact => noise.integer(16),
            Self::Real => noise.float(1.0),
            Self::Least => -16.0,
            Self::Greatest => 16.0,
        }
    }
}

/// Sizes and layout of a product; its values come from `seed`.
#[derive(Clone, Debug)]
pub struct Case {
    /// Kind of the weights.
    pub kind: Kind,
    /// Number of rows.
    pub m: usize,
    /// Number of outputs.
    pub n: usize,
    /// Number of inputs.
    pub k: usize,
    /// Elements between the end of a row of inputs and the start of the next.
    pub gap: usize,
    /// Elements from the start of a cache line to the first element.
    pub offset: usize,
    /// Elements between rows of outputs.
    pub y_gap: usize,
    /// Whether input rows are gathered by an index.
    pub gather: bool,
    /// Whether output rows are scattered: added by an index, each with a weight.
    pub scatter: bool,
    /// Whether a bias is added.
    pub bias: bool,
    /// Whether outputs are added to the existing values.
    pub add: bool,
    /// Activation after the sums.
    pub activation: Activation,
    /// Distribution of inputs and weights.
    pub values: Values,
    /// Seed of the values.
    pub seed: u64,
}

const ACTIVATIONS: [Activation; 5] =
    [Activation::None, Activation::Relu, Activation::LeakyRelu(0.25), Activation::Gelu, Activation::GeluTanh];

impl Case {
    /// A seeded product at the sizes of one of this processor's back-ends.
    pub fn sample(kind: Kind, seed: u64, values: Values) -> Self {
        let mut noise = Noise::new(seed);
        let isas: Vec<Isa> = Isa::available().collect();
        let Tiling { rows, outputs, inputs, .. } = kind.tiling(isas[noise.below(isas.len())]);
        let (m, n, k) = loop {
            let [m, n, k] = [rows, outputs, inputs].map(|tiles| around(tiles, &mut noise));
            if m * n * k <= MAX_WORK {
                break (m, n, k);
            }
        };
        // Whole tiles of rows that start at cache lines are loaded in place; a quarter of all cases has them.
        let in_place = noise.below(4) == 0;
        let case = Self::placed(kind, (m, n, k), noise, values);
        let tile = rows.iter().copied().filter(|rows| *rows < 100).max().unwrap_or(1);
        let (m, k) = (m.next_multiple_of(tile), k.next_multiple_of(LINE));
        if in_place && m * n * k <= MAX_WORK {
            return Self { m, k, gap: [0, LINE][case.gap % 2], offset: 0, gather: false, ..case };
        }
        case
    }

    /// Like [`sample`](Self::sample), but the same on every processor.
    pub fn portable_sample(kind: Kind, seed: u64) -> Self {
        let mut noise = Noise::new(seed);
        let mut around = |tiles: &[usize]| {
            let size = tiles[noise.below(tiles.len())] * (1 + noise.below(3));
            size + 1 - noise.below(3)
        };
        let sizes = (around(&[1, 6, 12]), around(&[16, 32, 64]), around(&[4, 16, 64, 256]));
        Self::placed(kind, sizes, noise, Values::Real)
    }

    fn placed(kind: Kind, (m, n, k): (usize, usize, usize), mut noise: Noise, values: Values) -> Self {
        let (gap, offset, y_gap) = (noise.below(2 * LINE), noise.below(64), noise.below(3));
        let activation = ACTIVATIONS[noise.below(ACTIVATIONS.len())];
        let [gather, scatter, bias, add] = [3, 2, 2, 2].map(|end| noise.below(end) == 0);
        Self { kind, m, n, k, gap, offset, y_gap, gather, scatter, bias, add, activation, values, seed: noise.bits() }
    }
}

/// A size at or next to a multiple of one of these, or any up to it.
fn around(tiles: &[usize], noise: &mut Noise) -> usize {
    let tile = tiles[noise.below(tiles.len())];
    let size = tile * (1 + noise.below(4));
    match noise.below(4) {
        0 => size,
        1 => size - 1,
        2 => size + 1,
        _ => 1 + noise.below(size + tile),
    }
}

/// Inputs, or packed weights.
#[derive(Debug)]
enum Elements {
    I4(Placed<u8>),
    I8(Placed<i8>),
    F32(Placed<f32>),
    Bf16(Placed<Bf16>),
}

/// Operands of one case.
#[derive(Debug)]
pub struct Operands {
    case: Case,
    x: Elements,
    /// Scale of each row of inputs; all 1 for floats.
    pub x_scale: Vec<f32>,
    /// Scale of each output; all 1 for floats.
    pub w_scale: Vec<f32>,
    index: Vec<u32>,
    packed: [Elements; 2],
    /// Sum of the codes of each output.
    sum: [Vec<i32>; 2],
    /// Weights of the plain product before packing, `[n][k]`.
    pub w: Vec<f32>,
    bias: Placed<f32>,
    rows: Vec<u32>,
    weight: Vec<f32>,
}

/// Packed weights, their sums of int8 codes, and their values.
fn weights(case: &Case, noise: &mut Noise, sum: &mut [i32]) -> (Elements, Vec<f32>) {
    let &Case { kind, n, k, offset, values, .. } = case;
    match kind {
        I4 => {
            let groups = k.div_ceil(GROUP);
            let codes: Vec<i8> = (0..n * k).map(|_| values.int4_code(noise)).collect();
            let multipliers: Vec<i8> = (0..n * groups).map(|_| values.multiplier(noise)).collect();
            let w: Vec<f32> = (0..n * k)
                .map(|i| f32::from(codes[i]) * f32::from(multipliers[i / k * groups + i % k / GROUP]))
                .collect();
            let (mut packed, panel) = (vec![0; packed_len_i4(n, k)], packed_len_i4(1, k));
            for o in 0..n {
                let (codes, multipliers) = (&codes[o * k..][..k], &multipliers[o * groups..][..groups]);
                pack_row_i4(codes, multipliers, o % PANEL, &mut packed[o / PANEL * panel..][..panel]).unwrap();
            }
            (Elements::I4(Placed::copy_of(&packed, offset)), w)
        }
        I8 => {
            let codes: Vec<i8> = (0..n * k).map(|_| values.code(noise)).collect();
            let w: Vec<f32> = codes.iter().map(|&code| code.into()).collect();
            let mut packed = vec![0; packed_len_i8(n, k)];
            pack_i8(Mat::new(&codes, n, k).unwrap(), &mut packed, sum).unwrap();
            (Elements::I8(Placed::copy_of(&packed, offset)), w)
        }
        F32 => {
            let w: Vec<f32> = (0..n * k).map(|_| values.float(noise)).collect();
            let mut packed = vec![0.0; packed_len(n, k)];
            pack(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
            (Elements::F32(Placed::copy_of(&packed, offset)), w)
        }
        Kind::Bf16 => {
            let w: Vec<f32> = (0..n * k).map(|_| Bf16::from_f32(values.float(noise)).to_f32()).collect();
            let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
            pack_bf16(Mat::new(&w, n, k).unwrap(), &mut packed).unwrap();
            (Elements::Bf16(Placed::copy_of(&packed, offset)), w)
        }
    }
}

impl Operands {
    /// Draws the operands of this case.
    pub fn new(case: &Case) -> Self {
        let &Case { kind, m, n, k, gap, offset, values, .. } = case;
        let noise = &mut Noise::new(case.seed);
        let sources = if case.gather { m + 3 } else { m };
        let x = match kind {
            I4 | I8 => Elements::I8(Placed::new(sources, k, gap, offset, || values.code(noise))),
            _ => Elements::F32(Placed::new(sources, k, gap, offset, || values.float(noise))),
        };
        let mut sum = [vec![0; n], vec![0; n]];
        let (gate, _) = weights(case, noise, &mut sum[1]);
        let (plain, w) = weights(case, noise, &mut sum[0]);
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

    /// The epilogue.
    pub fn epilogue(&self) -> Epilogue<'_> {
        Epilogue {
            bias: self.case.bias.then(|| self.bias.row()),
            activation: self.case.activation,
            add: self.case.add,
            scatter: self.case.scatter.then_some(Scatter { rows: &self.rows, weight: &self.weight }),
        }
    }

    /// Index of the gathered rows.
    pub fn index(&self) -> Option<&[u32]> {
        self.case.gather.then_some(&self.index)
    }

    /// Outputs before the product: all 3.
    pub fn output(&self, scatter: bool) -> Guarded<f32> {
        let rows = if scatter { self.case.m.max(1) + 2 } else { self.case.m };
        Guarded::filled(rows, self.case.n, self.case.y_gap, self.case.offset, 3.0)
    }

    /// Computes the rows `rows` of the product for the outputs `outputs`; all rows if they are gathered.
    pub fn plain(
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

    /// Computes the gated product.
    pub fn gated(&self, isa: Isa, y: MatMut<f32>) {
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

    /// The rows `rows`, or all rows that are gathered from.
    pub fn codes(&self, rows: core::ops::Range<usize>) -> QuantRows<'_> {
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

    /// Computes the plain and the gated product.
    pub fn run(&self, isa: Isa) -> [Vec<Vec<f32>>; 2] {
        let Case { m, n, scatter, .. } = self.case;
        let mut plain = self.output(scatter);
        self.plain(isa, 0..m, 0..n, self.epilogue(), plain.mat());
        let mut gated = self.output(false);
        self.gated(isa, gated.mat());
        [plain.checked(), gated.checked()]
    }

    /// The bits of the plain or the gated product.
    pub fn bits(&self, isa: Isa, gated: bool) -> Vec<u64> {
        bits(&self.run(isa)[usize::from(gated)]).concat().into_iter().map(u64::from).collect()
    }

    /// The sum behind output `o` of row `t`, before its scale, in f64, and the sum of its terms' magnitudes.
    pub fn sum(&self, t: usize, o: usize) -> (f64, f64) {
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

    /// The input row from which output row `t` is computed.
    pub fn source(&self, t: usize) -> usize {
        self.index().map_or(t, |index| index[t] as usize)
    }
}
