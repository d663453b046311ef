//! 4 queries x 32 keys, or 32 columns, are 8 registers of even products, of odd ones, and of what was summed before.

use super::loops::{loops, one_value_a_lane};
use super::{KEYS, LEAST, POWER, STEP, Softmax};
use crate::attention::avx512vnni::transpose;
use crate::attention::operands::Operands;
use crate::lanes::avx512vnni::*;
use crate::lanes::{LANES, LANES as WIDTH, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use core::arch::x86_64::*;

/// Queries at once.
const QUERIES: usize = 4;

one_value_a_lane!("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");
loops!("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");

/// The nearest bfloat16, ties to even; denormals are 0.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn rounded(x: Register) -> Register {
    const QUIET: i32 = 0x40_0000;
    let bits = _mm512_castps_si512(x);
    let odd = _mm512_and_si512(_mm512_srli_epi32::<16>(bits), _mm512_set1_epi32(1));
    let up = _mm512_add_epi32(bits, _mm512_add_epi32(odd, _mm512_set1_epi32(0x7fff)));
    let nan = _mm512_cmp_ps_mask::<_CMP_UNORD_Q>(x, x);
    let up = _mm512_mask_or_epi32(up, nan, bits, _mm512_set1_epi32(QUIET));
    let denormal = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(_mm512_abs_ps(x), _mm512_set1_ps(f32::MIN_POSITIVE));
    _mm512_castsi512_ps(_mm512_maskz_and_epi32(!denormal, up, _mm512_set1_epi32(!0xffff)))
}

/// The words of the register's lower half and those of its upper one, in turn.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn in_turn(words: __m512i) -> Register {
    let places = _mm512_set_epi16(
        31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23, 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1,
        16, 0,
    );
    _mm512_castsi512_ps(_mm512_permutexvar_epi16(places, words))
}

/// `2^t` of differences from a maximum.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn power(t: Register) -> Register {
    let n = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(t);
    let (r, mut power) = (sub(t, n), set(POWER[0]));
    for &c in &POWER[1..] {
        power = fmadd(power, r, set(c));
    }
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(n, set(LEAST));
    _mm512_maskz_scalef_ps(normal, fmadd(power, r, set(1.0)), n)
}

/// `a / b`.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
pub(super) fn divide(a: Register, b: Register) -> Register {
    _mm512_div_ps(a, b)
}
