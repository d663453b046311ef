//! Pairs of registers of 4 lanes; two pairs hold the 16. NEON's 32 registers hold as many values in
//! pairs as AVX2's 16, so the loops have the tiles of AVX2.

use super::LANES;
use crate::bf16::Bf16;
use core::arch::aarch64::*;
use umo_kernels_features::neon;

/// Lanes of one pair.
pub(crate) const HALF: usize = 8;

/// 8 lanes of f32.
pub(crate) type Register = [float32x4_t; 2];

/// 4 values.
#[inline]
#[neon]
fn load_four(src: &[f32; 4]) -> float32x4_t {
    // SAFETY: `src` is 4 readable floats; the load needs no alignment beyond theirs.
    unsafe { vld1q_f32(src.as_ptr()) }
}

/// Stores 4 values.
#[inline]
#[neon]
fn store_four(dst: &mut [f32; 4], value: float32x4_t) {
    // SAFETY: `dst` is 4 writable floats; the store needs no alignment beyond theirs.
    unsafe { vst1q_f32(dst.as_mut_ptr(), value) }
}

/// 8 values.
#[inline]
#[neon]
pub(crate) fn load(src: &[f32; HALF]) -> Register {
    let (fours, _) = src.as_chunks::<4>();
    [load_four(&fours[0]), load_four(&fours[1])]
}

/// The first 8 values, padded with zeros. NEON has no masked load: a copy pads them.
#[inline]
#[neon]
pub(crate) fn load_part(src: &[f32]) -> Register {
    if let Some(whole) = src.first_chunk() {
        return load(whole);
    }
    let mut padded = [0.0; HALF];
    padded[..src.len()].copy_from_slice(src);
    load(&padded)
}

/// 8 values of a row from `at` on, padded with zeros.
#[inline]
#[neon]
pub(crate) fn load_at(row: &[f32], at: usize) -> Register {
    match row.get(at..) {
        Some(rest) if !rest.is_empty() => load_part(rest),
        _ => zero(),
    }
}

/// Stores 8 values.
#[inline]
#[neon]
pub(crate) fn store(dst: &mut [f32; HALF], value: Register) {
    let (fours, _) = dst.as_chunks_mut::<4>();
    store_four(&mut fours[0], value[0]);
    store_four(&mut fours[1], value[1]);
}

/// Stores as many of the 8 values as `dst` has room for.
#[inline]
#[neon]
pub(crate) fn store_part(dst: &mut [f32], value: Register) {
    if let Some(whole) = dst.first_chunk_mut() {
        return store(whole, value);
    }
    let lanes = to_array(value);
    dst.copy_from_slice(&lanes[..dst.len()]);
}

/// The 8 values as an array.
#[inline]
#[neon]
pub(crate) fn to_array(value: Register) -> [f32; HALF] {
    let mut lanes = [0.0; HALF];
    store(&mut lanes, value);
    lanes
}

/// The largest of the 8 values.
#[inline]
#[neon]
pub(crate) fn reduce_max(value: Register) -> f32 {
    vmaxvq_f32(vmaxq_f32(value[0], value[1]))
}

/// Zeros.
#[inline]
#[neon]
pub(crate) fn zero() -> Register {
    splat(0.0)
}

/// `value` in every lane.
#[inline]
#[neon]
pub(crate) fn splat(value: f32) -> Register {
    [vdupq_n_f32(value); 2]
}

/// `a + b`.
#[inline]
#[neon]
pub(crate) fn add(a: Register, b: Register) -> Register {
    [vaddq_f32(a[0], b[0]), vaddq_f32(a[1], b[1])]
}

/// `a - b`.
#[inline]
#[neon]
pub(crate) fn sub(a: Register, b: Register) -> Register {
    [vsubq_f32(a[0], b[0]), vsubq_f32(a[1], b[1])]
}

/// `a * b`.
#[inline]
#[neon]
pub(crate) fn mul(a: Register, b: Register) -> Register {
    [vmulq_f32(a[0], b[0]), vmulq_f32(a[1], b[1])]
}

/// `a * b + c`, rounded once.
#[inline]
#[neon]
pub(crate) fn fmadd(a: Register, b: Register, c: Register) -> Register {
    [vfmaq_f32(c[0], a[0], b[0]), vfmaq_f32(c[1], a[1], b[1])]
}

/// The greater of each two lanes; NaN if one is NaN.
#[inline]
#[neon]
pub(crate) fn max_lanes(a: Register, b: Register) -> Register {
    [vmaxq_f32(a[0], b[0]), vmaxq_f32(a[1], b[1])]
}

/// The first `len` lanes of `a`, the others of `b`.
#[inline]
#[neon]
pub(crate) fn select_first(len: usize, a: Register, b: Register) -> Register {
    const NUMBERS: [[u32; 4]; 2] = [[0, 1, 2, 3], [4, 5, 6, 7]];
    let len = vdupq_n_u32(u32::try_from(len).unwrap_or(u32::MAX));
    let mut result = a;
    for half in 0..2 {
        // SAFETY: `NUMBERS[half]` is 4 readable words; the load needs no alignment beyond theirs.
        let number = unsafe { vld1q_u32(NUMBERS[half].as_ptr()) };
        result[half] = vbslq_f32(vcltq_u32(number, len), a[half], b[half]);
    }
    result
}

/// 8 values, widened: bfloat16 is the upper half of an f32.
#[inline]
#[neon]
pub(crate) fn load_bf16(src: &[Bf16; HALF]) -> Register {
    // SAFETY: `src` is 8 readable words of 16 bits, the layout of `Bf16`; the load needs no
    // alignment beyond theirs.
    let words = unsafe { vld1q_u16(src.as_ptr().cast()) };
    let (low, high) = (vshll_n_u16::<16>(vget_low_u16(words)), vshll_high_n_u16::<16>(words));
    [vreinterpretq_f32_u32(low), vreinterpretq_f32_u32(high)]
}

/// The first 8 values, widened, padded with zeros.
#[inline]
#[neon]
pub(crate) fn load_part_bf16(src: &[Bf16]) -> Register {
    let mut padded = [Bf16(0); HALF];
    let len = src.len().min(HALF);
    padded[..len].copy_from_slice(&src[..len]);
    load_bf16(&padded)
}

/// 16 values, in two pairs.
#[inline]
#[neon]
pub(crate) fn load_two(src: &[f32; LANES]) -> [Register; 2] {
    let (halves, _) = src.as_chunks::<HALF>();
    [load(&halves[0]), load(&halves[1])]
}

/// Stores 16 values from two pairs.
#[inline]
#[neon]
pub(crate) fn store_two(dst: &mut [f32; LANES], values: [Register; 2]) {
    let (halves, _) = dst.as_chunks_mut::<HALF>();
    store(&mut halves[0], values[0]);
    store(&mut halves[1], values[1]);
}
