//! Element-wise functions against f64 over their whole range; softmax and argmax at every length.

use proptest::prelude::*;
use umo_kernels::Isa;
use umo_kernels::activation::{Activation, apply, argmax, softmax};
use umo_kernels::tiling::LANES;
use umo_tests::{EPSILON, Guarded, Noise, Placed, SMALLEST_POWER, bits, cases, fill, for_each_isa, near, offset, ulp};

/// `activation` of every value of `x`, in a buffer that starts `offset` elements in.
fn applied(isa: Isa, activation: Activation, x: &[f32], offset: usize) -> Vec<f32> {
    let mut y = Guarded::slice(x.len(), offset);
    y.first_row().copy_from_slice(x);
    apply(isa, activation, y.first_row());
    y.checked().remove(0)
}

/// `(x, Phi(x))` for the multiples of 1/1024 in -12..12, Phi the integral of the normal density by
/// Simpson's rule from the left: its error of about 1e-16 per cell adds up to 1e-12.
fn normal_integral() -> Vec<(f32, f64)> {
    let density = |x: f64| (-0.5 * x * x).exp() / (2.0 * std::f64::consts::PI).sqrt();
    let mut sum = 0.0;
    (-12 * 1024..12 * 1024_i16)
        .map(|i| {
            let (x, step) = (f32::from(i) / 1024.0, 1.0 / 1024.0);
            let (here, at) = (sum, f64::from(x));
            sum += step / 6.0 * (density(at) + 4.0 * density(at + step / 2.0) + density(at + step));
            (x, here)
        })
        .collect()
}

/// Checks the contract's bound.
fn assert_gelu(name: &str, x: f32, got: f32, want: f64) {
    let tolerance = 4.0 * ulp(want) + 1e-7 * f64::from(x.abs());
    assert!((f64::from(got) - want).abs() <= tolerance, "{name}({x}) = {got}, not {want}");
}

fn gelu_is_near_f64(isa: Isa) {
    let (x, phi): (Vec<f32>, Vec<f64>) = normal_integral().into_iter().unzip();
    for ((&x, phi), got) in x.iter().zip(phi).zip(applied(isa, Activation::Gelu, &x, 0)) {
        assert_gelu("gelu", x, got, f64::from(x) * phi);
    }
    let far = [12.0, 100.0, 1e18, 3e38];
    assert_eq!(applied(isa, Activation::Gelu, &far, 0), far);
    for (x, got) in [-12.0_f32, -100.0, -1e18].iter().zip(applied(isa, Activation::Gelu, &[-12.0, -100.0, -1e18], 0)) {
        assert!(got.abs() <= 1e-14, "gelu({x}) = {got}");
    }
}

fn gelu_tanh_is_near_f64(isa: Isa) {
    let mut x: Vec<f32> = (-15 * 1024..15 * 1024_i16).map(|i| f32::from(i) / 1024.0).collect();
    x.extend([-1e6, -40.0, 40.0, 1e6, 1e-6, -1e-6, 1e-30, -1e-30]);
    for (&x, got) in x.iter().zip(applied(isa, Activation::GeluTanh, &x, 0)) {
        let wide = f64::from(x);
        let inner = (2.0 / std::f64::consts::PI).sqrt() * (wide + 0.044_715 * wide * wide * wide);
        assert_gelu("gelu_tanh", x, got, 0.5 * wide * (1.0 + inner.tanh()));
    }
}

fn piecewise_activations_are_exact(isa: Isa) {
    proptest!(cases(96), |(len in near(LANES, 6), offset in offset(), fill in fill(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x: Vec<f32> = (0..len).map(|_| fill.next(&mut noise)).collect();
        prop_assert_eq!(&applied(isa, Activation::None, &x, offset), &x);
        let relu: Vec<f32> = x.iter().map(|&x| if x > 0.0 { x } else { 0.0 }).collect();
        prop_assert_eq!(applied(isa, Activation::Relu, &x, offset), relu);
        let leaky: Vec<f32> = x.iter().map(|&x| if x >= 0.0 { x } else { 0.2 * x }).collect();
        prop_assert_eq!(applied(isa, Activation::LeakyRelu(0.2), &x, offset), leaky);
    });
}

/// An element has the same bits whatever its neighbours.
fn activations_of_an_element_are_the_same_anywhere(isa: Isa) {
    proptest!(cases(48), |(len in near(LANES, 6), offset in offset(), fill in fill(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x: Vec<f32> = (0..len).map(|_| fill.next(&mut noise)).collect();
        for activation in [Activation::Gelu, Activation::GeluTanh, Activation::LeakyRelu(0.1)] {
            let together = applied(isa, activation, &x, offset);
            let alone = x.iter().map(|&x| applied(isa, activation, &[x], 0)[0]).collect();
            prop_assert_eq!(bits(&[together]), bits(&[alone]));
        }
    });
}

/// Error of a term: the difference from the maximum is rounded once, `exp` is within 3 units, and
/// the sum has `len` terms.
fn softmax_is_near_f64(isa: Isa) {
    let len = prop_oneof![near(LANES, 6), near(4 * LANES, 4)];
    proptest!(cases(96), |(len in len, offset in offset(), fill in fill(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x: Vec<f32> = (0..len).map(|_| fill.next(&mut noise)).collect();
        let mut y = Guarded::slice(len, offset);
        y.first_row().copy_from_slice(&x);
        softmax(isa, y.first_row());
        let max = f64::from(x.iter().fold(f32::NEG_INFINITY, |max, &x| max.max(x)));
        let total: f64 = x.iter().map(|&x| (f64::from(x) - max).exp()).sum();
        for (&x, got) in x.iter().zip(y.checked().remove(0)) {
            let below = max - f64::from(x);
            let want = (-below).exp() / total;
            let tolerance = (below + 5.0 + len as f64) * EPSILON * want + SMALLEST_POWER;
            prop_assert!((f64::from(got) - want).abs() <= tolerance, "softmax({x}) = {got}, not {want}");
        }
    });
}

fn argmax_finds_the_first_largest(isa: Isa) {
    let special = [f32::NAN, f32::NEG_INFINITY, f32::INFINITY, 0.0, -0.0, 1.0, -1.0, f32::MIN, 1e-45];
    let len = prop_oneof![near(LANES, 6), near(4 * LANES, 4)];
    proptest!(cases(256), |(len in len, offset in offset(), kinds in 1..=special.len(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x = Placed::new(1, len, 0, offset, || match noise.below(3) {
            0 => special[noise.below(kinds)],
            _ => noise.integer(3),
        });
        let x = x.row();
        let largest = x.iter().fold(f32::NAN, |largest, &x| largest.max(x));
        prop_assert_eq!(argmax(isa, x), x.iter().position(|&x| x == largest), "{:?}", x);
    });
    assert_eq!(argmax(isa, &[f32::NAN; 40]), None);
    assert_eq!(argmax(isa, &[f32::NEG_INFINITY; 40]), Some(0));
}

fn activations_and_softmax_have_the_scalar_bits(isa: Isa) {
    proptest!(cases(96), |(len in near(LANES, 9), offset in offset(), fill in fill(), seed in any::<u64>())| {
        let mut noise = Noise::new(seed);
        let x: Vec<f32> = (0..len).map(|_| fill.next(&mut noise)).collect();
        for activation in [Activation::Gelu, Activation::GeluTanh, Activation::Relu, Activation::LeakyRelu(0.1)] {
            let (here, scalar) = (applied(isa, activation, &x, offset), applied(Isa::SCALAR, activation, &x, 0));
            prop_assert_eq!(bits(&[here]), bits(&[scalar]));
        }
        let (mut here, mut scalar) = (x.clone(), x);
        softmax(isa, &mut here);
        softmax(Isa::SCALAR, &mut scalar);
        prop_assert_eq!(bits(&[here]), bits(&[scalar]));
    });
}

for_each_isa!(activations_and_softmax_have_the_scalar_bits => vector);
for_each_isa!(
    gelu_is_near_f64,
    gelu_tanh_is_near_f64,
    piecewise_activations_are_exact,
    activations_of_an_element_are_the_same_anywhere,
    softmax_is_near_f64,
    argmax_finds_the_first_largest
    => every
);
