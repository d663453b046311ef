//! What can be set while a session runs, by number.

use std::ffi::{CStr, c_char};

use umo_core::config::Sampling;
use umo_core::part::Part;
use umo_core::session::{Idle, MAX_GAIN, Session};

use crate::ffi::{self, Sized32, guard};
use crate::status::{Failure, UmoStatus};

/// How freely codes are drawn: 0 takes the likeliest always; the model says what it was tuned for.
pub const UMO_PARAMETER_TEMPERATURE: u32 = 1;
/// Only this many of the likeliest codes are drawn from; 0 is all.
pub const UMO_PARAMETER_TOP_K: u32 = 2;
/// Only the likeliest codes that together reach this probability are drawn from.
pub const UMO_PARAMETER_TOP_P: u32 = 3;
/// What is shown while no audio comes: one of `UMO_IDLE_…`.
pub const UMO_PARAMETER_IDLE: u32 = 4;
/// How much the face moves, jaw and eyes included: 0 at rest, 1 as computed, 2 exaggerated.
pub const UMO_PARAMETER_GAIN_FACE: u32 = 16;
/// How much the fingers move.
pub const UMO_PARAMETER_GAIN_HANDS: u32 = 17;
/// How much spine, neck, head and arms move.
pub const UMO_PARAMETER_GAIN_UPPER: u32 = 18;
/// How much pelvis and legs move, and the body through the world.
pub const UMO_PARAMETER_GAIN_LOWER: u32 = 19;

/// The last pose is held.
pub const UMO_IDLE_HOLD: u32 = 0;
/// `umo_session_sample_pose` eases to the rest pose.
pub const UMO_IDLE_REST: u32 = 1;
/// The model runs on silence.
pub const UMO_IDLE_LIVE: u32 = 2;

/// Only whole numbers are allowed.
pub const UMO_PARAMETER_WHOLE: u32 = 1;

/// What a parameter is. Set `struct_size`, the rest is written by `umo_parameter_get_info`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoParameterInfo {
    /// `sizeof(umo_parameter_info)`.
    pub struct_size: u32,
    /// `UMO_PARAMETER_…`.
    pub id: u32,
    /// `UMO_PARAMETER_WHOLE` or 0.
    pub flags: u32,
    /// Zero.
    pub reserved: u32,
    /// Least value.
    pub minimum: f64,
    /// Largest value.
    pub maximum: f64,
    /// Its name: static.
    pub name: *const c_char,
}

// SAFETY: `repr(C)`, starts with its size, numbers and a pointer that may be NULL.
unsafe impl Sized32 for UmoParameterInfo {
    const FIRST: usize = 32 + size_of::<*const c_char>();
}

struct Parameter {
    id: u32,
    name: &'static CStr,
    maximum: f64,
    flags: u32,
}

/// Every parameter, in the order of their numbers; all begin at 0.
#[rustfmt::skip]
const PARAMETERS: [Parameter; 8] = [
    Parameter { id: UMO_PARAMETER_TEMPERATURE, name: c"temperature", maximum: 100.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_TOP_K, name: c"top_k", maximum: 65535.0, flags: UMO_PARAMETER_WHOLE },
    Parameter { id: UMO_PARAMETER_TOP_P, name: c"top_p", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_IDLE, name: c"idle", maximum: UMO_IDLE_LIVE as f64, flags: UMO_PARAMETER_WHOLE },
    Parameter { id: UMO_PARAMETER_GAIN_FACE, name: c"gain_face", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_HANDS, name: c"gain_hands", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_UPPER, name: c"gain_upper", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_LOWER, name: c"gain_lower", maximum: MAX_GAIN as f64, flags: 0 },
];

fn find(id: u32) -> Result<&'static Parameter, Failure> {
    let unknown = || Failure::argument(format_args!("parameter {id} is none of UMO_PARAMETER_…"));
    PARAMETERS.iter().find(|parameter| parameter.id == id).ok_or_else(unknown)
}

/// The idle mode of a number.
pub(crate) fn idle(number: u32) -> Result<Idle, Failure> {
    match number {
        UMO_IDLE_HOLD => Ok(Idle::Hold),
        UMO_IDLE_REST => Ok(Idle::Rest),
        UMO_IDLE_LIVE => Ok(Idle::Live),
        _ => Err(Failure::argument(format_args!("idle {number} is none of UMO_IDLE_…"))),
    }
}

fn part(id: u32) -> Part {
    match id {
        UMO_PARAMETER_GAIN_FACE => Part::Face,
        UMO_PARAMETER_GAIN_HANDS => Part::Hands,
        UMO_PARAMETER_GAIN_UPPER => Part::Upper,
        _ => Part::Lower,
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the range was checked")]
pub(crate) fn set(session: &Session, id: u32, value: f64) -> Result<(), Failure> {
    let parameter = find(id)?;
    let (name, maximum) = (parameter.name.to_str().unwrap_or_default(), parameter.maximum);
    if !(0.0..=maximum).contains(&value) {
        return Err(Failure::argument(format_args!("{name} {value}: expected 0 to {maximum}")));
    }
    if parameter.flags & UMO_PARAMETER_WHOLE != 0 && value.fract() != 0.0 {
        return Err(Failure::argument(format_args!("{name} {value}: expected a whole number")));
    }
    match id {
        UMO_PARAMETER_IDLE => session.set_idle(idle(value as u32)?),
        UMO_PARAMETER_TEMPERATURE => {
            session.set_sampling(Sampling { temperature: value as f32, ..session.sampling()? })?;
        }
        UMO_PARAMETER_TOP_K => session.set_sampling(Sampling { top_k: value as usize, ..session.sampling()? })?,
        UMO_PARAMETER_TOP_P => session.set_sampling(Sampling { top_p: value as f32, ..session.sampling()? })?,
        _ => session.set_gain(part(id), value as f32)?,
    }
    Ok(())
}

#[expect(clippy::cast_precision_loss, reason = "as large a number of codes as there are")]
pub(crate) fn get(session: &Session, id: u32) -> Result<f64, Failure> {
    find(id)?;
    Ok(match id {
        UMO_PARAMETER_IDLE => f64::from(session.idle() as u8),
        UMO_PARAMETER_TEMPERATURE => session.sampling()?.temperature.into(),
        UMO_PARAMETER_TOP_K => session.sampling()?.top_k as f64,
        UMO_PARAMETER_TOP_P => session.sampling()?.top_p.into(),
        _ => session.gain(part(id)).into(),
    })
}

/// What the parameter at `index` is, from 0 on: `INVALID_ARGUMENT` says that there are no more.
///
/// Threads: any. Never allocates, never waits.
/// Errors: `NULL_POINTER`, `STRUCT_SIZE`, `INVALID_ARGUMENT`.
///
/// # Safety
/// `info` is NULL or as long as its `struct_size` says, and writable.
#[unsafe(no_mangle)]
#[must_use]
pub unsafe extern "C" fn umo_parameter_get_info(index: u32, info: *mut UmoParameterInfo) -> UmoStatus {
    guard(|| {
        let none = || Failure::argument(format_args!("parameter {index}: there are {}", PARAMETERS.len()));
        let parameter = PARAMETERS.get(index as usize).ok_or_else(none)?;
        let value = UmoParameterInfo {
            struct_size: 0,
            id: parameter.id,
            flags: parameter.flags,
            reserved: 0,
            minimum: 0.0,
            maximum: parameter.maximum,
            name: parameter.name.as_ptr(),
        };
        // SAFETY: by this function's own clause.
        unsafe { ffi::write(info, "info", &value) }
    })
}
