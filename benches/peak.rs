//! What the processor can do at most: products from registers, and reading memory.
#![expect(unsafe_code, reason = "vector instructions that were detected first")]

use std::hint::black_box;
use std::time::Instant;

use umo_core::weights::AlignedBox;
use umo_kernels::Isa;

/// Int8 multiply-adds per second of `threads` threads with a back-end's instructions, where they are known here.
pub fn int8(threads: usize, isa: Isa) -> Option<f64> {
    match isa.name() {
        // SAFETY: `Isa` is proof of AVX-512 with VNNI.
        #[cfg(target_arch = "x86_64")]
        "avx512vnni" => Some(best(threads, |_| unsafe { x86_64::int8(50_000) })),
        // SAFETY: `Isa` is proof of tiles.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        "amx" => Some(best(threads, |_| unsafe { x86_64::int8_tiles(5_000) })),
        _ => None,
    }
}

/// Single-precision multiply-adds per second of `threads` threads with a back-end's instructions, where they are known
/// here.
pub fn f32(threads: usize, isa: Isa) -> Option<f64> {
    match isa.name() {
        // SAFETY: `Isa` is proof of AVX-512's foundation.
        #[cfg(target_arch = "x86_64")]
        "avx512vnni" | "amx" => Some(best(threads, |_| unsafe { x86_64::f32(50_000) })),
        _ => None,
    }
}

/// Bytes per second that `threads` threads read together from `bytes` of memory in huge pages.
pub fn read(threads: usize, bytes: usize) -> f64 {
    let mut memory = AlignedBox::<i8>::zeroed(bytes);
    memory.fill(1);
    let share = bytes / threads;
    best(threads, |thread| sum(&memory[thread * share..(thread + 1) * share]))
}

/// The best of many rounds, in which all threads start together: work done per second.
fn best(threads: usize, work: impl Fn(usize) -> usize + Sync) -> f64 {
    let barrier = std::sync::Barrier::new(threads);
    let (work, barrier) = (&work, &barrier);
    let round = |thread: usize| {
        barrier.wait();
        let start = Instant::now();
        let done = work(thread);
        done as f64 / start.elapsed().as_secs_f64()
    };
    let mut best = 0.0_f64;
    for _ in 0..12 {
        let total: f64 = std::thread::scope(|scope| {
            let runs: Vec<_> = (0..threads).map(|thread| scope.spawn(move || round(thread))).collect();
            runs.into_iter().map(|run| run.join().expect("no panics")).sum()
        });
        best = best.max(total);
    }
    best
}

/// Reads every byte once.
fn sum(bytes: &[i8]) -> usize {
    #[cfg(target_arch = "x86_64")]
    if std::is_x86_feature_detected!("avx512f") {
        // SAFETY: AVX-512's foundation was detected.
        unsafe { x86_64::read(bytes) };
        return bytes.len();
    }
    black_box(bytes.iter().fold(0_i8, |sum, &v| sum.wrapping_add(v)));
    bytes.len()
}

#[cfg(target_arch = "x86_64")]
mod x86_64 {
    use std::arch::asm;
    use std::arch::x86_64::{
        _mm512_add_epi32, _mm512_dpbusd_epi32, _mm512_fmadd_ps, _mm512_loadu_si512, _mm512_set1_epi32, _mm512_set1_ps,
        _mm512_setzero_ps, _mm512_setzero_si512,
    };
    use std::hint::black_box;

    /// `vpdpbusd` on 24 independent sums; returns multiply-adds done.
    #[target_feature(enable = "avx512f,avx512vnni")]
    pub(super) fn int8(rounds: usize) -> usize {
        let (x, w) = (_mm512_set1_epi32(black_box(1)), _mm512_set1_epi32(black_box(2)));
        let mut sums = [_mm512_setzero_si512(); 24];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm512_dpbusd_epi32(*sum, x, w);
            }
        }
        black_box(sums);
        rounds * 24 * 64
    }

    /// `vfmadd231ps` on 24 independent sums; returns multiply-adds done.
    #[target_feature(enable = "avx512f")]
    pub(super) fn f32(rounds: usize) -> usize {
        let (x, w) = (_mm512_set1_ps(black_box(1.0)), _mm512_set1_ps(black_box(0.5)));
        let mut sums = [_mm512_setzero_ps(); 24];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm512_fmadd_ps(x, w, *sum);
            }
        }
        black_box(sums);
        rounds * 24 * 16
    }

    /// Tiles of 16 rows of 64 bytes, all eight of them.
    #[repr(C, align(64))]
    struct Tiles {
        palette: u8,
        start_row: u8,
        reserved: [u8; 14],
        row_bytes: [u16; 16],
        rows: [u8; 16],
    }

    /// `tdpbssd` on four independent sums; returns multiply-adds done.
    ///
    /// # Safety
    /// The processor has tiles with int8 products, and the system granted them.
    #[cfg(target_os = "linux")]
    pub(super) unsafe fn int8_tiles(rounds: usize) -> usize {
        let eight = |v: u8| std::array::from_fn(|tile| if tile < 8 { v } else { 0 });
        let rows = eight(16);
        let tiles = Tiles {
            palette: 1,
            start_row: 0,
            reserved: [0; 14],
            row_bytes: rows.map(|rows| u16::from(rows) * 4),
            rows,
        };
        // SAFETY: tiles are there by this function's contract; `tiles` is 64 bytes that describe what palette 1 allows;
        // tiles are used between configuration and release alone, inside this block.
        unsafe {
            asm!(
                "ldtilecfg [{tiles}]",
                "2:",
                "tdpbssd tmm0, tmm4, tmm6",
                "tdpbssd tmm1, tmm4, tmm7",
                "tdpbssd tmm2, tmm5, tmm6",
                "tdpbssd tmm3, tmm5, tmm7",
                "dec {rounds}",
                "jnz 2b",
                "tilerelease",
                tiles = in(reg) &raw const tiles,
                rounds = inout(reg) rounds => _,
                options(nostack, readonly),
            );
        }
        rounds * 4 * 16 * 16 * 64
    }

    #[target_feature(enable = "avx512f")]
    pub(super) fn read(bytes: &[i8]) {
        let mut sums = [_mm512_setzero_si512(); 8];
        for chunk in bytes.as_chunks::<512>().0 {
            for (sum, line) in sums.iter_mut().zip(chunk.as_chunks::<64>().0) {
                // SAFETY: `line` is 64 readable bytes.
                *sum = _mm512_add_epi32(*sum, unsafe { _mm512_loadu_si512(line.as_ptr().cast()) });
            }
        }
        black_box(sums);
    }
}
