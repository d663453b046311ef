//! Times every product against the limits of the processor, after checking parity. Also times Intel MKL if `UMO_MKL` is
//! the path of its `libmkl_rt.so`. Usage: `peak [seconds per figure] [filter]`.
//!
//! Each line is one operation, back-end and shape: median and best microseconds, GMAC/s, GB/s of weights read, and the
//! share of the floor, which is the greater of the time for arithmetic from registers and the time for reading the same
//! bytes from the same place. `hot` uses one weight matrix repeatedly; `cold` cycles through 32 MiB of them, far beyond
//! L2. For one row the gated product cycles through the same matrices between the plain products, so some of its reads
//! may still be cached: `benches/peers/products` times one row in isolation.

#![expect(clippy::cast_possible_truncation, reason = "sizes are small, and random bytes are cut from wider numbers")]
#![expect(clippy::missing_transmute_annotations, reason = "the fields that the symbols go to carry the signatures")]

use std::hint::black_box;
use std::time::Instant;
use umo_kernels::gemm::{Epilogue, Input};
use umo_kernels::matmul_bf16::matmul_bf16;
use umo_kernels::matmul_f32::{matmul_f32, matmul_gated_f32};
use umo_kernels::matmul_i8::{matmul_gated_i8, matmul_i8};
use umo_kernels::pack::{pack, pack_bf16, pack_i8, packed_len, packed_len_bf16, packed_len_i8};
use umo_kernels::quantize::QuantRows;
use umo_kernels::{Bf16, Isa, Mat, MatMut, PackedBf16, PackedF32, PackedI8, peak};

/// Total bytes of weights that are cycled through in the cold figures.
const COLD_BYTES: usize = 32 << 20;

/// Memory on huge pages if available.
struct Huge<T> {
    data: *mut T,
    len: usize,
}

impl<T: Copy> Huge<T> {
    fn new(len: usize) -> Self {
        let bytes = (len * size_of::<T>()).next_multiple_of(2 << 20);
        // SAFETY: an anonymous mapping of at least `len` elements has no precondition.
        let data = unsafe {
            libc::mmap(
                std::ptr::null_mut(),
                bytes,
                libc::PROT_READ | libc::PROT_WRITE,
                libc::MAP_PRIVATE | libc::MAP_ANONYMOUS,
                -1,
                0,
            )
        };
        assert!(data != libc::MAP_FAILED, "no memory");
        // SAFETY: advice on our own mapping of this length.
        unsafe { libc::madvise(data, bytes, libc::MADV_HUGEPAGE) };
        Self { data: data.cast(), len }
    }

    fn get(&mut self) -> &mut [T] {
        // SAFETY: the mapping holds `len` zeroed elements, of types for which zero bytes are a valid value.
        unsafe { std::slice::from_raw_parts_mut(self.data, self.len) }
    }
}

/// Pseudo-random numbers.
fn numbers(seed: u64) -> impl FnMut() -> u64 {
    let mut state = seed;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    }
}

/// Intel MKL's packed int8 product and its single-precision one.
struct Mkl {
    size: unsafe extern "C" fn(i32, i32, i32, i32) -> usize,
    pack: unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, *const i8, i32, *mut u8),
    compute: unsafe extern "C" fn(
        i32,
        i32,
        i32,
        i32,
        i32,
        i32,
        i32,
        f32,
        *const u8,
        i32,
        i8,
        *const u8,
        i32,
        i8,
        f32,
        *mut i32,
        i32,
        *const i32,
    ),
    sgemm:
        unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, f32, *const f32, i32, *const f32, i32, f32, *mut f32, i32),
    sgemm_size: unsafe extern "C" fn(i32, i32, i32, i32) -> usize,
    sgemm_pack: unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, f32, *const f32, i32, *mut f32),
    sgemm_compute:
        unsafe extern "C" fn(i32, i32, i32, i32, i32, i32, *const f32, i32, *const f32, i32, f32, *mut f32, i32),
}

const COL: i32 = 102;
const NO_TRANS: i32 = 111;
const TRANS: i32 = 112;
const PACKED: i32 = 151;
const A_MATRIX: i32 = 161;
const FIX_OFFSET: i32 = 173;

impl Mkl {
    fn open(threads: i32) -> Option<Self> {
        let path = std::ffi::CString::new(std::env::var("UMO_MKL").ok()?).ok()?;
        // SAFETY: `path` is a C string; the library's initialisers are Intel's.
        let library = unsafe { libc::dlopen(path.as_ptr(), libc::RTLD_NOW | libc::RTLD_GLOBAL) };
        assert!(!library.is_null(), "cannot load {path:?}");
        let symbol = |name: &std::ffi::CStr| {
            // SAFETY: `library` is open; `name` is a C string.
            let symbol = unsafe { libc::dlsym(library, name.as_ptr()) };
            assert!(!symbol.is_null(), "no {name:?}");
            symbol
        };
        // SAFETY: `void MKL_Set_Num_Threads(int)`.
        let set: unsafe extern "C" fn(i32) = unsafe { std::mem::transmute(symbol(c"MKL_Set_Num_Threads")) };
        // SAFETY: any number of threads may be asked for.
        unsafe { set(threads) };
        macro_rules! function {
            ($name:literal) => {
                // SAFETY: the field's signature is that of mkl_cblas.h with 32-bit integers.
                unsafe { std::mem::transmute(symbol($name)) }
            };
        }
        Some(Self {
            size: function!(c"cblas_gemm_s8u8s32_pack_get_size"),
            pack: function!(c"cblas_gemm_s8u8s32_pack"),
            compute: function!(c"cblas_gemm_s8u8s32_compute"),
            sgemm: function!(c"cblas_sgemm"),
            sgemm_size: function!(c"cblas_sgemm_pack_get_size"),
            sgemm_pack: function!(c"cblas_sgemm_pack"),
            sgemm_compute: function!(c"cblas_sgemm_compute"),
        })
    }
}

/// Times several functions, alternating: median and best microseconds of each.
fn race(seconds: f64, runs: &mut [Box<dyn FnMut() + '_>]) -> Vec<(f64, f64)> {
    let mut times = vec![Vec::new(); runs.len()];
    // One sample is several calls, so that the clock's overhead is negligible.
    let calls: Vec<usize> = runs
        .iter_mut()
        .map(|run| {
            run();
            let start = Instant::now();
            run();
            (30e-6 / start.elapsed().as_secs_f64()).ceil().max(1.0) as usize
        })
        .collect();
    let start = Instant::now();
    while start.elapsed().as_secs_f64() < seconds * runs.len() as f64 {
        for ((run, times), &calls) in runs.iter_mut().zip(&mut times).zip(&calls) {
            let start = Instant::now();
            (0..calls).for_each(|_| run());
            times.push(start.elapsed().as_secs_f64() * 1e6 / calls as f64);
        }
    }
    times
        .into_iter()
        .map(|mut times| {
            times.sort_by(f64::total_cmp);
            (times[times.len() / 2], times[0])
        })
        .collect()
}

struct Floors {
    int8: f64,
    f32: f64,
    cold: f64,
}

/// Peaks with AVX-512 if the processor has it, so that shares are comparable between back-ends.
fn floors(memory: &mut Huge<u8>) -> Floors {
    let best = |f: &mut dyn FnMut() -> usize| {
        (0..50)
            .map(|_| {
                let start = Instant::now();
                let work = f();
                work as f64 / start.elapsed().as_secs_f64() / 1e9
            })
            .fold(0.0, f64::max)
    };
    let isa = Isa::from_name("avx512vnni").unwrap_or(Isa::detect());
    let bytes = memory.get();
    // SAFETY: `u8` and `i8` have the same layout.
    let bytes = unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast::<i8>(), bytes.len()) };
    let (mut at, piece) = (0, 2 << 20);
    let known = "the portable back-end has no peak";
    let int8 = best(&mut || peak::int8(isa, 20_000).expect(known));
    let f32 = best(&mut || peak::f32(isa, 20_000).expect(known));
    let [streams, whole] = peak::Order::ALL.map(|order| {
        best(&mut || {
            at = (at + piece) % bytes.len();
            peak::read(isa, order, &bytes[at..at + piece]);
            piece
        })
    });
    let cold = streams.max(whole);
    Floors { int8, f32, cold }
}

/// Alignment in bytes of int8 inputs and outputs, as in the engine.
const LINE: usize = 64;

/// The part of `y` from its first cache line on.
fn line(y: &mut [f32]) -> &mut [f32] {
    let skip = y.as_ptr().align_offset(LINE);
    &mut y[skip..]
}

fn main() {
    let mut args = std::env::args().skip(1);
    let seconds: f64 = args.next().map_or(0.15, |s| s.parse().expect("seconds"));
    let filter = args.next().unwrap_or_default();
    let mkl = Mkl::open(1);
    let mut memory = Huge::<u8>::new(COLD_BYTES);
    let mut random = numbers(42);
    memory.get().iter_mut().for_each(|b| *b = (random() >> 32) as u8);
    let floors = floors(&mut memory);
    println!(
        "registers: int8 {:.0} GMAC/s, f32 {:.0} GMAC/s; reading {} MiB {:.1} GB/s",
        floors.int8,
        floors.f32,
        COLD_BYTES >> 20,
        floors.cold
    );
    for (n, k) in [(2048, 768), (768, 2048), (768, 768), (3072, 768), (768, 3072), (777, 779)] {
        for m in [1, 2, 4, 8, 16, 32, 64, 128, 256, 500] {
            let wants = |op: &str| format!("{op}/{n}x{k}/{m}/").contains(&filter) || filter.is_empty();
            for cold in [true, false] {
                let case = Case { n, k, m, cold, seconds };
                if wants("i8") {
                    int8(case, &floors, mkl.as_ref(), &mut memory);
                }
                if wants("f32") {
                    float(case, &floors, mkl.as_ref());
                }
            }
        }
    }
}

/// Back-ends to time: the one named by `UMO_ISA`, or else all except scalar.
fn timed() -> impl Iterator<Item = Isa> {
    let one = std::env::var("UMO_ISA").ok();
    Isa::available().skip(1).filter(move |isa| one.as_deref().is_none_or(|one| one == isa.name()))
}

/// Index of the copy of the weights at which a contestant starts, far from those that the others have just read.
fn start(contestant: usize, copies: usize) -> usize {
    contestant * copies / 8 % copies
}

struct Line<'a> {
    op: &'a str,
    isa: &'a str,
    shape: (usize, usize, usize),
    cold: bool,
    bytes: f64,
    peak: f64,
    read: f64,
}

impl Line<'_> {
    fn print(&self, (median, best): (f64, f64)) {
        let (n, k, m) = self.shape;
        let macs = (m * n * k) as f64;
        let floor = (macs / self.peak / 1e3).max(if self.cold { self.bytes / self.read / 1e3 } else { 0.0 });
        println!(
            "{:<10} {:<14} {:<9} m={m:<4} {} {median:9.1} us (best {best:9.1}) {:6.0} GMAC/s {:5.1} GB/s  {:3.0} %",
            self.op,
            self.isa,
            format!("{n}x{k}"),
            if self.cold { "cold" } else { "hot " },
            macs / median / 1e3,
            self.bytes / median / 1e3,
            100.0 * floor / median,
        );
    }
}

/// A product to time.
#[derive(Clone, Copy)]
struct Case {
    n: usize,
    k: usize,
    m: usize,
    /// Weights come from memory, not from a cache.
    cold: bool,
    /// Duration of each contestant's runs.
    seconds: f64,
}

fn int8(case: Case, floors: &Floors, mkl: Option<&Mkl>, memory: &mut Huge<u8>) {
    let Case { n, k, m, cold, seconds } = case;
    let len = packed_len_i8(n, k).next_multiple_of(64);
    let copies = if cold { COLD_BYTES / len } else { 1 };
    let mut random = numbers(7);
    let w: Vec<i8> = (0..n * k).map(|_| (random() >> 32) as i8).collect();
    let x: Vec<i8> = (0..m * k + LINE).map(|_| (random() >> 32) as i8).collect();
    let x = &x[x.as_ptr().align_offset(LINE)..][..m * k];
    let mut sum = vec![0; n];
    let mut packed = vec![0; packed_len_i8(n, k)];
    pack_i8(Mat::new(&w, n, k).unwrap(), &mut packed, &mut sum).unwrap();
    let bytes = memory.get();
    for copy in 0..copies {
        for (to, from) in bytes[copy * len..].iter_mut().zip(&packed) {
            *to = *from as u8;
        }
    }
    // SAFETY: `u8` and `i8` have the same layout.
    let all = unsafe { std::slice::from_raw_parts(bytes.as_ptr().cast::<i8>(), bytes.len()) };
    let w_scale = vec![0.01; n];
    let x_scale = vec![0.02; m];
    let rows = QuantRows::new(Mat::new(x, m, k).unwrap(), &x_scale).unwrap();
    let view = |copy: usize| PackedI8::new(&all[copy * len..][..packed_len_i8(n, k)], &w_scale, &sum, n, k).unwrap();
    let product = |isa, copy, y: &mut [f32]| {
        matmul_i8(isa, rows, None, view(copy), Epilogue::STORE, MatMut::new(line(y), m, n).unwrap()).unwrap();
    };
    let mut want = vec![0.0; m * n + LINE];
    product(Isa::SCALAR, 0, &mut want);
    let isas: Vec<Isa> = timed().collect();
    let unsigned: Vec<u8> = x.iter().map(|x| (*x as u8) ^ 0x80).collect();
    let mut mkl_memory = None;
    let mut names = Vec::new();
    let mut runs: Vec<Box<dyn FnMut()>> = Vec::new();
    for &isa in &isas {
        let mut y = vec![0.0; m * n + LINE];
        product(isa, 0, &mut y);
        let (y_line, want) = (&line(&mut y)[..m * n], &line(&mut want)[..m * n]);
        assert!(y_line.iter().zip(want).all(|(y, want)| y.to_bits() == want.to_bits()), "{} is wrong", isa.name());
        let mut copy = start(runs.len(), copies);
        let product = &product;
        names.push(("i8", isa.name()));
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            product(isa, copy, &mut y);
            black_box(&mut y);
        }));
    }
    if m == 256 || m == 1 {
        let isa = Isa::detect();
        let mut y = vec![0.0; m * n / 2 / 16 * 16];
        let half = n / 2 / 16 * 16;
        let mut copy = start(runs.len(), copies);
        names.push(("i8 gated/2", isa.name()));
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            let w = view(copy);
            y.resize(m * half, 0.0);
            let (gate, up) = (w.outputs(0..half), w.outputs(half..2 * half));
            matmul_gated_i8(isa, rows, None, gate, up, MatMut::new(&mut y, m, half).unwrap()).unwrap();
            black_box(&mut y);
        }));
    }
    if let Some(mkl) = mkl {
        let (n32, m32, k32) = (n as i32, m as i32, k as i32);
        // SAFETY: a pure query.
        let size = unsafe { (mkl.size)(A_MATRIX, n32, m32, k32) }.next_multiple_of(64);
        // The size that the library requests is far larger than the part it fills.
        let copies = if cold { COLD_BYTES / len } else { 1 };
        let memory = mkl_memory.insert(Huge::<u8>::new(size * copies));
        for copy in memory.get().chunks_exact_mut(size) {
            // SAFETY: `copy` has the size that the library asked for; `w` is `[n, k]`.
            unsafe { (mkl.pack)(COL, A_MATRIX, TRANS, n32, m32, k32, w.as_ptr(), k32, copy.as_mut_ptr()) };
        }
        let mut y = vec![0_i32; m * n];
        let at = memory.get().as_ptr();
        let compute = move |copy: usize, y: &mut [i32], x: &[u8]| {
            let zero = 0;
            // SAFETY: all operands have the sizes named by `n`, `m` and `k`.
            unsafe {
                (mkl.compute)(
                    COL,
                    PACKED,
                    NO_TRANS,
                    FIX_OFFSET,
                    n32,
                    m32,
                    k32,
                    1.0,
                    at.wrapping_add(copy * size),
                    k32,
                    0,
                    x.as_ptr(),
                    k32,
                    0,
                    0.0,
                    y.as_mut_ptr(),
                    n32,
                    &zero,
                );
            }
        };
        compute(0, &mut y, &unsigned);
        for (i, (&y, &want)) in y.iter().zip(&want).enumerate() {
            let value = (y - 128 * sum[i % n]) as f32 * (0.02_f32 * 0.01);
            assert!(value == want, "MKL: {value}, {want}");
        }
        let (mut copy, unsigned) = (0, &unsigned);
        names.push(("i8", "MKL"));
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            compute(copy, &mut y, unsigned);
            black_box(&mut y);
        }));
    }
    let times = race(seconds, &mut runs);
    drop(runs);
    for ((op, isa), time) in names.into_iter().zip(times) {
        let line =
            Line { op, isa, shape: (n, k, m), cold, bytes: (n * k) as f64, peak: floors.int8, read: floors.cold };
        line.print(time);
    }
}

fn float(case: Case, floors: &Floors, mkl: Option<&Mkl>) {
    let Case { n, k, m, cold, seconds } = case;
    let len = packed_len(n, k);
    let len_bf16 = packed_len_bf16(n, k);
    let copies = if cold { COLD_BYTES / 4 / len } else { 1 };
    let mut random = numbers(7);
    let mut real = || (random() >> 40) as f32 / (1 << 23) as f32 - 1.0;
    let w: Vec<f32> = (0..n * k).map(|_| Bf16::from_f32(real()).to_f32()).collect();
    let x: Vec<f32> = (0..m * k).map(|_| real()).collect();
    let mut memory = Huge::<f32>::new(len * copies);
    let mut memory_bf16 = Huge::<Bf16>::new(len_bf16 * copies);
    for copy in memory.get().chunks_exact_mut(len) {
        pack(Mat::new(&w, n, k).unwrap(), copy).unwrap();
    }
    for copy in memory_bf16.get().chunks_exact_mut(len_bf16) {
        pack_bf16(Mat::new(&w, n, k).unwrap(), copy).unwrap();
    }
    let (all, all_bf16) = (&*memory.get(), &*memory_bf16.get());
    let rows = Input::all(Mat::new(&x, m, k).unwrap());
    let view = |copy: usize| PackedF32::new(&all[copy * len..][..len], n, k).unwrap();
    let view_bf16 = |copy: usize| PackedBf16::new(&all_bf16[copy * len_bf16..][..len_bf16], n, k).unwrap();
    let mut want = vec![0.0; m * n];
    matmul_f32(Isa::SCALAR, rows, view(0), Epilogue::STORE, MatMut::new(&mut want, m, n).unwrap()).unwrap();
    let close = |y: &[f32], name: &str| {
        let off = y.iter().zip(&want).map(|(y, want)| (y - want).abs()).fold(0.0, f32::max);
        assert!(off < 1e-3, "{name} is wrong: off by {off}");
    };
    let mut names = Vec::new();
    let mut runs: Vec<Box<dyn FnMut()>> = Vec::new();
    for isa in timed() {
        let mut y = vec![0.0; m * n];
        let mut copy = start(runs.len(), copies);
        names.push(("f32", isa.name(), 4.0));
        matmul_f32(isa, rows, view(0), Epilogue::STORE, MatMut::new(&mut y, m, n).unwrap()).unwrap();
        close(&y, isa.name());
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            matmul_f32(isa, rows, view(copy), Epilogue::STORE, MatMut::new(&mut y, m, n).unwrap()).unwrap();
            black_box(&mut y);
        }));
        let mut y = vec![0.0; m * n];
        let mut copy = start(runs.len(), copies);
        names.push(("bf16", isa.name(), 2.0));
        matmul_bf16(isa, rows, view_bf16(0), Epilogue::STORE, MatMut::new(&mut y, m, n).unwrap()).unwrap();
        close(&y, isa.name());
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            matmul_bf16(isa, rows, view_bf16(copy), Epilogue::STORE, MatMut::new(&mut y, m, n).unwrap()).unwrap();
            black_box(&mut y);
        }));
        if m == 256 {
            let half = n / 2 / 16 * 16;
            let mut y = vec![0.0; m * half];
            let mut copy = start(runs.len(), copies);
            names.push(("f32 gated/2", isa.name(), 4.0));
            runs.push(Box::new(move || {
                copy = (copy + 1) % copies;
                let w = view(copy);
                let (gate, up) = (w.outputs(0..half), w.outputs(half..2 * half));
                matmul_gated_f32(isa, rows, gate, up, MatMut::new(&mut y, m, half).unwrap()).unwrap();
                black_box(&mut y);
            }));
        }
    }
    let (mut plain, mut packed) = (None, None);
    if let Some(mkl) = mkl {
        let (n32, m32, k32) = (n as i32, m as i32, k as i32);
        let memory = plain.insert(Huge::<f32>::new(n * k * copies));
        memory.get().chunks_exact_mut(n * k).for_each(|copy| copy.copy_from_slice(&w));
        let (at, mut copy, x) = (memory.get().as_ptr(), 0, &x);
        let mut y = vec![0.0; m * n];
        let sgemm = move |copy: usize, y: &mut [f32]| {
            // SAFETY: all operands have the sizes named by `n`, `m` and `k`.
            unsafe {
                (mkl.sgemm)(
                    COL,
                    TRANS,
                    NO_TRANS,
                    n32,
                    m32,
                    k32,
                    1.0,
                    at.wrapping_add(copy * n * k),
                    k32,
                    x.as_ptr(),
                    k32,
                    0.0,
                    y.as_mut_ptr(),
                    n32,
                );
            }
        };
        sgemm(0, &mut y);
        close(&y, "MKL");
        names.push(("f32", "MKL", 4.0));
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            sgemm(copy, &mut y);
            black_box(&mut y);
        }));
        // SAFETY: a pure query.
        let size = (unsafe { (mkl.sgemm_size)(A_MATRIX, n32, m32, k32) } / 4).next_multiple_of(16);
        let copies = if cold { COLD_BYTES / 4 / len } else { 1 };
        let memory = packed.insert(Huge::<f32>::new(size * copies));
        for copy in memory.get().chunks_exact_mut(size) {
            // SAFETY: `copy` has the size that the library asked for; `w` is `[n, k]`.
            unsafe { (mkl.sgemm_pack)(COL, A_MATRIX, TRANS, n32, m32, k32, 1.0, w.as_ptr(), k32, copy.as_mut_ptr()) };
        }
        let (at, mut copy) = (memory.get().as_ptr(), 0);
        let mut y = vec![0.0; m * n];
        names.push(("f32", "MKL packed", 4.0));
        runs.push(Box::new(move || {
            copy = (copy + 1) % copies;
            // SAFETY: all operands have the sizes named by `n`, `m` and `k`.
            unsafe {
                (mkl.sgemm_compute)(
                    COL,
                    PACKED,
                    NO_TRANS,
                    n32,
                    m32,
                    k32,
                    at.wrapping_add(copy * size),
                    k32,
                    x.as_ptr(),
                    k32,
                    0.0,
                    y.as_mut_ptr(),
                    n32,
                );
            }
            black_box(&mut y);
        }));
    }
    let times = race(seconds, &mut runs);
    drop(runs);
    for ((op, isa, width), time) in names.into_iter().zip(times) {
        let bytes = (n * k) as f64 * width;
        Line { op, isa, shape: (n, k, m), cold, bytes, peak: floors.f32, read: floors.cold }.print(time);
    }
}
