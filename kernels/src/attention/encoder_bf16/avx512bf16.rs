//! As `avx512vnni.rs`, but that a lane of a factor holds two values of one sum, which `vdpbf16ps` adds one after the other: the
//! upper one first, each product rounded with its addition, as two fused operations do ([`Isa`](crate::Isa) asks the processor).

use super::avx512vnni::{divide, in_turn, power};
use super::loops::loops;
use super::{KEYS, STEP, Softmax};
use crate::attention::avx512vnni::transpose;
use crate::attention::operands::Operands;
use crate::bf16::avx512bf16::{multiply_pairs, round_two};
use crate::lanes::avx512vnni::*;
use crate::lanes::{LANES, LANES as WIDTH, pairwise};
use crate::mat::{Mat, MatMut};
use crate::math::LOG2_E;
use core::arch::x86_64::*;

/// Queries at once.
const QUERIES: usize = 4;

/// Values of a lane.
const JOINED: usize = 2;

loops!("avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni");

/// Each lane's value of one row in its upper half, where the first value is, and of the other in its lower.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn join(first: Register, second: Register) -> Register {
    // SAFETY: the dispatch leads here from `Backend::Avx512Bf16` alone.
    let words = unsafe { round_two(second, first) };
    in_turn(words)
}

/// Of each four values the first and the third in the first lane, the second and the fourth in the second; the earlier in the upper half.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn factor([first, second]: [Register; JOINED]) -> Register {
    let places = _mm512_broadcast_i32x4(_mm_setr_epi8(4, 5, 0, 1, 6, 7, 2, 3, 12, 13, 8, 9, 14, 15, 10, 11));
    // SAFETY: the dispatch leads here from `Backend::Avx512Bf16` alone.
    let words = unsafe { round_two(first, second) };
    _mm512_castsi512_ps(_mm512_shuffle_epi8(words, places))
}

/// `sum + x * w` of each lane's first values, then of its second.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply_add(x: Register, w: Register, sum: Register) -> Register {
    // SAFETY: the dispatch leads here from `Backend::Avx512Bf16` alone.
    unsafe { multiply_pairs(x, w, sum) }
}
