//! Nibbles are unsigned bytes, so that `vpdpbusd` adds up their products with inputs as they are; and one
//! `vpmulld` per group multiplies its sums by the multipliers.
//!
//! ```text
//! a block              o0 o0 o0 o0 o1 .. o15    64 bytes, two codes each: low nibbles one register, high another
//! times inputs          0  1  2  3  0 ..  3     the same four in every output
//! ```
//! A nibble is its code plus 8: a group's sums start at -8 times those of its inputs.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::avx2::dequantize_tile;
use super::tiles::{self, GROUPS, Inputs, Kernel};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, GROUP_BLOCKS, PANEL, PackedI4, QUAD};
use crate::prefetch;
use crate::tiling::Tiling;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Rows of the largest tile: 8 rows x 1 panel are 16 registers of a group's sums and 8 of all, which leaves 8
/// for codes and a mask.
const ROWS: usize = 8;
/// Prefetch distance in blocks: 4 KiB, into L2, with which a Zen 4 takes less time than into L1.
const PREFETCH_DISTANCE: usize = 64;

/// The multiplication of some number of rows.
type Multiply = unsafe fn(&Inputs<[i8; GROUP], ROWS>, &[[u8; PANEL]], &[[u8; BLOCK]], &mut [[i32; PANEL]]);

entry! {
    pub(super) fn matmul(token: Avx512Vnni, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>) {
        tiles::run(token, &x, &GemmTask::Plain(w, epilogue), y);
    }

    pub(super) fn matmul_gated(token: Avx512Vnni, x: QuantInput, gate: PackedI4, up: PackedI4, y: MatMut<f32>) {
        tiles::run(token, &x, &GemmTask::Gated(gate, up), y);
    }
}

/// Where the loops change.
pub(super) fn tiling(_token: Avx512Vnni) -> Tiling {
    tiles::tiling(&[1, ROWS])
}

impl Kernel<ROWS> for Avx512Vnni {
    type Group = [i8; GROUP];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> [i8; GROUP] {
        *inputs
    }

    fn multiply(
        self,
        inputs: &Inputs<[i8; GROUP], ROWS>,
        multipliers: &[[u8; PANEL]],
        blocks: &[[u8; BLOCK]],
        sums: &mut [[i32; PANEL]],
    ) {
        let multiply: Multiply = match sums.len() {
            1 => panel::<1>,
            2 => panel::<2>,
            3 => panel::<3>,
            4 => panel::<4>,
            5 => panel::<5>,
            6 => panel::<6>,
            7 => panel::<7>,
            ROWS => panel::<ROWS>,
            rows => unreachable!("a tile of {rows} rows"),
        };
        // SAFETY: the token exists only where the processor has the function's features.
        unsafe { multiply(inputs, multipliers, blocks, sums) }
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
        // SAFETY: as above.
        unsafe { dequantize_tile(x, t, sums, width, task, slot, y) }
    }
}

/// Adds the products of `R` rows with a panel. Kept out of line, so that all registers are its own.
#[inline(never)]
#[avx512vnni]
fn panel<const R: usize>(
    inputs: &Inputs<[i8; GROUP], ROWS>,
    multipliers: &[[u8; PANEL]],
    blocks: &[[u8; BLOCK]],
    sums: &mut [[i32; PANEL]],
) {
    let (groups, _) = blocks.as_chunks::<GROUP_BLOCKS>();
    assert!(groups.len() <= GROUPS && multipliers.len() == groups.len() && sums.len() == R);
    let nibbles = _mm512_set1_epi8(15);
    let mut totals = [_mm512_setzero_si512(); R];
    for (g, (blocks, multipliers)) in groups.iter().zip(multipliers).enumerate() {
        // Sums of the low and of the high nibbles: one row has two chains of additions.
        let mut group = [[_mm512_setzero_si512(); 2]; R];
        for r in 0..R {
            group[r][0] = _mm512_set1_epi32(inputs.start[r][g]);
        }
        for (j, block) in blocks.iter().enumerate() {
            prefetch::to_l2((&raw const *block).wrapping_add(PREFETCH_DISTANCE));
            // SAFETY: a block is 64 readable bytes; the load needs no alignment.
            let both = unsafe { _mm512_loadu_si512(block.as_ptr().cast()) };
            let low = _mm512_and_si512(both, nibbles);
            let high = _mm512_and_si512(_mm512_srli_epi16::<4>(both), nibbles);
            for r in 0..R {
                let (quads, _) = inputs.groups[r][g].as_chunks::<QUAD>();
                group[r][0] = _mm512_dpbusd_epi32(group[r][0], low, splat(&quads[2 * j]));
                group[r][1] = _mm512_dpbusd_epi32(group[r][1], high, splat(&quads[2 * j + 1]));
            }
        }
        // SAFETY: `multipliers` is 16 readable bytes; the load needs no alignment.
        let m = _mm512_cvtepi8_epi32(unsafe { _mm_loadu_si128(multipliers.as_ptr().cast()) });
        for r in 0..R {
            let group = _mm512_add_epi32(group[r][0], group[r][1]);
            totals[r] = _mm512_add_epi32(totals[r], _mm512_mullo_epi32(group, m));
        }
    }
    for (sums, total) in sums.iter_mut().zip(totals) {
        // SAFETY: the sums of a panel are 64 readable bytes; the load needs no alignment.
        let before = unsafe { _mm512_loadu_si512(sums.as_ptr().cast()) };
        let sum = _mm512_add_epi32(before, total);
        // SAFETY: and writable.
        unsafe { _mm512_storeu_si512(sums.as_mut_ptr().cast(), sum) };
    }
}

/// A quad of inputs for every output.
#[inline]
#[avx512vnni]
fn splat(quad: &[i8; QUAD]) -> __m512i {
    _mm512_set1_epi32(i32::from_le_bytes(quad.map(i8::cast_unsigned)))
}
