//! Interpolation of keyframes' code vectors to the frames between them (SPEC 2.14). The layers of
//! [`Interp`](super::Interp) run on vectors. They predict the difference of a frame's vector from the linear
//! interpolation between the known frames on its two sides.

use std::ops::{Deref, DerefMut, Range};

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_kernels::gemm::Epilogue;
use umo_kernels::{Mat, MatMut};

use super::InterpScratch;
use super::trunk::{Filling, Trunk};
use crate::linear::{Compute, Linear};
use crate::weights::{Loader, Table};

/// The interpolation network of layout `frames`.
#[derive(Debug)]
pub struct VectorInterp {
    /// Projection of vectors to tokens, for each part with channels.
    input: Vec<Linear>,
    /// Tokens of a masked frame, one row per part.
    mask: Table,
    trunk: Trunk,
    head: Vec<Linear>,
    dim: usize,
}

impl VectorInterp {
    /// Loads `interp.*`.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (dim, mut parts) = (config.interp.d_model, config.part_list());
        parts.retain(|part| !part.is_annotation());
        let input = |name: &str, width| loader.linear_with_bias(&format!("interp.input.{name}"), dim, width);
        let head = |name: &str, width| loader.linear_with_bias(&format!("interp.head.{name}"), width, dim);
        Ok(Self {
            input: parts.iter().map(|part| input(&part.name, part.width)).collect::<Result<_, _>>()?,
            mask: loader.table("interp.mask.weight", parts.len(), dim)?,
            trunk: Trunk::load(loader, parts.len())?,
            head: parts.iter().map(|part| head(&part.name, part.width)).collect::<Result<_, _>>()?,
            dim,
        })
    }

    /// Maximum number of frames in one run.
    pub fn max_frames(&self) -> usize {
        self.trunk.max_frames()
    }

    /// Width of each part's vectors.
    pub fn widths(&self) -> impl ExactSizeIterator<Item = usize> {
        self.input.iter().map(Linear::inputs)
    }

    /// Allocates scratch for windows of up to `frames` frames, limited to the model's maximum.
    pub fn scratch(&self, frames: usize) -> InterpScratch {
        let widest = self.widths().max().unwrap_or(0);
        InterpScratch::new(&self.trunk, frames, self.input.len(), (self.dim, widest))
    }

    /// Fills the unknown frames of a window whose first frame is a keyframe; known frames do not change.
    /// Never allocates.
    ///
    /// Shapes: `vectors [T, width]` of each part; `known [T]`.
    ///
    /// # Errors
    /// As [`Self::fill_from`].
    pub fn fill(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        vectors: &mut [impl DerefMut<Target = [f32]>],
        known: &[bool],
    ) -> Result<(), StepError> {
        self.fill_from(cx, scratch, vectors, known, 0)
    }

    /// Fills only the unknown frames from `first` on, with the same bits as [`Self::fill`].
    ///
    /// # Errors
    /// [`StepError`] if there are no frames or more than `scratch` has room for, no frame is known, or the
    /// parts have different numbers of frames.
    pub fn fill_from(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        vectors: &mut [impl DerefMut<Target = [f32]>],
        known: &[bool],
        first: usize,
    ) -> Result<(), StepError> {
        let mut filling = self.begin(cx, scratch, vectors, known, first, usize::MAX)?;
        while self.step(cx, scratch, vectors, known, &mut filling)? {}
        Ok(())
    }

    /// Begins to fill the frames from `first` on, at most `piece` frames per step.
    ///
    /// # Errors
    /// As [`Self::fill_from`].
    pub fn begin(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        vectors: &[impl Deref<Target = [f32]>],
        known: &[bool],
        first: usize,
        piece: usize,
    ) -> Result<Filling, StepError> {
        let frames = known.len();
        if first >= frames || !known.contains(&true) {
            return Err(StepError::Empty("known frames to interpolate"));
        }
        if frames > scratch.max_frames {
            return Err(StepError::TooLong { what: "frames to interpolate", got: frames, limit: scratch.max_frames });
        }
        self.check(vectors, frames)?;
        for ((input, vectors), tokens) in self.input.iter().zip(vectors).zip(&mut scratch.parts) {
            let x = Mat::new(vectors, frames, input.inputs())?;
            input.forward(cx, &mut scratch.quant, x, Epilogue::STORE, MatMut::new(tokens, frames, self.dim)?)?;
        }
        let InterpScratch { trunk, parts: tokens, .. } = scratch;
        self.trunk.embed(
            trunk,
            frames,
            |frame| known[frame],
            |frame, part, out| match known[frame] {
                true => out.copy_from_slice(&tokens[part][frame * self.dim..][..self.dim]),
                false => self.mask.gather(part, out),
            },
        );
        Ok(self.trunk.begin(frames, first, piece))
    }

    /// Runs the next step of a filling begun with [`Self::begin`], with the same vectors; returns whether
    /// there is more to do. A step may fill no frames. The bits are the same as with [`Self::fill_from`].
    ///
    /// # Errors
    /// [`StepError`] if an output is not finite, or the number of frames differs from the beginning.
    pub fn step(
        &self,
        cx: Compute,
        scratch: &mut InterpScratch,
        vectors: &mut [impl DerefMut<Target = [f32]>],
        known: &[bool],
        filling: &mut Filling,
    ) -> Result<bool, StepError> {
        self.check(vectors, known.len())?;
        let InterpScratch { trunk, change, .. } = scratch;
        let range = self.trunk.step(cx, trunk, filling)?;
        if range.end > known.len() {
            return Err(StepError::Disagree("interpolation was taken up with fewer frames"));
        }
        if range.is_empty() {
            return Ok(!filling.is_done());
        }
        for (part, (head, vectors)) in self.head.iter().zip(vectors).enumerate() {
            let width = head.outputs();
            let (x, quant) = self.trunk.outputs(trunk, range.len(), part)?;
            head.forward(cx, quant, x, Epilogue::STORE, MatMut::new(change, range.len(), width)?)?;
            check_finite(&change[..range.len() * width], "interpolated vectors")?;
            lines(known, range.clone(), width, vectors);
            let asked = rows(&mut vectors[range.start * width..], change, width).zip(&known[range.clone()]);
            for ((row, change), _) in asked.filter(|(_, known)| !**known) {
                row.iter_mut().zip(change).for_each(|(v, change)| *v += change);
            }
        }
        Ok(!filling.is_done())
    }

    /// Checks that every part has `frames` frames.
    fn check(&self, vectors: &[impl Deref<Target = [f32]>], frames: usize) -> Result<(), StepError> {
        let lengths = vectors.iter().map(|vectors| vectors.len());
        match lengths.eq(self.widths().map(|width| width * frames)) {
            true => Ok(()),
            false => Err(StepError::Disagree("the parts have different numbers of frames to interpolate")),
        }
    }
}

fn rows<'a>(a: &'a mut [f32], b: &'a [f32], width: usize) -> impl Iterator<Item = (&'a mut [f32], &'a [f32])> {
    a.chunks_exact_mut(width).zip(b.chunks_exact(width))
}

/// Writes the linear interpolation between known rows of `vectors [T, width]` to the other rows of `range`.
/// Rows before the first known row or after the last get its values.
#[expect(clippy::cast_precision_loss, reason = "windows have far fewer than 2^24 frames")]
fn lines(known: &[bool], range: Range<usize>, width: usize, vectors: &mut [f32]) {
    let mut before = known[..range.start].iter().rposition(|known| *known);
    for frame in range {
        if known[frame] {
            before = Some(frame);
            continue;
        }
        let after = (frame + 1..known.len()).find(|&frame| known[frame]);
        let (from, to, share) = match (before, after) {
            (Some(from), Some(to)) => (from, to, (frame - from) as f32 / (to - from) as f32),
            (Some(at), None) | (None, Some(at)) => (at, at, 0.0),
            (None, None) => return,
        };
        for i in 0..width {
            let (a, b) = (vectors[from * width + i], vectors[to * width + i]);
            vectors[frame * width + i] = a + share * (b - a);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::lines;

    #[test]
    fn lines_run_between_known_rows_and_are_level_beyond_them() {
        let known = [false, true, false, false, false, true, false];
        let mut vectors = [9.0, 9.0, 1.0, -2.0, 9.0, 9.0, 9.0, 9.0, 9.0, 9.0, 3.0, 2.0, 9.0, 9.0];
        let (mut later, mut some) = (vectors, vectors);
        lines(&known, 0..7, 2, &mut vectors);
        assert_eq!(vectors, [1.0, -2.0, 1.0, -2.0, 1.5, -1.0, 2.0, 0.0, 2.5, 1.0, 3.0, 2.0, 3.0, 2.0]);
        lines(&known, 3..7, 2, &mut later);
        lines(&known, 3..4, 2, &mut some);
        assert_eq!(later[..6], [9.0, 9.0, 1.0, -2.0, 9.0, 9.0]);
        assert_eq!(later[6..], vectors[6..]);
        assert_eq!(some[6..8], vectors[6..8]);
        assert_eq!(some[8..10], [9.0, 9.0]);
    }
}
