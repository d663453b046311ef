//! What WebAssembly needs beside `umo.h`: memory for a program outside of the module, which has no
//! allocator of its own there.

use std::alloc::{Layout, alloc, dealloc};

/// Alignment of what [`umo_web_allocate`] gives.
const ALIGNMENT: usize = 16;

/// `size` bytes aligned to 16, or NULL.
#[unsafe(no_mangle)]
pub extern "C" fn umo_web_allocate(size: usize) -> *mut u8 {
    match Layout::from_size_align(size.max(1), ALIGNMENT) {
        // SAFETY: the size is not 0.
        Ok(layout) => unsafe { alloc(layout) },
        Err(_) => std::ptr::null_mut(),
    }
}

/// Takes back what [`umo_web_allocate`] gave. NULL is fine.
///
/// # Safety
/// `memory` is NULL, or from [`umo_web_allocate`] with the same size, and not freed yet.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn umo_web_free(memory: *mut u8, size: usize) {
    if let (false, Ok(layout)) = (memory.is_null(), Layout::from_size_align(size.max(1), ALIGNMENT)) {
        // SAFETY: it was allocated with this layout, guaranteed by the caller (see # Safety).
        unsafe { dealloc(memory, layout) }
    }
}
