//! Detection of the instruction sets of 64-bit Arm, and the tokens that prove it.

use super::Backend;
use super::std::arch::is_aarch64_feature_detected;

macro_rules! tokens {
    ($($(#[$meta:meta])* $name:ident),* $(,)?) => {$(
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) struct $name(());
    )*};
}

// A token proves that the processor has every feature that the attribute of the same name in
// `umo_kernels_features` enables. The constructors are private to this module, each in the function
// that detects them.
tokens! {
    /// NEON.
    Neon,
    /// The features of [`Neon`], and int8 dot products (FEAT_DotProd).
    NeonDotprod,
    /// The features of [`NeonDotprod`], and int8 matrix products (FEAT_I8MM).
    NeonI8mm,
}

impl Neon {
    /// `None` on big-endian systems, where the bytes of a register are numbered from the other end.
    fn detect() -> Option<Self> {
        (cfg!(target_endian = "little") && is_aarch64_feature_detected!("neon")).then_some(Self(()))
    }
}

impl NeonDotprod {
    fn detect() -> Option<Self> {
        Neon::detect()?;
        is_aarch64_feature_detected!("dotprod").then_some(Self(()))
    }
}

impl NeonI8mm {
    fn detect() -> Option<Self> {
        NeonDotprod::detect()?;
        is_aarch64_feature_detected!("i8mm").then_some(Self(()))
    }
}

// Conversions from a stronger token to a weaker one.

impl From<NeonDotprod> for Neon {
    fn from(_: NeonDotprod) -> Self {
        Self(())
    }
}

impl From<NeonI8mm> for NeonDotprod {
    fn from(_: NeonI8mm) -> Self {
        Self(())
    }
}

impl From<NeonI8mm> for Neon {
    fn from(_: NeonI8mm) -> Self {
        Self(())
    }
}

/// Every back-end of 64-bit Arm, slowest first.
pub(super) fn backends() -> impl Iterator<Item = (&'static str, Option<Backend>)> {
    [
        ("neon", Neon::detect().map(Backend::Neon)),
        ("neon_dotprod", NeonDotprod::detect().map(Backend::NeonDotprod)),
        ("neon_i8mm", NeonI8mm::detect().map(Backend::NeonI8mm)),
    ]
    .into_iter()
}
