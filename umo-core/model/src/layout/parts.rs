//! Layout `parts`, the paper's: four parts with one code a frame. A decoder pass gives one code of a keyframe (SPEC
//! 2.5), and a network chooses the codes of the frames between keyframes (SPEC 2.6).

use std::sync::Arc;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{Arena, Slice, filled};
use umo_core_base::state::{StateError, StatePass};
use umo_core_pose::part::{Part, PerPart};

use super::{Drawn, Pass, Shape, Window, window_frames};
use crate::avatar::Avatar;
use crate::config::Config;
use crate::interp::{Filling, Interp, InterpScratch};
use crate::linear::Compute;
use crate::lm::decoder::Sequence;
use crate::lm::generate::{Generator, Heads, Position};
use crate::motion::{MotionDecoder, MotionStream};
use crate::weights::Loader;

/// The networks.
#[derive(Debug)]
pub struct Networks {
    heads: Arc<Heads>,
    interp: Arc<Interp>,
}

impl Networks {
    pub(super) fn load(loader: &Loader) -> Result<Self, LoadError> {
        Ok(Self { heads: Arc::new(Heads::load(loader)?), interp: Arc::new(Interp::load(loader)?) })
    }

    pub(super) fn interp(&self) -> &Interp {
        &self.interp
    }

    pub(super) fn draw(&self, config: &Config, width: usize) -> Draw {
        Draw {
            generator: Generator::new(config, Arc::clone(&self.heads)),
            positions: filled(Position::default(), width).into(),
        }
    }

    pub fn run_in(&self, config: &Config, decoder: &MotionDecoder, shape: Shape, arena: &Arena) -> Run {
        let (len, stride) = (window_frames(config, shape.target), config.keyframe_stride);
        Run {
            interp: Arc::clone(&self.interp),
            frames: Frames { codes: PerPart::from_fn(|_| arena.filled(0, len)), stride },
            motion: MotionStream::new_in(decoder, (shape.target * stride, shape.lookahead), shape.smoothing, arena),
        }
    }
}

/// Codes of a window's frames, and the motion that is decoded from them.
#[derive(Debug)]
pub struct Run {
    interp: Arc<Interp>,
    pub(super) frames: Frames,
    pub(super) motion: MotionStream<u16>,
}

/// Codes of a window's frames. Each chunk writes them before it reads them.
#[derive(Debug)]
pub(super) struct Frames {
    /// `[(P + N - 1) * stride + 1]` of each part.
    codes: PerPart<Slice<u16>>,
    stride: usize,
}

impl Frames {
    /// Copies the keyframes to their frames and masks all others.
    #[expect(clippy::cast_possible_truncation, reason = "the mask fits 16 bits by the config's checks")]
    fn lay_out(&mut self, window: &Window, mask: usize) {
        for part in Part::ALL {
            self.codes[part].fill(mask as u16);
            for (frame, codes) in self.codes[part].iter_mut().step_by(self.stride).zip(window.keyframes()) {
                *frame = codes[part as usize];
            }
        }
    }

    /// Codes of the frames from `start` on.
    pub(super) fn codes(&self, start: usize) -> PerPart<&[u16]> {
        PerPart::from_fn(|part| &self.codes[part][start..])
    }

    /// Inputs of the motion decoders: the codes of the frames from `start` on.
    pub(super) fn latents(&self, start: usize) -> [&[u16]; Part::ALL.len()] {
        Part::ALL.map(|part| &self.codes[part][start..])
    }
}

impl Run {
    /// Describes the history, part by part, and the motion.
    pub(super) fn state(
        &mut self,
        pass: &mut StatePass,
        window: &mut Window,
        decoder: &MotionDecoder,
        known: usize,
    ) -> Result<(), StateError> {
        let (parts, codes) = (Part::ALL.len(), window.history().len());
        window.state(pass, (0..parts).flat_map(|part| (part..codes).step_by(parts)))?;
        self.motion.state(pass, decoder, known, |book, pass, codes| pass.codes(codes, book.codes()))
    }

    pub fn begin_filling(
        &mut self,
        scratch: &mut InterpScratch,
        (window, start): (&Window, usize),
        piece: impl Fn(usize) -> usize,
    ) -> Result<Filling, StepError> {
        self.frames.lay_out(window, self.interp.mask());
        self.interp.begin(scratch, self.frames.codes(0), start, piece(Part::ALL.len()))
    }

    pub fn fill(&mut self, cx: Compute, scratch: &mut InterpScratch, filling: &mut Filling) -> Result<bool, StepError> {
        let PerPart { face, hands, upper, lower } = &mut self.frames.codes;
        self.interp.step(cx, scratch, PerPart { face, hands, upper, lower }, filling)
    }
}

/// Drawing of codes, one from each sequence of a pass.
#[derive(Debug)]
pub(crate) struct Draw {
    generator: Generator,
    /// One per member.
    positions: Box<[Position]>,
}

impl Draw {
    pub(super) fn start(&mut self, member: usize, sequence: &mut Sequence) -> Result<(), StepError> {
        self.positions[member] = self.generator.begin(sequence)?;
        Ok(())
    }

    pub(super) fn step(&mut self, cx: Compute, pass: Pass, avatars: &mut [Avatar]) -> Result<Drawn, StepError> {
        let (mut row, mut more) = (0, false);
        for ((sequence, position), avatar) in pass.sequences.iter_mut().zip(&mut self.positions).zip(avatars) {
            let count = sequence.ids().len();
            if count == 0 {
                continue;
            }
            row += count;
            let (sampling, codes) = (avatar.chunk_sampling(), avatar.window.targets_mut());
            more |= self.generator.write(cx, pass.lm, row - 1, sampling, position, codes, sequence)?;
        }
        Ok(if more { Drawn::Pass } else { Drawn::Chunk })
    }
}
