//! Parameters of a running session, by number.

use std::ffi::{CStr, c_char};

use umo_core::{Attention, Idle, Layer, LipShape, MAX_GAIN, MAX_OUTPUT_DELAY, Mood, Part, Sampling, Session};

use crate::ffi::{self, Sized32, guard};
use crate::status::{Failure, UmoStatus};

/// Sampling temperature: 0 always takes the likeliest code; the model's default is the value it was tuned for.
pub const UMO_PARAMETER_TEMPERATURE: u32 = 1;
/// Top-k sampling: number of the likeliest codes to sample from; 0 for all.
pub const UMO_PARAMETER_TOP_K: u32 = 2;
/// Top-p sampling: samples from the likeliest codes that together reach this probability.
pub const UMO_PARAMETER_TOP_P: u32 = 3;
/// Idle mode, while no audio comes: one of `UMO_IDLE_…`.
pub const UMO_PARAMETER_IDLE: u32 = 4;
/// Gain of the face's motion, jaw and eyes included: 0 is at rest, 1 as computed, 2 exaggerated.
pub const UMO_PARAMETER_GAIN_FACE: u32 = 16;
/// Gain of the fingers' motion.
pub const UMO_PARAMETER_GAIN_HANDS: u32 = 17;
/// Gain of the motion of spine, neck, head and arms.
pub const UMO_PARAMETER_GAIN_UPPER: u32 = 18;
/// Gain of the motion of pelvis and legs, and of the body through the world.
pub const UMO_PARAMETER_GAIN_LOWER: u32 = 19;

/// Attention of the avatar: one of `UMO_ATTENTION_…`.
pub const UMO_PARAMETER_ATTENTION: u32 = 5;
/// Delay of the output device in seconds, from playing a sound to hearing it: `umo_session_sample_pose`
/// shows a pose that much earlier. 0 to 2; some 0.2 for Bluetooth.
pub const UMO_PARAMETER_OUTPUT_DELAY: u32 = 6;
/// Activity of the hands, 0 to 1: how often they leave rest. 0.5 is the default; at 1 they hardly rest, at 0 hardly rise.
pub const UMO_PARAMETER_ACTIVITY: u32 = 7;
/// Expression, 0 to 1: how far body and face follow the arousal of the voice. 0.5 is the default, 0 ignores the voice.
pub const UMO_PARAMETER_EXPRESSION: u32 = 8;
/// Strength of the layer of blinks, gaze and lids over the model's motion, 0 to 1.
pub const UMO_PARAMETER_LAYER_GAZE: u32 = 32;
/// Strength of breath, sway, weight shifts and fingers, and of hands at rest between gestures.
pub const UMO_PARAMETER_LAYER_IDLE: u32 = 33;
/// Strength of the asymmetry between the face's left and right.
pub const UMO_PARAMETER_LAYER_ASYMMETRY: u32 = 34;
/// Strength of nods on accents, and while listening.
pub const UMO_PARAMETER_LAYER_NODS: u32 = 35;
/// Strength of the mood's face and posture; without a mood, strength of removing a frown that no mood asked
/// for.
pub const UMO_PARAMETER_LAYER_MOOD: u32 = 36;
/// Strength of planted feet, steps, and the root's return to where it stood.
pub const UMO_PARAMETER_LAYER_FEET: u32 = 37;
/// Strength of trunk, shoulders and legs that go with the hands.
pub const UMO_PARAMETER_LAYER_BODY: u32 = 38;

/// Speaking while its own audio is heard, otherwise idle; in a scene, and after `umo_session_push_other_audio`, also
/// listening.
pub const UMO_ATTENTION_AUTO: u32 = 0;
/// Nothing in particular.
pub const UMO_ATTENTION_IDLE: u32 = 1;
/// The one who speaks: the avatar looks there, nods, and raises its brows.
pub const UMO_ATTENTION_LISTENING: u32 = 2;
/// An answer to give: the avatar looks away.
pub const UMO_ATTENTION_THINKING: u32 = 3;
/// Its own speech.
pub const UMO_ATTENTION_SPEAKING: u32 = 4;

/// No mood: the model's face without its frown.
pub const UMO_MOOD_NEUTRAL: u32 = 0;
/// Joy.
pub const UMO_MOOD_JOY: u32 = 1;
/// Sadness.
pub const UMO_MOOD_SAD: u32 = 2;
/// Anger.
pub const UMO_MOOD_ANGRY: u32 = 3;
/// Surprise.
pub const UMO_MOOD_SURPRISED: u32 = 4;
/// Disgust.
pub const UMO_MOOD_DISGUSTED: u32 = 5;
/// Fear.
pub const UMO_MOOD_AFRAID: u32 = 6;

/// The lips meet: p, b, m.
pub const UMO_LIPS_CLOSED: u32 = 0;
/// The lower lip is at the upper teeth: f, v.
pub const UMO_LIPS_TEETH: u32 = 1;
/// The lips are rounded: w, and vowels such as that of "boot".
pub const UMO_LIPS_ROUND: u32 = 2;

/// The last pose is held.
pub const UMO_IDLE_HOLD: u32 = 0;
/// `umo_session_sample_pose` eases to the rest pose.
pub const UMO_IDLE_REST: u32 = 1;
/// The model runs on silence.
pub const UMO_IDLE_LIVE: u32 = 2;

/// The parameter takes only whole numbers.
pub const UMO_PARAMETER_WHOLE: u32 = 1;

/// Description of a parameter. Set `struct_size`; `umo_parameter_get_info` writes the rest.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct UmoParameterInfo {
    /// `sizeof(umo_parameter_info)`.
    pub struct_size: u32,
    /// Number of the parameter, `UMO_PARAMETER_…`.
    pub id: u32,
    /// `UMO_PARAMETER_WHOLE` or 0.
    pub flags: u32,
    /// Zero.
    pub reserved: u32,
    /// Smallest value.
    pub minimum: f64,
    /// Largest value.
    pub maximum: f64,
    /// Name of the parameter: static.
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

/// All parameters; every range begins at 0.
#[rustfmt::skip]
const PARAMETERS: [Parameter; 19] = [
    Parameter { id: UMO_PARAMETER_TEMPERATURE, name: c"temperature", maximum: 100.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_TOP_K, name: c"top_k", maximum: 65535.0, flags: UMO_PARAMETER_WHOLE },
    Parameter { id: UMO_PARAMETER_TOP_P, name: c"top_p", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_IDLE, name: c"idle", maximum: UMO_IDLE_LIVE as f64, flags: UMO_PARAMETER_WHOLE },
    Parameter { id: UMO_PARAMETER_ATTENTION, name: c"attention", maximum: UMO_ATTENTION_SPEAKING as f64, flags: UMO_PARAMETER_WHOLE },
    Parameter { id: UMO_PARAMETER_OUTPUT_DELAY, name: c"output_delay", maximum: MAX_OUTPUT_DELAY, flags: 0 },
    Parameter { id: UMO_PARAMETER_ACTIVITY, name: c"activity", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_EXPRESSION, name: c"expression", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_FACE, name: c"gain_face", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_HANDS, name: c"gain_hands", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_UPPER, name: c"gain_upper", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_GAIN_LOWER, name: c"gain_lower", maximum: MAX_GAIN as f64, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_GAZE, name: c"layer_gaze", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_IDLE, name: c"layer_idle", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_ASYMMETRY, name: c"layer_asymmetry", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_NODS, name: c"layer_nods", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_MOOD, name: c"layer_mood", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_FEET, name: c"layer_feet", maximum: 1.0, flags: 0 },
    Parameter { id: UMO_PARAMETER_LAYER_BODY, name: c"layer_body", maximum: 1.0, flags: 0 },
];

fn find(id: u32) -> Result<&'static Parameter, Failure> {
    let unknown = || Failure::argument(format_args!("parameter {id} is not one of UMO_PARAMETER_…"));
    PARAMETERS.iter().find(|parameter| parameter.id == id).ok_or_else(unknown)
}

/// Converts a number to an idle mode.
pub(crate) fn idle(number: u32) -> Result<Idle, Failure> {
    match number {
        UMO_IDLE_HOLD => Ok(Idle::Hold),
        UMO_IDLE_REST => Ok(Idle::Rest),
        UMO_IDLE_LIVE => Ok(Idle::Live),
        _ => Err(Failure::argument(format_args!("idle {number} is not one of UMO_IDLE_…"))),
    }
}

/// Converts a number to an attention.
fn attention(number: u32) -> Result<Attention, Failure> {
    let unknown = || Failure::argument(format_args!("attention {number} is not one of UMO_ATTENTION_…"));
    Attention::ALL.get(number as usize).copied().ok_or_else(unknown)
}

/// Converts a number to a mood.
pub(crate) fn mood(number: u32) -> Result<Mood, Failure> {
    let unknown = || Failure::argument(format_args!("mood {number} is not one of UMO_MOOD_…"));
    Mood::ALL.get(number as usize).copied().ok_or_else(unknown)
}

/// Converts a number to a shape of the lips.
pub(crate) fn lips(number: u32) -> Result<LipShape, Failure> {
    let unknown = || Failure::argument(format_args!("shape {number} is not one of UMO_LIPS_…"));
    LipShape::ALL.get(number as usize).copied().ok_or_else(unknown)
}

/// Returns the layer whose strength a parameter sets.
fn layer(id: u32) -> Option<Layer> {
    let number = id.checked_sub(UMO_PARAMETER_LAYER_GAZE)?;
    Layer::ALL.get(number as usize).copied()
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
        UMO_PARAMETER_ATTENTION => session.set_attention(attention(value as u32)?)?,
        UMO_PARAMETER_OUTPUT_DELAY => session.set_output_delay(value)?,
        UMO_PARAMETER_ACTIVITY => session.set_activity(value as f32)?,
        UMO_PARAMETER_EXPRESSION => session.set_expression(value as f32)?,
        _ => match layer(id) {
            Some(layer) => session.set_layer(layer, value as f32)?,
            None => session.set_gain(part(id), value as f32)?,
        },
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
        UMO_PARAMETER_ATTENTION => f64::from(session.attention()? as u8),
        UMO_PARAMETER_OUTPUT_DELAY => session.output_delay(),
        UMO_PARAMETER_ACTIVITY => session.activity()?.into(),
        UMO_PARAMETER_EXPRESSION => session.expression()?.into(),
        _ => match layer(id) {
            Some(layer) => session.layer(layer)?.into(),
            None => session.gain(part(id)).into(),
        },
    })
}

/// Gets the description of the parameter at `index`, from 0; `INVALID_ARGUMENT` past the last one.
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
        // SAFETY: guaranteed by the caller (see # Safety).
        unsafe { ffi::write(info, "info", &value) }
    })
}
