//! What a keyframe is as one position of the language model (SPEC 2.13).

use crate::error::{LoadError, StepError};
use crate::weights::{Loader, Table};

/// Row of the history's type.
const HISTORY: usize = 0;
/// Row of the start of a chunk.
const START: usize = 1;

/// `lm.frames.*`.
#[derive(Debug)]
pub struct FrameTables {
    /// `[2, d_model]`
    kind: Table,
    /// `[levels * codes, d_model]` of each part.
    embed: Vec<Table>,
    /// Part, row of code 0, and codes of each code of a keyframe.
    slots: Vec<(usize, usize, usize)>,
}

impl FrameTables {
    /// Loads them.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (d, parts) = (config.lm.d_model, config.part_list());
        let slots = parts
            .iter()
            .enumerate()
            .flat_map(|(part, spec)| (0..spec.levels).map(move |level| (part, level * spec.codes, spec.codes)));
        let table = |(name, rows): (&str, usize)| loader.table(&format!("lm.frames.embed.{name}.weight"), rows, d);
        Ok(Self {
            kind: loader.table("lm.frames.type.weight", 2, d)?,
            slots: slots.collect(),
            embed: parts.iter().map(|part| table((&part.name, part.levels * part.codes))).collect::<Result<_, _>>()?,
        })
    }

    /// Codes of a keyframe.
    pub fn codes(&self) -> usize {
        self.slots.len()
    }

    /// Numbers of codes of each of them.
    pub fn limits(&self) -> impl Iterator<Item = usize> {
        self.slots.iter().map(|&(_, _, codes)| codes)
    }

    /// A keyframe of the chunk: the sum of its codes' embeddings, into `out [d_model]`.
    ///
    /// # Errors
    /// [`StepError`] where a code is out of range.
    pub fn keyframe(&self, codes: &[u16], out: &mut [f32]) -> Result<(), StepError> {
        out.fill(0.0);
        for (&(part, first, limit), &code) in self.slots.iter().zip(codes) {
            let code = usize::from(code);
            if code >= limit {
                return Err(StepError::OutOfRange { what: "motion code", got: code, limit });
            }
            self.embed[part].add(first + code, out);
        }
        Ok(())
    }

    /// A keyframe of the history: the same, and the history's type.
    ///
    /// # Errors
    /// As [`Self::keyframe`].
    pub fn history(&self, codes: &[u16], out: &mut [f32]) -> Result<(), StepError> {
        self.keyframe(codes, out)?;
        self.kind.add(HISTORY, out);
        Ok(())
    }

    /// The first input of a chunk.
    pub fn start(&self, out: &mut [f32]) {
        self.kind.gather(START, out);
    }
}
