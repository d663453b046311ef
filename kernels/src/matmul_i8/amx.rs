//! 16 x 16 outputs and 64 inputs per instruction: `tdpbssd`, signed by signed bytes, so that nothing needs correction.
//!
//! The packed weights are the instruction's own layout: 16 quads of one panel, 1 KiB, are one tile. Rows of inputs are
//! gathered into tiles on the stack, 32 rows at a time. Up to [`FEW_ROWS`] rows, most of a tile would be empty: they are left to VNNI.

use super::QuantInput;
use super::avx512vnni::{self, Job, finish};
use crate::amx::{Aligned, BYTES, TILE, Tiles};
use crate::mat::MatMut;
use crate::matmul_f32::Epilogue;
use crate::pack::{PANEL, PackedI8};

/// Rows that VNNI multiplies sooner.
const FEW_ROWS: usize = 6;
/// Rows of inputs in work.
const ROWS: usize = 2 * TILE;
/// Steps of inputs gathered at once: as few as the inputs fill, because the buffer is cleared first.
const STEPS: [usize; 3] = [16, 32, 64];
/// Bytes of weights in work at once, which stay in L2 while blocks of rows go by.
const CHUNK_BYTES: usize = 768 << 10;

/// Panels of sums in one block: integers as bits in the place of the floats that they become.
const SUMS: usize = ROWS * 2;

/// 16 rows of 64 bytes.
type Tile = [[i8; BYTES]; TILE];

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul(x: QuantInput, w: PackedI8, end: Epilogue, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        avx512vnni::matmul(x, w, end, y);
    } else {
        run(&x, &Job::Plain(w, end), y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn matmul_gated(x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>) {
    if x.rows.rows() <= FEW_ROWS {
        avx512vnni::matmul_gated(x, gate, up, y);
    } else {
        run(&x, &Job::Gated(gate, up), y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn run(x: &QuantInput, job: &Job, y: MatMut<f32>) {
    // SAFETY: only the `Amx` arm of the products leads here.
    let tiles = unsafe { Tiles::new() };
    if job.k() <= STEPS[0] * BYTES {
        product::<{ STEPS[0] }>(&tiles, x, job, y);
    } else if job.k() <= STEPS[1] * BYTES {
        product::<{ STEPS[1] }>(&tiles, x, job, y);
    } else {
        product::<{ STEPS[2] }>(&tiles, x, job, y);
    }
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn product<const MOST: usize>(tiles: &Tiles, x: &QuantInput, job: &Job, mut y: MatMut<f32>) {
    let mut inputs = Aligned([[[[0; BYTES]; TILE]; 2]; MOST]);
    let mut sums = Aligned([[0.0; PANEL]; SUMS]);
    // A multiple of the panels that any block takes at once.
    let width = (CHUNK_BYTES / (PANEL * job.k().max(1)) / 4).max(1) * 4;
    for first in (0..job.slots()).step_by(width) {
        let end = (first + width).min(job.slots());
        for t in (0..x.rows.rows()).step_by(ROWS) {
            let rows = (x.rows.rows() - t).min(ROWS);
            gather(x, t, rows, 0, &mut inputs.0);
            let mut slot = first;
            while slot < end {
                let panels = match end - slot {
                    4.. if rows <= TILE => 4,
                    1 => 1,
                    _ => 2,
                };
                block(tiles, x, t, rows, &mut inputs.0, job, slot, panels, &mut sums.0, &mut y);
                slot += panels;
            }
        }
    }
}

/// The inputs from `first` on of the rows from `t` on, in tiles, as many steps as `inputs` holds. Whatever stands behind the
/// last input meets weights that are zero, and behind the last row, sums that nobody reads.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn gather(x: &QuantInput, t: usize, rows: usize, first: usize, inputs: &mut [[Tile; 2]]) {
    let last = (first + inputs.len() * BYTES).min(x.rows.cols());
    for r in 0..rows {
        let (whole, part) = x.rows.row(t + r)[first..last].as_chunks::<BYTES>();
        for (step, whole) in inputs.iter_mut().zip(whole) {
            step[r / TILE][r % TILE] = *whole;
        }
        if let Some(step) = inputs.get_mut(whole.len()).filter(|_| !part.is_empty()) {
            step[r / TILE][r % TILE][..part.len()].copy_from_slice(part);
        }
    }
}

/// The rows from `t` on with the slots from `slot` on, from the first input to the end of the product.
#[expect(clippy::too_many_arguments, reason = "one block of a product, each operand named")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn block(
    tiles: &Tiles,
    x: &QuantInput,
    t: usize,
    rows: usize,
    inputs: &mut [[Tile; 2]],
    job: &Job,
    slot: usize,
    panels: usize,
    sums: &mut [[f32; PANEL]; SUMS],
    y: &mut MatMut<f32>,
) {
    // Not by `from_fn`: a closure has this function's features and cannot be inlined into one that has not.
    let mut quads = [&[][..]; 4];
    for (p, quads) in quads.iter_mut().enumerate() {
        *quads = job.panel(slot + p.min(panels - 1));
    }
    let blocks = quads[0].len().div_ceil(inputs.len() * TILE).max(1);
    for i in 0..blocks {
        if blocks > 1 {
            gather(x, t, rows, i * inputs.len() * BYTES, inputs);
        }
        let part = i * inputs.len() * TILE..((i + 1) * inputs.len() * TILE).min(quads[0].len());
        let mut quads = quads;
        for quads in &mut quads {
            *quads = &quads[part.clone()];
        }
        match (rows <= TILE, panels) {
            (true, 4) => multiply::<1, 4>(tiles, inputs, &quads, i == 0, sums),
            (true, 2) => multiply::<1, 2>(tiles, inputs, &quads, i == 0, sums),
            (true, _) => multiply::<1, 1>(tiles, inputs, &quads, i == 0, sums),
            (false, 2) => multiply::<2, 2>(tiles, inputs, &quads, i == 0, sums),
            (false, _) => multiply::<2, 1>(tiles, inputs, &quads, i == 0, sums),
        }
    }
    finish::<0>(x, t, &mut sums[..rows * panels], panels, job, slot, y);
}

/// Adds the products of `R` tiles of rows with the quads of `P` panels to `sums [rows, P]`, or starts them.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply<const R: usize, const P: usize>(
    tiles: &Tiles,
    inputs: &[[Tile; 2]],
    quads: &[&[[i8; BYTES]]; 4],
    start: bool,
    sums: &mut [[f32; PANEL]; SUMS],
) {
    if !start {
        tiles.load_sums::<R, P>(sums);
    } else {
        tiles.zero();
    }
    let [first, second, third, fourth] = *quads;
    let ((first, rest), (second, _)) = (first.as_chunks::<TILE>(), second.as_chunks::<TILE>());
    let ((third, _), (fourth, _)) = (third.as_chunks::<TILE>(), fourth.as_chunks::<TILE>());
    let (steps, rest) = (first.len(), rest.len());
    for (i, x) in inputs.iter().enumerate().take(steps) {
        step::<R, P>(tiles, x, [&first[i], &second[i], &third[i], &fourth[i]]);
    }
    if rest > 0 {
        let mut last = Aligned([[[0; BYTES]; TILE]; 4]);
        for (last, quads) in last.0.iter_mut().zip(quads).take(P) {
            last[..rest].copy_from_slice(&quads[steps * TILE..]);
        }
        step::<R, P>(tiles, &inputs[steps], last.0.each_ref());
    }
    tiles.store_sums::<R, P>(sums);
}

/// 64 inputs of `R` tiles of rows with `P` panels.
#[inline]
fn step<const R: usize, const P: usize>(tiles: &Tiles, x: &[Tile; 2], w: [&Tile; 4]) {
    tiles.load::<4, _>(&x[0]);
    tiles.load::<6, _>(w[0]);
    tiles.multiply_i8::<0, 4, 6>();
    if R == 2 {
        tiles.load::<5, _>(&x[1]);
        tiles.multiply_i8::<2, 5, 6>();
    }
    if P > 1 {
        tiles.load::<7, _>(w[1]);
        tiles.multiply_i8::<1, 4, 7>();
    }
    if R == 2 && P > 1 {
        tiles.multiply_i8::<3, 5, 7>();
    }
    if R == 1 && P > 2 {
        tiles.load::<6, _>(w[2]);
        tiles.multiply_i8::<2, 4, 6>();
        tiles.load::<7, _>(w[3]);
        tiles.multiply_i8::<3, 4, 7>();
    }
}
