//! Bytes widened to words, multiplied and added in pairs to 32-bit sums
//! (`i32x4.dot_i16x8_s`), which is exact.
//!
//! ```text
//! a quad of a panel    o0 o0 o0 o0 o1 o1 o1 o1     8 bytes, a register of words
//! times inputs          0  1  2  3  0  1  2  3     the same four in every output
//! adds up to             o0    o0    o1    o1      two sums per output, added at the end
//! ```

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::input::{GemmTask, QuantInput};
use crate::gemm::simd128::{ROWS, WIDTH, store_gated_tile, store_tile};
use crate::gemm::{self, Epilogue, Scaled, tiles};
use crate::isa::Simd128;
use crate::lanes::simd128::{REGISTERS, load_all, splat, store_all};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::wasm32::*;

/// Registers of a panel's quad, two outputs each.
const PAIRS: usize = PANEL / 2;

/// A quad of all outputs of a panel.
type Quads = [i8; PANEL * QUAD];

pub(super) fn matmul(_token: Simd128, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
    run(&x, &GemmTask::Plain(w, epilogue), y);
}

pub(super) fn matmul_gated(
    _token: Simd128,
    x: QuantInput,
    gate: PackedI8,
    up: PackedI8,
    y: MatMut<f32>,
    _tuning: Tuning,
) {
    run(&x, &GemmTask::Gated(gate, up), y);
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Simd128) -> Tiling {
    Tiling { rows: &[ROWS], outputs: &[PANEL, WIDTH * PANEL], inputs: &[QUAD], held: 0, chunk: 0 }
}

/// Processes all rows with each pair of panels while it is in the cache.
fn run(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    for slot in (0..task.slots()).step_by(WIDTH) {
        let width = WIDTH.min(task.slots() - slot);
        for (t, rows) in tiles(x.rows.rows(), ROWS) {
            let mut sums = [[0.0; PANEL]; ROWS * WIDTH];
            let sums = &mut sums[..rows * width];
            for i in 0..width {
                let quads = task.panel(slot + i);
                // One row has registers for the sums of a whole panel, more rows for half a panel.
                match rows {
                    1 => panel::<1, PAIRS>(x, t, quads, &mut sums[i..], width),
                    2 => panel::<2, { PAIRS / 2 }>(x, t, quads, &mut sums[i..], width),
                    ROWS => panel::<ROWS, { PAIRS / 2 }>(x, t, quads, &mut sums[i..], width),
                    rows => unreachable!("a tile of {rows} rows"),
                }
            }
            dequantize(x, t, sums, width, task, slot);
            match task {
                GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, &mut y),
                GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, &mut y),
            }
        }
    }
}

/// Exact sums of `R` rows from `t` on with one panel, `G` of its registers at a time, in
/// every `width`th of `sums`, as bits of floats.
#[inline(never)]
fn panel<const R: usize, const G: usize>(
    x: &QuantInput,
    t: usize,
    quads: &[Quads],
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let (mut rows, mut tails) = ([&[][..]; R], [[0; QUAD]; R]);
    for r in 0..R {
        let tail;
        (rows[r], tail) = x.rows.row(t + r).as_chunks::<QUAD>();
        tails[r][..tail.len()].copy_from_slice(tail);
    }
    let (whole, end) = quads.split_at(rows[0].len());
    for first in (0..PAIRS).step_by(G) {
        let mut acc = [[i32x4_splat(0); G]; R];
        for r in 0..R {
            rows[r] = &rows[r][..whole.len()];
        }
        for (s, quads) in whole.iter().enumerate() {
            let mut inputs = [&[0; QUAD]; R];
            for r in 0..R {
                inputs[r] = &rows[r][s];
            }
            step(&mut acc, &inputs, quads, first);
        }
        if let [quads] = end {
            step(&mut acc, &tails.each_ref(), quads, first);
        }
        for r in 0..R {
            let (registers, _) = sums[r * width].as_chunks_mut();
            for (pair, register) in acc[r].as_chunks::<2>().0.iter().zip(&mut registers[first / 2..]) {
                let [a, b] = *pair;
                let (even, odd) = (i32x4_shuffle::<0, 2, 4, 6>(a, b), i32x4_shuffle::<1, 3, 5, 7>(a, b));
                crate::lanes::simd128::store(register, i32x4_add(even, odd));
            }
        }
    }
}

/// Adds the products of a quad of inputs of each row with the registers from `first` on.
#[inline(always)]
fn step<const R: usize, const G: usize>(
    acc: &mut [[v128; G]; R],
    inputs: &[&[i8; QUAD]; R],
    quads: &Quads,
    first: usize,
) {
    let mut x = [i32x4_splat(0); R];
    for r in 0..R {
        // SAFETY: the input is 4 readable bytes; the load needs no alignment.
        x[r] = i16x8_extend_low_i8x16(unsafe { v128_load32_splat(inputs[r].as_ptr().cast()) });
    }
    let (pairs, _) = quads.as_chunks::<{ 2 * QUAD }>();
    for g in 0..G {
        // SAFETY: the weights are 8 readable bytes; the load needs no alignment.
        let w = unsafe { i16x8_load_extend_i8x8(pairs[first + g].as_ptr()) };
        for r in 0..R {
            acc[r][g] = i32x4_add(acc[r][g], i32x4_dot_i16x8(x[r], w));
        }
    }
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot` on to
/// floats. The sums are stored as bits of floats.
pub(crate) fn dequantize<'a, W: Scaled<'a>>(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &gemm::GemmTask<'_, W>,
    slot: usize,
) {
    for i in 0..width {
        let (w, p) = task.slot(slot + i);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let mut w_scale = [0.0; PANEL];
        w_scale[..outputs.len()].copy_from_slice(&w.scale()[outputs]);
        let w_scale = load_all(&w_scale);
        for (t, sum) in (t..).zip(sums[i..].iter_mut().step_by(width)) {
            let x_scale = splat(x.scale(t));
            let mut value = load_all(sum);
            for g in 0..REGISTERS {
                // The exact sum rounded to f32 once, then scalar's order of roundings.
                value[g] = f32x4_mul(f32x4_convert_i32x4(value[g]), f32x4_mul(x_scale, w_scale[g]));
            }
            store_all(sum, value);
        }
    }
}
