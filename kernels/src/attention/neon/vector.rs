//! Registers, tile shapes and shuffles for the loops of attention.

pub(super) use crate::lanes::neon::{HALF as WIDTH, *};
pub(super) use crate::math::neon::softmax_exp;
use core::arch::aarch64::*;
use umo_kernels_features::neon;
pub(super) use umo_kernels_features::neon as features;

/// Registers of columns per pass for one, two and four queries: 8 sums of values.
pub(super) const COLUMNS: [usize; 3] = [8, 4, 2];

/// Queries that share one packing: their softmax states take 9 KiB.
pub(super) const BLOCK: usize = 256;

/// The pairs of partial sums, each named by its first, in the order in which
/// [`pairwise`](crate::lanes::pairwise) adds neighbours.
pub(super) const ORDER: [usize; WIDTH / 2] = [0, 2, 1, 3];

/// Pairs of partial sums that are added while they are in registers: two would spill.
pub(super) const PAIRS: usize = 1;

/// Registers of a sum's lanes.
pub(super) const PARTS: usize = 1;

/// Rows to columns.
#[inline]
#[neon]
pub(in crate::attention) fn transpose(rows: [Register; WIDTH]) -> [Register; WIDTH] {
    let mut columns = rows;
    for (from, to) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
        // Columns `4 from ..` of the rows `4 to ..`.
        let mut four = [rows[0][0]; 4];
        for i in 0..4 {
            four[i] = rows[4 * to + i][from];
        }
        let four = transpose_four(four);
        for i in 0..4 {
            columns[4 * from + i][to] = four[i];
        }
    }
    columns
}

#[inline]
#[neon]
fn transpose_four([a, b, c, d]: [float32x4_t; 4]) -> [float32x4_t; 4] {
    let (even, odd) = ([vtrn1q_f32(a, b), vtrn1q_f32(c, d)], [vtrn2q_f32(a, b), vtrn2q_f32(c, d)]);
    let (low, high) = ([lower(even), lower(odd)], [upper(even), upper(odd)]);
    [low[0], low[1], high[0], high[1]]
}

/// The lower halves of two registers.
#[inline]
#[neon]
fn lower([a, b]: [float32x4_t; 2]) -> float32x4_t {
    vreinterpretq_f32_f64(vzip1q_f64(vreinterpretq_f64_f32(a), vreinterpretq_f64_f32(b)))
}

/// The upper halves of two registers.
#[inline]
#[neon]
fn upper([a, b]: [float32x4_t; 2]) -> float32x4_t {
    vreinterpretq_f32_f64(vzip2q_f64(vreinterpretq_f64_f32(a), vreinterpretq_f64_f32(b)))
}

/// The sum of each of 8 registers, `sums[i]` in lane `i`, each added pairwise as
/// [`pairwise`](crate::lanes::pairwise) does.
#[inline]
#[neon]
pub(super) fn sums_of(sums: [Register; WIDTH]) -> Register {
    // Three rounds halve the registers: 4 lanes of one sum, 2 lanes of two sums, one of four.
    let mut four = [sums[0][0]; WIDTH];
    for i in 0..WIDTH {
        four[i] = vaddq_f32(sums[i][0], sums[i][1]);
    }
    let mut two = [four[0]; WIDTH / 2];
    for i in 0..WIDTH / 2 {
        let pair = [four[2 * i], four[2 * i + 1]];
        two[i] = vaddq_f32(lower(pair), upper(pair));
    }
    [vpaddq_f32(two[0], two[1]), vpaddq_f32(two[2], two[3])]
}
