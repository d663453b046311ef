//! Keyframes to dense codes: a small bidirectional transformer over frames, then over parts (SPEC 2.6).

mod layer;

use umo_kernels::activation::argmax;
use umo_kernels::gemm::Epilogue;
use umo_kernels::norm::layer_norm;
use umo_kernels::{Mat, MatMut};

use crate::error::{LoadError, StepError, check_finite};
use crate::linear::{Compute, Linear};
use crate::memory::filled;
use crate::part::{Part, PerPart};
use crate::weights::{Loader, Table};
use layer::{EPS, Layer, LayerScratch, Norm};

const PARTS: usize = Part::ALL.len();

/// What the network is told of a frame: its row in the table of frame types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FrameType {
    /// Its codes are known, and it is on the grid of keyframes.
    Keyframe = 0,
    /// Its codes are to be filled in.
    Masked = 1,
    /// Its codes are known, off the grid: the last frame before the masked ones.
    LastValid = 2,
}

/// The interpolation network.
#[derive(Debug)]
pub struct Interp {
    embed: PerPart<Table>,
    frame_type: Table,
    position: Table,
    temporal: Vec<Layer>,
    part: Vec<Layer>,
    norm: Norm,
    head: PerPart<Linear>,
    dim: usize,
    stride: usize,
    codes: usize,
    max_frames: usize,
}

/// Room for one run of the network.
#[derive(Debug)]
pub struct InterpScratch {
    /// `[frames, dim]`, the sum of what is known of each frame, then what the temporal layers make of it
    hidden: Box<[f32]>,
    /// `[frames * parts, dim]`, each part's token of each frame
    tokens: Box<[f32]>,
    /// `[frames * parts, dim]`, the final norm of the tokens
    normed: Box<[f32]>,
    layer: LayerScratch,
    /// `[frames, codes]` of each part
    logits: PerPart<Box<[f32]>>,
    frames: usize,
    max_frames: usize,
    codes: usize,
}

impl InterpScratch {
    /// The logits `[T, codes]` of `part` in the last run, for every frame, known or filled.
    pub fn logits(&self, part: Part) -> &[f32] {
        &self.logits[part][..self.frames * self.codes]
    }
}

impl Interp {
    /// Loads `interp.*`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (sizes, codes) = (&config.interp, config.vq.codes);
        let dim = sizes.d_model;
        let layers = |group: &str, count: usize| {
            (0..count).map(|i| Layer::load(loader, &format!("interp.{group}.{i}"), sizes)).collect::<Result<_, _>>()
        };
        Ok(Self {
            embed: PerPart::try_from_fn(|part| {
                loader.table(&format!("interp.embed.{}.weight", part.name()), codes + 1, dim)
            })?,
            frame_type: loader.table("interp.frame_type.weight", 3, dim)?,
            position: loader.table("interp.position.weight", sizes.max_frames, dim)?,
            temporal: layers("temporal", sizes.temporal_layers)?,
            part: layers("part", sizes.part_layers)?,
            norm: Norm::load(loader, "interp.norm", dim)?,
            head: PerPart::try_from_fn(|part| {
                loader.linear_with_bias(&format!("interp.head.{}", part.name()), codes, dim)
            })?,
            dim,
            stride: config.keyframe_stride,
            codes,
            max_frames: sizes.max_frames,
        })
    }

    /// The most frames of one run.
    pub fn max_frames(&self) -> usize {
        self.max_frames
    }

    /// The code that stands for one to be filled in.
    pub fn mask(&self) -> usize {
        self.codes
    }

    /// Room for windows of up to `frames` frames, and no more than the model allows.
    pub fn scratch(&self, frames: usize) -> InterpScratch {
        let max_frames = frames.min(self.max_frames);
        let rows = max_frames * PARTS;
        let room = |rows: usize, cols: usize| filled(0.0, rows * cols).into_boxed_slice();
        let ffn = self.temporal.iter().chain(&self.part).map(Layer::ffn_dim).max().unwrap_or(0);
        InterpScratch {
            hidden: room(max_frames, self.dim),
            tokens: room(rows, self.dim),
            normed: room(rows, self.dim),
            layer: LayerScratch::new(rows, self.dim, ffn),
            logits: PerPart::from_fn(|_| room(max_frames, self.codes)),
            frames: 0,
            max_frames,
            codes: self.codes,
        }
    }

    /// Fills the masked frames of a window whose first frame is a keyframe; known codes stay as they are.
    /// Never allocates.
    ///
    /// Shapes: `codes [T]` of each part, [`mask`](Self::mask) where unknown, in all parts alike; overwritten there by the
    /// code with the largest logit, the lowest of equals.
    /// Cost: `T * dim * (4 dim + 2 ffn_dim)` multiply-adds per temporal layer, four times that per part layer.
    ///
    /// # Errors
    /// [`StepError`] where there is no frame or more than `scratch` has room for, the parts have different numbers of
    /// codes or different masks, or a code is neither a code nor the mask; nothing is filled then.
    pub fn fill(&self, cx: Compute, scratch: &mut InterpScratch, codes: PerPart<&mut [u16]>) -> Result<(), StepError> {
        let known = PerPart { face: &*codes.face, hands: &*codes.hands, upper: &*codes.upper, lower: &*codes.lower };
        scratch.frames = 0;
        let frames = self.check(scratch, known)?;
        self.embed(scratch, known, frames);
        let hidden = &mut scratch.hidden[..frames * self.dim];
        for layer in &self.temporal {
            layer.run(cx, &mut scratch.layer, frames, hidden)?;
        }
        for (tokens, hidden) in scratch.tokens.chunks_exact_mut(PARTS * self.dim).zip(hidden.chunks_exact(self.dim)) {
            for token in tokens.chunks_exact_mut(self.dim) {
                token.iter_mut().zip(hidden).for_each(|(token, hidden)| *token += hidden);
            }
        }
        let tokens = &mut scratch.tokens[..frames * PARTS * self.dim];
        for layer in &self.part {
            layer.run(cx, &mut scratch.layer, PARTS, tokens)?;
        }
        self.predict(cx, scratch, frames)?;
        scratch.frames = frames;
        self.choose(cx, scratch, codes)
    }

    /// The number of frames, where everything about `codes` is as it must be.
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

    /// The code vectors of every part to the tokens; their sum, the frame's type and its position to the hidden rows.
    fn embed(&self, scratch: &mut InterpScratch, codes: PerPart<&[u16]>, frames: usize) {
        let rows = scratch.hidden.chunks_exact_mut(self.dim).zip(scratch.tokens.chunks_exact_mut(PARTS * self.dim));
        for (frame, (hidden, tokens)) in rows.take(frames).enumerate() {
            hidden.fill(0.0);
            for (part, token) in Part::ALL.into_iter().zip(tokens.chunks_exact_mut(self.dim)) {
                self.embed[part].gather(usize::from(codes[part][frame]), token);
                hidden.iter_mut().zip(&*token).for_each(|(hidden, token)| *hidden += token);
            }
            let kind = match self.is_mask(codes.face[frame]) {
                true => FrameType::Masked,
                false if frame.is_multiple_of(self.stride) => FrameType::Keyframe,
                false => FrameType::LastValid,
            };
            self.frame_type.add(kind as usize, hidden);
            self.position.add(frame, hidden);
        }
    }

    /// The logits of every part and frame.
    fn predict(&self, cx: Compute, s: &mut InterpScratch, frames: usize) -> Result<(), StepError> {
        let rows = frames * PARTS;
        let x = Mat::new(&s.tokens, rows, self.dim)?;
        layer_norm(cx.isa, x, &self.norm.weight, &self.norm.bias, EPS, MatMut::new(&mut s.normed, rows, self.dim)?)?;
        for (i, part) in Part::ALL.into_iter().enumerate() {
            let x = Mat::with_stride(&s.normed[i * self.dim..], frames, self.dim, PARTS * self.dim)?;
            let y = MatMut::new(&mut s.logits[part], frames, self.codes)?;
            self.head[part].forward(cx, s.layer.quant(), x, Epilogue::STORE, y)?;
        }
        Ok(())
    }

    /// The likeliest code of each masked frame.
    fn choose(&self, cx: Compute, scratch: &InterpScratch, mut codes: PerPart<&mut [u16]>) -> Result<(), StepError> {
        for part in Part::ALL {
            let logits = scratch.logits(part).chunks_exact(self.codes);
            for (code, logits) in codes[part].iter_mut().zip(logits) {
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
