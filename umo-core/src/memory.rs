//! Memory that may not be there: what a model file or a configuration can make large is allocated
//! fallibly.
//!
//! The standard library aborts the process where it gets no memory. So what grows with the sizes in
//! a file or a configuration is allocated here: [`filled`] and [`with_capacity`] unwind to the
//! [`catch`] around the call instead, which frees what was made so far and gives [`OutOfMemory`].
//! They also leave [`SPARE`] bytes free, enough for the small pieces that the standard library and
//! other crates allocate in between. Outside of [`catch`] they end the process, as the standard
//! library does.
//!
//! What a session has comes out of one block, an [`Arena`]'s.

mod arena;

use std::alloc::{Layout, handle_alloc_error};
use std::any::Any;
use std::cell::Cell;
use std::collections::TryReserveError;
use std::fmt;
use std::mem::ManuallyDrop;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};

pub use arena::{Arena, BlockError, Boxed, Counted, HostMemory, Slice};

/// Bytes that are free after each large piece, for the small ones before the next. More than they
/// take: glibc's allocator asks the system for at least a megabyte where its heap cannot grow in
/// place.
pub const SPARE: usize = (1 << 20) + (128 << 10);
/// Bytes that a new thread needs while it starts: the standard library's stack, and what else the
/// system sets up, without which it ends the process.
pub const THREAD: usize = 3 << 20;
/// A large piece, in bytes: after these, that [`SPARE`] is left is looked at.
const LARGE: usize = 4 << 10;

/// The system or the host has no memory for a piece of this size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory {
    /// Bytes that were asked for.
    pub bytes: usize,
}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "not enough memory: no {} bytes could be allocated", self.bytes)
    }
}

impl std::error::Error for OutOfMemory {}

/// What unwinding allocates comes out of these bytes, which [`refuse`] frees.
const RESERVED: usize = 32 << 10;

thread_local! {
    /// The reserve of the innermost [`catch`] that the thread is in. Not dropped with the thread, for which the
    /// standard library would have to allocate: [`catch`] takes it back.
    static RESERVE: Cell<Option<ManuallyDrop<Vec<u8>>>> = const { Cell::new(None) };
}

/// Pieces so far that the system refused and the reserve of the process's allocator gave, and the bytes of the last.
static RESCUED: AtomicUsize = AtomicUsize::new(0);
static LAST_RESCUED: AtomicUsize = AtomicUsize::new(0);

/// Says that the process's allocator has given a piece out of a reserve of its own, which the system refused.
pub fn rescued(bytes: usize) {
    LAST_RESCUED.store(bytes, Ordering::Relaxed);
    RESCUED.fetch_add(1, Ordering::Relaxed);
}

/// Runs `make`, whose result counts only where the system refused no piece meanwhile, on any thread: where the
/// process's allocator has a reserve ([`rescued`]), work goes on to the end of this.
///
/// # Errors
/// [`OutOfMemory`] where the reserve gave a piece.
pub fn watch<R>(make: impl FnOnce() -> R) -> Result<R, OutOfMemory> {
    let before = RESCUED.load(Ordering::Relaxed);
    let made = make();
    if RESCUED.load(Ordering::Relaxed) == before {
        return Ok(made);
    }
    Err(OutOfMemory { bytes: LAST_RESCUED.load(Ordering::Relaxed) })
}

/// Runs `make`, and gives a piece of memory that it did not get as a value; panics go on.
///
/// Calls may be nested. Work that `make` hands to other threads needs a call of its own on each: [`refuse`] ends the
/// process on a thread that is in none.
///
/// # Errors
/// [`OutOfMemory`] where a function of this module got no memory on this thread, and as [`watch`].
pub fn catch<R>(make: impl FnOnce() -> R) -> Result<R, OutOfMemory> {
    let mut reserve = Vec::new();
    reserve.try_reserve_exact(RESERVED).map_err(|_| OutOfMemory { bytes: RESERVED })?;
    let outer = RESERVE.replace(Some(ManuallyDrop::new(reserve)));
    let made = watch(|| catch_unwind(AssertUnwindSafe(make)));
    drop(RESERVE.replace(outer).map(ManuallyDrop::into_inner));
    made?.map_err(|payload: Box<dyn Any + Send>| match payload.downcast::<OutOfMemory>() {
        Ok(missing) => *missing,
        Err(panic) => resume_unwind(panic),
    })
}

/// Unwinds to [`catch`]. Prints nothing. Ends the process where the thread is in no [`catch`].
pub fn refuse(bytes: usize) -> ! {
    match RESERVE.take() {
        Some(reserve) => drop(ManuallyDrop::into_inner(reserve)),
        None => handle_alloc_error(Layout::array::<u8>(bytes).unwrap_or(Layout::new::<u8>())),
    }
    resume_unwind(Box::new(OutOfMemory { bytes }))
}

/// Whether `bytes` more can be allocated now; they are given back at once.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check(bytes: usize) -> Result<(), OutOfMemory> {
    let mut piece = Vec::<u8>::new();
    let is_there = has(|| piece.try_reserve_exact(bytes));
    // Otherwise the compiler may leave the allocation out.
    std::hint::black_box(&mut piece);
    if is_there { Ok(()) } else { Err(OutOfMemory { bytes }) }
}

/// Whether an allocation is made, and by the system: what can fail is not to use up a reserve.
fn has(allocate: impl FnOnce() -> Result<(), TryReserveError>) -> bool {
    watch(allocate).is_ok_and(|got| got.is_ok())
}

/// Whether [`SPARE`] is left for small pieces.
pub(crate) fn spare() -> Result<(), OutOfMemory> {
    check(SPARE)
}

/// Whether the system has [`THREAD`] bytes for one more thread. The allocator may have as many left in its
/// heap, of which a thread's stack gets none: they are asked of the system, where it can be asked.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check_thread() -> Result<(), OutOfMemory> {
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    if memmap2::MmapMut::map_anon(THREAD).is_err() {
        return Err(OutOfMemory { bytes: THREAD });
    }
    check(THREAD)
}

/// That there is memory for one more thread.
///
/// Unwinds to [`catch`] where there is not.
pub(crate) fn require_thread() {
    if check_thread().is_err() {
        refuse(THREAD);
    }
}

/// That `bytes` more can be allocated now, by code that would end the process otherwise.
///
/// Unwinds to [`catch`] where they cannot.
pub fn require(bytes: usize) {
    if check(bytes).is_err() {
        refuse(bytes);
    }
}

/// An empty vector with room for `len` values.
///
/// Unwinds to [`catch`] where there is no memory.
pub fn with_capacity<T>(len: usize) -> Vec<T> {
    let bytes = len.saturating_mul(size_of::<T>());
    let mut values = Vec::new();
    if !has(|| values.try_reserve_exact(len)) || (bytes >= LARGE && spare().is_err()) {
        // What is freed here is what unwinding needs.
        drop(values);
        refuse(bytes);
    }
    values
}

/// What `values` gives.
///
/// Unwinds to [`catch`] where there is no memory.
pub fn collected<T>(values: impl ExactSizeIterator<Item = T>) -> Vec<T> {
    let mut all = with_capacity(values.len());
    all.extend(values);
    all
}

/// Adds `values` at the end of `all`.
///
/// Unwinds to [`catch`] where there is no memory.
pub fn append<T: Copy>(all: &mut Vec<T>, values: &[T]) {
    if !has(|| all.try_reserve(values.len())) {
        refuse(size_of_val(values));
    }
    all.extend_from_slice(values);
}

/// A copy of `values`.
///
/// Unwinds to [`catch`] where there is no memory.
pub fn copied<T: Copy>(values: &[T]) -> Vec<T> {
    let mut copy = with_capacity(values.len());
    copy.extend_from_slice(values);
    copy
}

/// `len` copies of `value`.
///
/// Unwinds to [`catch`] where there is no memory.
pub fn filled<T: Copy>(value: T, len: usize) -> Vec<T> {
    let mut values = with_capacity(len);
    values.resize(len, value);
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_piece_that_is_too_large_is_an_error() {
        let bytes = isize::MAX as usize - 63;
        assert_eq!(check(bytes), Err(OutOfMemory { bytes }));
        assert_eq!(catch(|| drop(with_capacity::<u64>(bytes / 8))), Err(OutOfMemory { bytes: bytes / 8 * 8 }));
        assert_eq!(catch(|| filled(3_u8, 5)), Ok(vec![3; 5]));
        assert_eq!(catch(|| drop(filled(1_u64, usize::MAX))), Err(OutOfMemory { bytes: usize::MAX }));
    }

    #[test]
    fn a_panic_goes_on() {
        let panic = catch_unwind(|| catch(|| resume_unwind(Box::new(7)))).unwrap_err();
        assert_eq!(panic.downcast_ref(), Some(&7));
    }

    #[test]
    fn each_catch_has_a_reserve_of_its_own() {
        let missing = |bytes| OutOfMemory { bytes };
        let caught = catch(|| {
            let inner = [1, 2, 3].map(|bytes| catch(|| refuse(bytes)));
            assert_eq!(inner, [1, 2, 3].map(|bytes| Err(missing(bytes))));
            refuse(4)
        });
        assert_eq!(caught, Err(missing(4)));
        assert!(RESERVE.take().is_none());
    }
}
