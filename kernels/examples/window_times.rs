//! Times HuBERT's convolutions as products of overlapping rows, with weights in bfloat16, and inputs rounded to
//! bfloat16 or split into two: microseconds, the fastest of many runs, and GMAC/s, counting the products of both parts.
//! One thread, with the fastest back-end that multiplies such rows faster than f32; by pairs also the rate from
//! registers.

use std::hint::black_box;
use std::time::Instant;

use umo_kernels::activation::Activation;
use umo_kernels::gemm::Epilogue;
use umo_kernels::matmul_bf16::{Bf16Rows, matmul_bf16_rows};
use umo_kernels::pack::{pack_bf16, packed_len_bf16};
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16, peak};

/// Rows, outputs, inputs, and elements from row to row: half a convolution of three steps, half one of two, a group of
/// the positional convolution, and the largest of 3 s of audio.
const SHAPES: [[usize; 4]; 4] =
    [[512, 256, 1536, 1024], [512, 256, 1024, 1024], [149, 48, 6144, 48], [4799, 512, 1536, 1024]];
/// Multiply-adds timed for each.
const WORK: usize = 200_000_000_000;

/// 32 values at the start of a cache line, where the engine's buffers begin.
#[repr(align(64))]
#[derive(Clone, Copy)]
struct Line([Bf16; 32]);

fn lines(values: usize) -> Vec<Line> {
    // 1.0, so that no product is denormal.
    vec![Line([Bf16(0x3f80); 32]); values.div_ceil(32)]
}

fn values(lines: &mut [Line]) -> &mut [Bf16] {
    let len = lines.len() * size_of_val(&lines[0].0) / size_of::<Bf16>();
    // SAFETY: a line is 32 values and nothing else, because its alignment is its size; the borrow is `lines`'.
    unsafe { std::slice::from_raw_parts_mut(lines.as_mut_ptr().cast(), len) }
}

fn fastest(times: usize, mut call: impl FnMut()) -> f64 {
    let time = |_| {
        let start = Instant::now();
        call();
        start.elapsed().as_secs_f64() * 1e6
    };
    (0..times).map(time).fold(f64::INFINITY, f64::min)
}

fn main() {
    let isa = Isa::detect();
    const ROUNDS: usize = 100_000;
    if let Some(macs) = peak::pairs(isa, ROUNDS) {
        let us = fastest(1000, || {
            peak::pairs(isa, black_box(ROUNDS));
        });
        println!("registers/{}: {:.0} GMAC/s", isa.name(), macs as f64 / us / 1e3);
    }
    for [m, n, k, stride] in SHAPES {
        let mut x = [(); 2].map(|()| lines((m - 1) * stride + k));
        let [high, low] = x.each_mut().map(|part| Mat::with_stride(values(part), m, k, stride).expect("sized above"));
        let mut memory = lines(packed_len_bf16(n, k));
        let packed = &mut values(&mut memory)[..packed_len_bf16(n, k)];
        pack_bf16(Mat::new(&vec![0.5; n * k], n, k).expect("sized here"), packed).expect("sized above");
        let w = PackedBf16::new(packed, n, k).expect("sized above");
        let mut y = vec![0.0; m * n];
        let split = Bf16Rows::split(high, low).expect("parts are alike");
        let kinds =
            [("rounded", Bf16Rows::rounded(high), 1, isa.multiplies_bf16()), ("cut in two", split, 2, isa.has_tiles())];
        for (name, rows, parts, _) in kinds.into_iter().filter(|(.., pays)| *pays) {
            for (end, suffix) in [(Epilogue::STORE, ""), (Epilogue::STORE.then(Activation::Gelu), " and GELU")] {
                let us = fastest(WORK / (m * n * k), || {
                    let y = MatMut::new(black_box(&mut y), m, n).expect("sized above");
                    matmul_bf16_rows(isa, rows, w, end, y).expect("shapes agree");
                });
                let rate = (parts * m * n * k) as f64 / us / 1e3;
                println!("{m} x {n} x {k} every {stride}, {name}{suffix}/{}: {us:.1} us, {rate:.0} GMAC/s", isa.name());
            }
        }
    }
}
