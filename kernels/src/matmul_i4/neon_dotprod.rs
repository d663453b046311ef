//! As on NEON, with `sdot`, which adds four products to the sum of their output: nibbles are valid signed bytes
//! too.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::neon::{FEW_ROWS, PREFETCH_DISTANCE, ROWS, add_groups, load_quads, load_sums, nibbles, store_sums};
use super::tiles::{self, HELD_BLOCKS, Inputs, Kernel, OutputTile};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::{NeonDotprod, entry};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::matmul_i8::neon::{REGISTERS, dequantize_tile};
use crate::matmul_i8::neon_dotprod::dot;
use crate::pack::{BLOCK, GROUP, PANEL, PackedI4, Span, spans};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::aarch64::*;
use umo_kernels_features::neon_dotprod;

/// The multiplication for one number of rows.
type Multiply = unsafe fn(&Inputs<[i8; GROUP], ROWS>, &[[u8; BLOCK]], &mut [[i32; PANEL]]);

entry! {
    pub(super) fn matmul(token: NeonDotprod, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(token: NeonDotprod, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: NeonDotprod) -> Tiling {
    tiles::tiling(&[1, FEW_ROWS, ROWS])
}

impl Kernel<ROWS> for NeonDotprod {
    type Group = [i8; GROUP];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> [i8; GROUP] {
        *inputs
    }

    fn multiply(self, inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
        let multiply: Multiply = match sums.len() {
            1 => dots::<1, REGISTERS>,
            2 => dots::<FEW_ROWS, REGISTERS>,
            3 => dots::<3, 2>,
            ROWS => dots::<ROWS, 2>,
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

/// Adds the products of `R` rows with `H` registers of a panel at a time, four by four. Kept out of line, so
/// that it has all registers.
#[inline(never)]
#[neon_dotprod]
fn dots<const R: usize, const H: usize>(
    inputs: &Inputs<[i8; GROUP], ROWS>,
    weights: &[[u8; BLOCK]],
    sums: &mut [[i32; PANEL]],
) {
    assert!(weights.len() <= HELD_BLOCKS && sums.len() == R);
    for first in (0..REGISTERS).step_by(H) {
        let mut totals = load_sums::<R, H>(sums, first);
        for Span { first_group, multipliers, groups } in spans(weights) {
            for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
                let mut group = [[vdupq_n_s32(0); H]; R];
                for r in 0..R {
                    group[r] = [vdupq_n_s32(inputs.start[r][g]); H];
                }
                for (j, block) in blocks.iter().enumerate() {
                    if R == 1 {
                        prefetch::to_l1((&raw const *block).wrapping_add(PREFETCH_DISTANCE));
                    }
                    let mut x = [vdupq_n_s8(0); R];
                    for r in 0..R {
                        x[r] = load_quads(&inputs.groups[r][g].as_chunks().0[j]);
                    }
                    for h in 0..H {
                        let (low, high) = nibbles(block, first + h);
                        for r in 0..R {
                            group[r][h] = dot::<0>(group[r][h], low, x[r]);
                            group[r][h] = dot::<1>(group[r][h], high, x[r]);
                        }
                    }
                }
                add_groups(&mut totals, &group, multipliers, first);
            }
        }
        store_sums(sums, first, &totals);
    }
}
