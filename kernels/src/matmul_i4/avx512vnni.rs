//! Nibbles are unsigned bytes, so that `vpdpbusd` sums their products with unmodified inputs; one
//! `vpmulld` per group multiplies the sums by the multipliers.
//!
//! ```text
//! a block              o0 o0 o0 o0 o1 .. o15    64 bytes, two codes each: low nibbles one register, high another
//! times inputs          0  1  2  3  0 ..  3     the same four in every output
//! ```
//! A nibble is its code plus 8: a group's sums start at -8 times the sums of its inputs.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::avx2::dequantize_tile;
use super::tiles::{self, GROUPS, HELD_BLOCKS, Inputs, Kernel, OutputTile, prepare};
use crate::gemm::{Epilogue, GemmTask};
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::matmul_i8::avx512vnni::end::end;
use crate::matmul_i8::input::QuantInput;
use crate::pack::{BLOCK, GROUP, GROUP_BLOCKS, PANEL, PackedI4, QUAD, Span, panels, spans};
use crate::prefetch;
use crate::tiling::Tiling;
use crate::tuning::Tuning;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// Rows of the largest tile: 8 rows x 1 panel are 16 registers of a group's sums and 8 of totals, which leaves 8
/// for codes and a mask.
const ROWS: usize = 8;
/// Most rows for which a processor with [`Tuning::own_prefetch`] is fastest without prefetches: its hardware prefetcher
/// falls behind with more.
const UNFETCHED: usize = 3;
/// Prefetch distance in blocks: 8 KiB, into L2, which is faster on a Zen 4 than 4 KiB or L1.
const PREFETCH_DISTANCE: usize = 128;

/// The multiplication for one number of rows.
type Multiply = unsafe fn(&Inputs<[i8; GROUP], ROWS>, &[[u8; BLOCK]], &mut [[i32; PANEL]]);

entry! {
    pub(super) fn matmul(token: Avx512Vnni, x: QuantInput, w: PackedI4, epilogue: Epilogue, y: MatMut<f32>, tuning: Tuning) {
        run(token, x, &GemmTask::Plain(w, epilogue), y, tuning);
    }

    pub(super) fn matmul_gated(
        token: Avx512Vnni,
        x: QuantInput,
        gate: PackedI4,
        up: PackedI4,
        y: MatMut<f32>,
        tuning: Tuning,
    ) {
        run(token, x, &GemmTask::Gated(gate, up), y, tuning);
    }
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx512Vnni) -> Tiling {
    tiles::tiling(&[1, UNFETCHED, ROWS])
}

impl Kernel<ROWS> for Avx512Vnni {
    type Group = [i8; GROUP];

    #[inline(always)]
    fn group(inputs: &[i8; GROUP]) -> [i8; GROUP] {
        *inputs
    }

    fn multiply(self, inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
        let multiply: Multiply = match sums.len() {
            1 => add_panel::<1>,
            2 => add_panel::<2>,
            3 => add_panel::<3>,
            4 => add_panel::<4>,
            5 => add_panel::<5>,
            6 => add_panel::<6>,
            7 => add_panel::<7>,
            ROWS => add_panel::<ROWS>,
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

/// Few rows, short enough to hold all their inputs at once, run with their epilogue in registers; more run in tiles.
#[avx512vnni]
fn run(token: Avx512Vnni, x: QuantInput, task: &GemmTask<PackedI4>, y: MatMut<f32>, tuning: Tuning) {
    let rows = x.rows.rows();
    if !(1..=ROWS).contains(&rows) || task.k() > GROUPS * GROUP {
        tiles::run(token, &x, task, y);
    } else if tuning.own_prefetch && rows <= UNFETCHED {
        few::<false>(&x, task, y);
    } else {
        few::<true>(&x, task, y);
    }
}

/// The product of few rows.
#[avx512vnni]
fn few<const PREFETCH: bool>(x: &QuantInput, task: &GemmTask<PackedI4>, y: MatMut<f32>) {
    match x.rows.rows() {
        1 => product::<1, PREFETCH>(x, task, y),
        2 => product::<2, PREFETCH>(x, task, y),
        3 => product::<3, PREFETCH>(x, task, y),
        4 => product::<4, PREFETCH>(x, task, y),
        5 => product::<5, PREFETCH>(x, task, y),
        6 => product::<6, PREFETCH>(x, task, y),
        7 => product::<7, PREFETCH>(x, task, y),
        ROWS => product::<ROWS, PREFETCH>(x, task, y),
        rows => unreachable!("{rows} rows"),
    }
}

/// The product of `R` rows. Kept out of line, so that it has all registers.
#[inline(never)]
#[avx512vnni]
fn product<const R: usize, const PREFETCH: bool>(x: &QuantInput, task: &GemmTask<PackedI4>, mut y: MatMut<f32>) {
    let mut inputs = Inputs { groups: [[[0; GROUP]; GROUPS]; R], start: [[0; GROUPS]; R] };
    prepare(x, (0, R), 0, |codes| *codes, &mut inputs);
    match task {
        GemmTask::Plain(..) => multiply_panels::<R, 1, PREFETCH>(x, &inputs, task, &mut y),
        GemmTask::Gated(..) => multiply_panels::<R, 2, PREFETCH>(x, &inputs, task, &mut y),
    }
}

/// Processes one panel after another; the epilogue runs for the sums of `P` panels at once.
#[inline]
#[avx512vnni]
fn multiply_panels<const R: usize, const P: usize, const PREFETCH: bool>(
    x: &QuantInput,
    inputs: &Inputs<[i8; GROUP], R>,
    task: &GemmTask<PackedI4>,
    y: &mut MatMut<f32>,
) {
    for first in (0..task.slots()).step_by(P) {
        let mut sums = [[_mm512_setzero_si512(); P]; R];
        for p in 0..P {
            let (w, number) = task.slot(first + p);
            let panel = w.panel(number);
            // Never prefetches beyond the weight's last panel.
            let last = w.panel(panels(w.n()) - 1).as_ptr();
            let ahead = panel.as_ptr().wrapping_add(PREFETCH_DISTANCE).min(last);
            let panel = multiply::<R, R, PREFETCH>(inputs, panel, ahead);
            for r in 0..R {
                sums[r][p] = panel[r];
            }
        }
        end(x, 0, &sums, task, first, y);
    }
}

/// Adds the products of `R` rows with groups of a panel to `sums`. Kept out of line, as above.
#[inline(never)]
#[avx512vnni]
fn add_panel<const R: usize>(inputs: &Inputs<[i8; GROUP], ROWS>, weights: &[[u8; BLOCK]], sums: &mut [[i32; PANEL]]) {
    assert!(sums.len() == R);
    let ahead = weights.as_ptr().wrapping_add(PREFETCH_DISTANCE);
    let totals = multiply::<R, ROWS, true>(inputs, weights, ahead);
    for (sums, total) in sums.iter_mut().zip(totals) {
        // SAFETY: the sums of a panel are 64 readable bytes; the load needs no alignment.
        let before = unsafe { _mm512_loadu_si512(sums.as_ptr().cast()) };
        let sum = _mm512_add_epi32(before, total);
        // SAFETY: as above, and they are writable.
        unsafe { _mm512_storeu_si512(sums.as_mut_ptr().cast(), sum) };
    }
}

/// The products of the first `R` of `N` rows with groups of a panel. With `PREFETCH`, prefetches the same number of
/// lines from `ahead` on.
#[inline]
#[avx512vnni]
fn multiply<const R: usize, const N: usize, const PREFETCH: bool>(
    inputs: &Inputs<[i8; GROUP], N>,
    weights: &[[u8; BLOCK]],
    mut ahead: *const [u8; BLOCK],
) -> [__m512i; R] {
    const { assert!(R <= N) };
    assert!(weights.len() <= HELD_BLOCKS);
    let (low_nibbles, high_nibbles) = (_mm512_set1_epi8(0x0f), _mm512_set1_epi8(0xf0_u8.cast_signed()));
    let mut totals = [_mm512_setzero_si512(); R];
    for Span { first_group, multipliers, groups } in spans(weights) {
        if PREFETCH {
            prefetch::to_l2(ahead);
            ahead = ahead.wrapping_add(1);
        }
        for (g, (blocks, multipliers)) in (first_group..).zip(groups.iter().zip(multipliers)) {
            // Sums of the low and of the high nibbles, so that one row has two chains of additions. With few rows,
            // high nibbles are not shifted, and so count 16 times: shifting a group's sums is cheaper than shifting
            // its blocks.
            let mut group = [[_mm512_setzero_si512(); 2]; R];
            for r in 0..R {
                group[r][0] = _mm512_set1_epi32(inputs.start[r][g]);
            }
            for (j, block) in blocks.iter().enumerate() {
                if PREFETCH {
                    prefetch::to_l2(ahead.wrapping_add(j));
                }
                // SAFETY: a block is 64 readable bytes; the load needs no alignment.
                let both = unsafe { _mm512_loadu_si512(block.as_ptr().cast()) };
                let low = _mm512_and_si512(both, low_nibbles);
                let high = if R < GROUP_BLOCKS {
                    _mm512_and_si512(both, high_nibbles)
                } else {
                    _mm512_and_si512(_mm512_srli_epi16::<4>(both), low_nibbles)
                };
                for r in 0..R {
                    let (quads, _) = inputs.groups[r][g].as_chunks::<QUAD>();
                    group[r][0] = _mm512_dpbusd_epi32(group[r][0], low, splat(&quads[2 * j]));
                    group[r][1] = _mm512_dpbusd_epi32(group[r][1], high, splat(&quads[2 * j + 1]));
                }
            }
            ahead = ahead.wrapping_add(GROUP_BLOCKS);
            // SAFETY: `multipliers` is 16 readable bytes; the load needs no alignment.
            let m = _mm512_cvtepi8_epi32(unsafe { _mm_loadu_si128(multipliers.as_ptr().cast()) });
            for r in 0..R {
                let high = if R < GROUP_BLOCKS { _mm512_srai_epi32::<4>(group[r][1]) } else { group[r][1] };
                let group = _mm512_add_epi32(group[r][0], high);
                totals[r] = _mm512_add_epi32(totals[r], _mm512_mullo_epi32(group, m));
            }
        }
    }
    totals
}

/// Broadcasts a quad of inputs to every output.
#[inline]
#[avx512vnni]
fn splat(quad: &[i8; QUAD]) -> __m512i {
    _mm512_set1_epi32(i32::from_le_bytes(quad.map(i8::cast_unsigned)))
}
