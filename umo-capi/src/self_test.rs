//! Self-test of the machine that the library is installed on.

use std::ffi::c_char;

use umo_core::MAX_THREADS;
use umo_core_base::{memory, thread};

use crate::ffi::{self, guard, put, wanted};
use crate::model::{UmoModel, get};
use crate::status::{Failure, UMO_STATUS_BUFFER_TOO_SMALL, UmoStatus};

/// Maximum length in bytes of a self-test's report, including its terminating zero.
pub const UMO_SELF_TEST_SIZE: usize = 8192;

/// Memory for the self-test's small allocations: operands, texts, a voice. An engine checks its own.
const MEMORY: usize = 32 << 20;

/// Tests this machine with a model, for about 10 seconds or less. Every kernel of every back-end that the processor
/// supports is compared with its scalar reference. The model's motion is compared with recorded motion, or for a model
/// without a record with a second run. The model's speed is measured if the library has threads and a clock. `passed`
/// is 1 if no fault was found. `report` is a text of several lines: processor, comparisons, faults, speed, and changes
/// that would make it faster. It contains no path, host name or user name. `size` is at least `UMO_SELF_TEST_SIZE`.
///
/// Threads: any but the audio thread. Allocates, starts threads, and waits for them.
/// Errors: `NULL_POINTER`, `INVALID_HANDLE`, `BUFFER_TOO_SMALL` (nothing was tested), `OUT_OF_MEMORY`. Faults found by
/// the test are not errors of the call.
///
/// # Safety
/// `passed` is NULL or writable; `report` is NULL or has `size` writable bytes.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_self_test(
    model: *const UmoModel,
    passed: *mut u32,
    report: *mut c_char,
    size: usize,
) -> UmoStatus {
    guard(|| {
        wanted(passed, "passed")?;
        wanted(report, "report")?;
        if size < UMO_SELF_TEST_SIZE {
            let what = format_args!("there is room for {size} bytes, a report has up to {UMO_SELF_TEST_SIZE}");
            return Err(Failure::new(UMO_STATUS_BUFFER_TOO_SMALL, what));
        }
        // SAFETY: guaranteed by the caller (see # Safety).
        let buffer = unsafe { ffi::slice_mut(report.cast::<u8>(), size, "report")? };
        let model = std::sync::Arc::clone(&get(model)?.model);
        memory::check(MEMORY)?;
        let found = umo_self_test::run(&model, thread::available().min(MAX_THREADS));
        let mut text = found.to_string();
        text.truncate(text.floor_char_boundary(UMO_SELF_TEST_SIZE - 1));
        buffer[..text.len()].copy_from_slice(text.as_bytes());
        buffer[text.len()] = 0;
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { put(passed, "passed", u32::from(found.passed())) }
    })
}
