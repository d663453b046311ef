//! Registers and operations for the loops of attention over bf16 factors.

pub(super) use crate::attention::avx2::vector::transpose;
pub(super) use crate::isa::Avx2 as Token;
pub(super) use crate::lanes::avx2::{HALF as WIDTH, *};
use crate::math::avx2::exp2_bf16_rounded;
use core::arch::x86_64::*;
use umo_kernels_features::avx2;
pub(super) use umo_kernels_features::avx2 as features;

/// Queries at once.
pub(super) const QUERIES: usize = 2;

pub(super) const JOINED: usize = 1;

#[inline]
#[avx2]
pub(super) fn join(_: Token, value: Register, _: Register) -> Register {
    round_to_bf16(value)
}

#[inline]
#[avx2]
pub(super) fn factor(_: Token, [values]: [Register; JOINED]) -> Register {
    round_to_bf16(values)
}

/// `2^t` of differences from a maximum, and their factor.
#[inline]
#[avx2]
pub(super) fn weights(_: Token, [t]: [Register; JOINED]) -> ([Register; JOINED], Register) {
    let [weight, rounded] = exp2_bf16_rounded(t);
    ([weight], rounded)
}

#[inline]
#[avx2]
pub(super) fn multiply_add(_: Token, x: Register, w: Register, sum: Register) -> Register {
    fmadd(x, w, sum)
}

/// The nearest bfloat16, ties to even; denormals become 0.
#[inline]
#[avx2]
fn round_to_bf16(x: Register) -> Register {
    const QUIET: i32 = 0x40_0000;
    let bits = _mm256_castps_si256(x);
    let odd = _mm256_and_si256(_mm256_srli_epi32::<16>(bits), _mm256_set1_epi32(1));
    let up = _mm256_add_epi32(bits, _mm256_add_epi32(odd, _mm256_set1_epi32(0x7fff)));
    let quiet = _mm256_or_si256(bits, _mm256_set1_epi32(QUIET));
    let nan = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_UNORD_Q>(x, x));
    let up = _mm256_and_si256(_mm256_blendv_epi8(up, quiet, nan), _mm256_set1_epi32(!0xffff));
    let size = _mm256_andnot_ps(splat(-0.0), x);
    let denormal = _mm256_cmp_ps::<_CMP_LT_OQ>(size, splat(f32::MIN_POSITIVE));
    _mm256_andnot_ps(denormal, _mm256_castsi256_ps(up))
}

/// `a / b`.
#[inline]
#[avx2]
pub(super) fn divide(a: Register, b: Register) -> Register {
    _mm256_div_ps(a, b)
}
