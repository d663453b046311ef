//! Every operation on every back-end at the base model's shapes and an awkward one: `<op>/<isa>/<shape>`.
//!
//! Each is compared with the scalar twin before it is timed. Weights are the same in every call, so they are hot: what
//! reads them from memory is timed in `step.rs`.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use umo_benches::{Random, is_test};
use umo_core::weights::AlignedBox;
use umo_kernels::attention::{RelativeBias, Visible, attention_f32, encoder_attention_bf16, encoder_attention_f32};
use umo_kernels::matmul_bf16::matmul_bf16;
use umo_kernels::matmul_f32::{Epilogue, Input, matmul_f32};
use umo_kernels::matmul_i8::{QuantRows, matmul_i8, quantize_rows};
use umo_kernels::norm::rms_norm;
use umo_kernels::pack::{pack, pack_bf16, pack_i8, packed_len, packed_len_bf16, packed_len_i8};
use umo_kernels::{Ahead, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI8, ShapeError};

/// Rows, outputs and inputs: one token, a pass with markers, a window; feed-forward in, out, attention; and odd ones.
const PRODUCTS: [(usize, usize, usize); 9] = [
    (1, 2048, 768),
    (1, 768, 2048),
    (3, 2304, 768),
    (16, 768, 768),
    (64, 2048, 768),
    (256, 2048, 768),
    (256, 768, 2048),
    (150, 3072, 768),
    (37, 131, 257),
];

/// Queries, keys and width of one head.
const ATTENTIONS: [(usize, usize, usize); 4] = [(256, 256, 64), (1, 256, 64), (3, 25, 64), (7, 61, 20)];

const SHAPES: &str = "shapes agree";

/// Shapes to time; where benches run as tests, the small ones.
fn chosen<const N: usize>(shapes: [(usize, usize, usize); N]) -> Vec<(usize, usize, usize)> {
    shapes.into_iter().filter(|(m, n, k)| !is_test() || m * n * k < 1 << 21).collect()
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

/// Runs `op` on every back-end, compares it with the scalar one, and times it. `unit` is what one call does.
fn compare(
    c: &mut Criterion,
    op: &str,
    shape: &str,
    unit: u64,
    (len, tolerance): (usize, f32),
    run: impl Fn(Isa, &mut [f32]),
) {
    let (mut wanted, mut y) = (AlignedBox::<f32>::zeroed(len), AlignedBox::<f32>::zeroed(len));
    run(Isa::SCALAR, &mut wanted);
    let mut group = c.benchmark_group(op);
    group.throughput(Throughput::Elements(unit)).sample_size(20);
    for isa in Isa::available() {
        run(isa, &mut y);
        let error = wanted.iter().zip(&*y).fold(0.0_f32, |a, (x, y)| a.max((x - y).abs()));
        assert!(error <= tolerance, "{op}/{}/{shape}: differs from scalar by {error}", isa.name());
        group.bench_with_input(BenchmarkId::new(isa.name(), shape), &isa, |b, &isa| b.iter(|| run(isa, &mut y)));
    }
    group.finish();
}

/// Sums of `k` products of numbers below 1 in two orders differ by less than this.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn sums(k: usize) -> f32 {
    k as f32 * k as f32 * f32::EPSILON
}

/// The same where tiles round every input to 16 bits.
#[expect(clippy::cast_precision_loss, reason = "widths are far below 2^24")]
fn bf16_sums(k: usize) -> f32 {
    sums(k) + k as f32 / 65_536.0
}

fn products(c: &mut Criterion) {
    for (m, n, k) in chosen(PRODUCTS) {
        let (mut random, shape, macs) = (Random::new(1), format!("{m}x{n}x{k}"), (m * n * k) as u64);
        let (x, w) = (floats(&mut random, m * k), floats(&mut random, n * k));
        let (rows, w) = (Mat::new(&x, m, k).expect(SHAPES), Mat::new(&w, n, k).expect(SHAPES));

        let mut packed = AlignedBox::zeroed(packed_len(n, k));
        pack(w, &mut packed).expect(SHAPES);
        let weight = PackedF32::new(&packed, n, k).expect(SHAPES);
        compare(c, "matmul_f32", &shape, macs, (m * n, sums(k)), |isa, y| {
            let y = MatMut::new(y, m, n).expect(SHAPES);
            matmul_f32(isa, Input::all(rows), weight, Epilogue::STORE, y).expect(SHAPES);
        });

        let mut packed = AlignedBox::zeroed(packed_len_bf16(n, k));
        pack_bf16(w, &mut packed).expect(SHAPES);
        let weight = PackedBf16::new(&packed, n, k).expect(SHAPES);
        compare(c, "matmul_bf16", &shape, macs, (m * n, bf16_sums(k)), |isa, y| {
            let y = MatMut::new(y, m, n).expect(SHAPES);
            matmul_bf16(isa, Input::all(rows), weight, Epilogue::STORE, y).expect(SHAPES);
        });

        int8_product(c, &mut random, (m, n, k), &shape);
    }
}

fn int8_product(c: &mut Criterion, random: &mut Random, (m, n, k): (usize, usize, usize), shape: &str) {
    let (x, w) = (steps(random, m * k), steps(random, n * k));
    let (x_scale, w_scale) = (vec![0.01; m], vec![0.02; n]);
    let (mut packed, mut sum) = (AlignedBox::zeroed(packed_len_i8(n, k)), vec![0; n]);
    pack_i8(Mat::new(&w, n, k).expect(SHAPES), &mut packed, &mut sum).expect(SHAPES);
    let weight = PackedI8::new(&packed, &w_scale, &sum, n, k).expect(SHAPES);
    let rows = QuantRows::new(Mat::new(&x, m, k).expect(SHAPES), &x_scale).expect(SHAPES);
    compare(c, "matmul_i8", shape, (m * n * k) as u64, (m * n, 0.0), |isa, y| {
        matmul_i8(isa, rows, None, weight, Epilogue::STORE, MatMut::new(y, m, n).expect(SHAPES)).expect(SHAPES);
    });
}

/// Attention over whole sequences.
type EncoderAttention =
    fn(Isa, Mat<f32>, Mat<f32>, Mat<f32>, f32, Option<RelativeBias>, MatMut<f32>) -> Result<(), ShapeError>;

fn attention(c: &mut Criterion) {
    for (m, n, width) in chosen(ATTENTIONS) {
        let mut random = Random::new(2);
        let [q, k, v] = [m, n, n].map(|rows| floats(&mut random, rows * width));
        let values = floats(&mut random, m + n);
        let bias = RelativeBias { values: &values, origin: m - 1 };
        let view = |data, rows| Mat::new(data, rows, width).expect(SHAPES);
        let macs = (2 * m * n * width) as u64;
        compare(c, "attention_f32", &format!("{m}x{n}x{width}"), macs, (m * width, sums(width)), |isa, y| {
            let y = MatMut::new(y, m, width).expect(SHAPES);
            let (q, k, v) = (view(&q, m), view(&k, n), view(&v, n));
            attention_f32(isa, q, k, v, 0.125, Some(bias), Visible::All, Ahead::NOTHING, y).expect(SHAPES);
        });
        if m == n {
            // With factors in bfloat16 all back-ends have the same bits.
            for (op, attention, tolerance) in [
                ("encoder_attention_f32", encoder_attention_f32 as EncoderAttention, sums(width)),
                ("encoder_attention_bf16", encoder_attention_bf16, 0.0),
            ] {
                compare(c, op, &format!("{m}x{n}x{width}"), macs, (m * width, tolerance), |isa, y| {
                    let y = MatMut::new(y, m, width).expect(SHAPES);
                    let (q, k, v) = (view(&q, m), view(&k, n), view(&v, n));
                    attention(isa, q, k, v, 0.125, Some(bias), y).expect(SHAPES);
                });
            }
        }
    }
}

fn rows(c: &mut Criterion) {
    for (m, n) in [(1, 768), (256, 768), (5, 37)] {
        let mut random = Random::new(3);
        let (x, weight) = (floats(&mut random, m * n), floats(&mut random, n));
        let x = Mat::new(&x, m, n).expect(SHAPES);
        let (shape, bytes) = (format!("{m}x{n}"), (4 * m * n) as u64);
        compare(c, "rms_norm", &shape, bytes, (m * n, 1e-5), |isa, y| {
            rms_norm(isa, x, &weight, 1e-6, MatMut::new(y, m, n).expect(SHAPES)).expect(SHAPES);
        });
        compare(c, "quantize_rows", &shape, bytes, (m, 0.0), |isa, scale| {
            let mut steps = vec![0; m * n];
            quantize_rows(isa, x, MatMut::new(&mut steps, m, n).expect(SHAPES), scale).expect(SHAPES);
        });
    }
}

criterion_group!(benches, products, attention, rows);
criterion_main!(benches);
