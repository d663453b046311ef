//! A tuning profile changes the order of memory accesses and of exact operations, and never a bit
//! of a result.

use umo_kernels::attention::{Visible, attention_bf16, attention_f32};
use umo_kernels::gemm::Epilogue;
use umo_kernels::matmul_i8::{matmul_gated_i8, matmul_i8};
use umo_kernels::pack::{pack_i8, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::tuning::Tuning;
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedI8, PrefetchHint};

/// Numbers without a pattern.
fn numbers(seed: u64) -> impl Iterator<Item = u64> {
    (1..).map(move |i: u64| {
        (seed + i).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29).wrapping_mul(0xbf58_476d_1ce4_e5b9) >> 40
    })
}

fn bytes(seed: u64, len: usize) -> Vec<i8> {
    numbers(seed).take(len).map(|x| x.to_le_bytes()[0].cast_signed()).collect()
}

fn floats(seed: u64, len: usize) -> Vec<f32> {
    numbers(seed).take(len).map(|x| (x % 4001) as f32 / 2000.0 - 1.0).collect()
}

/// The bits of what `f` writes, by every profile, which are the same.
fn with_every_profile(isa: Isa, len: usize, f: impl Fn(Isa, &mut [f32])) -> Vec<u32> {
    let bits = Tuning::ALL.map(|tuning| {
        let mut y = vec![0.0; len];
        f(isa.with_tuning(tuning), &mut y);
        y.into_iter().map(f32::to_bits).collect::<Vec<_>>()
    });
    assert_eq!(bits[0], bits[1], "{}", isa.name());
    let [bits, _] = bits;
    bits
}

#[test]
fn int8_products_do_not_depend_on_the_profile() {
    // Rows around the 8 that one stream takes, inputs around the 4096 that it takes, and a part of
    // a quad.
    for (m, n, k) in [(1, 100, 64), (1, 16, 4100), (2, 33, 257), (5, 48, 130), (8, 70, 96), (9, 70, 96), (12, 20, 4097)]
    {
        let (x, w, scale) = (bytes(1, m * k), bytes(2, n * k), floats(3, m.max(n)));
        let (mut packed, mut sum) = (vec![0; packed_len_i8(n, k)], vec![0; n]);
        pack_i8(Mat::new(&w, n, k).unwrap(), &mut packed, &mut sum).unwrap();
        let w = PackedI8::new(&packed, &scale[..n], &sum, n, k).unwrap();
        let x = QuantRows::new(Mat::new(&x, m, k).unwrap(), &scale[..m]).unwrap();
        let bias = floats(4, n);
        let results = Isa::available().map(|isa| {
            let plain = with_every_profile(isa, m * n, |isa, y| {
                matmul_i8(isa, x, None, w, Epilogue::bias(&bias), MatMut::new(y, m, n).unwrap()).unwrap();
            });
            let gated = with_every_profile(isa, m * n, |isa, y| {
                matmul_gated_i8(isa, x, None, w, w, MatMut::new(y, m, n).unwrap()).unwrap();
            });
            (plain, gated)
        });
        let results: Vec<_> = results.collect();
        assert!(results.iter().all(|result| *result == results[0]), "{m} x {n} x {k}");
    }
}

#[test]
fn attention_does_not_depend_on_the_profile() {
    for (m, n, dim) in [(1, 70, 64), (2, 130, 20), (3, 5, 64), (9, 64, 48)] {
        let (q, k, v) = (floats(5, m * dim), floats(6, n * dim), floats(7, n * dim));
        let [k_bf16, v_bf16] = [&k, &v].map(|x| x.iter().map(|&x| Bf16::from_f32(x)).collect::<Vec<_>>());
        let q = Mat::new(&q, m, dim).unwrap();
        for isa in Isa::available() {
            with_every_profile(isa, m * dim, |isa, y| {
                let [k, v] = [&k, &v].map(|x| Mat::new(x, n, dim).unwrap());
                let y = MatMut::new(y, m, dim).unwrap();
                attention_f32(isa, q, k, v, 0.125, None, Visible::All, PrefetchHint::NONE, y).unwrap();
            });
            with_every_profile(isa, m * dim, |isa, y| {
                let [k, v] = [&k_bf16, &v_bf16].map(|x| Mat::new(x, n, dim).unwrap());
                let y = MatMut::new(y, m, dim).unwrap();
                attention_bf16(isa, q, k, v, 0.125, None, Visible::All, PrefetchHint::NONE, y).unwrap();
            });
        }
    }
}
