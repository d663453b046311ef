//! AMX: eight tiles of 16 rows of 64 bytes. All products use them in one way:
//!
//! ```text
//!                  w: tmm6  tmm7    one panel each
//! x: tmm4 (rows  0..16)  tmm0  tmm1
//!    tmm5 (rows 16..32)  tmm2  tmm3
//! ```
//! or, if at most 16 rows are left, one tile of rows with four panels.

#[cfg(not(umo_emulated_tiles))]
mod registers;
// For tests on processors without tiles: an exact and slow emulation.
#[cfg(umo_emulated_tiles)]
#[path = "amx/emulated.rs"]
mod registers;

use crate::isa::Amx;
use crate::pack::PANEL;
use core::marker::PhantomData;
use registers::Registers;

/// Rows of a tile; for weights, the number of quads or pairs.
pub(crate) const TILE: usize = 16;
/// Bytes of a tile's row.
pub(crate) const BYTES: usize = 64;

/// A value aligned to a cache line: a tile row that crosses two lines takes twice as long to
/// load.
#[repr(C, align(64))]
pub(crate) struct Aligned<T>(pub(crate) T);

/// Proof that this thread's tiles are configured, all as 16 rows of 64 bytes; dropping it
/// releases them. At most one per thread: two would overwrite each other's sums.
///
/// Tile registers keep their values from one `asm!` block to the next, which inline assembly cannot
/// declare. That is sound as long as no other code of the process uses tiles on the thread: the
/// compiler emits no tile instruction by itself, no feature is enabled that would allow it to, and
/// the system saves tiles when it switches threads.
pub(crate) struct Tiles {
    registers: Registers,
    /// Makes the type `!Send`: tiles belong to a thread.
    thread: PhantomData<*const ()>,
}

impl Tiles {
    /// Configures this thread's tiles.
    pub(crate) fn new(_token: Amx) -> Self {
        // SAFETY: the token proves that tiles are granted, and nothing but this type uses them.
        Self { registers: unsafe { Registers::configure() }, thread: PhantomData }
    }

    /// Zeroes the sums, tiles 0 to 3.
    #[inline]
    pub(crate) fn zero(&self) {
        self.zero_two();
        self.registers.zero::<2>();
        self.registers.zero::<3>();
    }

    /// Zeroes the first two sums, tiles 0 and 1.
    #[inline]
    pub(crate) fn zero_two(&self) {
        self.registers.zero::<0>();
        self.registers.zero::<1>();
    }

    /// `tmmT = tile`.
    #[inline]
    pub(crate) fn load<const T: u8, Row>(&self, tile: &[Row; TILE]) {
        const { assert!(size_of::<Row>() == BYTES) };
        // SAFETY: `tile` holds 16 contiguous rows of 64 bytes.
        unsafe { self.registers.load::<T>(tile.as_ptr().cast(), BYTES) }
    }

    /// `tmmT` = 64 bytes of each of 16 rows, `stride` elements apart.
    #[inline]
    pub(crate) fn load_rows<const T: u8, V>(&self, rows: &[V], stride: usize) {
        assert!(size_of_val(rows) >= (TILE - 1) * stride * size_of::<V>() + BYTES);
        // SAFETY: the last of 16 rows of 64 bytes ends inside `rows` by the assertion.
        unsafe { self.registers.load::<T>(rows.as_ptr().cast(), stride * size_of::<V>()) }
    }

    /// [`Tiles::load_rows`] with a streaming hint (`tileloaddt1`): the rows do not displace
    /// reused data in L1.
    #[inline]
    pub(crate) fn load_tile_streaming<const T: u8, V>(&self, rows: &[V], stride: usize) {
        assert!(size_of_val(rows) >= (TILE - 1) * stride * size_of::<V>() + BYTES);
        // SAFETY: the last of 16 rows of 64 bytes ends inside `rows` by the assertion.
        unsafe { self.registers.load_streaming::<T>(rows.as_ptr().cast(), stride * size_of::<V>()) }
    }

    /// `tmmC += tmmX * tmmW`, signed bytes with exact sums.
    #[inline]
    pub(crate) fn multiply_i8<const C: u8, const X: u8, const W: u8>(&self) {
        self.registers.multiply_i8::<C, X, W>();
    }

    /// `tmmC += tmmX * tmmW`, pairs of bf16 with f32 sums.
    #[inline]
    pub(crate) fn multiply_bf16<const C: u8, const X: u8, const W: u8>(&self) {
        self.registers.multiply_bf16::<C, X, W>();
    }

    #[inline]
    fn load_sum<const C: u8>(&self, sums: &[[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: row `r` of 64 bytes is `sums[r * stride]`, inside by the assertion.
        unsafe { self.registers.load::<C>(sums.as_ptr().cast(), stride * size_of::<[f32; PANEL]>()) }
    }

    /// Stores tile `C` as 16 rows of sums, `stride` apart.
    #[inline]
    pub(crate) fn store_sum<const C: u8>(&self, sums: &mut [[f32; PANEL]], stride: usize) {
        assert!(sums.len() > (TILE - 1) * stride);
        // SAFETY: row `r` of 64 bytes is `sums[r * stride]`, inside by the assertion.
        unsafe { self.registers.store::<C>(sums.as_mut_ptr().cast(), stride * size_of::<[f32; PANEL]>()) }
    }

    /// Loads the sums of `R` tiles of rows with `P` panels, as [`Tiles::store_sums`] stored them.
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

    /// Stores the sums of `R` tiles of rows with `P` panels as `[rows, P]`: tile `P * r +
    /// p` has the sums of row tile `r` with panel `p`.
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
