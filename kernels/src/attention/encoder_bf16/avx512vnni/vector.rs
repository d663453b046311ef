//! Registers and operations for the loops of attention over bf16 factors.

pub(super) use crate::attention::avx512vnni::vector::transpose;
pub(super) use crate::isa::Avx512Vnni as Token;
pub(super) use crate::lanes::LANES as WIDTH;
pub(super) use crate::lanes::avx512vnni::*;
use crate::math::avx512vnni::exp2_bf16_rounded;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;
pub(super) use umo_kernels_features::avx512vnni as features;

/// Queries at once.
pub(super) const QUERIES: usize = 4;

pub(super) const JOINED: usize = 1;

#[inline]
#[avx512vnni]
pub(super) fn join(_: Token, value: Register, _: Register) -> Register {
    round_to_bf16(value)
}

#[inline]
#[avx512vnni]
pub(super) fn factor(_: Token, [values]: [Register; JOINED]) -> Register {
    round_to_bf16(values)
}

/// `2^t` of differences from a maximum, and their factor.
#[inline]
#[avx512vnni]
pub(super) fn weights(_: Token, [t]: [Register; JOINED]) -> ([Register; JOINED], Register) {
    let [weight, rounded] = exp2_bf16_rounded(t);
    ([weight], rounded)
}

#[inline]
#[avx512vnni]
pub(super) fn multiply_add(_: Token, x: Register, w: Register, sum: Register) -> Register {
    fmadd(x, w, sum)
}

/// The nearest bfloat16, ties to even; denormals become 0.
#[inline]
#[avx512vnni]
fn round_to_bf16(x: Register) -> Register {
    const QUIET: i32 = 0x40_0000;
    let bits = _mm512_castps_si512(x);
    let odd = _mm512_and_si512(_mm512_srli_epi32::<16>(bits), _mm512_set1_epi32(1));
    let up = _mm512_add_epi32(bits, _mm512_add_epi32(odd, _mm512_set1_epi32(0x7fff)));
    let nan = _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(x, x);
    let up = _mm512_mask_or_epi32(up, nan, bits, _mm512_set1_epi32(QUIET));
    let denormal = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(x), _mm512_set1_ps(f32::MIN_POSITIVE));
    _mm512_castsi512_ps(_mm512_maskz_and_epi32(!denormal, up, _mm512_set1_epi32(!0xffff)))
}

/// Interleaves the words of the register's lower and upper halves.
#[inline]
#[avx512vnni]
pub(in crate::attention::encoder_bf16) fn interleave_halves(words: __m512i) -> Register {
    let places = _mm512_set_epi16(
        31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1,
        16, 0,
    );
    _mm512_castsi512_ps(_mm512_permutexvar_epi16(places, words))
}

/// `a / b`.
#[inline]
#[avx512vnni]
pub(in crate::attention::encoder_bf16) fn divide(a: Register, b: Register) -> Register {
    _mm512_div_ps(a, b)
}
