//! Shared parts of the kernel tests: one test per instruction set, guarded buffers, and inputs for
//! edge cases.
//!
//! A property takes an [`Isa`]; [`for_each_isa!`] makes one test of it per back-end, with the
//! back-end in the test's name. On a processor that lacks a back-end the test prints `SKIPPED`,
//! unless the environment variable `UMO_TEST_REQUIRE` (names separated by commas) requires it:
//! then the test fails.

#[path = "pages.rs"]
pub mod pages;

use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

use proptest::prelude::*;
use umo_kernels::Isa;
pub use umo_self_test::kernels::buffers::{Canary, GUARD, Guarded, LINE, Noise, Placed, bits};

/// Tells a test's other threads to end, even if the test fails: a scope waits for them.
pub struct Ends<'a>(pub &'a AtomicBool);

impl Drop for Ends<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::SeqCst);
    }
}

/// One test per instruction set of this target for each property: `for_each_isa!(softmax_is_exact =>
/// every);` makes the tests `softmax_is_exact::scalar`, `softmax_is_exact::avx2` and so on. For
/// `vector`, `scalar` is left out.
#[macro_export]
macro_rules! for_each_isa {
    ($($property:ident),+ => $isas:ident) => {
        $(
            mod $property {
                $crate::for_each_isa!(@$isas $property);
            }
        )+
    };
    (@every $property:ident) => {
        $crate::for_each_isa!(@tests $property scalar);
        $crate::for_each_isa!(@vector $property);
    };
    (@vector $property:ident) => {
        #[cfg(target_arch = "x86_64")]
        $crate::for_each_isa!(@tests $property avx2 avxvnni avx512vnni avx512bf16 amx);
        #[cfg(target_arch = "aarch64")]
        $crate::for_each_isa!(@tests $property neon neon_dotprod neon_i8mm);
        #[cfg(target_arch = "wasm32")]
        $crate::for_each_isa!(@tests $property simd128);
    };
    (@tests $property:ident $($isa:ident)+) => {
        $(
            #[test]
            fn $isa() {
                $crate::on_isa(stringify!($isa), super::$property);
            }
        )+
    };
}

/// Runs `property` on the back-end of this name, or skips it as described in the module.
pub fn on_isa(name: &str, property: impl FnOnce(Isa)) {
    match Isa::from_name(name) {
        Some(isa) => property(isa),
        None if required().iter().any(|required| required == name) => {
            panic!("UMO_TEST_REQUIRE names {name}, which this processor does not have")
        }
        None => {
            // Not `eprintln!`, whose output libtest captures for passing tests.
            writeln!(std::io::stderr(), "SKIPPED: this processor does not have {name}")
                .expect("standard error is open");
        }
    }
}

/// The names in `UMO_TEST_REQUIRE`.
pub fn required() -> Vec<String> {
    let names = std::env::var("UMO_TEST_REQUIRE").unwrap_or_default();
    names.split(',').map(|name| name.trim().to_owned()).filter(|name| !name.is_empty()).collect()
}

/// Sizes `n * tile + {-1, 0, 1}` for `n` up to `most`, with 0 and 1 among them.
pub fn near(tile: usize, most: usize) -> impl Strategy<Value = usize> {
    (0..=most, 0..3_usize).prop_map(move |(n, more)| (n * tile + more).saturating_sub(1))
}

/// Sizes around multiples of these, up to twelve: the multiple itself, one less and one more
/// equally often, and sometimes any remainder or 0.
pub fn around(tiles: &'static [usize]) -> impl Strategy<Value = usize> {
    let count = prop_oneof![4 => 1..=2_usize, 3 => 3..=5_usize, 1 => 6..=12_usize];
    (prop::sample::select(tiles), count).prop_flat_map(|(tile, count)| {
        let size = tile * count;
        prop_oneof![20 => Just(size), 9 => Just(size - 1), 9 => Just(size + 1), 9 => 1..=size + tile, 1 => Just(0)]
    })
}

/// Offset of a slice from a cache line's start, in elements.
pub fn offset() -> impl Strategy<Value = usize> {
    0..64_usize
}

/// Distributions of inputs.
#[derive(Clone, Copy, Debug)]
pub enum Fill {
    /// Uniform in `-size..size`.
    Uniform(f32),
    /// Integers in `-size..=size`: sums of their products are exact in f32.
    Integer(i16),
    /// Mostly small, with a few values a thousand times larger, as in transformers' outlier
    /// channels.
    Outliers,
    /// One value everywhere.
    Constant(f32),
    /// Values so small that their squares are denormal or zero.
    Tiny,
}

impl Fill {
    /// One value.
    pub fn next(self, noise: &mut Noise) -> f32 {
        match self {
            Self::Uniform(size) => noise.float(size),
            Self::Integer(size) => noise.integer(size),
            Self::Outliers if noise.below(50) == 0 => noise.float(1000.0),
            Self::Outliers => noise.float(1.0),
            Self::Constant(value) => value,
            Self::Tiny => noise.float(1e-20),
        }
    }
}

/// Any distribution, for operations whose tolerance scales with the values.
pub fn fill() -> impl Strategy<Value = Fill> {
    prop_oneof![
        4 => Just(Fill::Uniform(1.0)),
        1 => Just(Fill::Uniform(30.0)),
        1 => Just(Fill::Integer(16)),
        2 => Just(Fill::Outliers),
        1 => (-3_i8..=3).prop_map(|value| Fill::Constant(f32::from(value))),
        1 => Just(Fill::Tiny),
    ]
}

/// One unit in the last place of 1 in f32: twice the largest relative error of one operation.
pub const EPSILON: f64 = f32::EPSILON as f64;

/// Powers of e below this are 0 in the kernels.
pub const SMALLEST_POWER: f64 = 1.2e-38;

/// One unit in the last place of an f32 result of this exact value.
pub fn ulp(exact: f64) -> f64 {
    let size = exact.abs().max(f64::from(f32::MIN_POSITIVE));
    2.0_f64.powf(size.log2().floor() - 23.0)
}

/// Number of cases that a property tries: `PROPTEST_CASES`, or `cases`. Failures print their seed and are
/// not written to files.
pub fn cases(cases: u32) -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|given| given.parse().ok()).unwrap_or(cases);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

/// The README's example, compiled as a test.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
