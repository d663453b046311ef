//! The loops with the results of `scalar.rs`: sums in 16 lanes, two registers, and products that are rounded before they are added.

#[path = "../loops.rs"]
mod loops;

use crate::attention::operands::{HeadOperands, Operands};
use crate::isa::{Avx2, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;
use loops::Load;

/// What differs from the back-end's own loops.
mod vector {
    pub(super) use super::super::vector::*;
    use crate::lanes::LANES;
    pub(super) use crate::math::avx2::exp as softmax_exp;

    /// Registers of a sum's lanes.
    pub(super) const PARTS: usize = LANES / WIDTH;

    /// `a * b + c`, both rounded.
    #[inline]
    #[features]
    pub(super) fn fmadd(a: Register, b: Register, c: Register) -> Register {
        add(mul(a, b), c)
    }
}

/// Sizes at which the loops change.
pub(in crate::attention) fn tiling(_token: Avx2) -> Tiling {
    loops::TILING
}

/// Sizes at which the loops over heads change.
pub(in crate::attention) fn heads_tiling(_token: Avx2) -> Tiling {
    loops::HEADS_TILING
}

entry! {
    pub(in crate::attention) fn attention<T: Load>(_token: Avx2, x: Operands<T>, y: MatMut<f32>) {
        loops::attention(x, y);
    }

    pub(in crate::attention) fn heads(_token: Avx2, x: HeadOperands, y: MatMut<f32>) {
        loops::heads(x, y);
    }
}
