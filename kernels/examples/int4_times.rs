//! Times int4 products against int8 products of the same weights, alternating, with weights read from memory. Usage:
//! `int4_times [seconds per figure]`.
//!
//! Each line is one shape: median microseconds of both, their ratio, and GB/s of the int4 weights.

use std::hint::black_box;
use std::time::Instant;
use umo_kernels::gemm::Epilogue;
use umo_kernels::matmul_i4::{is_fast, matmul_i4};
use umo_kernels::matmul_i8::matmul_i8;
use umo_kernels::pack::{GROUP, PANEL, pack_i8, pack_row_i4, packed_len_i4, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::{Isa, Mat, MatMut, PackedI4, PackedI8};

/// Total bytes of int8 weights that are cycled through, more than the cache holds.
const COLD_BYTES: usize = 96 << 20;
/// Numbers of outputs and inputs: attention and experts of the base model, and of the default model.
const SHAPES: [(usize, usize); 5] = [(768, 768), (2048, 768), (768, 2048), (256, 256), (1024, 256)];
const ROWS: [usize; 9] = [1, 2, 3, 4, 5, 8, 16, 64, 256];

fn main() {
    let seconds: f64 = std::env::args().nth(1).map_or(0.2, |seconds| seconds.parse().expect("seconds"));
    let isa = std::env::var("UMO_ISA").map_or(Isa::detect(), |name| Isa::from_name(&name).expect("a back-end"));
    println!("{}{}", isa.name(), if is_fast(isa, true) { "" } else { ", without an int4 product of its own" });
    println!("{:>11} {:>4} {:>9} {:>9} {:>6} {:>6}", "n x k", "rows", "int4 us", "int8 us", "ratio", "GB/s");
    for (n, k) in SHAPES {
        let weights = Weights::new(n, k);
        for m in ROWS {
            weights.time(isa, m, seconds);
        }
    }
}

/// Copies of one weight matrix in both formats.
struct Weights {
    n: usize,
    k: usize,
    copies: usize,
    int4: Vec<u8>,
    int8: Vec<i8>,
    sum: Vec<i32>,
}

impl Weights {
    fn new(n: usize, k: usize) -> Self {
        let groups = k.div_ceil(GROUP);
        let number = |i: usize| i8::try_from((i.wrapping_mul(2_654_435_761) >> 9) % 16).unwrap_or(0) - 8;
        let multiplier = |i: usize| number(i).unsigned_abs().cast_signed() + 1;
        let (mut one, mut values) = (vec![0; packed_len_i4(n, k)], vec![0; n * k]);
        for o in 0..n {
            let codes: Vec<i8> = (0..k).map(|i| number(o * k + i)).collect();
            let multipliers: Vec<i8> = (0..groups).map(|g| multiplier(o * groups + g)).collect();
            let panel = packed_len_i4(1, k);
            pack_row_i4(&codes, &multipliers, o % PANEL, &mut one[o / PANEL * panel..][..panel]).expect("a row");
            for (i, value) in values[o * k..][..k].iter_mut().enumerate() {
                *value = codes[i] * multipliers[i / GROUP];
            }
        }
        let (mut other, mut sum) = (vec![0; packed_len_i8(n, k)], vec![0; n]);
        pack_i8(Mat::new(&values, n, k).expect("a matrix"), &mut other, &mut sum).expect("a panel");
        let copies = COLD_BYTES / other.len();
        Self { n, k, copies, int4: one.repeat(copies), int8: other.repeat(copies), sum }
    }

    fn time(&self, isa: Isa, m: usize, seconds: f64) {
        let &Self { n, k, copies, .. } = self;
        let x: Vec<i8> = (0..m * k).map(|i| i8::try_from(i * 31 % 251).unwrap_or(-90)).collect();
        let (x_scale, w_scale) = (vec![0.02; m], vec![0.01; n]);
        let rows = QuantRows::new(Mat::new(&x, m, k).expect("rows"), &x_scale).expect("scales");
        let mut y = [vec![0.0; m * n], vec![0.0; m * n]];
        let (len4, len8) = (packed_len_i4(n, k), packed_len_i8(n, k));
        let mut run = |copy: usize, int4: bool| {
            let y = MatMut::new(&mut y[usize::from(int4)], m, n).expect("outputs");
            let start = Instant::now();
            if int4 {
                let w = PackedI4::new(&self.int4[copy * len4..][..len4], &w_scale, n, k).expect("weights");
                matmul_i4(isa, rows, None, w, Epilogue::STORE, y).expect("shapes");
            } else {
                let w = PackedI8::new(&self.int8[copy * len8..][..len8], &w_scale, &self.sum, n, k).expect("weights");
                matmul_i8(isa, rows, None, w, Epilogue::STORE, y).expect("shapes");
            }
            start.elapsed().as_secs_f64()
        };
        let (mut times, start) = ([vec![], vec![]], Instant::now());
        let mut copy = 0;
        while start.elapsed().as_secs_f64() < seconds || times[0].len() < 5 {
            copy = (copy + 1) % copies;
            for (times, int4) in times.iter_mut().zip([true, false]) {
                times.push(run(copy, int4));
            }
        }
        let [int4, int8] = times.map(|mut times| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        });
        assert!(black_box(&y[0]) == black_box(&y[1]), "both products have the same bits");
        let (a, b, rate) = (int4 * 1e6, int8 * 1e6, len4 as f64 / int4 / 1e9);
        println!("{:>11} {m:>4} {a:>9.1} {b:>9.1} {:>6.2} {rate:>6.1}", format!("{n}x{k}"), int4 / int8);
    }
}
