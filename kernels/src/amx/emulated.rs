//! Tiles in memory, for processors without AMX: each method follows Intel's description of the
//! instruction.

use super::{BYTES, TILE};
use core::array::from_fn;
use core::cell::Cell;

type Tile = [[u8; BYTES]; TILE];
/// Four-byte values in a tile's row.
const WIDE: usize = BYTES / 4;

/// Eight tiles.
pub(super) struct Registers([Cell<Tile>; 8]);

impl Registers {
    /// # Safety
    /// None; the hardware version has preconditions.
    pub(super) unsafe fn configure() -> Self {
        Self(from_fn(|_| Cell::new([[0; BYTES]; TILE])))
    }

    fn tile<const T: u8>(&self) -> &Cell<Tile> {
        &self.0[usize::from(T)]
    }

    /// `tmmT = 0`.
    pub(super) fn zero<const T: u8>(&self) {
        self.tile::<T>().set([[0; BYTES]; TILE]);
    }

    /// `tmmT` = 16 rows, `stride` bytes apart.
    ///
    /// # Safety
    /// 64 bytes of each row are readable.
    pub(super) unsafe fn load<const T: u8>(&self, rows: *const u8, stride: usize) {
        // SAFETY: readable by this function's contract; bytes need no alignment.
        let row = |r: usize| unsafe { rows.wrapping_add(r * stride).cast::<[u8; BYTES]>().read() };
        self.tile::<T>().set(from_fn(row));
    }

    /// [`Registers::load`], with the streaming hint ignored.
    ///
    /// # Safety
    /// 64 bytes of each row are readable.
    pub(super) unsafe fn load_streaming<const T: u8>(&self, rows: *const u8, stride: usize) {
        // SAFETY: by this function's contract, which is the same.
        unsafe { self.load::<T>(rows, stride) }
    }

    /// Stores `tmmT` as 16 rows, `stride` bytes apart.
    ///
    /// # Safety
    /// 64 bytes of each row are writable.
    pub(super) unsafe fn store<const T: u8>(&self, rows: *mut u8, stride: usize) {
        for (r, row) in self.tile::<T>().get().into_iter().enumerate() {
            // SAFETY: writable by this function's contract; bytes need no alignment.
            unsafe { rows.wrapping_add(r * stride).cast::<[u8; BYTES]>().write(row) }
        }
    }

    /// `tmmC += tmmX * tmmW`, signed bytes with sums that wrap.
    pub(super) fn multiply_i8<const C: u8, const X: u8, const W: u8>(&self) {
        let signed = |bytes: [u8; 4]| bytes.map(|byte| i32::from(byte.cast_signed()));
        let (x, w) = (numbers(self.tile::<X>(), signed), numbers(self.tile::<W>(), signed));
        let mut sums = numbers(self.tile::<C>(), i32::from_le_bytes);
        for (sums, x) in sums.iter_mut().zip(&x) {
            for (x, w) in x.iter().zip(&w) {
                for (sum, w) in sums.iter_mut().zip(w) {
                    *sum = sum.wrapping_add(x[0] * w[0] + x[1] * w[1] + x[2] * w[2] + x[3] * w[3]);
                }
            }
        }
        self.tile::<C>().set(bytes(sums, i32::to_le_bytes));
    }

    /// `tmmC += tmmX * tmmW`, pairs of bf16 with f32 sums: the products of the first and of
    /// the second numbers of all pairs are summed separately, these two sums are added, and
    /// the total is added to `tmmC`. A product of two bf16 numbers is exact in f32;
    /// denormals are flushed to zero.
    pub(super) fn multiply_bf16<const C: u8, const X: u8, const W: u8>(&self) {
        let pair = |[a, b, c, d]: [u8; 4]| [[0, 0, a, b], [0, 0, c, d]].map(|bytes| flush(f32::from_le_bytes(bytes)));
        let (x, w) = (numbers(self.tile::<X>(), pair), numbers(self.tile::<W>(), pair));
        let mut sums = numbers(self.tile::<C>(), |bytes| flush(f32::from_le_bytes(bytes)));
        for (sums, x) in sums.iter_mut().zip(&x) {
            let mut pairs = [[0.0; 2]; WIDE];
            for (x, w) in x.iter().zip(&w) {
                for (pair, w) in pairs.iter_mut().zip(w) {
                    *pair = [flush(pair[0] + x[0] * w[0]), flush(pair[1] + x[1] * w[1])];
                }
            }
            for (sum, pair) in sums.iter_mut().zip(pairs) {
                *sum = flush(*sum + flush(pair[0] + pair[1]));
            }
        }
        self.tile::<C>().set(bytes(sums, f32::to_le_bytes));
    }
}

/// Applies `f` to the four-byte numbers of a tile.
fn numbers<T>(tile: &Cell<Tile>, f: impl Fn([u8; 4]) -> T) -> [[T; WIDE]; TILE] {
    tile.get().map(|row| from_fn(|n| f(from_fn(|i| row[4 * n + i]))))
}

/// Numbers as a tile's rows.
fn bytes<T>(numbers: [[T; WIDE]; TILE], f: impl Fn(T) -> [u8; 4]) -> Tile {
    numbers.map(|row| {
        let bytes = row.map(&f);
        from_fn(|i| bytes[i / 4][i % 4])
    })
}

/// Flushes denormals to zeros of their sign.
fn flush(value: f32) -> f32 {
    if value.is_subnormal() { 0.0_f32.copysign(value) } else { value }
}
