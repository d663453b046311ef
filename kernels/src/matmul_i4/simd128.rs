//! Nibbles as words, multiplied by words of inputs and added in pairs to 32-bit sums
//! (`i32x4.dot_i16x8_s`), and one multiplication of a group's sums by its multipliers.
//!
//! ```text
//! a quarter of a block  o0 o0 o0 o0 o1 .. o3    16 bytes, two codes each, as 8 words of 4 codes
//! by shift and mask     o0 o0 o1 o1 ..          4 registers of words: inputs 0 and 2, 1 and 3, 4 and 6, 5 and 7
//! times inputs           0  2  0  2 ..          the same two in every output
//! ```
//! Products of bytes (`i16x8.extmul`) would take half as many instructions, but x86 has no such instruction: 1.9
//! times as slow there.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::tiles::{self, HELD_BLOCKS, Inputs, Kernel, OutputTile};
use crate::gemm::simd128::{store_gated_tile, store_tile};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::Simd128;
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::matmul_i8::simd128::dequantize;
use crate::pack::{BLOCK, GROUP, PANEL, PackedI4, QUAD, Span, spans};
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::wasm32::*;

/// Rows of the largest tile: 3 rows x half a panel are 6 registers of sums, which leaves 6 for inputs and 4 for
/// codes.
const ROWS: usize = 3;
/// Quarters of a block, of 4 outputs each.
const QUARTERS: usize = 4;
/// Outputs of a quarter.
const OUTPUTS: usize = PANEL / QUARTERS;

pub(super) fn matmul(token: Simd128, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
    tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
}

pub(super) fn matmul_gated(
    token: Simd128,
    x: QuantInput,
    gate: PackedI4,
    up: PackedI4,
    y: MatMut<f32>,
    _tuning: Tuning,
) {
    tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Simd128) -> Tiling {
    tiles::tiling(&[1, ROWS])
}

impl Kernel<ROWS> for Simd128 {
    /// Pairs of words: inputs 0 and 2 of each quad, then 1 and 3.
    type Group = [[i16; 2]; GROUP / 2];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> Self::Group {
        let mut group = Self::Group::default();
        for (pairs, quad) in group.as_chunks_mut::<2>().0.iter_mut().zip(inputs.as_chunks::<QUAD>().0) {
            let [a, b, c, d] = quad.map(i16::from);
            *pairs = [[a, c], [b, d]];
        }
        group
    }

    fn multiply(
        self,
        inputs: &Inputs<[[i16; 2]; GROUP / 2], ROWS>,
        weights: &[[u8; BLOCK]],
        sums: &mut [[i32; PANEL]],
    ) {
        // One row has registers for the sums of a whole panel, more rows for half a panel.
        match sums.len() {
            1 => panel::<1, QUARTERS>(inputs, weights, sums),
            2 => panel::<2, 2>(inputs, weights, sums),
            ROWS => panel::<ROWS, 2>(inputs, weights, sums),
            rows => unreachable!("a tile of {rows} rows"),
        }
    }

    fn finish(
        self,
        x: &QuantInput,
        tile: OutputTile,
        sums: &mut [[f32; PANEL]],
        task: &GemmTask<PackedI4>,
        y: &mut MatMut<f32>,
    ) {
        let OutputTile { t, slot, width } = tile;
        dequantize(x, t, sums, width, task, slot);
        match task {
            GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, y),
            GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
        }
    }
}

/// Adds the products of `R` rows with `H` quarters of a panel at a time. Kept out of line, so that
/// it has all registers.
#[inline(never)]
fn panel<const R: usize, const H: usize>(
    inputs: &Inputs<[[i16; 2]; GROUP / 2], ROWS>,
    weights: &[[u8; BLOCK]],
    sums: &mut [[i32; PANEL]],
) {
    assert!(weights.len() <= HELD_BLOCKS && sums.len() == R);
    for first in (0..QUARTERS).step_by(H) {
        let mut totals = [[i32x4_splat(0); H]; R];
        for Span { first_group, multipliers, groups } in spans(weights) {
            for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
                let mut group = [[i32x4_splat(0); H]; R];
                for r in 0..R {
                    group[r] = [i32x4_splat(inputs.start[r][g]); H];
                }
                for (j, block) in blocks.iter().enumerate() {
                    let (quarters, _) = block.as_chunks::<{ BLOCK / QUARTERS }>();
                    half::<R, H, false>(&mut group, inputs, (g, 4 * j), quarters, first);
                    half::<R, H, true>(&mut group, inputs, (g, 4 * j + 2), quarters, first);
                }
                let (m, _) = multipliers.as_chunks::<OUTPUTS>();
                for h in 0..H {
                    let m = i16x8_extend_low_i8x16(i32x4_splat(i32::from_le_bytes(m[first + h])));
                    let m = i32x4_extend_low_i16x8(m);
                    for r in 0..R {
                        totals[r][h] = i32x4_add(totals[r][h], i32x4_mul(group[r][h], m));
                    }
                }
            }
        }
        for r in 0..R {
            let (registers, _) = sums[r].as_chunks_mut::<OUTPUTS>();
            for h in 0..H {
                let register = registers[first + h].as_mut_ptr();
                // SAFETY: a register is 4 readable sums; the load needs no alignment.
                let before = unsafe { v128_load(register.cast()) };
                // SAFETY: as above, and they are writable.
                unsafe { v128_store(register.cast(), i32x4_add(before, totals[r][h])) };
            }
        }
    }
}

/// Adds the products of the pairs `pair` and `pair + 1` of group `g` with the low or the `HIGH` nibbles.
#[inline(always)]
fn half<const R: usize, const H: usize, const HIGH: bool>(
    group: &mut [[v128; H]; R],
    inputs: &Inputs<[[i16; 2]; GROUP / 2], ROWS>,
    (g, pair): (usize, usize),
    quarters: &[[u8; BLOCK / QUARTERS]],
    first: usize,
) {
    let nibble = i16x8_splat(15);
    let mut x = [[i32x4_splat(0); 2]; R];
    for r in 0..R {
        x[r] = [splat(&inputs.groups[r][g][pair]), splat(&inputs.groups[r][g][pair + 1])];
    }
    for h in 0..H {
        // SAFETY: a quarter of a block is 16 readable bytes; the load needs no alignment.
        let both = unsafe { v128_load(quarters[first + h].as_ptr().cast()) };
        let (even, odd) = if HIGH {
            (v128_and(u16x8_shr(both, 4), nibble), u16x8_shr(both, 12))
        } else {
            (v128_and(both, nibble), v128_and(u16x8_shr(both, 8), nibble))
        };
        for r in 0..R {
            let products = i32x4_add(i32x4_dot_i16x8(even, x[r][0]), i32x4_dot_i16x8(odd, x[r][1]));
            group[r][h] = i32x4_add(group[r][h], products);
        }
    }
}

/// Broadcasts a pair of inputs to every output.
#[inline(always)]
fn splat(pair: &[i16; 2]) -> v128 {
    // SAFETY: a pair is 4 readable bytes; the load needs no alignment.
    unsafe { v128_load32_splat(pair.as_ptr().cast()) }
}
