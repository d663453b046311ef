//! A block is filled exactly as planned and released with its last allocation.

use super::*;
use std::collections::HashMap;
use std::ptr::null_mut;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use proptest::prelude::*;

/// A host's allocator that records its allocations.
#[derive(Default)]
struct Host {
    given: Mutex<HashMap<usize, Layout>>,
    calls: AtomicUsize,
    /// Whether to return NULL; offset by which to misalign memory.
    is_empty: AtomicBool,
    off: AtomicUsize,
}

unsafe extern "C" fn allocate(userdata: *mut c_void, size: usize, alignment: usize) -> *mut c_void {
    // SAFETY: `Host::memory` passed it.
    let host = unsafe { &*userdata.cast::<Host>() };
    host.calls.fetch_add(1, Ordering::Relaxed);
    if host.is_empty.load(Ordering::Relaxed) {
        return null_mut();
    }
    let off = host.off.load(Ordering::Relaxed);
    let layout = Layout::from_size_align(size + off, alignment).unwrap();
    // SAFETY: a block is never empty.
    let memory = unsafe { alloc(layout) };
    // SAFETY: `off` more bytes were allocated.
    let memory = unsafe { memory.add(off) };
    host.given.lock().unwrap().insert(memory.addr(), Layout::from_size_align(size, alignment).unwrap());
    memory.cast()
}

unsafe extern "C" fn release(userdata: *mut c_void, memory: *mut c_void, size: usize, alignment: usize) {
    // SAFETY: `Host::memory` passed it.
    let host = unsafe { &*userdata.cast::<Host>() };
    let off = host.off.load(Ordering::Relaxed);
    let layout = Layout::from_size_align(size, alignment).unwrap();
    assert_eq!(host.given.lock().unwrap().remove(&memory.addr()), Some(layout));
    let layout = Layout::from_size_align(size + off, alignment).unwrap();
    // SAFETY: `allocate` added `off`.
    let memory = unsafe { memory.cast::<u8>().sub(off) };
    // SAFETY: `allocate` got it with this layout.
    unsafe { dealloc(memory, layout) };
}

impl Host {
    fn memory(&self) -> HostMemory {
        // SAFETY: the functions above, with the `userdata` that they expect; tests keep it alive as long as blocks.
        unsafe { HostMemory::new((&raw const *self).cast_mut().cast(), allocate, release) }
    }

    fn blocks(&self) -> usize {
        self.given.lock().unwrap().len()
    }

    /// Whether all of `value` lies in the only block.
    fn has<T: ?Sized>(&self, value: &T) -> bool {
        let given = self.given.lock().unwrap();
        let (&start, layout) = given.iter().next().unwrap();
        let at = (&raw const *value).addr();
        (start..=start + layout.size()).contains(&at) && at + size_of_val(value) <= start + layout.size()
    }
}

/// Values of every kind, some nested.
struct Things {
    rows: Slice<Slice<u16>>,
    floats: Slice<f32>,
    bytes: Slice<u8>,
    boxed: Boxed<(u8, Slice<u64>)>,
    shared: Counted<Slice<u32>>,
    other: Counted<Slice<u32>>,
}

impl Things {
    fn new(sizes: &[usize], arena: &Arena) -> Self {
        let rows = arena.collect(sizes.iter().map(|&len| arena.filled(7, len)));
        let shared = arena.counted(arena.collect_len(sizes.len(), 0..));
        Self {
            rows,
            floats: arena.filled(1.5, sizes[0]),
            bytes: arena.copied(b"abc"),
            boxed: arena.boxed((3, arena.collect((0..sizes[0]).map(|v| v as u64)))),
            other: Counted::clone(&shared),
            shared,
        }
    }

    fn check(&self, sizes: &[usize]) {
        assert!(self.rows.iter().map(|row| row.len()).eq(sizes.iter().copied()));
        assert!(self.rows.iter().flatten().all(|&v| v == 7));
        assert!(self.floats.len() == sizes[0] && self.floats.iter().all(|&v| v == 1.5));
        let (number, numbers) = &*self.boxed;
        assert_eq!((&*self.bytes, *number), (&b"abc"[..], 3));
        assert!(numbers.iter().copied().eq(0..sizes[0] as u64));
        assert!(self.shared.iter().zip(0..).all(|(&a, b)| a == b) && self.other.len() == sizes.len());
    }
}

proptest! {
    #[test]
    fn a_plan_is_exact_and_pieces_lie_in_the_block(sizes in prop::collection::vec(0_usize..300, 1..12)) {
        let (host, plan) = (Host::default(), Arena::plan());
        Things::new(&sizes, &plan);
        let block = Arena::host_block(plan.layout().unwrap(), host.memory()).unwrap();
        let things = Things::new(&sizes, &block);
        prop_assert_eq!(block.unused(), 0);
        things.check(&sizes);
        prop_assert!((sizes[0] == 0 || host.has(&*things.floats)) && host.has(&*things.boxed) && host.has(&*things.shared));
        prop_assert!(things.rows.iter().all(|row| row.is_empty() || host.has(&**row)));
        drop(block);
        let kept = Counted::clone(&things.shared);
        // Freed on another thread, as an engine may.
        std::thread::spawn(move || drop(things)).join().unwrap();
        prop_assert_eq!(host.blocks(), 1);
        prop_assert_eq!(kept.len(), sizes.len());
        drop(kept);
        prop_assert_eq!((host.blocks(), host.calls.load(Ordering::Relaxed)), (0, 1));
    }
}

#[test]
fn the_system_gives_each_piece() {
    let things = Things::new(&[5, 0, 70], &Arena::system());
    things.check(&[5, 0, 70]);
    let clone = things.rows.clone();
    drop(things);
    assert_eq!(clone[2].len(), 70);
}

#[test]
fn what_a_box_is_made_of_is_it_again() {
    let layout = {
        let plan = Arena::plan();
        plan.plan_boxed::<String>();
        plan.layout().unwrap()
    };
    for arena in [Arena::system(), Arena::block(layout).unwrap()] {
        let mut boxed = arena.boxed("a".to_owned());
        boxed.push('b');
        drop(arena);
        let raw = boxed.into_raw();
        // SAFETY: it was just made of a box.
        assert_eq!(*unsafe { Boxed::from_raw(raw) }, "ab");
    }
}

#[test]
fn bad_memory_is_an_error() {
    let host = Host::default();
    let layout = Layout::from_size_align(4096, 64).unwrap();
    host.off.store(8, Ordering::Relaxed);
    let misaligned = Arena::host_block(layout, host.memory()).unwrap_err();
    assert_eq!(misaligned, BlockError::Misaligned { alignment: 64 });
    assert_eq!(host.blocks(), 0, "it was given back");
    host.is_empty.store(true, Ordering::Relaxed);
    let missing = Arena::host_block(layout, host.memory()).unwrap_err();
    assert_eq!(missing, BlockError::OutOfMemory(OutOfMemory { bytes: 4096 }));
    assert!(misaligned.to_string().contains("64 bytes") && missing.to_string().contains("4096 bytes"));
    for len in [isize::MAX as usize / 8, usize::MAX] {
        let large = Arena::plan();
        drop(large.filled(0_u64, len));
        assert!(large.layout().is_err(), "{len}");
    }
}

#[test]
fn a_constructor_that_panics_gives_everything_back() {
    let (host, sizes) = (Host::default(), [3, 4]);
    let plan = Arena::plan();
    Things::new(&sizes, &plan);
    let block = Arena::host_block(plan.layout().unwrap(), host.memory()).unwrap();
    let half = std::panic::AssertUnwindSafe(|| {
        let rows = block.filled(1_u8, 3);
        drop(block.collect((0..4).map(|i| if i < 2 { block.copied(&rows) } else { panic!("in the middle") })));
    });
    assert!(std::panic::catch_unwind(half).is_err());
    drop(block);
    assert_eq!(host.blocks(), 0);
}

#[test]
#[should_panic(expected = "a block has room for what was planned")]
fn more_than_was_planned_is_a_defect() {
    let plan = Arena::plan();
    drop(plan.filled(0_u8, 64));
    let block = Arena::block(plan.layout().unwrap()).unwrap();
    drop(block.filled(0_u8, 65));
}
