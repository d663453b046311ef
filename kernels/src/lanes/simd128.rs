//! Registers of 4 lanes; four of them hold the 16.
//!
//! There is no fused multiply-add: products and sums are rounded separately, as in the scalar
//! back-end. If the scalar reference fuses them, [`fmadd`] has the same bits at the cost of about
//! twenty operations.

use super::LANES;
use crate::bf16::Bf16;
use core::arch::wasm32::*;

/// Lanes of one register.
pub(crate) const WIDTH: usize = 4;

/// Registers that hold 16 values.
pub(crate) const REGISTERS: usize = LANES / WIDTH;

/// 4 lanes of f32.
pub(crate) type Register = v128;

/// 4 values.
#[inline]
pub(crate) fn load(src: &[f32; WIDTH]) -> Register {
    // SAFETY: `src` is 16 readable bytes; the load needs no alignment.
    unsafe { v128_load(src.as_ptr().cast()) }
}

/// The first 4 values, padded with zeros by a copy.
#[inline]
pub(crate) fn load_part(src: &[f32]) -> Register {
    if let Some(whole) = src.first_chunk() {
        return load(whole);
    }
    let mut padded = [0.0; WIDTH];
    padded[..src.len()].copy_from_slice(src);
    load(&padded)
}

/// 4 values of a row from `at` on, padded with zeros.
#[inline]
pub(crate) fn load_at(row: &[f32], at: usize) -> Register {
    match row.get(at..) {
        Some(rest) if !rest.is_empty() => load_part(rest),
        _ => zero(),
    }
}

/// Stores 4 values.
#[inline]
pub(crate) fn store(dst: &mut [f32; WIDTH], value: Register) {
    // SAFETY: `dst` is 16 writable bytes; the store needs no alignment.
    unsafe { v128_store(dst.as_mut_ptr().cast(), value) }
}

/// Stores as many of the 4 values as `dst` has room for.
#[inline]
pub(crate) fn store_part(dst: &mut [f32], value: Register) {
    if let Some(whole) = dst.first_chunk_mut() {
        return store(whole, value);
    }
    let lanes = to_array(value);
    dst.copy_from_slice(&lanes[..dst.len()]);
}

/// The 4 values as an array.
#[inline]
pub(crate) fn to_array(value: Register) -> [f32; WIDTH] {
    let mut lanes = [0.0; WIDTH];
    store(&mut lanes, value);
    lanes
}

/// The largest of the 4 values.
#[inline]
pub(crate) fn reduce_max(value: Register) -> f32 {
    let two = max_lanes(value, i32x4_shuffle::<2, 3, 0, 1>(value, value));
    f32x4_extract_lane::<0>(max_lanes(two, i32x4_shuffle::<1, 0, 3, 2>(two, two)))
}

/// Zeros.
#[inline]
pub(crate) fn zero() -> Register {
    splat(0.0)
}

/// `value` in every lane.
#[inline]
pub(crate) fn splat(value: f32) -> Register {
    f32x4_splat(value)
}

/// `a + b`.
#[inline]
pub(crate) fn add(a: Register, b: Register) -> Register {
    f32x4_add(a, b)
}

/// `a - b`.
#[inline]
pub(crate) fn sub(a: Register, b: Register) -> Register {
    f32x4_sub(a, b)
}

/// `a * b`.
#[inline]
pub(crate) fn mul(a: Register, b: Register) -> Register {
    f32x4_mul(a, b)
}

/// `a / b`.
#[inline]
pub(crate) fn divide(a: Register, b: Register) -> Register {
    f32x4_div(a, b)
}

/// `a * b + c`, both rounded.
#[inline]
pub(crate) fn multiply_add(a: Register, b: Register, c: Register) -> Register {
    f32x4_add(f32x4_mul(a, b), c)
}

/// The greater of each two lanes; `a` if one is NaN.
#[inline]
pub(crate) fn max_lanes(a: Register, b: Register) -> Register {
    f32x4_pmax(a, b)
}

/// `a * b + c`, rounded once.
///
/// A product is exact in f64, and its sum with `c` is rounded once to 53 bits. A second
/// rounding to 24 gives the correct result unless the first gave a tie or the result is denormal: in
/// these cases each lane is computed separately.
#[inline]
pub(crate) fn fmadd(a: Register, b: Register, c: Register) -> Register {
    let low = wide_sum(a, b, c);
    let high = wide_sum(upper(a), upper(b), upper(c));
    let value = i64x2_shuffle::<0, 2>(f32x4_demote_f64x2_zero(low), f32x4_demote_f64x2_zero(high));
    let tiny = f32x4_le(f32x4_abs(value), f32x4_splat(f32::MIN_POSITIVE));
    if v128_any_true(v128_or(tiny, v128_or(is_tie(low), is_tie(high)))) { fmadd_lanes(a, b, c) } else { value }
}

/// `a * b + c` of the lower two lanes, in f64.
#[inline]
fn wide_sum(a: Register, b: Register, c: Register) -> v128 {
    let product = f64x2_mul(f64x2_promote_low_f32x4(a), f64x2_promote_low_f32x4(b));
    f64x2_add(product, f64x2_promote_low_f32x4(c))
}

/// The upper two lanes.
#[inline]
fn upper(value: Register) -> Register {
    i64x2_shuffle::<1, 1>(value, value)
}

/// Lanes of f64 half-way between two f32.
#[inline]
fn is_tie(value: v128) -> v128 {
    /// The bits by which an f64's fraction exceeds an f32's, and the highest of them.
    const REST: u64 = (1 << 29) - 1;
    const HALF: u64 = 1 << 28;
    i64x2_eq(v128_and(value, u64x2_splat(REST)), u64x2_splat(HALF))
}

#[cold]
#[inline(never)]
fn fmadd_lanes(a: Register, b: Register, c: Register) -> Register {
    let (a, b, mut value) = (to_array(a), to_array(b), to_array(c));
    for lane in 0..WIDTH {
        value[lane] = a[lane].mul_add(b[lane], value[lane]);
    }
    load(&value)
}

/// The first `len` lanes of `a`, the others of `b`.
#[inline]
pub(crate) fn select_first(len: usize, a: Register, b: Register) -> Register {
    let len = u32x4_splat(u32::try_from(len).unwrap_or(u32::MAX));
    v128_bitselect(a, b, u32x4_lt(u32x4(0, 1, 2, 3), len))
}

/// 4 values, widened: bfloat16 is the upper half of an f32.
#[inline]
pub(crate) fn load_bf16(src: &[Bf16; WIDTH]) -> Register {
    // SAFETY: `src` is 8 readable bytes, as `Bf16` is 16 bits in memory; the load needs no alignment.
    u32x4_shl(unsafe { u32x4_load_extend_u16x4(src.as_ptr().cast()) }, 16)
}

/// The first 4 values, widened, padded with zeros.
#[inline]
pub(crate) fn load_part_bf16(src: &[Bf16]) -> Register {
    if let Some(whole) = src.first_chunk() {
        return load_bf16(whole);
    }
    let mut padded = [Bf16(0); WIDTH];
    padded[..src.len()].copy_from_slice(src);
    load_bf16(&padded)
}

/// 16 values.
#[inline]
pub(crate) fn load_all(src: &[f32; LANES]) -> [Register; REGISTERS] {
    let (parts, _) = src.as_chunks();
    [load(&parts[0]), load(&parts[1]), load(&parts[2]), load(&parts[3])]
}

/// Stores 16 values.
#[inline]
pub(crate) fn store_all(dst: &mut [f32; LANES], values: [Register; REGISTERS]) {
    for (part, value) in dst.as_chunks_mut().0.iter_mut().zip(values) {
        store(part, value);
    }
}
