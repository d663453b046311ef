//! Tiles of AMX: configured, loaded, multiplied as bfloat16 pairs and stored, each instruction by its name.

use core::arch::asm;
use core::marker::PhantomData;

/// Rows of a tile.
pub(crate) const ROWS: usize = 16;

/// 16 rows of 64 bytes: 16 f32, or 16 pairs of bfloat16, each row at home in one AVX-512 register.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Tile(pub(crate) [[f32; 16]; ROWS]);

impl Tile {
    /// All zeros.
    pub(crate) const ZERO: Self = Self([[0.0; 16]; ROWS]);
}

/// The proof that this thread's tiles are configured, all of them 16 rows of 64 bytes; dropping it releases them.
pub(crate) struct Tiles {
    /// Tiles belong to a thread.
    thread: PhantomData<*const ()>,
}

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

impl Tiles {
    /// Configures this thread's tiles.
    ///
    /// # Safety
    /// `Isa` must hold `Amx`: the processor and the system granted tiles to this process.
    pub(crate) unsafe fn new() -> Self {
        // SAFETY: tiles are granted, by this function's own clause; `CONFIG` is 64 readable bytes that describe what
        // palette 1 allows.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const CONFIG, options(nostack, preserves_flags, readonly)) }
        Self { thread: PhantomData }
    }

    /// `tmmT = 0`.
    #[inline(always)]
    pub(crate) fn zero<const T: u8>(&self) {
        // SAFETY: tile `T` is configured while `self` lives; nothing but this type's methods uses it.
        unsafe { asm!("tilezero tmm{t}", t = const T, options(nostack, preserves_flags, nomem)) }
    }

    /// `tmmT = tile`.
    #[inline(always)]
    pub(crate) fn load<const T: u8>(&self, tile: &Tile) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, which is what `tile` holds, one behind the other.
        unsafe {
            asm!("tileloadd tmm{t}, [{tile} + {stride}]", t = const T, tile = in(reg) tile, stride = in(reg) 64_usize,
                options(nostack, preserves_flags, readonly));
        }
    }

    /// `tile = tmmT`.
    #[inline(always)]
    pub(crate) fn store<const T: u8>(&self, tile: &mut Tile) {
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, for which `tile` has room.
        unsafe {
            asm!("tilestored [{tile} + {stride}], tmm{t}", t = const T, tile = in(reg) tile, stride = in(reg) 64_usize,
                options(nostack, preserves_flags));
        }
    }

    /// `tmmC += tmmA * tmmB`: `C[i][j] += sum_p A[i][2 p] * B[p][2 j] + A[i][2 p + 1] * B[p][2 j + 1]` in bfloat16 pairs,
    /// denormals taken as zero. A row of `C` depends on its own row of `A` alone.
    #[inline(always)]
    pub(crate) fn multiply_bf16<const C: u8, const A: u8, const B: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this type's methods uses them.
        unsafe {
            asm!("tdpbf16ps tmm{c}, tmm{a}, tmm{b}", c = const C, a = const A, b = const B,
                options(nostack, preserves_flags, nomem));
        }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        // SAFETY: tiles are configured, so the processor has them; whoever needs them next configures them again.
        unsafe { asm!("tilerelease", options(nostack, preserves_flags, nomem)) }
    }
}
