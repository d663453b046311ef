//! Peaks with tiles.

use core::arch::asm;

/// Tiles of 16 rows of 64 bytes, all eight of them.
#[repr(C, align(64))]
struct Config {
    palette: u8,
    start_row: u8,
    reserved: [u8; 14],
    row_bytes: [u16; 16],
    rows: [u8; 16],
}

static CONFIG: Config = Config {
    palette: 1,
    start_row: 0,
    reserved: [0; 14],
    row_bytes: [64, 64, 64, 64, 64, 64, 64, 64, 0, 0, 0, 0, 0, 0, 0, 0],
    rows: [16, 16, 16, 16, 16, 16, 16, 16, 0, 0, 0, 0, 0, 0, 0, 0],
};

/// `tdpbssd` on four independent sums.
///
/// # Safety
/// `Isa` must hold `Amx`: the processor has tiles with int8 products, and the system granted them.
pub(super) unsafe fn int8(rounds: usize) -> usize {
    if rounds == 0 {
        return 0;
    }
    // SAFETY: tiles are granted, by this function's own clause; `CONFIG` is 64 readable bytes that describe what palette 1
    // allows; tiles are used between configuration and release alone, inside this block; `rounds` is at least 1.
    unsafe {
        asm!(
            "ldtilecfg [{config}]",
            "2:",
            "tdpbssd tmm0, tmm4, tmm6",
            "tdpbssd tmm1, tmm4, tmm7",
            "tdpbssd tmm2, tmm5, tmm6",
            "tdpbssd tmm3, tmm5, tmm7",
            "dec {rounds}",
            "jnz 2b",
            "tilerelease",
            config = in(reg) &raw const CONFIG,
            rounds = inout(reg) rounds => _,
            options(nostack, readonly),
        );
    }
    rounds * 4 * 16 * 16 * 64
}
