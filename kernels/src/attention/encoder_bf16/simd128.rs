//! As `neon.rs`, in registers of 4 lanes.

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use crate::attention::operands::Operands;
use crate::isa::Simd128;
use crate::mat::MatMut;
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Simd128) -> Tiling {
    loops::TILING
}

pub(super) fn attention(token: Simd128, x: Operands<f32>, y: MatMut<f32>) {
    loops::attention(token, x, y);
}
