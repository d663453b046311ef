//! A whole motion in memory, and its conversion back to channels and codes (SPEC 2.7, EMAGE's lower-body
//! channels).

use super::conv::ConvScratch;
use super::pose::{Assembly, FIRST_FACE_VALUE, Pose};
use super::root::{FIRST_CONTACT, HEIGHT, VELOCITY_X, VELOCITY_Z};
use super::rotation::{Quat, slerp};
use super::skeleton::{JOINTS, joint_places};
use super::vq::{MotionScratch, VqEncoder};
use super::{body_channels, widest};
use crate::config::{Channels, Config, Face, PartSpec, Skeleton};
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::memory::filled;
use crate::part::{Part, PerPart};
use crate::weights::Loader;

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
    /// Creates an empty motion with a model's bones and face.
    pub fn new(config: &Config) -> Self {
        Self {
            frame_rate: rate(config),
            skeleton: config.skeleton.clone(),
            face: config.face.clone(),
            rotations: Vec::new(),
            translation: Vec::new(),
            face_values: Vec::new(),
        }
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
            (tree.parents.len() == JOINTS && tree.offsets_m.len() == JOINTS, "its skeleton does not have 55 joints"),
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

    fn channels_of(&self, part: Part) -> usize {
        match part {
            Part::Face => FIRST_FACE_VALUE + self.face.names.len(),
            Part::Hands | Part::Upper => 6 * super::skeleton::joints_of(part).count(),
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

fn rate(config: &Config) -> f32 {
    config.frame_rate as f32
}

/// VQ encoders of the parts, if a model has them.
#[derive(Debug)]
pub struct MotionEncoder {
    /// Parts in the order of the config. The encoder is `None` for an annotation, which is encoded as its
    /// rest codes.
    parts: Vec<(PartSpec, Option<(VqEncoder, Channels)>)>,
    /// Number of channels of each body part.
    widths: PerPart<usize>,
    width: usize,
    frame_rate: f32,
}

impl MotionEncoder {
    /// Loads `vq.{part}.encoder`; returns `None` if the file has no encoders.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor, also if only some of the tensors are present.
    pub fn load(loader: &Loader) -> Result<Option<Self>, LoadError> {
        let config = loader.file().config();
        let parts = config.part_list();
        if !parts.iter().any(|part| loader.file().has_any(&format!("vq.{}.encoder.", part.name))) {
            return Ok(None);
        }
        let load = |part: PartSpec| {
            let channels = part.channels(&config.face);
            let encoder =
                |channels: Channels| Ok::<_, LoadError>((VqEncoder::load(loader, &part, channels.count())?, channels));
            let encoder = channels.map(encoder).transpose()?;
            Ok((part, encoder))
        };
        Ok(Some(Self {
            parts: parts.into_iter().map(load).collect::<Result<_, LoadError>>()?,
            widths: PerPart::from_fn(|part| body_channels(part, &config.face)),
            width: widest(config),
            frame_rate: rate(config),
        }))
    }

    /// Encodes a whole motion's `channels [T, channels]` to codes `[T]` of each part, for a model with the
    /// paper's four parts. Allocates.
    ///
    /// # Errors
    /// [`StepError`] if there are no frames, the parts have different numbers of frames, or the model has
    /// other parts.
    pub fn encode(&self, cx: Compute, channels: PerPart<&[f32]>) -> Result<PerPart<Vec<u16>>, StepError> {
        let mut codes = self.encode_list(cx, channels)?.into_iter();
        let paper = self.parts.iter().map(|(part, _)| part.name.as_str()).eq(Part::ALL.map(Part::name));
        if !paper || self.parts.iter().any(|(part, _)| part.levels > 1) {
            return Err(StepError::Missing("codes of the four parts: its config lists others"));
        }
        Ok(PerPart::from_fn(|_| codes.next().unwrap_or_default()))
    }

    /// Encodes to codes `[T, levels]` of each part of the config; an annotation gets its rest codes.
    /// Allocates.
    ///
    /// # Errors
    /// [`StepError`] if there are no frames, or the parts have different numbers of frames.
    pub fn encode_list(&self, cx: Compute, channels: PerPart<&[f32]>) -> Result<Vec<Vec<u16>>, StepError> {
        let frames = channels.face.len() / self.widths.face;
        if frames == 0 {
            return Err(StepError::Empty("motion frames"));
        }
        let mut scratch = MotionScratch(ConvScratch::new(frames, self.width));
        let encode = |(part, encoder): &(PartSpec, Option<(VqEncoder, Channels)>)| {
            let mut codes = filled(0, frames * part.levels);
            let Some((encoder, places)) = encoder else {
                #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
                codes.iter_mut().zip(part.rest.iter().cycle()).for_each(|(code, &rest)| *code = rest as u16);
                return Ok(codes);
            };
            let (all, width) = (channels[places.part], self.widths[places.part]);
            if all.len() != frames * width {
                return Err(StepError::Disagree("channels and codes have different numbers of frames"));
            }
            let mut own = Vec::with_capacity(frames * encoder.channels());
            for row in all.chunks_exact(width) {
                places.ranges.iter().for_each(|range| own.extend_from_slice(&row[range.clone()]));
            }
            encoder.encode(cx, &mut scratch, &own, &mut codes)?;
            Ok(codes)
        };
        self.parts.iter().map(encode).collect()
    }

    /// Encodes a motion, after resampling it to the model's frame rate.
    ///
    /// # Errors
    /// [`StepError`] if there are no frames, the number of face values differs from the model's, or the frame
    /// rate is not between 1 and 1000 frames a second.
    pub fn encode_clip(&self, cx: Compute, clip: &Clip) -> Result<PerPart<Vec<u16>>, StepError> {
        let channels = self.channels(clip)?;
        self.encode(cx, PerPart::from_fn(|part| &*channels[part]))
    }

    /// Like [`Self::encode_clip`] for a model with any parts, as [`Self::encode_list`].
    ///
    /// # Errors
    /// As [`Self::encode_clip`].
    pub fn encode_clip_list(&self, cx: Compute, clip: &Clip) -> Result<Vec<Vec<u16>>, StepError> {
        let channels = self.channels(clip)?;
        self.encode_list(cx, PerPart::from_fn(|part| &*channels[part]))
    }

    /// Computes the channels of a clip at the model's frame rate.
    fn channels(&self, clip: &Clip) -> Result<PerPart<Vec<f32>>, StepError> {
        if !(1.0..=1000.0).contains(&clip.frame_rate) {
            return Err(StepError::Disagree("the motion's frame rate is not between 1 and 1000"));
        }
        if clip.channels_of(Part::Face) != self.widths.face {
            return Err(StepError::Disagree("the motion's face has another number of values than the model's"));
        }
        Ok(clip.at_rate(self.frame_rate).channels())
    }
}

#[cfg(test)]
mod tests {
    use super::super::rotation::axis_angle_to_quat;
    use super::*;
    use crate::ModelFile;

    #[test]
    fn check_refuses_a_clip_that_contradicts_itself() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors");
        let mut good = Clip::new(ModelFile::open(path.as_ref()).unwrap().config());
        assert_eq!(good.check(), Err("it has no frames"));
        let face = vec![0.5; good.face.names.len()];
        (0..3).for_each(|_| good.push(&Pose::REST, &face));
        assert_eq!(good.check(), Ok(()));
        let broken = |change: fn(&mut Clip)| {
            let mut clip = good.clone();
            change(&mut clip);
            clip.check().unwrap_err()
        };
        assert!(broken(|c| c.frame_rate = 0.0).contains("frame rate"));
        assert!(broken(|c| c.frame_rate = f32::NAN).contains("frame rate"));
        assert!(broken(|c| c.translation.truncate(2)).contains("translation"));
        assert!(broken(|c| c.face_values.truncate(9)).contains("face values"));
        assert!(broken(|c| c.skeleton.parents.truncate(9)).contains("55 joints"));
        assert!(broken(|c| c.skeleton.parents[4] = 4).contains("parent"));
        assert!(broken(|c| c.skeleton.parents[4] = -1).contains("parent"));
        assert!(broken(|c| c.face_values[5] = f32::INFINITY).contains("finite"));
        assert!(broken(|c| c.translation[1][1] = f32::NAN).contains("finite"));
        assert!(broken(|c| c.rotations[1][9] = [0.0; 4]).contains("unit"));
    }

    #[test]
    fn contacts_are_of_the_left_side_before_the_right() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../models/umo-people/model.safetensors");
        let file = ModelFile::open(path.as_ref()).unwrap();
        let mut clip = Clip::new(file.config());
        let face = vec![0.0; clip.face.names.len()];
        for frame in 0_u8..4 {
            let mut pose = Pose::REST;
            // The left leg swings from the hip.
            pose.rotations[1] = axis_angle_to_quat([0.2 * f32::from(frame), 0.0, 0.0]);
            clip.push(&pose, &face);
        }
        let channels = clip.channels();
        for row in channels.lower.chunks_exact(FIRST_CONTACT + 4) {
            assert_eq!(row[FIRST_CONTACT..], [0.0, 0.0, 1.0, 1.0]);
        }
    }
}
