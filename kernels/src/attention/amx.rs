//! 32 queries at a time over 256 keys, on tiles of bfloat16 pairs, with the accuracy of f32.
//!
//! `tdpbf16ps` multiplies 16 times as much per cycle as registers of f32 do, but takes bfloat16, with 8 bits of mantissa.
//! An f32 has 24: it is exactly the sum of three bfloat16 values, [`PARTS`]: its leading bits, the next ones and the last.
//! A product is then six: those whose size is at least 2^-16 of the largest. What is left out is below f32's own rounding.
//!
//! ```text
//!               keys or columns: tmm6 tmm7
//! queries  0..16: tmm4             tmm0 tmm1
//!         16..32: tmm5             tmm2 tmm3
//! ```
//! Scores of 32 queries stand in tiles of 16 keys; softmax turns two tiles of scores into three of the parts of weights.
//! Every query takes this road, however few there are: the bits of a row do not depend on the others.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::Operands;
use super::avx512vnni::transpose;
use crate::amx::{TILE as ROWS, Tiles};
use crate::lanes::LANES;
use crate::lanes::avx512vnni::{first_lanes, load, load_part, store, store_part};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use core::arch::x86_64::*;

/// Widest head; wider ones are left to AVX-512.
const MOST_DIM: usize = 64;
/// Fewest keys that repay the packing.
const FEWEST_KEYS: usize = 65;

/// Keys in work at once: packed keys and values take 96 KiB each of L2, scores 48 KiB.
const KEYS: usize = 256;
/// Queries whose softmaxes are kept while blocks of keys go by.
const BLOCK: usize = 512;
/// Bfloat16 values in a row of a tile: lane `i` of a register holds the values `i` and `16 + i`.
const PAIRS: usize = 2 * LANES;

/// 16 rows of 16 f32, or of 16 pairs of bfloat16, each row at home in one register.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
struct Tile([[f32; 16]; ROWS]);

impl Tile {
    const ZERO: Self = Self([[0.0; 16]; ROWS]);
}

/// What an f32 is the sum of, largest first.
const PARTS: usize = 3;
/// The parts of the same 16 x 32 values.
type Split = [Tile; PARTS];

/// Groups of 16 queries in work at once.
const GROUPS: usize = 2;

/// What one call keeps between its loops.
struct Work {
    /// By 16 keys and 32 of `head_dim`: rows of pairs, a key per column.
    k: [[Split; MOST_DIM / PAIRS]; KEYS / ROWS],
    /// By 32 keys and 16 of `head_dim`: rows of pairs of keys.
    v: [[Split; MOST_DIM / LANES]; KEYS / PAIRS],
    /// By 16 queries and 32 of `head_dim`.
    q: [[Split; MOST_DIM / PAIRS]; GROUPS],
    /// By 16 queries and 32 keys: two tiles of scores, then the parts of their weights.
    scores: [[Split; KEYS / PAIRS]; GROUPS],
    /// By 16 queries and 16 of `head_dim`: values summed up over these keys.
    sums: [[Tile; MOST_DIM / LANES]; GROUPS],
}

/// One query's softmax so far.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    sum: f32,
}

/// Whether tiles are faster: a question of the keys and their width, never of the number of queries.
pub(super) fn pays(x: &Operands<f32>) -> bool {
    x.k.rows() >= FEWEST_KEYS && x.k.cols() <= MOST_DIM
}

#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn attention(x: Operands<f32>, mut y: MatMut<f32>) {
    // SAFETY: the dispatch leads here from `Backend::Amx` alone.
    let tiles = &unsafe { Tiles::new() };
    let mut work = Work {
        k: [[[Tile::ZERO; PARTS]; MOST_DIM / PAIRS]; KEYS / ROWS],
        v: [[[Tile::ZERO; PARTS]; MOST_DIM / LANES]; KEYS / PAIRS],
        q: [[[Tile::ZERO; PARTS]; MOST_DIM / PAIRS]; GROUPS],
        scores: [[[Tile::ZERO; PARTS]; KEYS / PAIRS]; GROUPS],
        sums: [[Tile::ZERO; MOST_DIM / LANES]; GROUPS],
    };
    for start in (0..x.q.rows()).step_by(BLOCK) {
        let end = x.q.rows().min(start + BLOCK);
        let mut softmaxes = [Softmax { max: f32::NEG_INFINITY, sum: 0.0 }; BLOCK];
        for first in (0..x.k.rows()).step_by(KEYS) {
            let keys = first..x.k.rows().min(first + KEYS);
            pack_keys(x.k.row_range(keys.clone()), &mut work.k);
            pack_values(x.v.row_range(keys.clone()), &mut work.v);
            for i in (start..end).step_by(GROUPS * ROWS) {
                let count = (end - i).min(GROUPS * ROWS);
                let softmaxes = &mut softmaxes[i - start..][..count];
                pack_queries(x.q.row_range(i..i + count), &mut work.q);
                if count > ROWS {
                    block::<2>(tiles, x, i, first, keys.len(), softmaxes, &mut work, &mut y);
                } else {
                    block::<1>(tiles, x, i, first, keys.len(), softmaxes, &mut work, &mut y);
                }
            }
        }
    }
}

/// The queries from `i` on, as many as there are softmaxes (at most 16 `G`), with the `keys` keys from `first` on.
#[expect(clippy::too_many_arguments, reason = "one block of an operation, each operand named")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn block<const G: usize>(
    tiles: &Tiles,
    x: Operands<f32>,
    i: usize,
    first: usize,
    keys: usize,
    softmaxes: &mut [Softmax],
    work: &mut Work,
    y: &mut MatMut<f32>,
) {
    let (steps, pairs) = (x.q.cols().div_ceil(PAIRS), keys.div_ceil(PAIRS));
    for pair in 0..pairs {
        let [left, right] = [&work.k[2 * pair], &work.k[2 * pair + 1]];
        tiles.zero();
        for step in 0..steps {
            multiply::<G>(tiles, [&work.q[0][step], &work.q[1][step]], [&left[step], &right[step]]);
        }
        let [above, below] = &mut work.scores;
        finish::<G>(tiles, &mut above[pair], &mut below[pair]);
    }

    let shrink = weights(&mut work.scores, x, i, first, keys, softmaxes);

    for columns in 0..steps {
        tiles.zero();
        for pair in 0..pairs {
            let values = &work.v[pair];
            let weights = [&work.scores[0][pair], &work.scores[1][pair]];
            multiply::<G>(tiles, weights, [&values[2 * columns], &values[2 * columns + 1]]);
        }
        let [above, below] = &mut work.sums;
        finish::<G>(tiles, &mut above[2 * columns..], &mut below[2 * columns..]);
    }

    let last = first + keys == x.k.rows();
    for (r, softmax) in softmaxes.iter().enumerate() {
        let shrink = if first > 0 { Some(shrink[r]) } else { None };
        add(&work.sums[r / ROWS], r % ROWS, shrink, last.then_some(softmax.sum), y.row_mut(i + r));
    }
}

/// `y = y * shrink + sums[..][r]`, over `total` in the end; without `shrink`, what `y` holds does not count.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn add(sums: &[Tile; MOST_DIM / LANES], r: usize, shrink: Option<f32>, total: Option<f32>, y: &mut [f32]) {
    let sum = |tile: &Tile, y: __m512| {
        let sum = load(&tile.0[r]);
        let sum = shrink.map_or(sum, |shrink| _mm512_fmadd_ps(y, _mm512_set1_ps(shrink), sum));
        total.map_or(sum, |total| divide(sum, total))
    };
    let (whole, part) = y.as_chunks_mut();
    let last = &sums[whole.len() % sums.len()];
    for (tile, y) in sums.iter().zip(whole) {
        store(y, sum(tile, load(y)));
    }
    if !part.is_empty() {
        store_part(part, sum(last, load_part(part)));
    }
}

/// `x / total`, rounded correctly: one division for a row instead of a slow one per register.
#[target_feature(enable = "avx512f")]
fn divide(x: __m512, total: f32) -> __m512 {
    let (total, inverse) = (_mm512_set1_ps(total), _mm512_set1_ps(1.0 / total));
    let quotient = _mm512_mul_ps(x, inverse);
    _mm512_fmadd_ps(_mm512_fnmadd_ps(quotient, total, x), inverse, quotient)
}

/// Adds the six products of `G` x 2 tiles. From each to the next, one side stays where it is.
#[inline(always)]
fn multiply<const G: usize>(tiles: &Tiles, [above, below]: [&Split; 2], [left, right]: [&Split; 2]) {
    let products = || {
        tiles.multiply_bf16::<0, 4, 6>();
        tiles.multiply_bf16::<1, 4, 7>();
        if G == 2 {
            tiles.multiply_bf16::<2, 5, 6>();
            tiles.multiply_bf16::<3, 5, 7>();
        }
    };
    let queries = |part: usize| {
        tiles.load::<4, _>(&above[part].0);
        if G == 2 {
            tiles.load::<5, _>(&below[part].0);
        }
    };
    let keys = |part: usize| {
        tiles.load::<6, _>(&left[part].0);
        tiles.load::<7, _>(&right[part].0);
    };
    queries(0);
    keys(2);
    products();
    keys(1);
    products();
    queries(1);
    products();
    keys(0);
    products();
    queries(2);
    products();
    queries(0);
    products();
}

/// Stores the sums of `G` x 2 tiles, two beside each other.
#[inline(always)]
fn finish<const G: usize>(tiles: &Tiles, above: &mut [Tile], below: &mut [Tile]) {
    tiles.store_sum::<0>(&mut above[0].0, 1);
    tiles.store_sum::<1>(&mut above[1].0, 1);
    if G == 2 {
        tiles.store_sum::<2>(&mut below[0].0, 1);
        tiles.store_sum::<3>(&mut below[1].0, 1);
    }
}

/// The parts of 32 values: exact, each by cutting off what a bfloat16 has no room for. Whatever is not finite becomes NaN
/// in the second part.
#[inline]
#[target_feature(enable = "avx512f")]
fn split(a: __m512, b: __m512) -> [__m512; PARTS] {
    let (high_a, high_b) = (upper_half(a), upper_half(b));
    let (rest_a, rest_b) = (_mm512_sub_ps(a, high_a), _mm512_sub_ps(b, high_b));
    let (middle_a, middle_b) = (upper_half(rest_a), upper_half(rest_b));
    let (low_a, low_b) = (_mm512_sub_ps(rest_a, middle_a), _mm512_sub_ps(rest_b, middle_b));
    [paired(a, b), paired(rest_a, rest_b), paired(low_a, low_b)]
}

/// The upper 16 bits of every value: a bfloat16, rounded towards zero.
#[inline]
#[target_feature(enable = "avx512f")]
fn upper_half(x: __m512) -> __m512 {
    _mm512_castsi512_ps(_mm512_and_si512(_mm512_castps_si512(x), _mm512_set1_epi32(!0xffff)))
}

/// Upper halves of `a` in the lower halves of the lanes, of `b` in the upper ones.
#[inline]
#[target_feature(enable = "avx512f")]
fn paired(a: __m512, b: __m512) -> __m512 {
    // `a | b & mask` in one operation; spelled out, the compiler makes a shuffle of it that takes four times as long.
    const OR_AND: i32 = 0b1111_1000;
    let (a, b) = (_mm512_srli_epi32::<16>(_mm512_castps_si512(a)), _mm512_castps_si512(b));
    _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<OR_AND>(a, b, _mm512_set1_epi32(!0xffff)))
}

/// 32 values of a row from `at` on, zeros where there are fewer.
#[inline]
#[target_feature(enable = "avx512f")]
fn load_pairs(row: &[f32], at: usize) -> [__m512; 2] {
    match row.get(at..at + PAIRS) {
        Some(row) => {
            let (row, _) = row.as_chunks();
            [load(&row[0]), load(&row[1])]
        }
        None => [load_part(row.get(at..).unwrap_or(&[])), load_part(row.get(at + LANES..).unwrap_or(&[]))],
    }
}

/// Queries as rows of pairs; rows beyond the last keep what they hold, and nobody reads what becomes of it.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn pack_queries(q: Mat<f32>, packed: &mut [[Split; MOST_DIM / PAIRS]; GROUPS]) {
    for r in 0..q.rows() {
        let row = q.row(r);
        for (step, to) in packed[r / ROWS][..q.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
            let [a, b] = load_pairs(row, step * PAIRS);
            for (to, part) in to.iter_mut().zip(split(a, b)) {
                store(&mut to.0[r % ROWS], part);
            }
        }
    }
}

/// Keys as columns of pairs; those beyond the last are zeros up to a multiple of 32.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn pack_keys(k: Mat<f32>, packed: &mut [[Split; MOST_DIM / PAIRS]; KEYS / ROWS]) {
    for (tile, packed) in packed[..2 * k.rows().div_ceil(PAIRS)].iter_mut().enumerate() {
        for (step, to) in packed[..k.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
            for j in 0..LANES {
                let row = tile * ROWS + j;
                let mut pairs = [_mm512_setzero_ps(); 2];
                if row < k.rows() {
                    pairs = load_pairs(k.row(row), step * PAIRS);
                }
                let [a, b] = pairs;
                for (to, part) in to.iter_mut().zip(split(a, b)) {
                    store(&mut to.0[j], part);
                }
            }
            for to in to {
                let mut rows = [_mm512_setzero_ps(); LANES];
                for j in 0..LANES {
                    rows[j] = load(&to.0[j]);
                }
                let columns = transpose(rows);
                for j in 0..LANES {
                    store(&mut to.0[j], columns[j]);
                }
            }
        }
    }
}

/// Values as rows of pairs of keys; those beyond the last are zeros up to a multiple of 32.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn pack_values(v: Mat<f32>, packed: &mut [[Split; MOST_DIM / LANES]; KEYS / PAIRS]) {
    for (tile, packed) in packed[..v.rows().div_ceil(PAIRS)].iter_mut().enumerate() {
        for pair in 0..LANES {
            let first = tile * PAIRS + pair;
            let row = |row: usize| if row < v.rows() { v.row(row) } else { &[] };
            let (a, b) = (row(first), row(first + LANES));
            for (c, to) in packed.as_chunks_mut::<2>().0[..v.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
                let ([a, b], [c, d]) = (load_pairs(a, c * PAIRS), load_pairs(b, c * PAIRS));
                for (to, part) in to[0].iter_mut().zip(split(a, c)) {
                    store(&mut to.0[pair], part);
                }
                for (to, part) in to[1].iter_mut().zip(split(b, d)) {
                    store(&mut to.0[pair], part);
                }
            }
        }
    }
}

/// Turns dot products with the `keys` keys from `first` on into the parts of weights `exp(score - max)`; returns the factors
/// for what the queries have summed up before.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn weights(
    scores: &mut [[Split; KEYS / PAIRS]; GROUPS],
    x: Operands<f32>,
    i: usize,
    first: usize,
    keys: usize,
    softmaxes: &mut [Softmax],
) -> [f32; GROUPS * ROWS] {
    let pairs = keys.div_ceil(PAIRS);
    let (mut before, mut after) = ([0.0; GROUPS * ROWS], [0.0; GROUPS * ROWS]);
    for (r, softmax) in softmaxes.iter_mut().enumerate() {
        before[r] = softmax.max;
        softmax.max = score(&mut scores[r / ROWS][..pairs], r % ROWS, keys, x.scale, x.bias(i + r, first), softmax.max);
        after[r] = softmax.max;
    }
    // All rows' factors at once: one row by itself would wait for its own.
    let mut shrink = [0.0; GROUPS * ROWS];
    for ((shrink, before), after) in
        shrink.as_chunks_mut().0.iter_mut().zip(before.as_chunks().0).zip(after.as_chunks().0)
    {
        store(shrink, exp(_mm512_sub_ps(load(before), load(after))));
    }
    for (r, softmax) in softmaxes.iter_mut().enumerate() {
        let sum = weigh(&mut scores[r / ROWS][..pairs], r % ROWS, softmax.max);
        softmax.sum = softmax.sum * shrink[r] + sum;
    }
    shrink
}

/// Turns row `r` of the dot products with `keys` keys into scores, hides the rest, and returns the largest.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn score(tiles: &mut [Split], r: usize, keys: usize, scale: f32, bias: &[f32], max: f32) -> f32 {
    let (scale, hidden) = (_mm512_set1_ps(scale), _mm512_set1_ps(f32::NEG_INFINITY));
    let mut largest = _mm512_set1_ps(max);
    for (t, [left, right, _]) in tiles.iter_mut().enumerate() {
        let at = t * PAIRS;
        let [bias_a, bias_b] = load_pairs(bias, at);
        let mut a = _mm512_fmadd_ps(load(&left.0[r]), scale, bias_a);
        let mut b = _mm512_fmadd_ps(load(&right.0[r]), scale, bias_b);
        if at + PAIRS > keys {
            a = _mm512_mask_blend_ps(first_lanes(keys - at), hidden, a);
            b = _mm512_mask_blend_ps(first_lanes((keys - at).saturating_sub(LANES)), hidden, b);
        }
        largest = _mm512_max_ps(largest, _mm512_max_ps(a, b));
        store(&mut left.0[r], a);
        store(&mut right.0[r], b);
    }
    _mm512_reduce_max_ps(largest)
}

/// Turns row `r` of the scores into the parts of weights, and returns the sum of these.
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn weigh(tiles: &mut [Split], r: usize, max: f32) -> f32 {
    let max = _mm512_set1_ps(max);
    let mut sum = _mm512_setzero_ps();
    for [first, second, third] in tiles {
        let a = exp(_mm512_sub_ps(load(&first.0[r]), max));
        let b = exp(_mm512_sub_ps(load(&second.0[r]), max));
        sum = _mm512_add_ps(sum, _mm512_add_ps(a, b));
        let parts = split(a, b);
        store(&mut first.0[r], parts[0]);
        store(&mut second.0[r], parts[1]);
        store(&mut third.0[r], parts[2]);
    }
    _mm512_reduce_add_ps(sum)
}

/// Minimax `(2^r - 1) / r` on `0..=1`, highest power first: off by 2e-9 in `2^r`.
const POWER: [f32; 6] = [0.000_216_129_16, 0.001_246_784_6, 0.009_675_452, 0.055_485_282, 0.240_229_31, 0.693_147_06];

/// `e^x` of differences from a maximum: exactly 1 at 0, otherwise off by a unit of the last place and by 2^-24 of `x`;
/// 0 below -87.33.
#[inline]
#[target_feature(enable = "avx512f,avx512dq")]
fn exp(x: __m512) -> __m512 {
    let x = _mm512_mul_ps(x, _mm512_set1_ps(LOG2_E));
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(x, _mm512_set1_ps(-126.0));
    // What is above the next lower integer; that integer is the power by which `scalef` scales.
    let r = _mm512_reduce_ps::<1>(x);
    let mut power = _mm512_set1_ps(POWER[0]);
    for &c in &POWER[1..] {
        power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(c));
    }
    _mm512_maskz_scalef_ps(normal, _mm512_fmadd_ps(power, r, _mm512_set1_ps(1.0)), x)
}
