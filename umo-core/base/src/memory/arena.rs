//! Arena that serves all allocations of one object: each from the system, or all from one block whose size the
//! object's constructor adds up in a first run.
//!
//! ```text
//! Arena::plan() ──make──► layout ──► Arena::block(layout) ──make──► pieces
//!                                       ▲                            │ the last of them
//!                              host's or system's memory ◄───────────┘ gives the block back
//! ```
//! The same constructors run twice. Under a plan, every [`Slice`] is empty and every [`Boxed`] and [`Counted`] has no
//! value, so constructors must not read what they have just made. A host learns a session's size before it exists, and
//! gives one piece of that size: only the constructors know their allocations, and sizes written a second time by hand
//! could disagree with them.
#![expect(unsafe_code, reason = "the standard library's boxes cannot take their memory from a block of the host's")]

use std::alloc::{Layout, alloc, dealloc};
use std::cell::Cell;
use std::ffi::c_void;
use std::fmt;
use std::mem::ManuallyDrop;
use std::ops::{Deref, DerefMut};
use std::ptr::NonNull;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::{OutOfMemory, with_capacity};

/// A cache line: blocks are aligned to it, and so are allocations of at least this size.
const LINE: usize = 64;
/// Space for the head of a block, before its allocations.
const HEAD: usize = size_of::<Block>().next_multiple_of(LINE);

/// Layout that no memory and no block has room for.
const TOO_LARGE: Layout = match Layout::from_size_align(isize::MAX as usize, 1) {
    Ok(layout) => layout,
    Err(_) => unreachable!(),
};

/// Message of the panic on reading a value under a plan.
const PLANNED: &str = "a plan has no values";

/// A host's two functions for allocating and releasing a block.
#[derive(Clone, Copy, Debug)]
pub struct HostMemory {
    userdata: *mut c_void,
    allocate: unsafe extern "C" fn(*mut c_void, usize, usize) -> *mut c_void,
    release: unsafe extern "C" fn(*mut c_void, *mut c_void, usize, usize),
}

impl HostMemory {
    /// Both functions get `userdata`; their last arguments are the size in bytes and the alignment, a power of two.
    ///
    /// # Safety
    /// `allocate` returns memory of that size, not used by anyone else until `release` takes it back, or NULL. Both
    /// must be callable as long as any allocation of the block is alive; `release` is called on the thread that drops
    /// the last one.
    pub const unsafe fn new(
        userdata: *mut c_void,
        allocate: unsafe extern "C" fn(*mut c_void, usize, usize) -> *mut c_void,
        release: unsafe extern "C" fn(*mut c_void, *mut c_void, usize, usize),
    ) -> Self {
        Self { userdata, allocate, release }
    }
}

/// Error from allocating a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockError {
    /// The system or the host has no memory.
    OutOfMemory(OutOfMemory),
    /// The host's memory is not aligned as requested.
    Misaligned {
        /// Requested alignment, bytes.
        alignment: usize,
    },
}

impl fmt::Display for BlockError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfMemory(missing) => missing.fmt(f),
            Self::Misaligned { alignment } => {
                write!(f, "the allocator returned memory that is not aligned to the requested {alignment} bytes")
            }
        }
    }
}

impl std::error::Error for BlockError {}

/// Head of a block.
struct Block {
    /// Allocations that are not dropped, plus one for the arena.
    live: AtomicUsize,
    layout: Layout,
    host: Option<HostMemory>,
}

/// Reference that keeps an allocation's block alive; `None` if the memory is the system's.
struct Home(Option<NonNull<Block>>);

// SAFETY: only the count of a block changes while others may read it, and it is atomic.
unsafe impl Send for Home {}
// SAFETY: as above.
unsafe impl Sync for Home {}

impl Home {
    const SYSTEM: Self = Self(None);

    fn is_block(&self) -> bool {
        self.0.is_some()
    }
}

impl Clone for Home {
    fn clone(&self) -> Self {
        if let Some(block) = self.0 {
            // SAFETY: this reference keeps the block alive.
            unsafe { block.as_ref() }.live.fetch_add(1, Ordering::Relaxed);
        }
        Self(self.0)
    }
}

impl Drop for Home {
    fn drop(&mut self) {
        let Some(block) = self.0 else { return };
        // SAFETY: this reference keeps the block alive until the count is decremented.
        if unsafe { block.as_ref() }.live.fetch_sub(1, Ordering::AcqRel) > 1 {
            return;
        }
        // SAFETY: no reference is left, so nobody else reads the head, which is not used again.
        let Block { layout, host, .. } = unsafe { block.read() };
        // SAFETY: `Arena::block_of` got the memory from `host`, or from the system, with this layout.
        unsafe { give_back(host, block.cast(), layout) };
    }
}

/// # Safety
/// `memory` came from `host`, or from the system if that is `None`, with this layout, and is no longer used.
unsafe fn give_back(host: Option<HostMemory>, memory: NonNull<u8>, layout: Layout) {
    match host {
        // SAFETY: the host's own function, with memory from its other function (see # Safety).
        Some(host) => unsafe {
            (host.release)(host.userdata, memory.as_ptr().cast(), layout.size(), layout.align());
        },
        // SAFETY: the system gave it with this layout (see # Safety).
        None => unsafe { dealloc(memory.as_ptr(), layout) },
    }
}

/// Source of memory for constructors.
#[derive(Debug)]
pub struct Arena(Mode);

enum Mode {
    System,
    Plan {
        /// Bytes from the block's start.
        next: Cell<usize>,
    },
    Block {
        home: Home,
        next: Cell<usize>,
        size: usize,
    },
}

impl fmt::Debug for Mode {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::System => f.write_str("System"),
            Self::Plan { next } => write!(f, "Plan({} bytes)", next.get()),
            Self::Block { next, size, .. } => write!(f, "Block({} of {size} bytes)", next.get()),
        }
    }
}

/// Start and end of an allocation of this layout placed after `next` bytes.
fn place(next: usize, layout: Layout) -> (usize, usize) {
    // Kernels load whole registers; a load that crosses a cache line is slower.
    let alignment = if layout.size() < LINE { layout.align() } else { layout.align().max(LINE) };
    let start = next.checked_next_multiple_of(alignment).unwrap_or(usize::MAX);
    (start, start.saturating_add(layout.size()))
}

impl Arena {
    /// Every allocation from the system. Constructors unwind to [`catch`](super::catch) if it has no memory.
    pub const fn system() -> Self {
        Self(Mode::System)
    }

    /// Adds up sizes and allocates nothing.
    pub const fn plan() -> Self {
        Self(Mode::Plan { next: Cell::new(HEAD) })
    }

    /// One block from the system for all allocations. `layout` is the plan's [`Self::layout`].
    ///
    /// # Errors
    /// [`OutOfMemory`].
    pub fn block(layout: Layout) -> Result<Self, OutOfMemory> {
        // The system's memory is always aligned as requested.
        Self::block_of(layout, None).map_err(|_| OutOfMemory { bytes: layout.size() })
    }

    /// One block from the host for all allocations.
    ///
    /// # Errors
    /// [`BlockError`] if the host gives no memory, or misaligned memory.
    pub fn host_block(layout: Layout, host: HostMemory) -> Result<Self, BlockError> {
        Self::block_of(layout, Some(host))
    }

    /// Counts a [`Self::boxed`] value that the plan does not construct.
    ///
    /// # Panics
    /// If this is not a plan.
    pub fn plan_boxed<T>(&self) {
        assert!(matches!(self.0, Mode::Plan { .. }), "only a plan counts what is not made");
        self.take(Layout::new::<Kept<T>>());
    }

    fn block_of(layout: Layout, host: Option<HostMemory>) -> Result<Self, BlockError> {
        // At least the head, on its own line.
        let layout = Layout::from_size_align(layout.size().max(HEAD), layout.align().max(LINE))
            .map_err(|_| BlockError::OutOfMemory(OutOfMemory { bytes: layout.size() }))?;
        let memory = match host {
            // SAFETY: the host's own function, called as `HostMemory::new` describes.
            Some(host) => unsafe { (host.allocate)(host.userdata, layout.size(), layout.align()) }.cast(),
            // SAFETY: a block is never empty.
            None => unsafe { alloc(layout) },
        };
        let Some(memory) = NonNull::new(memory) else {
            return Err(BlockError::OutOfMemory(OutOfMemory { bytes: layout.size() }));
        };
        if !memory.addr().get().is_multiple_of(layout.align()) {
            // SAFETY: it was allocated above and holds nothing.
            unsafe { give_back(host, memory, layout) };
            return Err(BlockError::Misaligned { alignment: layout.align() });
        }
        let block: NonNull<Block> = memory.cast();
        let head = Block { live: AtomicUsize::new(1), layout, host };
        // SAFETY: the memory is aligned, has room for the head, and is nobody else's.
        unsafe { block.write(head) };
        Ok(Self(Mode::Block { home: Home(Some(block)), next: Cell::new(HEAD), size: layout.size() }))
    }

    /// Returns the layout of a block for the planned allocations.
    ///
    /// # Errors
    /// [`OutOfMemory`] if it exceeds the address space.
    ///
    /// # Panics
    /// If this is not a plan.
    pub fn layout(&self) -> Result<Layout, OutOfMemory> {
        let Mode::Plan { next } = &self.0 else { panic!("only a plan has a layout") };
        let size = next.get().checked_next_multiple_of(LINE).unwrap_or(usize::MAX);
        Layout::from_size_align(size, LINE).map_err(|_| OutOfMemory { bytes: size })
    }

    /// Bytes of the block in use, or planned; 0 if allocations come from the system.
    pub fn used(&self) -> usize {
        match &self.0 {
            Mode::System => 0,
            Mode::Plan { next } | Mode::Block { next, .. } => next.get(),
        }
    }

    /// Bytes of the block that are still free: 0 if the plan was exact.
    #[doc(hidden)]
    pub fn unused(&self) -> usize {
        match &self.0 {
            Mode::Block { next, size, .. } => size - next.get().next_multiple_of(LINE),
            Mode::System | Mode::Plan { .. } => 0,
        }
    }

    /// Takes memory of this non-empty layout; `None` under a plan or from the system.
    fn take(&self, layout: Layout) -> Option<(NonNull<u8>, Home)> {
        assert!(layout.align() <= LINE, "a block is aligned to a cache line");
        match &self.0 {
            Mode::System => None,
            Mode::Plan { next } => {
                next.set(place(next.get(), layout).1);
                None
            }
            Mode::Block { home, next, size } => {
                let (start, end) = place(next.get(), layout);
                assert!(end <= *size, "a block has room for what was planned: {end} of {size} bytes");
                next.set(end);
                let Home(Some(block)) = home else { unreachable!("an arena's home is its block") };
                // SAFETY: `start` is at most the block's size; the bytes from there to `end` are given out once.
                Some((unsafe { block.cast::<u8>().add(start) }, home.clone()))
            }
        }
    }

    /// Collects `values`, whose iterator may allocate from this arena too.
    pub fn collect<T>(&self, values: impl IntoIterator<Item = T, IntoIter: ExactSizeIterator>) -> Slice<T> {
        let values = values.into_iter();
        self.collect_len(values.len(), values)
    }

    /// Collects the first `len` of `values`, whose iterator may allocate from this arena too.
    ///
    /// # Panics
    /// If there are fewer.
    pub fn collect_len<T>(&self, len: usize, values: impl IntoIterator<Item = T>) -> Slice<T> {
        let values = values.into_iter().take(len);
        if matches!(self.0, Mode::System) {
            let mut all = with_capacity(len);
            all.extend(values);
            assert!(all.len() == len, "{len} values, got {}", all.len());
            return Slice::from(all.into_boxed_slice());
        }
        let layout = Layout::array::<T>(len).unwrap_or(TOO_LARGE);
        assert!(size_of::<T>() > 0, "a value has bytes");
        if len == 0 {
            return Slice::empty();
        }
        let Some((memory, home)) = self.take(layout) else {
            if std::mem::needs_drop::<T>() {
                // Their own allocations count too.
                values.for_each(drop);
            }
            return Slice::empty();
        };
        // Grows with the values: if one panics, those before it are dropped.
        let mut slice = Slice { start: memory.cast(), len: 0, home };
        for value in values {
            // SAFETY: within the memory taken for `len` values.
            let place = unsafe { slice.start.add(slice.len) };
            // SAFETY: aligned memory that only this slice has.
            unsafe { place.write(value) };
            slice.len += 1;
        }
        assert!(slice.len == len, "{len} values, got {}", slice.len);
        slice
    }

    /// `len` copies of `value`.
    pub fn filled<T: Copy>(&self, value: T, len: usize) -> Slice<T> {
        self.collect(std::iter::repeat_n(value, len))
    }

    /// A copy of `values`.
    pub fn copied<T: Copy>(&self, values: &[T]) -> Slice<T> {
        self.collect(values.iter().copied())
    }

    /// Moves `value` into its own allocation.
    pub fn boxed<T>(&self, value: T) -> Boxed<T> {
        Boxed(self.counted(value))
    }

    /// Moves `value` into its own allocation, for several owners.
    pub fn counted<T>(&self, value: T) -> Counted<T> {
        let keep = |home| Kept { value, owners: AtomicUsize::new(1), home };
        if let Some((memory, home)) = self.take(Layout::new::<Kept<T>>()) {
            let memory = memory.cast();
            // SAFETY: memory of its layout that is nobody else's.
            unsafe { memory.write(keep(home)) };
            return Counted(Some(memory));
        }
        if matches!(self.0, Mode::Plan { .. }) {
            return Counted(None);
        }
        let mut value = with_capacity(1);
        value.push(keep(Home::SYSTEM));
        // A slice of one value has the value's address.
        Counted(Some(NonNull::from(Box::leak(value.into_boxed_slice())).cast()))
    }
}

/// Fixed number of values in memory of an [`Arena`].
pub struct Slice<T> {
    /// `len` values that only this slice has: in a block, or in a leaked box if `home` is `None`.
    start: NonNull<T>,
    len: usize,
    home: Home,
}

// SAFETY: a slice is the only way to its values; its home may be dropped anywhere.
unsafe impl<T: Send> Send for Slice<T> {}
// SAFETY: a shared slice gives out shared references only.
unsafe impl<T: Sync> Sync for Slice<T> {}

impl<T> Slice<T> {
    fn empty() -> Self {
        Self { start: NonNull::dangling(), len: 0, home: Home::SYSTEM }
    }
}

impl<T> From<Box<[T]>> for Slice<T> {
    fn from(values: Box<[T]>) -> Self {
        let values = NonNull::from(Box::leak(values));
        Self { start: values.cast(), len: values.len(), home: Home::SYSTEM }
    }
}

impl<T> Deref for Slice<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: `len` values that only this slice has, as long as it lives.
        unsafe { std::slice::from_raw_parts(self.start.as_ptr(), self.len) }
    }
}

impl<T> DerefMut for Slice<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as in `deref`; `self` is mutably borrowed as long as they are.
        unsafe { std::slice::from_raw_parts_mut(self.start.as_ptr(), self.len) }
    }
}

impl<T> Drop for Slice<T> {
    fn drop(&mut self) {
        let values = NonNull::slice_from_raw_parts(self.start, self.len).as_ptr();
        if self.home.is_block() {
            // SAFETY: they are this slice's, which is not used again. Their memory belongs to the block.
            unsafe { values.drop_in_place() };
        } else {
            // SAFETY: they came from a box, or the slice is empty.
            drop(unsafe { Box::from_raw(values) });
        }
    }
}

impl<T: fmt::Debug> fmt::Debug for Slice<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// A clone is allocated from the system.
impl<T: Clone> Clone for Slice<T> {
    fn clone(&self) -> Self {
        Arena::system().collect(self.iter().cloned())
    }
}

impl<'a, T> IntoIterator for &'a Slice<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<'a, T> IntoIterator for &'a mut Slice<T> {
    type Item = &'a mut T;
    type IntoIter = std::slice::IterMut<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter_mut()
    }
}

/// A value, its number of owners and the owner of its memory.
#[repr(C)]
struct Kept<T> {
    /// First, so that its address is that of the struct.
    value: T,
    owners: AtomicUsize,
    home: Home,
}

/// Shared value in memory of an [`Arena`], dropped with its last owner; `None` under a plan.
pub struct Counted<T>(Option<NonNull<Kept<T>>>);

// SAFETY: owners on several threads read the value, and any of them may drop it.
unsafe impl<T: Send + Sync> Send for Counted<T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for Counted<T> {}

impl<T> Clone for Counted<T> {
    fn clone(&self) -> Self {
        if let Some(kept) = self.0 {
            // SAFETY: this owner keeps it alive.
            unsafe { kept.as_ref() }.owners.fetch_add(1, Ordering::Relaxed);
        }
        Self(self.0)
    }
}

impl<T> Deref for Counted<T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: this owner keeps it alive.
        &unsafe { self.0.expect(PLANNED).as_ref() }.value
    }
}

impl<T> Drop for Counted<T> {
    fn drop(&mut self) {
        let Some(kept) = self.0 else { return };
        // SAFETY: this owner keeps it alive until the count is decremented.
        if unsafe { kept.as_ref() }.owners.fetch_sub(1, Ordering::AcqRel) > 1 {
            return;
        }
        // SAFETY: no owner is left, and `counted` made it.
        let home = unsafe { kept.as_ref() }.home.0;
        if home.is_none() {
            // SAFETY: as above: it was a leaked box of one value.
            return drop(unsafe { Box::from_raw(kept.as_ptr()) });
        }
        // Moved out of the block, which may be freed with it.
        let _home = Home(home);
        // SAFETY: as above; the value is first.
        unsafe { kept.cast::<T>().drop_in_place() };
    }
}

impl<T: fmt::Debug> fmt::Debug for Counted<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

/// Value in memory of an [`Arena`]; empty under a plan.
pub struct Boxed<T>(Counted<T>);

// SAFETY: a box is the only way to its value.
unsafe impl<T: Send> Send for Boxed<T> {}
// SAFETY: a shared box gives out shared references only.
unsafe impl<T: Sync> Sync for Boxed<T> {}

impl<T> Boxed<T> {
    /// Returns the value's address; the caller owns the value and its memory.
    ///
    /// # Panics
    /// Under a plan.
    pub fn into_raw(self) -> NonNull<T> {
        ManuallyDrop::new(self).0.0.expect(PLANNED).cast()
    }

    /// Rebuilds the box that [`into_raw`](Self::into_raw) was called on.
    ///
    /// # Safety
    /// `value` came from `into_raw`, and nobody else uses it or makes a box of it.
    pub unsafe fn from_raw(value: NonNull<T>) -> Self {
        Self(Counted(Some(value.cast())))
    }
}

impl<T> Deref for Boxed<T> {
    type Target = T;

    fn deref(&self) -> &T {
        &self.0
    }
}

impl<T> DerefMut for Boxed<T> {
    fn deref_mut(&mut self) -> &mut T {
        // SAFETY: this box is the value's only owner, and is mutably borrowed as long as the value is.
        &mut unsafe { self.0.0.expect(PLANNED).as_mut() }.value
    }
}

impl<T: fmt::Debug> fmt::Debug for Boxed<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        (**self).fmt(f)
    }
}

#[cfg(test)]
mod tests;
