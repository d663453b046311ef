//! One call of every kernel with seeded operands, and digests of the results.

use umo_kernels::activation::{Activation, apply, argmax, softmax};
use umo_kernels::attention::{
    self, HeadCache, RelativeBias, Visible, attention_bf16, attention_f32, attention_heads_f32, encoder_attention_bf16,
    encoder_attention_f32,
};
use umo_kernels::bf16::round_bf16;
use umo_kernels::conv1d::{GroupedF32, conv1d_grouped_f32, frames_out};
use umo_kernels::experts::{Routing, route};
use umo_kernels::filter::dot;
use umo_kernels::gemm::Epilogue;
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16_rows, split_bf16x2};
use umo_kernels::norm::{channel_affine, channel_sums, layer_norm, rms_norm};
use umo_kernels::pack::{pack, pack_bf16, packed_len, packed_len_bf16};
use umo_kernels::quantize::quantize_rows;
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16};

use super::buffers::Noise;
use super::products::{Case, Kind, Operands, Values};

/// Calls a kernel with operands whose sizes and values follow from a seed; returns the bits of its results.
pub type Call = fn(Isa, u64, Values) -> Vec<u64>;

/// Every kernel, by its name in docs/kernels.md.
pub const CALLS: [(&str, Call); 27] = [
    ("matmul_i4", |isa, seed, values| plain(Kind::I4, isa, seed, values)),
    ("matmul_gated_i4", |isa, seed, values| gated(Kind::I4, isa, seed, values)),
    ("matmul_i8", |isa, seed, values| plain(Kind::I8, isa, seed, values)),
    ("matmul_gated_i8", |isa, seed, values| gated(Kind::I8, isa, seed, values)),
    ("quantize_rows", quantized),
    ("activation::apply", activated),
    ("softmax", softmaxed),
    ("argmax", found),
    ("rms_norm", rms),
    ("layer_norm", layer),
    ("filter::dot", filtered),
    ("channel_sums", sums),
    ("channel_affine", affine),
    ("route", routed),
    ("round_bf16", rounded),
    ("split_bf16x2", split),
    ("encoder_attention_bf16", |isa, seed, values| Attention::new(seed, values).encoder(isa, encoder_attention_bf16)),
    ("matmul_f32", |isa, seed, values| plain(Kind::F32, isa, seed, values)),
    ("matmul_gated_f32", |isa, seed, values| gated(Kind::F32, isa, seed, values)),
    ("conv1d_grouped_f32", convolved),
    ("matmul_bf16", |isa, seed, values| plain(Kind::Bf16, isa, seed, values)),
    ("matmul_gated_bf16", |isa, seed, values| gated(Kind::Bf16, isa, seed, values)),
    ("matmul_bf16_rows", rounded_rows),
    ("attention_f32", |isa, seed, values| Attention::new(seed, values).f32(isa)),
    ("attention_heads_f32", heads),
    ("attention_bf16", |isa, seed, values| Attention::new(seed, values).bf16(isa)),
    ("encoder_attention_f32", |isa, seed, values| Attention::new(seed, values).encoder(isa, encoder_attention_f32)),
];

fn bits(values: &[f32]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits().into()).collect()
}

fn filled(noise: &mut Noise, count: usize, values: Values) -> Vec<f32> {
    (0..count).map(|_| values.float(noise)).collect()
}

fn floats(noise: &mut Noise, count: usize) -> Vec<f32> {
    filled(noise, count, Values::Real)
}

/// Operands of attention scores: integers with exact products, or arbitrary values.
fn scored(noise: &mut Noise, count: usize, values: Values) -> Vec<f32> {
    match values {
        Values::Exact => (0..count).map(|_| noise.integer(2)).collect(),
        _ => floats(noise, count),
    }
}

fn mat<T: Copy>(data: &[T], rows: usize, cols: usize) -> Mat<'_, T> {
    Mat::new(data, rows, cols).unwrap()
}

fn plain(kind: Kind, isa: Isa, seed: u64, values: Values) -> Vec<u64> {
    Operands::new(&Case::sample(kind, seed, values)).bits(isa, false)
}

fn gated(kind: Kind, isa: Isa, seed: u64, values: Values) -> Vec<u64> {
    Operands::new(&Case::sample(kind, seed, values)).bits(isa, true)
}

fn portable(kind: Kind, isa: Isa, seed: u64, gated: bool) -> Vec<u64> {
    Operands::new(&Case::portable_sample(kind, seed)).bits(isa, gated)
}

fn rounded_rows(isa: Isa, seed: u64, values: Values) -> Vec<u64> {
    rounded_rows_of(isa, seed, &Case::sample(Kind::Bf16, seed, values))
}

fn rounded_rows_of(isa: Isa, seed: u64, &Case { m, n, k, values, .. }: &Case) -> Vec<u64> {
    let mut noise = Noise::new(seed);
    let mut floats = |count| filled(&mut noise, count, values);
    let x: Vec<_> = floats(m * k).into_iter().map(Bf16::from_f32).collect();
    let (w, bias, mut y) = (floats(n * k), floats(n), floats(m * n));
    let mut packed = vec![Bf16::default(); packed_len_bf16(n, k)];
    pack_bf16(mat(&w, n, k), &mut packed).unwrap();
    let w = PackedBf16::new(&packed, n, k).unwrap();
    let epilogue = Epilogue { bias: Some(&bias), activation: Activation::Gelu, add: true, scatter: None };
    matmul_bf16_rows(isa, Bf16Rows::rounded(mat(&x, m, k)), w, epilogue, MatMut::new(&mut y, m, n).unwrap()).unwrap();
    bits(&y)
}

/// Seeded rows of floats: their number, their length, the values, and the generator for further operands.
fn rows(seed: u64) -> (usize, usize, Vec<f32>, Noise) {
    let mut noise = Noise::new(seed);
    let (rows, cols) = (1 + noise.below(5), 1 + noise.below(300));
    let x = floats(&mut noise, rows * cols);
    (rows, cols, x, noise)
}

#[expect(clippy::cast_sign_loss, reason = "the bits of a byte")]
fn quantized(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, x, _) = rows(seed);
    let (mut codes, mut scale) = (vec![0; rows * cols], vec![0.0; rows]);
    quantize_rows(isa, mat(&x, rows, cols), MatMut::new(&mut codes, rows, cols).unwrap(), &mut scale).unwrap();
    codes.iter().map(|&code| u64::from(code as u8)).chain(bits(&scale)).collect()
}

fn activated(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (_, _, x, _) = rows(seed);
    let all = [Activation::Gelu, Activation::GeluTanh, Activation::Relu, Activation::LeakyRelu(0.2)];
    let of = |activation| {
        let mut x: Vec<f32> = x.iter().map(|x| 6.0 * x).collect();
        apply(isa, activation, &mut x);
        bits(&x)
    };
    all.into_iter().flat_map(of).collect()
}

fn softmaxed(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (_, _, mut x, _) = rows(seed);
    x.iter_mut().for_each(|x| *x *= 9.0);
    softmax(isa, &mut x);
    bits(&x)
}

/// Includes ties: of equal values, the first wins.
fn found(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, x, mut noise) = rows(seed);
    let x: Vec<f32> = x.into_iter().map(|x| if noise.below(2) == 0 { x } else { noise.integer(2) }).collect();
    (0..rows).map(|t| argmax(isa, mat(&x, rows, cols).row(t)).map_or(u64::MAX, |at| at as u64)).collect()
}

fn norm(isa: Isa, seed: u64, layer: bool) -> Vec<u64> {
    let (rows, cols, x, mut noise) = rows(seed);
    let (weight, bias) = (floats(&mut noise, cols), floats(&mut noise, cols));
    let mut y = vec![0.0; rows * cols];
    let (x, out) = (mat(&x, rows, cols), MatMut::new(&mut y, rows, cols).unwrap());
    if layer {
        layer_norm(isa, x, &weight, &bias, 1e-5, out).unwrap();
    } else {
        rms_norm(isa, x, &weight, 1e-6, out).unwrap();
    }
    bits(&y)
}

fn filtered(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, x, mut noise) = rows(seed);
    let taps = floats(&mut noise, cols);
    (0..rows).map(|t| dot(isa, &taps, mat(&x, rows, cols).row(t)).unwrap().to_bits().into()).collect()
}

fn rms(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    norm(isa, seed, false)
}

fn layer(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    norm(isa, seed, true)
}

fn sums(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, x, _) = rows(seed);
    let (mut sum, mut squares) = (vec![0.0; cols], vec![0.0; cols]);
    channel_sums(isa, mat(&x, rows, cols), &mut sum, &mut squares).unwrap();
    sum.iter().chain(&squares).map(|value| value.to_bits()).collect()
}

fn affine(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, mut x, mut noise) = rows(seed);
    let (scale, shift) = (floats(&mut noise, cols), floats(&mut noise, cols));
    channel_affine(isa, MatMut::new(&mut x, rows, cols).unwrap(), &scale, &shift).unwrap();
    bits(&x)
}

fn routed(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let mut noise = Noise::new(seed);
    let (rows, experts) = (1 + noise.below(40), 2 + noise.below(6));
    let top_k = 1 + noise.below(2);
    let mut logits = floats(&mut noise, rows * experts);
    let (mut starts, mut order, mut weights) = (vec![0; experts + 1], vec![0; rows * top_k], vec![0.0; rows * top_k]);
    let mut routing = Routing { starts: &mut starts, rows: &mut order, weights: &mut weights };
    route(isa, MatMut::new(&mut logits, rows, experts).unwrap(), top_k, &mut routing).unwrap();
    starts.iter().chain(&order).map(|&place| place.into()).chain(bits(&weights)).chain(bits(&logits)).collect()
}

fn rounded(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (rows, cols, x, _) = rows(seed);
    let mut y = vec![Bf16::default(); x.len()];
    round_bf16(isa, mat(&x, rows, cols), MatMut::new(&mut y, rows, cols).unwrap()).unwrap();
    y.iter().map(|y| y.0.into()).collect()
}

fn split(isa: Isa, seed: u64, _: Values) -> Vec<u64> {
    let (_, _, x, _) = rows(seed);
    let (mut hi, mut lo) = (vec![Bf16::default(); x.len()], vec![Bf16::default(); x.len()]);
    split_bf16x2(isa, &x, &mut hi, &mut lo).unwrap();
    hi.iter().chain(&lo).map(|part| part.0.into()).collect()
}

fn convolved(isa: Isa, seed: u64, values: Values) -> Vec<u64> {
    let mut noise = Noise::new(seed);
    let (groups, out, channels, kernel) =
        (1 + noise.below(3), 1 + noise.below(20), 1 + noise.below(4), 1 + noise.below(40));
    let frames = kernel + noise.below(40);
    let x = filled(&mut noise, groups * frames * channels, values);
    let mut packed = vec![];
    for _ in 0..groups {
        let w = filled(&mut noise, out * kernel * channels, values);
        let mut group = vec![0.0; packed_len(out, kernel * channels)];
        pack(mat(&w, out, kernel * channels), &mut group).unwrap();
        packed.extend(group);
    }
    let w = GroupedF32::new(&packed, groups, groups * out, groups * channels, kernel).unwrap();
    let rows = frames_out(frames, kernel, 1);
    let mut y = vec![0.0; rows * groups * out];
    let out = MatMut::new(&mut y, rows, groups * out).unwrap();
    conv1d_grouped_f32(isa, &x, frames, w, Epilogue::STORE, out).unwrap();
    bits(&y)
}

/// Operands of attention.
struct Attention {
    queries: usize,
    keys: usize,
    dim: usize,
    q: Vec<f32>,
    k: Vec<f32>,
    v: Vec<f32>,
    bias: Option<Vec<f32>>,
    causal: bool,
}

type EncoderAttention = fn(Isa, attention::Operands<f32>, MatMut<f32>) -> Result<(), umo_kernels::ShapeError>;

impl Attention {
    fn new(seed: u64, values: Values) -> Self {
        let mut noise = Noise::new(seed);
        let scores = |noise: &mut Noise, count| scored(noise, count, values);
        let queries = [1, 3, 17, 40][noise.below(4)];
        let keys = queries + noise.below(300);
        let dim = [8, 32, 33, 64][noise.below(4)];
        Self {
            queries,
            keys,
            dim,
            q: scores(&mut noise, queries * dim),
            k: scores(&mut noise, keys * dim),
            v: floats(&mut noise, keys * dim),
            bias: (noise.below(2) == 0).then(|| scores(&mut noise, queries + keys)),
            causal: noise.below(2) == 0,
        }
    }

    fn bias(&self) -> Option<RelativeBias<'_>> {
        self.bias.as_ref().map(|values| RelativeBias { values, origin: self.queries })
    }

    fn visible(&self) -> Visible {
        if self.causal { Visible::Causal { first: self.keys - self.queries } } else { Visible::All }
    }

    fn result(&self, attention: impl FnOnce(MatMut<f32>)) -> Vec<u64> {
        let mut y = vec![0.0; self.q.len()];
        attention(MatMut::new(&mut y, self.queries, self.dim).unwrap());
        bits(&y)
    }

    fn encoder(&self, isa: Isa, attention: EncoderAttention) -> Vec<u64> {
        let [q, k, v] = [&self.q, &self.k, &self.v].map(|data| mat(data, data.len() / self.dim, self.dim));
        self.result(|y| attention(isa, attention::Operands::new(q, k, v, 0.5).biased(self.bias()), y).unwrap())
    }

    fn f32(&self, isa: Isa) -> Vec<u64> {
        let [q, k, v] = [&self.q, &self.k, &self.v].map(|data| mat(data, data.len() / self.dim, self.dim));
        let operands = attention::Operands::new(q, k, v, 0.5).biased(self.bias()).seeing(self.visible());
        self.result(|y| attention_f32(isa, operands, y).unwrap())
    }

    fn bf16(&self, isa: Isa) -> Vec<u64> {
        let [k, v] = [&self.k, &self.v].map(|data| data.iter().map(|&x| Bf16::from_f32(x)).collect::<Vec<_>>());
        let (k, v) = (mat(&k, self.keys, self.dim), mat(&v, self.keys, self.dim));
        let q = mat(&self.q, self.queries, self.dim);
        let operands = attention::Operands::new(q, k, v, 0.5).biased(self.bias()).seeing(self.visible());
        self.result(|y| attention_bf16(isa, operands, y).unwrap())
    }
}

/// Heads with specialised widths and with others, with few keys and with many.
fn heads(isa: Isa, seed: u64, values: Values) -> Vec<u64> {
    let mut noise = Noise::new(seed);
    let (rows, heads, dim) = (1 + noise.below(3), 1 + noise.below(6), [24, 32, 48, 64][noise.below(4)]);
    let filled = 1 + [noise.below(40), noise.below(80)][noise.below(2)];
    let places = filled + noise.below(3);
    let count = rows * heads * places * dim;
    let q = scored(&mut noise, rows * heads * dim, values);
    let (keys, values) = (scored(&mut noise, count, values), floats(&mut noise, count));
    let cache = HeadCache { keys: &keys, values: &values, heads, places, filled };
    let mut y = vec![0.0; q.len()];
    let out = MatMut::new(&mut y, rows, heads * dim).unwrap();
    attention_heads_f32(isa, mat(&q, rows, heads * dim), cache, 0.5, out).unwrap();
    bits(&y)
}

/// Digests of the kernels' results on `scalar` and on `avx2`.
pub(super) const DIGESTS: [(&str, [u64; 2]); 27] = [
    ("matmul_i4", [0xe9d2_8743_06d7_6d99, 0xe9d2_8743_06d7_6d99]),
    ("matmul_gated_i4", [0xd2f1_47e5_dc4d_f909, 0xd2f1_47e5_dc4d_f909]),
    ("matmul_i8", [0x6591_9937_4fc8_38b5, 0x6591_9937_4fc8_38b5]),
    ("matmul_gated_i8", [0xafbd_0d54_57d3_8319, 0xafbd_0d54_57d3_8319]),
    ("quantize_rows", [0x52d6_526d_e1e1_8f9d, 0x52d6_526d_e1e1_8f9d]),
    ("activation::apply", [0xf21f_9a83_6f8b_2dfd, 0xf21f_9a83_6f8b_2dfd]),
    ("softmax", [0xb67b_ac9c_70a6_3e18, 0xb67b_ac9c_70a6_3e18]),
    ("argmax", [0xae96_62b9_2ce3_5b45, 0xae96_62b9_2ce3_5b45]),
    ("rms_norm", [0x8b73_48f1_fd8e_922d, 0x8b73_48f1_fd8e_922d]),
    ("layer_norm", [0x0717_5c25_eb4b_79fd, 0x0717_5c25_eb4b_79fd]),
    ("filter::dot", [0x94c6_b832_a9a0_afa0, 0x94c6_b832_a9a0_afa0]),
    ("channel_sums", [0xd1c4_306e_8041_3f24, 0xd1c4_306e_8041_3f24]),
    ("channel_affine", [0xbe9c_a4d4_8b8f_aab6, 0xbe9c_a4d4_8b8f_aab6]),
    ("route", [0xa738_74e9_42c3_a4b6, 0xa738_74e9_42c3_a4b6]),
    ("round_bf16", [0xfe67_96be_94be_e963, 0xfe67_96be_94be_e963]),
    ("split_bf16x2", [0x1bd9_3329_945d_8572, 0x1bd9_3329_945d_8572]),
    ("encoder_attention_bf16", [0x5962_92f4_e33b_eece, 0x5962_92f4_e33b_eece]),
    ("matmul_f32", [0x3b47_de9f_40d6_d879, 0x15c8_788c_fac9_aac3]),
    ("matmul_gated_f32", [0xee81_0970_326b_11f4, 0xfa38_abd9_ad66_aff4]),
    ("conv1d_grouped_f32", [0xbd54_f89e_bbea_1bd1, 0x245f_27d9_1741_1ca3]),
    ("matmul_bf16", [0xff78_fa9f_7362_d411, 0x9827_db20_823f_9612]),
    ("matmul_gated_bf16", [0x53b5_f29a_05be_fec0, 0x9b2e_a461_021b_b81e]),
    ("matmul_bf16_rows", [0x2bdf_3791_e4b2_4ead, 0x2bdf_3791_e4b2_4ead]),
    ("attention_f32", [0x89e2_1f31_998f_dc1e, 0xaa87_60b2_8d35_722b]),
    ("attention_heads_f32", [0x9c91_c84f_9356_c39f, 0x5555_3046_1f7f_11c6]),
    ("attention_bf16", [0x54c5_bebf_fc82_5160, 0xd7e8_5552_1146_fe7d]),
    ("encoder_attention_f32", [0xceb4_ca52_c5b8_2380, 0xb3f1_203b_cf17_b0de]),
];

/// Replacements with fixed sizes for calls whose sizes depend on the processor's back-ends.
pub(super) const PORTABLE_CALLS: [(&str, Call); 9] = [
    ("matmul_i4", |isa, seed, _| portable(Kind::I4, isa, seed, false)),
    ("matmul_gated_i4", |isa, seed, _| portable(Kind::I4, isa, seed, true)),
    ("matmul_i8", |isa, seed, _| portable(Kind::I8, isa, seed, false)),
    ("matmul_gated_i8", |isa, seed, _| portable(Kind::I8, isa, seed, true)),
    ("matmul_f32", |isa, seed, _| portable(Kind::F32, isa, seed, false)),
    ("matmul_gated_f32", |isa, seed, _| portable(Kind::F32, isa, seed, true)),
    ("matmul_bf16", |isa, seed, _| portable(Kind::Bf16, isa, seed, false)),
    ("matmul_gated_bf16", |isa, seed, _| portable(Kind::Bf16, isa, seed, true)),
    ("matmul_bf16_rows", |isa, seed, _| rounded_rows_of(isa, seed, &Case::portable_sample(Kind::Bf16, seed))),
];
