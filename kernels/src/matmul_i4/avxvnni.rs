//! As on AVX-512 (see its module), in registers of half a panel: nibbles are unsigned bytes, so that `vpdpbusd`
//! sums their products with unmodified inputs.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::avx2::dequantize_tile;
use super::tiles::{self, HELD_BLOCKS, Inputs, Kernel, OutputTile};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::{AvxVnni, entry};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, PANEL, PackedI4, QUAD, Span, spans};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avxvnni;

/// Rows of the largest tile: 4 rows of a half panel are 8 registers of a group's sums and 4 of totals, which leaves 4
/// for codes and a mask.
const ROWS: usize = 4;
/// Outputs of a register.
const OUTPUTS: usize = 8;
/// Prefetch distance in blocks.
const PREFETCH_DISTANCE: usize = 64;

/// The multiplication for one number of rows.
type Multiply = unsafe fn(&Inputs<[i8; GROUP], ROWS>, &[[u8; BLOCK]], &mut [[i32; PANEL]]);

entry! {
    pub(super) fn matmul(token: AvxVnni, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(token: AvxVnni, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>, _tuning: Tuning) {
        tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: AvxVnni) -> Tiling {
    tiles::tiling(&[1, ROWS])
}

impl Kernel<ROWS> for AvxVnni {
    type Group = [i8; GROUP];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> [i8; GROUP] {
        *inputs
    }

    fn multiply(self, inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
        let multiply: Multiply = match sums.len() {
            1 => panel::<1>,
            2 => panel::<2>,
            3 => panel::<3>,
            ROWS => panel::<ROWS>,
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

/// Adds the products of `R` rows with each half of a panel in turn. Kept out of line, so that
/// it has all registers.
#[inline(never)]
#[avxvnni]
fn panel<const R: usize>(inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
    assert!(weights.len() <= HELD_BLOCKS && sums.len() == R);
    let nibbles = _mm256_set1_epi8(15);
    for half in 0..PANEL / OUTPUTS {
        let mut totals = [_mm256_setzero_si256(); R];
        for Span { first_group, multipliers, groups } in spans(weights) {
            for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
                // Sums of the low and of the high nibbles, so that one row has two chains of additions.
                let mut group = [[_mm256_setzero_si256(); 2]; R];
                for r in 0..R {
                    group[r][0] = _mm256_set1_epi32(inputs.start[r][g]);
                }
                for (j, block) in blocks.iter().enumerate() {
                    if half == 0 {
                        prefetch::to_l1((&raw const *block).wrapping_add(PREFETCH_DISTANCE));
                    }
                    let (halves, _) = block.as_chunks::<{ OUTPUTS * QUAD }>();
                    // SAFETY: half a block is 32 readable bytes; the load needs no alignment.
                    let both = unsafe { _mm256_loadu_si256(halves[half].as_ptr().cast()) };
                    let low = _mm256_and_si256(both, nibbles);
                    let high = _mm256_and_si256(_mm256_srli_epi16::<4>(both), nibbles);
                    for r in 0..R {
                        let (quads, _) = inputs.groups[r][g].as_chunks::<QUAD>();
                        group[r][0] = _mm256_dpbusd_avx_epi32(group[r][0], low, splat(&quads[2 * j]));
                        group[r][1] = _mm256_dpbusd_avx_epi32(group[r][1], high, splat(&quads[2 * j + 1]));
                    }
                }
                let (multipliers, _) = multipliers.as_chunks::<OUTPUTS>();
                // SAFETY: half of the multipliers is 8 readable bytes; the load needs no alignment.
                let m = _mm256_cvtepi8_epi32(unsafe { _mm_loadl_epi64(multipliers[half].as_ptr().cast()) });
                for r in 0..R {
                    let group = _mm256_add_epi32(group[r][0], group[r][1]);
                    totals[r] = _mm256_add_epi32(totals[r], _mm256_mullo_epi32(group, m));
                }
            }
        }
        for (sums, total) in sums.iter_mut().zip(totals) {
            let register = sums.as_chunks_mut::<OUTPUTS>().0[half].as_mut_ptr();
            // SAFETY: half of a panel's sums is 32 readable bytes; the load needs no alignment.
            let before = unsafe { _mm256_loadu_si256(register.cast()) };
            let sum = _mm256_add_epi32(before, total);
            // SAFETY: as above, and they are writable.
            unsafe { _mm256_storeu_si256(register.cast(), sum) };
        }
    }
}

/// Broadcasts a quad of inputs to every output.
#[inline]
#[avxvnni]
fn splat(quad: &[i8; QUAD]) -> __m256i {
    _mm256_set1_epi32(i32::from_le_bytes(quad.map(i8::cast_unsigned)))
}
