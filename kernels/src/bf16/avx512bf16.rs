//! `vdpbf16ps` and `vcvtne2ps2bf16` in assembly: the intrinsics require a target feature that the
//! loops, which are shared with other instructions, lack, so they would not be inlined.

use crate::isa::Avx512Bf16;
use core::arch::asm;
use core::arch::x86_64::*;
use umo_kernels_features::avx512vnni;

/// `sum + x * w` of each lane's upper halves, then of its lower halves: products of bf16, with one
/// rounding per addition and denormals taken as 0.
#[inline]
#[avx512vnni]
pub(crate) fn multiply_pairs(_token: Avx512Bf16, x: __m512, w: __m512, mut sum: __m512) -> __m512 {
    // SAFETY: the token proves that the processor has the instruction, which reads and
    // writes only these registers.
    unsafe {
        asm!("vdpbf16ps {sum}, {x}, {w}", sum = inout(zmm_reg) sum, x = in(zmm_reg) x, w = in(zmm_reg) w,
            options(pure, nomem, nostack, preserves_flags));
    }
    sum
}

/// The nearest bf16 of all lanes, ties to even, denormals as 0: the words of `first`, then of `second`.
#[inline]
#[avx512vnni]
pub(crate) fn round_two(_token: Avx512Bf16, first: __m512, second: __m512) -> __m512i {
    let words;
    // SAFETY: the token proves that the processor has the instruction, which reads and
    // writes only these registers.
    unsafe {
        asm!("vcvtne2ps2bf16 {words}, {second}, {first}", words = out(zmm_reg) words, second = in(zmm_reg) second,
            first = in(zmm_reg) first, options(pure, nomem, nostack, preserves_flags));
    }
    words
}
