//! Codes to poses: VQ decoders, the root network, rotations (SPEC 2.7); and poses back to codes.
//!
//! | module | what it holds |
//! |---|---|
//! | [`vq`], [`root`] | the codecs of the four parts, the root network |
//! | [`rotation`], [`skeleton`], [`pose`] | rotations, the 55 joints, channels as one frame's pose |
//! | [`stream`] | frames from codes that become known bit by bit |
//! | [`axes`], [`visemes`] | poses in an engine's axes and units; mouth shapes |
//! | [`clip`] | a whole motion, and its way back to channels and codes |

pub mod axes;
pub mod clip;
mod conv;
pub mod pose;
pub mod root;
pub mod rotation;
pub mod skeleton;
pub mod stream;
pub mod visemes;
pub mod vq;

pub use clip::{Clip, MotionEncoder};
pub use pose::{Assembly, Pose};
pub use stream::{FrameRef, MotionStream};
pub use vq::MotionScratch;

use crate::config::Config;
use crate::error::{LoadError, StepError};
use crate::linear::Compute;
use crate::memory::{copied, with_capacity};
use crate::part::{Part, PerPart};
use crate::weights::Loader;
use conv::ConvScratch;
use root::{HEIGHT, RootNet, Travel};
use rotation::quat_to_axis_angle;
use skeleton::JOINTS;
use vq::VqDecoder;

/// The four VQ decoders and the root network.
#[derive(Debug)]
pub struct MotionDecoder {
    parts: PerPart<VqDecoder>,
    root: RootNet,
    assembly: Assembly,
    frame_seconds: f64,
    width: usize,
    codes: usize,
}

/// A whole motion as the networks give it.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// `[T, channels]` of each part.
    pub channels: PerPart<Vec<f32>>,
    /// Axis-angle of each joint, relative to its parent; the eyes at rest.
    pub rotations: Vec<[[f32; 3]; JOINTS]>,
    /// Place of the root, metres.
    pub translation: Vec<[f32; 3]>,
}

impl MotionDecoder {
    /// Loads `vq.*` but the encoders of the parts.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        Ok(Self {
            parts: PerPart::try_from_fn(|part| VqDecoder::load(loader, part))?,
            root: RootNet::load(loader)?,
            assembly: Assembly::new(&config.face),
            frame_seconds: frame_seconds(config),
            width: widest(config),
            codes: config.vq.codes,
        })
    }

    /// Room to decode `rows` frames at once.
    pub fn scratch(&self, rows: usize) -> MotionScratch {
        MotionScratch(ConvScratch::new(rows, self.width))
    }

    /// Frames that a scratch needs room for where a [`MotionStream`] of these limits uses it.
    pub fn stream_rows(&self, max_push: usize, max_lookahead: usize) -> usize {
        max_push + (3 * self.reach()).max(max_lookahead + 1 + 2 * self.root.reach())
    }

    /// Frames on each side that any part's channels depend on: a lookahead of as many gives the body of a whole decode.
    pub fn reach(&self) -> usize {
        Part::ALL.iter().map(|&part| self.parts[part].reach()).max().unwrap_or(0)
    }

    /// Frames on each side that the root's motion depends on.
    pub fn root_reach(&self) -> usize {
        self.parts.lower.reach() + self.root.reach()
    }

    /// Values per frame of `part`.
    pub fn channels(&self, part: Part) -> usize {
        self.parts[part].channels()
    }

    /// How channels become poses.
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// Decodes a whole motion at once; allocates as it needs.
    ///
    /// # Errors
    /// [`StepError`] where there are no codes, the parts have different numbers of them, or one is no code.
    pub fn decode(&self, cx: Compute, codes: PerPart<&[u16]>) -> Result<Decoded, StepError> {
        let frames = self.check_codes(codes)?;
        if frames == 0 {
            return Err(StepError::Empty("motion codes"));
        }
        let mut scratch = self.scratch(frames);
        let channels = PerPart::try_from_fn(|part| {
            Ok::<_, StepError>(copied(self.parts[part].decode(cx, &mut scratch, codes[part])?))
        })?;
        let row = |frame: usize| {
            PerPart::from_fn(|part| &channels[part][frame * self.channels(part)..(frame + 1) * self.channels(part)])
        };
        let mut rotations = with_capacity(frames);
        rotations.extend((0..frames).map(|f| self.assembly.rotations(row(f)).map(quat_to_axis_angle)));
        let root = self.root.run(cx, &mut scratch, &channels.lower)?;
        let mut travel = Travel::default();
        let mut translation = with_capacity(frames);
        translation.extend(root.chunks_exact(self.root.channels()).map(|row| {
            let place = travel.place(row[HEIGHT]);
            travel.advance(row, self.frame_seconds);
            place
        }));
        Ok(Decoded { channels, rotations, translation })
    }

    /// The number of frames that `codes` have, which are as many codes of each part.
    fn check_codes(&self, codes: PerPart<&[u16]>) -> Result<usize, StepError> {
        let frames = codes.face.len();
        for part in Part::ALL {
            if codes[part].len() != frames {
                return Err(StepError::Disagree("the parts have different numbers of motion codes"));
            }
            if let Some(&code) = codes[part].iter().find(|&&code| usize::from(code) >= self.codes) {
                return Err(StepError::OutOfRange { what: "motion code", got: code.into(), limit: self.codes });
            }
        }
        Ok(frames)
    }
}

fn frame_seconds(config: &Config) -> f64 {
    1.0 / config.frame_rate as f64
}

/// The widest activation of any codec.
fn widest(config: &Config) -> usize {
    let channels = Part::ALL.iter().map(|&part| config.vq[part].channels).max().unwrap_or(0);
    channels.max(config.vq.root.channels).max(config.vq.width)
}
