//! 8 outputs per fused multiply-add: a panel is two registers.

#[path = "loops.rs"]
mod loops;
mod vector;

use crate::isa::Avx2;
use crate::tiling::Tiling;
pub(crate) use loops::{Load, run, store_gated_tile, store_tile};

/// Sizes at which the loops change.
pub(crate) fn tiling(_token: Avx2) -> Tiling {
    loops::TILING
}
