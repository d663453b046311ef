//! Weights in work, which stay in L2 while tiles of rows go by, and the next, which come meanwhile.

use super::input::GemmTask;
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use core::ops::Range;

/// Rows of a tile that is bound by memory, where clearing a large buffer would show, and fetching further weights does not pay.
pub(super) const FEW_ROWS: usize = 4;
/// Bytes of weights in work at once, beside the next: half of a small L2.
pub(super) const CHUNK_BYTES: usize = 256 << 10;
/// Quads between a multiplication and the prefetch of its weights: from L2, where 8 steps of 13 cycles are longer than it takes, and
/// where several rows meet each weight but once, and it comes from further away.
pub(super) const PREFETCH_DISTANCE: [usize; 2] = [8, 32];

/// Some of a task's panels, for a group of them at a time to be multiplied.
pub(super) struct Chunk<'a> {
    pub(super) task: &'a GemmTask<'a>,
    /// In L2 while tiles of rows go by.
    pub(super) slots: Range<usize>,
    /// Quads between a multiplication and its own weights' prefetch.
    pub(super) ahead: usize,
    /// Not yet fetched, of the chunk after this.
    next: Range<usize>,
    /// How many of those a group fetches.
    each: usize,
}

impl<'a> Chunk<'a> {
    /// These slots, as far as there are any, for so many rows in `tiles`, each of which meets `group` panels at a time.
    pub(super) fn new(task: &'a GemmTask, slots: Range<usize>, rows: usize, (tiles, group): (usize, usize)) -> Self {
        let slots = slots.start..slots.end.min(task.slots());
        let next = slots.end..(slots.end + slots.len()).min(task.slots());
        let groups = tiles * slots.len().div_ceil(group);
        let (each, ahead) =
            (next.len().div_ceil(groups.max(1)).min(2), PREFETCH_DISTANCE[usize::from(tiles == 1 && rows > 1)]);
        Self { task, slots, ahead, next, each }
    }

    /// Panels of the next chunk to be fetched now; where there are none, `panel`, which is here.
    #[inline]
    pub(super) fn fetch(&mut self, panel: &[[i8; PANEL * QUAD]]) -> [*const [i8; PANEL * QUAD]; 2] {
        let mut some = [panel.as_ptr(); 2];
        for sum_index in &mut some[..self.each] {
            if let Some(slot) = self.next.next() {
                *sum_index = self.task.panel(slot).as_ptr();
            }
        }
        some
    }
}

/// Fetches what ends the sums of a slot's panel, while it is multiplied.
#[inline]
pub(super) fn prefetch_scales(task: &GemmTask, slot: usize) {
    let (w, p) = task.slot(slot);
    prefetch::to_l1(w.scale().as_ptr().wrapping_add(p * PANEL));
    prefetch::to_l1(w.sum().as_ptr().wrapping_add(p * PANEL));
}
