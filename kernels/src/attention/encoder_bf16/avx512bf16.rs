//! As `avx512vnni.rs`, but that a lane of a factor holds two values of one sum, which `vdpbf16ps` adds one after the other: the
//! upper one first, each product rounded with its addition, as two fused operations do ([`Isa`](crate::Isa) asks the processor).

use super::avx512vnni::{divide, power, rounded};
use super::loops::loops;
use super::{KEYS, STEP, Softmax};
use crate::attention::Operands;
use crate::attention::avx512vnni::transpose;
use crate::bf16::avx512bf16::multiply_pairs;
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

/// Each lane's first value, then its second.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn join(first: Register, second: Register) -> Register {
    let second = _mm512_srli_epi32::<16>(_mm512_castps_si512(second));
    _mm512_castsi512_ps(_mm512_or_si512(_mm512_castps_si512(first), second))
}

/// Of each four values the first and the third in the first lane, the second and the fourth in the second.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn joined_in_place(values: Register) -> Register {
    join(values, _mm512_permute_ps::<0b01_00_11_10>(values))
}

/// `sum + x * w` of each lane's first values, then of its second.
#[inline]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vnni")]
fn multiply_add(x: Register, w: Register, sum: Register) -> Register {
    // SAFETY: the dispatch leads here from `Backend::Avx512Bf16` alone.
    unsafe { multiply_pairs(x, w, sum) }
}
