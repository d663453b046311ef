//! Quantising rows in vectors: maximum, one product, one rounding to even; nothing depends on an order.

#[cfg(target_arch = "x86_64")]
pub(super) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(super) mod avx512vnni;
