//! 4 outputs per fused multiply-add: a panel is two pairs of registers.

#[path = "loops.rs"]
mod loops;
mod vector;

use crate::isa::Neon;
use crate::tiling::Tiling;
pub(crate) use loops::{Load, run, store_gated_tile, store_tile};

/// Sizes at which the loops change.
pub(crate) fn tiling(_token: Neon) -> Tiling {
    loops::TILING
}
