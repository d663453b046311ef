//! Records of chunks for inspection: codes, and the experts that their tokens were sent to.

use umo_core_pose::part::{Part, PerPart};

use crate::config::Config;
use crate::lm::tally::Tally;

/// Record of the last chunk of an animation.
#[derive(Clone, Copy, Debug)]
pub struct Chunk<'a> {
    /// Number of the chunk in the stream.
    pub index: u64,
    /// First frame whose codes the chunk made known.
    pub first_frame: usize,
    /// Number of frames whose codes the chunk made known; in the last chunk they may extend beyond the end of the
    /// stream.
    pub frames: usize,
    /// Codes of these frames. Every `keyframe_stride`-th is from the language model, the others are from the
    /// interpolation network: a frame is a keyframe if its number is a multiple of the stride. Empty in layout
    /// `frames`, which interpolates vectors.
    pub codes: PerPart<&'a [u16]>,
    /// Codes `[keyframes, codes of a keyframe]` of the chunk's keyframes; the first is the first keyframe among its
    /// frames. Empty in layout `parts`.
    pub keyframes: &'a [u16],
    /// Number of rows in the chunk's encoder and decoder passes, by layer, kind of token and expert.
    pub tally: &'a Tally,
}

/// Codes of the frames that one avatar's last chunk made known.
#[derive(Debug)]
pub(crate) struct Codes {
    index: u64,
    first_frame: usize,
    /// 0 before the first chunk, and after a step without one.
    frames: usize,
    /// Empty before the first chunk, and after a step without one.
    codes: PerPart<Vec<u16>>,
    keyframes: Vec<u16>,
}

impl Codes {
    /// Buffers for chunks of any target.
    pub(crate) fn new(config: &Config) -> Self {
        let most = if config.is_frames() { 0 } else { config.max_target * config.keyframe_stride };
        let keyframes = if config.is_frames() { config.max_target * config.codes_per_keyframe() } else { 0 };
        Self {
            index: 0,
            first_frame: 0,
            frames: 0,
            codes: PerPart::from_fn(|_| Vec::with_capacity(most)),
            keyframes: Vec::with_capacity(keyframes),
        }
    }

    pub(crate) fn clear(&mut self) {
        self.frames = 0;
        self.keyframes.clear();
        Part::ALL.into_iter().for_each(|part| self.codes[part].clear());
    }

    pub(crate) fn keep(&mut self, index: u64, first_frame: usize, codes: PerPart<&[u16]>) {
        (self.index, self.first_frame, self.frames) = (index, first_frame, codes.face.len());
        for part in Part::ALL {
            self.codes[part].clear();
            self.codes[part].extend_from_slice(codes[part]);
        }
    }

    pub(crate) fn keep_keyframes(&mut self, index: u64, first_frame: usize, frames: usize, codes: &[u16]) {
        (self.index, self.first_frame, self.frames) = (index, first_frame, frames);
        self.keyframes.clear();
        self.keyframes.extend_from_slice(codes);
    }

    pub(crate) fn chunk<'a>(&'a self, tally: &'a Tally) -> Option<Chunk<'a>> {
        let codes = PerPart::from_fn(|part| &*self.codes[part]);
        let Self { index, first_frame, frames, .. } = *self;
        (frames > 0).then_some(Chunk { index, first_frame, frames, codes, keyframes: &self.keyframes, tally })
    }
}
