//! A product as the vector back-ends process it: panels of any element type in processing order,
//! and tiles of rows.

use super::Epilogue;
use crate::bf16::Bf16;
use crate::pack::{BLOCK, PAIR, PANEL, PackedBf16, PackedF32, PackedI4, PackedI8, QUAD, panels};
#[cfg(target_arch = "x86_64")]
use core::ops::Range;

/// Packed weights of any type, so that tasks, and back-ends whose loops differ only in the
/// load, are written once.
pub(crate) trait Panels<'a>: Copy {
    /// Adjacent weights of a panel in memory: the weights of one input, or of a
    /// pair.
    type Row: Copy + 'a;
    /// Outputs.
    fn n(&self) -> usize;
    /// Inputs.
    fn k(&self) -> usize;
    /// Panel `p`, all inputs.
    fn panel(&self, p: usize) -> &'a [Self::Row];
}

impl<'a> Panels<'a> for PackedF32<'a> {
    type Row = [f32; PANEL];
    fn n(&self) -> usize {
        PackedF32::n(self)
    }
    fn k(&self) -> usize {
        PackedF32::k(self)
    }
    fn panel(&self, p: usize) -> &'a [Self::Row] {
        PackedF32::panel(self, p)
    }
}

impl<'a> Panels<'a> for PackedBf16<'a> {
    type Row = [[Bf16; PAIR]; PANEL];
    fn n(&self) -> usize {
        PackedBf16::n(self)
    }
    fn k(&self) -> usize {
        PackedBf16::k(self)
    }
    fn panel(&self, p: usize) -> &'a [Self::Row] {
        PackedBf16::panel(self, p)
    }
}

impl<'a> Panels<'a> for PackedI8<'a> {
    type Row = [i8; PANEL * QUAD];
    fn n(&self) -> usize {
        PackedI8::n(self)
    }
    fn k(&self) -> usize {
        PackedI8::k(self)
    }
    fn panel(&self, p: usize) -> &'a [Self::Row] {
        PackedI8::panel(self, p)
    }
}

impl<'a> Panels<'a> for PackedI4<'a> {
    type Row = [u8; BLOCK];
    fn n(&self) -> usize {
        PackedI4::n(self)
    }
    fn k(&self) -> usize {
        PackedI4::k(self)
    }
    fn panel(&self, p: usize) -> &'a [Self::Row] {
        PackedI4::panel(self, p)
    }
}

/// Packed weights with a scale per output.
pub(crate) trait Scaled<'a>: Panels<'a> {
    /// Value of one unit, per output.
    fn scale(&self) -> &'a [f32];
    /// Sums of the weights of some outputs; empty if inputs are never offset.
    #[cfg(target_arch = "x86_64")]
    fn sums(&self, outputs: Range<usize>) -> &'a [i32];
}

impl<'a> Scaled<'a> for PackedI8<'a> {
    fn scale(&self) -> &'a [f32] {
        PackedI8::scale(self)
    }
    #[cfg(target_arch = "x86_64")]
    fn sums(&self, outputs: Range<usize>) -> &'a [i32] {
        &self.sum()[outputs]
    }
}

impl<'a> Scaled<'a> for PackedI4<'a> {
    fn scale(&self) -> &'a [f32] {
        PackedI4::scale(self)
    }
    #[cfg(target_arch = "x86_64")]
    fn sums(&self, _: Range<usize>) -> &'a [i32] {
        &[]
    }
}

/// The weights of a product and its epilogue. A *slot* is a panel's position in the order of
/// processing.
pub(crate) enum GemmTask<'a, W> {
    /// A product with its epilogue.
    Plain(W, Epilogue<'a>),
    /// Gate and up panels alternate.
    Gated(W, W),
}

impl<'a, W: Panels<'a>> GemmTask<'_, W> {
    pub(crate) fn k(&self) -> usize {
        match self {
            GemmTask::Plain(w, _) | GemmTask::Gated(w, _) => w.k(),
        }
    }

    pub(crate) fn slots(&self) -> usize {
        match self {
            GemmTask::Plain(w, _) => panels(w.n()),
            GemmTask::Gated(gate, _) => 2 * panels(gate.n()),
        }
    }

    /// The panel of a slot.
    #[inline]
    pub(crate) fn panel(&self, slot: usize) -> &'a [W::Row] {
        let (w, p) = self.slot(slot);
        w.panel(p)
    }

    /// The weight of a slot, and the panel's place in it.
    #[inline]
    pub(crate) fn slot(&self, slot: usize) -> (&W, usize) {
        match self {
            GemmTask::Plain(w, _) => (w, slot),
            GemmTask::Gated(gate, up) => (if slot.is_multiple_of(2) { gate } else { up }, slot / 2),
        }
    }
}

/// First row and number of rows of each tile: as few tiles as possible, as equal as possible.
pub(crate) fn tiles(rows: usize, most: usize) -> impl Iterator<Item = (usize, usize)> {
    let count = rows.div_ceil(most);
    (0..count).map(move |i| (i * rows / count, (i + 1) * rows / count - i * rows / count))
}
