//! A frame that owns its memory, and what layers read beside its pose.

use umo_core_base::arousal::ORDINARY;
use umo_core_base::memory::{Arena, Slice};
use umo_core_base::state::{StateError, StatePass};

use crate::pose::Pose;
use crate::rotation::slerp;

/// Upper bound of frame indices: 145 years at 240 frames a second.
pub const MAX_INDEX: u64 = 1 << 40;
/// Upper bound of positions in the pushed audio: 180 years at 192 kHz.
pub const MAX_SAMPLE: u64 = 1 << 50;

/// Data of a frame besides its pose that the layers read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cue {
    /// Root mean square of the frame's sound, full scale 1; 0 without sound.
    pub level: f32,
    /// Arousal of the voice, 0 to 1; [`ORDINARY`] without a voice.
    pub arousal: f32,
    /// Seconds until the next phrase begins; 0 if none is near, below 0 where that cannot be known.
    pub onset: f32,
    /// Model's confidence that each foot joint is planted, 0 to 1: left ankle and foot, right ankle and
    /// foot.
    pub contacts: [f32; 4],
    /// 1 where a prompt says what the body does, else 0.
    pub prompted: f32,
}

impl Default for Cue {
    /// A frame without sound.
    fn default() -> Self {
        Self { level: 0.0, arousal: ORDINARY, onset: 0.0, contacts: [0.0; 4], prompted: 0.0 }
    }
}

/// A frame that owns its memory.
#[derive(Clone, Debug)]
pub struct OwnedFrame {
    /// Index in the stream.
    pub index: u64,
    /// Sample frame of the stream's audio that the frame belongs to.
    pub sample: u64,
    /// Rotations relative to the parents; root translation in metres.
    pub pose: Pose,
    /// Face values, in the order of the model's names.
    pub face: Slice<f32>,
    /// Inputs of the layers besides the pose.
    pub cue: Cue,
}

impl OwnedFrame {
    /// Creates frame 0 of a stream with this pose and face.
    #[inline]
    pub fn new(pose: Pose, face: &[f32]) -> Self {
        Self { index: 0, sample: 0, pose, face: Arena::system().copied(face), cue: Cue::default() }
    }

    /// Returns a copy in memory of `arena`.
    #[inline]
    pub fn clone_in(&self, arena: &Arena) -> Self {
        Self { face: arena.copied(&self.face), ..*self }
    }

    /// Describes the frame.
    #[inline]
    pub fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.number("frame index", &mut self.index, 2 * MAX_INDEX)?;
        pass.number("frame's sample", &mut self.sample, 2 * MAX_SAMPLE)?;
        pass.rotations(&mut self.pose.rotations)?;
        pass.places(&mut self.pose.translation)?;
        pass.f32s(std::slice::from_mut(&mut self.cue.level))?;
        pass.share(&mut self.cue.arousal)?;
        pass.within(&mut self.cue.onset, -1.0..=1.0)?;
        pass.moderate(&mut self.cue.contacts)?;
        pass.share(&mut self.cue.prompted)?;
        pass.moderate(&mut self.face)
    }

    /// Takes over pose, face and cue, without allocating.
    #[inline]
    pub fn take(&mut self, index: u64, (pose, face): (&Pose, &[f32]), cue: Cue, sample: u64) {
        (self.index, self.sample, self.pose, self.cue) = (index, sample, *pose, cue);
        self.face.copy_from_slice(face);
    }

    /// Stands where `other` stands.
    #[inline]
    pub fn stay_at(&mut self, other: [f32; 3]) {
        (self.pose.translation[0], self.pose.translation[2]) = (other[0], other[2]);
    }

    /// Copies `other` without allocating.
    #[inline]
    pub fn copy(&mut self, other: &Self) {
        (self.index, self.sample, self.pose, self.cue) = (other.index, other.sample, other.pose, other.cue);
        self.face.copy_from_slice(&other.face);
    }

    /// Interpolates the pose at `t` between `a` and `b`; copies one of them exactly at 0 and 1.
    #[inline]
    pub fn between(&mut self, a: &Self, b: &Self, t: f32) {
        match t {
            _ if t <= 0.0 => self.pose_of(a),
            _ if t >= 1.0 => self.pose_of(b),
            _ => {
                let pairs = a.pose.rotations.iter().zip(&b.pose.rotations);
                self.pose.rotations.iter_mut().zip(pairs).for_each(|(q, (&a, &b))| *q = slerp(a, b, t));
                mixed(&mut self.pose.translation, &a.pose.translation, &b.pose.translation, t);
                mixed(&mut self.face, &a.face, &b.face, t);
            }
        }
    }

    /// Moves by `1 - t` towards `from`, the face by `1 - t_face`; at 1 nothing changes.
    #[inline]
    pub fn ease_from(&mut self, from: &Self, t: f32, t_face: f32) {
        let ease = |to: &mut [f32], from: &[f32], t: f32| {
            if t < 1.0 {
                to.iter_mut().zip(from).for_each(|(to, from)| *to = from + (*to - from) * t);
            }
        };
        if t < 1.0 {
            let pairs = self.pose.rotations.iter_mut().zip(&from.pose.rotations);
            pairs.for_each(|(q, &from)| *q = slerp(from, *q, t));
        }
        ease(&mut self.pose.translation, &from.pose.translation, t);
        ease(&mut self.face, &from.face, t_face);
    }

    /// Copies pose and face of `other`.
    #[inline]
    pub fn pose_of(&mut self, other: &Self) {
        self.pose = other.pose;
        self.face.copy_from_slice(&other.face);
    }
}

/// Interpolates `out` at `t` between `a` and `b`.
#[inline]
pub fn mixed(out: &mut [f32], a: &[f32], b: &[f32], t: f32) {
    out.iter_mut().zip(a.iter().zip(b)).for_each(|(out, (a, b))| *out = a + (b - a) * t);
}
