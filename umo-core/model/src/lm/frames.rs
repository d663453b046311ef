//! Keyframes as positions of the language model (SPEC 2.13).

use umo_core_base::error::{LoadError, StepError};

use crate::weights::{Loader, Table};

/// Row of the history type.
const HISTORY: usize = 0;
/// Row of the start-of-chunk type.
const START: usize = 1;

/// The tables `lm.frames.*`.
#[derive(Debug)]
pub struct FrameTables {
    /// `[2, d_model]`
    kind: Table,
    /// `[levels * codes, d_model]` for each part.
    embed: Vec<Table>,
    /// Part, row of code 0, and number of codes, for each code of a keyframe.
    slots: Vec<(usize, usize, usize)>,
}

impl FrameTables {
    /// Loads the tables.
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

    /// Number of codes in a keyframe.
    pub fn codes(&self) -> usize {
        self.slots.len()
    }

    /// Number of values of each code of a keyframe.
    pub fn limits(&self) -> impl Iterator<Item = usize> {
        self.slots.iter().map(|&(_, _, codes)| codes)
    }

    /// Embeds a keyframe of the chunk: writes the sum of its codes' embeddings to `out [d_model]`.
    ///
    /// # Errors
    /// [`StepError`] if a code is out of range.
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

    /// Embeds a keyframe of the history: as [`Self::keyframe`], plus the history type.
    ///
    /// # Errors
    /// As [`Self::keyframe`].
    pub fn history(&self, codes: &[u16], out: &mut [f32]) -> Result<(), StepError> {
        self.keyframe(codes, out)?;
        self.kind.add(HISTORY, out);
        Ok(())
    }

    /// Writes the first input of a chunk.
    pub fn start(&self, out: &mut [f32]) {
        self.kind.gather(START, out);
    }
}
