//! The instruction set of WebAssembly. A module's instructions are all valid or the module is
//! refused as a whole, so that there is nothing to detect: what it was compiled for is there.

use super::Backend;

/// Proves that this module was compiled for 128-bit SIMD (`-C target-feature=+simd128`), without
/// which the back-end's operations would be calls.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Simd128(());

/// Every back-end of WebAssembly.
pub(super) fn backends() -> impl Iterator<Item = (&'static str, Option<Backend>)> {
    let simd128 = cfg!(target_feature = "simd128").then_some(Backend::Simd128(Simd128(())));
    [("simd128", simd128)].into_iter()
}
