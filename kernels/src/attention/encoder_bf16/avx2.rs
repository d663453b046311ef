//! As `avx512vnni.rs`, in registers of 8 lanes: 2 queries x 16 keys or columns are 4 registers
//! each.

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use crate::attention::operands::Operands;
use crate::isa::{Avx2, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx2) -> Tiling {
    loops::TILING
}

entry! {
    pub(super) fn attention(token: Avx2, x: Operands<f32>, y: MatMut<f32>) {
        loops::attention(token, x, y);
    }
}
