//! Registers, tile shapes and shuffles for the loops of attention.

pub(super) use crate::lanes::avx2::{HALF as WIDTH, *};
pub(super) use crate::math::avx2::softmax_exp;
use core::arch::x86_64::*;
use umo_kernels_features::avx2;
pub(super) use umo_kernels_features::avx2 as features;

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
#[avx2]
pub(in crate::attention) fn transpose(rows: [Register; WIDTH]) -> [Register; WIDTH] {
    let mut pairs = rows;
    for t in 0..4 {
        let (a, b) = (rows[2 * t], rows[2 * t + 1]);
        (pairs[2 * t], pairs[2 * t + 1]) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
    }
    // `fours[4 g + c]`: of the rows `4 g ..` the columns c and 4 + c, 128 bits each.
    let mut fours = rows;
    for t in 0..4 {
        let (g, h) = (t / 2, t % 2);
        let (a, b) = (_mm256_castps_pd(pairs[4 * g + h]), _mm256_castps_pd(pairs[4 * g + 2 + h]));
        fours[4 * g + 2 * h] = _mm256_castpd_ps(_mm256_unpacklo_pd(a, b));
        fours[4 * g + 2 * h + 1] = _mm256_castpd_ps(_mm256_unpackhi_pd(a, b));
    }
    let mut columns = rows;
    for c in 0..4 {
        columns[c] = _mm256_permute2f128_ps::<0x20>(fours[c], fours[4 + c]);
        columns[4 + c] = _mm256_permute2f128_ps::<0x31>(fours[c], fours[4 + c]);
    }
    columns
}

/// The sum of each of 8 registers, `sums[i]` in lane `i`, each added pairwise as
/// [`pairwise`](crate::lanes::pairwise) does.
#[inline]
#[avx2]
pub(super) fn sums_of(sums: [Register; WIDTH]) -> Register {
    // Three rounds halve the registers: [4 lanes of a, b], [2 of a, c; of b, d], ...
    let mut four = [_mm256_setzero_ps(); 4];
    for t in 0..4 {
        let (a, b) = (sums[t], sums[4 + t]);
        four[t] = _mm256_add_ps(_mm256_permute2f128_ps::<0x20>(a, b), _mm256_permute2f128_ps::<0x31>(a, b));
    }
    let mut two = [_mm256_setzero_ps(); 2];
    for t in 0..2 {
        let (a, b) = (four[2 * t], four[2 * t + 1]);
        two[t] = _mm256_add_ps(_mm256_shuffle_ps::<0x44>(a, b), _mm256_shuffle_ps::<0xee>(a, b));
    }
    let [a, b] = two;
    _mm256_add_ps(_mm256_shuffle_ps::<0x88>(a, b), _mm256_shuffle_ps::<0xdd>(a, b))
}
