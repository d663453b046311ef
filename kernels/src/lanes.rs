//! Sixteen lanes: the order of additions that all back-ends share, with loads and stores.
//!
//! A long f32 sum is kept in [`LANES`] partial sums, element `i` in lane `i % LANES`, which are
//! finally added pairwise. These fit one AVX-512 register, two of AVX2 or four of NEON, and the error bound
//! is lower than that of one running sum.

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512vnni;
#[cfg(target_arch = "aarch64")]
pub(crate) mod neon;
#[cfg(target_arch = "wasm32")]
pub(crate) mod simd128;

/// Partial sums of one long sum.
pub(crate) const LANES: usize = 16;

/// Adds the upper half of the lanes to the lower until one is left; `N` is a power of two.
#[inline(always)]
pub(crate) fn pairwise<const N: usize>(mut lanes: [f32; N]) -> f32 {
    let mut width = N / 2;
    while width > 0 {
        for lane in 0..width {
            lanes[lane] += lanes[lane + width];
        }
        width /= 2;
    }
    lanes[0]
}

/// `sum_i f(x[i])` in lanes.
#[inline(always)]
pub(crate) fn sum_of(x: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let (chunks, tail) = x.as_chunks::<LANES>();
    for chunk in chunks {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane += f(x);
        }
    }
    for (lane, &x) in lanes.iter_mut().zip(tail) {
        *lane += f(x);
    }
    pairwise(lanes)
}
