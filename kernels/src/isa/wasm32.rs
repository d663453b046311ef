//! The instruction set of WebAssembly. An engine refuses a module with any unknown instruction
//! as a whole, so there is nothing to detect: the features of the compilation are present.

use super::Backend;

/// Proof that this module was compiled for 128-bit SIMD (`-C target-feature=+simd128`), without
/// which the intrinsics would be function calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Simd128(());

/// Every back-end of WebAssembly.
pub(super) fn backends() -> impl Iterator<Item = (&'static str, Option<Backend>)> {
    let simd128 = cfg!(target_feature = "simd128").then_some(Backend::Simd128(Simd128(())));
    [("simd128", simd128)].into_iter()
}
