//! Fallible allocation, for everything whose size a model file or a configuration determines.
//!
//! The standard library aborts the process if an allocation fails. So data that grows with the sizes in a file or a
//! configuration is allocated here: [`filled`] and [`with_capacity`] unwind to the enclosing [`catch`] instead, which
//! frees everything made so far and returns [`OutOfMemory`]. They also leave [`SPARE`] bytes free, enough for the
//! small allocations that the standard library and other crates make in between. Outside of [`catch`] they end the
//! process, as the standard library does.
//!
//! All memory of a session comes from one block of an [`Arena`].

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

/// Bytes left free after each large allocation, for the small ones before the next. More than those take: glibc's
/// allocator asks the system for at least a megabyte if its heap cannot grow in place.
pub const SPARE: usize = (1 << 20) + (128 << 10);
/// Bytes that starting a thread needs: the standard library's stack and the system's own structures. Without them the
/// system ends the process.
pub const THREAD: usize = 5 << 20;
/// Size in bytes from which an allocation is large: after it, [`SPARE`] is checked.
const LARGE: usize = 4 << 10;

/// The system or the host could not allocate memory of this size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutOfMemory {
    /// Bytes requested.
    pub bytes: usize,
}

impl fmt::Display for OutOfMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "not enough memory: no {} bytes could be allocated", self.bytes)
    }
}

impl std::error::Error for OutOfMemory {}

/// Size of the reserve that [`refuse`] frees, so that unwinding can allocate.
const RESERVED: usize = 32 << 10;

thread_local! {
    /// The reserve of the thread's innermost [`catch`]. `ManuallyDrop`, because a thread-local destructor would make
    /// the standard library allocate: [`catch`] takes the reserve back.
    static RESERVE: Cell<Option<ManuallyDrop<Vec<u8>>>> = const { Cell::new(None) };
}

/// Number of allocations that the system refused and the process's allocator served from its reserve; size of the
/// last.
static RESCUED: AtomicUsize = AtomicUsize::new(0);
static LAST_RESCUED: AtomicUsize = AtomicUsize::new(0);

/// Reports that the process's allocator served an allocation from its reserve because the system refused it.
pub fn rescued(bytes: usize) {
    LAST_RESCUED.store(bytes, Ordering::Relaxed);
    RESCUED.fetch_add(1, Ordering::Relaxed);
}

/// Runs `make`, whose result counts only if the system refused no allocation meanwhile, on any thread. An allocator
/// with a reserve ([`rescued`]) lets `make` run to its end.
///
/// # Errors
/// [`OutOfMemory`] if the reserve served an allocation.
pub fn watch<R>(make: impl FnOnce() -> R) -> Result<R, OutOfMemory> {
    let before = RESCUED.load(Ordering::Relaxed);
    let made = make();
    if RESCUED.load(Ordering::Relaxed) == before {
        return Ok(made);
    }
    Err(OutOfMemory { bytes: LAST_RESCUED.load(Ordering::Relaxed) })
}

/// Runs `make` and returns a failed allocation as an error; other panics propagate.
///
/// Calls may be nested. Work that `make` hands to other threads needs a call on each of them: outside of a `catch`,
/// [`refuse`] ends the process.
///
/// # Errors
/// [`OutOfMemory`] if a function of this module could not allocate on this thread, or as in [`watch`].
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

/// Unwinds to [`catch`], without printing. Outside of a [`catch`], ends the process.
pub fn refuse(bytes: usize) -> ! {
    match RESERVE.take() {
        Some(reserve) => drop(ManuallyDrop::into_inner(reserve)),
        None => handle_alloc_error(Layout::array::<u8>(bytes).unwrap_or(Layout::new::<u8>())),
    }
    resume_unwind(Box::new(OutOfMemory { bytes }))
}

/// Checks that `bytes` more can be allocated now, and frees them at once.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check(bytes: usize) -> Result<(), OutOfMemory> {
    let mut piece = Vec::<u8>::new();
    let is_there = has(|| piece.try_reserve_exact(bytes));
    // Otherwise the compiler may remove the allocation.
    std::hint::black_box(&mut piece);
    if is_there { Ok(()) } else { Err(OutOfMemory { bytes }) }
}

/// Whether the system itself can serve an allocation. Fallible allocations must not use up the reserve.
fn has(allocate: impl FnOnce() -> Result<(), TryReserveError>) -> bool {
    watch(allocate).is_ok_and(|got| got.is_ok())
}

/// Checks that [`SPARE`] bytes are left for small allocations.
pub(crate) fn spare() -> Result<(), OutOfMemory> {
    check(SPARE)
}

/// Checks that the system has [`THREAD`] bytes for one more thread. Free memory in the allocator's heap does not
/// count, because thread stacks do not come from it: the system is asked, if it can be, after the heap, which keeps what
/// it was asked for.
///
/// # Errors
/// [`OutOfMemory`].
pub fn check_thread() -> Result<(), OutOfMemory> {
    check(THREAD)?;
    #[cfg(all(feature = "mmap", not(target_family = "wasm")))]
    if memmap2::MmapMut::map_anon(THREAD).is_err() {
        return Err(OutOfMemory { bytes: THREAD });
    }
    Ok(())
}

/// Requires memory for one more thread.
///
/// Unwinds to [`catch`] if there is too little.
pub fn require_thread() {
    if check_thread().is_err() {
        refuse(THREAD);
    }
}

/// Requires that `bytes` more can be allocated now, by code that would otherwise end the process.
///
/// Unwinds to [`catch`] if they cannot.
pub fn require(bytes: usize) {
    if check(bytes).is_err() {
        refuse(bytes);
    }
}

/// Returns an empty vector with room for `len` values.
///
/// Unwinds to [`catch`] if out of memory.
pub fn with_capacity<T>(len: usize) -> Vec<T> {
    let bytes = len.saturating_mul(size_of::<T>());
    let mut values = Vec::new();
    if !has(|| values.try_reserve_exact(len)) || (bytes >= LARGE && spare().is_err()) {
        // Unwinding needs the memory that is freed here.
        drop(values);
        refuse(bytes);
    }
    values
}

/// Collects `values` into a vector.
///
/// Unwinds to [`catch`] if out of memory.
pub fn collected<T>(values: impl ExactSizeIterator<Item = T>) -> Vec<T> {
    let mut all = with_capacity(values.len());
    all.extend(values);
    all
}

/// Appends `values` to `all`.
///
/// Unwinds to [`catch`] if out of memory.
pub fn append<T: Copy>(all: &mut Vec<T>, values: &[T]) {
    if !has(|| all.try_reserve(values.len())) {
        refuse(size_of_val(values));
    }
    all.extend_from_slice(values);
}

/// Returns a copy of `values`.
///
/// Unwinds to [`catch`] if out of memory.
pub fn copied<T: Copy>(values: &[T]) -> Vec<T> {
    let mut copy = with_capacity(values.len());
    copy.extend_from_slice(values);
    copy
}

/// Returns `len` copies of `value`.
///
/// Unwinds to [`catch`] if out of memory.
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
