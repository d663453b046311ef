//! As `avx512vnni.rs`, in registers of 8 lanes: 4 queries x 2 keys are 8 dot products in 8 of the
//! 16 registers; a dot product has 8 partial sums.

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use super::operands::Operands;
use crate::isa::{Avx2, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;
pub(super) use loops::Load;

/// Where the loops change.
pub(super) fn tiling(_token: Avx2) -> Tiling {
    loops::TILING
}

entry! {
    pub(super) fn attention<T: Load>(_token: Avx2, x: Operands<T>, y: MatMut<f32>) {
        loops::attention(x, y);
    }
}
