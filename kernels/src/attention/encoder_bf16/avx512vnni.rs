//! 4 queries x 32 keys, or 32 columns, are 8 registers of even products, 8 of odd ones, and 8
//! of running sums.

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use crate::attention::operands::Operands;
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx512Vnni) -> Tiling {
    loops::TILING
}

entry! {
    pub(super) fn attention(token: Avx512Vnni, x: Operands<f32>, y: MatMut<f32>) {
        loops::attention(token, x, y);
    }
}
