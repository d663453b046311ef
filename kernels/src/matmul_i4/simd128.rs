//! Nibbles times bytes (`i16x8.extmul`), added up in words, which hold a group's products; and one
//! `i32x4.dot_i16x8_s` per group, which multiplies the words by the group's multiplier and adds pairs of them.
//!
//! ```text
//! a quarter of a block  o0 o0 o0 o0 o1 .. o3    16 bytes, two codes each: low nibbles one register, high another
//! times inputs           0  1  2  3  0 ..  3    the same four in every output
//! words                  o0 .. o0 o1 .. o1      two registers: four sums per output, 8 products each
//! times multipliers      m0 .. m0 m1 .. m1
//! sums                     o0 o0    o1 o1       two per output, added at the end
//! ```
//! A nibble is its code plus 8, so that words start at -8 times the sums of their inputs.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::tiles::{self, GROUPS, Inputs, Kernel};
use crate::gemm::simd128::{store_gated_tile, store_tile};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::Simd128;
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::matmul_i8::simd128::dequantize;
use crate::pack::{BLOCK, GROUP, GROUP_BLOCKS, NIBBLE_OFFSET, PANEL, PackedI4, QUAD};
use crate::tiling::Tiling;
use core::arch::wasm32::*;

/// Rows of the largest tile.
const ROWS: usize = 4;
/// Rows of a tile that is bound by memory.
const FEW_ROWS: usize = 2;
/// Quarters of a block, of 4 outputs each.
const QUARTERS: usize = 4;
/// Outputs of a quarter.
const OUTPUTS: usize = PANEL / QUARTERS;

pub(super) fn matmul(token: Simd128, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>) {
    tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
}

pub(super) fn matmul_gated(token: Simd128, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>) {
    tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
}

/// Where the loops change.
pub(super) fn tiling(_token: Simd128) -> Tiling {
    tiles::tiling(&[1, FEW_ROWS, ROWS])
}

impl Kernel<ROWS> for Simd128 {
    /// Of each input of all quads of a group.
    type Start = [i16; QUAD];

    fn start(group: &[i8; GROUP]) -> [i16; QUAD] {
        let mut sums = [0; QUAD];
        for quad in group.as_chunks::<QUAD>().0 {
            sums.iter_mut().zip(quad).for_each(|(sum, &x)| *sum -= i16::from(NIBBLE_OFFSET) * i16::from(x));
        }
        sums
    }

    fn multiply(
        self,
        inputs: &Inputs<[i16; QUAD], ROWS>,
        multipliers: &[[u8; PANEL]],
        blocks: &[[u8; BLOCK]],
        sums: &mut [[i32; PANEL]],
    ) {
        // One row has registers for the words of two quarters, more rows for those of one.
        match sums.len() {
            1 => words::<1, 2>(inputs, multipliers, blocks, sums),
            2 => words::<FEW_ROWS, 1>(inputs, multipliers, blocks, sums),
            3 => words::<3, 1>(inputs, multipliers, blocks, sums),
            ROWS => words::<ROWS, 1>(inputs, multipliers, blocks, sums),
            rows => unreachable!("a tile of {rows} rows"),
        }
    }

    fn finish(
        self,
        x: &QuantInput,
        t: usize,
        sums: &mut [[f32; PANEL]],
        width: usize,
        task: &GemmTask<PackedI4>,
        slot: usize,
        y: &mut MatMut<f32>,
    ) {
        dequantize(x, t, sums, width, task, slot);
        match task {
            GemmTask::Plain(_, epilogue) => store_tile(sums, width, t, slot * PANEL, epilogue, y),
            GemmTask::Gated(..) => store_gated_tile(sums, width / 2, t, slot / 2 * PANEL, y),
        }
    }
}

/// Adds the products of `R` rows with `H` quarters of a panel at a time. Kept out of line, so that all
/// registers are its own.
#[inline(never)]
fn words<const R: usize, const H: usize>(
    inputs: &Inputs<[i16; QUAD], ROWS>,
    multipliers: &[[u8; PANEL]],
    blocks: &[[u8; BLOCK]],
    sums: &mut [[i32; PANEL]],
) {
    let (groups, _) = blocks.as_chunks::<GROUP_BLOCKS>();
    assert!(groups.len() <= GROUPS && multipliers.len() == groups.len() && sums.len() == R);
    for first in (0..QUARTERS).step_by(H) {
        let mut totals = [[[i32x4_splat(0); 2]; H]; R];
        for (g, (blocks, multipliers)) in groups.iter().zip(multipliers).enumerate() {
            let mut words = [[[i16x8_splat(0); 2]; H]; R];
            for r in 0..R {
                // SAFETY: a start is 8 readable bytes; the load needs no alignment.
                words[r] = [[unsafe { v128_load64_splat(inputs.start[r][g].as_ptr().cast()) }; 2]; H];
            }
            for (j, block) in blocks.iter().enumerate() {
                let (quarters, _) = block.as_chunks::<{ BLOCK / QUARTERS }>();
                let (mut low, mut high) = ([i8x16_splat(0); H], [i8x16_splat(0); H]);
                for h in 0..H {
                    // SAFETY: a quarter of a block is 16 readable bytes; the load needs no alignment.
                    let both = unsafe { v128_load(quarters[first + h].as_ptr().cast()) };
                    (low[h], high[h]) = (v128_and(both, i8x16_splat(15)), u8x16_shr(both, 4));
                }
                for r in 0..R {
                    let (quads, _) = inputs.groups[r][g].as_chunks::<QUAD>();
                    let (x, next) = (splat(&quads[2 * j]), splat(&quads[2 * j + 1]));
                    for h in 0..H {
                        let [mut a, mut b] = words[r][h];
                        a = i16x8_add(a, i16x8_extmul_low_i8x16(low[h], x));
                        b = i16x8_add(b, i16x8_extmul_high_i8x16(low[h], x));
                        a = i16x8_add(a, i16x8_extmul_low_i8x16(high[h], next));
                        b = i16x8_add(b, i16x8_extmul_high_i8x16(high[h], next));
                        words[r][h] = [a, b];
                    }
                }
            }
            let (m, _) = multipliers.as_chunks::<OUTPUTS>();
            for h in 0..H {
                let m = i16x8_extend_low_i8x16(i32x4_splat(i32::from_le_bytes(m[first + h])));
                let m = [i16x8_shuffle::<0, 0, 0, 0, 1, 1, 1, 1>(m, m), i16x8_shuffle::<2, 2, 2, 2, 3, 3, 3, 3>(m, m)];
                for r in 0..R {
                    for i in 0..2 {
                        totals[r][h][i] = i32x4_add(totals[r][h][i], i32x4_dot_i16x8(words[r][h][i], m[i]));
                    }
                }
            }
        }
        for r in 0..R {
            let (registers, _) = sums[r].as_chunks_mut::<OUTPUTS>();
            for h in 0..H {
                let [a, b] = totals[r][h];
                let (even, odd) = (i32x4_shuffle::<0, 2, 4, 6>(a, b), i32x4_shuffle::<1, 3, 5, 7>(a, b));
                let register = registers[first + h].as_mut_ptr();
                // SAFETY: a register is 4 readable sums; the load needs no alignment.
                let before = unsafe { v128_load(register.cast()) };
                // SAFETY: and writable.
                unsafe { v128_store(register.cast(), i32x4_add(before, i32x4_add(even, odd))) };
            }
        }
    }
}

/// A quad of inputs for every output.
#[inline(always)]
fn splat(src: &[i8; QUAD]) -> v128 {
    // SAFETY: `src` is 4 readable bytes; the load needs no alignment.
    unsafe { v128_load32_splat(src.as_ptr().cast()) }
}
