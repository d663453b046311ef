use std::time::Duration;

use umo_kernels::Isa;

use super::*;

/// A back-end with one wrong bit in one case of one kernel is detected and named, and no other.
#[test]
fn a_wrong_bit_of_one_back_end_is_found_and_named() {
    let Some(isa) = Isa::available().nth(1) else { return };
    for (kernel, _) in CALLS {
        let checked = check_calls(Duration::MAX, |name, call, at, seed, values| {
            let mut results = call(at, seed, values);
            if (name, at, seed, values) == (kernel, isa, 1, Values::Exact) {
                let last = results.last_mut().expect("it has results");
                *last ^= 1 << 29;
            }
            results
        });
        let [wrong] = &checked.wrong[..] else { panic!("{kernel}: {:?}", checked.wrong) };
        assert_eq!((wrong.kernel, wrong.isa), (kernel, isa.name()));
        assert!(wrong.detail.starts_with("case 1: 1 of "), "{}", wrong.detail);
    }
}

/// Wrong scalar code is detected by comparison with the recorded digests, and so is a kernel that panics.
#[test]
fn a_wrong_reference_and_a_panic_are_found() {
    umo_core_base::defect::keep_quiet(&[&[file!()]]);
    let spoilt = |panics: bool| {
        let checked = check_calls(Duration::MAX, |name, call, isa, seed, values| {
            let mut results = call(isa, seed, values);
            if (name, isa) == ("softmax", Isa::SCALAR) {
                assert!(!panics, "planted");
                results[0] ^= 1 << 29;
            }
            results
        });
        checked.wrong.into_iter().find(|wrong| wrong.isa == "scalar").map(|wrong| (wrong.kernel, wrong.detail))
    };
    assert_eq!(spoilt(true), Some(("softmax", "it panicked: planted".to_owned())));
    let (kernel, detail) = spoilt(false).expect("found");
    assert!(kernel == "softmax" && detail.starts_with("the digest of its results is 0x"), "{kernel}: {detail}");
}

/// With little time, every kernel still has a case, and the result states that cases were left out.
#[test]
fn little_time_leaves_cases_out_and_no_kernel() {
    let checked = check(Duration::ZERO);
    let others = Isa::available().skip(1).count();
    assert!(checked.is_cut || others == 0);
    assert!(checked.cases >= CALLS.len() * (1 + others), "{}", checked.cases);
}
