//! As `avx2.rs`, in pairs of registers of 4 lanes.

#[path = "loops.rs"]
mod loops;
pub(super) mod portable;
pub(super) mod vector;

use super::operands::{HeadOperands, Operands};
use crate::isa::{Neon, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;
pub(super) use loops::Load;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Neon) -> Tiling {
    loops::TILING
}

/// Sizes at which the loops over heads change.
pub(super) fn heads_tiling(_token: Neon) -> Tiling {
    loops::HEADS_TILING
}

entry! {
    pub(super) fn attention<T: Load>(_token: Neon, x: Operands<T>, y: MatMut<f32>) {
        loops::attention(x, y);
    }

    pub(super) fn heads(_token: Neon, x: HeadOperands, y: MatMut<f32>) {
        loops::heads(x, y);
    }
}
