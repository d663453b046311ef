//! No peak to compare with, but for memory: an engine decides what each operation costs.

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
