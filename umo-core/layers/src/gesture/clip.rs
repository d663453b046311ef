//! The host's own gestures, made of a clip's frames.

use std::fmt;

use umo_core_base::error::LoadError;
use umo_core_base::memory;
use umo_core_base::state::Fingerprint;
use umo_core_pose::clip::MAX_GESTURE_FRAMES;
use umo_core_pose::rotation::{Quat, normalized, slerp};
use umo_core_pose::skeleton::{FIRST_FINGER, JOINTS};

use super::curve::ease;
use super::set::{GestureParts, check_name};
use crate::rig::mirrored;

/// Longest fade-in and fade-out of a clip, seconds.
const FADE_IN_SECONDS: f32 = 0.4;
const FADE_OUT_SECONDS: f32 = 0.55;

/// Gesture of the host's own, made of a clip's frames. See [`Gestures::add`](super::Gestures::add).
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
    /// Creates a gesture from frames, `rate` of them a second. Each has the rotation of every joint of
    /// [`JOINT_NAMES`](umo_core_pose::skeleton::JOINT_NAMES), relative to its parent, x, y, z, w; the avatar looks along +Z,
    /// and at rest the arms are held out. Only the joints of `parts` are shown; position and stance of the
    /// body stay the model's.
    ///
    /// The stroke is `stroke` seconds after the first frame. The clip fades in over its first 0.4 seconds,
    /// or until its stroke if that is earlier, and fades out over its last 0.55 seconds.
    ///
    /// # Errors
    /// [`LoadError::Argument`] if the name is not 1 to 64 bytes of letters, digits, `_`, `-` and spaces, there
    /// are fewer than 2 or more than [`MAX_GESTURE_FRAMES`] frames, the rate is not 1 to 240, the stroke is
    /// outside the clip, a number is not finite, or no part is given; [`LoadError::Memory`].
    pub fn new(
        name: &str,
        rate: f32,
        frames: &[[Quat; JOINTS]],
        stroke: f32,
        parts: GestureParts,
    ) -> Result<Self, LoadError> {
        check_name(name)?;
        let refuse =
            |key: &'static str, problem: String| Err(LoadError::argument(key, format!("gesture {name:?}: {problem}")));
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
            return refuse("parts", "it moves no joint".to_owned());
        }
        let frames = memory::catch(|| memory::collected(frames.iter().map(|frame| frame.map(normalized))))?.into();
        Ok(Self { name: name.to_owned(), rate, frames, stroke, parts })
    }

    /// Creates a gesture from an animation in the `bytes` of a `.glb` or `.vrm` file, or of a `.gltf` file
    /// with embedded data: the animation of the given name, or the first. Its character may be any that
    /// [`Mapping::closest`](umo_core_rig::retarget::Mapping::closest) recognizes, or one with VRM's table of bones. The motion
    /// is retargeted to `skeleton`, the model's, at 30 frames a second. Without a
    /// `stroke`, it is in the middle.
    ///
    /// # Errors
    /// [`LoadError::Argument`] if the file is not glTF, violates the format, or lacks bones, and as for
    /// [`Self::new`]; [`LoadError::Memory`]. The message names the violation or the missing bones.
    #[cfg(feature = "retarget")]
    pub fn from_glb(
        name: &str,
        bytes: &[u8],
        animation: Option<&str>,
        skeleton: &umo_core_pose::skeleton::Skeleton,
        stroke: Option<f32>,
        parts: GestureParts,
    ) -> Result<Self, LoadError> {
        use umo_core_rig::glb::clip::{RATE, read};
        check_name(name)?;
        let frames = memory::catch(|| read(bytes, animation, skeleton))?
            .map_err(|problem| LoadError::argument("file", format!("gesture {name:?}: {problem}")))?;
        let middle = 0.5 * frames.len().saturating_sub(1) as f32 / RATE;
        Self::new(name, RATE, &frames, stroke.unwrap_or(middle), parts)
    }

    /// Name of the gesture.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Parts that the gesture moves.
    pub fn parts(&self) -> GestureParts {
        self.parts
    }

    /// Duration from the first frame to the last, seconds.
    pub fn seconds(&self) -> f32 {
        (self.frames.len() - 1) as f32 / self.rate
    }

    /// Time of the stroke after the first frame, seconds.
    pub fn stroke(&self) -> f32 {
        self.stroke
    }

    /// Start of the fade-out after the first frame, seconds.
    pub(super) fn leaves(&self) -> f32 {
        (self.seconds() - FADE_OUT_SECONDS).max(self.stroke).min(self.seconds())
    }

    /// Weight of the clip `t` seconds after its first frame, 0 to 1.
    pub(super) fn weight(&self, t: f32) -> f32 {
        let into = FADE_IN_SECONDS
            .min(if self.stroke > 0.1 { self.stroke } else { FADE_IN_SECONDS })
            .min(self.leaves().max(0.1));
        let out = (self.seconds() - self.leaves()).max(1e-3);
        ease(t / into) * (1.0 - ease((t - self.leaves()) / out))
    }

    /// Blends the joints of its parts by `share` towards their rotations `t` seconds after the first
    /// frame.
    #[doc(hidden)]
    pub fn apply(&self, rotations: &mut [Quat; JOINTS], t: f32, share: f32, is_mirrored: bool) {
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

/// Returns the part that a joint belongs to; `None` for the lower body and the jaw.
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

/// Returns the corresponding joint of the other side.
fn other_side(joint: usize) -> usize {
    match joint {
        13 | 16 | 18 | 20 => joint + 1,
        14 | 17 | 19 | 21 => joint - 1,
        FIRST_FINGER.. if joint < FIRST_FINGER + 15 => joint + 15,
        FIRST_FINGER.. => joint - 15,
        _ => joint,
    }
}
