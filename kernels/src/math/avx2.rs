//! 8 lanes, operation by operation as in `scalar.rs`.

use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, EXP2_BF16, EXP2_BF16_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, ROUND_BF16,
    TAIL, TAIL_MAX, TANH_CUBE, TANH_MAX, TANH_SCALE,
};
use core::arch::x86_64::*;
use umo_kernels_features::avx2;

/// `e^x`.
#[inline]
#[avx2]
pub(crate) fn exp(x: __m256) -> __m256 {
    let small = _mm256_cmp_ps::<_CMP_LT_OQ>(x, _mm256_set1_ps(EXP_MIN));
    let large = _mm256_cmp_ps::<_CMP_GT_OQ>(x, _mm256_set1_ps(EXP_MAX));
    let unordered = _mm256_cmp_ps::<_CMP_UNORD_Q>(x, x);
    let power = _mm256_blendv_ps(exp_in_range(x), _mm256_set1_ps(f32::INFINITY), large);
    _mm256_blendv_ps(_mm256_blendv_ps(power, _mm256_setzero_ps(), small), x, unordered)
}

#[inline]
#[avx2]
fn exp_in_range(x: __m256) -> __m256 {
    let round = _mm256_set1_ps(ROUND);
    let shifted = _mm256_add_ps(_mm256_mul_ps(x, _mm256_set1_ps(LOG2_E)), round);
    let n = _mm256_sub_ps(shifted, round);
    let r = _mm256_sub_ps(x, _mm256_mul_ps(n, _mm256_set1_ps(LN_2_HIGH)));
    let r = _mm256_sub_ps(r, _mm256_mul_ps(n, _mm256_set1_ps(LN_2_LOW)));
    let mut tail = _mm256_set1_ps(EXP[0]);
    for &c in &EXP[1..] {
        tail = _mm256_add_ps(_mm256_mul_ps(tail, r), _mm256_set1_ps(c));
    }
    let power = _mm256_add_ps(_mm256_mul_ps(tail, _mm256_mul_ps(r, r)), r);
    let power = _mm256_castps_si256(_mm256_add_ps(power, _mm256_set1_ps(1.0)));
    let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(shifted));
    _mm256_castsi256_ps(_mm256_add_epi32(power, exponent))
}

/// The tanh form of GELU.
#[inline]
#[avx2]
pub(crate) fn gelu_tanh(x: __m256) -> __m256 {
    let slope = _mm256_fmadd_ps(_mm256_mul_ps(x, x), _mm256_set1_ps(TANH_CUBE), _mm256_set1_ps(TANH_SCALE));
    let t = _mm256_min_ps(_mm256_set1_ps(TANH_MAX), _mm256_mul_ps(x, slope));
    let t = _mm256_max_ps(_mm256_set1_ps(-TANH_MAX), t);
    _mm256_div_ps(x, _mm256_add_ps(exp2_in_range(t), _mm256_set1_ps(1.0)))
}

/// `2^t` for `-126..=126`.
#[inline]
#[avx2]
fn exp2_in_range(t: __m256) -> __m256 {
    let round = _mm256_set1_ps(ROUND);
    let shifted = _mm256_add_ps(t, round);
    let f = _mm256_sub_ps(t, _mm256_sub_ps(shifted, round));
    let power = _mm256_castps_si256(_mm256_fmadd_ps(polynomial(&EXP2, f), f, _mm256_set1_ps(1.0)));
    let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(shifted));
    _mm256_castsi256_ps(_mm256_add_epi32(power, exponent))
}

/// The erf form of GELU.
#[inline]
#[avx2]
pub(crate) fn gelu_erf(x: __m256) -> __m256 {
    let size = _mm256_andnot_ps(_mm256_set1_ps(-0.0), x);
    let size = _mm256_min_ps(_mm256_set1_ps(TAIL_MAX), size);
    let tail = exp2_in_range(polynomial(&TAIL, size));
    _mm256_fnmadd_ps(size, tail, _mm256_max_ps(x, _mm256_setzero_ps()))
}

/// [`Activation`] of 8 values, with the bits of [`super::scalar::activate`].
#[inline]
#[avx2]
pub(crate) fn activate(activation: Activation, x: __m256) -> __m256 {
    let zero = _mm256_setzero_ps();
    match activation {
        Activation::None => x,
        Activation::Relu => _mm256_max_ps(x, zero),
        Activation::LeakyRelu(slope) => {
            let keep = _mm256_cmp_ps::<_CMP_GE_OQ>(x, zero);
            _mm256_blendv_ps(_mm256_mul_ps(_mm256_set1_ps(slope), x), x, keep)
        }
        Activation::Gelu => gelu_erf(x),
        Activation::GeluTanh => gelu_tanh(x),
    }
}

/// Horner's rule in fused steps, highest power first.
#[inline]
#[avx2]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: __m256) -> __m256 {
    let mut value = _mm256_set1_ps(coefficients[0]);
    for &c in &coefficients[1..] {
        value = _mm256_fmadd_ps(value, x, _mm256_set1_ps(c));
    }
    value
}

/// `e^x` of a difference from a maximum (`x <= 0`), with fused operations: within 1 ULP, 0 below
/// -87.33.
#[inline]
#[avx2]
pub(crate) fn softmax_exp(x: __m256) -> __m256 {
    let normal = _mm256_cmp_ps::<_CMP_NLT_UQ>(x, _mm256_set1_ps(EXP_MIN));
    let n =
        _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(_mm256_mul_ps(x, _mm256_set1_ps(LOG2_E)));
    let r = _mm256_fnmadd_ps(n, _mm256_set1_ps(LN_2_HIGH), x);
    let r = _mm256_fnmadd_ps(n, _mm256_set1_ps(LN_2_LOW), r);
    let mut tail = _mm256_set1_ps(EXP[0]);
    for &c in &EXP[1..] {
        tail = _mm256_fmadd_ps(tail, r, _mm256_set1_ps(c));
    }
    let power = _mm256_fmadd_ps(tail, _mm256_mul_ps(r, r), r);
    let exponent = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
    let power = _mm256_castps_si256(_mm256_add_ps(power, _mm256_set1_ps(1.0)));
    _mm256_and_ps(normal, _mm256_castsi256_ps(_mm256_add_epi32(power, exponent)))
}

/// `2^t` of a difference from a maximum (`t <= 0`): within 1.03e-4 of the value, 0 below -126; and the same rounded to
/// bf16: the significand is rounded before it is scaled.
#[inline]
#[avx2]
pub(crate) fn exp2_bf16_rounded(t: __m256) -> [__m256; 2] {
    let n = _mm256_floor_ps(t);
    let (r, mut power) = (_mm256_sub_ps(t, n), _mm256_set1_ps(EXP2_BF16[0]));
    for &c in &EXP2_BF16[1..] {
        power = _mm256_fmadd_ps(power, r, _mm256_set1_ps(c));
    }
    let normal = _mm256_cmp_ps::<_CMP_NLT_UQ>(n, _mm256_set1_ps(EXP2_BF16_MIN));
    let power = _mm256_fmadd_ps(power, r, _mm256_set1_ps(1.0));
    let round = _mm256_set1_ps(ROUND_BF16);
    let rounded = _mm256_sub_ps(_mm256_add_ps(power, round), round);
    let exponent = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
    let power = _mm256_add_epi32(_mm256_castps_si256(power), exponent);
    let rounded = _mm256_add_epi32(_mm256_castps_si256(rounded), exponent);
    [_mm256_and_ps(normal, _mm256_castsi256_ps(power)), _mm256_and_ps(normal, _mm256_castsi256_ps(rounded))]
}
