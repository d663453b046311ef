//! Element-wise functions: GELU, softmax, argmax.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512vnni;
mod scalar;

use crate::isa::{Backend, Isa};

pub use crate::math::Activation;

/// Applies `activation` to every element in place.
///
/// Numerics: both forms of GELU within 4 ULP of the exact value plus `1e-7 * abs(x)`; all back-ends agree bit for bit.
pub fn apply(isa: Isa, activation: Activation, x: &mut [f32]) {
    match isa.0 {
        Backend::Scalar => scalar::apply(activation, x),
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::apply(activation, x) },
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::apply(activation, x) },
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => unsafe { avx512vnni::apply(activation, x) },
    }
}

/// Softmax in place: `x[i] = exp(x[i] - max) / sum_j exp(x[j] - max)`. An empty slice stays empty.
///
/// Numerics: relative error at most `(5 + abs(x[i] - max) + len) * 2^-23`, powers below 1.2e-38 are 0; all back-ends agree
/// bit for bit.
pub fn softmax(isa: Isa, x: &mut [f32]) {
    match isa.0 {
        Backend::Scalar => scalar::softmax(x),
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::softmax(x) },
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::softmax(x) },
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => unsafe { avx512vnni::softmax(x) },
    }
}

/// Index of the largest element, the lowest one of equals; `None` for an empty slice. NaN is never the largest.
pub fn argmax(isa: Isa, x: &[f32]) -> Option<usize> {
    match isa.0 {
        Backend::Scalar => scalar::argmax(x),
        // SAFETY: `Isa` holds `Avx2` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::AvxVnni => unsafe { avx2::argmax(x) },
        // SAFETY: `Isa` holds `Avx512Vnni` only after detection of every feature that this back-end enables.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx512Vnni | Backend::Avx512Bf16 => unsafe { avx512vnni::argmax(x) },
        // SAFETY: `Isa` holds `Amx` only where it could hold `Avx512Vnni`.
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => unsafe { avx512vnni::argmax(x) },
    }
}
