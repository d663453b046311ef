//! `exp` and the two forms of GELU, one polynomial formulation for every back-end.
//!
//! The vector versions follow `scalar.rs` operation by operation, so that all back-ends agree **bit for bit**. Multiplications
//! and additions of `exp` are rounded one by one, since fused ones cost a library call each in portable scalar code. Not so those of
//! GELU, which is more work than all else at the end of a product: both forms are fused, and have as few operations as their
//! bound allows, the tanh form 19 instead of 33, the erf form 21 instead of 41.
//!
//! Error bounds, swept over all exponents: `exp` 1 ULP (results below 1.2e-38 are 0), both forms of GELU 4 ULP plus
//! `1e-7 * abs(x)`.

pub(crate) mod scalar;

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512vnni;

/// An element-wise function.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Activation {
    /// The identity.
    #[default]
    None,
    /// `max(v, 0)`.
    Relu,
    /// `v` where positive, else `slope * v`.
    LeakyRelu(f32),
    /// `v * (1 + erf(v / sqrt(2))) / 2`.
    Gelu,
    /// The tanh approximation of GELU.
    GeluTanh,
}

/// Above this, `exp` is infinite.
const EXP_MAX: f32 = 88.722_84;
/// Below this, `exp` is 0: a little above the logarithm of the smallest normal number, so that no result is denormal.
pub(crate) const EXP_MIN: f32 = -87.33;

/// `log2(e)`.
pub(crate) const LOG2_E: f32 = core::f32::consts::LOG2_E;
/// Added and subtracted again, rounds to an integer (ties to even), which then stands in the lowest bits of the sum.
const ROUND: f32 = 12_582_912.0;
/// `ln(2)` to 9 bits: its product with an exponent is exact.
pub(crate) const LN_2_HIGH: f32 = 0.693_359_4;
/// What is left of `ln(2)`.
pub(crate) const LN_2_LOW: f32 = -2.121_944_4e-4;
/// Minimax `(exp(r) - 1 - r) / r^2` for `abs(r) <= ln(2) / 2`, highest power first: off by 3.1e-9 in `exp(r)`.
pub(crate) const EXP: [f32; 5] = [0.001_395_049_2, 0.008_368_89, 0.041_666_206, 0.166_665_18, 0.5];

/// `-2 * sqrt(2 / pi) * log2(e)`.
const TANH_SCALE: f32 = -2.302_208_2;
/// The same times the cube's share in the tanh form, 0.044715.
const TANH_CUBE: f32 = -0.102_943_24;
/// The tanh form's power of 2 stops here, on either side: its result is normal, and the sigmoid or what it lacks to 1 below
/// 1.2e-38.
const TANH_MAX: f32 = 126.0;
/// Minimax `(2^f - 1) / f` for `abs(f) <= 1 / 2`, highest power first: off by 1.1e-7 in `2^f`, of which a quarter at most arrives
/// in the sigmoid, and half in the normal distribution's tail.
#[expect(clippy::approx_constant, reason = "the last coefficient is fitted, and happens to lie near ln(2)")]
const EXP2: [f32; 5] = [0.001_326_472_7, 0.009_671_513, 0.055_507_336, 0.240_222_42, 0.693_147];

/// Beyond this the normal distribution's tail is taken as constant: 3e-16.
const TAIL_MAX: f32 = 8.0;
/// Minimax of `log2(erfc(a / sqrt(2)) / 2)` on `0..=8`, weighted by the tail itself and 3e-8 more, highest power first: off by 2e-8 in
/// the tail. A polynomial in the exponent needs no division, and is never wrong in the tail's size.
const TAIL: [f32; 9] = [
    -1.533_552_1e-6,
    2.541_39e-5,
    -1.273_172_5e-4,
    -2.617_050_2e-4,
    0.007_204_758,
    -0.052_580_08,
    -0.459_184_47,
    -1.151_107_8,
    -0.999_999_94,
];

#[cfg(test)]
mod tests {
    use super::scalar;
    use crate::isa::{Backend, Isa};

    /// Every 509th f32 of either sign, up to `limit`: all exponents, all roundings.
    fn sweep(limit: f32) -> impl Iterator<Item = f32> {
        (0..=limit.to_bits()).step_by(509).flat_map(|bits| [f32::from_bits(bits), -f32::from_bits(bits)])
    }

    /// Error function in f64: `2/sqrt(pi) * exp(-x^2) * sum_n 2^n x^(2n+1) / (1 * 3 * .. * (2n+1))`, no cancellation.
    fn erf(x: f64) -> f64 {
        let size = x.abs();
        if size >= 6.0 {
            return 1.0_f64.copysign(x);
        }
        let (mut term, mut sum, mut n) = (size, size, 1.0);
        while term > sum * 1e-17 {
            term *= 2.0 * size * size / (2.0 * n + 1.0);
            sum += term;
            n += 1.0;
        }
        (core::f64::consts::FRAC_2_SQRT_PI * (-size * size).exp() * sum).copysign(x)
    }

    #[expect(clippy::cast_possible_truncation, reason = "the spacing of f32 around a value is what is measured")]
    fn ulp(exact: f64) -> f64 {
        let size = (exact.abs() as f32).max(f32::MIN_POSITIVE);
        f64::from(f32::from_bits(size.to_bits() + 1)) - f64::from(size)
    }

    #[test]
    fn exp_is_within_one_ulp() {
        for x in sweep(88.7).filter(|x| *x >= super::EXP_MIN) {
            let exact = f64::from(x).exp();
            assert!((f64::from(scalar::exp(x)) - exact).abs() <= ulp(exact), "exp({x})");
        }
        assert_eq!(scalar::exp(f32::NEG_INFINITY), 0.0);
        assert_eq!(scalar::exp(f32::INFINITY), f32::INFINITY);
        assert_eq!(scalar::exp(0.0), 1.0);
        assert!(scalar::exp(f32::NAN).is_nan());
    }

    #[test]
    fn gelu_is_within_its_bound() {
        for x in sweep(1e6) {
            let wide = f64::from(x);
            let erf_form = 0.5 * wide * (1.0 + erf(wide * core::f64::consts::FRAC_1_SQRT_2));
            let error = (f64::from(scalar::gelu_erf(x)) - erf_form).abs();
            assert!(error <= 4.0 * ulp(erf_form) + 1e-7 * wide.abs(), "gelu_erf({x}): off by {error}");
            let u = (2.0 / core::f64::consts::PI).sqrt() * (wide + 0.044_715 * wide * wide * wide);
            let tanh_form = 0.5 * wide * (1.0 + u.tanh());
            let error = (f64::from(scalar::gelu_tanh(x)) - tanh_form).abs();
            assert!(error <= 4.0 * ulp(tanh_form) + 1e-7 * wide.abs(), "gelu_tanh({x}): off by {error}");
        }
    }

    /// Bits of `exp`, both forms of GELU and the other activations, of 16 values by one back-end.
    fn all_bits(isa: Isa, x: [f32; 16]) -> [[u32; 16]; 5] {
        use crate::math::Activation::{self, Gelu, GeluTanh, LeakyRelu, Relu};
        let activations: [Activation; 4] = [Gelu, GeluTanh, Relu, LeakyRelu(0.2)];
        let mut y = [x; 5];
        match isa.0 {
            Backend::Scalar => {
                y[0] = x.map(scalar::exp);
                for (y, activation) in y[1..].iter_mut().zip(activations) {
                    *y = x.map(|x| scalar::activate(activation, x));
                }
            }
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Isa` holds `Avx2` only after detection of every feature that `fill` enables.
            Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::fill(&mut y, activations) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that `fill` enables.
            Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::fill(&mut y, activations) },
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
            Backend::Amx => unsafe { avx512vnni::fill(&mut y, activations) },
        }
        y.map(|y| y.map(|y| if y.is_nan() { f32::NAN.to_bits() } else { y.to_bits() }))
    }

    #[cfg(target_arch = "x86_64")]
    mod avx2 {
        use crate::math::Activation;
        use crate::math::avx2::{activate, exp};
        use core::arch::x86_64::*;

        #[target_feature(enable = "avx2,fma")]
        fn each(y: &mut [f32; 16], f: impl Fn(__m256) -> __m256) {
            for y in y.as_chunks_mut::<8>().0 {
                // SAFETY: `y` is 8 readable floats.
                let x = unsafe { _mm256_loadu_ps(y.as_ptr()) };
                // SAFETY: `y` is 8 writable floats.
                unsafe { _mm256_storeu_ps(y.as_mut_ptr(), f(x)) };
            }
        }

        #[target_feature(enable = "avx2,fma")]
        pub(super) fn fill(y: &mut [[f32; 16]; 5], activations: [Activation; 4]) {
            each(&mut y[0], |x| exp(x));
            for (y, activation) in y[1..].iter_mut().zip(activations) {
                each(y, |x| activate(activation, x));
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    mod avx512vnni {
        use crate::math::Activation;
        use crate::math::avx512vnni::{activate, exp};
        use core::arch::x86_64::*;

        #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
        fn each(y: &mut [f32; 16], f: impl Fn(__m512) -> __m512) {
            // SAFETY: `y` is 16 readable floats.
            let x = unsafe { _mm512_loadu_ps(y.as_ptr()) };
            // SAFETY: `y` is 16 writable floats.
            unsafe { _mm512_storeu_ps(y.as_mut_ptr(), f(x)) };
        }

        #[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
        pub(super) fn fill(y: &mut [[f32; 16]; 5], activations: [Activation; 4]) {
            each(&mut y[0], |x| exp(x));
            for (y, activation) in y[1..].iter_mut().zip(activations) {
                each(y, |x| activate(activation, x));
            }
        }
    }

    #[test]
    fn back_ends_agree_bit_for_bit() {
        let special =
            [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::from_bits(0x7fc0_0001), -0.0, f32::MAX, f32::MIN];
        let mut values = sweep(f32::MAX).chain(special);
        while let Some(first) = values.next() {
            let x = core::array::from_fn(|lane| if lane == 0 { first } else { values.next().unwrap_or(1.0) });
            let want = all_bits(Isa::SCALAR, x);
            for isa in Isa::available() {
                assert_eq!(all_bits(isa, x), want, "{} {x:?}", isa.name());
            }
        }
    }
}
