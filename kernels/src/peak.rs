//! What this processor can do at most: products from registers, and reading memory.
//!
//! Each function does a known amount of work and nothing else; divided by the time that the best of many calls took it
//! gives the rates that no kernel exceeds. They are for measurements: nothing in the model calls them.

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
mod scalar;

use core::hint::black_box;

use crate::isa::{Isa, dispatch};

/// Int8 multiply-adds with int32 sums, from registers alone: returns how many were done in so many rounds of the back-end's
/// instruction; none where it has none of its own.
pub fn int8(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, int8(rounds), {
        Scalar: scalar,
        Avx2: avx2,
        AvxVnni: avxvnni,
        Avx512Vnni: avx512vnni,
        Avx512Bf16: avx512vnni,
        Amx: amx,
    })
}

/// Single-precision multiply-adds from registers alone: returns how many were done in so many rounds of the back-end's
/// instruction; none where it has none of its own.
pub fn f32(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, f32(rounds))
}

/// Multiply-adds of pairs of bfloat16 with f32 sums, from registers alone: returns how many were done in so many rounds of the
/// instruction; none where the back-end has none, as where tiles take its place.
pub fn pairs(isa: Isa, rounds: usize) -> Option<usize> {
    dispatch!(isa, pairs(rounds), {
        Scalar: scalar,
        Avx2: scalar,
        AvxVnni: scalar,
        Avx512Vnni: scalar,
        Avx512Bf16: avx512bf16,
        Amx: scalar,
    })
}

/// How memory is read: what comes faster differs between processors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Several streams beside each other.
    Streams,
    /// From end to end.
    Whole,
}

impl Order {
    /// Every way.
    pub const ALL: [Self; 2] = [Self::Streams, Self::Whole];
}

/// Streams that are read beside each other, as some products with one row read their panels, and the bytes of each: an Intel Xeon's memory
/// gives up to half as much again as to one stream.
#[cfg(target_arch = "x86_64")]
const STREAMS: usize = 8;
#[cfg(target_arch = "x86_64")]
const STREAM: usize = 12 << 10;

/// Bytes between a read and the prefetch in its stream: the first line of a page comes no later than the others.
#[cfg(target_arch = "x86_64")]
const FAR: usize = 2 << 10;

/// Where the line lies that is fetched while line `i` of a stream is read: behind the stream's end, in the same stream of the next
/// chunk.
#[cfg(target_arch = "x86_64")]
const fn prefetch_offset(i: usize) -> usize {
    if i + FAR < STREAM { i + FAR } else { i + FAR + (STREAMS - 1) * STREAM }
}

/// Bytes between a read and the prefetch where there is one stream: an AMD Zen 5 gives half as much again as to eight.
#[cfg(target_arch = "x86_64")]
const FAR_WHOLE: usize = 16 << 10;

/// Sums that take turns where there is one stream.
#[cfg(target_arch = "x86_64")]
const TURNS: usize = 4;

/// Reads every byte once.
pub fn read(isa: Isa, order: Order, bytes: &[i8]) {
    dispatch!(isa, read(order, bytes))
}

/// Reads every byte with one sum, as long as it takes.
fn sum(bytes: &[i8]) {
    black_box(bytes.iter().fold(0_i8, |sum, &byte| sum.wrapping_add(byte)));
}
