//! As `avx2.rs`, in pairs of registers of 4 lanes.

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use crate::attention::operands::Operands;
use crate::isa::{Neon, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Neon) -> Tiling {
    loops::TILING
}

entry! {
    pub(super) fn attention(token: Neon, x: Operands<f32>, y: MatMut<f32>) {
        loops::attention(token, x, y);
    }
}
