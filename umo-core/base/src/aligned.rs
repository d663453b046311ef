//! Memory for weights, caches and scratch: zeroed, aligned to cache lines, in huge pages if large enough. With the
//! memory map and the arena, one of the places outside the kernels that contain `unsafe`.
#![expect(unsafe_code, reason = "the standard library's boxes take no alignment, and pages need advice before use")]

use std::alloc::{Layout, alloc_zeroed, dealloc};
use std::fmt;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::sync::{Arc, Mutex, PoisonError};

#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
use memmap2::{MmapMut, MmapOptions};
use umo_kernels::Bf16;

use crate::memory::{refuse, spare};

/// A cache line, and the width of the widest vector register.
const LINE: usize = 64;
/// Larger page size of x86-64 and most ARM systems: a thousandth of the address translations.
#[cfg(all(feature = "mmap", not(target_family = "wasm")))]
const HUGE_PAGE: usize = 2 << 20;
/// Sizes of the first and the largest region of a pool; each is four times the one before.
const FIRST_REGION: usize = 64 << 10;
const LARGEST_REGION: usize = 64 << 20;

/// Number types that boxes may hold.
///
/// # Safety
/// All-zero bytes must be a value of the type, and its alignment at most 64.
pub unsafe trait Plain: Copy + Send + Sync + 'static {}

// SAFETY: zero bytes are the number 0; aligned to 1.
unsafe impl Plain for i8 {}
// SAFETY: as above.
unsafe impl Plain for u8 {}
// SAFETY: zero bytes are the number 0; aligned to 4.
unsafe impl Plain for f32 {}
// SAFETY: zero bits are the number 0; aligned to 2.
unsafe impl Plain for Bf16 {}

/// A boxed slice of numbers, aligned to 64 bytes.
pub struct AlignedBox<T: Plain> {
    /// `len` numbers inside `region`; no other box has them.
    data: NonNull<T>,
    len: usize,
    /// Keeps the memory alive.
    _region: Arc<Region>,
}

// SAFETY: a box is the only way to its numbers, which are `Send`; the region is only kept alive.
unsafe impl<T: Plain> Send for AlignedBox<T> {}
// SAFETY: a shared box gives out shared references only, to numbers that are `Sync`.
unsafe impl<T: Plain> Sync for AlignedBox<T> {}

impl<T: Plain> AlignedBox<T> {
    /// Allocates `len` zeros.
    pub fn zeroed(len: usize) -> Self {
        let region = Arc::new(Region::new(len * size_of::<T>()));
        Self { data: region.start.cast(), len, _region: region }
    }
}

impl<T: Plain> Deref for AlignedBox<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: `data` is the aligned start of `len` numbers, zeroed when the region was made. Only this box refers
        // to them, and they live as long as the region, which this box keeps alive.
        unsafe { std::slice::from_raw_parts(self.data.as_ptr(), self.len) }
    }
}

impl<T: Plain> DerefMut for AlignedBox<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in `deref`; `self` is mutably borrowed as long as the slice is.
        unsafe { std::slice::from_raw_parts_mut(self.data.as_ptr(), self.len) }
    }
}

impl<T: Plain> fmt::Debug for AlignedBox<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "AlignedBox({} x {} bytes)", self.len, size_of::<T>())
    }
}

/// Packs boxes into large regions, so that weights much smaller than a huge page share one.
#[derive(Debug, Default)]
pub struct Pool(Mutex<Option<Open>>);

/// The region that is being filled.
#[derive(Debug)]
struct Open {
    region: Arc<Region>,
    used: usize,
}

impl Pool {
    /// Allocates `len` zeros.
    pub fn zeroed<T: Plain>(&self, len: usize) -> AlignedBox<T> {
        let bytes = (len * size_of::<T>()).next_multiple_of(LINE);
        let mut open = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let open = match &mut *open {
            Some(open) if open.region.len - open.used >= bytes => open,
            full => {
                let next = full.as_ref().map_or(FIRST_REGION, |full| (4 * full.region.len).min(LARGEST_REGION));
                full.insert(Open { region: Arc::new(Region::new(next.max(bytes))), used: 0 })
            }
        };
        let first = open.used;
        open.used += bytes;
        // SAFETY: `first + bytes` is at most the region's length.
        let data = unsafe { open.region.start.add(first) };
        // No other box is given the bytes `first..first + bytes`; `first` is a multiple of `LINE`.
        AlignedBox { data: data.cast(), len, _region: Arc::clone(&open.region) }
    }
}

/// Zeroed memory.
#[derive(Debug)]
struct Region {
    /// Aligned to `LINE`, or to `HUGE_PAGE` if mapped.
    start: NonNull<u8>,
    len: usize,
    memory: Memory,
}

#[derive(Debug)]
enum Memory {
    /// Pages of the system, zeroed on first touch; unmapped when dropped.
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    Mapped { _map: MmapMut },
    /// From the allocator.
    Heap(Layout),
}

// SAFETY: a region is only memory; the boxes determine who may read and write which part of it.
unsafe impl Send for Region {}
// SAFETY: as above; the region itself never reads or writes its memory.
unsafe impl Sync for Region {}

impl Region {
    /// Unwinds to [`memory::catch`](crate::memory::catch) if out of memory, or if too little is left for small
    /// allocations.
    fn new(len: usize) -> Self {
        let region = Self::huge(len).unwrap_or_else(|| Self::allocated(len));
        // Also checked after mapping pages: a limit of the address space counts them, touched or not.
        if spare().is_err() {
            drop(region);
            refuse(len);
        }
        region
    }

    fn allocated(len: usize) -> Self {
        let layout = Layout::from_size_align(len.max(1), LINE).expect("less than half of the address space");
        // SAFETY: the layout has at least one byte.
        let start = NonNull::new(unsafe { alloc_zeroed(layout) }).unwrap_or_else(|| refuse(layout.size()));
        Self { start, len, memory: Memory::Heap(layout) }
    }

    #[cfg(not(all(feature = "mmap", not(target_family = "wasm"))))]
    fn huge(_: usize) -> Option<Self> {
        None
    }

    /// Pages of the system, huge if available, for regions that fill one; untouched pages take no memory.
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    fn huge(len: usize) -> Option<Self> {
        if len < HUGE_PAGE {
            return None;
        }
        let mut map = MmapOptions::new().len(len + HUGE_PAGE).map_anon().ok()?;
        let skipped = map.as_ptr().align_offset(HUGE_PAGE);
        // Only a hint: a system without huge pages gives small ones.
        #[cfg(target_os = "linux")]
        drop(map.advise_range(memmap2::Advice::HugePage, skipped, len));
        let start = NonNull::from(map.get_mut(skipped..)?).cast();
        Some(Self { start, len, memory: Memory::Mapped { _map: map } })
    }
}

impl Drop for Region {
    fn drop(&mut self) {
        #[cfg_attr(
            not(all(feature = "mmap", not(target_family = "wasm"))),
            expect(irrefutable_let_patterns, reason = "all memory is the allocator's")
        )]
        if let Memory::Heap(layout) = self.memory {
            // SAFETY: `start` came from the allocator with this layout; its boxes are gone, since each keeps the
            // region alive.
            unsafe { dealloc(self.start.as_ptr(), layout) }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn boxes_are_zeroed_aligned_and_apart() {
        let pool = Pool::default();
        let lens = [0, 1, 63, 64, 65, 100_000, 3 << 20, 5, 70 << 20, 1 << 20];
        let mut boxes: Vec<AlignedBox<i8>> = lens.into_iter().map(|len| pool.zeroed(len)).collect();
        boxes.extend(lens.map(AlignedBox::zeroed));
        for (i, slice) in boxes.iter_mut().enumerate() {
            assert_eq!(slice.len(), lens[i % lens.len()]);
            assert!(slice.as_ptr().addr().is_multiple_of(LINE));
            assert!(slice.iter().all(|&v| v == 0), "box {i} has another's bytes");
            slice.fill(i8::MAX);
        }
    }

    #[test]
    fn memory_outlives_its_pool() {
        let pool = Pool::default();
        let mut kept: AlignedBox<f32> = pool.zeroed(1 << 20);
        drop((pool.zeroed::<Bf16>(9), pool));
        kept.fill(2.5);
        assert_eq!(std::thread::spawn(move || kept.iter().sum::<f32>()).join().ok(), Some(2_621_440.0));
    }
}
