//! Every operation on every back-end at the base model's shapes and an odd one:
//! `<op>/<isa>/<shape>`, each with its floor, the limit of one thread of the processor:
//! multiply-adds from registers, or reading as many bytes as the call reads and writes.
//!
//! Each result is compared with the scalar reference before it is timed. Operands are the same in
//! every call and thus hot in cache: `step.rs` and `benches/peers` time weights read from
//! memory.

use std::cell::RefCell;
use std::collections::HashMap;
use std::time::{Duration, Instant};

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use umo_benches::{Random, is_test};
use umo_core_model::weights::AlignedBox;
use umo_core_tools::floor;
use umo_kernels::activation::{Activation, apply, argmax, softmax};
use umo_kernels::attention::{
    Operands, RelativeBias, attention_bf16, attention_f32, encoder_attention_bf16, encoder_attention_f32,
};
use umo_kernels::bf16::round_bf16;
use umo_kernels::conv1d::{GroupedF32, conv1d_grouped_f32, frames_out, windows};
use umo_kernels::experts::{Routing, route};
use umo_kernels::filter::dot;
use umo_kernels::gemm::{Epilogue, Input, Scatter};
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16, matmul_bf16_rows, matmul_gated_bf16};
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i8::{matmul_gated_i8, matmul_i8};
use umo_kernels::norm::{channel_affine, channel_sums, layer_norm, rms_norm};
use umo_kernels::pack::{pack, pack_bf16, pack_i8, packed_len, packed_len_bf16, packed_len_i8};
use umo_kernels::quantize::{QuantRows, quantize_rows};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI8, ShapeError};

/// Rows, outputs and inputs: one token, a pass with markers, a window; feed-forward in, out,
/// attention; a window of the default model; and odd ones.
const PRODUCTS: [(usize, usize, usize); 10] = [
    (1, 2048, 768),
    (1, 768, 2048),
    (3, 2304, 768),
    (16, 768, 768),
    (64, 2048, 768),
    (256, 2048, 768),
    (256, 768, 2048),
    (150, 3072, 768),
    (117, 768, 256),
    (37, 131, 257),
];

/// Rows, outputs and inputs of gated products; the gate and the up weight each have these outputs.
const GATED: [(usize, usize, usize); 5] =
    [(1, 2048, 768), (16, 2048, 768), (256, 2048, 768), (117, 512, 256), (7, 45, 61)];

/// Queries, keys and width of one head.
const ATTENTIONS: [(usize, usize, usize); 4] = [(256, 256, 64), (1, 256, 64), (3, 25, 64), (7, 61, 20)];

/// Rows, inner width and outer width of four experts.
const EXPERTS: [(usize, usize, usize); 4] = [(1, 2048, 768), (16, 2048, 768), (256, 2048, 768), (5, 61, 37)];

/// HuBERT's first three convolutions and an odd one: frames, channels in and out, kernel width, step.
const CONVOLUTIONS: [(usize, usize, usize, usize, usize); 4] =
    [(8000, 1, 512, 10, 5), (600, 512, 512, 3, 2), (300, 512, 512, 2, 2), (61, 11, 37, 3, 2)];

const SHAPES: &str = "shapes agree";

/// Whether a shape with this many multiply-adds is timed: few are if benches run as tests.
fn is_timed(macs: usize) -> bool {
    !is_test() || macs < 1 << 21
}

/// Shapes to time.
fn chosen<const N: usize>(shapes: [(usize, usize, usize); N]) -> Vec<(usize, usize, usize)> {
    shapes.into_iter().filter(|(m, n, k)| is_timed(m * n * k)).collect()
}

fn matrix(y: &mut [f32], rows: usize, cols: usize) -> MatMut<'_, f32> {
    MatMut::new(y, rows, cols).expect(SHAPES)
}

fn floats(random: &mut Random, len: usize) -> AlignedBox<f32> {
    let mut values = AlignedBox::zeroed(len);
    values.iter_mut().for_each(|v| *v = random.unit());
    values
}

fn steps(random: &mut Random, len: usize) -> AlignedBox<i8> {
    let mut values = AlignedBox::zeroed(len);
    values.iter_mut().for_each(|v| *v = random.int8());
    values
}

/// Kind of a peak rate of multiply-adds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Unit {
    Int8,
    Float,
    /// Both factors in bfloat16 if the back-end multiplies those faster; on tiles, the number of
    /// products per multiply-add.
    Rounded(u8),
    /// f32; tiles need this many products of bf16 parts.
    Parts(u8),
}

/// Work of a call.
#[derive(Clone, Copy, Debug)]
struct Work {
    unit: Unit,
    macs: usize,
    /// Bytes read and written.
    bytes: usize,
}

impl Work {
    /// A product with weights of `each` bytes.
    fn product(unit: Unit, (m, n, k): (usize, usize, usize), each: usize) -> Self {
        Self { unit, macs: m * n * k, bytes: n * k * each }
    }

    /// Reads and writes `values` floats.
    fn floats(values: usize) -> Self {
        Self { unit: Unit::Float, macs: 0, bytes: 4 * values }
    }
}

/// Peak rates of one thread, measured once.
#[derive(Debug, Default)]
struct Peaks {
    /// Multiply-adds per second; `None` if the back-end has no instruction.
    macs: HashMap<(&'static str, Unit), Option<f64>>,
    /// Bytes per second for a buffer size, rounded up to a power of two to measure few sizes.
    read: HashMap<(&'static str, usize), f64>,
}

impl Peaks {
    /// Minimum time of `work` in seconds; `None` if the back-end has no instructions of its own.
    fn least(&mut self, isa: Isa, work: Work) -> Option<f64> {
        let per_second = *self.macs.entry((isa.name(), work.unit)).or_insert_with(|| match work.unit {
            Unit::Int8 => floor::int8(1, isa),
            // A pair of bfloat16 takes the place of four int8.
            Unit::Rounded(products) | Unit::Parts(products) if isa.has_tiles() => {
                floor::int8(1, isa).map(|peak| peak / 2.0 / f64::from(products))
            }
            // The instruction multiplies two in place of one.
            Unit::Rounded(_) if isa.multiplies_bf16() => floor::f32(1, isa).map(|peak| 2.0 * peak),
            _ => floor::f32(1, isa),
        });
        let bytes = work.bytes.next_power_of_two().max(4096);
        let read = *self.read.entry((isa.name(), bytes)).or_insert_with(|| floor::read(1, isa, bytes));
        Some((work.macs as f64 / per_second?).max(work.bytes as f64 / read))
    }
}

/// A benchmark of one operation.
struct Bench<'a> {
    c: &'a mut Criterion,
    peaks: &'a mut Peaks,
}

impl Bench<'_> {
    /// Runs `op` on every back-end, compares its `len` outputs with the scalar ones, times it, and
    /// prints its speed relative to the floor.
    fn compare(
        &mut self,
        (op, shape): (&str, &str),
        work: Work,
        (len, tolerance): (usize, f32),
        mut run: impl FnMut(Isa, &mut [f32]),
    ) {
        /// Multiply-adds of scalar code in a tenth of a second.
        const LONG: usize = 1 << 26;
        let (mut wanted, mut y) = (AlignedBox::<f32>::zeroed(len), AlignedBox::<f32>::zeroed(len));
        run(Isa::SCALAR, &mut wanted);
        let mut group = self.c.benchmark_group(op);
        let amount =
            if work.macs > 0 { Throughput::Elements(work.macs as u64) } else { Throughput::Bytes(work.bytes as u64) };
        group.throughput(amount).sample_size(15);
        group.warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(600));
        for isa in Isa::available() {
            y.fill(0.0);
            run(isa, &mut y);
            let mut off = wanted.iter().zip(&*y).map(|(x, y)| (x - y).abs());
            let too_far = off.find(|off| off.is_nan() || *off > tolerance);
            assert_eq!(too_far, None, "{op}/{}/{shape}: differs from scalar by more than {tolerance}", isa.name());
            if isa == Isa::SCALAR && work.macs > LONG && Isa::available().count() > 1 {
                continue;
            }
            let times = RefCell::new(Vec::new());
            group.bench_function(BenchmarkId::new(isa.name(), shape), |b| {
                b.iter_custom(|iterations| {
                    let start = Instant::now();
                    for _ in 0..iterations {
                        run(isa, &mut y);
                    }
                    let all = start.elapsed();
                    times.borrow_mut().push(all.as_secs_f64() / iterations as f64);
                    all
                });
            });
            let mut times = times.into_inner();
            times.sort_by(f64::total_cmp);
            let Some(&median) = times.get(times.len() / 2).filter(|_| !is_test()) else { continue };
            let (rate, unit) = if work.macs > 0 {
                (work.macs as f64 / median, "GMAC/s")
            } else {
                (work.bytes as f64 / median, "GB/s")
            };
            let share =
                self.peaks.least(isa, work).map(|least| format!(", {:.0} % of the floor", 100.0 * least / median));
            let (us, share) = (1e6 * median, share.unwrap_or_default());
            println!("{op}/{}/{shape}: median {us:.2} us, {:.1} {unit}{share}", isa.name(), rate / 1e9);
        }
        group.finish();
    }
}

/// Bound on the difference of sums of `k` products of numbers below 1 in two orders.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn sums(k: usize) -> f32 {
    k as f32 * k as f32 * f32::EPSILON
}

/// The same bound if tiles round every input to 16 bits.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn bf16_sums(k: usize) -> f32 {
    sums(k) + k as f32 / 65_536.0
}

/// One weight in the format of each product.
struct Weight {
    shape: (usize, usize),
    float: AlignedBox<f32>,
    bf16: AlignedBox<Bf16>,
    int8: AlignedBox<i8>,
    scale: Vec<f32>,
    sum: Vec<i32>,
}

impl Weight {
    fn new(random: &mut Random, n: usize, k: usize) -> Self {
        let (values, int8) = (floats(random, n * k), steps(random, n * k));
        let w = Mat::new(&values, n, k).expect(SHAPES);
        let mut all = Self {
            shape: (n, k),
            float: AlignedBox::zeroed(packed_len(n, k)),
            bf16: AlignedBox::zeroed(packed_len_bf16(n, k)),
            int8: AlignedBox::zeroed(packed_len_i8(n, k)),
            scale: vec![0.02; n],
            sum: vec![0; n],
        };
        pack(w, &mut all.float).expect(SHAPES);
        pack_bf16(w, &mut all.bf16).expect(SHAPES);
        pack_i8(Mat::new(&int8, n, k).expect(SHAPES), &mut all.int8, &mut all.sum).expect(SHAPES);
        all
    }

    fn float(&self) -> PackedF32<'_> {
        PackedF32::new(&self.float, self.shape.0, self.shape.1).expect(SHAPES)
    }

    fn bf16(&self) -> PackedBf16<'_> {
        PackedBf16::new(&self.bf16, self.shape.0, self.shape.1).expect(SHAPES)
    }

    fn int8(&self) -> PackedI8<'_> {
        PackedI8::new(&self.int8, &self.scale, &self.sum, self.shape.0, self.shape.1).expect(SHAPES)
    }
}

/// Rows in the format of each product.
struct Rows {
    shape: (usize, usize),
    float: AlignedBox<f32>,
    bf16: Vec<Bf16>,
    int8: AlignedBox<i8>,
    scale: Vec<f32>,
}

impl Rows {
    fn new(random: &mut Random, m: usize, k: usize) -> Self {
        let float = floats(random, m * k);
        let bf16 = float.iter().map(|&value| Bf16::from_f32(value)).collect();
        Self { shape: (m, k), float, bf16, int8: steps(random, m * k), scale: vec![0.01; m] }
    }

    fn float(&self) -> Input<'_, f32> {
        Input::all(Mat::new(&self.float, self.shape.0, self.shape.1).expect(SHAPES))
    }

    fn bf16(&self) -> Bf16Rows<'_> {
        Bf16Rows::rounded(Mat::new(&self.bf16, self.shape.0, self.shape.1).expect(SHAPES))
    }

    fn int8(&self) -> QuantRows<'_> {
        QuantRows::new(Mat::new(&self.int8, self.shape.0, self.shape.1).expect(SHAPES), &self.scale).expect(SHAPES)
    }
}

fn products(bench: &mut Bench) {
    for (m, n, k) in chosen(PRODUCTS) {
        let (mut random, shape) = (Random::new(1), format!("{m}x{n}x{k}"));
        let (x, w) = (Rows::new(&mut random, m, k), Weight::new(&mut random, n, k));
        let work = |unit, each| Work::product(unit, (m, n, k), each);
        bench.compare(("matmul_f32", &shape), work(Unit::Float, 4), (m * n, sums(k)), |isa, out| {
            matmul_f32(isa, x.float(), w.float(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("matmul_bf16", &shape), work(Unit::Parts(2), 2), (m * n, bf16_sums(k)), |isa, out| {
            matmul_bf16(isa, x.float(), w.bf16(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("matmul_bf16_rows", &shape), work(Unit::Rounded(1), 2), (m * n, sums(k)), |isa, out| {
            matmul_bf16_rows(isa, x.bf16(), w.bf16(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("matmul_i8", &shape), work(Unit::Int8, 1), (m * n, 0.0), |isa, out| {
            matmul_i8(isa, x.int8(), None, w.int8(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
    }
}

fn gated(bench: &mut Bench) {
    for (m, n, k) in chosen(GATED) {
        let (mut random, shape) = (Random::new(4), format!("{m}x{n}x{k}"));
        let (x, [gate, up]) = (Rows::new(&mut random, m, k), [(); 2].map(|()| Weight::new(&mut random, n, k)));
        let work = |unit, each| Work::product(unit, (m, 2 * n, k), each);
        // The error of one factor times the other factor, about ten.
        let off = |sum: f32| (m * n, 16.0 * sum);
        bench.compare(("matmul_gated_f32", &shape), work(Unit::Float, 4), off(sums(k)), |isa, out| {
            matmul_gated_f32(isa, x.float(), gate.float(), up.float(), matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("matmul_gated_bf16", &shape), work(Unit::Parts(2), 2), off(bf16_sums(k)), |isa, out| {
            matmul_gated_bf16(isa, x.float(), gate.bf16(), up.bf16(), matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("matmul_gated_i8", &shape), work(Unit::Int8, 1), (m * n, 0.0), |isa, out| {
            matmul_gated_i8(isa, x.int8(), None, gate.int8(), up.int8(), matrix(out, m, n)).expect(SHAPES);
        });
    }
}

/// Routes rows to two of four experts each: the router's softmax and sorting, then each expert's gated
/// product of its gathered rows and its scattered down product.
fn experts(bench: &mut Bench) {
    const EACH: usize = 2;
    for (m, inner, outer) in chosen(EXPERTS) {
        let (mut random, shape) = (Random::new(5), format!("{m}x{inner}x{outer}"));
        let (x, logits) = (Rows::new(&mut random, m, outer), floats(&mut random, m * 4));
        let mut expert =
            || [(inner, outer), (inner, outer), (outer, inner)].map(|(n, k)| Weight::new(&mut random, n, k));
        let all = [expert(), expert(), expert(), expert()];
        let mut probabilities = vec![0.0; m * 4];
        let (mut starts, mut rows, mut weights) = (vec![0; 5], vec![0; EACH * m], vec![0.0; EACH * m]);
        let (mut hidden, mut int8, mut scale) =
            (vec![0.0; EACH * m * inner], vec![0; EACH * m * inner], vec![0.0; EACH * m]);
        let read = if m == 1 { EACH } else { 4 };
        let work = Work { unit: Unit::Int8, macs: EACH * m * 3 * inner * outer, bytes: read * 3 * inner * outer };
        bench.compare(("experts_i8", &shape), work, (m * outer, 0.0), |isa, y| {
            probabilities.copy_from_slice(&logits);
            let mut routing = Routing { starts: &mut starts, rows: &mut rows, weights: &mut weights };
            route(isa, matrix(&mut probabilities, m, 4), EACH, &mut routing).expect(SHAPES);
            y.fill(0.0);
            for (e, [gate, up, down]) in all.iter().enumerate() {
                let slots = starts[e] as usize..starts[e + 1] as usize;
                let (count, mine) = (slots.len(), slots.start * inner..slots.end * inner);
                let (rows, weight) = (&rows[slots.clone()], &weights[slots.clone()]);
                let out = MatMut::new(&mut hidden[mine.clone()], count, inner).expect(SHAPES);
                matmul_gated_i8(isa, x.int8(), Some(rows), gate.int8(), up.int8(), out).expect(SHAPES);
                let values = Mat::new(&hidden[mine.clone()], count, inner).expect(SHAPES);
                let into = MatMut::new(&mut int8[mine.clone()], count, inner).expect(SHAPES);
                quantize_rows(isa, values, into, &mut scale[slots.clone()]).expect(SHAPES);
                let values = Mat::new(&int8[mine], count, inner).expect(SHAPES);
                let values = QuantRows::new(values, &scale[slots]).expect(SHAPES);
                let end = Epilogue { scatter: Some(Scatter { rows, weight }), ..Epilogue::STORE };
                matmul_i8(isa, values, None, down.int8(), end, MatMut::new(y, m, outer).expect(SHAPES)).expect(SHAPES);
            }
        });
    }
}

/// Attention over whole sequences.
type EncoderAttention = fn(Isa, Operands<f32>, MatMut<f32>) -> Result<(), ShapeError>;

fn attention(bench: &mut Bench) {
    for (m, n, width) in chosen(ATTENTIONS) {
        let (mut random, shape) = (Random::new(2), format!("{m}x{n}x{width}"));
        let [q, k, v] = [m, n, n].map(|rows| Rows::new(&mut random, rows, width));
        let values = floats(&mut random, m + n);
        let bias = RelativeBias { values: &values, origin: m - 1 };
        fn view(rows: &Rows) -> Mat<'_, f32> {
            Mat::new(&rows.float, rows.shape.0, rows.shape.1).expect(SHAPES)
        }
        fn view_bf16(rows: &Rows) -> Mat<'_, Bf16> {
            Mat::new(&rows.bf16, rows.shape.0, rows.shape.1).expect(SHAPES)
        }
        let work = |unit, each| Work { unit, macs: 2 * m * n * width, bytes: 2 * n * width * each };
        bench.compare(("attention_f32", &shape), work(Unit::Float, 4), (m * width, sums(width)), |isa, out| {
            let operands = Operands::new(view(&q), view(&k), view(&v), 0.125).biased(bias);
            attention_f32(isa, operands, matrix(out, m, width)).expect(SHAPES);
        });
        bench.compare(("attention_bf16", &shape), work(Unit::Float, 2), (m * width, sums(width)), |isa, out| {
            let operands = Operands::new(view(&q), view_bf16(&k), view_bf16(&v), 0.125).biased(bias);
            attention_bf16(isa, operands, matrix(out, m, width)).expect(SHAPES);
        });
        if m == n {
            // With bfloat16 factors all back-ends have the same bits.
            for (op, unit, attention, tolerance) in [
                ("encoder_attention_f32", Unit::Parts(6), encoder_attention_f32 as EncoderAttention, sums(width)),
                ("encoder_attention_bf16", Unit::Rounded(1), encoder_attention_bf16, 0.0),
            ] {
                bench.compare((op, &shape), work(unit, 4), (m * width, tolerance), |isa, out| {
                    let operands = Operands::new(view(&q), view(&k), view(&v), 0.125).biased(bias);
                    attention(isa, operands, matrix(out, m, width)).expect(SHAPES);
                });
            }
        }
    }
}

fn convolutions(bench: &mut Bench) {
    for (frames, channels, out, kernel, step) in CONVOLUTIONS {
        let (m, n, k) = (frames_out(frames, kernel, step), out, kernel * channels);
        if !is_timed(m * n * k) {
            continue;
        }
        let (mut random, shape) = (Random::new(6), format!("{frames}x{channels}-{out}k{kernel}s{step}"));
        let (x, w) = (Rows::new(&mut random, frames, channels), Weight::new(&mut random, n, k));
        let work = |unit, each| Work::product(unit, (m, n, k), each);
        bench.compare(("conv1d_f32", &shape), work(Unit::Float, 4), (m * n, sums(k)), |isa, out| {
            let rows = Input::all(windows(&x.float, frames, channels, kernel, step).expect(SHAPES));
            matmul_f32(isa, rows, w.float(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("conv1d_bf16", &shape), work(Unit::Rounded(1), 2), (m * n, sums(k)), |isa, out| {
            let rows = Bf16Rows::rounded(windows(&x.bf16, frames, channels, kernel, step).expect(SHAPES));
            matmul_bf16_rows(isa, rows, w.bf16(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
        let (mut int8, mut scale) = (vec![0; m * k], vec![0.0; m]);
        bench.compare(("conv1d_i8", &shape), work(Unit::Int8, 1), (m * n, 0.0), |isa, out| {
            let rows = windows(&x.float, frames, channels, kernel, step).expect(SHAPES);
            quantize_rows(isa, rows, MatMut::new(&mut int8, m, k).expect(SHAPES), &mut scale).expect(SHAPES);
            let rows = QuantRows::new(Mat::new(&int8, m, k).expect(SHAPES), &scale).expect(SHAPES);
            matmul_i8(isa, rows, None, w.int8(), Epilogue::STORE, matrix(out, m, n)).expect(SHAPES);
        });
    }
    // HuBERT's position convolution over 3 s of frames with its zero padding, and an odd
    // one.
    for (frames, dim, groups, kernel) in [(277, 768, 16, 128), (19, 15, 3, 5)] {
        let (m, group) = (frames_out(frames, kernel, 1), dim / groups);
        if !is_timed(m * dim * kernel * group) {
            continue;
        }
        let (mut random, shape) = (Random::new(7), format!("{frames}x{dim}g{groups}k{kernel}"));
        let (x, k) = (floats(&mut random, frames * dim), kernel * group);
        let len = packed_len(group, k);
        let mut packed = AlignedBox::zeroed(groups * len);
        for packed in packed.chunks_exact_mut(len) {
            pack(Mat::new(&floats(&mut random, group * k), group, k).expect(SHAPES), packed).expect(SHAPES);
        }
        let w = GroupedF32::new(&packed, groups, dim, dim, kernel).expect(SHAPES);
        let work = Work::product(Unit::Float, (m, dim, k), 4);
        bench.compare(("conv1d_grouped_f32", &shape), work, (m * dim, sums(k)), |isa, out| {
            conv1d_grouped_f32(isa, &x, frames, w, Epilogue::STORE, matrix(out, m, dim)).expect(SHAPES);
        });
    }
}

fn rows(bench: &mut Bench) {
    for (m, n) in [(1, 768), (256, 768), (5, 37)] {
        let (mut random, shape) = (Random::new(3), format!("{m}x{n}"));
        let (values, weight, shift) = (floats(&mut random, m * n), floats(&mut random, n), floats(&mut random, n));
        let x = Mat::new(&values, m, n).expect(SHAPES);
        // Values read and written.
        let through = Work::floats(2 * m * n);
        bench.compare(("filter::dot", &shape), Work::floats(m * n + n), (m, 1e-2), |isa, out| {
            for (t, out) in out.iter_mut().enumerate().take(m) {
                *out = dot(isa, &weight, x.row(t)).expect(SHAPES);
            }
        });
        bench.compare(("rms_norm", &shape), through, (m * n, 1e-5), |isa, out| {
            rms_norm(isa, x, &weight, 1e-6, matrix(out, m, n)).expect(SHAPES);
        });
        bench.compare(("layer_norm", &shape), through, (m * n, 1e-5), |isa, out| {
            layer_norm(isa, x, &weight, &shift, 1e-6, matrix(out, m, n)).expect(SHAPES);
        });
        let (mut sum, mut squares) = (vec![0.0; n], vec![0.0; n]);
        bench.compare(("channel_sums", &shape), Work::floats(m * n), (n, 1e-3), |isa, out| {
            sum.fill(0.0);
            squares.fill(0.0);
            channel_sums(isa, x, &mut sum, &mut squares).expect(SHAPES);
            for ((out, sum), squares) in out.iter_mut().zip(&sum).zip(&squares) {
                #[expect(clippy::cast_possible_truncation, reason = "a few hundred at most")]
                let both = (sum + squares) as f32;
                *out = both;
            }
        });
        // In-place operations work on a copy, which is timed with them and counts towards the
        // bytes moved.
        let in_place = through;
        bench.compare(("channel_affine", &shape), in_place, (m * n, 1e-5), |isa, out| {
            out.copy_from_slice(&values);
            channel_affine(isa, matrix(out, m, n), &weight, &shift).expect(SHAPES);
        });
        for (op, activation) in [("gelu", Activation::Gelu), ("gelu_tanh", Activation::GeluTanh)] {
            bench.compare((op, &shape), in_place, (m * n, 1e-5), |isa, out| {
                out.copy_from_slice(&values);
                apply(isa, activation, out);
            });
        }
        bench.compare(("softmax", &shape), in_place, (m * n, 1e-5), |isa, out| {
            out.copy_from_slice(&values);
            out.chunks_exact_mut(n).for_each(|row| softmax(isa, row));
        });
        bench.compare(("argmax", &shape), Work::floats(m * n), (m, 0.0), |isa, out| {
            for (out, row) in out.iter_mut().zip(values.chunks_exact(n)) {
                #[expect(clippy::cast_precision_loss, reason = "places in a row")]
                let place = argmax(isa, row).map_or(-1.0, |place| place as f32);
                *out = place;
            }
        });
        let mut rounded = vec![Bf16::default(); m * n];
        let work = Work { bytes: 6 * m * n, ..through };
        bench.compare(("round_bf16", &shape), work, (1, 0.0), |isa, out| {
            round_bf16(isa, x, MatMut::new(&mut rounded, m, n).expect(SHAPES)).expect(SHAPES);
            out[0] = rounded[m * n - 1].to_f32();
        });
        let mut steps = vec![0; m * n];
        let work = Work { bytes: 5 * m * n, ..through };
        bench.compare(("quantize_rows", &shape), work, (m, 0.0), |isa, scale| {
            quantize_rows(isa, x, MatMut::new(&mut steps, m, n).expect(SHAPES), scale).expect(SHAPES);
        });
    }
}

fn all(c: &mut Criterion) {
    let bench = &mut Bench { c, peaks: &mut Peaks::default() };
    for benches in [products, gated, experts, attention, convolutions, rows] {
        benches(bench);
    }
}

criterion_group!(benches, all);
criterion_main!(benches);
