//! Codes to poses: VQ decoders, the root network, rotations (SPEC 2.7); and poses back to codes.
//!
//! | module | contents |
//! |---|---|
//! | [`vq`], [`root`] | the codecs of the parts, the root network |
//! | [`stream`] | frames from codes that become known incrementally |
//! | [`smoothing`] | low-pass filter of the body's motion |
//! | `encoder` | codes of a whole motion |

mod conv;
mod encoder;
pub mod root;
pub mod smoothing;
pub mod stream;
pub mod vq;

pub use encoder::MotionEncoder;
pub use smoothing::Smoothing;
pub(crate) use stream::Push;
pub use stream::{FrameRef, MotionStream};
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{filled, with_capacity};
use umo_core_pose::face::Face;
use umo_core_pose::part::{Part, PerPart};
use umo_core_pose::pose::{Assembly, HEIGHT, VELOCITY_X, VELOCITY_Z};
use umo_core_pose::rotation::quat_to_axis_angle;
use umo_core_pose::skeleton::JOINTS;
pub use vq::{Latent, MotionScratch};

use crate::config::{Config, channel_names};
use crate::linear::Compute;
use crate::weights::Loader;
use conv::ConvScratch;
use root::{RootNet, Travel};
use smoothing::MAX_PAST;
use vq::VqDecoder;

/// The parts' VQ decoders and the root network.
#[derive(Debug)]
pub struct MotionDecoder {
    /// Decoders of the config's parts that have channels, in order.
    decoders: Vec<VqDecoder>,
    /// Values per frame of the body parts.
    channels: PerPart<usize>,
    /// Whether the decoders are the paper's: one for each body part, with one level.
    is_paper: bool,
    /// Codes of the rest pose, `[levels]` for each decoder.
    rest: Vec<Vec<u16>>,
    root: RootNet,
    assembly: Assembly,
    frame_seconds: f64,
    width: usize,
}

/// A whole motion as decoded by the networks.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// `[T, channels]` of each part.
    pub channels: PerPart<Vec<f32>>,
    /// Axis-angle of each joint, relative to its parent; the eyes are at rest.
    pub rotations: Vec<[[f32; 3]; JOINTS]>,
    /// Position of the root, metres.
    pub translation: Vec<[f32; 3]>,
}

impl MotionDecoder {
    /// Loads `vq.*` except the encoders of the parts.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (mut decoders, mut rest) = (Vec::new(), Vec::new());
        for part in config.part_list() {
            if let Some(channels) = part.channels(&config.face) {
                decoders.push(VqDecoder::load(loader, &part, channels)?);
                #[expect(clippy::cast_possible_truncation, reason = "codes fit 16 bits by the config's checks")]
                rest.push(part.rest.iter().map(|&code| code as u16).collect());
            }
        }
        Ok(Self {
            decoders,
            channels: PerPart::from_fn(|part| body_channels(part, &config.face)),
            is_paper: config.parts.is_none() || !config.is_frames(),
            rest,
            // The feet move a thousandth as much in a frame as the rotations that determine it, so this needs
            // full precision.
            root: RootNet::load(&if config.is_frames() { loader.exact() } else { loader.clone() })?,
            assembly: Assembly::new(&config.face),
            frame_seconds: frame_seconds(config),
            width: widest(config),
        })
    }

    /// Allocates scratch memory to decode `rows` frames at once.
    pub fn scratch(&self, rows: usize) -> MotionScratch {
        MotionScratch(ConvScratch::new(rows, self.width))
    }

    /// Number of frames that the scratch of a [`MotionStream`] with these limits must hold.
    pub fn stream_rows(&self, max_push: usize, max_lookahead: usize) -> usize {
        max_push + (3 * self.reach()).max(max_lookahead.max(MAX_PAST) + 1 + MAX_PAST + 2 * self.root.reach())
    }

    /// Maximum number of frames on each side that any part's channels depend on. With this lookahead the body
    /// equals that of a whole decode.
    pub fn reach(&self) -> usize {
        self.decoders.iter().map(VqDecoder::reach).max().unwrap_or(0)
    }

    /// Like [`Self::reach`], for the decoders of one body part.
    pub fn reach_of(&self, part: Part) -> usize {
        self.decoders_of(part).map(|(_, decoder)| decoder.reach()).max().unwrap_or(0)
    }

    /// Frames on each side that the root's motion depends on.
    pub fn root_reach(&self) -> usize {
        self.reach_of(Part::Lower) + self.root.reach()
    }

    /// Values per frame of a body part.
    pub fn channels(&self, part: Part) -> usize {
        self.channels[part]
    }

    /// Decoders of the config's parts that have channels, in order.
    pub fn decoders(&self) -> &[VqDecoder] {
        &self.decoders
    }

    /// Decoders of a body part's channels, with their indices in the list.
    fn decoders_of(&self, part: Part) -> impl Iterator<Item = (usize, &VqDecoder)> {
        self.decoders.iter().enumerate().filter(move |(_, decoder)| decoder.places().part == part)
    }

    /// Conversion of channels to poses.
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
    }

    /// Decodes a whole motion at once from codes `[T]` of each part, for a model with the paper's four parts.
    /// Allocates.
    ///
    /// # Errors
    /// [`StepError`] if there are no codes, the parts have different numbers of codes, a code is out of
    /// range, or the model has other parts.
    pub fn decode(&self, cx: Compute, codes: PerPart<&[u16]>) -> Result<Decoded, StepError> {
        if !self.is_paper {
            return Err(StepError::Missing("codes of the four parts: its config lists others"));
        }
        self.decode_list(cx, &Part::ALL.map(|part| codes[part]))
    }

    /// Decodes a whole motion at once, from codes or vectors for each of [`Self::decoders`]. Allocates.
    ///
    /// # Errors
    /// [`StepError`] if there are no latents, the parts have different numbers of frames, or a code is out of
    /// range.
    pub fn decode_list<T: Latent>(&self, cx: Compute, latents: &[&[T]]) -> Result<Decoded, StepError> {
        let frames = self.check(latents)?;
        if frames == 0 {
            return Err(StepError::Empty("motion codes"));
        }
        let mut scratch = self.scratch(frames);
        let mut channels = PerPart::from_fn(|part| filled(0.0, frames * self.channels(part)));
        for (decoder, &latents) in self.decoders.iter().zip(latents) {
            let rows = decoder.decode(cx, &mut scratch, latents)?;
            let part = decoder.places().part;
            scatter(decoder, rows, self.channels(part), &mut channels[part]);
        }
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
            travel.advance([row[VELOCITY_X], row[VELOCITY_Z]], self.frame_seconds);
            place
        }));
        Ok(Decoded { channels, rotations, translation })
    }

    /// Decodes `frames` frames of the rest pose. Allocates.
    ///
    /// # Errors
    /// [`StepError`] if `frames` is 0.
    pub fn decode_rest(&self, cx: Compute, frames: usize) -> Result<Decoded, StepError> {
        let codes: Vec<Vec<u16>> = self.rest.iter().map(|rest| rest.repeat(frames)).collect();
        self.decode_list(cx, &codes.iter().map(Vec::as_slice).collect::<Vec<_>>())
    }

    /// Returns the number of frames in `latents`, after checking that it is equal for all parts.
    fn check<T: Latent>(&self, latents: &[&[T]]) -> Result<usize, StepError> {
        if latents.len() != self.decoders.len() {
            return Err(StepError::Disagree("there are codes of another number of parts than the model's"));
        }
        let mut frames = None;
        for (decoder, &latents) in self.decoders.iter().zip(latents) {
            let count = decoder.frames(latents)?;
            if *frames.get_or_insert(count) != count {
                return Err(StepError::Disagree("the parts have different numbers of motion codes"));
            }
        }
        Ok(frames.unwrap_or(0))
    }
}

/// Writes `rows [T, channels]` of one decoder to its channels in `body [T, width]`.
fn scatter(decoder: &VqDecoder, rows: &[f32], width: usize, body: &mut [f32]) {
    let ranges = &decoder.places().ranges;
    for (row, body) in rows.chunks_exact(decoder.channels()).zip(body.chunks_exact_mut(width)) {
        let mut rest = row;
        for range in ranges {
            let (values, more) = rest.split_at(range.len());
            body[range.clone()].copy_from_slice(values);
            rest = more;
        }
    }
}

/// Values per frame of a body part.
fn body_channels(part: Part, face: &Face) -> usize {
    channel_names(part, face).last().map_or(0, |(_, last)| last.end)
}

fn frame_seconds(config: &Config) -> f64 {
    1.0 / config.frame_rate as f64
}

/// Width of the widest activation of any codec.
fn widest(config: &Config) -> usize {
    let parts = config.part_list();
    let codecs = parts.iter().filter_map(|part| Some(part.channels(&config.face)?.count().max(part.width)));
    codecs.max().unwrap_or(0).max(config.vq.root.channels).max(config.vq.width)
}
