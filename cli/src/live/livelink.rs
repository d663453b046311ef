//! Faces as packets of the Live Link Face app, for Unreal's Live Link: version 6 of the format, big-endian numbers.
//!
//! | bytes | |
//! |---|---|
//! | 1 | version |
//! | 4, 36 | length of the device's id, and the id, a UUID as text |
//! | 4, n | length of the subject's name, and the name |
//! | 4, 4 | number of the frame since the start, and the subframe, float |
//! | 4, 4 | frames a second: numerator and denominator |
//! | 1 | number of values, 61 |
//! | 4 × 61 | floats: ARKit's 52 blendshapes in Apple's order; yaw, pitch, roll of head, left eye, right eye, radians |

use umo_core::{Config, Pose};
use umo_core_pose::names::ARKIT_NAMES;

use crate::args::Live;
use crate::export::csv;
use crate::failure::Failure;

/// Packet version.
const VERSION: u8 = 6;
/// Upper bound on the bytes of a subject's name.
const MAX_NAME: usize = 64;

/// Builder of face datagrams.
pub(super) struct Sender {
    /// Bytes before the frame number, constant across packets.
    head: Vec<u8>,
    /// Index of each ARKit blendshape among the face's channels.
    places: Vec<usize>,
    frame_rate: u16,
    has_mouth_close: bool,
}

impl Sender {
    pub(super) fn new(config: &Config, args: &Live) -> Result<Self, Failure> {
        let name = &*args.subject;
        if !(1..=MAX_NAME).contains(&name.len()) || !name.bytes().all(|byte| byte == b' ' || byte.is_ascii_graphic()) {
            return Err(Failure::input(format!("--subject {name:?}: expected 1 to {MAX_NAME} characters of ASCII")));
        }
        let places = csv::places(&config.face, &ARKIT_NAMES).map_err(Failure::input)?;
        let mut head = vec![VERSION];
        for text in [&*device(name), name] {
            #[expect(clippy::cast_possible_truncation, reason = "at most `MAX_NAME`")]
            head.extend((text.len() as u32).to_be_bytes());
            head.extend(text.bytes());
        }
        Ok(Self { head, places, frame_rate: args.fps, has_mouth_close: !args.no_mouth_close })
    }

    /// Returns the datagram of a face shown at `seconds`.
    pub(super) fn packet(&self, pose: &Pose, face: &[f32], seconds: f64) -> Vec<u8> {
        let mut packet = self.head.clone();
        let frame = seconds.max(0.0) * f64::from(self.frame_rate);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a day has 5,184,000 frames at 60 a second"
        )]
        packet.extend((frame as u32).to_be_bytes());
        #[expect(clippy::cast_possible_truncation, reason = "the format's numbers are floats")]
        packet.extend((frame.fract() as f32).to_be_bytes());
        packet.extend(u32::from(self.frame_rate).to_be_bytes());
        packet.extend(1_u32.to_be_bytes());
        let mut shapes: [f32; ARKIT_NAMES.len()] =
            std::array::from_fn(|shape| face[self.places[shape]].clamp(0.0, 1.0));
        if !self.has_mouth_close {
            without_mouth_close(&mut shapes);
        }
        #[expect(clippy::cast_possible_truncation, reason = "the format's numbers are floats")]
        let angles = csv::angles(&pose.rotations).map(|angle| angle as f32);
        #[expect(clippy::cast_possible_truncation, reason = "61")]
        packet.push((shapes.len() + angles.len()) as u8);
        packet.extend(shapes.iter().chain(&angles).flat_map(|value| value.to_be_bytes()));
        packet
    }
}

/// Subtracts `mouthClose` from `jawOpen` and sets it to 0.
fn without_mouth_close(shapes: &mut [f32; ARKIT_NAMES.len()]) {
    let place = |name| ARKIT_NAMES.iter().position(|&shape| shape == name).expect("a shape of ARKit's");
    let close = std::mem::take(&mut shapes[place("mouthClose")]);
    let jaw = &mut shapes[place("jawOpen")];
    *jaw = (*jaw - close).max(0.0);
}

/// Returns a device id, derived from the subject and stable across runs.
fn device(subject: &str) -> String {
    // FNV-1a.
    let hash = subject
        .bytes()
        .fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3));
    format!("756D6F00-0000-4000-8000-{:012X}", hash >> 16)
}

#[cfg(test)]
mod tests;
