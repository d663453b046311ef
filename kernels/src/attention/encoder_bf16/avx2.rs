//! As `avx512vnni.rs`, in registers of 8 lanes: 2 queries x 16 keys or columns are 4 registers each.

use super::loops::{loops, one_value_a_lane};
use super::{KEYS, LEAST, POWER, STEP, Softmax};
use crate::attention::avx2::transpose;
use crate::attention::operands::Operands;
use crate::lanes::avx2::{HALF as WIDTH, *};
use crate::lanes::{LANES, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use core::arch::x86_64::*;

/// Queries at once.
const QUERIES: usize = 2;

one_value_a_lane!("avx2,fma");
loops!("avx2,fma");

/// The nearest bfloat16, ties to even; denormals are 0.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn rounded(x: Register) -> Register {
    const QUIET: i32 = 0x40_0000;
    let bits = _mm256_castps_si256(x);
    let odd = _mm256_and_si256(_mm256_srli_epi32::<16>(bits), _mm256_set1_epi32(1));
    let up = _mm256_add_epi32(bits, _mm256_add_epi32(odd, _mm256_set1_epi32(0x7fff)));
    let quiet = _mm256_or_si256(bits, _mm256_set1_epi32(QUIET));
    let nan = _mm256_castps_si256(_mm256_cmp_ps::<_CMP_UNORD_Q>(x, x));
    let up = _mm256_and_si256(_mm256_blendv_epi8(up, quiet, nan), _mm256_set1_epi32(!0xffff));
    let size = _mm256_andnot_ps(set(-0.0), x);
    let denormal = _mm256_cmp_ps::<_CMP_LT_OQ>(size, set(f32::MIN_POSITIVE));
    _mm256_andnot_ps(denormal, _mm256_castsi256_ps(up))
}

/// `2^t` of differences from a maximum.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn power(t: Register) -> Register {
    let n = _mm256_floor_ps(t);
    let (r, mut power) = (sub(t, n), set(POWER[0]));
    for &c in &POWER[1..] {
        power = fmadd(power, r, set(c));
    }
    let normal = _mm256_cmp_ps::<_CMP_NLT_UQ>(n, set(LEAST));
    let power = _mm256_castps_si256(fmadd(power, r, set(1.0)));
    let scaled = _mm256_add_epi32(power, _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n)));
    _mm256_and_ps(normal, _mm256_castsi256_ps(scaled))
}

/// `a / b`.
#[inline]
#[target_feature(enable = "avx2,fma")]
fn divide(a: Register, b: Register) -> Register {
    _mm256_div_ps(a, b)
}
