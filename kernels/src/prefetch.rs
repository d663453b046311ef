//! Lines of memory that are wanted soon. An address may lie anywhere, even beyond what it points into.

use core::arch::x86_64::{_MM_HINT_T0, _MM_HINT_T1, _mm_prefetch};

/// Fetches a line into L1.
#[inline]
pub(crate) fn near<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(line.cast()) }
}

/// Fetches a line into L2.
#[inline]
pub(crate) fn far<T>(line: *const T) {
    // SAFETY: a prefetch is a hint: it reads nothing that the program can see and never faults.
    unsafe { _mm_prefetch::<_MM_HINT_T1>(line.cast()) }
}
