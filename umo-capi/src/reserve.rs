//! The allocator of the shared and the static library: the system's, with a reserve for pieces that the system refuses.
//!
//! The standard library and other crates end the process where they get no memory for a name or a map. Here such a piece
//! comes out of the reserve, the work goes on to the end of its [`memory::watch`], and the call fails with
//! `UMO_STATUS_OUT_OF_MEMORY`; what it made is dropped, and the reserve is whole again. Pieces that a model file or a
//! configuration makes large are refused, and handled by [`umo_core::memory`].

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::UnsafeCell;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use umo_core::memory;

/// Bytes of a unit, in which the reserve is given out.
const UNIT: usize = 16;
/// Largest alignment of a piece: two cache lines, which are as far apart as threads' own data is kept.
const ALIGNMENT: usize = 128;
/// Units of the reserve: 512 KiB. A figure's largest list takes 1.2 MB.
const UNITS: usize = if cfg!(feature = "gltf") { 3 << 20 } else { 512 << 10 } / UNIT;
/// Part of the free units that one piece may take: large pieces leave room for small ones.
const SHARE: usize = 2;

#[global_allocator]
static ALLOCATOR: Reserving = Reserving::new();

/// The system's allocator and a reserve. All zeros as the library begins, so that the reserve takes pages of memory only
/// once it is used.
struct Reserving {
    room: Room,
    /// Whether each unit is taken.
    taken: [AtomicBool; UNITS],
    /// Number of units that are taken.
    used: AtomicUsize,
    /// Where a free piece is looked for first.
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

    /// A piece of the reserve, or NULL. Waits for no other thread.
    #[cold]
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
        memory::rescued(layout.size());
        self.start().wrapping_add(start * UNIT)
    }

    /// Takes the first free units from `from` on, and says where they start.
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

    /// Marks a unit as taken; whether it was.
    fn mark(&self, unit: usize) -> bool {
        self.taken[unit].swap(true, Ordering::Acquire)
    }

    fn free(&self, piece: Range<usize>) {
        self.taken[piece].iter().for_each(|unit| unit.store(false, Ordering::Release));
    }

    fn start(&self) -> *mut u8 {
        self.room.0.get().cast()
    }

    /// The first unit of a piece of the reserve; none for the system's.
    fn unit(&self, piece: *mut u8) -> Option<usize> {
        let offset = piece.addr().wrapping_sub(self.start().addr());
        (offset < UNITS * UNIT).then_some(offset / UNIT)
    }
}

/// Units that a piece takes.
fn units(layout: Layout) -> usize {
    layout.size().div_ceil(UNIT)
}

// SAFETY: a piece is the system's, or units of the reserve that nobody else has until it is freed. Nothing unwinds.
unsafe impl GlobalAlloc for Reserving {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: by the caller's clause.
        let piece = unsafe { System.alloc(layout) };
        if piece.is_null() { self.take(layout) } else { piece }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: by the caller's clause.
        let piece = unsafe { System.alloc_zeroed(layout) };
        if !piece.is_null() {
            return piece;
        }
        let piece = self.take(layout);
        if !piece.is_null() {
            // SAFETY: the piece has as many bytes.
            unsafe { piece.write_bytes(0, layout.size()) };
        }
        piece
    }

    unsafe fn dealloc(&self, piece: *mut u8, layout: Layout) {
        let Some(first) = self.unit(piece) else {
            // SAFETY: by the caller's clause: it is not of the reserve, so the system gave it.
            return unsafe { System.dealloc(piece, layout) };
        };
        let count = units(layout);
        self.free(first..first + count);
        self.used.fetch_sub(count, Ordering::Relaxed);
    }

    unsafe fn realloc(&self, piece: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        if self.unit(piece).is_none() {
            // SAFETY: by the caller's clause: it is not of the reserve, so the system gave it.
            let moved = unsafe { System.realloc(piece, layout, size) };
            if !moved.is_null() {
                return moved;
            }
        }
        // SAFETY: the caller's clause says that the size is not 0, and no larger than a layout can be.
        let wanted = unsafe { Layout::from_size_align_unchecked(size, layout.align()) };
        // SAFETY: the size is not 0.
        let moved = unsafe { self.alloc(wanted) };
        if !moved.is_null() {
            // SAFETY: both have as many bytes, and they are two pieces.
            unsafe { moved.copy_from_nonoverlapping(piece, size.min(layout.size())) };
            // SAFETY: by the caller's clause.
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
        // SAFETY: three bytes that were taken above.
        unsafe { piece.copy_from_nonoverlapping([1, 2, 3].as_ptr(), 3) };
        // SAFETY: it was taken with this layout.
        let grown = unsafe { RESERVE.realloc(piece, layout(3), 5000) };
        assert!(RESERVE.unit(grown).is_none() && RESERVE.used.load(Ordering::Relaxed) == 0);
        // SAFETY: it has 5,000 bytes, of which the first three were copied.
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
                        // SAFETY: it has as many bytes.
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
