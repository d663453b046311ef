//! 32 queries at a time over 256 keys, on tiles of bfloat16 pairs, with the accuracy of f32.
//!
//! `tdpbf16ps` has 16 times the multiply-adds per cycle of f32 registers, but takes bf16, with
//! 8 bits of mantissa. An f32 has 24: it is exactly the sum of three bf16 values ([`PARTS`]),
//! from its leading, middle and last bits. Of the nine products of two such sums the six are
//! from its leading, middle and last bits. Of the nine products of two such sums, the six
//! with a size of at least 2^-16 of the largest are computed; the others are below the rounding of
//!
//! ```text
//!               keys or columns: tmm6 tmm7
//! queries  0..16: tmm4             tmm0 tmm1
//!         16..32: tmm5             tmm2 tmm3
//! ```
//! Scores of 32 queries are stored in tiles of 16 keys; softmax replaces two tiles of scores by
//! three tiles of weight parts. Any number of queries takes this path: a row's bits
//! do not depend on the other rows.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::avx512vnni::{self, vector::transpose};
use super::operands::Operands;
use crate::amx::{TILE as ROWS, Tiles};
use crate::isa::{Amx, entry};
use crate::lanes::LANES;
use crate::lanes::avx512vnni::{lane_mask, load, load_at, load_part, store, store_part, to_array};
use crate::mat::{Mat, MatMut};
use crate::math::avx512vnni::softmax_exp_reduce;
use crate::tiling::Tiling;
use core::arch::x86_64::*;
use core::mem::MaybeUninit;
use core::ops::Range;
use umo_kernels_features::avx512vnni;

/// Widest head; AVX-512 computes wider ones.
pub(super) const MAX_DIM: usize = 64;
/// Fewest keys for which packing pays.
const FEWEST_KEYS: usize = 65;

/// Keys per block: packed keys and values take 96 KiB of L2 each, scores 48 KiB.
const KEYS: usize = 256;
/// Queries whose softmax states are kept while blocks of keys are processed.
const BLOCK: usize = 512;
/// Bfloat16 values in a row of a tile: lane `i` of a register holds the values `i` and `16 + i`.
const PAIRS: usize = 2 * LANES;

/// 16 rows of 16 f32, or of 16 pairs of bfloat16; each row fits one register.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Tile<Row = [f32; 16]>(pub(super) [Row; ROWS]);

impl Tile {
    pub(super) const ZERO: Self = Self([[0.0; 16]; ROWS]);
}

/// A row that is written here and read only by tiles. It is not initialized: rows that are never
/// read cost nothing.
pub(super) type Packed = MaybeUninit<[f32; 16]>;

impl Tile<Packed> {
    pub(super) const EMPTY: Self = Self([MaybeUninit::uninit(); ROWS]);
}

/// Number of bf16 parts of an f32, largest first.
const PARTS: usize = 3;
/// The three parts of 16 x 32 values.
type Split<Row = [f32; 16]> = [Tile<Row>; PARTS];
/// Products of two splits.
const PRODUCTS: usize = 6;

/// Number of pieces of exponentials computed early, after each four products with values; a weight costs
/// as much as four scores.
const EARLY: usize = 2;

/// Groups of 16 queries processed at once.
const GROUPS: usize = 2;

/// Indexed by 16 keys and 32 of `head_dim`: rows of pairs, a key per column.
type Keys = [[Split<Packed>; MAX_DIM / PAIRS]; KEYS / ROWS];
/// Indexed by 32 keys and 16 of `head_dim`: rows of pairs of keys.
type Values = [[Split<Packed>; MAX_DIM / LANES]; KEYS / PAIRS];
/// Indexed by 16 queries and 32 of `head_dim`.
type Queries = [[Split<Packed>; MAX_DIM / PAIRS]; GROUPS];
/// Indexed by 16 queries and 32 keys: two tiles of scores, then the parts of their weights.
type Scores = [[Split; KEYS / PAIRS]; GROUPS];
/// Indexed by 16 queries and 16 of `head_dim`: weighted sums of values over the current block of keys.
pub(super) type Sums = [[Tile; MAX_DIM / LANES]; GROUPS];

/// The buffers of one call.
struct Work {
    k: Keys,
    v: Values,
    q: Queries,
    /// Scores of the queries being scored, and of those whose values are being summed.
    scores: [Scores; 2],
    sums: Sums,
}

/// State of one query's softmax.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    sum: f32,
}

/// Whether tiles are faster; depends only on the keys and their width, never on the number of
/// queries.
fn pays(x: &Operands<f32>) -> bool {
    x.k.rows() >= FEWEST_KEYS && x.k.cols() <= MAX_DIM
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Amx) -> Tiling {
    Tiling {
        rows: &[ROWS, GROUPS * ROWS, BLOCK],
        outputs: &[LANES, PAIRS, FEWEST_KEYS, KEYS],
        inputs: &[LANES, PAIRS, MAX_DIM],
        held: 0,
        chunk: 0,
    }
}

entry! {
    pub(super) fn attention(token: Amx, x: Operands<f32>, y: MatMut<f32>) {
        if pays(&x) {
            run(&Tiles::new(token), x, y);
        } else {
            avx512vnni::attention(token.into(), x, y);
        }
    }
}

#[avx512vnni]
fn run(tiles: &Tiles, x: Operands<f32>, mut y: MatMut<f32>) {
    let mut work = Work {
        k: [[[Tile::EMPTY; PARTS]; MAX_DIM / PAIRS]; KEYS / ROWS],
        v: [[[Tile::EMPTY; PARTS]; MAX_DIM / LANES]; KEYS / PAIRS],
        q: [[[Tile::EMPTY; PARTS]; MAX_DIM / PAIRS]; GROUPS],
        scores: [[[[Tile::ZERO; PARTS]; KEYS / PAIRS]; GROUPS]; 2],
        sums: [[Tile::ZERO; MAX_DIM / LANES]; GROUPS],
    };
    for start in (0..x.q.rows()).step_by(BLOCK) {
        let end = x.q.rows().min(start + BLOCK);
        let mut softmaxes = [Softmax { max: f32::NEG_INFINITY, sum: 0.0 }; BLOCK];
        for first in (0..x.k.rows()).step_by(KEYS) {
            let keys = first..x.k.rows().min(first + KEYS);
            pack_keys(x.k.row_range(keys.clone()), &mut work.k);
            pack_values(x.v.row_range(keys.clone()), &mut work.v);
            queries(tiles, x, start, &mut softmaxes[..end - start], keys, &mut work, &mut y);
        }
    }
}

/// Processes one query per softmax state, from `start` on, with the keys
/// and values `keys`.
///
/// Software pipeline over blocks of 32 queries: while the tiles compute the scores of a block,
/// the registers compute weights of the block before; while the tiles sum the values of that
/// block, the registers scale the scores of the next and compute its first weights. Tiles leave
/// one of two vector ports free, 64 operations for four products; more operations stall both, so
/// they are spread evenly over both halves.
#[avx512vnni]
fn queries(
    tiles: &Tiles,
    x: Operands<f32>,
    start: usize,
    softmaxes: &mut [Softmax],
    keys: Range<usize>,
    work: &mut Work,
    y: &mut MatMut<f32>,
) {
    let Work { k, v, q, scores: [even, odd], sums } = work;
    let (mut free, mut last) = (even, Block::new(x, &keys, start, &mut [], odd));
    let blocks = softmaxes.chunks_mut(GROUPS * ROWS).chain([&mut [][..]]);
    for (i, softmaxes) in blocks.enumerate() {
        let mut next = Block::new(x, &keys, start + i * GROUPS * ROWS, softmaxes, free);
        match next.softmaxes.len() {
            0 => {}
            1..=ROWS => score_keys::<1>(tiles, q, k, &mut next, &mut last),
            _ => score_keys::<2>(tiles, q, k, &mut next, &mut last),
        }
        last.softmax_weights(usize::MAX);
        last.add_up();
        match last.softmaxes.len() {
            0 => {}
            1..=ROWS => apply_values::<1>(tiles, v, &mut last, sums, &mut next),
            _ => apply_values::<2>(tiles, v, &mut last, sums, &mut next),
        }
        next.score(usize::MAX);
        next.rescale();
        for (r, softmax) in last.softmaxes.iter().enumerate() {
            let shrink = if keys.start > 0 { Some(last.shrink[r]) } else { None };
            let total = (keys.end == x.k.rows()).then_some(softmax.sum);
            add(&sums[r / ROWS], r % ROWS, shrink, total, y.row_mut(last.i + r));
        }
        free = last.scores;
        last = next;
    }
}

/// Computes the unscaled scores of `next`; meanwhile, weights of `last`.
#[avx512vnni]
fn score_keys<const G: usize>(tiles: &Tiles, q: &mut Queries, k: &Keys, next: &mut Block, last: &mut Block) {
    pack_queries(next.x.q.row_range(next.i..next.i + next.softmaxes.len()), q);
    let (steps, pairs) = (next.x.q.cols().div_ceil(PAIRS), next.keys.div_ceil(PAIRS));
    // Queries without values have no products.
    let pieces = last.softmaxes.len().div_ceil((PRODUCTS * steps).max(1)).max(EARLY);
    for pair in 0..pairs {
        let keys = [&k[2 * pair], &k[2 * pair + 1]];
        tiles.zero();
        for step in 0..steps {
            let (queries, keys) = ([&q[0][step], &q[1][step]], keys.map(|keys| &keys[step]));
            multiply::<G, _, _>(tiles, queries, keys, || last.softmax_weights(pieces - EARLY));
        }
        let [above, below] = &mut *next.scores;
        store_sums::<G>(tiles, &mut above[pair], &mut below[pair]);
    }
}

/// Computes the weighted sums of values of `last`; meanwhile, scores of `next`.
#[avx512vnni]
fn apply_values<const G: usize>(tiles: &Tiles, v: &Values, last: &mut Block, sums: &mut Sums, next: &mut Block) {
    let (steps, pairs) = (last.x.q.cols().div_ceil(PAIRS), last.keys.div_ceil(PAIRS));
    let pieces = next.softmaxes.len().div_ceil((PRODUCTS * steps).max(1));
    let [above, below] = sums;
    for columns in 0..steps {
        tiles.zero();
        for pair in 0..pairs {
            let weights = [&last.scores[0][pair], &last.scores[1][pair]];
            let values = [&v[pair][2 * columns], &v[pair][2 * columns + 1]];
            multiply::<G, _, _>(tiles, weights, values, || {
                next.score(pieces);
                next.softmax_weights(EARLY);
            });
        }
        store_sums::<G>(tiles, &mut above[2 * columns..], &mut below[2 * columns..]);
    }
}

/// Progress of a pass over the scores of a block.
struct Done {
    rows: usize,
    /// Pairs of tiles done in the next row.
    pairs: usize,
    /// The largest score, or the sum of weights, of those pairs, by lane.
    lanes: [f32; 16],
}

/// Up to 32 queries and the current block of keys.
struct Block<'a> {
    x: Operands<'a, f32>,
    /// The first query.
    i: usize,
    /// The first key, and the number of keys.
    first: usize,
    keys: usize,
    softmaxes: &'a mut [Softmax],
    scores: &'a mut Scores,
    scored: Done,
    exponentiated: Done,
    /// Largest scores before these keys; later, the factors that rescale earlier sums.
    shrink: [f32; GROUPS * ROWS],
    /// Sums of weights.
    sums: [f32; GROUPS * ROWS],
}

impl<'a> Block<'a> {
    fn new(
        x: Operands<'a, f32>,
        keys: &Range<usize>,
        i: usize,
        softmaxes: &'a mut [Softmax],
        scores: &'a mut Scores,
    ) -> Self {
        let (first, keys) = (keys.start, keys.len());
        let scored = Done { rows: 0, pairs: 0, lanes: [f32::NEG_INFINITY; 16] };
        let exponentiated = Done { rows: 0, pairs: 0, lanes: [0.0; 16] };
        Self {
            x,
            i,
            first,
            keys,
            softmaxes,
            scores,
            scored,
            exponentiated,
            shrink: [0.0; GROUPS * ROWS],
            sums: [0.0; GROUPS * ROWS],
        }
    }

    /// Turns the dot products of the next `pieces` pairs of a row's tiles into scores.
    #[avx512vnni]
    fn score(&mut self, pieces: usize) {
        let (Done { rows, pairs, lanes }, all) = (&mut self.scored, self.keys.div_ceil(PAIRS));
        let mut largest = load(lanes);
        for _ in 0..pieces {
            let Some(softmax) = self.softmaxes.get_mut(*rows) else { return };
            let bias = self.x.bias(self.i + *rows, self.first);
            let tiles = &mut self.scores[*rows / ROWS][*pairs];
            largest = score(tiles, *rows % ROWS, self.keys, *pairs * PAIRS, self.x.scale, bias, largest);
            *pairs += 1;
            if *pairs == all {
                self.shrink[*rows] = softmax.max;
                softmax.max = softmax.max.max(_mm512_reduce_max_ps(largest));
                largest = _mm512_set1_ps(f32::NEG_INFINITY);
                (*rows, *pairs) = (*rows + 1, 0);
            }
        }
        store(lanes, largest);
    }

    /// Computes the factors of all rows at once, to hide the latency of a
    /// single one.
    #[avx512vnni]
    fn rescale(&mut self) {
        let mut max = [0.0; GROUPS * ROWS];
        for (max, softmax) in max.iter_mut().zip(&*self.softmaxes) {
            *max = softmax.max;
        }
        for (shrink, max) in self.shrink.as_chunks_mut().0.iter_mut().zip(max.as_chunks().0) {
            store(shrink, softmax_exp_reduce(_mm512_sub_ps(load(shrink), load(max))));
        }
    }

    /// Turns the scores of the next `pieces` pairs of a row's tiles into the parts of weights
    /// `exp(score - max)`, for the rows whose scores are complete.
    #[avx512vnni]
    fn softmax_weights(&mut self, pieces: usize) {
        let (Done { rows, pairs, lanes }, all) = (&mut self.exponentiated, self.keys.div_ceil(PAIRS));
        let mut sum = load(lanes);
        for _ in 0..pieces {
            if *rows == self.scored.rows {
                break;
            }
            let softmax = &self.softmaxes[*rows];
            let tiles = &mut self.scores[*rows / ROWS][*pairs];
            sum = _mm512_add_ps(sum, softmax_weights(tiles, *rows % ROWS, softmax.max));
            *pairs += 1;
            if *pairs == all {
                self.sums[*rows] = _mm512_reduce_add_ps(sum);
                sum = _mm512_setzero_ps();
                (*rows, *pairs) = (*rows + 1, 0);
            }
        }
        store(lanes, sum);
    }

    /// Adds the sums of weights to the sums over earlier keys.
    fn add_up(&mut self) {
        for ((softmax, sum), shrink) in self.softmaxes.iter_mut().zip(&self.sums).zip(&self.shrink) {
            softmax.sum = softmax.sum * shrink + sum;
        }
    }
}

/// `y = y * shrink + sums[..][r]`, divided by `total` after the last block; without `shrink`,
/// the old `y` is ignored.
#[avx512vnni]
pub(super) fn add(sums: &[Tile; MAX_DIM / LANES], r: usize, shrink: Option<f32>, total: Option<f32>, y: &mut [f32]) {
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

/// `x / total`, rounded correctly: one division per row instead of a slow one per register.
#[avx512vnni]
fn divide(x: __m512, total: f32) -> __m512 {
    let (total, inverse) = (_mm512_set1_ps(total), _mm512_set1_ps(1.0 / total));
    let quotient = _mm512_mul_ps(x, inverse);
    _mm512_fmadd_ps(_mm512_fnmadd_ps(quotient, total, x), inverse, quotient)
}

/// Adds the products of `G` x 2 tiles, and calls `between` after each. Consecutive products
/// share one operand.
#[inline(always)]
fn multiply<const G: usize, A, B>(
    tiles: &Tiles,
    [above, below]: [&Split<A>; 2],
    [left, right]: [&Split<B>; 2],
    mut between: impl FnMut(),
) {
    let mut products = || {
        tiles.multiply_bf16::<0, 4, 6>();
        tiles.multiply_bf16::<1, 4, 7>();
        if G == 2 {
            tiles.multiply_bf16::<2, 5, 6>();
            tiles.multiply_bf16::<3, 5, 7>();
        }
        between();
    };
    let queries = |part: usize| {
        tiles.load::<4, _>(&above[part].0);
        if G == 2 {
            tiles.load::<5, _>(&below[part].0);
        }
    };
    let keys = |part: usize| {
        tiles.load_tile_streaming::<6, _>(&left[part].0, 1);
        tiles.load_tile_streaming::<7, _>(&right[part].0, 1);
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

/// Stores the sums of `G` x 2 adjacent tiles.
#[inline(always)]
fn store_sums<const G: usize>(tiles: &Tiles, above: &mut [Tile], below: &mut [Tile]) {
    tiles.store_sum::<0>(&mut above[0].0, 1);
    tiles.store_sum::<1>(&mut above[1].0, 1);
    if G == 2 {
        tiles.store_sum::<2>(&mut below[0].0, 1);
        tiles.store_sum::<3>(&mut below[1].0, 1);
    }
}

/// Splits 32 values exactly into bf16 parts by truncation. The second part of a value that is
/// not finite is NaN.
#[inline]
#[avx512vnni]
fn split_bf16x3(a: __m512, b: __m512) -> [__m512; PARTS] {
    let (high_a, high_b) = (upper_half(a), upper_half(b));
    let (rest_a, rest_b) = (_mm512_sub_ps(a, high_a), _mm512_sub_ps(b, high_b));
    let (middle_a, middle_b) = (upper_half(rest_a), upper_half(rest_b));
    let (low_a, low_b) = (_mm512_sub_ps(rest_a, middle_a), _mm512_sub_ps(rest_b, middle_b));
    [paired(a, b), paired(rest_a, rest_b), paired(low_a, low_b)]
}

/// The upper 16 bits of every value: a bfloat16, rounded towards zero.
#[inline]
#[avx512vnni]
fn upper_half(x: __m512) -> __m512 {
    _mm512_castsi512_ps(_mm512_and_si512(_mm512_castps_si512(x), _mm512_set1_epi32(!0xffff)))
}

/// Puts the upper halves of `a` into the lower halves of the lanes, and the upper halves of `b` into the upper ones.
#[inline]
#[avx512vnni]
fn paired(a: __m512, b: __m512) -> __m512 {
    // `a | b & mask` in one operation; otherwise the compiler emits a shuffle of four times
    // the cost.
    const OR_AND: i32 = 0b1111_1000;
    let (a, b) = (_mm512_srli_epi32::<16>(_mm512_castps_si512(a)), _mm512_castps_si512(b));
    _mm512_castsi512_ps(_mm512_ternarylogic_epi32::<OR_AND>(a, b, _mm512_set1_epi32(!0xffff)))
}

/// 32 values of a row from `at` on, padded with zeros.
#[inline]
#[avx512vnni]
pub(super) fn load_pairs(row: &[f32], at: usize) -> [__m512; 2] {
    match row.get(at..at + PAIRS) {
        Some(row) => {
            let (row, _) = row.as_chunks();
            [load(&row[0]), load(&row[1])]
        }
        None => [load_at(row, at), load_at(row, at + LANES)],
    }
}

/// Packs queries as rows of pairs; rows beyond the last keep their old contents, whose results
/// are never read.
#[avx512vnni]
fn pack_queries(q: Mat<f32>, packed: &mut Queries) {
    for r in 0..q.rows() {
        let row = q.row(r);
        for (step, to) in packed[r / ROWS][..q.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
            let [a, b] = load_pairs(row, step * PAIRS);
            for (to, part) in to.iter_mut().zip(split_bf16x3(a, b)) {
                to.0[r % ROWS].write(to_array(part));
            }
        }
    }
}

/// Packs keys as columns of pairs, padded with zeros to a multiple of 32.
#[avx512vnni]
fn pack_keys(k: Mat<f32>, packed: &mut Keys) {
    for (tile, packed) in packed[..2 * k.rows().div_ceil(PAIRS)].iter_mut().enumerate() {
        for (step, to) in packed[..k.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
            let mut rows = [[_mm512_setzero_ps(); LANES]; PARTS];
            for j in 0..LANES {
                let row = tile * ROWS + j;
                if row < k.rows() {
                    let [a, b] = load_pairs(k.row(row), step * PAIRS);
                    for (rows, part) in rows.iter_mut().zip(split_bf16x3(a, b)) {
                        rows[j] = part;
                    }
                }
            }
            for (to, rows) in to.iter_mut().zip(rows) {
                for (to, column) in to.0.iter_mut().zip(transpose(rows)) {
                    to.write(to_array(column));
                }
            }
        }
    }
}

/// Packs values as rows of pairs of keys, padded with zeros to a multiple of 32.
#[avx512vnni]
fn pack_values(v: Mat<f32>, packed: &mut Values) {
    for (tile, packed) in packed[..v.rows().div_ceil(PAIRS)].iter_mut().enumerate() {
        for pair in 0..LANES {
            let first = tile * PAIRS + pair;
            let row = |row: usize| if row < v.rows() { v.row(row) } else { &[] };
            let (a, b) = (row(first), row(first + LANES));
            for (c, to) in packed.as_chunks_mut::<2>().0[..v.cols().div_ceil(PAIRS)].iter_mut().enumerate() {
                let ([a, b], [c, d]) = (load_pairs(a, c * PAIRS), load_pairs(b, c * PAIRS));
                for (to, part) in to[0].iter_mut().zip(split_bf16x3(a, c)) {
                    to.0[pair].write(to_array(part));
                }
                for (to, part) in to[1].iter_mut().zip(split_bf16x3(b, d)) {
                    to.0[pair].write(to_array(part));
                }
            }
        }
    }
}

/// Turns row `r` of the dot products with the keys from `at` on, out of `keys`, into scores, masks the
/// rest, and returns the lane-wise maximum with `largest`.
#[inline]
#[avx512vnni]
fn score(
    [left, right, _]: &mut Split,
    r: usize,
    keys: usize,
    at: usize,
    scale: f32,
    bias: &[f32],
    largest: __m512,
) -> __m512 {
    let (scale, hidden) = (_mm512_set1_ps(scale), _mm512_set1_ps(f32::NEG_INFINITY));
    let [bias_a, bias_b] = load_pairs(bias, at);
    let mut a = _mm512_fmadd_ps(load(&left.0[r]), scale, bias_a);
    let mut b = _mm512_fmadd_ps(load(&right.0[r]), scale, bias_b);
    if at + PAIRS > keys {
        a = _mm512_mask_blend_ps(lane_mask(keys - at), hidden, a);
        b = _mm512_mask_blend_ps(lane_mask((keys - at).saturating_sub(LANES)), hidden, b);
    }
    store(&mut left.0[r], a);
    store(&mut right.0[r], b);
    _mm512_max_ps(largest, _mm512_max_ps(a, b))
}

/// Turns row `r` of 32 scores into the parts of weights, and returns the sums of the weights.
#[inline]
#[avx512vnni]
fn softmax_weights([first, second, third]: &mut Split, r: usize, max: f32) -> __m512 {
    let max = _mm512_set1_ps(max);
    let a = softmax_exp_reduce(_mm512_sub_ps(load(&first.0[r]), max));
    let b = softmax_exp_reduce(_mm512_sub_ps(load(&second.0[r]), max));
    let parts = split_bf16x3(a, b);
    store(&mut first.0[r], parts[0]);
    store(&mut second.0[r], parts[1]);
    store(&mut third.0[r], parts[2]);
    _mm512_add_ps(a, b)
}
