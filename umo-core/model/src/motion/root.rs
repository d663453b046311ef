//! The root network: motion of the pelvis through the world, from the motion of the legs (SPEC 2.7).

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::state::{StateError, StatePass};
pub use umo_core_pose::pose::{FIRST_CONTACT, HEIGHT, ROTATION_CHANNELS, VELOCITY_X, VELOCITY_Z, finite};
use umo_core_pose::rotation::orthonormal_six;

use super::conv::{DecoderStack, EncoderStack};
use super::vq::MotionScratch;
use crate::config::Codec;
use crate::linear::Compute;
use crate::weights::Loader;

/// A convolutional auto-encoder over the lower body's channels.
#[derive(Debug)]
pub struct RootNet {
    encoder: EncoderStack,
    decoder: DecoderStack,
    codec: Codec,
}

impl RootNet {
    /// Loads `vq.root`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let vq = &loader.file().config().vq;
        Ok(Self {
            encoder: EncoderStack::load(loader, "vq.root.encoder.main", vq.root, vq.width)?,
            decoder: DecoderStack::load(loader, "vq.root.decoder.main", vq.root, vq.width)?,
            codec: vq.root,
        })
    }

    /// Number of values per frame, in input and output.
    pub fn channels(&self) -> usize {
        self.codec.channels
    }

    /// Number of frames on each side that a frame depends on.
    pub fn reach(&self) -> usize {
        self.codec.encoder_reach() + self.codec.decoder_reach()
    }

    /// Runs the network on the lower body's channels `lower [T, channels]` and returns `[T, channels]`, in
    /// `scratch`. The rotations need not be orthonormal, and the velocity is ignored. Only [`VELOCITY_X`],
    /// [`HEIGHT`] and [`VELOCITY_Z`] of the output are used.
    ///
    /// # Errors
    /// [`StepError`] if `lower` is not a whole number of frames, or has more frames than `scratch` has room
    /// for.
    pub fn run<'a>(&self, cx: Compute, scratch: &'a mut MotionScratch, lower: &[f32]) -> Result<&'a [f32], StepError> {
        self.run_held(cx, scratch, lower, 0)
    }

    /// Like [`run`](Self::run), with the last frame repeated `held` times; returns `[T + held, channels]`.
    ///
    /// # Errors
    /// As `run`.
    pub(super) fn run_held<'a>(
        &self,
        cx: Compute,
        scratch: &'a mut MotionScratch,
        lower: &[f32],
        held: usize,
    ) -> Result<&'a [f32], StepError> {
        let channels = self.codec.channels;
        let frames = lower.len() / channels;
        if frames * channels != lower.len() {
            return Err(StepError::Disagree("the lower body's channels are not a whole number of frames"));
        }
        let rows = if frames == 0 { 0 } else { frames + held };
        let input = scratch.0.input(rows, channels)?;
        let last = lower.rchunks_exact(channels).next().into_iter().cycle();
        for (row, out) in lower.chunks_exact(channels).chain(last).zip(input.chunks_exact_mut(channels)) {
            out.copy_from_slice(row);
            out[..ROTATION_CHANNELS].as_chunks_mut().0.iter_mut().for_each(|six| *six = orthonormal_six(*six));
            out[VELOCITY_X..FIRST_CONTACT].fill(0.0);
        }
        self.encoder.run(cx, &mut scratch.0, rows)?;
        self.decoder.run(cx, &mut scratch.0, rows)?;
        Ok(scratch.0.output(rows, channels))
    }
}

/// Horizontal position of the root: the sum of its velocity over the frames. In f64, so that it stays smooth
/// for hours.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Travel {
    x: f64,
    z: f64,
}

impl Travel {
    /// Advances by one frame of `seconds`, at the velocity along x and z that the network computed for the
    /// previous frame.
    pub(super) fn advance(&mut self, [x, z]: [f32; 2], seconds: f64) {
        self.x += f64::from(finite(x)) * seconds;
        self.z += f64::from(finite(z)) * seconds;
    }

    /// Describes the root's position for [`StatePass`].
    pub(super) fn state(&mut self, pass: &mut StatePass) -> Result<(), StateError> {
        pass.place(&mut self.x)?;
        pass.place(&mut self.z)
    }

    /// Position of the root at `height`.
    #[expect(clippy::cast_possible_truncation, reason = "a place in metres is given as f32")]
    pub(super) fn place(&self, height: f32) -> [f32; 3] {
        [self.x as f32, finite(height), self.z as f32]
    }
}

#[cfg(test)]
mod tests {
    use umo_core_base::team::Team;
    use umo_kernels::Isa;

    use super::*;
    use crate::linear::Precision;
    use crate::motion::MotionDecoder;
    use crate::weights::ModelFile;

    /// Output of the root network for the same legs at a precision.
    fn rows(precision: Precision) -> Vec<f32> {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden/frames_seven/model.safetensors");
        let file = ModelFile::open(path.as_ref()).unwrap();
        let decoder = MotionDecoder::load(&Loader::new(&file, precision, Isa::detect())).unwrap();
        let (team, frames) = (Team::new(1).unwrap(), 12_u16);
        let values = (0..frames * 61).map(|i| 1.0 + 0.001 * f32::from(i % 17));
        let lower: Vec<f32> = values.collect();
        let cx = Compute { isa: Isa::detect(), team: &team };
        decoder.root.run(cx, &mut decoder.scratch(usize::from(frames)), &lower).unwrap().to_vec()
    }

    #[test]
    fn the_root_of_layout_frames_is_computed_in_full_at_every_precision() {
        let wanted = rows(Precision::F32);
        for precision in [Precision::Bf16, Precision::Int8, Precision::Stored] {
            assert_eq!(rows(precision), wanted, "{precision:?}");
        }
    }
}
