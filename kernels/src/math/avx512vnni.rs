//! 16 lanes, operation by operation as in `scalar.rs`.

#[cfg(any(test, target_os = "linux"))]
use super::EXP2_UNIT;
use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, EXP2_BF16, EXP2_BF16_MIN, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, ROUND_BF16,
    TAIL, TAIL_MAX, TANH_CUBE, TANH_MAX, TANH_SCALE,
};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// `e^x`.
#[inline]
#[avx512vnni]
pub(crate) fn exp(x: __m512) -> __m512 {
    let small = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(x, _mm512_set1_ps(EXP_MIN));
    let large = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, _mm512_set1_ps(EXP_MAX));
    // NaN lanes stay NaN: every operation on them is arithmetic.
    let power = _mm512_mask_blend_ps(large, exp_in_range(x), _mm512_set1_ps(f32::INFINITY));
    _mm512_mask_blend_ps(small, power, _mm512_setzero_ps())
}

#[inline]
#[avx512vnni]
fn exp_in_range(x: __m512) -> __m512 {
    let round = _mm512_set1_ps(ROUND);
    let n = _mm512_sub_ps(_mm512_add_ps(_mm512_mul_ps(x, _mm512_set1_ps(LOG2_E)), round), round);
    let r = _mm512_sub_ps(x, _mm512_mul_ps(n, _mm512_set1_ps(LN_2_HIGH)));
    let r = _mm512_sub_ps(r, _mm512_mul_ps(n, _mm512_set1_ps(LN_2_LOW)));
    let mut tail = _mm512_set1_ps(EXP[0]);
    for &c in &EXP[1..] {
        tail = _mm512_add_ps(_mm512_mul_ps(tail, r), _mm512_set1_ps(c));
    }
    let power = _mm512_add_ps(_mm512_mul_ps(tail, _mm512_mul_ps(r, r)), r);
    // The result is normal, so this scaling is exact, like the scalar addition to the exponent's
    // bits.
    _mm512_scalef_ps(_mm512_add_ps(power, _mm512_set1_ps(1.0)), n)
}

/// The tanh form of GELU.
#[inline]
#[avx512vnni]
pub(crate) fn gelu_tanh(x: __m512) -> __m512 {
    let slope = _mm512_fmadd_ps(_mm512_mul_ps(x, x), _mm512_set1_ps(TANH_CUBE), _mm512_set1_ps(TANH_SCALE));
    // The smaller absolute value of the two, with the first one's sign. The result for NaN does not
    // matter: `x` is NaN too.
    let t = _mm512_range_ps::<2>(_mm512_mul_ps(x, slope), _mm512_set1_ps(TANH_MAX));
    _mm512_div_ps(x, _mm512_add_ps(exp2_in_range(t), _mm512_set1_ps(1.0)))
}

/// `2^t` for `-126..=126`.
#[inline]
#[avx512vnni]
fn exp2_in_range(t: __m512) -> __m512 {
    let round = _mm512_set1_ps(ROUND);
    let n = _mm512_sub_ps(_mm512_add_ps(t, round), round);
    let f = _mm512_sub_ps(t, n);
    // The result is normal, so this scaling is exact, like the scalar addition to the exponent's
    // bits.
    _mm512_scalef_ps(_mm512_fmadd_ps(polynomial(&EXP2, f), f, _mm512_set1_ps(1.0)), n)
}

/// The erf form of GELU.
#[inline]
#[avx512vnni]
pub(crate) fn gelu_erf(x: __m512) -> __m512 {
    let size = _mm512_min_ps(_mm512_set1_ps(TAIL_MAX), _mm512_abs_ps(x));
    let tail = exp2_in_range(polynomial(&TAIL, size));
    _mm512_fnmadd_ps(size, tail, _mm512_max_ps(x, _mm512_setzero_ps()))
}

/// [`Activation`] of 16 values, with the bits of [`super::scalar::activate`].
#[inline]
#[avx512vnni]
pub(crate) fn activate(activation: Activation, x: __m512) -> __m512 {
    let zero = _mm512_setzero_ps();
    match activation {
        Activation::None => x,
        Activation::Relu => _mm512_max_ps(x, zero),
        Activation::LeakyRelu(slope) => {
            let keep = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(x, zero);
            _mm512_mask_blend_ps(keep, _mm512_mul_ps(_mm512_set1_ps(slope), x), x)
        }
        Activation::Gelu => gelu_erf(x),
        Activation::GeluTanh => gelu_tanh(x),
    }
}

/// Horner's rule in fused steps, highest power first.
#[inline]
#[avx512vnni]
fn polynomial<const N: usize>(coefficients: &[f32; N], x: __m512) -> __m512 {
    let mut value = _mm512_set1_ps(coefficients[0]);
    for &c in &coefficients[1..] {
        value = _mm512_fmadd_ps(value, x, _mm512_set1_ps(c));
    }
    value
}

/// `e^x` of a difference from a maximum (`x <= 0`), with fused operations: within 1 ULP, 0 below
/// -87.33.
#[inline]
#[avx512vnni]
pub(crate) fn softmax_exp(x: __m512) -> __m512 {
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(x, _mm512_set1_ps(EXP_MIN));
    let n = _mm512_roundscale_ps::<0>(_mm512_mul_ps(x, _mm512_set1_ps(LOG2_E)));
    let r = _mm512_fnmadd_ps(n, _mm512_set1_ps(LN_2_HIGH), x);
    let r = _mm512_fnmadd_ps(n, _mm512_set1_ps(LN_2_LOW), r);
    let mut tail = _mm512_set1_ps(EXP[0]);
    for &c in &EXP[1..] {
        tail = _mm512_fmadd_ps(tail, r, _mm512_set1_ps(c));
    }
    let power = _mm512_fmadd_ps(tail, _mm512_mul_ps(r, r), r);
    _mm512_maskz_scalef_ps(normal, _mm512_add_ps(power, _mm512_set1_ps(1.0)), n)
}

/// `e^x` of a difference from a maximum (`x <= 0`), with the fewest operations: exactly 1 at 0,
/// otherwise within 1.5 ULP plus `1.25 * 2^-24 * abs(x)` of the value; 0 below -87.33.
#[cfg(any(test, target_os = "linux"))]
#[inline]
#[avx512vnni]
pub(crate) fn softmax_exp_reduce(x: __m512) -> __m512 {
    let x = _mm512_mul_ps(x, _mm512_set1_ps(LOG2_E));
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(x, _mm512_set1_ps(-126.0));
    // The fraction above the next lower integer, by which `scalef` scales.
    let r = _mm512_reduce_ps::<1>(x);
    let mut power = _mm512_set1_ps(EXP2_UNIT[0]);
    for &c in &EXP2_UNIT[1..] {
        power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(c));
    }
    _mm512_maskz_scalef_ps(normal, _mm512_fmadd_ps(power, r, _mm512_set1_ps(1.0)), x)
}

/// `2^t` of a difference from a maximum (`t <= 0`) that will be rounded to bf16: within 1.03e-4 of
/// the value, 0 below -126.
#[inline]
#[avx512vnni]
pub(crate) fn exp2_bf16(t: __m512) -> __m512 {
    let n = _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(t);
    let (r, mut power) = (_mm512_sub_ps(t, n), _mm512_set1_ps(EXP2_BF16[0]));
    for &c in &EXP2_BF16[1..] {
        power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(c));
    }
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(n, _mm512_set1_ps(EXP2_BF16_MIN));
    _mm512_maskz_scalef_ps(normal, _mm512_fmadd_ps(power, r, _mm512_set1_ps(1.0)), n)
}

/// [`exp2_bf16`], and the same rounded to bf16, in few operations: adding [`ROUND`] with rounding down leaves the
/// exponent in the lowest bits, and the significand is rounded before it is scaled.
#[inline]
#[avx512vnni]
pub(crate) fn exp2_bf16_rounded(t: __m512) -> [__m512; 2] {
    let floor = _mm512_add_round_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(t, _mm512_set1_ps(ROUND));
    let n = _mm512_sub_ps(floor, _mm512_set1_ps(ROUND));
    let (r, mut power) = (_mm512_sub_ps(t, n), _mm512_set1_ps(EXP2_BF16[0]));
    for &c in &EXP2_BF16[1..] {
        power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(c));
    }
    let power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(1.0));
    let round = _mm512_set1_ps(ROUND_BF16);
    let rounded = _mm512_sub_ps(_mm512_add_ps(power, round), round);
    let normal = _mm512_cmp_ps_mask::<_CMP_NLT_UQ>(n, _mm512_set1_ps(EXP2_BF16_MIN));
    let exponent = _mm512_slli_epi32::<23>(_mm512_castps_si512(floor));
    let (power, rounded) = (_mm512_castps_si512(power), _mm512_castps_si512(rounded));
    let (power, rounded) =
        (_mm512_maskz_add_epi32(normal, power, exponent), _mm512_maskz_add_epi32(normal, rounded, exponent));
    [_mm512_castsi512_ps(power), _mm512_castsi512_ps(rounded)]
}

/// [`exp2_bf16`] without its mask: denormal below -126, which becomes 0 when rounded,
/// and vanishes in a sum of at least 1.
#[cfg(any(test, target_os = "linux"))]
#[inline]
#[avx512vnni]
pub(crate) fn exp2_bf16_unmasked(t: __m512) -> __m512 {
    // The fraction above the next lower integer, by which `scalef` scales. Not with `vreduceps`,
    // which rounds the difference in the same direction as the integer, down; the scalar reference
    // rounds it to nearest.
    let r = _mm512_sub_ps(t, _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(t));
    let mut power = _mm512_set1_ps(EXP2_BF16[0]);
    for &c in &EXP2_BF16[1..] {
        power = _mm512_fmadd_ps(power, r, _mm512_set1_ps(c));
    }
    _mm512_scalef_ps(_mm512_fmadd_ps(power, r, _mm512_set1_ps(1.0)), t)
}
