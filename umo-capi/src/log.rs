//! Log messages for the host.

use std::ffi::{CString, c_char, c_void};
use std::fmt::Display;

/// Log level: information.
pub const UMO_LOG_INFO: u32 = 1;
/// Log level: warning.
pub const UMO_LOG_WARNING: u32 = 2;
/// Log level: error.
pub const UMO_LOG_ERROR: u32 = 3;

/// A log callback. Called only by the functions that make and free models, engines and sessions or encode a
/// text, on the calling thread; never by calls for the audio thread or the game thread, nor on the engine's
/// threads.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoLog {
    /// Passed to `write`.
    pub userdata: *mut c_void,
    /// Receives one of `UMO_LOG_…` and a zero-terminated text, valid until it returns. Must not throw.
    pub write: Option<unsafe extern "C" fn(userdata: *mut c_void, level: u32, message: *const c_char)>,
}

/// Log of a host, or `None`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Log(pub(crate) Option<UmoLog>);

// SAFETY: `UmoLog` says which threads call it; the host's pointer is only passed back.
unsafe impl Send for Log {}
// SAFETY: as above.
unsafe impl Sync for Log {}

impl Log {
    pub(crate) fn say(&self, level: u32, message: impl Display) {
        let Some(UmoLog { userdata, write: Some(write) }) = self.0 else { return };
        let Ok(message) = CString::new(message.to_string()) else { return };
        // SAFETY: the host's function, called as documented.
        unsafe { write(userdata, level, message.as_ptr()) };
    }
}
