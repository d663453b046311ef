//! Eight inputs of 2 rows and 2 outputs per instruction: `smmla`.
//!
//! ```text
//! inputs, in a buffer   row 0: 8 inputs | row 1: 8 inputs          prepared once for all panels
//! two quads of a panel  o0 o1 o2 o3 and o0 o1 o2 o3, 4 inputs each
//! interleaved           o0 o0 o1 o1 and o2 o2 o3 o3, 8 inputs each  `zip1` and `zip2`
//! adds up to            rows 0, 1 of o0, o1, and rows 0, 1 of o2, o3
//! ```

use super::chunk::{CHUNK_BYTES, Chunk, prefetch_scales};
use super::input::{GemmTask, QuantInput};
use super::neon::{Quads, dequantize_tile, load_bytes, load_sums, store_sums};
use super::neon_dotprod;
use crate::gemm::{Epilogue, tiles};
use crate::isa::{NeonI8mm, entry};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::aarch64::*;
use core::arch::asm;
use umo_kernels_features::neon_i8mm;

/// Most rows for which `sdot`, without interleaving, is as fast.
const FEW_ROWS: usize = 3;
/// Pairs of rows of the largest tile: 6 pairs x half a panel are 24 registers of sums, which leaves
/// 4 for weights and 4 others.
const PAIRS: usize = 6;
/// Rows of the largest tile.
const ROWS: usize = 2 * PAIRS;
/// Panels whose epilogue runs at once: a gate and an up panel.
const WIDTH: usize = 2;
/// Inputs of a step.
const STEP: usize = 2 * QUAD;
/// Steps of inputs that are prepared at once: 6 pairs are 12 KiB.
const STEPS: usize = 128;
/// Registers of sums of one pair of rows and half a panel.
const SUMS: usize = PANEL / 4;

/// Inputs of two rows, alternating by steps.
type PairOfRows = [[i8; 2 * STEP]; STEPS];

entry! {
    pub(super) fn matmul(_token: NeonI8mm, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: NeonI8mm, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: NeonI8mm) -> Tiling {
    Tiling {
        rows: &[FEW_ROWS, ROWS],
        outputs: &[PANEL, WIDTH * PANEL],
        inputs: &[QUAD, STEP, STEPS * STEP],
        held: 0,
        chunk: CHUNK_BYTES,
    }
}

#[neon_i8mm]
fn run(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let rows = x.rows.rows();
    if rows <= FEW_ROWS {
        return neon_dotprod::run(x, task, y);
    }
    let mut buffer = [[[0; 2 * STEP]; STEPS]; PAIRS];
    let width = (CHUNK_BYTES / (PANEL * task.k().max(1)) / WIDTH).max(1) * WIDTH;
    for first in (0..task.slots()).step_by(width) {
        let mut chunk = Chunk::new(task, first..first + width, rows, (rows.div_ceil(ROWS), WIDTH));
        for (t, rows) in tiles(rows, ROWS) {
            let buffer = &mut buffer[..rows.div_ceil(2)];
            prepare(x, (t, rows), 0, buffer);
            for slot in chunk.slots.clone().step_by(WIDTH) {
                let width = WIDTH.min(chunk.slots.end - slot);
                let next = chunk.fetch(task.panel(slot));
                let mut sums = [[0.0; PANEL]; ROWS * WIDTH];
                // A tile with an odd number of rows has one more row.
                let some = &mut sums[..2 * buffer.len() * width];
                for (i, next) in next[..width].iter().enumerate() {
                    prefetch_scales(task, slot + i);
                    let fetch = (chunk.ahead, *next);
                    panel(x, (t, rows), buffer, task.panel(slot + i), fetch, &mut some[i..], width);
                }
                dequantize_tile(x, t, &mut sums[..rows * width], width, task, slot, &mut y);
            }
        }
    }
}

/// Prepares the inputs from `first` on of `rows` rows from `t` on, as many as `buffer` holds of each.
#[neon_i8mm]
fn prepare(x: &QuantInput, (t, rows): (usize, usize), first: usize, buffer: &mut [PairOfRows]) {
    let inputs = first..(first + STEPS * STEP).min(x.rows.cols());
    for (p, pair) in buffer.iter_mut().enumerate() {
        for side in 0..2 {
            // The last row is repeated past the end.
            let row = &x.rows.row(t + (2 * p + side).min(rows - 1))[inputs.clone()];
            let (whole, tail) = row.as_chunks::<STEP>();
            for (x, to) in whole.iter().zip(pair.iter_mut()) {
                to.as_chunks_mut().0[side] = *x;
            }
            // Values behind the last input are multiplied by zero weights.
            if !tail.is_empty() {
                pair[whole.len()][side * STEP..][..tail.len()].copy_from_slice(tail);
            }
        }
    }
}

/// Exact sums of the rows in `buffer` with one panel, in every `width`th of `sums`. Prefetches the
/// panel at the distance `ahead`, and the `next` one.
#[neon_i8mm]
fn panel(
    x: &QuantInput,
    rows: (usize, usize),
    buffer: &mut [PairOfRows],
    quads: &[Quads],
    (ahead, next): (usize, *const Quads),
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    for (i, quads) in quads.chunks(2 * STEPS).enumerate() {
        if x.rows.cols() > STEPS * STEP {
            prepare(x, rows, i * STEPS * STEP, buffer);
        }
        let fetch = (ahead, next.wrapping_add(i * 2 * STEPS));
        match buffer.len() {
            2 => halves::<2>(buffer, quads, fetch, sums, width),
            3 => halves::<3>(buffer, quads, fetch, sums, width),
            4 => halves::<4>(buffer, quads, fetch, sums, width),
            5 => halves::<5>(buffer, quads, fetch, sums, width),
            PAIRS => halves::<PAIRS>(buffer, quads, fetch, sums, width),
            pairs => unreachable!("a tile of {pairs} pairs of rows"),
        }
    }
}

/// Adds the products of `N` pairs of rows with each half of the panel in turn to `sums`.
#[neon_i8mm]
fn halves<const N: usize>(
    buffer: &[PairOfRows],
    quads: &[Quads],
    fetch: (usize, *const Quads),
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let (pairs, end) = quads.as_chunks();
    let mut rows = [&[][..]; N];
    for (rows, pair) in rows.iter_mut().zip(buffer) {
        *rows = pair;
    }
    let mut last = [[[0; PANEL * QUAD]; 2]];
    if let [end] = end {
        last[0][0] = *end;
    }
    for half in 0..2 {
        let mut acc = [[vdupq_n_s32(0); SUMS]; N];
        if half == 0 {
            multiply::<N, 0, true>(&mut acc, &rows, pairs, fetch);
        } else {
            multiply::<N, 1, false>(&mut acc, &rows, pairs, fetch);
        }
        if !end.is_empty() {
            let mut rest = [&[][..]; N];
            for (rest, rows) in rest.iter_mut().zip(rows) {
                *rest = &rows[pairs.len()..];
            }
            if half == 0 {
                multiply::<N, 0, true>(&mut acc, &rest, &last, fetch);
            } else {
                multiply::<N, 1, false>(&mut acc, &rest, &last, fetch);
            }
        }
        for n in 0..N {
            for side in 0..2 {
                let sum = &mut sums[(2 * n + side) * width];
                let mut values = load_sums(sum);
                for g in 0..2 {
                    let (low, high) = (vreinterpretq_s64_s32(acc[n][2 * g]), vreinterpretq_s64_s32(acc[n][2 * g + 1]));
                    let row = if side == 0 { vzip1q_s64(low, high) } else { vzip2q_s64(low, high) };
                    values[2 * half + g] = vaddq_s32(values[2 * half + g], vreinterpretq_s32_s64(row));
                }
                store_sums(sum, values);
            }
        }
    }
}

/// The innermost tile: adds the products of `N` pairs of rows with the half `HALF` of a panel.
/// `FETCH`: prefetches weights at the distance `ahead`, and the `next` panel. Kept out of line, so
/// that it has all registers.
#[inline(never)]
#[neon_i8mm]
fn multiply<const N: usize, const HALF: usize, const FETCH: bool>(
    sums: &mut [[int32x4_t; SUMS]; N],
    rows: &[&[[i8; 2 * STEP]]; N],
    pairs: &[[Quads; 2]],
    (ahead, next): (usize, *const Quads),
) {
    let steps = pairs.len();
    for row in rows {
        assert!(row.len() >= steps);
    }
    let mut acc = *sums;
    for s in 0..steps {
        let [first, second] = &pairs[s];
        if FETCH {
            for (quad, which) in [(first, 0), (second, 1)] {
                prefetch::to_l1((&raw const *quad).wrapping_add(ahead));
                prefetch::to_l2(next.wrapping_add(2 * s + which));
            }
        }
        let ((first, _), (second, _)) = (first.as_chunks(), second.as_chunks());
        let mut w = [vdupq_n_s8(0); SUMS];
        for g in 0..2 {
            let a = vreinterpretq_s32_s8(load_bytes(&first[2 * HALF + g]));
            let b = vreinterpretq_s32_s8(load_bytes(&second[2 * HALF + g]));
            w[2 * g] = vreinterpretq_s8_s32(vzip1q_s32(a, b));
            w[2 * g + 1] = vreinterpretq_s8_s32(vzip2q_s32(a, b));
        }
        for n in 0..N {
            let x = load_bytes(&rows[n][s]);
            for i in 0..SUMS {
                acc[n][i] = matrix_product(acc[n][i], x, w[i]);
            }
        }
    }
    *sums = acc;
}

/// Adds the product of two rows of 8 inputs and two outputs' weights. In assembly, as the
/// intrinsic is not stable.
#[inline]
#[neon_i8mm]
fn matrix_product(sum: int32x4_t, x: int8x16_t, w: int8x16_t) -> int32x4_t {
    let mut sum = sum;
    // SAFETY: this function enables the instruction, which touches only the named registers.
    unsafe {
        asm!(
            "smmla {sum:v}.4s, {x:v}.16b, {w:v}.16b",
            sum = inout(vreg) sum, x = in(vreg) x, w = in(vreg) w,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    sum
}
