//! Gestures of a host's own: frames of a clip.

use std::fmt;

use super::curve::ease;
use super::hand::mirrored;
use super::set::{GestureParts, check_name};
use crate::error::LoadError;
use crate::memory;
use crate::motion::rotation::{Quat, normalized, slerp};
use crate::motion::skeleton::{FIRST_FINGER, JOINTS};
use crate::state::Fingerprint;

/// Most frames of a gesture: a minute at 60 a second.
pub const MAX_GESTURE_FRAMES: usize = 3600;
/// Longest time in which a clip comes in, and in which it goes out, seconds.
const IN: f32 = 0.4;
const OUT: f32 = 0.55;

/// A gesture of a host's own, made of a clip's frames. See [`Gestures::add`](super::Gestures::add).
#[derive(Clone)]
pub struct Gesture {
    name: String,
    rate: f32,
    frames: Box<[[Quat; JOINTS]]>,
    stroke: f32,
    parts: GestureParts,
}

impl fmt::Debug for Gesture {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, rate, frames, stroke, parts } = self;
        let frames = frames.len();
        f.debug_struct("Gesture")
            .field("name", name)
            .field("rate", rate)
            .field("frames", &frames)
            .field("stroke", stroke)
            .field("parts", parts)
            .finish()
    }
}

impl Gesture {
    /// A gesture of frames, `rate` of them a second: the rotation of each joint of
    /// [`JOINT_NAMES`](crate::JOINT_NAMES), relative to its parent, x, y, z, w, with the avatar
    /// looking along +Z, and all joints at rest with the arms held out. Of these the joints of
    /// `parts` are shown; where the body stands and goes stays the model's.
    ///
    /// The stroke is `stroke` seconds after the first frame. The clip comes in over its first 0.4
    /// seconds, or up to its stroke if that is earlier, and goes out over its last 0.55 seconds.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the name is none of 1 to 64 letters, digits, `_`, `-` and
    /// spaces, there are fewer than 2 or more than [`MAX_GESTURE_FRAMES`] frames, the rate is not 1
    /// to 240, the stroke is outside the clip, a number is not finite, or no part is named;
    /// [`LoadError::Memory`].
    pub fn new(
        name: &str,
        rate: f32,
        frames: &[[Quat; JOINTS]],
        stroke: f32,
        parts: GestureParts,
    ) -> Result<Self, LoadError> {
        check_name(name)?;
        let refuse = |key: &str, problem: String| Err(LoadError::config(key, format!("gesture {name:?}: {problem}")));
        if !(1.0..=240.0).contains(&rate) {
            return refuse("rate", format!("expected 1 to 240 frames a second, got {rate}"));
        }
        if !(2..=MAX_GESTURE_FRAMES).contains(&frames.len()) {
            return refuse("frames", format!("expected 2 to {MAX_GESTURE_FRAMES}, got {}", frames.len()));
        }
        if !frames.iter().flatten().flatten().all(|value| value.is_finite()) {
            return refuse("frames", "a rotation is not finite".to_owned());
        }
        let seconds = (frames.len() - 1) as f32 / rate;
        if !(0.0..=seconds).contains(&stroke) {
            return refuse("stroke", format!("expected 0 to {seconds:.3} s, got {stroke}"));
        }
        if parts == GestureParts::NONE {
            return refuse("parts", "it moves no part".to_owned());
        }
        let frames = memory::catch(|| memory::collected(frames.iter().map(|frame| frame.map(normalized))))?.into();
        Ok(Self { name: name.to_owned(), rate, frames, stroke, parts })
    }

    /// A gesture of the animation in a `.glb` or `.vrm` file's `bytes`, or a `.gltf` file's with its data
    /// inside: the one of a name, or the first. Its character may be any that [`Mapping::closest`](crate::Mapping::closest) knows, or
    /// one with VRM's table of bones; the motion is brought to `skeleton`, the
    /// [model's](crate::Config::skeleton), at 30 frames a second. Without a `stroke` it is in the
    /// middle.
    ///
    /// # Errors
    /// [`LoadError::Config`] where the file is none, what of it is not as the format has it, which
    /// bones were not found, and as for [`Self::new`]; [`LoadError::Memory`].
    #[cfg(feature = "retarget")]
    pub fn from_glb(
        name: &str,
        bytes: &[u8],
        animation: Option<&str>,
        skeleton: &crate::config::Skeleton,
        stroke: Option<f32>,
        parts: GestureParts,
    ) -> Result<Self, LoadError> {
        use crate::glb::clip::{RATE, read};
        check_name(name)?;
        let frames = memory::catch(|| read(bytes, animation, skeleton))?
            .map_err(|problem| LoadError::config("file", format!("gesture {name:?}: {problem}")))?;
        let middle = 0.5 * frames.len().saturating_sub(1) as f32 / RATE;
        Self::new(name, RATE, &frames, stroke.unwrap_or(middle), parts)
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Parts that it moves.
    pub fn parts(&self) -> GestureParts {
        self.parts
    }

    /// Seconds from its first frame to its last.
    pub fn seconds(&self) -> f32 {
        (self.frames.len() - 1) as f32 / self.rate
    }

    /// Seconds from its first frame to its stroke.
    pub fn stroke(&self) -> f32 {
        self.stroke
    }

    /// When it begins to go out.
    pub(super) fn leaves(&self) -> f32 {
        (self.seconds() - OUT).max(self.stroke).min(self.seconds())
    }

    /// How much of it is shown `t` seconds after its first frame, 0 to 1.
    pub(super) fn weight(&self, t: f32) -> f32 {
        let into = IN.min(if self.stroke > 0.1 { self.stroke } else { IN }).min(self.leaves().max(0.1));
        let out = (self.seconds() - self.leaves()).max(1e-3);
        ease(t / into) * (1.0 - ease((t - self.leaves()) / out))
    }

    /// Turns the joints of its parts to where they are `t` seconds after its first frame, by
    /// `share` of the way.
    pub(super) fn apply(&self, rotations: &mut [Quat; JOINTS], t: f32, share: f32, is_mirrored: bool) {
        let at = (t * self.rate).clamp(0.0, (self.frames.len() - 1) as f32);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within the clip")]
        let first = (at as usize).min(self.frames.len() - 2);
        let (from, to) = (&self.frames[first], &self.frames[first + 1]);
        let parts = if is_mirrored { self.parts.mirrored() } else { self.parts };
        for (joint, q) in rotations.iter_mut().enumerate() {
            if !part_of(joint).is_some_and(|part| parts.contains(part)) {
                continue;
            }
            let source = if is_mirrored { other_side(joint) } else { joint };
            let wanted = slerp(from[source], to[source], at - first as f32);
            let wanted = if is_mirrored { mirrored(wanted) } else { wanted };
            *q = slerp(*q, wanted, share);
        }
    }

    pub(super) fn add_to(&self, sum: &mut Fingerprint) {
        sum.add(self.name.as_bytes());
        for value in self.frames.iter().flatten().flatten().chain(&[self.rate, self.stroke]) {
            sum.add(&value.to_le_bytes());
        }
        sum.add(&self.parts.bits().to_le_bytes());
    }
}

/// The part that a joint belongs to; the lower body and the jaw belong to none.
fn part_of(joint: usize) -> Option<GestureParts> {
    match joint {
        12 | 15 => Some(GestureParts::HEAD),
        3 | 6 | 9 => Some(GestureParts::TRUNK),
        13 | 16 | 18 | 20 => Some(GestureParts::LEFT_ARM),
        14 | 17 | 19 | 21 => Some(GestureParts::RIGHT_ARM),
        FIRST_FINGER.. if joint < FIRST_FINGER + 15 => Some(GestureParts::LEFT_ARM),
        FIRST_FINGER.. => Some(GestureParts::RIGHT_ARM),
        _ => None,
    }
}

/// The same joint of the other side.
fn other_side(joint: usize) -> usize {
    match joint {
        13 | 16 | 18 | 20 => joint + 1,
        14 | 17 | 19 | 21 => joint - 1,
        FIRST_FINGER.. if joint < FIRST_FINGER + 15 => joint + 15,
        FIRST_FINGER.. => joint - 15,
        _ => joint,
    }
}
