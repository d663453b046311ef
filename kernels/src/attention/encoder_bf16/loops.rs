//! The loops of the vector back-ends, lanes along keys and then along columns, compiled once per
//! instruction set: every back-end includes this file as its module `loops`. Its module `vector`
//! holds the differences: the register of `WIDTH` lanes with its operations, `QUERIES`, the
//! attribute `features` and a `Token` that proves the instructions; and the contents of a lane of a
//! factor: `JOINED` values of one sum, 1 or 2, with `factor`, which rounds and joins neighbours in a
//! row, `join`, which rounds and joins values of two rows, `weights`, which returns powers of 2 and their
//! factor, and `multiply_add`.
//!
//! ```text
//! a step of 32      e0 o0 e1 o1 e2 o2 e3 o3 ...        even and odd values are summed separately
//! JOINED 1          e0 | o0 | e1 | o1 | ...            rows of a panel, and lanes of a row of queries or weights
//! JOINED 2          e0 e1 | o0 o1 | e2 e3 | ...        the same, half as many
//! ```

use super::vector::{
    JOINED, QUERIES, Register, Token, WIDTH, add, divide, factor, features, fmadd, join, load, load_at, load_part,
    max_lanes, mul, multiply_add, reduce_max, select_first, splat, store, store_part, sub, transpose, weights, zero,
};
use crate::attention::encoder_bf16::{KEYS, STEP, Softmax};
use crate::attention::operands::Operands;
use crate::lanes::{LANES, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use crate::tiling::Tiling;

/// Queries per block; their scores stay in L1.
const BLOCK: usize = 16;

/// Queries that share one packing of keys and values.
const GROUP: usize = 256;

/// Columns packed at once.
const WIDE: usize = 64;

/// Adjacent keys, or columns of values: two registers.
const PANEL: usize = 2 * WIDTH;

/// Rows of a panel per step.
const ROWS: usize = STEP / JOINED;

/// Registers that hold the lanes of a sum of weights.
const HALF: usize = LANES / WIDTH;

/// The buffers of one call, each aligned to a cache line.
#[repr(align(64))]
struct Work<const N: usize> {
    /// Rounded and joined, as rows of [`PANEL`]: `[N / PANEL, WIDE / JOINED, PANEL]`.
    k: [[f32; N]; WIDE / JOINED],
    /// Rounded and joined, as rows of [`PANEL`]: `[WIDE / PANEL, N / JOINED, PANEL]`.
    v: [[f32; WIDE / JOINED]; N],
    /// Rounded and joined.
    q: [[f32; WIDE / JOINED]; BLOCK],
    /// Dot products, then scores, then weights, rounded and joined.
    scores: [[f32; N]; BLOCK],
    /// The largest score in each lane.
    largest: [[f32; WIDTH]; BLOCK],
    /// Biases of a group times `log2(e)`, those of its last query from the first one on.
    biases: [f32; GROUP + KEYS],
}

/// Keys of a short sequence, for which smaller buffers are cleared.
const FEW: usize = 64;

/// Sizes at which the loops change.
pub(super) const TILING: Tiling =
    Tiling { rows: &[QUERIES, BLOCK, GROUP], outputs: &[PANEL, FEW, KEYS], inputs: &[STEP, WIDE], held: 0, chunk: 0 };

#[features]
pub(in crate::attention) fn attention(token: Token, x: Operands<f32>, y: MatMut<f32>) {
    if x.k.rows() <= FEW { run::<FEW>(token, x, y) } else { run::<KEYS>(token, x, y) }
}

/// `N` keys at a time.
#[features]
fn run<const N: usize>(token: Token, x: Operands<f32>, mut y: MatMut<f32>) {
    let mut work = Work {
        k: [[0.0; N]; WIDE / JOINED],
        v: [[0.0; WIDE / JOINED]; N],
        q: [[0.0; WIDE / JOINED]; BLOCK],
        scores: [[0.0; N]; BLOCK],
        largest: [[0.0; WIDTH]; BLOCK],
        biases: [0.0; GROUP + KEYS],
    };
    let Work { k, v, q, scores, largest, biases } = &mut work;
    let (k, _) = k.as_flattened_mut().as_chunks_mut();
    let (v, _) = v.as_flattened_mut().as_chunks_mut();
    for start in (0..x.q.rows()).step_by(GROUP) {
        let count = GROUP.min(x.q.rows() - start);
        let mut softmaxes = [Softmax::START; GROUP];
        for first in (0..x.k.rows()).step_by(N) {
            let keys = first..x.k.rows().min(first + N);
            let place = (first > 0, keys.end == x.k.rows());
            scale_biases(x.bias(start + count - 1, first), count - 1 + keys.len(), biases);
            for block in (0..count).step_by(BLOCK) {
                let queries = BLOCK.min(count - block);
                let (scores, softmaxes) = (&mut scores[..queries], &mut softmaxes[block..block + queries]);
                let largest = &mut largest[..queries];
                let scaled = Scaled { scale: x.scale * LOG2_E, biases: &biases[..], last: count - 1 - block };
                for at in (0..x.q.cols()).step_by(WIDE) {
                    // The packing is reused by all blocks unless another
                    // range of columns replaces it.
                    if block == 0 || x.q.cols() > WIDE {
                        pack_keys(token, x.k.row_range(keys.clone()), at, k);
                    }
                    for (r, to) in q[..queries].iter_mut().enumerate() {
                        let row = &x.q.row(start + block + r)[at..];
                        for (c, to) in to.as_chunks_mut().0.iter_mut().enumerate() {
                            store(to, factor_from(token, row, c * WIDTH * JOINED));
                        }
                    }
                    let columns = WIDE.min(x.q.cols() - at);
                    let scaled = (at + columns == x.q.cols()).then_some((scaled, &mut *largest));
                    multiply(token, &q[..queries], k, (columns, keys.len()), at > 0, scaled, scores);
                }
                for (softmax, largest) in softmaxes.iter_mut().zip(&*largest) {
                    softmax.update_max(reduce_max(load(largest)));
                }
                for (scores, softmax) in scores.iter_mut().zip(&mut *softmaxes) {
                    softmax_weights(token, &mut scores[..keys.len().next_multiple_of(STEP)], softmax);
                }
                let (_, mut y) = y.reborrow().split_rows(start + block);
                for at in (0..x.v.cols()).step_by(WIDE) {
                    if block == 0 || x.v.cols() > WIDE {
                        pack_values::<N>(token, x.v.row_range(keys.clone()), at, v);
                    }
                    add_values(token, v, (at, keys.len()), scores, softmaxes, place, &mut y);
                }
            }
        }
    }
}

/// A register of values of `row` from `at` on, rounded and joined, padded with zeros.
#[inline]
#[features]
fn factor_from(token: Token, row: &[f32], at: usize) -> Register {
    let mut values = [zero(); JOINED];
    for (i, values) in values.iter_mut().enumerate() {
        *values = load_at(row, at + i * WIDTH);
    }
    factor(token, values)
}

/// Packs the columns `at ..` of `k`, at most [`WIDE`], rounded and joined, as rows, padded with
/// zeros to a whole step.
#[features]
fn pack_keys(token: Token, k: Mat<f32>, at: usize, packed: &mut [[f32; PANEL]]) {
    let columns = WIDE.min(k.cols() - at).next_multiple_of(STEP);
    for first in (0..k.rows()).step_by(WIDTH) {
        let panel = &mut packed[first / PANEL * (WIDE / JOINED)..][..columns / JOINED];
        for (d, panel) in panel.chunks_exact_mut(WIDTH).enumerate() {
            let mut rows = [zero(); WIDTH];
            for j in 0..WIDTH.min(k.rows() - first) {
                rows[j] = factor_from(token, k.row(first + j), at + d * WIDTH * JOINED);
            }
            for (to, column) in panel.iter_mut().zip(transpose(rows)) {
                store(&mut to.as_chunks_mut().0[first / WIDTH % 2], column);
            }
        }
    }
}

/// Packs the columns `at ..` of `v`, at most [`WIDE`], rounded and joined, padded with zeros to
/// a whole step of keys.
#[features]
fn pack_values<const N: usize>(token: Token, v: Mat<f32>, at: usize, packed: &mut [[f32; PANEL]]) {
    let value = |j: usize, c: usize| {
        let row = if j < v.rows() { &v.row(j)[at..] } else { &[] };
        load_at(row, c * WIDTH)
    };
    for row in 0..v.rows().next_multiple_of(STEP) / JOINED {
        let j = row / 2 * 2 * JOINED + row % 2;
        for c in 0..WIDE / WIDTH {
            let second = if JOINED == 2 { value(j + 2, c) } else { zero() };
            let joined = join(token, value(j, c), second);
            store(&mut packed[c / 2 * (N / JOINED) + row].as_chunks_mut().0[c % 2], joined);
        }
    }
}

/// The first biases times `log2(e)`; zeros where there are none.
#[features]
fn scale_biases(biases: &[f32], len: usize, scaled: &mut [f32]) {
    for (c, scaled) in scaled.as_chunks_mut().0[..len.div_ceil(WIDTH)].iter_mut().enumerate() {
        store(scaled, mul(load_at(biases, c * WIDTH), splat(LOG2_E)));
    }
}

/// What turns dot products into scores.
#[derive(Clone, Copy)]
struct Scaled<'a> {
    scale: f32,
    biases: &'a [f32],
    /// Index of the first query's first bias; of each further query it is one less.
    last: usize,
}

/// Computes the dot products of queries with as many columns and keys; `more`: adds them to the
/// scores of earlier columns. Even and odd products of a step and the running sums are separate
/// registers. With `scaled` the products are complete, and scores are stored, padded with minus infinity to
/// a whole step, and the largest in each lane.
#[features]
fn multiply<const N: usize>(
    token: Token,
    q: &[[f32; WIDE / JOINED]],
    k: &[[f32; PANEL]],
    (columns, keys): (usize, usize),
    more: bool,
    mut scaled: Option<(Scaled, &mut [[f32; WIDTH]])>,
    scores: &mut [[f32; N]],
) {
    let hidden = splat(f32::NEG_INFINITY);
    if let Some((_, largest)) = &mut scaled {
        for (largest, scores) in largest.iter_mut().zip(scores.iter_mut()) {
            store(largest, hidden);
            scores[keys.next_multiple_of(PANEL)..keys.next_multiple_of(STEP)].fill(f32::NEG_INFINITY);
        }
    }
    for t in 0..keys.div_ceil(PANEL) {
        let panel = &k[t * (WIDE / JOINED)..][..columns.next_multiple_of(STEP) / JOINED];
        let (steps, _) = panel.as_chunks::<ROWS>();
        for (group, (q, scores)) in q.chunks(QUERIES).zip(scores.chunks_mut(QUERIES)).enumerate() {
            let mut rows = [&q[0]; QUERIES];
            for (row, q) in rows.iter_mut().zip(q) {
                *row = q;
            }
            let mut sums = [[zero(); 2]; QUERIES];
            if more {
                for (sums, scores) in sums.iter_mut().zip(scores.iter()) {
                    let (scores, _) = scores.as_chunks();
                    *sums = [load(&scores[2 * t]), load(&scores[2 * t + 1])];
                }
            }
            for (step, k) in steps.iter().enumerate() {
                let mut inputs = [&[0.0; ROWS]; QUERIES];
                for r in 0..QUERIES {
                    inputs[r] = &rows[r].as_chunks().0[step];
                }
                dot_step(token, &inputs, k, &mut sums);
            }
            for (r, scores) in scores.iter_mut().enumerate() {
                if let Some((scaled, largest)) = &mut scaled {
                    let query = QUERIES * group + r;
                    let (biases, _) = scaled.biases[scaled.last - query + t * PANEL..].as_chunks();
                    let mut max = load(&largest[query]);
                    for side in 0..2 {
                        let score = fmadd(sums[r][side], splat(scaled.scale), load(&biases[side]));
                        let left = keys.saturating_sub(t * PANEL + side * WIDTH);
                        let seen = if left < WIDTH { select_first(left, score, hidden) } else { score };
                        max = max_lanes(max, seen);
                        sums[r][side] = seen;
                    }
                    store(&mut largest[query], max);
                }
                let (scores, _) = scores.as_chunks_mut();
                store(&mut scores[2 * t], sums[r][0]);
                store(&mut scores[2 * t + 1], sums[r][1]);
            }
        }
    }
}

/// Adds one step's products of rows with a panel.
#[inline]
#[features]
fn dot_step(
    token: Token,
    rows: &[&[f32; ROWS]; QUERIES],
    panel: &[[f32; PANEL]; ROWS],
    sums: &mut [[Register; 2]; QUERIES],
) {
    let mut both = [[[zero(); 2]; QUERIES]; 2];
    for i in 0..ROWS / 2 {
        for odd in 0..2 {
            let (values, _) = panel[2 * i + odd].as_chunks();
            let (a, b) = (load(&values[0]), load(&values[1]));
            for r in 0..QUERIES {
                let x = splat(rows[r][2 * i + odd]);
                both[odd][r][0] = multiply_add(token, x, a, both[odd][r][0]);
                both[odd][r][1] = multiply_add(token, x, b, both[odd][r][1]);
            }
        }
    }
    for r in 0..QUERIES {
        for side in 0..2 {
            sums[r][side] = add(sums[r][side], add(both[0][r][side], both[1][r][side]));
        }
    }
}

/// Turns the scores of one query into weights, rounded and joined.
#[features]
fn softmax_weights(token: Token, scores: &mut [f32], softmax: &mut Softmax) {
    let (scores, _) = scores.as_chunks_mut();
    let max = splat(softmax.max);
    let mut sums = [zero(); HALF];
    for step in 0..scores.len() / (2 * HALF) {
        let mut powers = [zero(); 2 * HALF];
        for (i, powers) in powers.as_chunks_mut::<JOINED>().0.iter_mut().enumerate() {
            for (j, power) in powers.iter_mut().enumerate() {
                *power = sub(load(&scores[step * 2 * HALF + i * JOINED + j]), max);
            }
            let rounded;
            (*powers, rounded) = weights(token, *powers);
            // Overwrites scores that have been read.
            store(&mut scores[step * 2 * HALF / JOINED + i], rounded);
        }
        for h in 0..HALF {
            sums[h] = add(sums[h], add(powers[h], powers[HALF + h]));
        }
    }
    let mut lanes = [0.0; LANES];
    for (to, sum) in lanes.as_chunks_mut().0.iter_mut().zip(sums) {
        store(to, sum);
    }
    softmax.add(pairwise(lanes));
}

/// Adds the columns `at ..` of values, weighted, to the first rows of `y`, one for each of
/// `weights`. `others`: there were keys before these; `last`: there are none after.
#[features]
fn add_values<const N: usize>(
    token: Token,
    v: &[[f32; PANEL]],
    (at, keys): (usize, usize),
    weights: &[[f32; N]],
    softmaxes: &[Softmax],
    (others, last): (bool, bool),
    y: &mut MatMut<f32>,
) {
    for (panel, column) in (at..y.cols().min(at + WIDE)).step_by(PANEL).enumerate() {
        let panel = &v[panel * (N / JOINED)..][..keys.next_multiple_of(STEP) / JOINED];
        let (steps, _) = panel.as_chunks::<ROWS>();
        for first in (0..weights.len()).step_by(QUERIES) {
            let count = QUERIES.min(weights.len() - first);
            let mut rows = [&weights[first]; QUERIES];
            rows[..count].iter_mut().zip(&weights[first..]).for_each(|(row, weights)| *row = weights);
            let mut sums = [[zero(); 2]; QUERIES];
            for (step, v) in steps.iter().enumerate() {
                let mut inputs = [&[0.0; ROWS]; QUERIES];
                for r in 0..QUERIES {
                    inputs[r] = &rows[r].as_chunks().0[step];
                }
                dot_step(token, &inputs, v, &mut sums);
            }
            for (r, softmax) in softmaxes[first..first + count].iter().enumerate() {
                let y = &mut y.row_mut(first + r)[column..];
                for (y, mut sum) in y.chunks_mut(WIDTH).zip(sums[r]) {
                    if others {
                        sum = fmadd(load_part(y), splat(softmax.shrink), sum);
                    }
                    if last {
                        sum = divide(sum, splat(softmax.sum));
                    }
                    store_part(y, sum);
                }
            }
        }
    }
}
