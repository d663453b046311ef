//! Encoders of a motion: its codes (SPEC 2.7).

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_core_pose::clip::Clip;
use umo_core_pose::part::{Part, PerPart};

use super::conv::ConvScratch;
use super::vq::{MotionScratch, VqEncoder};
use super::{body_channels, widest};
use crate::config::{Channels, PartSpec};
use crate::linear::Compute;
use crate::weights::Loader;

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
            frame_rate: config.frame_rate as f32,
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
    use umo_core_pose::pose::{FIRST_CONTACT, Pose};
    use umo_core_pose::rotation::axis_angle_to_quat;

    use super::*;
    use crate::weights::ModelFile;

    #[test]
    fn check_refuses_a_clip_that_contradicts_itself() {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
        let mut good = ModelFile::open(path.as_ref()).unwrap().config().clip();
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
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/umo-people/model.safetensors");
        let file = ModelFile::open(path.as_ref()).unwrap();
        let mut clip = file.config().clip();
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
