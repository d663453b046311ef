//! Compares every kernel of every back-end of this processor with its scalar reference, and scalar code with results
//! that are the same on every processor.

pub mod buffers;
mod calls;
pub mod products;
#[cfg(test)]
mod tests;

use std::time::Duration;

use umo_core_base::defect::contain_quietly;
use umo_core_base::time::Instant;
use umo_kernels::Isa;

pub use calls::{CALLS, Call};
use calls::{DIGESTS, PORTABLE_CALLS};
use products::Values;

/// Number of cases of each kernel and back-end.
const CASES: u64 = 10;
/// Number of cases of each digest.
const DIGEST_CASES: u64 = 12;
/// Kernels that round scores, weights and sums in an order that depends on the back-end.
const ROUNDED: [&str; 4] = ["attention_f32", "attention_heads_f32", "attention_bf16", "encoder_attention_f32"];
/// Largest accepted difference of their results, which are means of values below 1. Scores are exact. Each weight is
/// off by up to 5 roundings for each of 22 blocks of keys, and tiles add 6 products for each of 340 keys: 2.9e-4, on
/// both sides.
const TOLERANCE: f32 = 6e-4;

/// A kernel whose results are wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Wrong {
    /// Name in docs/kernels.md.
    pub kernel: &'static str,
    /// Name of the back-end.
    pub isa: &'static str,
    /// First wrong result.
    pub detail: String,
}

/// Result of the comparison.
#[derive(Clone, Debug, Default)]
pub struct Checked {
    /// Number of results compared.
    pub cases: usize,
    /// Whether time ran out before all cases were compared.
    pub is_cut: bool,
    /// One entry for each kernel and back-end whose results are wrong.
    pub wrong: Vec<Wrong>,
}

/// Compares kernels until all cases are done, or until `limit` has passed and each kernel has had a case.
pub fn check(limit: Duration) -> Checked {
    check_calls(limit, |_, call, isa, seed, values| call(isa, seed, values))
}

type Run<'a> = dyn Fn(&str, Call, Isa, u64, Values) -> Vec<u64> + 'a;

fn check_calls(limit: Duration, run: impl Fn(&str, Call, Isa, u64, Values) -> Vec<u64>) -> Checked {
    let (start, mut checked) = (Instant::now(), Checked::default());
    check_digests(&mut checked, &run);
    for seed in 0..CASES {
        if seed > 0 && start.elapsed() > limit {
            checked.is_cut = true;
            break;
        }
        for (kernel, call) in CALLS {
            let result = |isa| contain_quietly(|| run(kernel, call, isa, seed, Values::Exact));
            let wanted = result(Isa::SCALAR);
            for isa in Isa::available().skip(1) {
                let difference = match (&wanted, result(isa)) {
                    (Ok(wanted), Ok(found)) => differs(kernel, &found, wanted),
                    (Err(defect), _) => Some(format!("the reference panicked: {}", defect.message())),
                    (_, Err(defect)) => Some(format!("it panicked: {}", defect.message())),
                };
                checked.add(kernel, isa, difference.map(|what| format!("case {seed}: {what}")));
            }
        }
    }
    checked
}

/// Checks scalar code, and the vector code that produces the same bits on x86-64 and on Arm.
fn check_digests(checked: &mut Checked, run: &Run) {
    for isa in Isa::available() {
        let place = match isa.name() {
            "scalar" | "simd128" => 0,
            "avx2" | "avxvnni" | "neon" | "neon_dotprod" | "neon_i8mm" => 1,
            _ => continue,
        };
        for ((kernel, call), (_, digests)) in CALLS.into_iter().zip(DIGESTS) {
            let call = PORTABLE_CALLS.iter().find(|(name, _)| *name == kernel).map_or(call, |&(_, call)| call);
            let result = |seed| run(kernel, call, isa, seed, Values::Real);
            let found = contain_quietly(|| (0..DIGEST_CASES).flat_map(result).fold(0xcbf2_9ce4_8422_2325, digest));
            let difference = match found {
                Ok(found) if found == digests[place] => None,
                Ok(found) => Some(format!("the digest of its results is {found:#018x}, not {:#018x}", digests[place])),
                Err(defect) => Some(format!("it panicked: {}", defect.message())),
            };
            checked.add(kernel, isa, difference);
        }
    }
}

impl Checked {
    fn add(&mut self, kernel: &'static str, isa: Isa, difference: Option<String>) {
        self.cases += 1;
        let Some(detail) = difference else { return };
        if !self.wrong.iter().any(|wrong| (wrong.kernel, wrong.isa) == (kernel, isa.name())) {
            self.wrong.push(Wrong { kernel, isa: isa.name(), detail });
        }
    }
}

/// Describes the first difference between two results.
fn differs(kernel: &str, found: &[u64], wanted: &[u64]) -> Option<String> {
    if found.len() != wanted.len() {
        return Some(format!("{} results, not {}", found.len(), wanted.len()));
    }
    #[expect(clippy::cast_possible_truncation, reason = "the bits of an f32")]
    let float = |bits: u64| f32::from_bits(bits as u32);
    let is_rounded = ROUNDED.contains(&kernel);
    let differs = |&(_, (&found, &wanted)): &(usize, (&u64, &u64))| match is_rounded {
        true => {
            let off = (float(found) - float(wanted)).abs();
            off > TOLERANCE || off.is_nan()
        }
        false => found != wanted,
    };
    let mut all = found.iter().zip(wanted).enumerate().filter(differs);
    let (at, (&first, &other)) = all.next()?;
    let count = 1 + all.count();
    Some(format!("{count} of {} results differ, first [{at}]: {first:#x}, not {other:#x}", wanted.len()))
}

/// FNV-1a over the words of all results.
fn digest(before: u64, word: u64) -> u64 {
    word.to_le_bytes().iter().fold(before, |hash, &byte| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3))
}
