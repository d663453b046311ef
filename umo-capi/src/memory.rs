//! Memory of a session: one block, from the host or the system.

use std::ffi::c_void;

use umo_core_base::memory::{BlockError, HostMemory};

use crate::status::Failure;

/// Allocator for a session's memory. Both functions are required. They are called by `umo_session_new`,
/// by `umo_session_free` and, if a session was freed while a chunk of it was being computed, by the next
/// call of either or `umo_engine_free`; always on the thread of that call. They must not throw, nor call
/// functions of this library.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoAllocator {
    /// Passed to both functions.
    pub userdata: *mut c_void,
    /// Returns `size` bytes aligned to `alignment`, a power of two, or NULL.
    pub allocate: Option<unsafe extern "C" fn(userdata: *mut c_void, size: usize, alignment: usize) -> *mut c_void>,
    /// Releases memory from `allocate`.
    pub release:
        Option<unsafe extern "C" fn(userdata: *mut c_void, memory: *mut c_void, size: usize, alignment: usize)>,
}

impl UmoAllocator {
    /// Checks that both functions are given.
    ///
    /// # Safety
    /// They behave as documented, for as long as a session with memory from them exists.
    pub(crate) unsafe fn host_memory(self) -> Result<HostMemory, Failure> {
        let (Some(allocate), Some(release)) = (self.allocate, self.release) else {
            return Err(Failure::null("allocator's functions"));
        };
        // SAFETY: guaranteed by the caller (see # Safety).
        Ok(unsafe { HostMemory::new(self.userdata, allocate, release) })
    }
}

impl From<BlockError> for Failure {
    fn from(error: BlockError) -> Self {
        match error {
            BlockError::OutOfMemory(missing) => missing.into(),
            BlockError::Misaligned { .. } => Self::argument(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::status::UMO_STATUS_NULL_POINTER;

    #[test]
    fn half_an_allocator_is_an_error() {
        unsafe extern "C" fn nothing(_: *mut c_void, _: usize, _: usize) -> *mut c_void {
            std::ptr::null_mut()
        }
        let half = UmoAllocator { userdata: std::ptr::null_mut(), allocate: Some(nothing), release: None };
        // SAFETY: it is not called.
        assert_eq!(unsafe { half.host_memory() }.err().unwrap().status, UMO_STATUS_NULL_POINTER);
    }
}
