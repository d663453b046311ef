//! The boundary between C and Rust: checks pointers, reads and writes structures of any version, and catches
//! panics.

use std::ffi::{CStr, c_char};

use umo_core_base::defect::{contain_quietly, keep_quiet};

use crate::status::{
    Failure, Text, UMO_STATUS_BUFFER_TOO_SMALL, UMO_STATUS_OK, UMO_STATUS_STRUCT_SIZE, UmoStatus, remember,
};

/// Maximum length of a text from C, in bytes.
pub(crate) const MAX_TEXT: usize = 1 << 16;
/// Largest `struct_size` that is accepted.
const MAX_STRUCT: usize = 1 << 12;
/// Maximum length of a slice, in bytes.
const MAX_BYTES: usize = isize::MAX as usize;

/// Runs a call without a session; the detail of a failure is kept for `umo_last_error`.
pub(crate) fn guard(call: impl FnOnce() -> Result<(), Failure>) -> UmoStatus {
    keep_quiet(&[umo_core::SOURCES, &[file!()]]);
    // State that a caught panic may leave inconsistent is behind a handle: a session is poisoned, and engines
    // and models are not changed.
    let result = contain_quietly(call).unwrap_or_else(|defect| Err(Failure::defect(&defect)));
    match result {
        Ok(()) => UMO_STATUS_OK,
        Err(failure) => {
            remember(&failure.detail);
            failure.status
        }
    }
}

/// Writes a result.
///
/// # Safety
/// `out` is NULL or writable.
pub(crate) unsafe fn put<T>(out: *mut T, what: &str, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Err(Failure::null(what));
    }
    check_alignment(out.cast_const(), what)?;
    // SAFETY: not NULL, aligned, and writable guaranteed by the caller (see # Safety).
    unsafe { out.write(value) };
    Ok(())
}

/// Writes a result if the host passed a pointer for it.
///
/// # Safety
/// `out` is NULL or writable.
pub(crate) unsafe fn put_if_wanted<T>(out: *mut T, what: &str, value: T) -> Result<(), Failure> {
    if out.is_null() {
        return Ok(());
    }
    // SAFETY: writable guaranteed by the caller (see # Safety).
    unsafe { put(out, what, value) }
}

/// Checks that a result can be written, before any other work.
pub(crate) fn wanted<T>(out: *mut T, what: &str) -> Result<(), Failure> {
    if out.is_null() {
        return Err(Failure::null(what));
    }
    check_alignment(out.cast_const(), what)
}

fn check_alignment<T>(pointer: *const T, what: &str) -> Result<(), Failure> {
    if pointer.is_aligned() {
        return Ok(());
    }
    Err(Failure::argument(format_args!("`{what}` is not aligned to {} bytes", align_of::<T>())))
}

/// Returns a slice of `len` values.
///
/// # Safety
/// `values` is NULL or has `len` readable values that no thread writes while the slice lives.
pub(crate) unsafe fn slice<'a, T>(values: *const T, len: usize, what: &str) -> Result<&'a [T], Failure> {
    if len == 0 {
        return Ok(&[]);
    }
    check_len::<T>(values, len, what)?;
    // SAFETY: not NULL, aligned, and short enough for a slice; readable as guaranteed by the caller (see
    // # Safety).
    Ok(unsafe { std::slice::from_raw_parts(values, len) })
}

/// Returns a mutable slice of `len` values.
///
/// # Safety
/// `values` is NULL or has `len` writable values that no other thread accesses while the slice lives.
pub(crate) unsafe fn slice_mut<'a, T>(values: *mut T, len: usize, what: &str) -> Result<&'a mut [T], Failure> {
    if len == 0 {
        return Ok(&mut []);
    }
    check_len::<T>(values, len, what)?;
    // SAFETY: not NULL, aligned, and short enough for a slice; writable as guaranteed by the caller (see
    // # Safety).
    Ok(unsafe { std::slice::from_raw_parts_mut(values, len) })
}

fn check_len<T>(values: *const T, len: usize, what: &str) -> Result<(), Failure> {
    if values.is_null() {
        return Err(Failure::null(what));
    }
    check_alignment(values, what)?;
    let end = len.checked_mul(size_of::<T>()).filter(|&bytes| bytes <= MAX_BYTES);
    if end.and_then(|bytes| values.addr().checked_add(bytes)).is_none() {
        return Err(Failure::argument(format_args!("`{what}`: {len} values are more than memory holds")));
    }
    Ok(())
}

/// Returns a zero-terminated text as UTF-8.
///
/// # Safety
/// `text` is NULL or readable up to its zero byte.
pub(crate) unsafe fn string<'a>(text: *const c_char, what: &str) -> Result<&'a str, Failure> {
    if text.is_null() {
        return Err(Failure::null(what));
    }
    for len in 0..MAX_TEXT {
        // SAFETY: no byte before this one was zero, so the caller guarantees that it is readable (see
        // # Safety).
        let byte = unsafe { text.add(len) };
        // SAFETY: as above.
        if unsafe { *byte } == 0 {
            // SAFETY: the loop found the terminating zero.
            let bytes = unsafe { CStr::from_ptr(text) };
            return bytes.to_str().map_err(|_| Failure::argument(format_args!("`{what}` is not UTF-8")));
        }
    }
    Err(Failure::argument(format_args!("`{what}` has more than {MAX_TEXT} bytes")))
}

/// A structure whose first field is its size, a `u32`, so that it can grow: a field that an older or
/// newer program does not have counts as zero.
///
/// # Safety
/// The type is `repr(C)`, starts with `struct_size: u32`, and every bit pattern is a valid value.
pub(crate) unsafe trait Sized32: Copy {
    /// Size in bytes of the structure in its first release.
    const FIRST: usize;
}

/// Reads a structure.
///
/// # Safety
/// `from` is NULL or has as many readable bytes as its `struct_size` says.
pub(crate) unsafe fn read<T: Sized32>(from: *const T, what: &str) -> Result<T, Failure> {
    // SAFETY: guaranteed by the caller (see # Safety).
    let size = unsafe { struct_size(from, what)? };
    // SAFETY: every bit pattern is valid, including zeros.
    let mut value: T = unsafe { std::mem::zeroed() };
    let known = size.min(size_of::<T>());
    // SAFETY: `size` bytes are readable, and `value` has room for the bytes that are copied.
    unsafe { std::ptr::copy_nonoverlapping(from.cast::<u8>(), (&raw mut value).cast(), known) };
    // SAFETY: the bytes from `known` to `size` are readable.
    let unknown = unsafe { from.cast::<u8>().add(known) };
    // SAFETY: as above.
    let unknown = unsafe { std::slice::from_raw_parts(unknown, size - known) };
    if unknown.iter().any(|&byte| byte != 0) {
        let what = format_args!("`{what}` sets fields that this version does not know");
        return Err(Failure::new(UMO_STATUS_STRUCT_SIZE, what));
    }
    Ok(value)
}

/// Writes the fields that the host's structure has room for; its `struct_size` is unchanged.
///
/// # Safety
/// `to` is NULL or has as many writable bytes as its `struct_size` says.
pub(crate) unsafe fn write<T: Sized32>(to: *mut T, what: &str, value: &T) -> Result<(), Failure> {
    // SAFETY: guaranteed by the caller (see # Safety).
    let size = unsafe { struct_size(to.cast_const(), what)? };
    let (head, known) = (size_of::<u32>(), size.min(size_of::<T>()));
    // SAFETY: `value` has more bytes than the head, and so has the host's structure, of at least `FIRST`.
    let from = unsafe { (&raw const *value).cast::<u8>().add(head) };
    // SAFETY: as above.
    let to = unsafe { to.cast::<u8>().add(head) };
    // SAFETY: both have `known` bytes, and `value` belongs to this library.
    unsafe { std::ptr::copy_nonoverlapping(from, to, known - head) };
    Ok(())
}

/// Returns the size that a structure declares.
///
/// # Safety
/// `from` is NULL or starts with a readable `u32`.
unsafe fn struct_size<T: Sized32>(from: *const T, what: &str) -> Result<usize, Failure> {
    if from.is_null() {
        return Err(Failure::null(what));
    }
    check_alignment(from, what)?;
    // SAFETY: not NULL, aligned, and readable guaranteed by the caller (see # Safety).
    let size = unsafe { from.cast::<u32>().read() } as usize;
    if !(T::FIRST..=MAX_STRUCT).contains(&size) {
        let what = format_args!("`{what}`: struct_size is {size}, but the structure has {} bytes", size_of::<T>());
        return Err(Failure::new(UMO_STATUS_STRUCT_SIZE, what));
    }
    Ok(size)
}

/// Initialises a structure of the host's: zeros, its size, then the fields of `value` that fit.
///
/// # Safety
/// `to` is NULL or has `size` writable bytes.
pub(crate) unsafe fn initialise<T: Sized32>(to: *mut T, size: usize, what: &str, value: &T) -> Result<(), Failure> {
    if to.is_null() {
        return Err(Failure::null(what));
    }
    check_alignment(to.cast_const(), what)?;
    if !(T::FIRST..=MAX_STRUCT).contains(&size) {
        let what = format_args!("`{what}`: a size of {size} was given, but the structure has {} bytes", size_of::<T>());
        return Err(Failure::new(UMO_STATUS_STRUCT_SIZE, what));
    }
    // SAFETY: `size` bytes are writable guaranteed by the caller (see # Safety).
    unsafe { to.cast::<u8>().write_bytes(0, size) };
    let size = u32::try_from(size).map_err(|_| Failure::argument("a structure's size"))?;
    // SAFETY: not NULL, aligned, and at least `FIRST` bytes are writable.
    unsafe { to.cast::<u32>().write(size) };
    // SAFETY: as many bytes are writable as the `struct_size` written above says.
    unsafe { write(to, what, value) }
}

/// Copies a text and its terminating zero to a buffer of the host's; writes its length without the zero.
///
/// # Safety
/// `buffer` is NULL or has `size` writable bytes; `length` is NULL or writable.
pub(crate) unsafe fn copy_text(
    text: &Text,
    buffer: *mut c_char,
    size: usize,
    length: *mut usize,
) -> Result<(), Failure> {
    let bytes = text.as_c_str().to_bytes_with_nul();
    // SAFETY: guaranteed by the caller (see # Safety).
    unsafe { put_if_wanted(length, "length", bytes.len() - 1)? };
    if size == 0 {
        return Ok(());
    }
    if size < bytes.len() {
        return Err(Failure::plain(UMO_STATUS_BUFFER_TOO_SMALL));
    }
    // SAFETY: guaranteed by the caller (see # Safety).
    let buffer = unsafe { slice_mut(buffer.cast::<u8>(), size, "buffer")? };
    buffer[..bytes.len()].copy_from_slice(bytes);
    Ok(())
}
