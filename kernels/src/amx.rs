//! AMX: eight tiles of 16 rows of 64 bytes, which products use in one way:
//!
//! ```text
//!                  w: tmm6  tmm7    one panel each
//! x: tmm4 (rows  0..16)  tmm0  tmm1
//!    tmm5 (rows 16..32)  tmm2  tmm3
//! ```
//! or, where no more than 16 rows are left, one tile of rows with four panels.

use crate::pack::PANEL;
use core::arch::asm;
use core::marker::PhantomData;

/// Rows of a tile; of weights, as many quads or pairs.
pub(crate) const TILE: usize = 16;
/// Bytes of a tile's row.
pub(crate) const BYTES: usize = 64;

/// Something at the start of a line: a tile's row that crosses two takes twice as long to load.
#[repr(C, align(64))]
pub(crate) struct Aligned<T>(pub(crate) T);

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
    /// # Safety
    /// The processor and the system grant tiles: where an `Isa` holds `Amx`.
    pub(crate) unsafe fn new() -> Self {
        // SAFETY: tiles are granted by this function's contract; `CONFIG` is 64 readable bytes that describe what palette 1
        // allows.
        unsafe { asm!("ldtilecfg [{}]", in(reg) &raw const CONFIG, options(nostack, preserves_flags, readonly)) }
        Self { thread: PhantomData }
    }

    /// The sums, tiles 0 to 3, become zero.
    #[inline]
    pub(crate) fn zero(&self) {
        // SAFETY: tiles 0 to 3 are configured; nothing but this type's methods uses them.
        unsafe {
            asm!(
                "tilezero tmm0",
                "tilezero tmm1",
                "tilezero tmm2",
                "tilezero tmm3",
                options(nostack, preserves_flags, nomem)
            );
        }
    }

    /// The first two sums, tiles 0 and 1, become zero.
    #[inline]
    pub(crate) fn zero_two(&self) {
        // SAFETY: tiles 0 and 1 are configured; nothing but this type's methods uses them.
        unsafe { asm!("tilezero tmm0", "tilezero tmm1", options(nostack, preserves_flags, nomem)) }
    }

    /// `tmmT = tile`.
    #[inline]
    pub(crate) fn load<const T: u8, Row>(&self, tile: &[Row; TILE]) {
        const { assert!(size_of::<Row>() == BYTES) };
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, which is what `tile` holds, one behind the other.
        unsafe {
            asm!("tileloadd tmm{t}, [{tile} + {stride}]", t = const T, tile = in(reg) tile, stride = in(reg) BYTES,
                options(nostack, preserves_flags, readonly));
        }
    }

    /// `tmmT` = 64 bytes of each of 16 rows, `stride` elements apart.
    #[inline]
    pub(crate) fn load_rows<const T: u8, V>(&self, rows: &[V], stride: usize) {
        assert!(size_of_val(rows) >= (TILE - 1) * stride * size_of::<V>() + BYTES);
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, the last of which ends inside `rows` by the assertion.
        unsafe {
            asm!("tileloadd tmm{t}, [{rows} + {stride}]", t = const T, rows = in(reg) rows.as_ptr(),
                stride = in(reg) stride * size_of::<V>(), options(nostack, preserves_flags, readonly));
        }
    }

    /// The same, of which L1 keeps nothing: what passes by once does not drive out what is used again.
    #[inline]
    pub(crate) fn load_rows_past<const T: u8, V>(&self, rows: &[V], stride: usize) {
        assert!(size_of_val(rows) >= (TILE - 1) * stride * size_of::<V>() + BYTES);
        // SAFETY: tile `T` is configured as 16 rows of 64 bytes, the last of which ends inside `rows` by the assertion.
        unsafe {
            asm!("tileloaddt1 tmm{t}, [{rows} + {stride}]", t = const T, rows = in(reg) rows.as_ptr(),
                stride = in(reg) stride * size_of::<V>(), options(nostack, preserves_flags, readonly));
        }
    }

    /// `tmmC += tmmX * tmmW`, signed bytes with exact sums.
    #[inline]
    pub(crate) fn multiply_i8<const C: u8, const X: u8, const W: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this type's methods uses them.
        unsafe {
            asm!("tdpbssd tmm{c}, tmm{x}, tmm{w}", c = const C, x = const X, w = const W,
                options(nostack, preserves_flags, nomem));
        }
    }

    /// `tmmC += tmmX * tmmW`, pairs of bf16 with f32 sums.
    #[inline]
    pub(crate) fn multiply_bf16<const C: u8, const X: u8, const W: u8>(&self) {
        // SAFETY: the three tiles are configured with sizes that fit each other; nothing but this type's methods uses them.
        unsafe {
            asm!("tdpbf16ps tmm{c}, tmm{x}, tmm{w}", c = const C, x = const X, w = const W,
                options(nostack, preserves_flags, nomem));
        }
    }

    #[inline]
    fn load_sum<const C: u8>(&self, sums: &[[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: tile `C` is configured as 16 rows of 64 bytes; row `r` is `sums[r * stride]`, inside by the assertion.
        unsafe {
            asm!("tileloadd tmm{c}, [{sums} + {stride}]", c = const C, sums = in(reg) sums.as_ptr(),
                stride = in(reg) stride * size_of::<[f32; PANEL]>(), options(nostack, preserves_flags, readonly));
        }
    }

    #[inline]
    /// 16 rows of sums, `stride` apart, become those of tile `C`.
    pub(crate) fn store_sum<const C: u8>(&self, sums: &mut [[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: tile `C` is configured as 16 rows of 64 bytes; row `r` is `sums[r * stride]`, inside by the assertion.
        unsafe {
            asm!("tilestored [{sums} + {stride}], tmm{c}", c = const C, sums = in(reg) sums.as_mut_ptr(),
                stride = in(reg) stride * size_of::<[f32; PANEL]>(), options(nostack, preserves_flags));
        }
    }

    /// The sums of `R` tiles of rows with `P` panels, as [`Tiles::store_sums`] left them.
    #[inline]
    pub(crate) fn load_sums<const R: usize, const P: usize>(&self, sums: &[[f32; PANEL]]) {
        self.load_sum::<0>(sums, P);
        if P > 1 {
            self.load_sum::<1>(&sums[1..], P);
        }
        if R == 2 {
            self.load_sum::<2>(&sums[TILE * P..], P);
        } else if P > 2 {
            self.load_sum::<2>(&sums[2..], P);
        }
        if R == 2 && P > 1 {
            self.load_sum::<3>(&sums[TILE * P + 1..], P);
        } else if P > 3 {
            self.load_sum::<3>(&sums[3..], P);
        }
    }

    /// Stores the sums of `R` tiles of rows with `P` panels as `[rows, P]`: tile `P * r + p` has those of row tile `r`.
    #[inline]
    pub(crate) fn store_sums<const R: usize, const P: usize>(&self, sums: &mut [[f32; PANEL]]) {
        self.store_sum::<0>(sums, P);
        if P > 1 {
            self.store_sum::<1>(&mut sums[1..], P);
        }
        if R == 2 {
            self.store_sum::<2>(&mut sums[TILE * P..], P);
        } else if P > 2 {
            self.store_sum::<2>(&mut sums[2..], P);
        }
        if R == 2 && P > 1 {
            self.store_sum::<3>(&mut sums[TILE * P + 1..], P);
        } else if P > 3 {
            self.store_sum::<3>(&mut sums[3..], P);
        }
    }
}

impl Drop for Tiles {
    fn drop(&mut self) {
        // SAFETY: tiles are configured, so the processor has them; whoever needs them next configures them again.
        unsafe { asm!("tilerelease", options(nostack, preserves_flags, nomem)) }
    }
}
