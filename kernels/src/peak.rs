//! The peak rates of this processor: products from registers, and memory bandwidth.
//!
//! Each function does a fixed amount of work and nothing else; dividing it by the fastest time
//! of many calls gives a rate that no kernel exceeds. They are for measurements: the model does
//! not call them.

#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
mod amx;
#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512bf16;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
#[cfg(target_arch = "x86_64")]
mod avxvnni;
#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(target_arch = "aarch64")]
mod neon_dotprod;
#[cfg(target_arch = "aarch64")]
mod neon_i8mm;
mod scalar;
#[cfg(target_arch = "wasm32")]
mod simd128;

use crate::isa::{Isa, dispatch};
use core::hint::black_box;

/// Int8 multiply-adds with int32 sums, from registers only: returns the number done in
/// `rounds` rounds of the back-end's instruction, or `None` if it has none.
pub fn int8(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, int8(rounds), {
        Scalar: scalar,
        Avx2: avx2,
        AvxVnni: avxvnni,
        Avx512Vnni: avx512vnni,
        Avx512Bf16: avx512vnni,
        Amx: amx,
        Neon: neon,
        NeonDotprod: neon_dotprod,
        NeonI8mm: neon_i8mm,
        Simd128: simd128,
    })
}

/// Single-precision multiply-adds from registers only: returns the number done in `rounds`
/// rounds of the back-end's instruction, or `None` if it has none.
pub fn f32(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, f32(rounds))
}

/// Multiply-adds of pairs of bf16 with f32 sums, from registers only: returns the number done
/// in `rounds` rounds of the instruction, or `None` if the back-end has none, or has tiles instead.
pub fn pairs(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, pairs(rounds), {
        Scalar: scalar,
        Avx2: scalar,
        AvxVnni: scalar,
        Avx512Vnni: scalar,
        Avx512Bf16: avx512bf16,
        Amx: scalar,
        Neon: scalar,
        NeonDotprod: scalar,
        NeonI8mm: scalar,
        Simd128: scalar,
    })
}

/// The order in which memory is read; the faster one depends on the processor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Several streams side by side.
    Streams,
    /// From end to end.
    Whole,
}

impl Order {
    /// All orders.
    pub const ALL: [Self; 2] = [Self::Streams, Self::Whole];
}

/// Number of streams read side by side: an Intel Xeon then has up to 1.5 times
/// the bandwidth of one stream.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const STREAMS: usize = 8;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const STREAM: usize = 12 << 10;

/// Prefetch distance in bytes: long enough for the first line of a page.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const FAR: usize = 2 << 10;

/// Offset of the line that is prefetched while line `i` of a stream is read: past the stream's
/// end, in the same stream of the next chunk.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const fn prefetch_offset(i: usize) -> usize {
    if i + FAR < STREAM { i + FAR } else { i + FAR + (STREAMS - 1) * STREAM }
}

/// Prefetch distance in bytes for one stream: with it an AMD Zen 5 has 1.5 times the bandwidth of
/// eight streams.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const FAR_WHOLE: usize = 16 << 10;

/// Accumulators for one stream.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
const TURNS: usize = 4;

/// Reads every byte once.
pub fn read(isa: Isa, order: Order, bytes: &[i8]) {
    dispatch!(isa, read(order, bytes))
}

/// Reads every byte with one sum.
fn sum(bytes: &[i8]) {
    black_box(bytes.iter().fold(0_i8, |sum, &byte| sum.wrapping_add(byte)));
}
