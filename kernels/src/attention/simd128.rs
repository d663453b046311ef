//! `scalar.rs` in registers: the same sums in the same order, so that all results have the scalar
//! bits.

use super::operands::{HeadOperands, Operands};
use super::scalar;
use crate::bf16::Bf16;
use crate::isa::Simd128;
use crate::lanes::LANES;
use crate::lanes::simd128::{
    REGISTERS, Register, WIDTH, add, divide, load, load_bf16, load_part, load_part_bf16, max_lanes, mul, multiply_add,
    reduce_max, splat, store, store_part, sub, zero,
};
use crate::mat::{Mat, MatMut};
use crate::math::scalar::exp as exp_of_one;
use crate::math::simd128::exp;
use crate::tiling::Tiling;
use core::arch::wasm32::{f32x4_extract_lane, i32x4_shuffle};

/// Keys whose scores are held at once.
const TILE: usize = 64;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Simd128) -> Tiling {
    scalar::tiling()
}

/// Storage type of keys and values, widened to f32 when loaded.
pub(super) trait Load: Copy {
    fn load(src: &[Self; WIDTH]) -> Register;
    /// The first values, padded with zeros.
    fn load_part(src: &[Self]) -> Register;
}

impl Load for f32 {
    #[inline]
    fn load(src: &[Self; WIDTH]) -> Register {
        load(src)
    }

    #[inline]
    fn load_part(src: &[Self]) -> Register {
        load_part(src)
    }
}

impl Load for Bf16 {
    #[inline]
    fn load(src: &[Self; WIDTH]) -> Register {
        load_bf16(src)
    }

    #[inline]
    fn load_part(src: &[Self]) -> Register {
        load_part_bf16(src)
    }
}

pub(super) fn attention<T: Load>(_token: Simd128, x: Operands<T>, mut y: MatMut<f32>) {
    for i in 0..x.q.rows() {
        let keys = 0..x.keys(i);
        query(x.q.row(i), x.k.row_range(keys.clone()), x.v.row_range(keys), x.scale, x.bias(i, 0), y.row_mut(i));
    }
}

/// Sizes at which the loops over heads change.
pub(super) fn heads_tiling(_token: Simd128) -> Tiling {
    scalar::heads_tiling()
}

/// Every head separately.
pub(super) fn heads(token: Simd128, x: HeadOperands, mut y: MatMut<f32>) {
    x.each(&mut y, |x, y| attention(token, x, y));
}

/// One query over all its keys; `y` holds the sum of values scaled by `exp(score - max)` until the
/// end.
fn query<T: Load>(q: &[f32], k: Mat<T>, v: Mat<T>, scale: f32, bias: &[f32], y: &mut [f32]) {
    let (mut max, mut sums) = (f32::NEG_INFINITY, [zero(); REGISTERS]);
    y.fill(0.0);
    for first in (0..k.rows()).step_by(TILE) {
        let count = TILE.min(k.rows() - first);
        let mut weights = [f32::NEG_INFINITY; TILE];
        for (j, score) in weights[..count].iter_mut().enumerate() {
            *score = scale * dot(q, k.row(first + j)) + bias.get(first + j).unwrap_or(&0.0);
        }
        let (registers, _) = weights.as_chunks_mut::<WIDTH>();
        let registers = &mut registers[..count.div_ceil(WIDTH)];
        let new_max = reduce_max(registers.iter().fold(splat(max), |max, scores| max_lanes(max, load(scores))));
        let shrink = exp_of_one(max - new_max);
        max = new_max;
        sums = sums.map(|sum| mul(sum, splat(shrink)));
        for (c, scores) in registers.iter_mut().enumerate() {
            let value = exp(sub(load(scores), splat(max)));
            sums[c % REGISTERS] = add(sums[c % REGISTERS], value);
            store(scores, value);
        }
        add_values(&weights[..count], v.row_range(first..first + count), shrink, y);
    }
    let sum = splat(total(sums));
    for y in y.chunks_mut(WIDTH) {
        let value = divide(load_part(y), sum);
        store_part(y, value);
    }
}

/// `y = y * shrink + sum_j weights[j] * v[j]`, in ascending order of keys.
fn add_values<T: Load>(weights: &[f32], v: Mat<T>, shrink: f32, y: &mut [f32]) {
    for (block, y) in y.chunks_mut(LANES).enumerate() {
        let mut sums = [zero(); REGISTERS];
        for (sum, y) in sums.iter_mut().zip(y.chunks(WIDTH)) {
            // Not a product, whose zeros may be negative.
            *sum = if shrink == 0.0 { zero() } else { mul(load_part(y), splat(shrink)) };
        }
        let columns = block * LANES..block * LANES + y.len();
        for (j, &weight) in weights.iter().enumerate() {
            let (weight, row) = (splat(weight), &v.row(j)[columns.clone()]);
            if let Some(row) = row.first_chunk::<LANES>() {
                for (sum, v) in sums.iter_mut().zip(row.as_chunks().0) {
                    *sum = multiply_add(weight, T::load(v), *sum);
                }
            } else {
                for (sum, v) in sums.iter_mut().zip(row.chunks(WIDTH)) {
                    *sum = multiply_add(weight, T::load_part(v), *sum);
                }
            }
        }
        for (sum, y) in sums.iter().zip(y.chunks_mut(WIDTH)) {
            store_part(y, *sum);
        }
    }
}

/// `sum_i a[i] * b[i]` in [`LANES`] partial sums, added pairwise at the end.
#[inline]
fn dot<T: Load>(a: &[f32], b: &[T]) -> f32 {
    let mut sums = [zero(); REGISTERS];
    let ((a, a_tail), (b, b_tail)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    for (a, b) in a.iter().zip(b) {
        for (sum, (a, b)) in sums.iter_mut().zip(a.as_chunks().0.iter().zip(b.as_chunks().0)) {
            *sum = multiply_add(load(a), T::load(b), *sum);
        }
    }
    // Products of padding are zeros, and a sum that starts at zero never becomes a negative zero.
    for (sum, (a, b)) in sums.iter_mut().zip(a_tail.chunks(WIDTH).zip(b_tail.chunks(WIDTH))) {
        *sum = multiply_add(load_part(a), T::load_part(b), *sum);
    }
    total(sums)
}

/// The sum of all lanes, added pairwise.
#[inline]
fn total(sums: [Register; REGISTERS]) -> f32 {
    let four = add(add(sums[0], sums[2]), add(sums[1], sums[3]));
    let two = add(four, i32x4_shuffle::<2, 3, 0, 1>(four, four));
    f32x4_extract_lane::<0>(add(two, i32x4_shuffle::<1, 0, 3, 2>(two, two)))
}
