//! Four queries at a time over a tile of keys, 16 lanes along `head_dim`.
//!
//! Scores: 4 queries x 4 keys are 16 dot products in 16 registers of partial sums, which a tree
//! of shuffles reduces to one register of 16 scores. One query uses 16 keys, two use 8; every
//! dot product keeps its order of additions. Values: 4 queries x 64 columns are 16 registers of
//! sums.

#[path = "loops.rs"]
mod loops;
pub(super) mod portable;
pub(super) mod vector;

use super::operands::{HeadOperands, Operands};
use crate::isa::{Avx512Vnni, entry};
use crate::mat::MatMut;
use crate::tiling::Tiling;
pub(super) use loops::Load;

/// Sizes at which the loops change.
pub(super) fn tiling(_token: Avx512Vnni) -> Tiling {
    loops::TILING
}

/// Sizes at which the loops over heads change.
pub(super) fn heads_tiling(_token: Avx512Vnni) -> Tiling {
    loops::HEADS_TILING
}

entry! {
    pub(super) fn attention<T: Load>(_token: Avx512Vnni, x: Operands<T>, y: MatMut<f32>) {
        loops::attention(x, y);
    }

    pub(super) fn heads(_token: Avx512Vnni, x: HeadOperands, y: MatMut<f32>) {
        loops::heads(x, y);
    }
}
