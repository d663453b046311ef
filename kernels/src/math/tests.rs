extern crate std;

use super::scalar;
use crate::isa::Isa;

/// Every 509th f32 of either sign, up to `limit`: all exponents, all roundings. `UMO_TEST_SWEEP` sets another step, for
/// slow emulated processors.
fn sweep(limit: f32) -> impl Iterator<Item = f32> {
    let step = std::env::var("UMO_TEST_SWEEP").map_or(509, |step| step.parse().expect("UMO_TEST_SWEEP is a number"));
    (0..=limit.to_bits()).step_by(step).flat_map(|bits| [f32::from_bits(bits), -f32::from_bits(bits)])
}

/// Error function in f64: `2/sqrt(pi) * exp(-x^2) * sum_n 2^n x^(2n+1) / (1 * 3 * .. * (2n+1))`, without
/// cancellation.
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

#[expect(clippy::cast_possible_truncation, reason = "measures the spacing of f32 around a value")]
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

/// `exp`, both forms of GELU and the other activations, of 16 values on every back-end.
mod back_ends {
    use crate::isa::{Isa, dispatch};
    use crate::math::Activation::{self, Gelu, GeluTanh, LeakyRelu, Relu};

    const ACTIVATIONS: [Activation; 4] = [Gelu, GeluTanh, Relu, LeakyRelu(0.2)];

    pub(super) fn all_bits(isa: Isa, x: [f32; 16]) -> [[u32; 16]; 5] {
        let mut y = [x; 5];
        dispatch!(isa, fill(&mut y));
        y.map(|y| y.map(|y| if y.is_nan() { f32::NAN.to_bits() } else { y.to_bits() }))
    }

    /// The exponentials of attention, of 16 values: `softmax_exp`, `softmax_exp_reduce`,
    /// `exp2_bf16`, `exp2_bf16_unmasked` and the first of `exp2_bf16_rounded`; a back-end without one of them runs
    /// another with the same bound.
    pub(super) fn exponentials(isa: Isa, x: [f32; 16]) -> [[f32; 16]; 5] {
        let mut y = [x; 5];
        dispatch!(isa, exponentials(&mut y));
        y
    }

    mod scalar {
        use super::ACTIVATIONS;
        use crate::math::scalar::{activate, exp, exp2_bf16};

        pub(super) fn exponentials(y: &mut [[f32; 16]; 5]) {
            *y = [y[0].map(exp), y[1].map(exp), y[2].map(exp2_bf16), y[3].map(exp2_bf16), y[4].map(exp2_bf16)];
        }

        pub(super) fn fill(y: &mut [[f32; 16]; 5]) {
            y[0] = y[0].map(exp);
            for (y, activation) in y[1..].iter_mut().zip(ACTIVATIONS) {
                *y = y.map(|x| activate(activation, x));
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    mod avx2 {
        use super::ACTIVATIONS;
        use crate::isa::{Avx2, entry};
        use crate::lanes::avx2::{load, store};
        use crate::math::avx2::{activate, exp, exp2_bf16_rounded, softmax_exp};

        entry! {
            pub(super) fn exponentials(_token: Avx2, y: &mut [[f32; 16]; 5]) {
                for (i, y) in y.iter_mut().enumerate() {
                    for y in y.as_chunks_mut().0 {
                        let x = load(y);
                        store(y, if i < 2 { softmax_exp(x) } else { exp2_bf16_rounded(x)[0] });
                    }
                }
            }

            pub(super) fn fill(_token: Avx2, y: &mut [[f32; 16]; 5]) {
                for half in 0..2 {
                    let [y, activated @ ..] = y;
                    let y = &mut y.as_chunks_mut().0[half];
                    let value = exp(load(y));
            store(y, value);
                    for (y, activation) in activated.iter_mut().zip(ACTIVATIONS) {
                        let y = &mut y.as_chunks_mut().0[half];
                        let value = activate(activation, load(y));
            store(y, value);
                    }
                }
            }
        }
    }

    #[cfg(target_arch = "aarch64")]
    mod neon {
        use super::ACTIVATIONS;
        use crate::isa::{Neon, entry};
        use crate::lanes::neon::{load, store};
        use crate::math::neon::{activate, exp, exp2_bf16, softmax_exp};

        entry! {
            pub(super) fn exponentials(_token: Neon, y: &mut [[f32; 16]; 5]) {
                for (i, y) in y.iter_mut().enumerate() {
                    for y in y.as_chunks_mut().0 {
                        let x = load(y);
                        store(y, if i < 2 { softmax_exp(x) } else { exp2_bf16(x) });
                    }
                }
            }

            pub(super) fn fill(_token: Neon, y: &mut [[f32; 16]; 5]) {
                for half in 0..2 {
                    let [y, activated @ ..] = y;
                    let y = &mut y.as_chunks_mut().0[half];
                    let value = exp(load(y));
            store(y, value);
                    for (y, activation) in activated.iter_mut().zip(ACTIVATIONS) {
                        let y = &mut y.as_chunks_mut().0[half];
                        let value = activate(activation, load(y));
            store(y, value);
                    }
                }
            }
        }
    }

    #[cfg(target_arch = "wasm32")]
    mod simd128 {
        use super::ACTIVATIONS;
        use crate::isa::Simd128;
        use crate::lanes::simd128::{load, store};
        use crate::math::simd128::{activate, exp, exp2_bf16};

        pub(super) fn exponentials(_token: Simd128, y: &mut [[f32; 16]; 5]) {
            for (i, y) in y.iter_mut().enumerate() {
                for y in y.as_chunks_mut().0 {
                    let x = load(y);
                    store(y, if i < 2 { exp(x) } else { exp2_bf16(x) });
                }
            }
        }

        pub(super) fn fill(_token: Simd128, y: &mut [[f32; 16]; 5]) {
            let [y, activated @ ..] = y;
            for y in y.as_chunks_mut().0 {
                let value = exp(load(y));
                store(y, value);
            }
            for (y, activation) in activated.iter_mut().zip(ACTIVATIONS) {
                for y in y.as_chunks_mut().0 {
                    let value = activate(activation, load(y));
                    store(y, value);
                }
            }
        }
    }

    #[cfg(target_arch = "x86_64")]
    mod avx512vnni {
        use super::ACTIVATIONS;
        use crate::isa::{Avx512Vnni, entry};
        use crate::lanes::avx512vnni::{load, store};
        use crate::math::avx512vnni::{
            activate, exp, exp2_bf16, exp2_bf16_rounded, exp2_bf16_unmasked, softmax_exp, softmax_exp_reduce,
        };

        entry! {
            pub(super) fn exponentials(_token: Avx512Vnni, y: &mut [[f32; 16]; 5]) {
                let x = load(&y[0]);
                let [power, _] = exp2_bf16_rounded(x);
                let values = [softmax_exp(x), softmax_exp_reduce(x), exp2_bf16(x), exp2_bf16_unmasked(x), power];
                for (y, value) in y.iter_mut().zip(values) {
                    store(y, value);
                }
            }

            pub(super) fn fill(_token: Avx512Vnni, y: &mut [[f32; 16]; 5]) {
                let [y, activated @ ..] = y;
                let value = exp(load(y));
            store(y, value);
                for (y, activation) in activated.iter_mut().zip(ACTIVATIONS) {
                    let value = activate(activation, load(y));
            store(y, value);
                }
            }
        }
    }
}

#[test]
fn back_ends_agree_bit_for_bit() {
    let special = [f32::INFINITY, f32::NEG_INFINITY, f32::NAN, f32::from_bits(0x7fc0_0001), -0.0, f32::MAX, f32::MIN];
    let mut values = sweep(f32::MAX).chain(special);
    while let Some(first) = values.next() {
        let x = core::array::from_fn(|lane| if lane == 0 { first } else { values.next().unwrap_or(1.0) });
        let want = back_ends::all_bits(Isa::SCALAR, x);
        for isa in Isa::available() {
            assert_eq!(back_ends::all_bits(isa, x), want, "{} {x:?}", isa.name());
        }
    }
}

/// Checks the bounds in the table of this module's documentation, for differences from a
/// maximum.
#[test]
fn exponentials_of_attention_are_within_their_bounds() {
    /// The bound of `exp2_bf16`, plus the rounding of the polynomial.
    const BF16: f64 = 1.03e-4 + 2.0 / (1 << 23) as f64;
    let mut values = sweep(126.0).filter(|x| *x <= 0.0).chain([-0.0]);
    while let Some(first) = values.next() {
        let x = core::array::from_fn(|lane| if lane == 0 { first } else { values.next().unwrap_or(-1.0) });
        for isa in Isa::available() {
            let y = back_ends::exponentials(isa, x);
            for (lane, x) in x.map(f64::from).into_iter().enumerate() {
                let [fused, reduced, bf16 @ ..] = y.map(|y| f64::from(y[lane]));
                let (name, exact) = (isa.name(), x.exp());
                if x >= f64::from(super::EXP_MIN) {
                    assert!((fused - exact).abs() <= ulp(exact), "{name} softmax_exp({x}): {fused}");
                    let bound = 1.5 * ulp(exact) + 1.25 * exact * x.abs() / (1 << 24) as f64;
                    assert!((reduced - exact).abs() <= bound, "{name} softmax_exp_reduce({x}): {reduced}");
                } else if x < -87.34 {
                    assert_eq!([fused, reduced], [0.0; 2], "{name} of {x}");
                }
                let exact = x.exp2();
                for value in bf16 {
                    assert!((value - exact).abs() <= exact * BF16, "{name} exp2_bf16({x}): {value}");
                }
            }
        }
    }
    for isa in Isa::available() {
        assert_eq!(back_ends::exponentials(isa, [0.0; 16]), [[1.0; 16]; 5], "{}", isa.name());
        assert_eq!(back_ends::exponentials(isa, [f32::NEG_INFINITY; 16]), [[0.0; 16]; 5], "{}", isa.name());
    }
}

#[test]
fn exp2_bf16_has_the_scalar_bits() {
    let mut values = sweep(200.0).filter(|x| *x <= 0.0);
    while let Some(first) = values.next() {
        let x = core::array::from_fn(|lane| if lane == 0 { first } else { values.next().unwrap_or(-1.0) });
        let want = back_ends::exponentials(Isa::SCALAR, x)[2].map(f32::to_bits);
        for isa in Isa::available() {
            for form in [2, 4] {
                assert_eq!(back_ends::exponentials(isa, x)[form].map(f32::to_bits), want, "{} {x:?}", isa.name());
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn a_rounded_exp2_is_the_nearest_bf16() {
    use crate::bf16::Bf16;
    use crate::isa::{Avx2, Avx512Vnni, Backend, entry};
    use crate::lanes::{avx2, avx512vnni};

    entry! {
        fn eight(_token: Avx2, y: &mut [f32; 8]) {
            let [_, rounded] = super::avx2::exp2_bf16_rounded(avx2::load(y));
            avx2::store(y, rounded);
        }

        fn sixteen(_token: Avx512Vnni, y: &mut [f32; 16]) {
            let [_, rounded] = super::avx512vnni::exp2_bf16_rounded(avx512vnni::load(y));
            avx512vnni::store(y, rounded);
        }
    }
    for backend in Isa::available().map(Isa::backend) {
        let mut values = sweep(200.0).filter(|x| *x <= 0.0).chain([f32::NEG_INFINITY, -126.0, -126.5]);
        while let Some(first) = values.next() {
            let x = core::array::from_fn(|lane| if lane == 0 { first } else { values.next().unwrap_or(-1.0) });
            let mut y: [f32; 16] = x;
            match backend {
                Backend::Avx2(token) => y.as_chunks_mut().0.iter_mut().for_each(|y| eight(token, y)),
                Backend::Avx512Vnni(token) => sixteen(token, &mut y),
                _ => break,
            }
            for (x, y) in x.into_iter().zip(y) {
                assert_eq!(y, Bf16::from_f32(scalar::exp2_bf16(x)).to_f32(), "of {x}");
            }
        }
    }
}
