//! Peaks with AVX-512.

use super::{FAR_WHOLE, Order, STREAM, STREAMS, TURNS, prefetch_offset};
use crate::isa::{Avx512Vnni, entry};
use crate::prefetch;
use core::arch::x86_64::{
    __m512i, _mm512_add_epi32, _mm512_dpbusd_epi32, _mm512_fmadd_ps, _mm512_loadu_si512, _mm512_set1_epi32,
    _mm512_set1_ps, _mm512_setzero_ps, _mm512_setzero_si512,
};
use core::hint::black_box;
use umo_kernels_features::avx512vnni;

/// Independent sums: far more than an instruction's latency needs, and with two operands fewer than 32
/// registers.
pub(super) const SUMS: usize = 24;

entry! {
    /// `vpdpbusd`.
    pub(super) fn int8(_token: Avx512Vnni, rounds: usize) -> Option<usize> {
        let (x, w) = (_mm512_set1_epi32(black_box(1)), _mm512_set1_epi32(black_box(2)));
        let mut sums = [_mm512_setzero_si512(); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm512_dpbusd_epi32(*sum, x, w);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 64)
    }

    pub(super) fn f32(_token: Avx512Vnni, rounds: usize) -> Option<usize> {
        let (x, w) = (_mm512_set1_ps(black_box(1.0)), _mm512_set1_ps(black_box(0.5)));
        let mut sums = [_mm512_setzero_ps(); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = _mm512_fmadd_ps(x, w, *sum);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 16)
    }

    pub(super) fn read(_token: Avx512Vnni, order: Order, bytes: &[i8]) {
        match order {
            Order::Streams => read_streams(bytes),
            Order::Whole => read_whole(bytes),
        }
    }
}

#[avx512vnni]
fn read_whole(bytes: &[i8]) {
    let mut sums = [_mm512_setzero_si512(); TURNS];
    let (turns, rest) = bytes.as_chunks::<{ TURNS * 64 }>();
    for turn in turns {
        for (sum, part) in sums.iter_mut().zip(turn.as_chunks().0) {
            prefetch::to_l1(part.as_ptr().wrapping_add(FAR_WHOLE));
            *sum = _mm512_add_epi32(*sum, load(part));
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[avx512vnni]
fn read_streams(bytes: &[i8]) {
    let mut sums = [_mm512_setzero_si512(); STREAMS];
    let (chunks, rest) = bytes.as_chunks::<{ STREAMS * STREAM }>();
    for chunk in chunks {
        let (streams, _) = chunk.as_chunks::<STREAM>();
        for i in (0..STREAM).step_by(64) {
            for (sum, stream) in sums.iter_mut().zip(streams) {
                prefetch::to_l2(stream.as_ptr().wrapping_add(prefetch_offset(i)));
                *sum = _mm512_add_epi32(*sum, load(stream[i..].first_chunk().expect("whole registers")));
            }
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[avx512vnni]
fn load(line: &[i8; 64]) -> __m512i {
    // SAFETY: `line` is 64 readable bytes; the load needs no alignment.
    unsafe { _mm512_loadu_si512(line.as_ptr().cast()) }
}
