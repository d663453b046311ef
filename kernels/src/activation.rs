//! Element-wise functions: GELU, softmax, argmax.

mod scalar;

use crate::isa::{Backend, Isa};
use crate::matmul_f32::Activation;

pub(crate) use scalar::activate;

/// Applies `activation` to every element in place.
///
/// Numerics: both forms of GELU within 4 ULP of the exact value plus `1e-7 * abs(x)`; all back-ends agree bit for bit.
pub fn apply(isa: Isa, activation: Activation, x: &mut [f32]) {
    match isa.0 {
        Backend::Scalar => scalar::apply(activation, x),
        // No version of their own yet.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::Avx512Vnni => scalar::apply(activation, x),
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => scalar::apply(activation, x),
    }
}

/// Softmax in place: `x[i] = exp(x[i] - max) / sum_j exp(x[j] - max)`. An empty slice stays empty.
///
/// Numerics: within 4 ULP of the exact value for inputs within 80 of the maximum; sums to 1 within `len * 2^-23`.
pub fn softmax(isa: Isa, x: &mut [f32]) {
    match isa.0 {
        Backend::Scalar => scalar::softmax(x),
        // No version of their own yet.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::Avx512Vnni => scalar::softmax(x),
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => scalar::softmax(x),
    }
}

/// Index of the largest element, the lowest one of equals; `None` for an empty slice. NaN is never the largest.
pub fn argmax(isa: Isa, x: &[f32]) -> Option<usize> {
    match isa.0 {
        Backend::Scalar => scalar::argmax(x),
        // No version of their own yet.
        #[cfg(target_arch = "x86_64")]
        Backend::Avx2 | Backend::Avx512Vnni => scalar::argmax(x),
        #[cfg(all(target_arch = "x86_64", target_os = "linux"))]
        Backend::Amx => scalar::argmax(x),
    }
}
