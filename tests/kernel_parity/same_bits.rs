//! Back-ends that give the same bits, function by function: the table in docs/kernels.md, row by
//! row.

use std::time::Duration;

use proptest::prelude::*;
use umo_kernels::Isa;
use umo_self_test::kernels::products::Values;
use umo_self_test::kernels::{CALLS, check};
use umo_tests::cases;
use umo_tests::pages::same_bits;

/// The table lists every function once, and each entry holds on the back-ends of this
/// processor.
#[test]
fn functions_match_the_same_bits_table() {
    let mut documented = vec![];
    for (cell, groups) in same_bits("function") {
        for name in cell.split(", ").map(|name| name.trim_matches('`')) {
            let &(name, call) = CALLS.iter().find(|(known, _)| *known == name).unwrap_or_else(|| panic!("no `{name}`"));
            documented.push(name);
            proptest!(cases(128), |(seed in any::<u64>())| {
                for group in &groups {
                    let Some((&first, others)) = group.split_first() else { continue };
                    let wanted = call(first, seed, Values::Real);
                    for &isa in others {
                        prop_assert!(call(isa, seed, Values::Real) == wanted, "{name}: {} is not {}", isa.name(), first.name());
                    }
                }
            });
        }
    }
    documented.sort_unstable();
    let mut known = CALLS.map(|(name, _)| name);
    known.sort_unstable();
    assert_eq!(documented, known, "the table does not name every function once");
}

/// The self-test of an installed library passes here: every back-end gives the results of its scalar reference. Scalar
/// code, AVX2 and NEON give the recorded bits, so that x86-64, 64-bit Arm and WebAssembly are compared with the same
/// numbers.
#[test]
fn the_self_test_finds_no_wrong_kernel() {
    let checked = check(Duration::MAX);
    assert_eq!((checked.wrong, checked.is_cut), (vec![], false));
}

/// Portable instruction sets have the bits of the scalar back-end, in every function.
#[test]
fn portable_back_ends_have_scalar_bits() {
    for (name, call) in CALLS {
        proptest!(cases(256), |(seed in any::<u64>())| {
            let wanted = call(Isa::SCALAR, seed, Values::Real);
            for isa in Isa::available().map(Isa::portable) {
                prop_assert!(call(isa, seed, Values::Real) == wanted, "{name}: portable {} is not scalar", isa.name());
            }
        });
    }
}
