//! Registers and operations for the loops of attention over bf16 factors.

pub(super) use crate::isa::Simd128 as Token;
use crate::lanes::simd128;
pub(super) use crate::lanes::simd128::{
    Register, WIDTH, add, divide, fmadd, load, load_at, load_part, max_lanes, mul, reduce_max, select_first, splat,
    store, store_part, sub, zero,
};
use crate::math::simd128::exp2_bf16;
use core::arch::wasm32::*;
pub(super) use umo_kernels_features::simd128 as features;

/// Queries at once.
pub(super) const QUERIES: usize = 2;

pub(super) const JOINED: usize = 1;

#[inline]
pub(super) fn join(_: Token, value: Register, _: Register) -> Register {
    round_to_bf16(value)
}

#[inline]
pub(super) fn factor(_: Token, [values]: [Register; JOINED]) -> Register {
    round_to_bf16(values)
}

/// `2^t` of differences from a maximum, and their factor.
#[inline]
pub(super) fn weights(token: Token, [t]: [Register; JOINED]) -> ([Register; JOINED], Register) {
    let weights = [exp2_bf16(t)];
    (weights, factor(token, weights))
}

/// Products of two bf16 values are exact: rounding them changes nothing.
#[inline]
pub(super) fn multiply_add(_: Token, x: Register, w: Register, sum: Register) -> Register {
    simd128::multiply_add(x, w, sum)
}

/// Rows to columns.
#[inline]
pub(super) fn transpose([a, b, c, d]: [Register; WIDTH]) -> [Register; WIDTH] {
    let (low, high) = (
        [i32x4_shuffle::<0, 4, 1, 5>(a, b), i32x4_shuffle::<0, 4, 1, 5>(c, d)],
        [i32x4_shuffle::<2, 6, 3, 7>(a, b), i32x4_shuffle::<2, 6, 3, 7>(c, d)],
    );
    [
        i64x2_shuffle::<0, 2>(low[0], low[1]),
        i64x2_shuffle::<1, 3>(low[0], low[1]),
        i64x2_shuffle::<0, 2>(high[0], high[1]),
        i64x2_shuffle::<1, 3>(high[0], high[1]),
    ]
}

/// The nearest bfloat16, ties to even; denormals become 0.
#[inline]
fn round_to_bf16(x: Register) -> Register {
    const QUIET: u32 = 0x40_0000;
    let odd = v128_and(u32x4_shr(x, 16), u32x4_splat(1));
    let up = u32x4_add(x, u32x4_add(odd, u32x4_splat(0x7fff)));
    let rounded = v128_bitselect(up, v128_or(x, u32x4_splat(QUIET)), f32x4_eq(x, x));
    let denormal = f32x4_lt(f32x4_abs(x), splat(f32::MIN_POSITIVE));
    v128_andnot(rounded, v128_or(denormal, u32x4_splat(0xffff)))
}
