//! Four queries at a time over a tile of keys, 16 lanes along `head_dim`.
//!
//! Scores: 4 queries x 4 keys are 16 dot products in 16 registers of partial sums, which a tree of shuffles then adds up
//! to one register of 16 scores; one query takes 16 keys, two take 8, and every dot product keeps its order of additions.
//! Values: 4 queries x 64 columns are 16 registers of sums.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::Operands;
use crate::lanes::avx512vnni::{array, first_lanes, load, load_part, store, store_part};
use crate::lanes::{LANES, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::{EXP, EXP_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E};
use core::arch::x86_64::*;

/// Keys whose scores are held at once: packed keys and values of a tile and 64 columns take 32 KiB of L1.
const TILE: usize = 64;

/// Registers of one query's sums of values: 64 columns.
const COLUMNS: usize = 4;

/// Most columns of packed keys and values; wider heads are computed without packing.
const PACKED_DIM: usize = 64;

/// Fewest queries that repay the packing of keys and values.
const PACKED_QUERIES: usize = 8;

/// Queries that share one packing: their softmaxes take 10 KiB.
const BLOCK: usize = 128;

/// Scores of a tile, then weights, for `Q` queries. Aligned, as [`Packed`] is, so that no load crosses a cache line.
#[repr(align(64))]
struct Weights<const Q: usize>([[f32; TILE]; Q]);

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn attention(x: Operands, mut y: MatMut<f32>) {
    let mut i = 0;
    if x.q.rows() >= PACKED_QUERIES && x.q.cols() <= PACKED_DIM {
        let packed = x.q.rows() / 4 * 4;
        while i < packed {
            let count = BLOCK.min(packed - i);
            block(x, i, count, &mut y);
            i += count;
        }
    }
    while i < x.q.rows() {
        i += match x.q.rows() - i {
            1 => group::<1, 16>(x, i, &mut y),
            2 | 3 => group::<2, 8>(x, i, &mut y),
            _ => group::<4, 4>(x, i, &mut y),
        };
    }
}

/// A tile of keys, transposed, and of values, dense: neither strides across the sets of L1 as the projections do.
#[repr(align(64))]
struct Packed {
    /// `[head_dim, TILE]`.
    k: [[f32; TILE]; PACKED_DIM],
    /// `[TILE, head_dim]`.
    v: [f32; TILE * PACKED_DIM],
}

/// `count` queries from `i` on, a multiple of 4 and at most [`BLOCK`], tile by tile of packed keys and values.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn block(x: Operands, i: usize, count: usize, y: &mut MatMut<f32>) {
    let dim = x.q.cols();
    let mut packed = Packed { k: [[0.0; TILE]; PACKED_DIM], v: [0.0; TILE * PACKED_DIM] };
    let mut weights = Weights([[0.0; TILE]; 4]);
    let mut pairs = [[[_mm512_setzero_ps(); 2]; 4]; 8];
    let mut softmaxes = [[Softmax::START; 4]; BLOCK / 4];
    let keys = x.keys(i + count - 1);
    for first in (0..keys).step_by(TILE) {
        let range = first..keys.min(first + TILE);
        pack_keys(x.k.row_range(range.clone()), &mut packed.k);
        for j in range.clone() {
            let to = &mut packed.v[(j - first) * dim..][..dim];
            for (to, from) in to.chunks_mut(LANES).zip(x.v.row(j).chunks(LANES)) {
                store_part(to, load_part(from));
            }
        }
        let v = Mat::new(&packed.v, range.len(), dim).expect("at most `TILE` rows of at most `PACKED_DIM` columns");
        for (group, softmaxes) in softmaxes[..count / 4].iter_mut().enumerate() {
            let i = i + 4 * group;
            if x.keys(i + 3) > first {
                packed_scores(x.q.row_range(i..i + 4), &packed.k, &mut pairs, &mut weights);
                weighted(x, i, first, v, softmaxes, &mut weights, y);
            }
        }
    }
    for (r, softmax) in softmaxes.as_flattened()[..count].iter().enumerate() {
        softmax.finish(y.row_mut(i + r));
    }
}

/// Transposes the rows of `k` into the columns of `packed`; columns beyond keep what they hold.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn pack_keys(k: Mat<f32>, packed: &mut [[f32; TILE]; PACKED_DIM]) {
    for first in (0..k.rows()).step_by(LANES) {
        for d in (0..k.cols()).step_by(LANES) {
            let mut rows = [_mm512_setzero_ps(); LANES];
            for j in 0..LANES {
                if first + j < k.rows() {
                    rows[j] = load_part(&k.row(first + j)[d..]);
                }
            }
            for (column, to) in transpose(rows).iter().zip(&mut packed[d..k.cols().min(d + LANES)]) {
                store_part(&mut to[first..first + LANES], *column);
            }
        }
    }
}

/// Rows to columns.
#[inline]
#[target_feature(enable = "avx512f")]
pub(super) fn transpose(rows: [__m512; LANES]) -> [__m512; LANES] {
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

/// Sums for 4 queries x 2 registers of keys.
type Sums = [[__m512; 2]; 4];

/// The pairs of partial sums, each named by its first, so that neighbours are what [`pairwise`] adds next.
const ORDER: [usize; 8] = [0, 4, 2, 6, 1, 5, 3, 7];

/// The dot products of 4 queries with a packed tile, lanes along the keys. Each partial sum of [`scores`] is here one
/// chain of multiply-adds, and the chains are added in the same tree, so that the bits are the same. `pairs` is scratch.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn packed_scores(q: Mat<f32>, k: &[[f32; TILE]; PACKED_DIM], pairs: &mut [Sums; 8], weights: &mut Weights<4>) {
    let mut padded = [[0.0; PACKED_DIM]; 4];
    if q.cols() < PACKED_DIM {
        for r in 0..4 {
            padded[r][..q.cols()].copy_from_slice(q.row(r));
        }
    }
    let mut rows = [&padded[0]; 4];
    for r in 0..4 {
        rows[r] = q.row(r).first_chunk().unwrap_or(&padded[r]);
    }
    for tile in 0..TILE / (2 * LANES) {
        for (pair, &lane) in pairs.iter_mut().zip(&ORDER) {
            // 4 queries x 2 registers of keys: 8 sums at a time, and 8 that wait for them.
            let mut chains = [[[_mm512_setzero_ps(); 2]; 4]; 2];
            for side in 0..2 {
                for c in 0..PACKED_DIM / LANES {
                    let d = lane + 8 * side + c * LANES;
                    let keys = k[d].as_chunks().0;
                    let (a, b) = (load(&keys[2 * tile]), load(&keys[2 * tile + 1]));
                    for r in 0..4 {
                        let q = _mm512_set1_ps(rows[r][d]);
                        chains[side][r][0] = _mm512_fmadd_ps(q, a, chains[side][r][0]);
                        chains[side][r][1] = _mm512_fmadd_ps(q, b, chains[side][r][1]);
                    }
                }
            }
            for r in 0..4 {
                pair[r][0] = _mm512_add_ps(chains[0][r][0], chains[1][r][0]);
                pair[r][1] = _mm512_add_ps(chains[0][r][1], chains[1][r][1]);
            }
        }
        for r in 0..4 {
            let to = weights.0[r].as_chunks_mut().0;
            for side in 0..2 {
                let mut p = [_mm512_setzero_ps(); 8];
                for i in 0..8 {
                    p[i] = pairs[i][r][side];
                }
                let (a, b) = (_mm512_add_ps(p[0], p[1]), _mm512_add_ps(p[2], p[3]));
                let (c, d) = (_mm512_add_ps(p[4], p[5]), _mm512_add_ps(p[6], p[7]));
                store(&mut to[2 * tile + side], _mm512_add_ps(_mm512_add_ps(a, b), _mm512_add_ps(c, d)));
            }
        }
    }
}

/// The `Q` queries from `i` on, over all their keys; returns `Q`. `y` holds the sums of values times `exp(score - max)`
/// until the end. Scores are made `K = 16 / Q` keys at a time.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn group<const Q: usize, const K: usize>(x: Operands, i: usize, y: &mut MatMut<f32>) -> usize {
    let mut weights = Weights([[0.0; TILE]; Q]);
    let mut softmaxes = [Softmax::START; Q];
    // A later query sees at least the keys of an earlier one.
    let keys = x.keys(i + Q - 1);
    for first in (0..keys).step_by(TILE) {
        let range = first..keys.min(first + TILE);
        scores::<Q, K>(x, i, x.k.row_range(range.clone()), &mut weights);
        weighted(x, i, first, x.v.row_range(range), &mut softmaxes, &mut weights, y);
    }
    for (r, softmax) in softmaxes.iter().enumerate() {
        softmax.finish(y.row_mut(i + r));
    }
    Q
}

/// Turns the scores of the tile of keys from `first` on into weights, and adds the tile's values to the rows of `y`.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn weighted<const Q: usize>(
    x: Operands,
    i: usize,
    first: usize,
    v: Mat<f32>,
    softmaxes: &mut [Softmax; Q],
    weights: &mut Weights<Q>,
    y: &mut MatMut<f32>,
) {
    let mut seen = [0; Q];
    for r in 0..Q {
        seen[r] = x.keys(i + r).saturating_sub(first).min(v.rows());
    }
    let shrink = weigh(x, i, first, seen, softmaxes, weights);
    values(&weights.0, 0, v.row_range(0..seen[0]), shrink, i, y);
    for r in 1..Q {
        if seen[r] > seen[0] {
            let v = v.row_range(seen[0]..seen[r]);
            values(core::array::from_ref(&weights.0[r]), seen[0], v, [1.0], i + r, y);
        }
    }
}

/// The dot products of `Q` queries with every key of `k`; up to `K - 1` more, of no meaning, follow them.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn scores<const Q: usize, const K: usize>(x: Operands, i: usize, k: Mat<f32>, weights: &mut Weights<Q>) {
    let chunks = x.q.cols() / LANES;
    for first in (0..k.rows()).step_by(K) {
        let mut sums = [[_mm512_setzero_ps(); K]; Q];
        let (mut q_rows, mut q_tails) = ([[].as_slice(); Q], [[].as_slice(); Q]);
        let (mut k_rows, mut k_tails) = ([[].as_slice(); K], [[].as_slice(); K]);
        for r in 0..Q {
            let (row, tail) = x.q.row(i + r).as_chunks();
            (q_rows[r], q_tails[r]) = (&row[..chunks], tail);
        }
        for j in 0..K {
            // Past the end, the last key stands in.
            let (row, tail) = k.row((first + j).min(k.rows() - 1)).as_chunks();
            (k_rows[j], k_tails[j]) = (&row[..chunks], tail);
        }
        for c in 0..chunks {
            let mut q = [_mm512_setzero_ps(); Q];
            for r in 0..Q {
                q[r] = load(&q_rows[r][c]);
            }
            for j in 0..K {
                let k = load(&k_rows[j][c]);
                for r in 0..Q {
                    sums[r][j] = _mm512_fmadd_ps(q[r], k, sums[r][j]);
                }
            }
        }
        if chunks * LANES < x.q.cols() {
            for j in 0..K {
                let k = load_part(k_tails[j]);
                for r in 0..Q {
                    sums[r][j] = _mm512_fmadd_ps(load_part(q_tails[r]), k, sums[r][j]);
                }
            }
        }
        let mut flat = [_mm512_setzero_ps(); LANES];
        for r in 0..Q {
            for j in 0..K {
                flat[r * K + j] = sums[r][j];
            }
        }
        let sums = array(sums_of(flat));
        for (weights, sums) in weights.0.iter_mut().zip(sums.as_chunks::<K>().0) {
            weights[first..first + K].copy_from_slice(sums);
        }
    }
}

/// The sum of each of 16 registers, `sums[i]` in lane `i`, each added pairwise as [`pairwise`] does.
#[target_feature(enable = "avx512f")]
fn sums_of(sums: [__m512; LANES]) -> __m512 {
    // Four rounds halve the registers: [8 lanes of a, b], [4 of a, b, c, d], [2 of each in every 128 bits], ...
    let mut eight = [_mm512_setzero_ps(); 8];
    for t in 0..8 {
        // The rounds would leave register `f` in lane `f % 4 * 4 + f / 4`; so `f` takes what belongs there.
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

/// One query's softmax so far.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    /// Sum of the weights, in lanes.
    sum: [f32; LANES],
}

impl Softmax {
    /// Before the first tile.
    const START: Self = Self { max: f32::NEG_INFINITY, sum: [0.0; LANES] };

    /// Divides the sums of weighted values by the sum of weights.
    #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
    fn finish(&self, y: &mut [f32]) {
        let sum = pairwise(self.sum);
        y.iter_mut().for_each(|y| *y /= sum);
    }
}

/// Turns the first `seen[r]` dot products of query `i + r` into weights `exp(score - max)`; returns the factors for what
/// the queries have summed up before: 0 in the first tile.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn weigh<const Q: usize>(
    x: Operands,
    i: usize,
    first: usize,
    seen: [usize; Q],
    softmaxes: &mut [Softmax; Q],
    weights: &mut Weights<Q>,
) -> [f32; Q] {
    // The queries' steps are independent of each other: none waits for another's maximum.
    let (mut before, mut after) = ([0.0; LANES], [0.0; LANES]);
    for r in 0..Q {
        before[r] = softmaxes[r].max;
        after[r] = score(&mut weights.0[r], seen[r], before[r], x.scale, x.bias(i + r, first));
        softmaxes[r].max = after[r];
    }
    let shrink = array(exp(_mm512_sub_ps(load(&before), load(&after))));
    let mut result = [0.0; Q];
    for r in 0..Q {
        let max = _mm512_set1_ps(after[r]);
        let mut sum = _mm512_mul_ps(load(&softmaxes[r].sum), _mm512_set1_ps(shrink[r]));
        for register in &mut weights.0[r].as_chunks_mut::<LANES>().0[..seen[r].div_ceil(LANES)] {
            let weight = exp(_mm512_sub_ps(load(register), max));
            sum = _mm512_add_ps(sum, weight);
            store(register, weight);
        }
        store(&mut softmaxes[r].sum, sum);
        result[r] = shrink[r];
    }
    result
}

/// Turns the first `seen` dot products into scores, hides the rest of their last register, and returns the largest.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn score(weights: &mut [f32; TILE], seen: usize, max: f32, scale: f32, bias: &[f32]) -> f32 {
    let mut largest = _mm512_set1_ps(max);
    let hidden = _mm512_set1_ps(f32::NEG_INFINITY);
    for (c, register) in weights.as_chunks_mut().0[..seen.div_ceil(LANES)].iter_mut().enumerate() {
        let bias = load_part(bias.get(c * LANES..).unwrap_or(&[]));
        let score = _mm512_fmadd_ps(load(register), _mm512_set1_ps(scale), bias);
        let score = _mm512_mask_blend_ps(first_lanes(seen - c * LANES), hidden, score);
        largest = _mm512_max_ps(largest, score);
        store(register, score);
    }
    _mm512_reduce_max_ps(largest)
}

/// `e^x` of differences from a maximum, fused: within 1 unit of the last place, 0 below -87.33.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn exp(x: __m512) -> __m512 {
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(x, _mm512_set1_ps(EXP_MIN));
    let n = _mm512_roundscale_ps::<0>(_mm512_mul_ps(x, _mm512_set1_ps(LOG2_E)));
    let r = _mm512_fnmadd_ps(n, _mm512_set1_ps(LN_2_HIGH), x);
    let r = _mm512_fnmadd_ps(n, _mm512_set1_ps(LN_2_LOW), r);
    let mut tail = _mm512_set1_ps(EXP[0]);
    for &c in &EXP[1..] {
        tail = _mm512_fmadd_ps(tail, r, _mm512_set1_ps(c));
    }
    let power = _mm512_fmadd_ps(tail, _mm512_mul_ps(r, r), r);
    _mm512_maskz_scalef_ps(normal, _mm512_add_ps(power, _mm512_set1_ps(1.0)), n)
}

/// `y[i + r] = y[i + r] * shrink[r] + sum_j weights[r][from + j] * v[j]`.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn values<const Q: usize>(
    weights: &[[f32; TILE]; Q],
    from: usize,
    v: Mat<f32>,
    shrink: [f32; Q],
    i: usize,
    y: &mut MatMut<f32>,
) {
    let mut column = 0;
    while column < v.cols() {
        column += match v.cols() - column {
            1..LANES => columns::<Q, 1, true>(weights, from, v, shrink, i, column, y),
            LANES..64 => columns::<Q, 1, false>(weights, from, v, shrink, i, column, y),
            _ => columns::<Q, COLUMNS, false>(weights, from, v, shrink, i, column, y),
        };
    }
}

/// `C` registers of columns from `column` on, or (`PART`) what is left of one; returns the columns done.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn columns<const Q: usize, const C: usize, const PART: bool>(
    weights: &[[f32; TILE]; Q],
    from: usize,
    v: Mat<f32>,
    shrink: [f32; Q],
    i: usize,
    column: usize,
    y: &mut MatMut<f32>,
) -> usize {
    let end = v.cols().min(column + C * LANES);
    let mut sums = [[_mm512_setzero_ps(); C]; Q];
    for r in 0..Q {
        // Nothing has been summed up before the first tile.
        if shrink[r] != 0.0 {
            let y = &y.row(i + r)[column..end];
            for c in 0..C {
                sums[r][c] = _mm512_mul_ps(load_part(&y[c * LANES..]), _mm512_set1_ps(shrink[r]));
            }
        }
    }
    for j in 0..v.rows() {
        let row = &v.row(j)[column..end];
        let mut values = [_mm512_setzero_ps(); C];
        if PART {
            values[0] = load_part(row);
        } else {
            let row: &[[f32; LANES]; C] = row.as_chunks().0.first_chunk().expect("`C` registers of columns are left");
            for c in 0..C {
                values[c] = load(&row[c]);
            }
        }
        for r in 0..Q {
            let weight = _mm512_set1_ps(weights[r][from + j]);
            for c in 0..C {
                sums[r][c] = _mm512_fmadd_ps(weight, values[c], sums[r][c]);
            }
        }
    }
    for r in 0..Q {
        let y = &mut y.row_mut(i + r)[column..end];
        for c in 0..C {
            let to = &mut y[c * LANES..];
            store_part(to, sums[r][c]);
        }
    }
    end - column
}
