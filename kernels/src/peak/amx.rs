//! Peaks with tiles.

use crate::amx::Tiles;
use crate::isa::Amx;

/// `tdpbssd` on four independent sums.
pub(super) fn int8(token: Amx, rounds: usize) -> Option<usize> {
    let tiles = Tiles::new(token);
    for _ in 0..rounds {
        tiles.multiply_i8::<0, 4, 6>();
        tiles.multiply_i8::<1, 4, 7>();
        tiles.multiply_i8::<2, 5, 6>();
        tiles.multiply_i8::<3, 5, 7>();
    }
    Some(rounds * 4 * 16 * 16 * 64)
}
