//! The scalar loop, compiled for this instruction set: the same order of additions, the same bits.

use super::scalar;
use crate::isa::Simd128;

pub(super) fn dot(_token: Simd128, taps: &[f32], samples: &[f32]) -> f32 {
    scalar::dot(taps, samples)
}
