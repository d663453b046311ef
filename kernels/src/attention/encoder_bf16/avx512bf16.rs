//! As `avx512vnni.rs`, but a lane of a factor holds two values of one sum, which `vdpbf16ps`
//! adds in sequence: the upper one first, rounding after each addition, like two fused
//! operations (`isa` checks that at detection).

#[path = "loops.rs"]
mod loops;
pub(super) mod vector;

use crate::attention::operands::Operands;
use crate::isa::{Avx512Bf16, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx512Bf16) -> Tiling {
    loops::TILING
}

entry! {
    pub(super) fn attention(token: Avx512Bf16, x: Operands<f32>, y: MatMut<f32>) {
        loops::attention(token, x, y);
    }
}
