//! Chunks of weights that stay in L2 while tiles of rows pass; meanwhile, the next chunk is
//! prefetched.

use super::input::GemmTask;
use crate::pack::{PANEL, QUAD};
use crate::prefetch;
use core::ops::Range;

/// Most rows of a memory-bound tile: for these, clearing a large buffer is measurable, and
/// prefetching further weights does not pay.
#[cfg(target_arch = "x86_64")]
pub(super) const FEW_ROWS: usize = 4;
/// Bytes of weights per chunk, which shares a small L2 with the next chunk.
pub(super) const CHUNK_BYTES: usize = 256 << 10;
/// Prefetch distances in quads: 8 steps of 13 cycles hide the latency of L2; the longer
/// distance is for one tile of several rows, whose weights are read once, from memory.
pub(super) const PREFETCH_DISTANCE: [usize; 2] = [8, 32];

/// Some of a task's panels, multiplied in groups.
pub(super) struct Chunk<'a> {
    pub(super) task: &'a GemmTask<'a>,
    /// Slots whose weights are in L2 while tiles of rows pass.
    pub(super) slots: Range<usize>,
    /// Prefetch distance of the chunk's own weights, in quads.
    pub(super) ahead: usize,
    /// Slots of the next chunk that are not yet prefetched.
    next: Range<usize>,
    /// Panels of the next chunk that each group prefetches.
    each: usize,
}

impl<'a> Chunk<'a> {
    /// The part of `slots` that exists, for `rows` rows in `tiles`, each of which
    /// processes `group` panels at a time.
    pub(super) fn new(task: &'a GemmTask, slots: Range<usize>, rows: usize, (tiles, group): (usize, usize)) -> Self {
        let slots = slots.start..slots.end.min(task.slots());
        let next = slots.end..(slots.end + slots.len()).min(task.slots());
        let groups = tiles * slots.len().div_ceil(group);
        let (each, ahead) =
            (next.len().div_ceil(groups.max(1)).min(2), PREFETCH_DISTANCE[usize::from(tiles == 1 && rows > 1)]);
        Self { task, slots, ahead, next, each }
    }

    /// Panels of the next chunk to be prefetched now, padded with `panel`, which is
    /// in cache.
    #[inline]
    pub(super) fn fetch(&mut self, panel: &[[i8; PANEL * QUAD]]) -> [*const [i8; PANEL * QUAD]; 2] {
        let mut some = [panel.as_ptr(); 2];
        for pointer in &mut some[..self.each] {
            if let Some(slot) = self.next.next() {
                *pointer = self.task.panel(slot).as_ptr();
            }
        }
        some
    }
}

/// Prefetches the scales and sums that the epilogue of a slot's panel reads.
#[inline]
pub(super) fn prefetch_scales(task: &GemmTask, slot: usize) {
    let (w, p) = task.slot(slot);
    prefetch::to_l1(w.scale().as_ptr().wrapping_add(p * PANEL));
    prefetch::to_l1(w.sum().as_ptr().wrapping_add(p * PANEL));
}
