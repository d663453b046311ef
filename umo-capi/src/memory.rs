//! One block of memory for each session, from the host where it wants that: what a session allocates while it is made comes
//! out of the block, and the block goes back when the last of it is freed.
//!
//! This is the library's global allocator. Outside of the making of a session it is the system's, to which it adds one
//! comparison; what is freed is found to belong to a block by its address.

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::ffi::c_void;
use std::sync::RwLock;
use std::sync::atomic::{AtomicUsize, Ordering};

use umo_core::memory::in_block;

use crate::status::{Failure, UMO_STATUS_FULL, UMO_STATUS_OUT_OF_MEMORY};

/// Where a session's memory comes from. Both functions are needed. They are called by `umo_session_new`,
/// `umo_session_free` and, where a session was freed while a chunk of it was computed, by the next of these or
/// `umo_engine_free`; never by another thread than the one in that call.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoAllocator {
    /// Given to both.
    pub userdata: *mut c_void,
    /// Gives `size` bytes aligned to `alignment`, a power of two, or NULL.
    pub allocate: Option<unsafe extern "C" fn(userdata: *mut c_void, size: usize, alignment: usize) -> *mut c_void>,
    /// Takes back what `allocate` gave.
    pub release:
        Option<unsafe extern "C" fn(userdata: *mut c_void, memory: *mut c_void, size: usize, alignment: usize)>,
}

/// Most blocks at once.
const MAX_BLOCKS: usize = crate::session::MAX_HANDLES;
/// A cache line: no two blocks share one.
const LEAST_ALIGNMENT: usize = 64;
/// What the block holds besides what was measured: the handle's own box and what errors need.
const SPARE: usize = 4096;

#[global_allocator]
static ALLOCATOR: Routed = Routed;

struct Routed;

/// Where a thread's allocations go.
#[derive(Clone, Copy)]
enum Route {
    System,
    /// To the system, and their sizes to be added up.
    Measured(*mut Bump),
    Block(*mut Block),
}

thread_local! {
    static ROUTE: Cell<Route> = const { Cell::new(Route::System) };
}

/// Memory handed out from the bottom up; the last piece can be taken back.
#[derive(Clone, Copy, Debug)]
struct Bump {
    next: usize,
    most: usize,
    alignment: usize,
    /// Start of the last piece, and where `next` was before it.
    last: usize,
    before: usize,
}

impl Bump {
    /// `start` is a multiple of every alignment that will come.
    const fn new(start: usize) -> Self {
        Self { next: start, most: start, alignment: LEAST_ALIGNMENT, last: usize::MAX, before: start }
    }

    fn take(&mut self, layout: Layout) -> usize {
        let start = self.next.next_multiple_of(layout.align());
        (self.last, self.before) = (start, self.next);
        self.next = start + layout.size();
        self.most = self.most.max(self.next);
        self.alignment = self.alignment.max(layout.align());
        start
    }

    fn give_back(&mut self, start: usize) {
        if start == self.last {
            self.next = self.before;
            self.last = usize::MAX;
        }
    }
}

/// The head of a session's memory.
struct Block {
    bump: Bump,
    end: usize,
    /// Pieces that are not freed, and one while the session is made.
    live: AtomicUsize,
    hooks: Option<UmoAllocator>,
    layout: Layout,
}

/// All blocks by address.
struct Blocks {
    count: usize,
    /// Start and end of each, sorted.
    ranges: [(usize, usize); MAX_BLOCKS],
}

static BLOCKS: RwLock<Blocks> = RwLock::new(Blocks { count: 0, ranges: [(0, 0); MAX_BLOCKS] });
/// As many blocks as there are, so that nothing is looked for where there are none.
static COUNT: AtomicUsize = AtomicUsize::new(0);

impl Blocks {
    /// The first range that does not end before `address`.
    fn place(&self, address: usize) -> usize {
        self.ranges[..self.count].partition_point(|&(_, end)| end <= address)
    }

    fn find(&self, address: usize) -> Option<*mut Block> {
        let &(start, _) = self.ranges[..self.count].get(self.place(address))?;
        (start <= address).then_some(std::ptr::with_exposed_provenance_mut(start))
    }
}

/// The block that `pointer` lies in.
fn block_of(pointer: *mut u8) -> Option<*mut Block> {
    if COUNT.load(Ordering::Acquire) == 0 {
        return None;
    }
    BLOCKS.read().unwrap_or_else(std::sync::PoisonError::into_inner).find(pointer.addr())
}

// SAFETY: memory is the system's, or a piece of a block that is as large and as aligned as was asked for, given out once
// until it is given back.
unsafe impl GlobalAlloc for Routed {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        match ROUTE.get() {
            Route::System => {}
            Route::Measured(bump) => {
                // SAFETY: `measure` keeps it alive and uses it from this thread alone.
                let bump = unsafe { &mut *bump };
                bump.take(layout);
                // SAFETY: by the caller's clause.
                let memory = unsafe { System.alloc(layout) };
                // The piece is known by its true address when it is freed.
                bump.last = memory.addr();
                return memory;
            }
            Route::Block(block) => {
                // SAFETY: `Making` keeps it alive; only the thread that makes the session touches the bump.
                let bump = unsafe { &mut (*block).bump };
                // SAFETY: as above; the end never changes.
                let end = unsafe { (*block).end };
                let before = *bump;
                let start = bump.take(layout);
                if bump.next <= end {
                    // SAFETY: as above.
                    unsafe { &(*block).live }.fetch_add(1, Ordering::Relaxed);
                    return block.cast::<u8>().with_addr(start);
                }
                // More than was measured: rather from the system than not at all.
                *bump = before;
            }
        }
        // SAFETY: by the caller's clause.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        match ROUTE.get() {
            // SAFETY: `measure` keeps it alive and uses it from this thread alone.
            Route::Measured(bump) => unsafe { &mut *bump }.give_back(pointer.addr()),
            // SAFETY: `Making` keeps it alive; only the thread that makes the session touches the bump.
            Route::Block(block) => unsafe { &mut (*block).bump }.give_back(pointer.addr()),
            Route::System => {}
        }
        match block_of(pointer) {
            // SAFETY: the piece was counted when it was given out.
            Some(block) => unsafe { release_one(block) },
            // SAFETY: by the caller's clause; no block has it, so the system gave it.
            None => unsafe { System.dealloc(pointer, layout) },
        }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, new_size: usize) -> *mut u8 {
        if matches!(ROUTE.get(), Route::System) && block_of(pointer).is_none() {
            // SAFETY: by the caller's clause; no block has it, so the system gave it.
            return unsafe { System.realloc(pointer, layout, new_size) };
        }
        // SAFETY: the caller makes sure that the size fits the alignment.
        let new_layout = unsafe { Layout::from_size_align_unchecked(new_size, layout.align()) };
        // SAFETY: by the caller's clause.
        let new = unsafe { self.alloc(new_layout) };
        if !new.is_null() {
            // SAFETY: both have as many bytes, and they are apart.
            unsafe { std::ptr::copy_nonoverlapping(pointer, new, layout.size().min(new_size)) };
            // SAFETY: by the caller's clause.
            unsafe { self.dealloc(pointer, layout) };
        }
        new
    }
}

/// One piece less; the last takes the block with it.
///
/// # Safety
/// `block` is alive and the piece was counted.
unsafe fn release_one(block: *mut Block) {
    // SAFETY: alive by this function's own clause.
    let left = unsafe { &(*block).live }.fetch_sub(1, Ordering::AcqRel) - 1;
    if left > 0 {
        return;
    }
    let mut blocks = BLOCKS.write().unwrap_or_else(std::sync::PoisonError::into_inner);
    let (place, count) = (blocks.place(block.addr()), blocks.count);
    blocks.ranges.copy_within(place + 1..count, place);
    blocks.count -= 1;
    COUNT.store(blocks.count, Ordering::Release);
    drop(blocks);
    // SAFETY: nobody has a piece of it any more, so it is this thread's alone.
    let Block { hooks, layout, .. } = unsafe { block.read() };
    // SAFETY: it is what `Making::new` got, of this layout.
    unsafe { give_back(hooks, block.cast(), layout) };
}

/// # Safety
/// `memory` came from `hooks`, or the system where there are none, with this layout.
unsafe fn give_back(hooks: Option<UmoAllocator>, memory: *mut u8, layout: Layout) {
    match hooks.and_then(|hooks| Some((hooks.release?, hooks.userdata))) {
        // SAFETY: the host's own function, with what the host's other function gave.
        Some((release, userdata)) => unsafe { release(userdata, memory.cast(), layout.size(), layout.align()) },
        // SAFETY: the system gave it, by this function's own clause.
        None => unsafe { System.dealloc(memory, layout) },
    }
}

/// Restores a thread's route, whatever happens.
struct Restore(Route);

impl Drop for Restore {
    fn drop(&mut self) {
        ROUTE.set(self.0);
    }
}

/// What `make` allocates at most at once, as one block: its layout. What it makes is dropped.
pub(crate) fn measure<T>(make: impl FnOnce() -> Result<T, Failure>) -> Result<Layout, Failure> {
    let mut bump = Bump::new(size_of::<Block>());
    let restore = Restore(ROUTE.replace(Route::Measured(&raw mut bump)));
    let made = in_block(make);
    ROUTE.set(Route::System);
    drop(restore);
    drop(made?);
    let too_much = |_| Failure::plain(UMO_STATUS_OUT_OF_MEMORY);
    let size = (bump.most + SPARE).next_multiple_of(bump.alignment);
    Layout::from_size_align(size, bump.alignment).map_err(too_much)
}

/// A block, while what is in it is made.
pub(crate) struct Making(*mut Block);

impl Making {
    /// A block of the host's, or the system's.
    pub(crate) fn new(layout: Layout, hooks: Option<UmoAllocator>) -> Result<Self, Failure> {
        let memory = match &hooks {
            Some(UmoAllocator { allocate: Some(allocate), release: Some(_), userdata }) => {
                // SAFETY: the host's own function, called as its description says.
                unsafe { allocate(*userdata, layout.size(), layout.align()) }.cast()
            }
            Some(_) => return Err(Failure::null("allocator's functions")),
            // SAFETY: a block is never empty.
            None => unsafe { System.alloc(layout) },
        };
        let gone = || Failure::new(UMO_STATUS_OUT_OF_MEMORY, format_args!("no memory for {} bytes", layout.size()));
        if memory.is_null() {
            return Err(gone());
        }
        let block: *mut Block = memory.cast();
        // The table knows it by its address alone.
        let start = block.expose_provenance();
        let failed = |status: Failure| {
            // SAFETY: it was got above, and nothing is in it.
            unsafe { give_back(hooks, memory, layout) };
            Err(status)
        };
        if !start.is_multiple_of(layout.align()) || start.checked_add(layout.size()).is_none() {
            let what = format_args!("the allocator gave memory that is not aligned to {} bytes", layout.align());
            return failed(Failure::argument(what));
        }
        let end = start + layout.size();
        let bump = Bump::new(start + size_of::<Block>());
        let head = Block { bump, end, live: AtomicUsize::new(1), hooks, layout };
        // SAFETY: the block is that large, aligned, and nobody else has it.
        unsafe { block.write(head) };
        let mut blocks = BLOCKS.write().unwrap_or_else(std::sync::PoisonError::into_inner);
        let count = blocks.count;
        if count == MAX_BLOCKS {
            drop(blocks);
            return failed(Failure::plain(UMO_STATUS_FULL));
        }
        let place = blocks.place(start);
        blocks.ranges.copy_within(place..count, place + 1);
        blocks.ranges[place] = (start, end);
        blocks.count += 1;
        COUNT.store(blocks.count, Ordering::Release);
        Ok(Self(block))
    }

    /// Runs `make` with everything that it allocates in the block.
    pub(crate) fn run<T>(&self, make: impl FnOnce() -> T) -> T {
        let _restore = Restore(ROUTE.replace(Route::Block(self.0)));
        in_block(make)
    }
}

impl Drop for Making {
    fn drop(&mut self) {
        // SAFETY: the maker's own count keeps the block alive until here.
        unsafe { release_one(self.0) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashMap;
    use std::ptr::null_mut;
    use std::sync::Mutex;

    /// A host's allocator that counts.
    #[derive(Default)]
    struct Host {
        got: Mutex<HashMap<usize, (usize, usize)>>,
        calls: AtomicUsize,
    }

    impl Host {
        fn hooks(&self) -> UmoAllocator {
            unsafe extern "C" fn allocate(userdata: *mut c_void, size: usize, alignment: usize) -> *mut c_void {
                // SAFETY: `hooks` gave it.
                let host = unsafe { &*userdata.cast::<Host>() };
                host.calls.fetch_add(1, Ordering::Relaxed);
                // SAFETY: a block is never empty.
                let memory = unsafe { System.alloc(Layout::from_size_align(size, alignment).unwrap()) };
                host.got.lock().unwrap().insert(memory.addr(), (size, alignment));
                memory.cast()
            }
            unsafe extern "C" fn release(userdata: *mut c_void, memory: *mut c_void, size: usize, alignment: usize) {
                // SAFETY: `hooks` gave it.
                let host = unsafe { &*userdata.cast::<Host>() };
                assert_eq!(host.got.lock().unwrap().remove(&memory.addr()), Some((size, alignment)));
                // SAFETY: `allocate` got it.
                unsafe { System.dealloc(memory.cast(), Layout::from_size_align(size, alignment).unwrap()) };
            }
            let userdata = (&raw const *self).cast_mut().cast();
            UmoAllocator { userdata, allocate: Some(allocate), release: Some(release) }
        }
    }

    /// Something that grows, shrinks and frees while it is made.
    fn things(seed: usize) -> Vec<Box<[u64]>> {
        let mut things = Vec::new();
        for i in 0..40 {
            let mut growing = Vec::new();
            (0..(seed + i * 7) % 90).for_each(|v| growing.push(v as u64));
            drop(vec![0_u8; i * 3]);
            things.push(growing.into_boxed_slice());
        }
        things
    }

    #[test]
    fn what_is_made_lies_in_one_block_that_goes_back_whole() {
        let host = Host::default();
        for seed in 0..20 {
            let layout = measure(|| Ok(things(seed))).unwrap();
            let making = Making::new(layout, Some(host.hooks())).unwrap();
            let made = making.run(|| things(seed));
            drop(making);
            let (&start, &(size, _)) = host.got.lock().unwrap().iter().next().unwrap();
            for thing in made.iter().filter(|thing| !thing.is_empty()) {
                assert!((start..start + size).contains(&thing.as_ptr().addr()));
            }
            assert_eq!(made, things(seed));
            // Freed on another thread, as an engine may.
            std::thread::spawn(|| drop(made)).join().unwrap();
            assert!(host.got.lock().unwrap().is_empty());
            assert_eq!(host.calls.load(Ordering::Relaxed), seed + 1);
        }
    }

    #[test]
    fn many_blocks_do_not_mix() {
        let made: Vec<_> = (0..100)
            .map(|seed| {
                let making = Making::new(measure(|| Ok(things(seed))).unwrap(), None).unwrap();
                making.run(|| things(seed))
            })
            .collect();
        for (seed, made) in made.into_iter().enumerate().rev() {
            assert_eq!(made, things(seed));
        }
    }

    #[test]
    fn an_allocator_that_gives_nothing_is_an_error() {
        unsafe extern "C" fn nothing(_: *mut c_void, _: usize, _: usize) -> *mut c_void {
            null_mut()
        }
        unsafe extern "C" fn never(_: *mut c_void, _: *mut c_void, _: usize, _: usize) {
            unreachable!("nothing was given");
        }
        let layout = Layout::from_size_align(4096, 64).unwrap();
        let hooks = UmoAllocator { userdata: null_mut(), allocate: Some(nothing), release: Some(never) };
        assert_eq!(Making::new(layout, Some(hooks)).err().unwrap().status, UMO_STATUS_OUT_OF_MEMORY);
        let half = UmoAllocator { release: None, ..hooks };
        assert!(Making::new(layout, Some(half)).is_err());
    }
}
