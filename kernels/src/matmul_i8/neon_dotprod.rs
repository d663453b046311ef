//! Four inputs of 4 outputs per instruction: `sdot` multiplies signed bytes, so that rows are read
//! in place, 16 inputs at a time, and the instruction selects the quad.

use super::input::{GemmTask, QuantInput};
use super::neon::{Quads, REGISTERS, dequantize_tile, load_bytes, load_sums, store_sums};
use crate::gemm::{Epilogue, tiles};
use crate::isa::{NeonDotprod, entry};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::aarch64::*;
use core::arch::asm;
use umo_kernels_features::neon_dotprod;

/// Rows of the largest tile: 6 rows x 1 panel are 24 registers of sums, which leaves 6 for inputs
/// and 2 for weights.
const ROWS: usize = 6;
/// Panels in one group for one row, which are 16 registers of sums; an even number, as gated products need.
const WIDE: usize = 4;
/// Panels in one group for more rows: a gate and an up panel.
const PAIR: usize = 2;
/// Inputs of a register, and their quads.
const BYTES: usize = QUADS * QUAD;
const QUADS: usize = 4;
/// Prefetch distance in quads for one row, whose weights are read once, from memory.
const PREFETCH_DISTANCE: usize = 32;

entry! {
    pub(super) fn matmul(_token: NeonDotprod, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: NeonDotprod, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: NeonDotprod) -> Tiling {
    Tiling {
        rows: &[1, ROWS],
        outputs: &[PANEL, PAIR * PANEL, WIDE * PANEL],
        inputs: &[QUAD, BYTES],
        held: 0,
        chunk: 0,
    }
}

/// Processes all rows with each group of panels while it is in the cache.
#[neon_dotprod]
pub(super) fn run(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let rows = x.rows.rows();
    let mut slot = 0;
    while slot < task.slots() {
        let left = task.slots() - slot;
        let width = if rows == 1 && left >= WIDE { WIDE } else { PAIR.min(left) };
        for (t, rows) in tiles(rows, ROWS) {
            match (rows, width) {
                (1, WIDE) => group::<1, WIDE, WIDE>(x, t, task, slot, &mut y),
                (1, PAIR) => group::<1, PAIR, PAIR>(x, t, task, slot, &mut y),
                (2, PAIR) => group::<2, PAIR, PAIR>(x, t, task, slot, &mut y),
                (3, PAIR) => group::<3, PAIR, PAIR>(x, t, task, slot, &mut y),
                (4, PAIR) => group::<4, 1, PAIR>(x, t, task, slot, &mut y),
                (5, PAIR) => group::<5, 1, PAIR>(x, t, task, slot, &mut y),
                (ROWS, PAIR) => group::<ROWS, 1, PAIR>(x, t, task, slot, &mut y),
                (1, 1) => group::<1, 1, 1>(x, t, task, slot, &mut y),
                (2, 1) => group::<2, 1, 1>(x, t, task, slot, &mut y),
                (3, 1) => group::<3, 1, 1>(x, t, task, slot, &mut y),
                (4, 1) => group::<4, 1, 1>(x, t, task, slot, &mut y),
                (5, 1) => group::<5, 1, 1>(x, t, task, slot, &mut y),
                (ROWS, 1) => group::<ROWS, 1, 1>(x, t, task, slot, &mut y),
                (rows, width) => unreachable!("a tile of {rows} rows and {width} panels"),
            }
        }
        slot += width;
    }
}

/// Processes `R` rows from `t` on with `WIDTH` slots from `slot` on, `P` of them at a time.
#[neon_dotprod]
fn group<const R: usize, const P: usize, const WIDTH: usize>(
    x: &QuantInput,
    t: usize,
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut rows = [&[][..]; R];
    let mut tails = [[[0; BYTES]; 1]; R];
    for r in 0..R {
        let tail;
        (rows[r], tail) = x.rows.row(t + r).as_chunks();
        tails[r][0][..tail.len()].copy_from_slice(tail);
    }
    let mut sums = [[[0.0; PANEL]; WIDTH]; R];
    let sums = sums.as_flattened_mut();
    for i in (0..WIDTH).step_by(P) {
        let mut panels = [&[][..]; P];
        let mut ends = [[[[0; PANEL * QUAD]; QUADS]; 1]; P];
        for p in 0..P {
            let end;
            (panels[p], end) = task.panel(slot + i + p).as_chunks();
            // If the inputs end within the last quads, the tail is processed with whole quads.
            if panels[p].len() > rows[0].len() {
                ends[p][0] = panels[p][rows[0].len()];
                panels[p] = &panels[p][..rows[0].len()];
            }
            ends[p][0][..end.len()].copy_from_slice(end);
        }
        multiply(&rows, &panels, true, &mut sums[i..], WIDTH);
        if !task.k().is_multiple_of(BYTES) {
            let (mut last, mut end) = ([&[][..]; R], [&[][..]; P]);
            for (last, tail) in last.iter_mut().zip(&tails) {
                *last = tail;
            }
            for (end, panel) in end.iter_mut().zip(&ends) {
                *end = panel;
            }
            multiply(&last, &end, false, &mut sums[i..], WIDTH);
        }
    }
    dequantize_tile(x, t, sums, WIDTH, task, slot, y);
}

/// The innermost tile: stores `R x P` panels of sums to the first panels of `sums [R, width]`, or
/// adds to them unless it is the `start`. Kept out of line, so that it has all registers.
#[inline(never)]
#[neon_dotprod]
fn multiply<const R: usize, const P: usize>(
    rows: &[&[[i8; BYTES]]; R],
    panels: &[&[[Quads; QUADS]]; P],
    start: bool,
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let steps = rows[0].len();
    for row in rows {
        assert!(row.len() == steps);
    }
    for panel in panels {
        assert!(panel.len() == steps);
    }
    let mut acc = [[[vdupq_n_s32(0); REGISTERS]; P]; R];
    if !start {
        for r in 0..R {
            for p in 0..P {
                acc[r][p] = load_sums(&sums[r * width + p]);
            }
        }
    }
    for s in 0..steps {
        let mut inputs = [vdupq_n_s8(0); R];
        for (input, row) in inputs.iter_mut().zip(rows) {
            *input = load_bytes(&row[s]);
        }
        step::<R, P, 0>(&mut acc, &inputs, panels, s);
        step::<R, P, 1>(&mut acc, &inputs, panels, s);
        step::<R, P, 2>(&mut acc, &inputs, panels, s);
        step::<R, P, 3>(&mut acc, &inputs, panels, s);
    }
    for r in 0..R {
        for p in 0..P {
            store_sums(&mut sums[r * width + p], acc[r][p]);
        }
    }
}

/// Adds the products of the quad `LANE` of each row's inputs in step `s`.
#[inline]
#[neon_dotprod]
fn step<const R: usize, const P: usize, const LANE: usize>(
    acc: &mut [[[int32x4_t; REGISTERS]; P]; R],
    inputs: &[int8x16_t; R],
    panels: &[&[[Quads; QUADS]]; P],
    s: usize,
) {
    for p in 0..P {
        let quad = &panels[p][s][LANE];
        if R == 1 {
            prefetch::to_l1(quad.as_ptr().wrapping_add(PREFETCH_DISTANCE * PANEL * QUAD));
        }
        let (outputs, _) = quad.as_chunks();
        for g in 0..REGISTERS {
            let w = load_bytes(&outputs[g]);
            for r in 0..R {
                acc[r][p][g] = dot::<LANE>(acc[r][p][g], w, inputs[r]);
            }
        }
    }
}

/// Adds to each sum the products of four bytes of `w` with those of quad `LANE` of `x`. In assembly,
/// as the intrinsic is not stable.
#[inline]
#[neon_dotprod]
pub(crate) fn dot<const LANE: usize>(sum: int32x4_t, w: int8x16_t, x: int8x16_t) -> int32x4_t {
    let mut sum = sum;
    // SAFETY: this function enables the instruction, which touches only the named registers.
    unsafe {
        asm!(
            "sdot {sum:v}.4s, {w:v}.16b, {x:v}.4b[{lane}]",
            sum = inout(vreg) sum, w = in(vreg) w, x = in(vreg) x, lane = const LANE,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    sum
}
