//! Nibbles times bytes, summed per group, and one `mla` per group by its multipliers.
//!
//! ```text
//! a quarter of a block  o0 o0 o0 o0 o1 .. o3    16 bytes, two codes each: low nibbles one register, high another
//! times inputs           0  1  2  3  0 ..  3    the same four in every output
//! ```
//! `smlal` accumulates products in words: a nibble has 4 bits, so that a word holds the 8 products of a group
//! (8 * 15 * 128), and also the sum of two such words.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::tiles::{self, HELD_BLOCKS, Inputs, Kernel, OutputTile};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::{Neon, entry};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::matmul_i8::neon::{REGISTERS, dequantize_tile};
use crate::pack::{BLOCK, GROUP, PANEL, PackedI4, QUAD, Span, spans};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::aarch64::*;
use umo_kernels_features::neon;

/// Rows of the largest tile.
pub(super) const ROWS: usize = 4;
/// Rows of the largest tile that multiplies a whole panel at a time.
pub(super) const FEW_ROWS: usize = 2;
/// Prefetch distance in blocks for one row, whose weights are read once, from memory.
pub(super) const PREFETCH_DISTANCE: usize = 16;

/// Sums of `H` registers of a panel for `R` rows.
pub(super) type Sums<const R: usize, const H: usize> = [[int32x4_t; H]; R];

/// The multiplication for one number of rows.
type Multiply = unsafe fn(&Inputs<[i8; GROUP], ROWS>, &[[u8; BLOCK]], &mut [[i32; PANEL]]);

entry! {
    pub(super) fn matmul(token: Neon, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(token: Neon, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Neon) -> Tiling {
    tiles::tiling(&[1, FEW_ROWS, ROWS])
}

impl Kernel<ROWS> for Neon {
    type Group = [i8; GROUP];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> [i8; GROUP] {
        *inputs
    }

    fn multiply(self, inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
        let multiply: Multiply = match sums.len() {
            1 => words::<1, REGISTERS>,
            2 => words::<FEW_ROWS, REGISTERS>,
            3 => words::<3, 2>,
            ROWS => words::<ROWS, 2>,
            rows => unreachable!("a tile of {rows} rows"),
        };
        // SAFETY: the token exists only if the processor has the function's features.
        unsafe { multiply(inputs, weights, sums) }
    }

    fn finish(
        self,
        x: &QuantInput,
        tile: OutputTile,
        sums: &mut [[f32; PANEL]],
        task: &GemmTask<PackedI4>,
        y: &mut MatMut<f32>,
    ) {
        // SAFETY: as above.
        unsafe { dequantize_tile(x, tile.t, sums, tile.width, task, tile.slot, y) }
    }
}

/// Adds the products of `R` rows with `H` registers of a panel at a time. Kept out of line, so that
/// it has all registers.
#[inline(never)]
#[neon]
fn words<const R: usize, const H: usize>(
    inputs: &Inputs<[i8; GROUP], ROWS>,
    weights: &[[u8; BLOCK]],
    sums: &mut [[i32; PANEL]],
) {
    assert!(weights.len() <= HELD_BLOCKS && sums.len() == R);
    for first in (0..REGISTERS).step_by(H) {
        let mut totals = load_sums::<R, H>(sums, first);
        for Span { first_group, multipliers, groups } in spans(weights) {
            for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
                let mut words = [[[vdupq_n_s16(0); 2]; H]; R];
                for (j, block) in blocks.iter().enumerate() {
                    if R == 1 {
                        prefetch::to_l1((&raw const *block).wrapping_add(PREFETCH_DISTANCE));
                    }
                    let mut x = [[vdupq_n_s8(0); 2]; R];
                    for r in 0..R {
                        let quads = vreinterpretq_s32_s8(load_quads(&inputs.groups[r][g].as_chunks().0[j]));
                        x[r][0] = vreinterpretq_s8_s32(vdupq_laneq_s32::<0>(quads));
                        x[r][1] = vreinterpretq_s8_s32(vdupq_laneq_s32::<1>(quads));
                    }
                    for h in 0..H {
                        let (low, high) = nibbles(block, first + h);
                        for r in 0..R {
                            let [mut a, mut b] = words[r][h];
                            a = vmlal_s8(a, vget_low_s8(low), vget_low_s8(x[r][0]));
                            b = vmlal_high_s8(b, low, x[r][0]);
                            a = vmlal_s8(a, vget_low_s8(high), vget_low_s8(x[r][1]));
                            b = vmlal_high_s8(b, high, x[r][1]);
                            words[r][h] = [a, b];
                        }
                    }
                }
                let mut group = [[vdupq_n_s32(0); H]; R];
                for r in 0..R {
                    let start = vdupq_n_s32(inputs.start[r][g]);
                    for h in 0..H {
                        group[r][h] = vpadalq_s16(start, vpaddq_s16(words[r][h][0], words[r][h][1]));
                    }
                }
                add_groups(&mut totals, &group, multipliers, first);
            }
        }
        store_sums(sums, first, &totals);
    }
}

/// Adds a group's sums times the multipliers of their outputs.
#[inline]
#[neon]
pub(super) fn add_groups<const R: usize, const H: usize>(
    totals: &mut Sums<R, H>,
    group: &Sums<R, H>,
    multipliers: &[u8; PANEL],
    first: usize,
) {
    let (registers, _) = multipliers.as_chunks::<{ PANEL / REGISTERS }>();
    for h in 0..H {
        let m = vdupq_n_s32(i32::from_le_bytes(registers[first + h]));
        let m = vmovl_s16(vget_low_s16(vmovl_s8(vget_low_s8(vreinterpretq_s8_s32(m)))));
        for r in 0..R {
            totals[r][h] = vmlaq_s32(totals[r][h], group[r][h], m);
        }
    }
}

/// The codes plus 8 of 4 outputs: for a quad, and for the next.
#[inline]
#[neon]
pub(super) fn nibbles(block: &[u8; BLOCK], register: usize) -> (int8x16_t, int8x16_t) {
    let (registers, _) = block.as_chunks::<{ BLOCK / REGISTERS }>();
    // SAFETY: a quarter of a block is 16 readable bytes; the load needs no alignment.
    let both = unsafe { vld1q_u8(registers[register].as_ptr()) };
    (vreinterpretq_s8_u8(vandq_u8(both, vdupq_n_u8(15))), vreinterpretq_s8_u8(vshrq_n_u8::<4>(both)))
}

/// Two quads of inputs, duplicated.
#[inline]
#[neon]
pub(super) fn load_quads(src: &[i8; 2 * QUAD]) -> int8x16_t {
    // SAFETY: `src` is 8 readable bytes; the load needs no alignment.
    let quads = unsafe { vld1_s8(src.as_ptr()) };
    vcombine_s8(quads, quads)
}

#[inline]
#[neon]
pub(super) fn load_sums<const R: usize, const H: usize>(sums: &[[i32; PANEL]], first: usize) -> Sums<R, H> {
    let mut loaded = [[vdupq_n_s32(0); H]; R];
    for r in 0..R {
        let (registers, _) = sums[r].as_chunks::<{ PANEL / REGISTERS }>();
        for h in 0..H {
            // SAFETY: a register is 4 readable sums; the load needs no alignment.
            loaded[r][h] = unsafe { vld1q_s32(registers[first + h].as_ptr()) };
        }
    }
    loaded
}

#[inline]
#[neon]
pub(super) fn store_sums<const R: usize, const H: usize>(sums: &mut [[i32; PANEL]], first: usize, values: &Sums<R, H>) {
    for r in 0..R {
        let (registers, _) = sums[r].as_chunks_mut::<{ PANEL / REGISTERS }>();
        for h in 0..H {
            // SAFETY: a register is 4 writable sums; the store needs no alignment.
            unsafe { vst1q_s32(registers[first + h].as_mut_ptr(), values[r][h]) };
        }
    }
}
