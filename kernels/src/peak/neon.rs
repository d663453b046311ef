//! Peaks with NEON.

use super::{FAR_WHOLE, Order, STREAM, STREAMS, TURNS, prefetch_offset};
use crate::isa::{Neon, entry};
use crate::prefetch;
use core::arch::aarch64::{int8x16_t, vaddq_s8, vdupq_n_f32, vdupq_n_s8, vfmaq_f32, vld1q_s8};
use core::arch::asm;
use core::hint::black_box;
use umo_kernels_features::neon;

/// Independent sums: with two operands and products they leave few of 32 registers.
pub(super) const SUMS: usize = 24;

entry! {
    /// `smull`, `smlal` and `sadalp`, the cost of two exact products of bytes. In assembly, as the
    /// compiler would merge the equal products.
    pub(super) fn int8(_token: Neon, rounds: usize) -> Option<usize> {
        if rounds == 0 {
            return Some(0);
        }
        // SAFETY: this function enables NEON, and only named registers are touched;
        // `rounds` is at least 1.
        unsafe {
            asm!(
                "2:",
                "smull v16.8h, v24.8b, v25.8b", "smlal v16.8h, v24.8b, v25.8b", "sadalp v0.4s, v16.8h",
                "smull v17.8h, v24.8b, v25.8b", "smlal v17.8h, v24.8b, v25.8b", "sadalp v1.4s, v17.8h",
                "smull v18.8h, v24.8b, v25.8b", "smlal v18.8h, v24.8b, v25.8b", "sadalp v2.4s, v18.8h",
                "smull v19.8h, v24.8b, v25.8b", "smlal v19.8h, v24.8b, v25.8b", "sadalp v3.4s, v19.8h",
                "smull v20.8h, v24.8b, v25.8b", "smlal v20.8h, v24.8b, v25.8b", "sadalp v4.4s, v20.8h",
                "smull v21.8h, v24.8b, v25.8b", "smlal v21.8h, v24.8b, v25.8b", "sadalp v5.4s, v21.8h",
                "smull v22.8h, v24.8b, v25.8b", "smlal v22.8h, v24.8b, v25.8b", "sadalp v6.4s, v22.8h",
                "smull v23.8h, v24.8b, v25.8b", "smlal v23.8h, v24.8b, v25.8b", "sadalp v7.4s, v23.8h",
                "subs {rounds}, {rounds}, #1",
                "b.ne 2b",
                rounds = inout(reg) rounds => _,
                out("v0") _, out("v1") _, out("v2") _, out("v3") _, out("v4") _, out("v5") _, out("v6") _, out("v7") _,
                out("v16") _, out("v17") _, out("v18") _, out("v19") _, out("v20") _, out("v21") _, out("v22") _,
                out("v23") _,
                options(nostack, nomem),
            );
        }
        Some(rounds * 8 * 16)
    }

    pub(super) fn f32(_token: Neon, rounds: usize) -> Option<usize> {
        let (x, w) = (vdupq_n_f32(black_box(1.0)), vdupq_n_f32(black_box(0.5)));
        let mut sums = [vdupq_n_f32(0.0); SUMS];
        for _ in 0..rounds {
            for sum in &mut sums {
                *sum = vfmaq_f32(*sum, x, w);
            }
        }
        black_box(sums);
        Some(rounds * SUMS * 4)
    }

    pub(super) fn read(_token: Neon, order: Order, bytes: &[i8]) {
        match order {
            Order::Streams => read_streams(bytes),
            Order::Whole => read_whole(bytes),
        }
    }
}

#[neon]
fn read_whole(bytes: &[i8]) {
    let mut sums = [vdupq_n_s8(0); TURNS];
    let (turns, rest) = bytes.as_chunks::<{ TURNS * 16 }>();
    for turn in turns {
        prefetch::to_l1(turn.as_ptr().wrapping_add(FAR_WHOLE));
        for (sum, part) in sums.iter_mut().zip(turn.as_chunks().0) {
            *sum = vaddq_s8(*sum, load(part));
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[neon]
fn read_streams(bytes: &[i8]) {
    let mut sums = [vdupq_n_s8(0); STREAMS];
    let (chunks, rest) = bytes.as_chunks::<{ STREAMS * STREAM }>();
    for chunk in chunks {
        let (streams, _) = chunk.as_chunks::<STREAM>();
        for i in (0..STREAM).step_by(16) {
            for (sum, stream) in sums.iter_mut().zip(streams) {
                if i % 64 == 0 {
                    prefetch::to_l2(stream.as_ptr().wrapping_add(prefetch_offset(i)));
                }
                *sum = vaddq_s8(*sum, load(stream[i..].first_chunk().expect("whole registers")));
            }
        }
    }
    black_box(sums);
    super::sum(rest);
}

#[neon]
fn load(line: &[i8; 16]) -> int8x16_t {
    // SAFETY: `line` is 16 readable bytes; the load needs no alignment.
    unsafe { vld1q_s8(line.as_ptr()) }
}
