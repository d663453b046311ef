//! The loops of the vector back-ends, compiled once per instruction set: every back-end includes
//! this file as its module `loops`. Its module `vector` holds the differences: the register of
//! `WIDTH` lanes with its operations, the tile shapes (`BLOCK`, `COLUMNS`, `ORDER`, `PAIRS`), the
//! shuffles `transpose` and `sums_of`, and the attribute `features`. Module `portable` of a back-end includes it again,
//! with sums in `PARTS` registers and other roundings: those of the scalar back-end.
//!
//! Not functions over a trait of registers: `[f32; S::WIDTH]` is not a type in stable Rust, and a
//! trait's methods cannot enable target features and be safe.

#![expect(clippy::needless_range_loop, reason = "loops of constant length over registers read best by index")]
#![allow(clippy::modulo_one, clippy::reversed_empty_ranges, reason = "`PARTS` is one in some modules")]

use super::vector::{
    BLOCK, COLUMNS, ORDER, PAIRS, PARTS, Register, WIDTH, add, features, fmadd, load, load_at, load_bf16, load_part,
    load_part_bf16, max_lanes, mul, reduce_max, select_first, softmax_exp, splat, store, store_part, sub, sums_of,
    to_array, transpose, zero,
};
use crate::attention::operands::{HeadOperands, Operands};
use crate::bf16::Bf16;
use crate::lanes::pairwise;
use crate::mat::{Mat, MatMut};
use crate::prefetch::{HintPrefetch, Prefetch, PrefetchHint, SelfPrefetch};
use crate::tiling::Tiling;

/// Keys whose scores are held at once: packed keys and values of a tile with 64 columns take 32
/// KiB of L1.
const TILE: usize = 64;

/// Most columns of packed keys and values; wider heads are computed without packing.
const PACKED_DIM: usize = 64;

/// Fewest queries for which packing keys and values pays.
const PACKED_QUERIES: usize = 8;

/// Keys whose dot products are computed at once.
const DOTS: usize = 4;

/// Registers in a row of the usual width, 64.
const WHOLE: usize = 64 / WIDTH;

/// Storage type of keys and values, widened to f32 when loaded.
pub(in crate::attention) trait Load: Copy {
    /// # Safety
    /// The processor has the features of this back-end.
    unsafe fn load(src: &[Self; WIDTH]) -> Register;
    /// The first values, padded with zeros.
    /// # Safety
    /// The processor has the features of this back-end.
    unsafe fn load_part(src: &[Self]) -> Register;
}

impl Load for f32 {
    #[inline]
    #[features]
    unsafe fn load(src: &[Self; WIDTH]) -> Register {
        load(src)
    }

    #[inline]
    #[features]
    unsafe fn load_part(src: &[Self]) -> Register {
        load_part(src)
    }
}

impl Load for Bf16 {
    #[inline]
    #[features]
    unsafe fn load(src: &[Self; WIDTH]) -> Register {
        load_bf16(src)
    }

    #[inline]
    #[features]
    unsafe fn load_part(src: &[Self]) -> Register {
        load_part_bf16(src)
    }
}

/// One register of keys or values.
#[inline]
#[features]
fn widened<T: Load>(src: &[T; WIDTH]) -> Register {
    // SAFETY: this function enables the features of this back-end, so that its caller has them.
    unsafe { T::load(src) }
}

/// The first values of a register, then zeros.
#[inline]
#[features]
fn widened_part<T: Load>(src: &[T]) -> Register {
    // SAFETY: this function enables the features of this back-end, so that its caller has them.
    unsafe { T::load_part(src) }
}

/// Scores of a tile, then weights, for `Q` queries. Aligned, as [`Packed`] is, so that no load
/// crosses a cache line.
#[repr(align(64))]
struct Weights<const Q: usize>([[f32; TILE]; Q]);

/// Sizes at which the loops change.
pub(super) const TILING: Tiling = Tiling {
    rows: &[4, PACKED_QUERIES, BLOCK],
    outputs: &[WIDTH, TILE],
    inputs: &[WIDTH, PACKED_DIM],
    held: 0,
    chunk: 0,
};

#[features]
pub(in crate::attention) fn attention<T: Load>(x: Operands<T>, mut y: MatMut<f32>) {
    let mut i = 0;
    if x.q.rows() >= PACKED_QUERIES && x.q.cols() <= PACKED_DIM {
        let packed = x.q.rows() / 4 * 4;
        while i < packed {
            let count = BLOCK.min(packed - i);
            block(x, i, count, &mut y);
            i += count;
        }
    }
    // Prefetching past a row reaches the next row only if rows are contiguous.
    let self_prefetch = x.self_prefetch && x.k.stride() == x.k.cols() && x.v.stride() == x.v.cols();
    while i < x.q.rows() {
        i += if self_prefetch { few::<T, SelfPrefetch>(x, i, &mut y) } else { few::<T, HintPrefetch>(x, i, &mut y) };
    }
}

/// Heads computed side by side, so that none waits for another's maximum or sum.
const HEADS: usize = 4;

/// Head widths with specialised loops.
const HEAD_DIMS: [usize; 3] = [32, 48, 64];

/// Sizes at which the loops over heads change.
pub(super) const HEADS_TILING: Tiling =
    Tiling { rows: &[HEADS], outputs: &[WIDTH, TILE], inputs: &HEAD_DIMS, held: 0, chunk: 0 };

/// All heads of all rows, one query each, with the operations of [`attention`] in the same order.
#[features]
pub(in crate::attention) fn heads(x: HeadOperands, mut y: MatMut<f32>) {
    match x.head_dim() {
        dim if x.cache.filled <= TILE && dim == HEAD_DIMS[0] => heads_of::<{ HEAD_DIMS[0] / WIDTH }>(x, &mut y),
        dim if x.cache.filled <= TILE && dim == HEAD_DIMS[1] => heads_of::<{ HEAD_DIMS[1] / WIDTH }>(x, &mut y),
        dim if x.cache.filled <= TILE && dim == HEAD_DIMS[2] => heads_of::<{ HEAD_DIMS[2] / WIDTH }>(x, &mut y),
        dim => {
            for row in 0..x.q.rows() {
                for (head, y) in y.row_mut(row).chunks_exact_mut(dim).enumerate() {
                    attention(x.alone(row, head), MatMut::new(y, 1, dim).expect("a head has `dim` columns"));
                }
            }
        }
    }
}

/// Heads of `C` registers, with keys that fit one tile.
#[features]
fn heads_of<const C: usize>(x: HeadOperands, y: &mut MatMut<f32>) {
    let (heads, filled) = (x.cache.heads, x.cache.filled);
    let mut weights = Weights([[0.0; TILE]; HEADS]);
    for row in 0..x.q.rows() {
        let (q, y) = (x.q.row(row).as_chunks().0.as_chunks::<C>().0, y.row_mut(row));
        let y = y.as_chunks_mut().0.as_chunks_mut::<C>().0;
        for (first, y) in (0..heads).step_by(HEADS).zip(y.chunks_mut(HEADS)) {
            let (mut max, mut sum) = ([0.0; HEADS], [[zero(); PARTS]; HEADS]);
            let mut v: [&[[[f32; WIDTH]; C]]; HEADS] = [&[]; HEADS];
            for h in 0..y.len() {
                let [keys, values] = x.of_head(row, first + h);
                v[h] = values.as_chunks().0.as_chunks::<C>().0;
                head_scores(&q[first + h], keys.as_chunks().0.as_chunks::<C>().0, &mut weights.0[h]);
                max[h] = score::<false>(&mut weights.0[h], filled, f32::NEG_INFINITY, x.scale, &[]);
            }
            for h in 0..y.len() {
                let max = splat(max[h]);
                let registers = &mut weights.0[h].as_chunks_mut::<WIDTH>().0[..filled.div_ceil(WIDTH)];
                for (c, register) in registers.iter_mut().enumerate() {
                    let weight = softmax_exp(sub(load(register), max));
                    sum[h][c % PARTS] = add(sum[h][c % PARTS], weight);
                    store(register, weight);
                }
            }
            for (h, y) in y.iter_mut().enumerate() {
                head_values(&weights.0[h], v[h], y);
                let sum = pairwise(to_array(joined(sum[h])));
                y.as_flattened_mut().iter_mut().for_each(|y| *y /= sum);
            }
        }
    }
}

/// The dot products of a query with every key, at most [`TILE`]; up to `WIDTH - 1` meaningless
/// values follow them.
#[inline]
#[features]
fn head_scores<const C: usize>(q: &[[f32; WIDTH]; C], k: &[[[f32; WIDTH]; C]], weights: &mut [f32; TILE]) {
    for (k, to) in k.chunks(WIDTH).zip(weights.as_chunks_mut::<WIDTH>().0) {
        let mut sums = [zero(); WIDTH];
        for from in (0..WIDTH).step_by(DOTS) {
            if from < k.len() {
                let mut keys = [&k[from]; DOTS];
                for j in 1..DOTS {
                    // Past the end, the last key is repeated.
                    keys[j] = &k[(from + j).min(k.len() - 1)];
                }
                for part in 0..PARTS {
                    let mut dots = [zero(); DOTS];
                    let mut c = part;
                    while c < C {
                        let q = load(&q[c]);
                        for j in 0..DOTS {
                            dots[j] = fmadd(q, load(&keys[j][c]), dots[j]);
                        }
                        c += PARTS;
                    }
                    for j in 0..DOTS {
                        sums[from + j] = if part == 0 { dots[j] } else { add(sums[from + j], dots[j]) };
                    }
                }
            }
        }
        store(to, sums_of(sums));
    }
}

/// `y = sum_j weights[j] * v[j]`.
#[inline]
#[features]
fn head_values<const C: usize>(weights: &[f32; TILE], v: &[[[f32; WIDTH]; C]], y: &mut [[f32; WIDTH]; C]) {
    let mut sums = [zero(); C];
    for (&weight, v) in weights.iter().zip(v) {
        let weight = splat(weight);
        for c in 0..C {
            sums[c] = fmadd(weight, load(&v[c]), sums[c]);
        }
    }
    for c in 0..C {
        store(&mut y[c], sums[c]);
    }
}

/// Processes one, two or four queries from `i` on; returns their number.
#[features]
fn few<T: Load, F: Prefetch>(x: Operands<T>, i: usize, y: &mut MatMut<f32>) -> usize {
    match x.q.rows() - i {
        1 => group::<T, F, 1, WIDTH, { COLUMNS[0] }>(x, i, y),
        2 | 3 => group::<T, F, 2, { WIDTH / 2 }, { COLUMNS[1] }>(x, i, y),
        _ => group::<T, F, 4, { WIDTH / 4 }, { COLUMNS[2] }>(x, i, y),
    }
}

/// A tile of keys, transposed, and of values, dense: unlike the projections, neither strides across
/// the sets of L1.
#[repr(align(64))]
struct Packed {
    /// `[head_dim, TILE]`.
    k: [[f32; TILE]; PACKED_DIM],
    /// `[TILE, head_dim]`.
    v: [f32; TILE * PACKED_DIM],
}

/// Processes `count` queries from `i` on, a multiple of 4 and at most [`BLOCK`], tile by tile of packed
/// keys and values.
#[features]
fn block<T: Load>(x: Operands<T>, i: usize, count: usize, y: &mut MatMut<f32>) {
    let dim = x.q.cols();
    let mut packed = Packed { k: [[0.0; TILE]; PACKED_DIM], v: [0.0; TILE * PACKED_DIM] };
    let mut weights = Weights([[0.0; TILE]; 4]);
    let mut pairs = [[[zero(); 2]; 4]; GROUPS];
    let mut softmaxes = [[Softmax::START; 4]; BLOCK / 4];
    let mut nothing = HintPrefetch::new(PrefetchHint::NONE, 1);
    let keys = x.keys(i + count - 1);
    for first in (0..keys).step_by(TILE) {
        let range = first..keys.min(first + TILE);
        pack_keys(x.k.row_range(range.clone()), &mut packed.k);
        for j in range.clone() {
            let to = &mut packed.v[(j - first) * dim..][..dim];
            for (to, from) in to.chunks_mut(WIDTH).zip(x.v.row(j).chunks(WIDTH)) {
                store_part(to, widened_part(from));
            }
        }
        let v = Mat::new(&packed.v, range.len(), dim).expect("at most `TILE` rows of at most `PACKED_DIM` columns");
        for (group, softmaxes) in softmaxes[..count / 4].iter_mut().enumerate() {
            let i = i + 4 * group;
            if x.keys(i + 3) > first {
                packed_scores(x.q.row_range(i..i + 4), &packed.k, &mut pairs, &mut weights);
                let scratch = (&mut weights, &mut nothing);
                weighted::<T, f32, HintPrefetch, 4, { COLUMNS[2] }>(x, i, first, v, softmaxes, scratch, y);
            }
        }
    }
    for (r, softmax) in softmaxes.as_flattened()[..count].iter().enumerate() {
        softmax.normalize(y.row_mut(i + r));
    }
}

/// Transposes the rows of `k` into the columns of `packed`; columns beyond keep their old
/// contents.
#[features]
fn pack_keys<T: Load>(k: Mat<T>, packed: &mut [[f32; TILE]; PACKED_DIM]) {
    for first in (0..k.rows()).step_by(WIDTH) {
        for d in (0..k.cols()).step_by(WIDTH) {
            let mut rows = [zero(); WIDTH];
            for j in 0..WIDTH {
                if first + j < k.rows() {
                    rows[j] = widened_part(&k.row(first + j)[d..]);
                }
            }
            for (column, to) in transpose(rows).iter().zip(&mut packed[d..k.cols().min(d + WIDTH)]) {
                store_part(&mut to[first..first + WIDTH], *column);
            }
        }
    }
}

/// Number of stored groups of a query's partial sums, [`PAIRS`] pairs each, before they are added.
const GROUPS: usize = WIDTH / 2 / PAIRS;

/// Sums for 4 queries x 2 registers of keys.
type Sums = [[Register; 2]; 4];

/// The dot products of 4 queries with a packed tile, lanes along the keys. Each partial sum of
/// [`scores`] is here one chain of multiply-adds, and the chains are added in the same tree, so
/// that the bits are the same. `pairs` is scratch.
#[features]
fn packed_scores(q: Mat<f32>, k: &[[f32; TILE]; PACKED_DIM], pairs: &mut [Sums; GROUPS], weights: &mut Weights<4>) {
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
    for tile in 0..TILE / (2 * WIDTH) {
        for (sums, lanes) in pairs.iter_mut().zip(ORDER.as_chunks::<PAIRS>().0) {
            let mut total = [[zero(); 2]; 4];
            for p in 0..PAIRS {
                // 4 queries x 2 registers of keys: 8 sums at a time, and 8 waiting partners.
                let mut chains = [[[zero(); 2]; 4]; 2];
                for half in 0..2 {
                    for part in 0..PARTS {
                        let mut chain = [[zero(); 2]; 4];
                        let mut c = part;
                        while c < PACKED_DIM / WIDTH {
                            let d = lanes[p] + WIDTH / 2 * half + c * WIDTH;
                            let keys = k[d].as_chunks().0;
                            let (a, b) = (load(&keys[2 * tile]), load(&keys[2 * tile + 1]));
                            for r in 0..4 {
                                let q = splat(rows[r][d]);
                                chain[r][0] = fmadd(q, a, chain[r][0]);
                                chain[r][1] = fmadd(q, b, chain[r][1]);
                            }
                            c += PARTS;
                        }
                        for r in 0..4 {
                            for side in 0..2 {
                                let before = chains[half][r][side];
                                chains[half][r][side] =
                                    if part == 0 { chain[r][side] } else { add(before, chain[r][side]) };
                            }
                        }
                    }
                }
                for r in 0..4 {
                    for side in 0..2 {
                        let pair = add(chains[0][r][side], chains[1][r][side]);
                        total[r][side] = if p == 0 { pair } else { add(total[r][side], pair) };
                    }
                }
            }
            *sums = total;
        }
        for r in 0..4 {
            let to = weights.0[r].as_chunks_mut().0;
            for side in 0..2 {
                let mut sums = [zero(); GROUPS];
                for i in 0..GROUPS {
                    sums[i] = pairs[i][r][side];
                }
                let mut left = GROUPS / 2;
                while left > 0 {
                    for i in 0..left {
                        sums[i] = add(sums[2 * i], sums[2 * i + 1]);
                    }
                    left /= 2;
                }
                store(&mut to[2 * tile + side], sums[0]);
            }
        }
    }
}

/// Processes the `Q` queries from `i` on, over all their keys; returns `Q`. `y` holds the sums
/// of values times `exp(score - max)` until the end. Scores are computed `K = WIDTH / Q` keys,
/// values `C` registers of columns at a time.
#[features]
fn group<T: Load, F: Prefetch, const Q: usize, const K: usize, const C: usize>(
    x: Operands<T>,
    i: usize,
    y: &mut MatMut<f32>,
) -> usize {
    let mut weights = Weights([[0.0; TILE]; Q]);
    let mut softmaxes = [Softmax::START; Q];
    // A later query sees at least the keys of an earlier one.
    let keys = x.keys(i + Q - 1);
    // The hint is prefetched during the last queries.
    let hint = if i + Q == x.q.rows() { x.hint } else { PrefetchHint::NONE };
    let mut fetch = F::new(hint, 2 * keys.div_ceil(DOTS));
    for first in (0..keys).step_by(TILE) {
        let range = first..keys.min(first + TILE);
        scores::<T, F, Q, K>(x, i, x.k.row_range(range.clone()), &mut fetch, &mut weights);
        let v = x.v.row_range(range);
        weighted::<T, T, F, Q, C>(x, i, first, v, &mut softmaxes, (&mut weights, &mut fetch), y);
    }
    for (r, softmax) in softmaxes.iter().enumerate() {
        softmax.normalize(y.row_mut(i + r));
    }
    Q
}

/// Turns the scores of the tile of keys from `first` on into weights, and adds the tile's values to
/// the rows of `y`, `C` registers of columns at a time.
#[features]
fn weighted<T: Load, V: Load, F: Prefetch, const Q: usize, const C: usize>(
    x: Operands<T>,
    i: usize,
    first: usize,
    v: Mat<V>,
    softmaxes: &mut [Softmax; Q],
    (weights, fetch): (&mut Weights<Q>, &mut F),
    y: &mut MatMut<f32>,
) {
    let mut seen = [0; Q];
    for r in 0..Q {
        seen[r] = x.keys(i + r).saturating_sub(first).min(v.rows());
    }
    let shrink = if seen == [TILE; Q] {
        softmax_weights::<T, Q, true>(x, i, first, seen, softmaxes, weights)
    } else {
        softmax_weights::<T, Q, false>(x, i, first, seen, softmaxes, weights)
    };
    values::<V, F, Q, C>(&weights.0, 0, v.row_range(0..seen[0]), fetch, shrink, i, y);
    for r in 1..Q {
        if seen[r] > seen[0] {
            let v = v.row_range(seen[0]..seen[r]);
            let weights = core::array::from_ref(&weights.0[r]);
            values::<V, F, 1, { COLUMNS[0] }>(weights, seen[0], v, fetch, [1.0], i + r, y);
        }
    }
}

/// The dot products of `Q` queries with every key of `k`; up to `K - 1` meaningless values follow
/// them.
#[features]
fn scores<T: Load, F: Prefetch, const Q: usize, const K: usize>(
    x: Operands<T>,
    i: usize,
    k: Mat<T>,
    fetch: &mut F,
    weights: &mut Weights<Q>,
) {
    let q = x.q.row_range(i..i + Q);
    for first in (0..k.rows()).step_by(K) {
        let mut sums = [zero(); WIDTH];
        // A few keys at a time, whose addresses stay in registers.
        for from in (0..K).step_by(DOTS) {
            fetch.advance();
            match (K < DOTS, q.cols() == WHOLE * WIDTH) {
                (true, _) => dots::<T, F, Q, K, K, 0>(q, k, (first, from), fetch, &mut sums),
                (_, true) => dots::<T, F, Q, K, DOTS, WHOLE>(q, k, (first, from), fetch, &mut sums),
                _ => dots::<T, F, Q, K, DOTS, 0>(q, k, (first, from), fetch, &mut sums),
            }
        }
        let sums = to_array(sums_of(sums));
        for (weights, sums) in weights.0.iter_mut().zip(sums.as_chunks::<K>().0) {
            weights[first..first + K].copy_from_slice(sums);
        }
    }
}

/// Partial sums of the dot products of `Q` queries with `N` keys from `first + from` on, out of the
/// `K` from `first` on. A row has `C` registers; if `C` is 0, any number and a tail.
#[inline]
#[features]
fn dots<T: Load, F: Prefetch, const Q: usize, const K: usize, const N: usize, const C: usize>(
    q: Mat<f32>,
    k: Mat<T>,
    (first, from): (usize, usize),
    fetch: &F,
    to: &mut [Register; WIDTH],
) {
    let chunks = if C > 0 { C } else { q.cols() / WIDTH };
    let mut keys = [0; N];
    for j in 0..N {
        // Past the end, the last key is repeated.
        keys[j] = (first + from + j).min(k.rows() - 1);
    }
    for part in 0..PARTS {
        let mut sums = [[zero(); N]; Q];
        let mut c = part;
        while c < chunks {
            let mut chunk = [zero(); Q];
            for r in 0..Q {
                chunk[r] = load(q.chunk(r, c));
            }
            for j in 0..N {
                let k = k.chunk(keys[j], c);
                fetch.touch(k, c);
                let k = widened(k);
                for r in 0..Q {
                    sums[r][j] = fmadd(chunk[r], k, sums[r][j]);
                }
            }
            c += PARTS;
        }
        if C == 0 && chunks % PARTS == part && chunks * WIDTH < q.cols() {
            for j in 0..N {
                let k = widened_part(&k.row(keys[j])[chunks * WIDTH..]);
                for r in 0..Q {
                    sums[r][j] = fmadd(load_part(&q.row(r)[chunks * WIDTH..]), k, sums[r][j]);
                }
            }
        }
        for r in 0..Q {
            for j in 0..N {
                let to = &mut to[r * K + from + j];
                *to = if part == 0 { sums[r][j] } else { add(*to, sums[r][j]) };
            }
        }
    }
}

/// Adds the parts of a sum.
#[inline]
#[features]
fn joined(parts: [Register; PARTS]) -> Register {
    let mut sum = parts[0];
    for part in 1..PARTS {
        sum = add(sum, parts[part]);
    }
    sum
}

/// State of one query's softmax.
#[derive(Clone, Copy)]
struct Softmax {
    max: f32,
    /// Sum of the weights, in lanes.
    sum: [[f32; WIDTH]; PARTS],
}

impl Softmax {
    /// The state before the first tile.
    const START: Self = Self { max: f32::NEG_INFINITY, sum: [[0.0; WIDTH]; PARTS] };

    /// Divides the sums of weighted values by the sum of weights.
    #[features]
    fn normalize(&self, y: &mut [f32]) {
        let mut parts = [zero(); PARTS];
        for part in 0..PARTS {
            parts[part] = load(&self.sum[part]);
        }
        let sum = pairwise(to_array(joined(parts)));
        y.iter_mut().for_each(|y| *y /= sum);
    }
}

/// Turns the first `seen[r]` dot products of query `i + r` into weights `exp(score - max)`;
/// returns the factors that rescale earlier sums: 0 in the first tile. `ALL`: all queries see
/// the whole tile.
#[inline]
#[features]
fn softmax_weights<T: Load, const Q: usize, const ALL: bool>(
    x: Operands<T>,
    i: usize,
    first: usize,
    seen: [usize; Q],
    softmaxes: &mut [Softmax; Q],
    weights: &mut Weights<Q>,
) -> [f32; Q] {
    // The queries are independent of each other: none waits for another's maximum.
    let (mut before, mut after) = ([0.0; WIDTH], [0.0; WIDTH]);
    for r in 0..Q {
        before[r] = softmaxes[r].max;
        after[r] = score::<ALL>(&mut weights.0[r], seen[r], before[r], x.scale, x.bias(i + r, first));
        softmaxes[r].max = after[r];
    }
    let shrink = to_array(softmax_exp(sub(load(&before), load(&after))));
    let mut result = [0.0; Q];
    for r in 0..Q {
        let max = splat(after[r]);
        let mut sum = [zero(); PARTS];
        for part in 0..PARTS {
            sum[part] = mul(load(&softmaxes[r].sum[part]), splat(shrink[r]));
        }
        let seen = if ALL { TILE } else { seen[r] };
        let registers = &mut weights.0[r].as_chunks_mut::<WIDTH>().0[..seen.div_ceil(WIDTH)];
        for (c, register) in registers.iter_mut().enumerate() {
            let weight = softmax_exp(sub(load(register), max));
            sum[c % PARTS] = add(sum[c % PARTS], weight);
            store(register, weight);
        }
        for part in 0..PARTS {
            store(&mut softmaxes[r].sum[part], sum[part]);
        }
        result[r] = shrink[r];
    }
    result
}

/// Turns the first `seen` dot products into scores, masks the rest of their last register, and
/// returns the largest. `ALL`: the whole tile is seen.
#[inline]
#[features]
fn score<const ALL: bool>(weights: &mut [f32; TILE], seen: usize, max: f32, scale: f32, bias: &[f32]) -> f32 {
    let seen = if ALL { TILE } else { seen };
    let mut highest = splat(max);
    let hidden = splat(f32::NEG_INFINITY);
    for (c, register) in weights.as_chunks_mut().0[..seen.div_ceil(WIDTH)].iter_mut().enumerate() {
        let bias = load_at(bias, c * WIDTH);
        let score = fmadd(load(register), splat(scale), bias);
        let score = select_first(seen - c * WIDTH, score, hidden);
        highest = max_lanes(highest, score);
        store(register, score);
    }
    reduce_max(highest)
}

/// `y[i + r] = y[i + r] * shrink[r] + sum_j weights[r][from + j] * v[j]`.
#[features]
fn values<V: Load, F: Prefetch, const Q: usize, const C: usize>(
    weights: &[[f32; TILE]; Q],
    from: usize,
    v: Mat<V>,
    fetch: &mut F,
    shrink: [f32; Q],
    i: usize,
    y: &mut MatMut<f32>,
) {
    let mut column = 0;
    while column < v.cols() {
        column += match v.cols() - column {
            1..WIDTH => columns::<V, F, Q, 1, true>(weights, from, v, fetch, shrink, (i, column), y),
            left if left < C * WIDTH => columns::<V, F, Q, 1, false>(weights, from, v, fetch, shrink, (i, column), y),
            _ => columns::<V, F, Q, C, false>(weights, from, v, fetch, shrink, (i, column), y),
        };
    }
}

/// Processes `C` registers of columns from `column` on, or (`PART`) part of one; returns
/// the number of columns.
#[features]
fn columns<V: Load, F: Prefetch, const Q: usize, const C: usize, const PART: bool>(
    weights: &[[f32; TILE]; Q],
    from: usize,
    v: Mat<V>,
    fetch: &mut F,
    shrink: [f32; Q],
    (i, column): (usize, usize),
    y: &mut MatMut<f32>,
) -> usize {
    let end = v.cols().min(column + C * WIDTH);
    let mut sums = [[zero(); C]; Q];
    for r in 0..Q {
        // There are no sums before the first tile.
        if shrink[r] != 0.0 {
            let y = &y.row(i + r)[column..end];
            for c in 0..C {
                sums[r][c] = mul(load_part(&y[c * WIDTH..]), splat(shrink[r]));
            }
        }
    }
    let v = v.columns(column..end);
    for j in 0..v.rows() {
        if j.is_multiple_of(DOTS) {
            fetch.advance();
        }
        let mut values = [zero(); C];
        if PART {
            values[0] = widened_part(v.row(j));
        } else {
            for c in 0..C {
                let v = v.chunk(j, c);
                fetch.touch(v, c);
                values[c] = widened(v);
            }
        }
        for r in 0..Q {
            let weight = splat(weights[r][from + j]);
            for c in 0..C {
                sums[r][c] = fmadd(weight, values[c], sums[r][c]);
            }
        }
    }
    for r in 0..Q {
        let y = &mut y.row_mut(i + r)[column..end];
        for c in 0..C {
            let to = &mut y[c * WIDTH..];
            store_part(to, sums[r][c]);
        }
    }
    end - column
}
