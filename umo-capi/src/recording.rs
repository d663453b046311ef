//! Level of whole recordings.

use umo_core_base::level::{MAX_CHANNELS, Meter};
use umo_core_model::audio::resample::{MAX_RATE, MIN_RATE};

use crate::ffi::{self, guard, wanted};
use crate::status::{Failure, UmoStatus};

/// Computes the gain of each channel that brings the speech of a whole recording to its normal level, for
/// `count` interleaved samples at `sample_rate` Hz. The gains are 1 for a plain recording. They differ if
/// its level is far from that of speech, if its channels cancel each other, or if only the centre channel
/// (the third, with five channels or more) has speech. Multiply each channel by its gain before you push
/// the samples into a session; `gains` has room for `channels` values, 1 to 64.
///
/// Threads: any but the audio thread. Allocates.
/// Errors: `NULL_POINTER`, `INVALID_ARGUMENT` (a rate or a number of channels out of range, or not a
/// multiple of the channels), `PANIC`.
///
/// # Safety
/// `samples` is NULL or has `count` readable values; `gains` is NULL or has room for `channels` values.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_recording_gains(
    samples: *const f32,
    count: usize,
    sample_rate: u32,
    channels: u32,
    gains: *mut f32,
) -> UmoStatus {
    guard(|| {
        wanted(gains, "gains")?;
        let (rate, width) = (sample_rate as usize, channels as usize);
        if !(MIN_RATE..=MAX_RATE).contains(&rate) {
            return Err(Failure::argument(format_args!("sample_rate {rate}: expected {MIN_RATE} to {MAX_RATE}")));
        }
        if !(1..=MAX_CHANNELS).contains(&width) || !count.is_multiple_of(width) {
            let what = format_args!("{count} samples of {width} channels: expected a multiple of 1 to {MAX_CHANNELS}");
            return Err(Failure::argument(what));
        }
        let mut meter = Meter::new(width, rate);
        // SAFETY: guaranteed by the caller (see # Safety).
        meter.push(unsafe { ffi::slice(samples, count, "samples")? });
        let found = meter.gains((width >= 5).then_some(2));
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::slice_mut(gains, width, "gains")? }.copy_from_slice(found.channels());
        Ok(())
    })
}
