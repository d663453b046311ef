//! `vdpbf16ps` and `vcvtne2ps2bf16`, by name: functions of the intrinsic's own feature would not be inlined into loops that do without.

use core::arch::asm;
use core::arch::x86_64::*;

/// `sum + x * w` of each lane's upper halves, then of its lower ones: products of bfloat16, each rounded with its addition, denormals
/// taken as 0.
///
/// # Safety
/// The processor has the feature "avx512bf16".
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn multiply_pairs(x: __m512, w: __m512, mut sum: __m512) -> __m512 {
    // SAFETY: the instruction, which the processor has, reads and writes these registers alone.
    unsafe {
        asm!("vdpbf16ps {sum}, {x}, {w}", sum = inout(zmm_reg) sum, x = in(zmm_reg) x, w = in(zmm_reg) w,
            options(pure, nomem, nostack, preserves_flags));
    }
    sum
}

/// The nearest bfloat16 of all lanes, ties to even, denormals as 0: words of `first`, then of `second`.
///
/// # Safety
/// The processor has the feature "avx512bf16".
#[inline]
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn round_two(first: __m512, second: __m512) -> __m512i {
    let words;
    // SAFETY: the instruction, which the processor has, reads and writes these registers alone.
    unsafe {
        asm!("vcvtne2ps2bf16 {words}, {second}, {first}", words = out(zmm_reg) words, second = in(zmm_reg) second,
            first = in(zmm_reg) first, options(pure, nomem, nostack, preserves_flags));
    }
    words
}

/// Whether it does as [`multiply_pairs`] says, which its description leaves open in part: the upper halves first, a rounding each.
///
/// # Safety
/// As for [`multiply_pairs`], and the processor has the feature "avx512f".
#[target_feature(enable = "avx512f")]
pub(crate) unsafe fn adds_one_by_one() -> bool {
    const ONE: i32 = 0x3f80;
    const MINUS_ONE: i32 = 0xbf80;
    const HALF_OF_THE_LAST_BIT: i32 = 0x3380;
    let sum_of = |start: f32, upper: i32, lower: i32| {
        let x = _mm512_castsi512_ps(_mm512_set1_epi32(upper << 16 | lower));
        let w = _mm512_castsi512_ps(_mm512_set1_epi32(ONE << 16 | ONE));
        let start = _mm512_set1_ps(start);
        // SAFETY: by this function's contract.
        let sum = unsafe { multiply_pairs(x, w, start) };
        _mm512_cvtss_f32(sum)
    };
    // Two halves of the last bit of 1: each is lost by itself, not both together. 1 - 1 + half of it: lost in the other order.
    sum_of(1.0, HALF_OF_THE_LAST_BIT, HALF_OF_THE_LAST_BIT) == 1.0
        && sum_of(1.0, MINUS_ONE, HALF_OF_THE_LAST_BIT) == f32::EPSILON / 2.0
}
