//! Times int8 and f32 products against Intel MKL's packed ones (if `UMO_MKL` names its
//! `libmkl_rt.so`) and against the crates `gemm`, `faer` and `matrixmultiply`.
//!
//! Usage: `products ISA THREADS [SECONDS [FILTER]]`: seconds per contestant and shape, and part of
//! a name such as `int8 2048 x 768, 64 rows`. `MATMUL_NUM_THREADS` must agree with the threads.
//! Every line is `name,peer,threads,ours,peer's,floor` in milliseconds, medians. Calls cycle through
//! 32 MiB of weights, far more than L2.
//!
//! Sides take turns of about ten milliseconds with a pause between them, in which the other side's
//! threads become idle (`KMP_BLOCKTIME` must be shorter); the first calls of a turn, which wake
//! them, do not count. Inputs and outputs of all sides start at a cache line, as the engine's do:
//! otherwise every store of ours would touch two lines.

mod mkl;

use std::hint::black_box;
use std::time::{Duration, Instant};

use mkl::{Mkl, Shape};
use umo_benches::Random;
use umo_core_model::weights::AlignedBox;
use umo_core::Team;
use umo_core_tools::floor;
use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_f32::matmul_f32;
use umo_kernels::matmul_i8::matmul_i8;
use umo_kernels::pack::{pack, pack_i8, packed_len, packed_len_i8, panels};
use umo_kernels::quantize::QuantRows;
use umo_kernels::{Isa, Mat, MatMut, PANEL, PackedF32, PackedI8, PrefetchHint, peak};

const WEIGHT_BYTES: usize = 32 << 20;
const SHAPES: [(usize, usize); 4] = [(2048, 768), (768, 2048), (768, 768), (3072, 768)];
const ROWS: [usize; 6] = [1, 4, 16, 64, 128, 256];
/// Panels of the next weights that a waiting thread prefetches, as in the engine.
const AHEAD: usize = 8;
/// Number of rows up to which products are memory bound, and the name of their floor.
const FEW_ROWS: usize = 4;
const READING: &str = "reading as many bytes";
const TURN: f64 = 0.01;
const REST: Duration = Duration::from_millis(4);
const OK: &str = "shapes agree";

/// Settings of the measurements of both kinds of product.
struct Bench {
    isa: Isa,
    team: Team,
    mkl: Option<Mkl>,
    seconds: f64,
    filter: String,
    /// Multiply-adds per second of int8 and f32.
    peaks: [f64; 2],
    /// The fastest order of reading, and its bytes per second over as much memory as the weights take.
    read: (peak::Order, f64),
}

/// One side: its name, and one product with the given copy of the weights.
type Side<'a> = (&'static str, Box<dyn FnMut(usize) + 'a>);

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let isa = args.first().and_then(|name| Isa::from_name(name)).expect("a back-end that this processor has");
    let threads = args.get(1).and_then(|n| n.parse().ok()).expect("a number of threads");
    let bench = Bench {
        isa,
        team: Team::new(threads).expect("threads can be started"),
        mkl: Mkl::open(threads),
        seconds: args.get(2).map_or(0.05, |s| s.parse().expect("seconds")),
        filter: args.get(3).cloned().unwrap_or_default(),
        peaks: [floor::int8, floor::f32].map(|peak| peak(threads, isa).unwrap_or(f64::INFINITY)),
        read: floor::faster_order(threads, isa, WEIGHT_BYTES),
    };
    eprintln!(
        "peaks of {threads} threads with {}: int8 {:.0} GMAC/s, f32 {:.0}, reading {} MiB {:.1} GB/s",
        isa.name(),
        bench.peaks[0] / 1e9,
        bench.peaks[1] / 1e9,
        WEIGHT_BYTES >> 20,
        bench.read.1 / 1e9
    );
    for (n, k) in SHAPES {
        for m in ROWS {
            let shape = Shape { m, n, k };
            bench.int8(shape);
            bench.f32(shape);
        }
    }
}

impl Bench {
    /// The product's name, if the filter accepts it.
    fn name(&self, kind: &str, Shape { m, n, k }: Shape) -> Option<String> {
        let name = format!("{kind} {n} x {k}; {m} rows; {}", self.isa.name());
        name.contains(&self.filter).then_some(name)
    }

    fn int8(&self, shape: Shape) {
        let Some(name) = self.name("int8", shape) else { return };
        let Shape { m, n, k } = shape;
        let mut random = Random::new(7);
        let w: Vec<i8> = (0..n * k).map(|_| random.int8()).collect();
        let x: Vec<i8> = (0..m * k).map(|_| random.int8()).collect();
        let raised: Vec<u8> = x.iter().map(|x| x.cast_unsigned() ^ 0x80).collect();
        let (x, raised) = (Lined::new(&x), Lined::new(&raised));
        let len = packed_len_i8(n, k);
        let copies = WEIGHT_BYTES / len;
        let (mut packed, mut sum) = (AlignedBox::<i8>::zeroed(len * copies), vec![0; n]);
        for copy in packed.chunks_exact_mut(len) {
            pack_i8(Mat::new(&w, n, k).expect(OK), copy, &mut sum).expect(OK);
        }
        let (w_scale, x_scale) = (vec![0.01; n], vec![0.02; m]);
        let rows = QuantRows::new(Mat::new(&x, m, k).expect(OK), &x_scale).expect(OK);
        let product = |isa, team: &Team, copy: usize, y: &mut [f32]| {
            let w = PackedI8::new(&packed[copy * len..][..len], &w_scale, &sum, n, k).expect(OK);
            let y = MatMut::new(y, m, n).expect(OK);
            let part = |outputs, y| Ok(matmul_i8(isa, rows, None, w.outputs(outputs), Epilogue::STORE, y)?);
            // Names the next weights, as the engine's layers do.
            let next = &packed[(copy + 1) % copies * len..][..len];
            team.prefetch_next(n, PANEL, |outputs| {
                let panel = len / panels(n);
                let first = &next[outputs.start / PANEL * panel..][..panel * AHEAD.min(outputs.len().div_ceil(PANEL))];
                let (left, right) = first.split_at(first.len() / 2);
                PrefetchHint::new(left, right).tuned_for(isa)
            });
            team.columns(y, PANEL, m * n * k, part).expect(OK);
        };
        let alone = Team::new(1).expect("no thread is started");
        let (mut want, mut y) = (vec![0.0; m * n], Lined::zeroed(m * n));
        product(Isa::SCALAR, &alone, 0, &mut want);
        product(self.isa, &self.team, 0, &mut y);
        assert!(y.iter().zip(&want).all(|(y, want)| y.to_bits() == want.to_bits()), "{name}: ours is wrong");
        let weights = self.mkl.as_ref().map(|mkl| (mkl, mkl.pack_i8(shape, &w, copies)));
        let mut sums = Lined::zeroed(m * n);
        let mut sides: Vec<Side> = vec![("umo", Box::new(|copy| product(self.isa, &self.team, copy, &mut y)))];
        if let Some((mkl, weights)) = &weights {
            mkl.compute_i8(weights, 0, &raised, &mut sums);
            for (i, (&got, &want)) in sums.iter().zip(&want).enumerate() {
                // Exact: sums are far below 2^24.
                let got = (got - 128 * sum[i % n]) as f32 * (0.02_f32 * 0.01);
                assert!(got == want, "{name}: MKL says {got}, not {want}");
            }
            sides.push(("MKL", Box::new(|copy| mkl.compute_i8(weights, copy, &raised, &mut sums))));
        }
        if m <= FEW_ROWS {
            sides.push((READING, Box::new(|copy| self.read_all(&packed[copy * len..][..len]))));
        }
        self.race(&name, shape, n * k, self.peaks[0], &mut sides, copies);
    }

    /// Reads every byte once, divided among the threads.
    fn read_all(&self, bytes: &[i8]) {
        let share = bytes.len().div_ceil(self.team.threads());
        self.team.run(&|thread| {
            let end = bytes.len().min((thread + 1) * share);
            peak::read(self.isa, self.read.0, &bytes[end.min(thread * share)..end]);
        });
    }

    fn f32(&self, shape: Shape) {
        let Some(name) = self.name("f32", shape) else { return };
        let Shape { m, n, k } = shape;
        let mut random = Random::new(7);
        let w: Vec<f32> = (0..n * k).map(|_| random.unit()).collect();
        let x: Vec<f32> = (0..m * k).map(|_| random.unit()).collect();
        let x = Lined::new(&x);
        let len = packed_len(n, k);
        let copies = WEIGHT_BYTES / 4 / len;
        let mut packed = AlignedBox::<f32>::zeroed(len * copies);
        for copy in packed.chunks_exact_mut(len) {
            pack(Mat::new(&w, n, k).expect(OK), copy).expect(OK);
        }
        let mut plain = AlignedBox::<f32>::zeroed(n * k * copies);
        plain.chunks_exact_mut(n * k).for_each(|copy| copy.copy_from_slice(&w));
        let rows = Input::all(Mat::new(&x, m, k).expect(OK));
        let product = |isa, team: &Team, copy: usize, y: &mut [f32]| {
            let w = PackedF32::new(&packed[copy * len..][..len], n, k).expect(OK);
            let y = MatMut::new(y, m, n).expect(OK);
            let part = |outputs, y| Ok(matmul_f32(isa, rows, w.outputs(outputs), Epilogue::STORE, y)?);
            team.columns(y, PANEL, m * n * k, part).expect(OK);
        };
        let alone = Team::new(1).expect("no thread is started");
        let mut want = vec![0.0; m * n];
        product(Isa::SCALAR, &alone, 0, &mut want);
        let weights = self.mkl.as_ref().map(|mkl| (mkl, mkl.pack_f32(shape, &w, copies)));
        let plain = |copy: usize| &plain[copy * n * k..][..n * k];
        let threads = self.team.threads();
        let mut ys = [(); 5].map(|()| Lined::zeroed(m * n));
        let mut outputs = ys.iter_mut();
        let mut y = || outputs.next().expect("one for every side");
        let (ours, mkls, gemms, faers, matrixmultiplys) = (y(), y(), y(), y(), y());
        let mut sides: Vec<Side> = vec![
            ("umo", Box::new(|copy| product(self.isa, &self.team, copy, ours))),
            ("gemm crate", Box::new(|copy| gemm_crate(shape, threads, &x, plain(copy), gemms))),
            ("faer", Box::new(|copy| faer_crate(shape, threads, &x, plain(copy), faers))),
            ("matrixmultiply", Box::new(|copy| matrixmultiply_crate(shape, &x, plain(copy), matrixmultiplys))),
        ];
        if let Some((mkl, weights)) = &weights {
            sides.push(("MKL", Box::new(|copy| mkl.compute_f32(weights, copy, &x, mkls))));
        }
        let names: Vec<_> = sides.iter().map(|(name, _)| *name).collect();
        sides.iter_mut().for_each(|(_, call)| call(0));
        self.race(&name, shape, 4 * n * k, self.peaks[1], &mut sides, copies);
        drop(sides);
        // In the order of the measurements above.
        for (side, y) in ["umo", "MKL", "gemm crate", "faer", "matrixmultiply"].iter().zip(&ys) {
            let off = y.iter().zip(&want).map(|(y, want)| (y - want).abs()).fold(0.0, f32::max);
            assert!(off < 1e-3 || !names.contains(side), "{name}: {side} is off by {off}");
        }
    }

    /// Times all sides alternately, and prints the others beside the first.
    fn race(&self, name: &str, shape: Shape, bytes: usize, peak: f64, sides: &mut [Side], copies: usize) {
        let mut times = vec![Vec::new(); sides.len()];
        let mut copy = 0;
        for _ in 0..(self.seconds / TURN).ceil().max(1.0) as usize {
            for ((_, call), times) in sides.iter_mut().zip(&mut times) {
                std::thread::sleep(REST);
                let mut product = || {
                    copy = (copy + 1) % copies;
                    call(black_box(copy));
                };
                (0..2).for_each(|_| product());
                let turn = Instant::now();
                while turn.elapsed().as_secs_f64() < TURN {
                    let start = Instant::now();
                    product();
                    times.push(1e3 * start.elapsed().as_secs_f64());
                }
            }
        }
        let medians: Vec<f64> = times
            .iter_mut()
            .map(|times| {
                times.sort_by(f64::total_cmp);
                times[times.len() / 2]
            })
            .collect();
        let macs = (shape.m * shape.n * shape.k) as f64;
        let floor = 1e3 * (macs / peak).max(bytes as f64 / self.read.1);
        for ((peer, _), theirs) in sides.iter().zip(&medians).skip(1) {
            println!("{name},{peer},{},{:.5},{theirs:.5},{floor:.5}", self.team.threads(), medians[0]);
        }
    }
}

/// An array that starts at a cache line.
struct Lined<T> {
    data: Vec<T>,
    skip: usize,
}

impl<T: Copy + Default> Lined<T> {
    fn new(values: &[T]) -> Self {
        let line = 64 / size_of::<T>();
        let mut data = vec![T::default(); values.len() + line];
        let skip = data.as_ptr().align_offset(64).min(line);
        data.truncate(skip + values.len());
        data[skip..].copy_from_slice(values);
        Self { data, skip }
    }

    fn zeroed(len: usize) -> Self {
        Self::new(&vec![T::default(); len])
    }
}

impl<T> std::ops::Deref for Lined<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.data[self.skip..]
    }
}

impl<T> std::ops::DerefMut for Lined<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.data[self.skip..]
    }
}

fn gemm_crate(Shape { m, n, k }: Shape, threads: usize, x: &[f32], w: &[f32], y: &mut [f32]) {
    let parallelism = if threads == 1 { gemm::Parallelism::None } else { gemm::Parallelism::Rayon(threads) };
    assert!(x.len() == m * k && w.len() == n * k && y.len() == m * n);
    let (n_stride, k_stride) = (n.cast_signed(), k.cast_signed());
    let (x, w, y) = (x.as_ptr(), w.as_ptr(), y.as_mut_ptr());
    // SAFETY: the three matrices have the given sizes by the assertion.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            y,
            1,
            n_stride,
            false,
            x,
            1,
            k_stride,
            w,
            k_stride,
            1,
            0.0,
            1.0,
            false,
            false,
            false,
            parallelism,
        );
    }
}

fn faer_crate(Shape { m, n, k }: Shape, threads: usize, x: &[f32], w: &[f32], y: &mut [f32]) {
    use faer::{Accum, MatMut, MatRef, Par};
    let parallelism = if threads == 1 { Par::Seq } else { Par::rayon(threads) };
    let y = MatMut::from_row_major_slice_mut(y, m, n);
    let (x, w) = (MatRef::from_row_major_slice(x, m, k), MatRef::from_row_major_slice(w, n, k));
    faer::linalg::matmul::matmul(y, Accum::Replace, x, w.transpose(), 1.0, parallelism);
}

fn matrixmultiply_crate(Shape { m, n, k }: Shape, x: &[f32], w: &[f32], y: &mut [f32]) {
    assert!(x.len() == m * k && w.len() == n * k && y.len() == m * n);
    let (n_stride, k_stride) = (n.cast_signed(), k.cast_signed());
    let (x, w, y) = (x.as_ptr(), w.as_ptr(), y.as_mut_ptr());
    // SAFETY: the three matrices have the given sizes by the assertion.
    unsafe { matrixmultiply::sgemm(m, k, n, 1.0, x, k_stride, 1, w, 1, k_stride, 0.0, y, n_stride, 1) };
}
