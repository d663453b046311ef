//! What the host wants to be told.

use std::ffi::{CString, c_char, c_void};
use std::fmt::Display;

/// Log level: information.
pub const UMO_LOG_INFO: u32 = 1;
/// Log level: warning.
pub const UMO_LOG_WARNING: u32 = 2;
/// Log level: error.
pub const UMO_LOG_ERROR: u32 = 3;

/// A log callback. Called only by the functions that make and free models, engines and sessions, on
/// their thread; never by the audio thread's or the game thread's calls, nor by the engine's
/// threads.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoLog {
    /// Given to `write`.
    pub userdata: *mut c_void,
    /// Gets one of `UMO_LOG_…` and a text that ends with a zero byte, good until it returns. Must not throw.
    pub write: Option<unsafe extern "C" fn(userdata: *mut c_void, level: u32, message: *const c_char)>,
}

/// A host's log, or none.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Log(pub(crate) Option<UmoLog>);

// SAFETY: `UmoLog` says which threads call it; the host's pointer is only handed back.
unsafe impl Send for Log {}
// SAFETY: as above.
unsafe impl Sync for Log {}

impl Log {
    pub(crate) fn say(&self, level: u32, message: impl Display) {
        let Some(UmoLog { userdata, write: Some(write) }) = self.0 else { return };
        let Ok(message) = CString::new(message.to_string()) else { return };
        // SAFETY: the host's own function, called as its description says.
        unsafe { write(userdata, level, message.as_ptr()) };
    }
}
