//! WebAssembly has no peak to compare with, except the memory bandwidth: engines determine the cost of operations.

use super::{Order, scalar};
use crate::isa::Simd128;

pub(super) fn int8(_token: Simd128, rounds: usize) -> Option<usize> {
    scalar::int8(rounds)
}

pub(super) fn f32(_token: Simd128, rounds: usize) -> Option<usize> {
    scalar::f32(rounds)
}

pub(super) fn read(_token: Simd128, order: Order, bytes: &[i8]) {
    scalar::read(order, bytes);
}
