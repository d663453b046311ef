//! Tile instructions of the processor.

use core::arch::asm;

/// The eight tiles of this thread, configured.
pub(super) struct Registers(());

/// Palette 1, and the bytes per row and rows of each tile.
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

impl Registers {
    /// # Safety
    /// The processor and the system grant tiles, and nothing else uses this thread's.
    pub(super) unsafe fn configure() -> Self {
        // SAFETY: tiles are granted by this function's contract; `CONFIG` is 64 readable bytes that
        // describe what palette 1 allows.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const CONFIG, options(nostack, preserves_flags, readonly)) }
        Self(())
    }

    /// `tmmT = 0`.
    #[inline]
    pub(super) fn zero<const T: u8>(&self) {
        // SAFETY: tiles are configured; nothing but this type's methods uses them.
        unsafe { asm!("tilezero tmm{t}", t = const T, options(nostack, preserves_flags, nomem)) }
    }

    /// `tmmT` = 16 rows, `stride` bytes apart.
    ///
    /// # Safety
    /// 64 bytes of each row are readable.
    #[inline]
    pub(super) unsafe fn load<const T: u8>(&self, rows: *const u8, stride: usize) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, readable by this function's
        // contract.
        unsafe {
            asm!("tileloadd tmm{t}, [{rows} + {stride}]", t = const T, rows = in(reg) rows, stride = in(reg) stride,
                options(nostack, preserves_flags, readonly));
        }
    }

    /// [`Registers::load`] with a streaming hint: L1 need not keep the rows.
    ///
    /// # Safety
    /// 64 bytes of each row are readable.
    #[inline]
    pub(super) unsafe fn load_streaming<const T: u8>(&self, rows: *const u8, stride: usize) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, readable by this function's
        // contract.
        unsafe {
            asm!("tileloaddt1 tmm{t}, [{rows} + {stride}]", t = const T, rows = in(reg) rows, stride = in(reg) stride,
                options(nostack, preserves_flags, readonly));
        }
    }

    /// Stores `tmmT` as 16 rows, `stride` bytes apart.
    ///
    /// # Safety
    /// 64 bytes of each row are writable.
    #[inline]
    pub(super) unsafe fn store<const T: u8>(&self, rows: *mut u8, stride: usize) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, writable by this function's
        // contract.
        unsafe {
            asm!("tilestored [{rows} + {stride}], tmm{t}", t = const T, rows = in(reg) rows, stride = in(reg) stride,
                options(nostack, preserves_flags));
        }
    }

    /// `tmmC += tmmX * tmmW`, signed bytes with exact sums.
    #[inline]
    pub(super) fn multiply_i8<const C: u8, const X: u8, const W: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this
        // type's methods uses them.
        unsafe {
            asm!("tdpbssd tmm{c}, tmm{x}, tmm{w}", c = const C, x = const X, w = const W,
                options(nostack, preserves_flags, nomem));
        }
    }

    /// `tmmC += tmmX * tmmW`, pairs of bf16 with f32 sums.
    #[inline]
    pub(super) fn multiply_bf16<const C: u8, const X: u8, const W: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this
        // type's methods uses them.
        unsafe {
            asm!("tdpbf16ps tmm{c}, tmm{x}, tmm{w}", c = const C, x = const X, w = const W,
                options(nostack, preserves_flags, nomem));
        }
    }
}

impl Drop for Registers {
    fn drop(&mut self) {
        // SAFETY: tiles are configured, so the processor has them; each later use
        // configures them again.
        unsafe { asm!("tilerelease", options(nostack, preserves_flags, nomem)) }
    }
}
