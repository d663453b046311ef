//! Four inputs of 4 outputs per instruction: `sdot` multiplies signed bytes, so that rows are read
//! where they are, 16 inputs at a time, and the instruction selects the quad.

use super::input::{GemmTask, QuantInput};
use super::neon::{Quads, REGISTERS, dequantize_tile, load_bytes, store_sums};
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
/// Panels of one row in one group, 16 registers of sums; an even number, as gated products need.
const WIDE: usize = 4;
/// Panels of more rows in one group: a gate and an up panel.
const PAIR: usize = 2;
/// Inputs of a register.
const BYTES: usize = 16;
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

/// Where the loops change.
pub(super) fn tiling(_token: NeonDotprod) -> Tiling {
    Tiling {
        rows: &[1, ROWS],
        outputs: &[PANEL, PAIR * PANEL, WIDE * PANEL],
        inputs: &[QUAD, BYTES],
        held: 0,
        chunk: 0,
    }
}

/// All rows pass by each group of panels while it is in the cache.
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

/// `R` rows from `t` on with `WIDTH` slots from `slot` on, `P` of them at a time.
#[neon_dotprod]
fn group<const R: usize, const P: usize, const WIDTH: usize>(
    x: &QuantInput,
    t: usize,
    task: &GemmTask,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    let mut rows = [&[][..]; R];
    for (r, row) in rows.iter_mut().enumerate() {
        *row = x.rows.row(t + r);
    }
    let mut sums = [[[0.0; PANEL]; WIDTH]; R];
    for i in (0..WIDTH).step_by(P) {
        let mut panels = [&[][..]; P];
        for (p, panel) in panels.iter_mut().enumerate() {
            *panel = task.panel(slot + i + p);
        }
        multiply(rows, panels, &mut sums, i);
    }
    dequantize_tile(x, t, sums.as_flattened_mut(), WIDTH, task, slot, y);
}

/// The innermost tile: `R x P` panels of sums in registers, stored to `sums` from panel `first` on.
/// Kept out of line, so that all registers are its own.
#[inline(never)]
#[neon_dotprod]
fn multiply<const R: usize, const P: usize, const WIDTH: usize>(
    rows: [&[i8]; R],
    panels: [&[Quads]; P],
    sums: &mut [[[f32; PANEL]; WIDTH]; R],
    first: usize,
) {
    let k = rows[0].len();
    let (mut whole, mut tails, mut last) = ([&[][..]; R], [[0; BYTES]; R], [vdupq_n_s8(0); R]);
    for r in 0..R {
        let tail;
        (whole[r], tail) = rows[r].as_chunks::<BYTES>();
        assert!(whole[r].len() == k / BYTES);
        tails[r][..tail.len()].copy_from_slice(tail);
        last[r] = load_bytes(&tails[r]);
    }
    for panel in panels {
        assert!(panel.len() == k.div_ceil(QUAD));
    }
    let mut acc = [[[vdupq_n_s32(0); REGISTERS]; P]; R];
    for c in 0..k / BYTES {
        let inputs = registers(&whole, c);
        step::<R, P, 0>(&mut acc, &inputs, &panels, 4 * c);
        step::<R, P, 1>(&mut acc, &inputs, &panels, 4 * c);
        step::<R, P, 2>(&mut acc, &inputs, &panels, 4 * c);
        step::<R, P, 3>(&mut acc, &inputs, &panels, 4 * c);
    }
    let quads = k / BYTES * 4;
    match panels[0].len() - quads {
        0 => {}
        1 => step::<R, P, 0>(&mut acc, &last, &panels, quads),
        2 => {
            step::<R, P, 0>(&mut acc, &last, &panels, quads);
            step::<R, P, 1>(&mut acc, &last, &panels, quads);
        }
        3 => {
            step::<R, P, 0>(&mut acc, &last, &panels, quads);
            step::<R, P, 1>(&mut acc, &last, &panels, quads);
            step::<R, P, 2>(&mut acc, &last, &panels, quads);
        }
        _ => {
            step::<R, P, 0>(&mut acc, &last, &panels, quads);
            step::<R, P, 1>(&mut acc, &last, &panels, quads);
            step::<R, P, 2>(&mut acc, &last, &panels, quads);
            step::<R, P, 3>(&mut acc, &last, &panels, quads);
        }
    }
    for r in 0..R {
        for p in 0..P {
            store_sums(&mut sums[r][first + p], acc[r][p]);
        }
    }
}

/// Register `c` of each row.
#[inline]
#[neon_dotprod]
fn registers<const R: usize>(rows: &[&[[i8; BYTES]]; R], c: usize) -> [int8x16_t; R] {
    let mut inputs = [vdupq_n_s8(0); R];
    for (input, row) in inputs.iter_mut().zip(rows) {
        *input = load_bytes(&row[c]);
    }
    inputs
}

/// Adds the products of the quad `LANE` of each row's inputs with the panels' quad `first + LANE`.
#[inline]
#[neon_dotprod]
fn step<const R: usize, const P: usize, const LANE: usize>(
    acc: &mut [[[int32x4_t; REGISTERS]; P]; R],
    inputs: &[int8x16_t; R],
    panels: &[&[Quads]; P],
    first: usize,
) {
    for p in 0..P {
        if R == 1 {
            prefetch::to_l1(panels[p].as_ptr().wrapping_add(first + LANE + PREFETCH_DISTANCE));
        }
        let (outputs, _) = panels[p][first + LANE].as_chunks();
        for g in 0..REGISTERS {
            let w = load_bytes(&outputs[g]);
            for r in 0..R {
                acc[r][p][g] = dot::<LANE>(acc[r][p][g], w, inputs[r]);
            }
        }
    }
}

/// Adds to each sum the products of four bytes of `w` with those of quad `LANE` of `x`. By name:
/// the compiler's function of it is not stable.
#[inline]
#[neon_dotprod]
fn dot<const LANE: usize>(sum: int32x4_t, w: int8x16_t, x: int8x16_t) -> int32x4_t {
    let mut sum = sum;
    // SAFETY: this function enables the instruction, which touches the named registers alone.
    unsafe {
        asm!(
            "sdot {sum:v}.4s, {w:v}.16b, {x:v}.4b[{lane}]",
            sum = inout(vreg) sum, w = in(vreg) w, x = in(vreg) x, lane = const LANE,
            options(pure, nomem, nostack, preserves_flags),
        );
    }
    sum
}
