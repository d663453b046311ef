//! Bytes multiplied to 16 bits (`smull`) and added in pairs to sums of 32 (`sadalp`), which is
//! exact.
//!
//! ```text
//! a quad of a panel    o0 o0 o0 o0 o1 o1 o1 o1 | o2 .. o3     16 bytes, a register of each half's products
//! times inputs          0  1  2  3  0  1  2  3 |  0 ..  3     the same four in every output
//! adds up to             o0    o0    o1    o1  |  o2 .. o3     two sums per output, added at the end
//! ```
//! Two products fit in 16 bits unless both are `-128 * -128`: inputs without -128, which are all
//! that [`crate::quantize`] makes, are added up by two quads (`smlal`) first.

use super::input::{GemmTask, QuantInput};
use crate::gemm::neon as float;
use crate::gemm::{Epilogue, tiles};
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
pub(super) const REGISTERS: usize = 4;

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

/// Where the loops change.
pub(super) fn tiling(_token: Neon) -> Tiling {
    Tiling { rows: &[ROWS], outputs: &[PANEL, WIDTH * PANEL], inputs: &[QUAD, STEP], held: 0, chunk: 0 }
}

/// All rows pass by each pair of panels while it is in the cache.
#[neon]
fn run(x: &QuantInput, task: &GemmTask, mut y: MatMut<f32>) {
    let fits = (0..x.rows.rows()).all(|t| !contains_min(x.rows.row(t)));
    for slot in (0..task.slots()).step_by(WIDTH) {
        let width = WIDTH.min(task.slots() - slot);
        for (t, rows) in tiles(x.rows.rows(), ROWS) {
            let mut sums = [[0.0; PANEL]; ROWS * WIDTH];
            let sums = &mut sums[..rows * width];
            for i in 0..width {
                let panel = task.panel(slot + i);
                match (rows, fits) {
                    (1, true) => multiply::<1, true>(x, t, panel, &mut sums[i..], width),
                    (1, false) => multiply::<1, false>(x, t, panel, &mut sums[i..], width),
                    (ROWS, true) => multiply::<ROWS, true>(x, t, panel, &mut sums[i..], width),
                    (ROWS, false) => multiply::<ROWS, false>(x, t, panel, &mut sums[i..], width),
                    (rows, _) => unreachable!("a tile of {rows} rows"),
                }
            }
            dequantize_tile(x, t, sums, width, task, slot, &mut y);
        }
    }
}

/// Whether an input is -128.
#[neon]
fn contains_min(row: &[i8]) -> bool {
    let (chunks, tail) = row.as_chunks();
    let mut least = vdupq_n_s8(0);
    for chunk in chunks {
        least = vminq_s8(least, load_bytes(chunk));
    }
    vminvq_s8(least) == i8::MIN || tail.contains(&i8::MIN)
}

/// The innermost tile: exact sums of the rows from `t` on, `R` of them, with one panel, every
/// `width`th of `sums`. `PAIRED`: no input is -128.
#[inline(never)]
#[neon]
fn multiply<const R: usize, const PAIRED: bool>(
    x: &QuantInput,
    t: usize,
    quads: &[Quads],
    sums: &mut [[f32; PANEL]],
    width: usize,
) {
    let k = x.rows.cols();
    let (pairs, last) = quads.as_chunks::<2>();
    assert!(quads.len() == k.div_ceil(QUAD));
    let (mut rows, mut tails) = ([&[][..]; R], [[0; STEP]; R]);
    for r in 0..R {
        let tail;
        (rows[r], tail) = x.rows.row(t + r).as_chunks::<STEP>();
        assert!(rows[r].len() == k / STEP);
        tails[r][..tail.len()].copy_from_slice(tail);
    }
    let mut acc = [[[vdupq_n_s32(0); 2]; REGISTERS]; R];
    for (c, pair) in pairs[..k / STEP].iter().enumerate() {
        let mut inputs = [&tails[0]; R];
        for r in 0..R {
            inputs[r] = &rows[r][c];
        }
        step::<R, PAIRED>(&mut acc, &inputs, pair);
    }
    if !k.is_multiple_of(STEP) {
        let mut pair = [[0; PANEL * QUAD]; 2];
        if let Some(whole) = pairs.get(k / STEP) {
            pair = *whole;
        } else {
            pair[0] = last[0];
        }
        let mut inputs = [&tails[0]; R];
        for r in 0..R {
            inputs[r] = &tails[r];
        }
        step::<R, PAIRED>(&mut acc, &inputs, &pair);
    }
    for r in 0..R {
        let mut values = [vdupq_n_s32(0); REGISTERS];
        for g in 0..REGISTERS {
            values[g] = vpaddq_s32(acc[r][g][0], acc[r][g][1]);
        }
        store_sums(&mut sums[r * width], values);
    }
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

/// 16 bytes.
#[inline]
#[neon]
pub(super) fn load_bytes(src: &[i8; 16]) -> int8x16_t {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    unsafe { vld1q_s8(src.as_ptr()) }
}

/// Integer sums, as bits of floats.
#[inline]
#[neon]
pub(super) fn load_sums(src: &[f32; PANEL]) -> [int32x4_t; REGISTERS] {
    load(src).as_flattened().first_chunk().expect("4 registers").map(|four| vreinterpretq_s32_f32(four))
}

/// Integer sums as bits of floats.
#[inline]
#[neon]
pub(super) fn store_sums(dst: &mut [f32; PANEL], sums: [int32x4_t; REGISTERS]) {
    let [a, b, c, d] = sums.map(|four| vreinterpretq_f32_s32(four));
    store(dst, [[a, b], [c, d]]);
}

/// Scales the integer sums `[rows, width]` of the rows from `t` on with the slots from `slot`
/// on to floats, and applies the epilogue. The sums are stored as bits of floats.
#[neon]
pub(super) fn dequantize_tile(
    x: &QuantInput,
    t: usize,
    sums: &mut [[f32; PANEL]],
    width: usize,
    task: &GemmTask,
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
        GemmTask::Plain(_, epilogue) => float::store_tile(sums, width, t, slot * PANEL, epilogue, y),
        GemmTask::Gated(..) => float::store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
    }
}
