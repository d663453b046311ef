//! Registers, tile shapes and shuffles for the loops of attention.

pub(super) use crate::lanes::LANES as WIDTH;
pub(super) use crate::lanes::avx512vnni::*;
pub(super) use crate::math::avx512vnni::softmax_exp;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;
pub(super) use umo_kernels_features::avx512vnni as features;

/// Registers of columns per pass for one, two and four queries: up to 16 sums of values.
pub(super) const COLUMNS: [usize; 3] = [4; 3];

/// Queries that share one packing: their softmax states take 17 KiB.
pub(super) const BLOCK: usize = 256;

/// The pairs of partial sums, each named by its first, in the order in which
/// [`pairwise`](crate::lanes::pairwise) adds neighbours.
pub(super) const ORDER: [usize; WIDTH / 2] = [0, 4, 2, 6, 1, 5, 3, 7];

/// Pairs of partial sums that are added while they are in registers.
pub(super) const PAIRS: usize = 2;

/// Registers of a sum's lanes.
pub(super) const PARTS: usize = 1;

/// Rows to columns.
#[inline]
#[avx512vnni]
pub(in crate::attention) fn transpose(rows: [Register; WIDTH]) -> [Register; WIDTH] {
    let mut pairs = rows;
    for t in 0..8 {
        let (a, b) = (rows[2 * t], rows[2 * t + 1]);
        (pairs[2 * t], pairs[2 * t + 1]) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
    }
    // `fours[4 g + c]`: of the rows `4 g ..` the columns c, 4 + c, 8 + c and 12 + c, 128 bits each.
    let mut fours = rows;
    for t in 0..8 {
        let (g, h) = (t / 2, t % 2);
        let (a, b) = (_mm512_castps_pd(pairs[4 * g + h]), _mm512_castps_pd(pairs[4 * g + 2 + h]));
        fours[4 * g + 2 * h] = _mm512_castpd_ps(_mm512_unpacklo_pd(a, b));
        fours[4 * g + 2 * h + 1] = _mm512_castpd_ps(_mm512_unpackhi_pd(a, b));
    }
    let mut columns = rows;
    for c in 0..4 {
        let (a, b, d, e) = (fours[c], fours[4 + c], fours[8 + c], fours[12 + c]);
        let (low, high) = (_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0x88>(d, e));
        columns[c] = _mm512_shuffle_f32x4::<0x88>(low, high);
        columns[8 + c] = _mm512_shuffle_f32x4::<0xdd>(low, high);
        let (low, high) = (_mm512_shuffle_f32x4::<0xdd>(a, b), _mm512_shuffle_f32x4::<0xdd>(d, e));
        columns[4 + c] = _mm512_shuffle_f32x4::<0x88>(low, high);
        columns[12 + c] = _mm512_shuffle_f32x4::<0xdd>(low, high);
    }
    columns
}

/// The sum of each of 16 registers, `sums[i]` in lane `i`, each added pairwise as
/// [`pairwise`](crate::lanes::pairwise) does.
#[inline]
#[avx512vnni]
pub(super) fn sums_of(sums: [Register; WIDTH]) -> Register {
    // Four rounds halve the registers: [8 lanes of a, b], [4 of a, b, c, d], [2 of each in every
    // 128 bits], ...
    let mut eight = [_mm512_setzero_ps(); 8];
    for t in 0..8 {
        // The rounds move register `f` to lane `f % 4 * 4 + f / 4`; the inputs are
        // permuted to undo that.
        let (a, b) = (sums[t % 2 * 8 + t / 2], sums[t % 2 * 8 + 4 + t / 2]);
        eight[t] = _mm512_add_ps(_mm512_shuffle_f32x4::<0x44>(a, b), _mm512_shuffle_f32x4::<0xee>(a, b));
    }
    let mut four = [_mm512_setzero_ps(); 4];
    for t in 0..4 {
        let (a, b) = (eight[2 * t], eight[2 * t + 1]);
        four[t] = _mm512_add_ps(_mm512_shuffle_f32x4::<0x88>(a, b), _mm512_shuffle_f32x4::<0xdd>(a, b));
    }
    let mut two = [_mm512_setzero_ps(); 2];
    for t in 0..2 {
        let (a, b) = (four[2 * t], four[2 * t + 1]);
        two[t] = _mm512_add_ps(_mm512_shuffle_ps::<0x44>(a, b), _mm512_shuffle_ps::<0xee>(a, b));
    }
    let [a, b] = two;
    _mm512_add_ps(_mm512_shuffle_ps::<0x88>(a, b), _mm512_shuffle_ps::<0xdd>(a, b))
}
