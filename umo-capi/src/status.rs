//! Status codes, their messages, and storage for the detail of the last failure.

use std::cell::UnsafeCell;
use std::ffi::{CStr, c_char};
use std::fmt::{self, Write as _};

use umo_core::{Defect, EngineError, LoadError, OutOfMemory, PacketError, PollError, SessionError};

/// Result of a call: `UMO_STATUS_OK`, or a negative error code. Numbers are never reused.
pub type UmoStatus = i32;

/// Success.
pub const UMO_STATUS_OK: UmoStatus = 0;
/// A required pointer is NULL.
pub const UMO_STATUS_NULL_POINTER: UmoStatus = -1;
/// A handle is unknown, freed, or of another kind.
pub const UMO_STATUS_INVALID_HANDLE: UmoStatus = -2;
/// An argument is out of range.
pub const UMO_STATUS_INVALID_ARGUMENT: UmoStatus = -3;
/// Unknown `struct_size`: call the structure's initializer, or set it to `sizeof`.
pub const UMO_STATUS_STRUCT_SIZE: UmoStatus = -4;
/// A buffer is too small for the output.
pub const UMO_STATUS_BUFFER_TOO_SMALL: UmoStatus = -5;
/// The program was compiled with the header of an incompatible version.
pub const UMO_STATUS_VERSION: UmoStatus = -6;
/// A file cannot be read or written.
pub const UMO_STATUS_IO: UmoStatus = -7;
/// The file is not a usable model.
pub const UMO_STATUS_MODEL: UmoStatus = -8;
/// There is not enough memory, or the host's allocator returned NULL.
pub const UMO_STATUS_OUT_OF_MEMORY: UmoStatus = -9;
/// No free slot: free a model, an engine or a session first.
pub const UMO_STATUS_FULL: UmoStatus = -10;
/// Another thread is in a call that excludes this one: call again. Nothing was done.
pub const UMO_STATUS_BUSY: UmoStatus = -11;
/// Audio was pushed after `umo_session_finish`: reset or interrupt the session first.
pub const UMO_STATUS_FINISHED: UmoStatus = -12;
/// The session's computation failed: it gives no more frames. Free it.
pub const UMO_STATUS_FAILED: UmoStatus = -13;
/// The session's engine was freed: it gives no more frames. Free it.
pub const UMO_STATUS_CLOSED: UmoStatus = -14;
/// A panic of this library was caught, without output; the session concerned cannot be used any more.
/// Free it, and report the defect: `umo_session_last_error` (or `umo_last_error`) has the panic's
/// message and its place in the source.
pub const UMO_STATUS_PANIC: UmoStatus = -15;
/// This model, processor or engine cannot do that.
pub const UMO_STATUS_UNSUPPORTED: UmoStatus = -16;
/// The bytes are not a state of a session with this configuration. Nothing was changed.
pub const UMO_STATUS_STATE: UmoStatus = -17;
/// A worker thread could not be created or pinned.
pub const UMO_STATUS_THREAD: UmoStatus = -18;
/// The bytes are not a packet for this decoder. Nothing was changed.
pub const UMO_STATUS_PACKET: UmoStatus = -19;
/// The bytes are not a take, or a damaged one.
pub const UMO_STATUS_TAKE: UmoStatus = -20;

/// Message of a status, with a remedy.
fn text(status: UmoStatus) -> &'static CStr {
    match status {
        UMO_STATUS_OK => c"no error",
        UMO_STATUS_NULL_POINTER => c"a required pointer is NULL",
        UMO_STATUS_INVALID_HANDLE => c"unknown or freed handle, or one of another kind",
        UMO_STATUS_INVALID_ARGUMENT => c"an argument is out of range",
        UMO_STATUS_STRUCT_SIZE => c"unknown struct_size: call the structure's initializer, or set it to sizeof",
        UMO_STATUS_BUFFER_TOO_SMALL => c"the buffer is too small",
        UMO_STATUS_VERSION => {
            c"the program was compiled with the umo.h of an incompatible version: compile it with this library's"
        }
        UMO_STATUS_IO => c"the file cannot be read or written",
        UMO_STATUS_MODEL => c"not a usable umo model",
        UMO_STATUS_OUT_OF_MEMORY => c"there is not enough memory",
        UMO_STATUS_FULL => c"no free slot: free a model, an engine or a session first",
        UMO_STATUS_BUSY => c"another thread is in a call that excludes this one: call again",
        UMO_STATUS_FINISHED => c"audio was pushed after finish: reset or interrupt the session first",
        UMO_STATUS_FAILED => c"the session's computation failed and it yields no more frames: free it",
        UMO_STATUS_CLOSED => c"the session's engine was freed and it yields no more frames: free it",
        UMO_STATUS_PANIC => c"a defect of this library was caught: free the session, and report the defect",
        UMO_STATUS_UNSUPPORTED => c"this model, processor or engine cannot do that",
        UMO_STATUS_STATE => c"not a state of a session with this configuration",
        UMO_STATUS_THREAD => c"a worker thread could not be created or pinned",
        UMO_STATUS_PACKET => c"not a packet for this decoder",
        UMO_STATUS_TAKE => c"not a take, or a damaged one",
        _ => c"not a status of this library",
    }
}

/// Maximum length in bytes of an error's detail, including its terminating zero.
pub const UMO_ERROR_SIZE: usize = 512;

/// A failed call's status and detail.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) status: UmoStatus,
    pub(crate) detail: Text,
}

impl Failure {
    /// A failure whose detail is the status's message.
    pub(crate) fn plain(status: UmoStatus) -> Self {
        Self { status, detail: Text::from(format_args!("{}", text(status).to_str().unwrap_or_default())) }
    }

    pub(crate) fn new(status: UmoStatus, detail: impl fmt::Display) -> Self {
        Self { status, detail: Text::from(format_args!("{detail}")) }
    }

    /// A path given to a library built without files; names the function that takes the file's bytes.
    #[cfg(not(feature = "files"))]
    pub(crate) fn no_files(path: &str, memory: &str) -> Self {
        let what = format_args!("{path}: this library was built without files: read it yourself and call {memory}");
        Self::new(UMO_STATUS_UNSUPPORTED, what)
    }

    /// A failure to read or write a file.
    #[cfg(any(feature = "files", feature = "gltf"))]
    pub(crate) fn io(cause: &std::io::Error, detail: impl fmt::Display) -> Self {
        let is_memory = cause.kind() == std::io::ErrorKind::OutOfMemory;
        Self::new(if is_memory { UMO_STATUS_OUT_OF_MEMORY } else { UMO_STATUS_IO }, detail)
    }

    /// A caught panic.
    pub(crate) fn defect(defect: &Defect) -> Self {
        let place = if defect.place().is_empty() { "an unknown place" } else { defect.place() };
        let what = format_args!(
            "a defect of this library was caught at {place}: {}. Free the session, and report the defect",
            defect.message()
        );
        Self::new(UMO_STATUS_PANIC, what)
    }

    pub(crate) fn null(what: &str) -> Self {
        Self::new(UMO_STATUS_NULL_POINTER, format_args!("`{what}` is NULL"))
    }

    pub(crate) fn argument(detail: impl fmt::Display) -> Self {
        Self::new(UMO_STATUS_INVALID_ARGUMENT, detail)
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        let status = match error {
            LoadError::Io { .. } => UMO_STATUS_IO,
            LoadError::Memory(_) => UMO_STATUS_OUT_OF_MEMORY,
            _ => UMO_STATUS_MODEL,
        };
        Self::new(status, error)
    }
}

impl From<EngineError> for Failure {
    fn from(error: EngineError) -> Self {
        let status = match error {
            EngineError::Config(_) => UMO_STATUS_INVALID_ARGUMENT,
            EngineError::Thread(_) => UMO_STATUS_THREAD,
            EngineError::Full { .. } => UMO_STATUS_FULL,
            EngineError::Rest(_) => UMO_STATUS_MODEL,
            EngineError::Memory(_) => UMO_STATUS_OUT_OF_MEMORY,
            EngineError::Panicked(defect) => return Self::defect(&defect),
        };
        Self::new(status, error)
    }
}

impl From<OutOfMemory> for Failure {
    fn from(missing: OutOfMemory) -> Self {
        Self::new(UMO_STATUS_OUT_OF_MEMORY, missing)
    }
}

impl From<SessionError> for Failure {
    fn from(error: SessionError) -> Self {
        let status = match error {
            SessionError::Busy(_) | SessionError::GesturesFull | SessionError::HintsFull | SessionError::WordsFull => {
                UMO_STATUS_BUSY
            }
            SessionError::Finished => UMO_STATUS_FINISHED,
            SessionError::Uneven { .. }
            | SessionError::Range(_)
            | SessionError::NotDecoder
            | SessionError::IsDecoder
            | SessionError::Take
            | SessionError::NoTake
            | SessionError::NoPackets
            | SessionError::Short { .. }
            | SessionError::UnknownGesture => UMO_STATUS_INVALID_ARGUMENT,
            SessionError::Failed(_) => UMO_STATUS_FAILED,
            SessionError::Panicked => UMO_STATUS_PANIC,
            SessionError::Closed => UMO_STATUS_CLOSED,
            SessionError::State(_) => UMO_STATUS_STATE,
            SessionError::Packet(PacketError::Full) => UMO_STATUS_BUSY,
            SessionError::Packet(_) => UMO_STATUS_PACKET,
        };
        Self::new(status, error)
    }
}

impl From<PollError> for Failure {
    fn from(error: PollError) -> Self {
        let status = match error {
            PollError::Busy => UMO_STATUS_BUSY,
            PollError::OwnThreads => UMO_STATUS_UNSUPPORTED,
        };
        Self::new(status, error)
    }
}

/// A zero-terminated text in fixed storage. Writing does not allocate; text that does not fit is
/// truncated.
#[derive(Clone, Copy)]
pub(crate) struct Text {
    bytes: [u8; UMO_ERROR_SIZE],
    len: usize,
}

impl Text {
    pub(crate) const EMPTY: Self = Self { bytes: [0; UMO_ERROR_SIZE], len: 0 };

    fn from(arguments: fmt::Arguments) -> Self {
        let mut text = Self::EMPTY;
        // Only text that does not fit is an error; it is truncated.
        let _ = text.write_fmt(arguments);
        text
    }

    pub(crate) fn as_bytes(&self) -> &[u8] {
        &self.bytes[..self.len]
    }

    /// Returns the text with its terminating zero.
    pub(crate) fn as_c_str(&self) -> &CStr {
        CStr::from_bytes_until_nul(&self.bytes).unwrap_or_default()
    }
}

impl fmt::Debug for Text {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&String::from_utf8_lossy(self.as_bytes()))
    }
}

impl fmt::Write for Text {
    fn write_str(&mut self, piece: &str) -> fmt::Result {
        for c in piece.chars() {
            let mut bytes = [0; 4];
            let bytes = c.encode_utf8(&mut bytes).as_bytes();
            // The last byte stays zero; a zero inside would end the text for C.
            if self.len + bytes.len() >= self.bytes.len() || c == '\0' {
                return Err(fmt::Error);
            }
            self.bytes[self.len..self.len + bytes.len()].copy_from_slice(bytes);
            self.len += bytes.len();
        }
        Ok(())
    }
}

thread_local! {
    /// Detail of the thread's last failure. It has no destructor, so that threads that never fail pay
    /// nothing.
    static LAST: UnsafeCell<Text> = const { UnsafeCell::new(Text::EMPTY) };
}

/// Stores a failure's detail for `umo_last_error`.
pub(crate) fn remember(detail: &Text) {
    LAST.with(|last| {
        // SAFETY: the cell is this thread's, and nothing called here calls back, so no other
        // reference to it exists.
        unsafe { *last.get() = *detail };
    });
}

/// Returns the message of a status, with a remedy: static, never NULL, in English.
///
/// Threads: any. Never allocates, never waits.
#[unsafe(no_mangle)]
pub extern "C" fn umo_status_message(status: UmoStatus) -> *const c_char {
    text(status).as_ptr()
}

/// Returns the detail of this thread's last failed call of a function without a session, such as the key,
/// file, tensor or argument. Never NULL; the storage belongs to the thread, and its next failure
/// overwrites it.
///
/// Threads: any but the audio thread. Never waits. Calls on sessions keep their detail with the
/// session: `umo_session_last_error`.
#[unsafe(no_mangle)]
pub extern "C" fn umo_last_error() -> *const c_char {
    LAST.with(|last| last.get().cast::<c_char>().cast_const())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_has_a_text_of_its_own() {
        let texts: std::collections::HashSet<_> = (UMO_STATUS_TAKE..=UMO_STATUS_OK).map(text).collect();
        assert_eq!(texts.len(), 21);
        assert!(!texts.contains(text(1)));
        assert!(text(-1000).to_str().unwrap().starts_with("not a status"));
    }

    #[test]
    fn long_details_are_cut_at_a_character_and_end() {
        let failure = Failure::argument("ä".repeat(UMO_ERROR_SIZE));
        let text = std::str::from_utf8(failure.detail.as_bytes()).unwrap();
        assert_eq!(text.chars().count(), (UMO_ERROR_SIZE - 1) / 2);
        assert_eq!(failure.detail.as_c_str().to_bytes(), text.as_bytes());
        remember(&failure.detail);
        // SAFETY: never NULL, and zero-terminated.
        let seen = unsafe { CStr::from_ptr(umo_last_error()) };
        assert_eq!(seen.to_bytes(), text.as_bytes());
    }
}
