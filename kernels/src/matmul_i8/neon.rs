//! Bytes multiplied to 16 bits (`smull`) and added in pairs to 32-bit sums (`sadalp`), which is
//! exact.
//!
//! ```text
//! a quad of a panel    o0 o0 o0 o0 o1 o1 o1 o1 | o2 .. o3     16 bytes, a register of each half's products
//! times inputs          0  1  2  3  0  1  2  3 |  0 ..  3     the same four in every output
//! adds up to             o0    o0    o1    o1  |  o2 .. o3     two sums per output, added at the end
//! ```
//! Two products fit in 16 bits unless both are `-128 * -128`: for inputs without -128, which includes
//! all outputs of [`crate::quantize`], two quads are first added (`smlal`).

use super::input::{GemmTask, QuantInput};
use crate::gemm::neon as float;
use crate::gemm::{self, Epilogue, Scaled, tiles};
use crate::isa::{Neon, entry};
use crate::lanes::neon::{load_two as load, store_two as store};
use crate::mat::MatMut;
use crate::pack::{PANEL, PackedI8, QUAD};
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::aarch64::*;
use umo_kernels_features::neon;

/// Rows of the largest tile: 2 rows x 1 panel are 16 registers of sums, which leaves 4 for inputs
/// and 12 for weights and products.
const ROWS: usize = 2;
/// Panels whose epilogue runs at once: a gate and an up panel.
const WIDTH: usize = 2;
/// Inputs of one step: two quads.
const STEP: usize = 2 * QUAD;
/// Registers of a panel's quad.
pub(crate) const REGISTERS: usize = 4;

/// A quad of all outputs of a panel.
pub(super) type Quads = [i8; PANEL * QUAD];

entry! {
    pub(super) fn matmul(_token: Neon, x: QuantInput, w: PackedI8, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(_token: Neon, x: QuantInput, gate: PackedI8, up: PackedI8, y: MatMut<f32>, _tuning: Tuning) {
        run(&x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Neon) -> Tiling {
    Tiling { rows: &[ROWS], outputs: &[PANEL, WIDTH * PANEL], inputs: &[QUAD, STEP], held: 0, chunk: 0 }
}

/// Processes all rows with each pair of panels while it is in the cache.
#[neon]
fn run(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let fits = (0..x.rows.rows()).all(|t| !contains_min(x.rows.row(t)));
    for slot in (0..task.slots()).step_by(WIDTH) {
        let width = WIDTH.min(task.slots() - slot);
        for (t, rows) in tiles(x.rows.rows(), ROWS) {
            let mut sums = [[0.0; PANEL]; ROWS * WIDTH];
            let sums = &mut sums[..rows * width];
            for i in 0..width {
                let quads = task.panel(slot + i);
                match (rows, fits) {
                    (1, true) => panel::<1, true>(x, t, quads, &mut sums[i..], width),
                    (1, false) => panel::<1, false>(x, t, quads, &mut sums[i..], width),
                    (ROWS, true) => panel::<ROWS, true>(x, t, quads, &mut sums[i..], width),
                    (ROWS, false) => panel::<ROWS, false>(x, t, quads, &mut sums[i..], width),
                    (rows, _) => unreachable!("a tile of {rows} rows"),
                }
            }
            dequantize_tile(x, t, sums, width, task, slot, &mut y);
        }
    }
}

/// Whether any input is -128.
#[neon]
fn contains_min(row: &[i8]) -> bool {
    let (chunks, tail) = row.as_chunks();
    let mut least = vdupq_n_s8(0);
    for chunk in chunks {
        least = vminq_s8(least, load_bytes(chunk));
    }
    vminvq_s8(least) == i8::MIN || tail.contains(&i8::MIN)
}

/// Exact sums of `R` rows from `t` on with one panel, in every `width`th of `sums`.
#[neon]
fn panel<const R: usize, const PAIRED: bool>(
    x: &QuantInput,
    t: usize,
    quads: &[Quads],
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let (mut rows, mut tails) = ([&[][..]; R], [[[0; STEP]; 1]; R]);
    for r in 0..R {
        let tail;
        (rows[r], tail) = x.rows.row(t + r).as_chunks();
        tails[r][0][..tail.len()].copy_from_slice(tail);
    }
    let (whole, end) = quads.split_at(2 * rows[0].len());
    let mut acc = [[[vdupq_n_s32(0); 2]; REGISTERS]; R];
    multiply::<R, PAIRED>(&mut acc, &rows, whole.as_chunks().0);
    if !end.is_empty() {
        let mut pair = [[0; PANEL * QUAD]; 2];
        pair[..end.len()].copy_from_slice(end);
        multiply::<R, PAIRED>(&mut acc, &tails.each_ref().map(|tail| &tail[..]), &[pair]);
    }
    for r in 0..R {
        let mut values = [vdupq_n_s32(0); REGISTERS];
        for g in 0..REGISTERS {
            values[g] = vpaddq_s32(acc[r][g][0], acc[r][g][1]);
        }
        store_sums(&mut sums[r * width], values);
    }
}

/// The innermost tile: adds the products of `R` rows with one panel. `PAIRED`: no input is -128.
/// Kept out of line, so that it has all registers.
#[inline(never)]
#[neon]
fn multiply<const R: usize, const PAIRED: bool>(
    sums: &mut [[[int32x4_t; 2]; REGISTERS]; R],
    rows: &[&[[i8; STEP]]; R],
    pairs: &[[Quads; 2]],
) {
    let steps = pairs.len();
    for row in rows {
        assert!(row.len() == steps);
    }
    let mut acc = *sums;
    for s in 0..steps {
        let mut inputs = [&[0; STEP]; R];
        for (input, row) in inputs.iter_mut().zip(rows) {
            *input = &row[s];
        }
        step::<R, PAIRED>(&mut acc, &inputs, &pairs[s]);
    }
    *sums = acc;
}

/// Adds the products of two quads of inputs of each row.
#[inline]
#[neon]
fn step<const R: usize, const PAIRED: bool>(
    acc: &mut [[[int32x4_t; 2]; REGISTERS]; R],
    inputs: &[&[i8; STEP]; R],
    [first, second]: &[Quads; 2],
) {
    let mut x = [[vdupq_n_s8(0); 2]; R];
    for r in 0..R {
        // SAFETY: the input is 8 readable bytes; the load needs no alignment.
        let quads = vreinterpret_s32_s8(unsafe { vld1_s8(inputs[r].as_ptr()) });
        x[r][0] = vreinterpretq_s8_s32(vdupq_lane_s32::<0>(quads));
        x[r][1] = vreinterpretq_s8_s32(vdupq_lane_s32::<1>(quads));
    }
    let ((first, _), (second, _)) = (first.as_chunks(), second.as_chunks());
    for g in 0..REGISTERS {
        let w = [load_bytes(&first[g]), load_bytes(&second[g])];
        for r in 0..R {
            let mut low = vmull_s8(vget_low_s8(w[0]), vget_low_s8(x[r][0]));
            let mut high = vmull_high_s8(w[0], x[r][0]);
            if PAIRED {
                low = vmlal_s8(low, vget_low_s8(w[1]), vget_low_s8(x[r][1]));
                high = vmlal_high_s8(high, w[1], x[r][1]);
            } else {
                let sums = &mut acc[r][g];
                *sums = [vpadalq_s16(sums[0], low), vpadalq_s16(sums[1], high)];
                low = vmull_s8(vget_low_s8(w[1]), vget_low_s8(x[r][1]));
                high = vmull_high_s8(w[1], x[r][1]);
            }
            let sums = &mut acc[r][g];
            *sums = [vpadalq_s16(sums[0], low), vpadalq_s16(sums[1], high)];
        }
    }
}

/// Loads 16 bytes.
#[inline]
#[neon]
pub(super) fn load_bytes(src: &[i8; 16]) -> int8x16_t {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    unsafe { vld1q_s8(src.as_ptr()) }
}

/// Loads integer sums, stored as bits of floats.
#[inline]
#[neon]
pub(super) fn load_sums(src: &[f32; PANEL]) -> [int32x4_t; REGISTERS] {
    let [low, high] = load(src);
    [as_integers(low[0]), as_integers(low[1]), as_integers(high[0]), as_integers(high[1])]
}

/// Stores integer sums as bits of floats.
#[inline]
#[neon]
pub(super) fn store_sums(dst: &mut [f32; PANEL], [a, b, c, d]: [int32x4_t; REGISTERS]) {
    store(dst, [[as_floats(a), as_floats(b)], [as_floats(c), as_floats(d)]]);
}

#[inline]
#[neon]
fn as_integers(bits: float32x4_t) -> int32x4_t {
    vreinterpretq_s32_f32(bits)
}

#[inline]
#[neon]
fn as_floats(bits: int32x4_t) -> float32x4_t {
    vreinterpretq_f32_s32(bits)
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot`
/// on to floats, and applies the epilogue. The sums are stored as bits of floats.
#[neon]
pub(crate) fn dequantize_tile<'a, W: Scaled<'a>>(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &gemm::GemmTask<'_, W>,
    slot: usize,
    y: &mut MatMut<f32>,
) {
    for i in 0..width {
        let (w, p) = task.slot(slot + i);
        let outputs = p * PANEL..((p + 1) * PANEL).min(w.n());
        let mut w_scale = [0.0; PANEL];
        w_scale[..outputs.len()].copy_from_slice(&w.scale()[outputs]);
        let w_scale = load(&w_scale);
        for (t, sum) in (t..).zip(sums[i..].iter_mut().step_by(width)) {
            let x_scale = vdupq_n_f32(x.scale(t));
            let exact = load_sums(sum);
            let mut value = w_scale;
            for g in 0..REGISTERS {
                // The exact sum rounded to f32 once, then scalar's order of roundings.
                let scale = vmulq_f32(x_scale, w_scale[g / 2][g % 2]);
                value[g / 2][g % 2] = vmulq_f32(vcvtq_f32_s32(exact[g]), scale);
            }
            store(sum, value);
        }
    }
    match task {
        gemm::GemmTask::Plain(_, epilogue) => float::store_tile(sums, width, t, slot * PANEL, epilogue, y),
        gemm::GemmTask::Gated(..) => float::store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}
