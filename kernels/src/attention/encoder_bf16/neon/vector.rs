//! Registers and operations for the loops of attention over bf16 factors.

pub(super) use crate::attention::neon::vector::transpose;
pub(super) use crate::isa::Neon as Token;
pub(super) use crate::lanes::neon::{HALF as WIDTH, *};
use crate::math::neon::exp2_bf16;
use core::arch::aarch64::*;
use umo_kernels_features::neon;
pub(super) use umo_kernels_features::neon as features;

/// Queries at once.
pub(super) const QUERIES: usize = 2;

pub(super) const JOINED: usize = 1;

#[inline]
#[neon]
pub(super) fn join(_: Token, value: Register, _: Register) -> Register {
    [round_to_bf16(value[0]), round_to_bf16(value[1])]
}

#[inline]
#[neon]
pub(super) fn factor(_: Token, [values]: [Register; JOINED]) -> Register {
    [round_to_bf16(values[0]), round_to_bf16(values[1])]
}

/// `2^t` of differences from a maximum, and their factor.
#[inline]
#[neon]
pub(super) fn weights(token: Token, [t]: [Register; JOINED]) -> ([Register; JOINED], Register) {
    let weights = [exp2_bf16(t)];
    (weights, factor(token, weights))
}

#[inline]
#[neon]
pub(super) fn multiply_add(_: Token, x: Register, w: Register, sum: Register) -> Register {
    fmadd(x, w, sum)
}

/// The nearest bfloat16, ties to even; denormals become 0.
#[inline]
#[neon]
fn round_to_bf16(x: float32x4_t) -> float32x4_t {
    const QUIET: u32 = 0x40_0000;
    let bits = vreinterpretq_u32_f32(x);
    let odd = vandq_u32(vshrq_n_u32::<16>(bits), vdupq_n_u32(1));
    let up = vaddq_u32(bits, vaddq_u32(odd, vdupq_n_u32(0x7fff)));
    let quiet = vorrq_u32(bits, vdupq_n_u32(QUIET));
    let rounded = vbslq_u32(vceqq_f32(x, x), up, quiet);
    let denormal = vcltq_f32(vabsq_f32(x), vdupq_n_f32(f32::MIN_POSITIVE));
    vreinterpretq_f32_u32(vbicq_u32(rounded, vorrq_u32(denormal, vdupq_n_u32(0xffff))))
}

/// `a / b`.
#[inline]
#[neon]
pub(super) fn divide(a: Register, b: Register) -> Register {
    [vdivq_f32(a[0], b[0]), vdivq_f32(a[1], b[1])]
}
