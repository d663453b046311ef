//! Peaks with tiles.

use crate::amx::Tiles;

/// `tdpbssd` on four independent sums.
///
/// # Safety
/// `Isa` must hold `Amx`: the processor has tiles with int8 products, and the system granted them.
pub(super) unsafe fn int8(rounds: usize) -> usize {
    // SAFETY: tiles are granted, by this function's own clause.
    let tiles = unsafe { Tiles::new() };
    for _ in 0..rounds {
        tiles.multiply_i8::<0, 4, 6>();
        tiles.multiply_i8::<1, 4, 7>();
        tiles.multiply_i8::<2, 5, 6>();
        tiles.multiply_i8::<3, 5, 7>();
    }
    rounds * 4 * 16 * 16 * 64
}
