//! Peaks with AVX2.

use super::{FAR_WHOLE, Order, STREAM, STREAMS, TURNS, prefetch_offset};
use crate::isa::{Avx2, entry};
use crate::prefetch;
use core::arch::asm;
use core::arch::x86_64::{
    __m256i, _mm256_add_epi32, _mm256_fmadd_ps, _mm256_loadu_si256, _mm256_set1_ps, _mm256_setzero_ps,
    _mm256_setzero_si256,
};
use core::hint::black_box;
use umo_kernels_features::avx2;

/// Independent sums: with two operands they leave two of 16 registers.
pub(super) const SUMS: usize = 12;

entry! {
    /// `vpmaddwd` and an addition, the cost of an exact product of widened bytes. In
    /// assembly, as the compiler would merge the equal products.
    pub(super) fn int8(_token: Avx2, rounds: usize) -> Option<usize> {
        if rounds == 0 {
            return Some(0);
        }
        // SAFETY: this function enables AVX2, and only named registers are touched;
        // `rounds` is at least 1.
        unsafe {
            asm!(
                "2:",
                "vpmaddwd ymm6, ymm12, ymm13", "vpaddd ymm0, ymm0, ymm6",
                "vpmaddwd ymm7, ymm12, ymm13", "vpaddd ymm1, ymm1, ymm7",
                "vpmaddwd ymm8, ymm12, ymm13", "vpaddd ymm2, ymm2, ymm8",
                "vpmaddwd ymm9, ymm12, ymm13", "vpaddd ymm3, ymm3, ymm9",
                "vpmaddwd ymm10, ymm12, ymm13", "vpaddd ymm4, ymm4, ymm10",
                "vpmaddwd ymm11, ymm12, ymm13", "vpaddd ymm5, ymm5, ymm11",
                "dec {rounds}",
                "jnz 2b",
                rounds = inout(reg) rounds => _,
                out("ymm0") _, out("ymm1") _, out("ymm2") _, out("ymm3") _, out("ymm4") _, out("ymm5") _, out("ymm6") _,
                out("ymm7") _, out("ymm8") _, out("ymm9") _, out("ymm10") _, out("ymm11") _,
                options(nostack, nomem),
            );
        }
        Some(rounds * 6 * 16)
    }

    pub(super) fn f32(_token: Avx2, rounds: usize) -> Option<usize> {
        let (x, w) = (_mm256_set1_ps(black_box(1.0)), _mm256_set1_ps(black_box(0.5)));
        let mut sums = [_mm256_setzero_ps(); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm256_fmadd_ps(x, w, *sum);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 8)
    }

    pub(super) fn read(_token: Avx2, order: Order, bytes: &[i8]) {
        match order {
            Order::Streams => read_streams(bytes),
            Order::Whole => read_whole(bytes),
        }
    }
}

#[avx2]
fn read_whole(bytes: &[i8]) {
    let mut sums = [_mm256_setzero_si256(); TURNS];
    let (turns, rest) = bytes.as_chunks::<{ TURNS * 32 }>();
    for turn in turns {
        for (sum, part) in sums.iter_mut().zip(turn.as_chunks().0) {
            prefetch::to_l1(part.as_ptr().wrapping_add(FAR_WHOLE));
            *sum = _mm256_add_epi32(*sum, load(part));
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[avx2]
fn read_streams(bytes: &[i8]) {
    let mut sums = [_mm256_setzero_si256(); STREAMS];
    let (chunks, rest) = bytes.as_chunks::<{ STREAMS * STREAM }>();
    for chunk in chunks {
        let (streams, _) = chunk.as_chunks::<STREAM>();
        for i in (0..STREAM).step_by(32) {
            for (sum, stream) in sums.iter_mut().zip(streams) {
                if i % 64 == 0 {
                    prefetch::to_l2(stream.as_ptr().wrapping_add(prefetch_offset(i)));
                }
                *sum = _mm256_add_epi32(*sum, load(stream[i..].first_chunk().expect("whole registers")));
            }
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[avx2]
fn load(line: &[i8; 32]) -> __m256i {
    // SAFETY: `line` is 32 readable bytes; the load needs no alignment.
    unsafe { _mm256_loadu_si256(line.as_ptr().cast()) }
}
