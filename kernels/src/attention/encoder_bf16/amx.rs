//! 32 queries at a time over 256 keys, on tiles of bfloat16 pairs.
//!
//! ```text
//! scores:  keys, one tile of 16 for each 32 of `head_dim`: tmm2, then tmm3
//!   queries  0..16: tmm4 tmm5 (by `head_dim`)    scores tmm0
//!           16..32: tmm6 tmm7                           tmm1
//! values:  values, 16 columns each: tmm6 tmm7
//!   queries  0..16: tmm4                          tmm0 tmm1
//!           16..32: tmm5                          tmm2 tmm3
//! ```
//! Scores of 32 queries are stored in tiles of 16 keys; softmax replaces two of them by one
//! tile of weights, in place: 32 KiB, which stay in L1 while keys and values stream through.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]

use super::avx512vnni::{self, vector::interleave_halves};
use super::{KEYS, STEP, Softmax};
use crate::amx::{TILE as ROWS, Tiles};
use crate::attention::amx::{MAX_DIM, Packed, Sums, Tile, add, load_pairs};
use crate::attention::avx512vnni::vector::transpose;
use crate::attention::operands::Operands;
use crate::isa::{Amx, entry};
use crate::lanes::LANES;
use crate::lanes::avx512vnni::{lane_mask, load, store, to_array};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use crate::math::avx512vnni::exp2_bf16_unmasked;
use crate::tiling::Tiling;
use core::arch::x86_64::*;
use core::ops::Range;
use umo_kernels_features::avx512bf16;

/// Queries whose softmax states are kept while blocks of keys are processed.
const BLOCK: usize = 512;

/// Groups of 16 queries processed at once.
const GROUPS: usize = 2;

/// Indexed by 16 keys and 32 of `head_dim`: rows of pairs, a key per column.
type Keys = [[Tile<Packed>; MAX_DIM / STEP]; KEYS / ROWS];
/// Indexed by 32 keys and 16 of `head_dim`: rows of pairs of keys.
type Values = [[Tile<Packed>; MAX_DIM / LANES]; KEYS / STEP];
/// Indexed by 16 queries and 32 of `head_dim`.
type Queries = [[Tile<Packed>; MAX_DIM / STEP]; GROUPS];
/// Indexed by 16 queries and 32 keys: two tiles of scores; then weights in the first.
type Scores = [[[Tile; 2]; KEYS / STEP]; GROUPS];

/// A register for each query.
type Lanes = [[[f32; LANES]; ROWS]; GROUPS];

/// The buffers of one call.
struct Work {
    scores: Scores,
    k: Keys,
    v: Values,
    q: Queries,
    sums: Sums,
    /// Per query: the largest score, or the sum of weights, by lane.
    lanes: Lanes,
    biases: [f32; BLOCK + KEYS],
}

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Amx) -> Tiling {
    Tiling {
        rows: &[ROWS, GROUPS * ROWS, BLOCK],
        outputs: &[LANES, STEP, KEYS],
        inputs: &[LANES, STEP, MAX_DIM],
        held: 0,
        chunk: 0,
    }
}

entry! {
    pub(super) fn attention(token: Amx, x: Operands<f32>, y: MatMut<f32>) {
        if fits(&x) {
            run(&Tiles::new(token), x, y);
        } else {
            avx512vnni::attention(token.into(), x, y);
        }
    }
}

#[avx512bf16]
fn run(tiles: &Tiles, x: Operands<f32>, mut y: MatMut<f32>) {
    let mut work = Work {
        k: [[Tile::EMPTY; MAX_DIM / STEP]; KEYS / ROWS],
        v: [[Tile::EMPTY; MAX_DIM / LANES]; KEYS / STEP],
        q: [[Tile::EMPTY; MAX_DIM / STEP]; GROUPS],
        scores: [[[Tile::ZERO; 2]; KEYS / STEP]; GROUPS],
        sums: [[Tile::ZERO; MAX_DIM / LANES]; GROUPS],
        lanes: [[[0.0; LANES]; ROWS]; GROUPS],
        biases: [0.0; BLOCK + KEYS],
    };
    for start in (0..x.q.rows()).step_by(BLOCK) {
        let end = x.q.rows().min(start + BLOCK);
        let mut softmaxes = [Softmax::START; BLOCK];
        for first in (0..x.k.rows()).step_by(KEYS) {
            let keys = first..x.k.rows().min(first + KEYS);
            pack_keys(x.k.row_range(keys.clone()), &mut work.k);
            pack_values(x.v.row_range(keys.clone()), &mut work.v);
            scale_biases(x.bias(end - 1, first), end - start - 1 + keys.len(), &mut work.biases);
            let place = (keys.start > 0, keys.end == x.k.rows());
            let mut first = start;
            for softmaxes in softmaxes[..end - start].chunks_mut(GROUPS * ROWS) {
                let rows = first..first + softmaxes.len();
                let (_, y) = y.reborrow().split_rows(first);
                first = rows.end;
                let biases = end - rows.end;
                let block = Block { q: x.q.row_range(rows), scale: x.scale * LOG2_E, biases, keys: keys.len() };
                if softmaxes.len() > ROWS {
                    block.run::<2>(tiles, &mut work, softmaxes, place, y);
                } else {
                    block.run::<1>(tiles, &mut work, softmaxes, place, y);
                }
            }
        }
    }
}

/// Whether the tiles suffice for heads of this width.
fn fits(x: &Operands<f32>) -> bool {
    x.q.cols() <= MAX_DIM
}

/// Converts `count` biases to powers of 2, if there are any.
#[avx512bf16]
fn scale_biases(biases: &[f32], count: usize, scaled: &mut [f32; BLOCK + KEYS]) {
    for (scaled, bias) in scaled.iter_mut().zip(biases).take(count) {
        *scaled = bias * LOG2_E;
    }
}

/// Up to 32 queries and the current block of keys.
struct Block<'a> {
    q: Mat<'a, f32>,
    scale: f32,
    /// Offset of the last query's biases; the biases of each earlier query start one element later.
    biases: usize,
    keys: usize,
}

impl Block<'_> {
    /// Adds the contribution of these keys to the first rows of `y`, in `G` groups of
    /// queries. `others`: there were keys before these; `last`: there are none after.
    ///
    /// While the tiles compute the scores of 32 keys, the registers scale the scores of the previous 32
    /// keys; while the tiles sum the values of 32 keys, the registers compute the
    /// weights of the next.
    #[avx512bf16]
    fn run<const G: usize>(
        &self,
        tiles: &Tiles,
        work: &mut Work,
        softmaxes: &mut [Softmax],
        (others, last): (bool, bool),
        mut y: MatMut<f32>,
    ) {
        let Work { scores, k, v, q, sums, lanes, biases } = work;
        let (steps, pairs) = (self.q.cols().div_ceil(STEP), self.keys.div_ceil(STEP));
        pack_queries(self.q, q);
        lanes.as_flattened_mut().fill([f32::NEG_INFINITY; LANES]);
        self.score_keys::<G>(tiles, q, k, scores, &biases[self.biases..], lanes);
        for (r, softmax) in softmaxes.iter_mut().enumerate() {
            softmax.update_max(_mm512_reduce_max_ps(load(&lanes[r / ROWS][r % ROWS])));
        }
        let mut max = [f32::NEG_INFINITY; GROUPS * ROWS];
        for (max, softmax) in max.iter_mut().zip(&*softmaxes) {
            *max = softmax.max;
        }
        lanes.as_flattened_mut().fill([0.0; LANES]);
        for r in 0..self.q.rows() {
            softmax_weights(scores, r, 0, max[r], lanes);
        }
        for columns in 0..steps {
            tiles.zero();
            for pair in 0..pairs {
                tiles.load::<4, _>(&scores[0][pair][0].0);
                tiles.load_tile_streaming::<6, _>(&v[pair][2 * columns].0, 1);
                tiles.load_tile_streaming::<7, _>(&v[pair][2 * columns + 1].0, 1);
                if G == 2 {
                    tiles.load::<5, _>(&scores[1][pair][0].0);
                }
                let mut r = 0;
                let mut between = || {
                    if columns == 0 && pair + 1 < pairs {
                        for r in r..self.q.rows().min(r + ROWS / 2) {
                            softmax_weights(scores, r, pair + 1, max[r], lanes);
                        }
                        r += ROWS / 2;
                    }
                };
                tiles.multiply_bf16::<0, 4, 6>();
                between();
                tiles.multiply_bf16::<1, 4, 7>();
                between();
                if G == 2 {
                    tiles.multiply_bf16::<2, 5, 6>();
                    between();
                    tiles.multiply_bf16::<3, 5, 7>();
                    between();
                }
            }
            let [above, below] = &mut *sums;
            tiles.store_sum::<0>(&mut above[2 * columns].0, 1);
            tiles.store_sum::<1>(&mut above[2 * columns + 1].0, 1);
            if G == 2 {
                tiles.store_sum::<2>(&mut below[2 * columns].0, 1);
                tiles.store_sum::<3>(&mut below[2 * columns + 1].0, 1);
            }
        }
        for (r, softmax) in softmaxes.iter_mut().enumerate() {
            softmax.add(_mm512_reduce_add_ps(load(&lanes[r / ROWS][r % ROWS])));
            let (shrink, total) = (others.then_some(softmax.shrink), last.then_some(softmax.sum));
            add(&sums[r / ROWS], r % ROWS, shrink, total, y.row_mut(r));
        }
    }

    /// Computes the scores of all keys, and the largest of each query by lane.
    #[inline]
    #[avx512bf16]
    fn score_keys<const G: usize>(
        &self,
        tiles: &Tiles,
        q: &Queries,
        k: &Keys,
        scores: &mut Scores,
        biases: &[f32],
        largest: &mut Lanes,
    ) {
        let (steps, pairs) = (self.q.cols().div_ceil(STEP), self.keys.div_ceil(STEP));
        tiles.load::<4, _>(&q[0][0].0);
        tiles.load::<5, _>(&q[0][1].0);
        if G == 2 {
            tiles.load::<6, _>(&q[1][0].0);
            tiles.load::<7, _>(&q[1][1].0);
        }
        let some = if steps == 2 { ROWS / 4 } else { ROWS / 2 };
        for pair in 0..pairs {
            let mut r = if pair > 0 { 0 } else { self.q.rows() };
            for half in 0..2 {
                let keys = &k[2 * pair + half];
                let mut between = || {
                    self.score(scores, r..self.q.rows().min(r + some), pair.wrapping_sub(1), biases, largest);
                    r += some;
                };
                tiles.zero_two();
                if steps > 0 {
                    tiles.load_tile_streaming::<2, _>(&keys[0].0, 1);
                    tiles.multiply_bf16::<0, 4, 2>();
                    between();
                    if G == 2 {
                        tiles.multiply_bf16::<1, 6, 2>();
                        between();
                    }
                }
                if steps > 1 {
                    tiles.load_tile_streaming::<3, _>(&keys[1].0, 1);
                    tiles.multiply_bf16::<0, 5, 3>();
                    between();
                    if G == 2 {
                        tiles.multiply_bf16::<1, 7, 3>();
                        between();
                    }
                }
                let [above, below] = &mut *scores;
                tiles.store_sum::<0>(&mut above[pair][half].0, 1);
                if G == 2 {
                    tiles.store_sum::<1>(&mut below[pair][half].0, 1);
                }
            }
        }
        self.score(scores, 0..self.q.rows(), pairs - 1, biases, largest);
    }

    /// Turns the dot products of the queries `rows` with 32 keys into scores, and updates
    /// the largest of each lane.
    #[inline]
    #[avx512bf16]
    fn score(&self, scores: &mut Scores, rows: Range<usize>, pair: usize, biases: &[f32], largest: &mut Lanes) {
        let (scale, hidden) = (_mm512_set1_ps(self.scale), _mm512_set1_ps(f32::NEG_INFINITY));
        for r in rows {
            let [left, right] = &mut scores[r / ROWS][pair];
            let biases = biases[self.q.rows() - 1 - r + pair * STEP..].as_chunks().0;
            let mut a = _mm512_fmadd_ps(load(&left.0[r % ROWS]), scale, load(&biases[0]));
            let mut b = _mm512_fmadd_ps(load(&right.0[r % ROWS]), scale, load(&biases[1]));
            if (pair + 1) * STEP > self.keys {
                let rest = self.keys - pair * STEP;
                a = _mm512_mask_blend_ps(lane_mask(rest), hidden, a);
                b = _mm512_mask_blend_ps(lane_mask(rest.saturating_sub(LANES)), hidden, b);
            }
            store(&mut left.0[r % ROWS], a);
            store(&mut right.0[r % ROWS], b);
            let largest = &mut largest[r / ROWS][r % ROWS];
            let so_far = load(largest);
            store(largest, _mm512_max_ps(so_far, _mm512_max_ps(a, b)));
        }
    }
}

/// Turns query `r`'s scores of 32 keys into weights, and adds them to its `sums`, by lanes.
#[inline]
#[avx512bf16]
fn softmax_weights(scores: &mut Scores, r: usize, pair: usize, max: f32, sums: &mut Lanes) {
    let ([left, right], max) = (&mut scores[r / ROWS][pair], _mm512_set1_ps(max));
    let a = exp2_bf16_unmasked(_mm512_sub_ps(load(&left.0[r % ROWS]), max));
    let b = exp2_bf16_unmasked(_mm512_sub_ps(load(&right.0[r % ROWS]), max));
    store(&mut left.0[r % ROWS], round_to_bf16(a, b));
    let sums = &mut sums[r / ROWS][r % ROWS];
    let so_far = load(sums);
    store(sums, _mm512_add_ps(so_far, _mm512_add_ps(a, b)));
}

/// Rounds two registers to one of bf16 values, to nearest, ties to even: first `a`, then
/// `b`.
#[inline]
#[avx512bf16]
fn round_to_bf16(a: __m512, b: __m512) -> __m512 {
    let round_to_bf16 = _mm512_cvtne2ps_pbh(b, a);
    // SAFETY: both are 64 bytes, and any bits are valid for both.
    unsafe { core::mem::transmute::<__m512bh, __m512>(round_to_bf16) }
}

/// Packs queries as rows of pairs; rows beyond the last keep their old contents, whose results
/// are never read.
#[avx512bf16]
fn pack_queries(q: Mat<f32>, packed: &mut Queries) {
    for r in 0..q.rows() {
        let row = q.row(r);
        for (step, to) in packed[r / ROWS][..q.cols().div_ceil(STEP)].iter_mut().enumerate() {
            let [a, b] = load_pairs(row, step * STEP);
            to.0[r % ROWS].write(to_array(round_to_bf16(a, b)));
        }
    }
}

/// Packs keys as columns of pairs, padded with zeros to a multiple of 32.
#[avx512bf16]
fn pack_keys(k: Mat<f32>, packed: &mut Keys) {
    for (tile, packed) in packed[..2 * k.rows().div_ceil(STEP)].iter_mut().enumerate() {
        for (step, to) in packed[..k.cols().div_ceil(STEP)].iter_mut().enumerate() {
            let mut rows = [_mm512_setzero_ps(); LANES];
            for j in 0..LANES {
                let row = tile * ROWS + j;
                if row < k.rows() {
                    let [a, b] = load_pairs(k.row(row), step * STEP);
                    rows[j] = round_to_bf16(a, b);
                }
            }
            for (to, column) in to.0.iter_mut().zip(transpose(rows)) {
                to.write(to_array(column));
            }
        }
    }
}

/// Packs values as rows of pairs of keys, padded with zeros to a multiple of 32.
#[avx512bf16]
fn pack_values(v: Mat<f32>, packed: &mut Values) {
    let pair = |a, b| interleave_halves(_mm512_castps_si512(round_to_bf16(a, b)));
    for (tile, packed) in packed[..v.rows().div_ceil(STEP)].iter_mut().enumerate() {
        for r in 0..ROWS {
            let row = |row: usize| if row < v.rows() { v.row(row) } else { &[] };
            let (even, odd) = (row(tile * STEP + 2 * r), row(tile * STEP + 2 * r + 1));
            for (c, to) in packed.as_chunks_mut::<2>().0[..v.cols().div_ceil(STEP)].iter_mut().enumerate() {
                let ([a, b], [c, d]) = (load_pairs(even, c * STEP), load_pairs(odd, c * STEP));
                to[0].0[r].write(to_array(pair(a, c)));
                to[1].0[r].write(to_array(pair(b, d)));
            }
        }
    }
}
