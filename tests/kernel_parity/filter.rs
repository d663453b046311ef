//! Filters against f64 within the documented bound, with the scalar bits on every back-end.

use proptest::prelude::*;
use umo_kernels::Isa;
use umo_kernels::filter::dot;
use umo_kernels::tiling::LANES;
use umo_tests::{Fill, Noise, Placed, cases, fill, for_each_isa, near, offset};

#[derive(Clone, Debug)]
struct Case {
    taps: Placed<f32>,
    samples: Placed<f32>,
}

fn case() -> impl Strategy<Value = Case> {
    let length = prop_oneof![Just(0), near(LANES, 5), near(2 * LANES, 5), Just(672), Just(10_752)];
    let place = |length, offset, fill: Fill, noise: &mut Noise| Placed::new(1, length, 0, offset, || fill.next(noise));
    (length, offset(), offset(), fill(), any::<u64>()).prop_map(move |(length, first, second, fill, seed)| {
        let mut noise = Noise::new(seed);
        let taps = place(length, first, fill, &mut noise);
        Case { taps, samples: place(length, second, fill, &mut noise) }
    })
}

fn dot_is_the_sum_of_products(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let (taps, samples) = (case.taps.row(), case.samples.row());
        let products = || taps.iter().zip(samples).map(|(&a, &b)| f64::from(a) * f64::from(b));
        let (exact, size) = (products().sum::<f64>(), products().map(f64::abs).sum::<f64>());
        let got = dot(isa, taps, samples).expect("as many samples as taps");
        // Denormal products are rounded relative to the denormal unit.
        let length = taps.len() as f64;
        let bound = (length / 32.0 + 6.0) * size * 2.0_f64.powi(-24) + length * 2.0_f64.powi(-149);
        prop_assert!((f64::from(got) - exact).abs() <= bound, "{got}, {exact} within {bound}");
    });
}

fn dot_has_the_scalar_bits(isa: Isa) {
    proptest!(cases(64), |(case in case())| {
        let of = |isa| dot(isa, case.taps.row(), case.samples.row()).expect("as many samples as taps").to_bits();
        prop_assert_eq!(of(isa), of(Isa::SCALAR));
    });
}

fn lengths_must_agree(isa: Isa) {
    let error = dot(isa, &[1.0; 3], &[1.0; 2]).unwrap_err().to_string();
    assert!(error.contains("samples"), "{error}");
}

for_each_isa!(dot_is_the_sum_of_products, lengths_must_agree => every);
for_each_isa!(dot_has_the_scalar_bits => vector);
