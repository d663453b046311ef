//! Common part of both interpolation networks, between their inputs and their heads: frame types, positions,
//! layers over frames and over parts (SPEC 2.6).

use std::ops::Range;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::filled;
use umo_kernels::norm::layer_norm;
use umo_kernels::{Mat, MatMut};

use super::layer::{EPS, Layer, LayerScratch, Norm};
use crate::linear::{Compute, QuantScratch};
use crate::weights::{Loader, Table};

/// Type of a frame: its row in the table of frame types.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FrameType {
    /// Known, on the grid of keyframes.
    Keyframe = 0,
    /// To be filled.
    Masked = 1,
    /// Known, off the grid: the last frame before the masked ones.
    LastValid = 2,
}

/// Progress of an interpolation, which can be interrupted between two steps.
#[derive(Clone, Copy, Debug)]
pub struct Filling {
    frames: usize,
    /// The next layer over frames.
    layer: usize,
    /// The next frame to fill.
    next: usize,
    /// Number of frames that one step fills.
    piece: usize,
}

impl Filling {
    /// Number of frames to fill per step for short steps, with `parts` parts per frame. Such a step takes
    /// about as long as a layer over the frames of a window.
    pub fn short_piece(parts: usize) -> usize {
        (SHORT_ROWS / parts.max(1)).max(1)
    }

    /// Whether every frame is filled.
    pub(super) fn is_done(&self) -> bool {
        self.next == self.frames
    }
}

/// Number of tokens in a short piece.
const SHORT_ROWS: usize = 32;

/// The layers.
#[derive(Debug)]
pub(super) struct Trunk {
    frame_type: Table,
    position: Table,
    temporal: Vec<Layer>,
    part: Vec<Layer>,
    norm: Norm,
    parts: usize,
    dim: usize,
    stride: usize,
    max_frames: usize,
}

/// Scratch memory for one run.
#[derive(Debug)]
pub(super) struct TrunkScratch {
    /// `[frames, dim]`: the embedded frames, then the output of the temporal layers.
    hidden: Box<[f32]>,
    /// `[frames * parts, dim]`: the token of each part of each frame.
    tokens: Box<[f32]>,
    /// `[frames * parts, dim]`: the final norm of a piece's tokens.
    normed: Box<[f32]>,
    layer: LayerScratch,
}

impl Trunk {
    /// Loads `interp.frame_type`, `interp.position`, the layers and `interp.norm`.
    pub(super) fn load(loader: &Loader, parts: usize) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (sizes, dim) = (&config.interp, config.interp.d_model);
        let layers = |group: &str, count: usize| {
            (0..count).map(|i| Layer::load(loader, &format!("interp.{group}.{i}"), sizes)).collect::<Result<_, _>>()
        };
        Ok(Self {
            frame_type: loader.table("interp.frame_type.weight", 3, dim)?,
            position: loader.table("interp.position.weight", sizes.max_frames, dim)?,
            temporal: layers("temporal", sizes.temporal_layers)?,
            part: layers("part", sizes.part_layers)?,
            norm: Norm::load(loader, "interp.norm", dim)?,
            parts,
            dim,
            stride: config.keyframe_stride,
            max_frames: sizes.max_frames,
        })
    }

    pub(super) fn max_frames(&self) -> usize {
        self.max_frames
    }

    pub(super) fn scratch(&self, frames: usize) -> TrunkScratch {
        let rows = frames * self.parts;
        let room = |rows: usize| filled(0.0, rows * self.dim).into_boxed_slice();
        let ffn = self.temporal.iter().chain(&self.part).map(Layer::ffn_dim).max().unwrap_or(0);
        TrunkScratch {
            hidden: room(frames),
            tokens: room(rows),
            normed: room(rows),
            layer: LayerScratch::new(rows, self.dim, ffn),
        }
    }

    /// Writes every token with `token(frame, part, out)`. Writes the sum of a frame's tokens, its type and
    /// its position to the hidden rows.
    pub(super) fn embed(
        &self,
        s: &mut TrunkScratch,
        frames: usize,
        is_known: impl Fn(usize) -> bool,
        mut token: impl FnMut(usize, usize, &mut [f32]),
    ) {
        let rows = s.hidden.chunks_exact_mut(self.dim).zip(s.tokens.chunks_exact_mut(self.parts * self.dim));
        for (frame, (hidden, tokens)) in rows.take(frames).enumerate() {
            hidden.fill(0.0);
            for (part, out) in tokens.chunks_exact_mut(self.dim).enumerate() {
                token(frame, part, out);
                hidden.iter_mut().zip(&*out).for_each(|(hidden, token)| *hidden += token);
            }
            let kind = match is_known(frame) {
                false => FrameType::Masked,
                true if frame.is_multiple_of(self.stride) => FrameType::Keyframe,
                true => FrameType::LastValid,
            };
            self.frame_type.add(kind as usize, hidden);
            self.position.add(frame, hidden);
        }
    }

    /// Begins a run over `frames` frames for the outputs from `first` on; earlier frames are only read.
    /// Outputs are computed `piece` frames at a time.
    pub(super) fn begin(&self, frames: usize, first: usize, piece: usize) -> Filling {
        Filling { frames, layer: 0, next: first, piece: piece.max(1) }
    }

    /// Runs one layer over all frames or, after these layers, the remaining layers for the next piece of
    /// frames. Returns the frames of that piece, whose tokens [`Self::outputs`] then returns; the range is
    /// empty after a layer over frames. The first step starts from the output of [`Self::embed`].
    pub(super) fn step(
        &self,
        cx: Compute,
        s: &mut TrunkScratch,
        filling: &mut Filling,
    ) -> Result<Range<usize>, StepError> {
        let (dim, parts, Filling { frames, layer, next, piece }) = (self.dim, self.parts, *filling);
        let hidden = &mut s.hidden[..frames * dim];
        if let Some(temporal) = self.temporal.get(layer) {
            filling.layer += 1;
            match filling.layer == self.temporal.len() {
                false => temporal.run(cx, &mut s.layer, frames, hidden)?,
                true => temporal.run_from(cx, &mut s.layer, next, hidden)?,
            }
            return Ok(next..next);
        }
        let range = next..frames.min(next.saturating_add(piece));
        filling.next = range.end;
        let tokens = &mut s.tokens[range.start * parts * dim..range.end * parts * dim];
        let hidden = &hidden[range.start * dim..];
        for (tokens, hidden) in tokens.chunks_exact_mut(parts * dim).zip(hidden.chunks_exact(dim)) {
            for token in tokens.chunks_exact_mut(dim) {
                token.iter_mut().zip(hidden).for_each(|(token, hidden)| *token += hidden);
            }
        }
        for layer in &self.part {
            layer.run(cx, &mut s.layer, parts, tokens)?;
        }
        let rows = range.len() * parts;
        let x = Mat::new(tokens, rows, dim)?;
        layer_norm(cx.isa, x, &self.norm.weight, &self.norm.bias, EPS, MatMut::new(&mut s.normed, rows, dim)?)?;
        Ok(range)
    }

    /// Returns the normed tokens `[frames, dim]` of one part for the last piece, which has `frames` frames,
    /// and scratch to quantize them.
    pub(super) fn outputs<'a>(
        &self,
        s: &'a mut TrunkScratch,
        frames: usize,
        part: usize,
    ) -> Result<(Mat<'a, f32>, &'a mut QuantScratch), StepError> {
        let x = Mat::with_stride(&s.normed[part * self.dim..], frames, self.dim, self.parts * self.dim)?;
        Ok((x, s.layer.quant()))
    }
}
