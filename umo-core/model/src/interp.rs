//! Interpolation of keyframes to codes of every frame: a small bidirectional transformer over frames, then
//! over parts (SPEC 2.6). [`vectors`] interpolates keyframes to code vectors of the frames between them (SPEC
//! 2.14).

mod layer;
mod trunk;
pub mod vectors;

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_core_base::memory::filled;
use umo_core_pose::part::{Part, PerPart};
use umo_kernels::MatMut;
use umo_kernels::activation::argmax;
use umo_kernels::gemm::Epilogue;

use crate::linear::{Compute, Linear, QuantScratch};
use crate::weights::{Loader, Table};
pub use trunk::Filling;
use trunk::{Trunk, TrunkScratch};

const PARTS: usize = Part::ALL.len();

/// The interpolation network.
#[derive(Debug)]
pub struct Interp {
    embed: PerPart<Table>,
    trunk: Trunk,
    head: PerPart<Linear>,
    codes: usize,
}

/// Scratch memory for one run of a network, of codes or of vectors.
#[derive(Debug)]
pub struct InterpScratch {
    trunk: TrunkScratch,
    /// `[frames, width]` of each part: logits of codes; or projected vectors, of which only the rows of known frames
    /// are used.
    parts: Vec<Box<[f32]>>,
    width: usize,
    /// Number of frames with logits.
    frames: usize,
    /// `[frames, widest]`: output of one part's head of vectors.
    change: Box<[f32]>,
    /// Quantized vectors, which may be wider than tokens.
    quant: QuantScratch,
    max_frames: usize,
}

impl InterpScratch {
    /// Creates scratch for `frames` frames. `width` is that of a row of a part's buffer, and `widest` that of the widest
    /// vector, 0 for codes.
    fn new(trunk: &Trunk, frames: usize, parts: usize, (width, widest): (usize, usize)) -> Self {
        let max_frames = frames.min(trunk.max_frames());
        Self {
            trunk: trunk.scratch(max_frames),
            parts: (0..parts).map(|_| filled(0.0, max_frames * width).into()).collect(),
            width,
            frames: 0,
            change: filled(0.0, max_frames * widest).into(),
            quant: QuantScratch::new(if widest > 0 { max_frames } else { 0 }, widest.max(width)),
            max_frames,
        }
    }

    /// Logits `[T, codes]` of `part` in the last run of codes, for every computed frame, known or filled.
    pub fn logits(&self, part: Part) -> &[f32] {
        &self.parts[part as usize][..self.frames * self.width]
    }
}

impl Interp {
    /// Loads `interp.*`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (sizes, codes) = (&config.interp, config.part_codes());
        let dim = sizes.d_model;
        Ok(Self {
            embed: PerPart::try_from_fn(|part| {
                loader.table(&format!("interp.embed.{}.weight", part.name()), codes + 1, dim)
            })?,
            trunk: Trunk::load(loader, PARTS)?,
            head: PerPart::try_from_fn(|part| {
                loader.linear_with_bias(&format!("interp.head.{}", part.name()), codes, dim)
            })?,
            codes,
        })
    }

    /// Maximum number of frames in one run.
    pub fn max_frames(&self) -> usize {
        self.trunk.max_frames()
    }

    /// Code that marks a frame to be filled.
    pub fn mask(&self) -> usize {
        self.codes
    }

    /// Allocates scratch for windows of up to `frames` frames, limited to the model's maximum.
    pub fn scratch(&self, frames: usize) -> InterpScratch {
        InterpScratch::new(&self.trunk, frames, PARTS, (self.codes, 0))
    }

    /// Fills the masked frames of a window whose first frame is a keyframe; known codes do not change. Never
    /// allocates.
    ///
    /// Shapes: `codes [T]` of each part. Unknown codes are [`mask`](Self::mask), in the same frames of all
    /// parts; they are overwritten by the code with the largest logit, ties going to the lowest. Cost:
    /// `T * dim * (4 dim + 2 ffn_dim)` multiply-adds per temporal layer, four times that per part layer.
    ///
    /// # Errors
    /// [`StepError`] if there are no frames or more than `scratch` has room for, the parts have different
    /// numbers of codes or different masks, or a code is neither a valid code nor the mask. Nothing is filled
    /// then.
    pub fn fill(&self, cx: Compute, scratch: &mut InterpScratch, codes: PerPart<&mut [u16]>) -> Result<(), StepError> {
        self.fill_from(cx, scratch, codes, 0)
    }

    /// Fills the masked frames from `first` on, like [`Self::fill`]; earlier ones stay masked.
    ///
    /// # Errors
    /// As [`Self::fill`], and if no frame is left.
    pub fn fill_from(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        codes: PerPart<&mut [u16]>,
        first: usize,
    ) -> Result<(), StepError> {
        let known = PerPart { face: &*codes.face, hands: &*codes.hands, upper: &*codes.upper, lower: &*codes.lower };
        let mut filling = self.begin(scratch, known, first, usize::MAX)?;
        let PerPart { face, hands, upper, lower } = codes;
        while self.step(
            cx,
            scratch,
            PerPart { face: &mut *face, hands: &mut *hands, upper: &mut *upper, lower: &mut *lower },
            &mut filling,
        )? {}
        Ok(())
    }

    /// Begins to fill the masked frames from `first` on, at most `piece` frames per step.
    ///
    /// # Errors
    /// As [`Self::fill_from`].
    pub fn begin(
        &self,
        scratch: &mut InterpScratch,
        known: PerPart<&[u16]>,
        first: usize,
        piece: usize,
    ) -> Result<Filling, StepError> {
        scratch.frames = 0;
        let frames = self.check(scratch, known)?;
        if first >= frames {
            return Err(StepError::Empty("frames to interpolate"));
        }
        self.embed(scratch, known, frames);
        Ok(self.trunk.begin(frames, first, piece))
    }

    /// Runs the next step of a filling begun with [`Self::begin`], with the same codes; returns whether there
    /// is more to do. A step may fill no frames. The bits are the same as with [`Self::fill_from`].
    ///
    /// # Errors
    /// [`StepError`] if logits are not finite, or there are fewer codes than at the beginning.
    pub fn step(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        codes: PerPart<&mut [u16]>,
        filling: &mut Filling,
    ) -> Result<bool, StepError> {
        let range = self.trunk.step(cx, &mut scratch.trunk, filling)?;
        self.predict(cx, scratch, range.len())?;
        scratch.frames += range.len();
        self.choose(cx, scratch, codes, range)?;
        Ok(!filling.is_done())
    }

    /// Checks `codes` and returns the number of frames.
    fn check(&self, scratch: &InterpScratch, codes: PerPart<&[u16]>) -> Result<usize, StepError> {
        let frames = codes.face.len();
        if frames == 0 {
            return Err(StepError::Empty("frames to interpolate"));
        }
        if frames > scratch.max_frames {
            return Err(StepError::TooLong { what: "frames to interpolate", got: frames, limit: scratch.max_frames });
        }
        for part in Part::ALL {
            if codes[part].len() != frames {
                return Err(StepError::Disagree("the parts have different numbers of frames to interpolate"));
            }
            if let Some(&code) = codes[part].iter().find(|&&code| usize::from(code) > self.codes) {
                return Err(StepError::OutOfRange { what: "motion code", got: code.into(), limit: self.codes + 1 });
            }
            let masks = codes[part].iter().zip(codes.face);
            if masks.into_iter().any(|(&code, &face)| self.is_mask(code) != self.is_mask(face)) {
                return Err(StepError::Disagree("the parts are masked at different frames"));
            }
        }
        Ok(frames)
    }

    fn is_mask(&self, code: u16) -> bool {
        usize::from(code) == self.codes
    }

    /// Writes the code embeddings of every part to the tokens. Writes the sum of the embeddings, the frame's
    /// type and its position to the hidden rows.
    fn embed(&self, scratch: &mut InterpScratch, codes: PerPart<&[u16]>, frames: usize) {
        let is_known = |frame: usize| !self.is_mask(codes.face[frame]);
        self.trunk.embed(&mut scratch.trunk, frames, is_known, |frame, part, token| {
            let part = Part::ALL[part];
            self.embed[part].gather(usize::from(codes[part][frame]), token);
        });
    }

    /// Computes the logits of every part for the next `frames` frames.
    fn predict(&self, cx: Compute, s: &mut InterpScratch, frames: usize) -> Result<(), StepError> {
        if frames == 0 {
            return Ok(());
        }
        for (i, part) in Part::ALL.into_iter().enumerate() {
            let (x, quant) = self.trunk.outputs(&mut s.trunk, frames, i)?;
            let y = MatMut::new(&mut s.parts[i][s.frames * self.codes..], frames, self.codes)?;
            self.head[part].forward(cx, quant, x, Epilogue::STORE, y)?;
        }
        Ok(())
    }

    /// Selects the likeliest code of each masked frame of `range`, whose logits were computed last.
    fn choose(
        &self,
        cx: Compute,
        scratch: &InterpScratch,
        mut codes: PerPart<&mut [u16]>,
        range: Range<usize>,
    ) -> Result<(), StepError> {
        for part in Part::ALL {
            let logits = scratch.logits(part).chunks_exact(self.codes).skip(scratch.frames - range.len());
            let codes = codes[part].get_mut(range.clone());
            let codes = codes.ok_or(StepError::Disagree("interpolation was taken up with fewer frames"))?;
            for (code, logits) in codes.iter_mut().zip(logits) {
                if self.is_mask(*code) {
                    check_finite(logits, "interpolation logits")?;
                    let best = argmax(cx.isa, logits).unwrap_or(0);
                    *code = u16::try_from(best).expect("the config allows no more codes than a u16 holds");
                }
            }
        }
        Ok(())
    }
}
