//! A counting allocator, written out because known crates turn themselves off in release builds.

use std::alloc::{GlobalAlloc, Layout, System};
use std::hint::black_box;
use std::sync::atomic::{AtomicUsize, Ordering};

/// The system's allocator, counted over the whole process.
struct Counting;

static CALLS: AtomicUsize = AtomicUsize::new(0);
static BYTES: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        CALLS.fetch_add(1, Ordering::Relaxed);
        BYTES.fetch_add(layout.size(), Ordering::Relaxed);
        // SAFETY: our caller guarantees that `layout` has a size above zero.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, start: *mut u8, layout: Layout) {
        CALLS.fetch_add(1, Ordering::Relaxed);
        BYTES.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: `start` came from `alloc` above with the same `layout`, as our own caller
        // guarantees.
        unsafe { System.dealloc(start, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Number of allocator calls, by any thread, while `f` runs.
pub(crate) fn allocator_calls(f: impl FnOnce()) -> usize {
    let before = CALLS.load(Ordering::Relaxed);
    f();
    CALLS.load(Ordering::Relaxed) - before
}

/// Bytes currently allocated.
pub(crate) fn allocated() -> usize {
    BYTES.load(Ordering::Relaxed)
}

/// Fails if the counter does not count. Also starts the threads that load models, which allocate
/// when they start.
pub(crate) fn check_counter() {
    rayon::broadcast(|_| ());
    assert!(allocator_calls(|| drop(black_box(vec![0_u8; 64]))) >= 2, "the counter does not count");
    let before = allocated();
    let bytes = black_box(vec![0_u8; 1 << 20]);
    assert!(allocated() >= before + bytes.len(), "the counter of bytes does not count");
}
