//! The two layouts of a model between its language model's decoder and its motion decoders.
//!
//! | layout | a decoder pass gives | the networks fill | motion is decoded from |
//! |---|---|---|---|
//! | `parts` | one code of one part | codes of the frames between keyframes | codes |
//! | `frames` | one keyframe, whose codes the depth network samples | vectors of these frames | vectors |
//!
//! The codes of the keyframes have one form, [`Window`]. What differs is one value for each owner: [`Networks`] of a
//! model, [`Run`] of a stream, and `Draw` of a batch. A run and a draw hold the networks that they use, so no two
//! values have to agree.

pub(crate) mod frames;
pub(crate) mod parts;
mod window;

use std::time::Duration;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{self, Arena};
use umo_core_base::state::{StateError, StatePass};

use crate::avatar::{Avatar, StageTimes};
use crate::config::Config;
use crate::interp::{Filling, InterpScratch};
use crate::linear::Compute;
use crate::lm::LmScratch;
use crate::lm::decoder::Sequence;
use crate::motion::{FrameRef, MotionDecoder, MotionScratch, Push, Smoothing};
use crate::record::Codes;
use crate::weights::Loader;
pub use window::{FREE, Window};

/// Networks of a model.
#[derive(Debug)]
pub enum Networks {
    /// Codes of four parts, frame by frame.
    Parts(parts::Networks),
    /// Codes of keyframes, and vectors of the frames between.
    Frames(frames::Networks),
}

/// Frames of a stream's window, and the motion that is decoded from them.
#[derive(Debug)]
pub enum Run {
    /// Of layout `parts`.
    Parts(parts::Run),
    /// Of layout `frames`.
    Frames(frames::Run),
}

/// Drawing of codes from the decoder passes of a batch.
#[derive(Debug)]
pub(crate) enum Draw {
    Parts(parts::Draw),
    Frames(frames::Draw),
}

/// Evaluates one expression in the variant of either layout.
macro_rules! each {
    ($value:expr, $name:ident => $then:expr) => {
        match $value {
            Self::Parts($name) => $then,
            Self::Frames($name) => $then,
        }
    };
}

/// Settings of a stream's motion.
#[derive(Clone, Copy, Debug)]
pub struct Shape {
    /// Keyframes of a chunk.
    pub target: usize,
    /// Frames held back.
    pub lookahead: usize,
    /// Low-pass filter of the body's motion.
    pub smoothing: Smoothing,
}

/// A decoder pass of a batch.
pub(crate) struct Pass<'a> {
    /// Final states of the pass, and inputs of the next.
    pub(crate) lm: &'a mut LmScratch,
    /// `per_member` of each member.
    pub(crate) sequences: &'a mut [Sequence],
    pub(crate) per_member: usize,
    /// Encoder ids and states of all sequences, and the rows of each.
    pub(crate) ids: &'a [u32],
    pub(crate) states: &'a [f32],
    pub(crate) lengths: &'a [usize],
    /// Whether one step draws only a few codes.
    pub(crate) bounded: bool,
}

/// Progress after a step of drawing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Drawn {
    /// Codes of this pass are left: those of the tasks from `first` on, from `code` on.
    Some { first: usize, code: usize },
    /// The pass is done, and another follows.
    Pass,
    /// All codes of the chunk are drawn.
    Chunk,
}

impl Networks {
    /// Loads the networks of the file's layout.
    pub(crate) fn load(loader: &Loader) -> Result<Self, LoadError> {
        // For the networks' own structures.
        memory::require(memory::SPARE);
        Ok(match loader.file().config().is_frames() {
            true => Self::Frames(frames::Networks::load(loader)?),
            false => Self::Parts(parts::Networks::load(loader)?),
        })
    }

    /// Creates the drawing for batches of at most `width` avatars with `per_member` sequences each.
    pub(crate) fn draw(&self, config: &Config, width: usize, per_member: usize) -> Draw {
        match self {
            Self::Parts(networks) => Draw::Parts(networks.draw(config, width)),
            Self::Frames(networks) => Draw::Frames(networks.draw(config, width, per_member)),
        }
    }

    /// Creates the frames and the motion of a stream.
    pub fn run_in(&self, config: &Config, decoder: &MotionDecoder, shape: Shape, arena: &Arena) -> Run {
        match self {
            Self::Parts(networks) => Run::Parts(networks.run_in(config, decoder, shape, arena)),
            Self::Frames(networks) => Run::Frames(networks.run_in(config, decoder, shape, arena)),
        }
    }

    /// Allocates scratch to interpolate the windows of runs with at most `target` new keyframes.
    pub fn scratch(&self, config: &Config, target: usize) -> InterpScratch {
        each!(self, networks => networks.interp().scratch(window_frames(config, target)))
    }
}

/// Number of frames of a window: from its first keyframe to its last.
fn window_frames(config: &Config, target: usize) -> usize {
    (config.prefix + target - 1) * config.keyframe_stride + 1
}

impl Run {
    /// Returns to the start of a stream.
    pub fn reset(&mut self) {
        each!(self, run => run.motion.reset());
    }

    /// Describes the history of `window` and the motion after `known` frames.
    pub(crate) fn state(
        &mut self,
        pass: &mut StatePass,
        window: &mut Window,
        decoder: &MotionDecoder,
        known: usize,
    ) -> Result<(), StateError> {
        each!(self, run => run.state(pass, window, decoder, known))
    }

    /// Number of frames whose codes are known.
    pub fn known(&self) -> usize {
        each!(self, run => run.motion.known())
    }

    /// Number of emitted frames.
    pub(crate) fn emitted(&self) -> usize {
        each!(self, run => run.motion.emitted())
    }

    /// Position of the root in the last emitted frame: x and z, metres.
    pub fn place(&self) -> [f32; 2] {
        each!(self, run => run.motion.place())
    }

    /// Begins to fill the frames of `window` from `start` on; a `bounded` step fills a few.
    pub fn begin_filling(
        &mut self,
        cx: Compute,
        scratch: &mut InterpScratch,
        (window, start): (&Window, usize),
        decoder: &MotionDecoder,
        bounded: bool,
    ) -> Result<Filling, StepError> {
        let piece = |parts| if bounded { Filling::short_piece(parts) } else { usize::MAX };
        match self {
            Self::Parts(run) => run.begin_filling(scratch, (window, start), piece),
            Self::Frames(run) => run.begin_filling(cx, scratch, (window, start), decoder, piece),
        }
    }

    /// Runs the next step of a filling; returns whether there is more to do.
    pub fn fill(&mut self, cx: Compute, scratch: &mut InterpScratch, filling: &mut Filling) -> Result<bool, StepError> {
        each!(self, run => run.fill(cx, scratch, filling))
    }

    /// Begins to decode the frames of the window from `start` on.
    pub fn begin_push(
        &mut self,
        decoder: &MotionDecoder,
        scratch: &MotionScratch,
        start: usize,
        lookahead: usize,
    ) -> Result<Push, StepError> {
        each!(self, run => run.motion.begin_push(decoder, scratch, &run.frames.latents(start), lookahead))
    }

    /// Begins to emit the frames held back, up to `total`.
    pub fn begin_finish(&self, total: usize) -> Result<Push, StepError> {
        each!(self, run => run.motion.begin_finish(total))
    }

    /// Runs the next decoder of a push of the frames from `start` on, or emits its frames; returns whether there is
    /// more to do.
    pub fn push_step(
        &mut self,
        cx: Compute,
        decoder: &MotionDecoder,
        scratch: &mut MotionScratch,
        start: usize,
        push: &mut Push,
        out: &mut dyn FnMut(FrameRef),
    ) -> Result<bool, StepError> {
        each!(self, run => run.motion.push_step(cx, decoder, scratch, &run.frames.latents(start), push, out))
    }

    /// Records the codes of the chunk `index`, whose frames begin at `first_frame`; `first` tells whether it is the
    /// stream's first.
    pub(crate) fn keep(&self, window: &Window, codes: &mut Codes, (index, first_frame): (u64, usize), first: bool) {
        match self {
            Self::Parts(run) => codes.keep(index, first_frame, run.frames.codes(window.fresh_start(first))),
            Self::Frames(_) => codes.keep_keyframes(index, first_frame, window.fresh_frames(first), window.targets()),
        }
    }
}

impl Draw {
    /// Writes the inputs of the encoder that stand for the history of `window`.
    pub(crate) fn write_history(&self, window: &Window, member: usize, lm: &mut LmScratch) -> Result<(), StepError> {
        match self {
            Self::Parts(_) => Ok(()),
            Self::Frames(draw) => draw.write_history(window, member, lm),
        }
    }

    /// Writes the first input of a member's sequence.
    pub(crate) fn start(
        &mut self,
        member: usize,
        sequence: &mut Sequence,
        lm: &mut LmScratch,
    ) -> Result<(), StepError> {
        match self {
            Self::Parts(draw) => draw.start(member, sequence),
            Self::Frames(draw) => draw.start(member, sequence, lm),
        }
    }

    /// Draws codes of a decoder pass, for the tasks from `first` on, their codes from `code` on, and writes the inputs
    /// of the next pass.
    pub(crate) fn step(
        &mut self,
        cx: Compute,
        config: &Config,
        pass: Pass,
        avatars: &mut [Avatar],
        (first, code): (usize, usize),
    ) -> Result<Drawn, StepError> {
        match self {
            Self::Parts(draw) => draw.step(cx, pass, avatars),
            Self::Frames(draw) => draw.step(cx, config, pass, avatars, (first, code)),
        }
    }

    /// The stage whose time drawing counts as.
    pub(crate) fn time<'a>(&self, times: &'a mut StageTimes) -> &'a mut Duration {
        match self {
            Self::Parts(_) => &mut times.decoder,
            Self::Frames(_) => &mut times.depth,
        }
    }
}
