//! As `avx512vnni.rs`, in registers of 8 lanes: 4 queries x 2 keys are 8 dot products in 8 of the
//! 16 registers; a dot product has 8 partial sums.

#[path = "loops.rs"]
mod loops;
pub(super) mod portable;
pub(super) mod vector;

use super::operands::{HeadOperands, Operands};
use crate::isa::{Avx2, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;
pub(super) use loops::Load;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx2) -> Tiling {
    loops::TILING
}

/// Sizes at which the loops over heads change.
pub(super) fn heads_tiling(_token: Avx2) -> Tiling {
    loops::HEADS_TILING
}

entry! {
    pub(super) fn attention<T: Load>(_token: Avx2, x: Operands<T>, y: MatMut<f32>) {
        loops::attention(x, y);
    }

    pub(super) fn heads(_token: Avx2, x: HeadOperands, y: MatMut<f32>) {
        loops::heads(x, y);
    }
}
