//! Allocator of the shared and the static library: the system's, with a reserve for pieces that the system refuses.
//!
//! The standard library and other crates abort the process if they get no memory for a name or a map. Here such a piece
//! comes from the reserve, the work continues to the end of its [`memory::watch`], and the call fails with
//! `UMO_STATUS_OUT_OF_MEMORY`. The result is dropped, and the reserve is whole again. Pieces that are large because of
//! a model file or a configuration are refused, and handled by [`umo_core_base::memory`].

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::UnsafeCell;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use umo_core_base::memory;

/// Size of a unit of the reserve, in bytes.
const UNIT: usize = 16;
/// Largest alignment of a piece: two cache lines, the distance that keeps threads' data apart.
const ALIGNMENT: usize = 128;
/// Number of units in the reserve: 512 KiB, or 3 MiB with glTF, as a figure's largest list takes 1.2 MB.
const UNITS: usize = if cfg!(feature = "gltf") { 3 << 20 } else { 512 << 10 } / UNIT;
/// Divisor of the free units for the largest piece: large pieces leave room for small ones.
const SHARE: usize = 2;

#[global_allocator]
static ALLOCATOR: Reserving = Reserving::new();

/// The system's allocator and a reserve. Initially all zeros, so that the reserve takes no pages of memory before it is
/// used.
struct Reserving {
    room: Room,
    /// Whether each unit is taken.
    taken: [AtomicBool; UNITS],
    /// Number of taken units.
    used: AtomicUsize,
    /// Unit at which the search for a free piece starts.
    next: AtomicUsize,
}

#[repr(C, align(128))]
struct Room(UnsafeCell<[u8; UNITS * UNIT]>);

// SAFETY: each byte belongs to the thread that took its unit.
unsafe impl Sync for Room {}

impl Reserving {
    const fn new() -> Self {
        let room = Room(UnsafeCell::new([0; UNITS * UNIT]));
        let (used, next) = (AtomicUsize::new(0), AtomicUsize::new(0));
        Self { room, taken: [const { AtomicBool::new(false) }; UNITS], used, next }
    }

    /// Takes a piece of the reserve; NULL if there is none. Never waits for another thread.
    fn take(&self, layout: Layout) -> *mut u8 {
        let wanted = units(layout);
        let free = UNITS.saturating_sub(self.used.load(Ordering::Relaxed));
        if wanted > free / SHARE || layout.align() > ALIGNMENT {
            return std::ptr::null_mut();
        }
        let next = self.next.load(Ordering::Relaxed);
        let Some(start) = self.claim(next, wanted, layout.align()).or_else(|| self.claim(0, wanted, layout.align()))
        else {
            return std::ptr::null_mut();
        };
        self.used.fetch_add(wanted, Ordering::Relaxed);
        self.next.store(start + wanted, Ordering::Relaxed);
        self.start().wrapping_add(start * UNIT)
    }

    /// Takes a piece of the reserve and reports it; NULL if there is none.
    #[cold]
    fn rescue(&self, layout: Layout) -> *mut u8 {
        let piece = self.take(layout);
        if !piece.is_null() {
            memory::rescued(layout.size());
        }
        piece
    }

    /// Takes the first `wanted` free units from `from` on; returns the index of the first one.
    fn claim(&self, from: usize, wanted: usize, alignment: usize) -> Option<usize> {
        let step = alignment.div_ceil(UNIT);
        let mut start = from.next_multiple_of(step);
        while start + wanted <= UNITS {
            let other = (start..start + wanted).find(|&unit| self.is_taken(unit) || self.mark(unit));
            let Some(other) = other else { return Some(start) };
            self.free(start..other);
            start = (other + 1).next_multiple_of(step);
        }
        None
    }

    fn is_taken(&self, unit: usize) -> bool {
        self.taken[unit].load(Ordering::Relaxed)
    }

    /// Marks a unit as taken; returns whether it already was.
    fn mark(&self, unit: usize) -> bool {
        self.taken[unit].swap(true, Ordering::Acquire)
    }

    fn free(&self, piece: Range<usize>) {
        self.taken[piece].iter().for_each(|unit| unit.store(false, Ordering::Release));
    }

    fn start(&self) -> *mut u8 {
        self.room.0.get().cast()
    }

    /// Returns the first unit of a piece of the reserve, `None` for a piece of the system's.
    fn unit(&self, piece: *mut u8) -> Option<usize> {
        let offset = piece.addr().wrapping_sub(self.start().addr());
        (offset < UNITS * UNIT).then_some(offset / UNIT)
    }
}

/// Number of units for a piece.
fn units(layout: Layout) -> usize {
    layout.size().div_ceil(UNIT)
}

// SAFETY: a piece is the system's, or units of the reserve that nobody else has until it is freed. Nothing unwinds.
unsafe impl GlobalAlloc for Reserving {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: guaranteed by the caller.
        let piece = unsafe { System.alloc(layout) };
        if piece.is_null() { self.rescue(layout) } else { piece }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: guaranteed by the caller.
        let piece = unsafe { System.alloc_zeroed(layout) };
        if !piece.is_null() {
            return piece;
        }
        let piece = self.rescue(layout);
        if !piece.is_null() {
            // SAFETY: the piece has at least `layout.size()` bytes.
            unsafe { piece.write_bytes(0, layout.size()) };
        }
        piece
    }

    unsafe fn dealloc(&self, piece: *mut u8, layout: Layout) {
        let Some(first) = self.unit(piece) else {
            // SAFETY: guaranteed by the caller; the piece is not in the reserve, so it is the system's.
            return unsafe { System.dealloc(piece, layout) };
        };
        let count = units(layout);
        self.free(first..first + count);
        self.used.fetch_sub(count, Ordering::Relaxed);
    }

    unsafe fn realloc(&self, piece: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if self.unit(piece).is_none() {
            // SAFETY: guaranteed by the caller; the piece is not in the reserve, so it is the system's.
            let moved = unsafe { System.realloc(piece, layout, size) };
            if !moved.is_null() {
                return moved;
            }
        }
        // SAFETY: the caller guarantees that the size is not 0, and not larger than a layout allows.
        let wanted = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        // SAFETY: the size is not 0.
        let moved = unsafe { self.alloc(wanted) };
        if !moved.is_null() {
            // SAFETY: both have at least that many bytes, and they are distinct pieces.
            unsafe { moved.copy_from_nonoverlapping(piece, size.min(layout.size())) };
            // SAFETY: guaranteed by the caller.
            unsafe { self.dealloc(piece, layout) };
        }
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout(size: usize) -> Layout {
        Layout::from_size_align(size, 8).unwrap()
    }

    #[test]
    fn pieces_are_apart_and_come_back() {
        static RESERVE: Reserving = Reserving::new();
        let sizes = [1, 64, 65, 1000, 4096, 100_000];
        let pieces = sizes.map(|size| RESERVE.take(layout(size)));
        for (i, piece) in pieces.iter().enumerate() {
            assert!(!piece.is_null() && piece.addr().is_multiple_of(UNIT));
            let next = pieces.get(i + 1).map_or(usize::MAX, |next| next.addr());
            assert!(piece.addr() + sizes[i] <= next);
        }
        for (piece, size) in pieces.into_iter().zip(sizes) {
            // SAFETY: it was taken with this layout.
            unsafe { RESERVE.dealloc(piece, layout(size)) };
        }
        assert_eq!(RESERVE.used.load(Ordering::Relaxed), 0);
        assert!((0..UNITS).all(|unit| !RESERVE.is_taken(unit)));
    }

    #[test]
    fn large_pieces_leave_room_for_small_ones() {
        static RESERVE: Reserving = Reserving::new();
        assert!(RESERVE.take(layout(UNITS * UNIT / SHARE + 1)).is_null());
        assert!(RESERVE.take(Layout::from_size_align(64, 256).unwrap()).is_null());
        for align in [128, 1, 128] {
            let piece = RESERVE.take(Layout::from_size_align(8, align).unwrap());
            assert!(!piece.is_null() && piece.addr().is_multiple_of(align));
        }
        let large = (0..100).take_while(|_| !RESERVE.take(layout(32 << 10)).is_null()).count();
        let small = (0..1000).take_while(|_| !RESERVE.take(layout(200)).is_null()).count();
        assert!(large > 10 && small > 100, "{large}, {small}");
    }

    #[test]
    fn a_piece_grows_out_of_the_reserve() {
        static RESERVE: Reserving = Reserving::new();
        let piece = RESERVE.take(layout(3));
        // SAFETY: the three bytes were taken above.
        unsafe { piece.copy_from_nonoverlapping([1, 2, 3].as_ptr(), 3) };
        // SAFETY: it was taken with this layout.
        let grown = unsafe { RESERVE.realloc(piece, layout(3), 5000) };
        assert!(RESERVE.unit(grown).is_none() && RESERVE.used.load(Ordering::Relaxed) == 0);
        // SAFETY: it has 5,000 bytes, and the first three were copied.
        assert_eq!(unsafe { std::slice::from_raw_parts(grown, 3) }, [1, 2, 3]);
        // SAFETY: it has this layout now.
        unsafe { RESERVE.dealloc(grown, layout(5000)) };
    }

    #[test]
    fn threads_get_pieces_of_their_own() {
        static RESERVE: Reserving = Reserving::new();
        std::thread::scope(|scope| {
            for byte in 0..4_u8 {
                scope.spawn(move || {
                    for size in (1..2000).rev() {
                        let piece = RESERVE.take(layout(size));
                        assert!(!piece.is_null());
                        // SAFETY: it has `size` bytes.
                        unsafe { piece.write_bytes(byte, size) };
                        // SAFETY: they were written above.
                        let bytes = unsafe { std::slice::from_raw_parts(piece, size) };
                        assert!(bytes.iter().all(|&seen| seen == byte));
                        // SAFETY: it was taken with this layout.
                        unsafe { RESERVE.dealloc(piece, layout(size)) };
                    }
                });
            }
        });
        assert_eq!(RESERVE.used.load(Ordering::Relaxed), 0);
    }
}
