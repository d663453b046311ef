//! Registers and operations for the loops of attention over bf16 factors.

pub(super) use crate::attention::avx512vnni::vector::transpose;
pub(super) use crate::attention::encoder_bf16::avx512vnni::vector::divide;
use crate::attention::encoder_bf16::avx512vnni::vector::interleave_halves;
use crate::bf16::avx512bf16::{multiply_pairs, round_two};
pub(super) use crate::isa::Avx512Bf16 as Token;
pub(super) use crate::lanes::LANES as WIDTH;
pub(super) use crate::lanes::avx512vnni::*;
use crate::math::avx512vnni::exp2_bf16;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;
pub(super) use umo_kernels_features::avx512vnni as features;

/// Queries at once.
pub(super) const QUERIES: usize = 4;

/// Values per lane.
pub(super) const JOINED: usize = 2;

/// Joins two rows: each lane holds the value of the first row in its upper half and that of the
/// second in its lower half.
#[inline]
#[avx512vnni]
pub(super) fn join(token: Token, first: Register, second: Register) -> Register {
    let words = round_two(token, second, first);
    interleave_halves(words)
}

/// Joins, of each four values, the first and the third in the first lane, the second and the fourth in the
/// second; the earlier one is in the upper half.
#[inline]
#[avx512vnni]
pub(super) fn factor(token: Token, [first, second]: [Register; JOINED]) -> Register {
    let places = _mm512_broadcast_i32x4(_mm_setr_epi8(4, 5, 0, 1, 6, 7, 2, 3, 12, 13, 8, 9, 14, 15, 10, 11));
    let words = round_two(token, first, second);
    _mm512_castsi512_ps(_mm512_shuffle_epi8(words, places))
}

/// `2^t` of differences from a maximum, and their factor.
#[inline]
#[avx512vnni]
pub(super) fn weights(token: Token, [t, u]: [Register; JOINED]) -> ([Register; JOINED], Register) {
    let weights = [exp2_bf16(t), exp2_bf16(u)];
    (weights, factor(token, weights))
}

/// `sum + x * w` of each lane's first values, then of its second values.
#[inline]
#[avx512vnni]
pub(super) fn multiply_add(token: Token, x: Register, w: Register, sum: Register) -> Register {
    multiply_pairs(token, x, w, sum)
}
