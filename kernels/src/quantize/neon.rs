//! 8 values at a time.

use crate::isa::{Neon, entry};
use crate::lanes::neon::{HALF, Register, load, load_part, max_lanes, mul, reduce_max, splat};
use core::arch::aarch64::*;
use umo_kernels_features::neon;

entry! {
    /// The largest absolute value.
    pub(super) fn largest(_token: Neon, row: &[f32]) -> f32 {
        let (chunks, tail) = row.as_chunks::<HALF>();
        let mut max = size(load_part(tail));
        for chunk in chunks {
            max = max_lanes(max, size(load(chunk)));
        }
        reduce_max(max)
    }

    pub(super) fn round(_token: Neon, row: &[f32], per_unit: f32, codes: &mut [i8]) {
        let factor = splat(per_unit);
        let ((chunks, tail), (code_chunks, code_tail)) = (row.as_chunks::<HALF>(), codes.as_chunks_mut::<HALF>());
        for (chunk, codes) in chunks.iter().zip(code_chunks) {
            rounded(mul(load(chunk), factor), codes);
        }
        let mut last = [0; HALF];
        rounded(mul(load_part(tail), factor), &mut last);
        code_tail.copy_from_slice(&last[..code_tail.len()]);
    }
}

#[inline]
#[neon]
fn size(x: Register) -> Register {
    [vabsq_f32(x[0]), vabsq_f32(x[1])]
}

/// The nearest codes, ties to even.
#[inline]
#[neon]
fn rounded(values: Register, codes: &mut [i8; HALF]) {
    let low = vqmovn_s32(vcvtnq_s32_f32(values[0]));
    let words = vqmovn_high_s32(low, vcvtnq_s32_f32(values[1]));
    let bytes = vqmovn_s16(words);
    // SAFETY: `codes` is 8 writable bytes; the store needs no alignment.
    unsafe { vst1_s8(codes.as_mut_ptr(), bytes) }
}
