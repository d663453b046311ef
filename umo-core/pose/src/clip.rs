//! A whole motion in memory, and its conversion to channels (SPEC 2.7, EMAGE's lower-body channels).

use umo_core_base::memory::filled;

use crate::face::Face;
use crate::part::{Part, PerPart};
use crate::pose::{Assembly, FIRST_CONTACT, FIRST_FACE_VALUE, HEIGHT, Pose, VELOCITY_X, VELOCITY_Z};
use crate::rotation::{Quat, slerp};
use crate::skeleton::{JOINTS, Skeleton, joint_places, joints_of};

/// Upper bound on the frames of a gesture: one minute at 60 a second.
pub const MAX_GESTURE_FRAMES: usize = 3600;

/// Left ankle and foot, right ankle and foot, in the order of the contact channels.
const CONTACT_JOINTS: [usize; 4] = [7, 10, 8, 11];

/// Displacement per frame below which a foot joint counts as standing, in metres.
const STANDING: f32 = 0.01;

/// A motion: the input of the writers of every format.
#[derive(Clone, Debug, PartialEq)]
pub struct Clip {
    /// Frames per second.
    pub frame_rate: f32,
    /// Bone hierarchy and offsets.
    pub skeleton: Skeleton,
    /// Names and kind of the face values.
    pub face: Face,
    /// Unit quaternions of 55 joints, relative to their parents, for each frame.
    pub rotations: Vec<[Quat; JOINTS]>,
    /// Position of the root for each frame, metres.
    pub translation: Vec<[f32; 3]>,
    /// `[frames, face.names]`
    pub face_values: Vec<f32>,
}

impl Clip {
    /// Creates an empty motion. `frame_rate`: frames per second.
    pub fn new(frame_rate: f32, skeleton: Skeleton, face: Face) -> Self {
        let (rotations, translation, face_values) = Default::default();
        Self { frame_rate, skeleton, face, rotations, translation, face_values }
    }

    /// Appends a frame. Panics if the length of `face` differs from the number of names of the clip's face.
    pub fn push(&mut self, pose: &Pose, face: &[f32]) {
        assert_eq!(face.len(), self.face.names.len(), "one value per name of the face");
        self.rotations.push(pose.rotations);
        self.translation.push(pose.translation);
        self.face_values.extend_from_slice(face);
    }

    /// Number of frames.
    pub fn len(&self) -> usize {
        self.rotations.len()
    }

    /// Whether there are no frames.
    pub fn is_empty(&self) -> bool {
        self.rotations.is_empty()
    }

    /// Pose of frame `index`. Panics if `index` is out of range.
    pub fn pose(&self, index: usize) -> Pose {
        Pose { rotations: self.rotations[index], translation: self.translation[index] }
    }

    /// Face values of frame `index`. Panics if `index` is out of range.
    pub fn face(&self, index: usize) -> &[f32] {
        let values = self.face.names.len();
        &self.face_values[index * values..(index + 1) * values]
    }

    /// Parent of a joint; `None` for the root.
    pub fn parent(&self, joint: usize) -> Option<usize> {
        usize::try_from(self.skeleton.parents[joint]).ok()
    }

    /// Joints whose parent is `joint`.
    pub fn children(&self, joint: usize) -> impl Iterator<Item = usize> {
        (joint + 1..JOINTS).filter(move |&child| self.parent(child) == Some(joint))
    }

    /// Position of the root joint in frame `index`. Panics if `index` is out of range.
    pub fn root_position(&self, index: usize) -> [f32; 3] {
        let (rest, moved) = (self.skeleton.offsets_m[0], self.translation[index]);
        std::array::from_fn(|axis| rest[axis] + moved[axis])
    }

    /// Checks that the motion is consistent. Writers index and divide without further checks.
    ///
    /// # Errors
    /// A description of the inconsistency.
    pub fn check(&self) -> Result<(), &'static str> {
        let (frames, tree) = (self.len(), &self.skeleton);
        let rules = [
            (frames > 0, "it has no frames"),
            (self.frame_rate.is_finite() && self.frame_rate > 0.0, "its frame rate is not a positive number"),
            (self.translation.len() == frames, "translation and rotations differ in length"),
            (self.face_values.len() == frames * self.face.names.len(), "face values are not frames times channels"),
            (tree.parents.len() == JOINTS && tree.offsets_m.len() == JOINTS, "its skeleton has not 55 joints"),
            (is_tree(&tree.parents), "a joint's parent does not come before it"),
            (self.is_finite(), "it holds a number that is not finite"),
            (self.rotations.iter().flatten().all(is_unit), "a rotation is not a unit quaternion"),
        ];
        rules.into_iter().find(|(holds, _)| !holds).map_or(Ok(()), |(_, what)| Err(what))
    }

    fn is_finite(&self) -> bool {
        let rotations = self.rotations.as_flattened().as_flattened();
        let positions = self.translation.as_flattened();
        let offsets = self.skeleton.offsets_m.as_flattened();
        [rotations, positions, offsets, &self.face_values].into_iter().flatten().all(|x| x.is_finite())
    }

    /// Resamples the motion to another frame rate, from its first frame to its last.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, reason = "frame numbers, rounded down on purpose")]
    #[expect(clippy::cast_sign_loss, reason = "frame numbers are not negative")]
    pub fn at_rate(&self, frame_rate: f32) -> Self {
        let step = f64::from(self.frame_rate) / f64::from(frame_rate);
        let mut clip = Self { frame_rate, ..self.clone() };
        if self.is_empty() || step == 1.0 {
            return clip;
        }
        (clip.rotations, clip.translation, clip.face_values) = Default::default();
        let last = self.len() - 1;
        // The small addend keeps a last frame that rounding would lose.
        let frames = (last as f64 / step + 1e-6) as usize + 1;
        let mut face = filled(0.0, self.face.names.len());
        for index in 0..frames {
            let time = (index as f64 * step).min(last as f64);
            let (a, share) = (time as usize, time.fract() as f32);
            let b = (a + 1).min(last);
            let mix = |a: f32, b: f32| a + share * (b - a);
            let (from, to) = (self.pose(a), self.pose(b));
            let pose = Pose {
                rotations: std::array::from_fn(|j| slerp(from.rotations[j], to.rotations[j], share)),
                translation: std::array::from_fn(|i| mix(from.translation[i], to.translation[i])),
            };
            for ((value, &a), &b) in face.iter_mut().zip(self.face(a)).zip(self.face(b)) {
                *value = mix(a, b);
            }
            clip.push(&pose, &face);
        }
        clip
    }

    /// Computes the channels `[frames, channels]` of each part, as input of its encoder.
    ///
    /// The lower body's rotations are followed by the velocity along x, the height and the velocity along z.
    /// Then comes 1 for each ankle and foot that moves less than 1 cm to the next frame, else 0. The velocity
    /// is the one that decoding sums: from a frame to its next, m/s. The last frame repeats the velocity and
    /// contacts of the one before.
    pub fn channels(&self) -> PerPart<Vec<f32>> {
        let mut channels = PerPart::from_fn(|part| filled(0.0, self.len() * self.channels_of(part)));
        for (part, index) in Part::ALL.into_iter().flat_map(|part| (0..self.len()).map(move |index| (part, index))) {
            let width = self.channels_of(part);
            let row = &mut channels[part][index * width..(index + 1) * width];
            Assembly::write_rotations(part, &self.rotations[index], row);
            if part == Part::Face {
                row[FIRST_FACE_VALUE..].copy_from_slice(self.face(index));
            }
        }
        self.write_root(&mut channels.lower);
        channels
    }

    /// Number of channels per frame of a part.
    pub fn channels_of(&self, part: Part) -> usize {
        match part {
            Part::Face => FIRST_FACE_VALUE + self.face.names.len(),
            Part::Hands | Part::Upper => 6 * joints_of(part).count(),
            Part::Lower => FIRST_CONTACT + CONTACT_JOINTS.len(),
        }
    }

    /// Writes root velocity, height and foot contact.
    fn write_root(&self, lower: &mut [f32]) {
        let feet: Vec<[[f32; 3]; 4]> = (0..self.len())
            .map(|index| {
                let places = joint_places(&self.skeleton, &self.pose(index));
                CONTACT_JOINTS.map(|joint| places[joint])
            })
            .collect();
        for (index, row) in lower.chunks_exact_mut(self.channels_of(Part::Lower)).enumerate() {
            let to = (index + 1).min(self.len() - 1);
            let from = to.saturating_sub(1);
            let velocity = |axis: usize| (self.translation[to][axis] - self.translation[from][axis]) * self.frame_rate;
            row[VELOCITY_X] = velocity(0);
            row[HEIGHT] = self.translation[index][1];
            row[VELOCITY_Z] = velocity(2);
            for (contact, (a, b)) in row[FIRST_CONTACT..].iter_mut().zip(feet[from].iter().zip(&feet[to])) {
                let moved: f32 = a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum();
                *contact = if moved.sqrt() < STANDING { 1.0 } else { 0.0 };
            }
        }
    }
}

fn is_tree(parents: &[i32]) -> bool {
    parents.iter().enumerate().all(|(joint, &parent)| {
        if joint == 0 { parent == -1 } else { usize::try_from(parent).is_ok_and(|parent| parent < joint) }
    })
}

fn is_unit(q: &Quat) -> bool {
    let square: f32 = q.iter().map(|x| x * x).sum();
    (square - 1.0).abs() < 1e-3
}
