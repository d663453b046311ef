//! 16 lanes, operation by operation as in `scalar.rs`.

use super::{
    Activation, EXP, EXP_MAX, EXP_MIN, EXP2, LN_2_HIGH, LN_2_LOW, LOG2_E, ROUND, TAIL, TAIL_MAX, TANH_CUBE, TANH_MAX,
    TANH_SCALE,
};
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// `e^x`.
#[inline]
#[avx512vnni]
pub(crate) fn exp(x: __m512) -> __m512 {
    let small = _mm512_cmp_ps_mask::<_CMP_LT_OQ>(x, _mm512_set1_ps(EXP_MIN));
    let large = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(x, _mm512_set1_ps(EXP_MAX));
    // NaN lanes stay NaN by themselves: every step of theirs is arithmetic.
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
    // The result is normal, so this scaling is exact, as is scalar's addition to the exponent's bits.
    _mm512_scalef_ps(_mm512_add_ps(power, _mm512_set1_ps(1.0)), n)
}

/// The tanh form of GELU.
#[inline]
#[avx512vnni]
pub(crate) fn gelu_tanh(x: __m512) -> __m512 {
    let slope = _mm512_fmadd_ps(_mm512_mul_ps(x, x), _mm512_set1_ps(TANH_CUBE), _mm512_set1_ps(TANH_SCALE));
    // The smaller in size of the two, with the first one's sign. What becomes of NaN here does not matter: `x` is NaN too.
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
    // The result is normal, so this scaling is exact, as is scalar's addition to the exponent's bits.
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
