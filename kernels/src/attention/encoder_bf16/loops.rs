//! The loops of the vector back-ends, lanes along keys and then along columns.
//!
//! The module that calls it has, besides loads and stores: `WIDTH` lanes of a `Register`; `QUERIES`, `COLUMNS`; the operations
//! `zero`, `set`, `add`, `sub`, `mul`, `fmadd`, `divide`, `maximum`, `largest`, `first_of`, `rounded`, `power`; and `transpose`.

macro_rules! loops {
    ($features:literal) => {
        /// Queries that share one packing of keys and values.
        const BLOCK: usize = 64;

        /// Columns of values packed at once.
        const WIDE: usize = 64;

        /// Registers whose lanes are those of a sum of weights.
        const HALF: usize = LANES / WIDTH;

        /// What one call keeps between its loops, at the start of a cache line each.
        #[repr(align(64))]
        struct Work<const N: usize> {
            /// Up to 32 of `head_dim`, rounded: `[STEP, N]`.
            k: [[f32; N]; STEP],
            /// Rounded.
            v: [[f32; WIDE]; N],
            /// Dot products, then scores, then weights.
            scores: [[f32; N]; BLOCK],
        }

        /// Keys of a short sequence, for which less is cleared.
        const FEW: usize = 64;

        #[target_feature(enable = $features)]
        pub(in super::super) fn attention(x: Operands<f32>, y: MatMut<f32>) {
            if x.k.rows() <= FEW { run::<FEW>(x, y) } else { run::<KEYS>(x, y) }
        }

        /// `N` keys at a time.
        #[target_feature(enable = $features)]
        fn run<const N: usize>(x: Operands<f32>, mut y: MatMut<f32>) {
            let mut work = Work { k: [[0.0; N]; STEP], v: [[0.0; WIDE]; N], scores: [[0.0; N]; BLOCK] };
            let Work { k, v, scores } = &mut work;
            for start in (0..x.q.rows()).step_by(BLOCK) {
                let count = BLOCK.min(x.q.rows() - start);
                let mut softmaxes = [Softmax::START; BLOCK];
                let softmaxes = &mut softmaxes[..count];
                for first in (0..x.k.rows()).step_by(N) {
                    let keys = first..x.k.rows().min(first + N);
                    scores[..count].as_flattened_mut().fill(0.0);
                    for at in (0..x.q.cols()).step_by(STEP) {
                        pack_keys(x.k.row_range(keys.clone()), at, k);
                        for (group, scores) in scores[..count].chunks_mut(QUERIES[0]).enumerate() {
                            multiply(x.q, start + group * QUERIES[0], at, k, keys.len(), scores);
                        }
                    }
                    for (r, softmax) in softmaxes.iter_mut().enumerate() {
                        let bias = x.bias(start + r, first);
                        weigh(&mut scores[r], keys.len(), x.scale * LOG2_E, bias, softmax);
                    }
                    let place = (first > 0, keys.end == x.k.rows());
                    for at in (0..x.v.cols()).step_by(WIDE) {
                        pack_values(x.v.row_range(keys.clone()), at, v);
                        for r in (0..count).step_by(QUERIES[1]) {
                            let end = count.min(r + QUERIES[1]);
                            let (_, mut y) = y.reborrow().split_rows(start + r);
                            add_values(v, at, keys.len(), &scores[r..end], &softmaxes[r..end], place, &mut y);
                        }
                    }
                }
            }
        }

        /// A register of what stands in `row` from `at` on, then zeros. A masked load where there is nothing costs a hundred others.
        #[inline]
        #[target_feature(enable = $features)]
        fn from(row: &[f32], at: usize) -> Register {
            row.get(at..).filter(|rest| !rest.is_empty()).map_or(zero(), |rest| load_part(rest))
        }

        /// The columns `at ..` of `k`, as many as a step has, rounded, as rows; zeros where there are none.
        #[target_feature(enable = $features)]
        fn pack_keys<const N: usize>(k: Mat<f32>, at: usize, packed: &mut [[f32; N]; STEP]) {
            for first in (0..k.rows()).step_by(WIDTH) {
                for d in (0..STEP).step_by(WIDTH) {
                    let mut rows = [zero(); WIDTH];
                    for j in 0..WIDTH.min(k.rows() - first) {
                        rows[j] = rounded(from(k.row(first + j), at + d));
                    }
                    for (column, to) in transpose(rows).iter().zip(&mut packed[d..d + WIDTH]) {
                        store_part(&mut to[first..first + WIDTH], *column);
                    }
                }
            }
        }

        /// The columns `at ..` of `v`, as many as there is room for, rounded; zeros where there are none, up to a whole step of keys.
        #[target_feature(enable = $features)]
        fn pack_values<const N: usize>(v: Mat<f32>, at: usize, packed: &mut [[f32; WIDE]; N]) {
            for (j, to) in packed[..v.rows().next_multiple_of(STEP)].iter_mut().enumerate() {
                let row = if j < v.rows() { &v.row(j)[at..] } else { &[] };
                for (c, to) in to.as_chunks_mut().0.iter_mut().enumerate() {
                    store(to, rounded(from(row, c * WIDTH)));
                }
            }
        }

        /// Adds to the dot products of the queries from `i` on, as many as there are `scores`, what the step from `at` on gives.
        #[target_feature(enable = $features)]
        fn multiply<const N: usize>(
            q: Mat<f32>,
            i: usize,
            at: usize,
            k: &[[f32; N]; STEP],
            keys: usize,
            scores: &mut [[f32; N]],
        ) {
            let mut queries = [[0.0; STEP]; QUERIES[0]];
            for r in 0..scores.len() {
                let row = &q.row(i + r)[at..];
                for (c, to) in queries[r].as_chunks_mut().0.iter_mut().enumerate() {
                    store(to, rounded(from(row, c * WIDTH)));
                }
            }
            for t in 0..keys.div_ceil(2 * WIDTH) {
                let mut both = [[[zero(); 2]; QUERIES[0]]; 2];
                for (odd, both) in both.iter_mut().enumerate() {
                    let mut sums = [[zero(); 2]; QUERIES[0]];
                    for d in (odd..STEP).step_by(2) {
                        let keys = k[d].as_chunks().0;
                        let (a, b) = (load(&keys[2 * t]), load(&keys[2 * t + 1]));
                        for r in 0..QUERIES[0] {
                            let q = set(queries[r][d]);
                            sums[r][0] = fmadd(q, a, sums[r][0]);
                            sums[r][1] = fmadd(q, b, sums[r][1]);
                        }
                    }
                    *both = sums;
                }
                for (r, scores) in scores.iter_mut().enumerate() {
                    for side in 0..2 {
                        let to = &mut scores.as_chunks_mut().0[2 * t + side];
                        store(to, add(load(to), add(both[0][r][side], both[1][r][side])));
                    }
                }
            }
        }

        /// Turns the dot products of one query with `keys` keys into scores and these into weights, rounded, zeros up to a whole step.
        #[target_feature(enable = $features)]
        fn weigh(scores: &mut [f32], keys: usize, scale: f32, bias: &[f32], softmax: &mut Softmax) {
            let hidden = set(f32::NEG_INFINITY);
            let mut max = hidden;
            let (scores, _) = scores[..keys.next_multiple_of(STEP)].as_chunks_mut();
            for (c, scores) in scores.iter_mut().enumerate() {
                let bias = mul(from(bias, c * WIDTH), set(LOG2_E));
                let all = fmadd(load(scores), set(scale), bias);
                let seen = first_of(keys.saturating_sub(c * WIDTH), all, hidden);
                store(scores, seen);
                max = maximum(max, seen);
            }
            softmax.meet(largest(max));
            let max = set(softmax.max);
            let mut sums = [zero(); HALF];
            for scores in scores.chunks_exact_mut(2 * HALF) {
                for h in 0..HALF {
                    let (a, b) = (power(sub(load(&scores[h]), max)), power(sub(load(&scores[HALF + h]), max)));
                    sums[h] = add(sums[h], add(a, b));
                    store(&mut scores[h], rounded(a));
                    store(&mut scores[HALF + h], rounded(b));
                }
            }
            let mut lanes = [0.0; LANES];
            for (to, sum) in lanes.as_chunks_mut().0.iter_mut().zip(sums) {
                store(to, sum);
            }
            softmax.add(pairwise(lanes));
        }

        /// Adds the columns `at ..` of values, weighted, to the first rows of `y`, one for each of `weights`. `others` came before
        /// these keys, or they are the `last`.
        #[target_feature(enable = $features)]
        fn add_values<const N: usize>(
            v: &[[f32; WIDE]; N],
            at: usize,
            keys: usize,
            weights: &[[f32; N]],
            softmaxes: &[Softmax],
            (others, last): (bool, bool),
            y: &mut MatMut<f32>,
        ) {
            let mut rows = [&weights[0]; QUERIES[1]];
            for (row, weights) in rows.iter_mut().zip(weights) {
                *row = weights;
            }
            let wide = WIDE.min(y.cols() - at);
            for column in (0..wide).step_by(COLUMNS * WIDTH) {
                let mut sums = [[zero(); COLUMNS]; QUERIES[1]];
                for step in (0..keys).step_by(STEP) {
                    let mut both = [[[zero(); COLUMNS]; QUERIES[1]]; 2];
                    for (odd, both) in both.iter_mut().enumerate() {
                        let mut sums = [[zero(); COLUMNS]; QUERIES[1]];
                        for j in (step + odd..step + STEP).step_by(2) {
                            let values = v[j][column..].as_chunks().0;
                            for c in 0..COLUMNS {
                                let value = load(&values[c]);
                                for r in 0..QUERIES[1] {
                                    sums[r][c] = fmadd(set(rows[r][j]), value, sums[r][c]);
                                }
                            }
                        }
                        *both = sums;
                    }
                    for r in 0..QUERIES[1] {
                        for c in 0..COLUMNS {
                            sums[r][c] = add(sums[r][c], add(both[0][r][c], both[1][r][c]));
                        }
                    }
                }
                for (r, softmax) in softmaxes.iter().enumerate() {
                    let y = &mut y.row_mut(r)[at + column..];
                    for (y, mut sum) in y.chunks_mut(WIDTH).zip(sums[r]) {
                        if others {
                            sum = fmadd(load_part(y), set(softmax.shrink), sum);
                        }
                        if last {
                            sum = divide(sum, set(softmax.sum));
                        }
                        store_part(y, sum);
                    }
                }
            }
        }
    };
}

pub(super) use loops;
