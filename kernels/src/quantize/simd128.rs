//! 16 values at a time.

use crate::isa::Simd128;
use crate::lanes::LANES;
use crate::lanes::simd128::{WIDTH, load, load_all, load_part, max_lanes, mul, reduce_max, splat};
use core::arch::wasm32::*;

/// The largest absolute value.
pub(super) fn largest(_token: Simd128, row: &[f32]) -> f32 {
    let (chunks, tail) = row.as_chunks::<WIDTH>();
    let max = chunks.iter().fold(f32x4_abs(load_part(tail)), |max, x| max_lanes(max, f32x4_abs(load(x))));
    reduce_max(max)
}

pub(super) fn round(_token: Simd128, row: &[f32], per_unit: f32, codes: &mut [i8]) {
    let ((chunks, tail), (code_chunks, code_tail)) = (row.as_chunks::<LANES>(), codes.as_chunks_mut::<LANES>());
    for (chunk, codes) in chunks.iter().zip(code_chunks) {
        rounded(chunk, per_unit, codes);
    }
    let (mut last, mut last_codes) = ([0.0; LANES], [0; LANES]);
    last[..tail.len()].copy_from_slice(tail);
    rounded(&last, per_unit, &mut last_codes);
    code_tail.copy_from_slice(&last_codes[..code_tail.len()]);
}

/// The nearest codes, ties to even.
#[inline]
fn rounded(values: &[f32; LANES], per_unit: f32, codes: &mut [i8; LANES]) {
    let factor = splat(per_unit);
    let [a, b, c, d] = load_all(values).map(|x| i32x4_trunc_sat_f32x4(f32x4_nearest(mul(x, factor))));
    let bytes = i8x16_narrow_i16x8(i16x8_narrow_i32x4(a, b), i16x8_narrow_i32x4(c, d));
    // SAFETY: `codes` is 16 writable bytes; the store needs no alignment.
    unsafe { v128_store(codes.as_mut_ptr().cast(), bytes) }
}
