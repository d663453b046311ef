//! Instruction sets of this processor, detected once.

// For processor detection only; linking it also gives `f32` its `sqrt` and similar methods. `Vec` and
// `Box` are not imported.
extern crate std;

#[cfg(target_arch = "aarch64")]
mod aarch64;
mod dispatch;
#[cfg(target_arch = "wasm32")]
mod wasm32;
#[cfg(target_arch = "x86_64")]
mod x86_64;

#[cfg(target_arch = "aarch64")]
pub(crate) use aarch64::{Neon, NeonDotprod, NeonI8mm};
pub(crate) use dispatch::dispatch;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) use dispatch::entry;
#[cfg(target_arch = "wasm32")]
pub(crate) use wasm32::Simd128;
#[cfg(all(target_arch = "x86_64", target_os = "linux"))]
pub(crate) use x86_64::Amx;
#[cfg(target_arch = "x86_64")]
pub(crate) use x86_64::{Avx2, Avx512Bf16, Avx512Vnni, AvxVnni};

use crate::tuning::Tuning;

/// An instruction set that this processor is known to support. The value is the proof.
///
/// Detect once when a model is loaded, store it, and pass it to every kernel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Isa {
    backend: Backend,
    tuning: Tuning,
    portable: bool,
}

/// The back-ends, each with the token that proves its features.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Backend {
    Scalar,
    #[cfg(target_arch = "x86_64")]
    Avx2(Avx2),
    /// [`Backend::Avx2`] with int8 dot products.
    #[cfg(target_arch = "x86_64")]
    AvxVnni(AvxVnni),
    #[cfg(target_arch = "x86_64")]
    Avx512Vnni(Avx512Vnni),
    /// [`Backend::Avx512Vnni`] with bf16 dot products.
    #[cfg(target_arch = "x86_64")]
    Avx512Bf16(Avx512Bf16),
    #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
    Amx(Amx),
    #[cfg(target_arch = "aarch64")]
    Neon(Neon),
    /// [`Backend::Neon`] with int8 dot products.
    #[cfg(target_arch = "aarch64")]
    NeonDotprod(NeonDotprod),
    /// [`Backend::NeonDotprod`] with int8 matrix products.
    #[cfg(target_arch = "aarch64")]
    NeonI8mm(NeonI8mm),
    #[cfg(target_arch = "wasm32")]
    Simd128(Simd128),
}

impl Backend {
    const fn name(self) -> &'static str {
        match self {
            Backend::Scalar => "scalar",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2(_) => "avx2",
            #[cfg(target_arch = "x86_64")]
            Backend::AvxVnni(_) => "avxvnni",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Vnni(_) => "avx512vnni",
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16(_) => "avx512bf16",
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx(_) => "amx",
            #[cfg(target_arch = "aarch64")]
            Backend::Neon(_) => "neon",
            #[cfg(target_arch = "aarch64")]
            Backend::NeonDotprod(_) => "neon_dotprod",
            #[cfg(target_arch = "aarch64")]
            Backend::NeonI8mm(_) => "neon_i8mm",
            #[cfg(target_arch = "wasm32")]
            Backend::Simd128(_) => "simd128",
        }
    }

    /// The profile of the processors that select this back-end; every back-end of x86-64 was
    /// measured with its profile.
    fn tuning(self) -> Tuning {
        match self {
            Backend::Scalar => Tuning::XEON,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2(_) | Backend::AvxVnni(_) | Backend::Avx512Vnni(_) => Tuning::XEON,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16(_) => Tuning::of_zen(),
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx(_) => Tuning::XEON,
            #[cfg(target_arch = "aarch64")]
            Backend::Neon(_) | Backend::NeonDotprod(_) | Backend::NeonI8mm(_) => Tuning::ARM,
            // WebAssembly has no prefetch, so no property of the profile is used.
            #[cfg(target_arch = "wasm32")]
            Backend::Simd128(_) => Tuning::XEON,
        }
    }
}

/// Every back-end of this target: its name, and the back-end itself if this processor supports it;
/// slowest first.
fn backends() -> impl Iterator<Item = (&'static str, Option<Backend>)> {
    let scalar = [("scalar", Some(Backend::Scalar))];
    #[cfg(target_arch = "x86_64")]
    return scalar.into_iter().chain(x86_64::backends());
    #[cfg(target_arch = "aarch64")]
    return scalar.into_iter().chain(aarch64::backends());
    #[cfg(target_arch = "wasm32")]
    return scalar.into_iter().chain(wasm32::backends());
    #[cfg(not(any(target_arch = "x86_64", target_arch = "aarch64", target_arch = "wasm32")))]
    scalar.into_iter()
}

impl Isa {
    /// Portable code, on every processor.
    pub const SCALAR: Self = Self { backend: Backend::Scalar, tuning: Tuning::XEON, portable: false };

    /// The fastest back-end that this processor supports.
    pub fn detect() -> Self {
        Self::available().last().unwrap_or(Self::SCALAR)
    }

    /// Every back-end that this processor supports, slowest first.
    pub fn available() -> impl Iterator<Item = Self> {
        let isa = |backend: Backend| Self { backend, tuning: backend.tuning(), portable: false };
        backends().filter_map(|(_, backend)| backend).map(isa)
    }

    /// The names of every back-end of this target, supported by this processor or not.
    pub fn names() -> impl Iterator<Item = &'static str> {
        backends().map(|(name, _)| name)
    }

    /// The name used in files, tests, benches and logs.
    pub const fn name(self) -> &'static str {
        self.backend.name()
    }

    /// The back-end of this name, if this processor supports it.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::available().find(|isa| isa.name() == name)
    }

    /// The same instruction set tuned for another processor family: other speed, the same results.
    #[must_use]
    pub const fn with_tuning(self, tuning: Tuning) -> Self {
        Self { tuning, ..self }
    }

    /// The same instruction set with the results of [`Isa::SCALAR`], in every bit, from every kernel: products are
    /// rounded before they are added, and sums have one order.
    #[must_use]
    pub const fn portable(self) -> Self {
        Self { portable: true, ..self }
    }

    /// Whether this is a [`Isa::portable`] one.
    pub const fn is_portable(self) -> bool {
        self.portable
    }

    /// What computes floats: of a portable instruction set, the registers alone.
    pub(crate) fn of_floats(self) -> Self {
        match self.backend {
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16(bf16) if self.portable => Self { backend: Backend::Avx512Vnni(bf16.into()), ..self },
            _ if self.portable => self.without_tiles(),
            _ => self,
        }
    }

    pub(crate) const fn tuning(self) -> Tuning {
        self.tuning
    }

    pub(crate) const fn backend(self) -> Backend {
        self.backend
    }

    /// Whether rows rounded to bf16 are multiplied faster than f32
    /// ([`crate::matmul_bf16::matmul_bf16_rows`]), so that [`crate::bf16::round_bf16`] is useful for
    /// products that need no more digits.
    pub const fn multiplies_bf16(self) -> bool {
        match self.backend {
            Backend::Scalar => false,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2(_) | Backend::AvxVnni(_) | Backend::Avx512Vnni(_) => false,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx512Bf16(_) => !self.portable,
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx(_) => !self.portable,
            #[cfg(target_arch = "aarch64")]
            Backend::Neon(_) | Backend::NeonDotprod(_) | Backend::NeonI8mm(_) => false,
            #[cfg(target_arch = "wasm32")]
            Backend::Simd128(_) => false,
        }
    }

    /// Whether float products with bf16 weights run on tiles, so that
    /// [`crate::matmul_bf16::split_bf16x2`] is useful for them.
    pub const fn has_tiles(self) -> bool {
        match self.backend {
            Backend::Scalar => false,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2(_) | Backend::AvxVnni(_) | Backend::Avx512Vnni(_) | Backend::Avx512Bf16(_) => false,
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx(_) => !self.portable,
            #[cfg(target_arch = "aarch64")]
            Backend::Neon(_) | Backend::NeonDotprod(_) | Backend::NeonI8mm(_) => false,
            #[cfg(target_arch = "wasm32")]
            Backend::Simd128(_) => false,
        }
    }

    /// The same instruction set without tiles, which do not multiply f32: for float products
    /// whose inputs must not be rounded.
    #[must_use]
    pub fn without_tiles(self) -> Self {
        match self.backend {
            Backend::Scalar => self,
            #[cfg(target_arch = "x86_64")]
            Backend::Avx2(_) | Backend::AvxVnni(_) | Backend::Avx512Vnni(_) | Backend::Avx512Bf16(_) => self,
            #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
            Backend::Amx(amx) => Self { backend: Backend::Avx512Vnni(amx.into()), ..self },
            #[cfg(target_arch = "aarch64")]
            Backend::Neon(_) | Backend::NeonDotprod(_) | Backend::NeonI8mm(_) => self,
            #[cfg(target_arch = "wasm32")]
            Backend::Simd128(_) => self,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_the_backends() {
        for (name, backend) in backends() {
            assert!(backend.is_none_or(|backend| backend.name() == name), "{name}");
        }
        for isa in Isa::available() {
            assert_eq!(Isa::from_name(isa.name()), Some(isa));
        }
    }
}
