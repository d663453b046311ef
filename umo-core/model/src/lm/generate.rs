//! Generation of a chunk's codes: the decoder's forced block structure, several rows per pass (paper section
//! 3.1; SPEC 2.5).

use umo_kernels::Mat;

use super::decoder::Sequence;
use super::sampler::{Rank, Sampler};
use super::{Lm, LmScratch};
use crate::config::{Config, Modality, Sampling};
use crate::linear::Compute;
use umo_core_base::error::{StepError, check_finite};
use umo_core_base::memory::filled;
use umo_core_pose::part::{Part, PerPart};

/// Name of each part's decoder output in errors.
const LOGITS: PerPart<&str> =
    PerPart { face: "face logits", hands: "hands logits", upper: "upper body logits", lower: "lower body logits" };

/// Marker ids and scratch memory for generating chunks.
#[derive(Debug)]
pub struct Generator {
    start: u32,
    parts: PerPart<Modality>,
    sampling: PerPart<Option<Sampling>>,
    /// `[codes]`.
    logits: Box<[f32]>,
    /// `[codes]`.
    ranks: Box<[Rank]>,
}

/// Sampling of one chunk's codes, and their number.
#[derive(Clone, Copy, Debug)]
pub struct ChunkSampling {
    /// Temperature, top-k, top-p and seed.
    pub sampler: Sampler,
    /// Number of the chunk in its stream.
    pub chunk: u64,
    /// Number of codes per part.
    pub target: usize,
}

/// Position of the next code in a sequence.
#[derive(Clone, Copy, Debug, Default)]
pub struct Position {
    part: usize,
    index: usize,
}

impl Generator {
    /// Creates a generator for models of this config.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    pub fn new(config: &Config) -> Self {
        Self {
            start: config.vocab.decoder_start as u32,
            parts: PerPart::from_fn(|part| config.vocab[part]),
            sampling: config.part_sampling(),
            logits: filled(0.0, config.part_codes()).into(),
            ranks: filled(Rank::default(), config.part_codes()).into(),
        }
    }

    /// Generates `codes`, the same number for every part, from encoder states.
    ///
    /// Markers are never sampled: `start(face)` joins the first pass, and `end(face) start(hands)` joins the
    /// pass of the last face code. So `4N` codes take `4N` passes over the weights.
    ///
    /// # Errors
    /// [`StepError`] if there are more codes than the sequence has room for.
    #[expect(
        clippy::too_many_arguments,
        reason = "the model, its scratch, its input, its sequence, the sampling, the output"
    )]
    pub fn generate(
        &mut self,
        cx: Compute,
        lm: &Lm,
        scratch: &mut LmScratch,
        states: Mat<f32>,
        sequence: &mut Sequence,
        sampling: ChunkSampling,
        mut codes: PerPart<&mut [u16]>,
    ) -> Result<(), StepError> {
        lm.attend_to(cx, scratch, states, sequence)?;
        let mut at = self.begin(sequence)?;
        loop {
            lm.decode(cx, scratch, std::slice::from_mut(sequence))?;
            let row = sequence.ids().len() - 1;
            if !self.write(cx, lm, scratch, row, sampling, &mut at, &mut codes, sequence)? {
                return Ok(());
            }
        }
    }

    /// Sets the ids of the first pass of `sequence`, which already attends to its encoder states.
    ///
    /// # Errors
    /// [`StepError`] if the sequence has no room for them.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    pub fn begin(&self, sequence: &mut Sequence) -> Result<Position, StepError> {
        sequence.set_ids(&[self.start, self.parts[Part::ALL[0]].start as u32])?;
        Ok(Position::default())
    }

    /// Samples a code from row `row` of the last pass, which is the last row of this sequence. Sets the ids
    /// of the next pass of `sequence`: the code, and the markers forced after it. Returns whether there is a
    /// next pass; after the last, the sequence has no ids.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    #[expect(clippy::cast_possible_truncation, reason = "codes and ids fit their types by the config's checks")]
    #[expect(
        clippy::too_many_arguments,
        reason = "the model, its scratch, its row, the sampling, the position, the output"
    )]
    pub fn write(
        &mut self,
        cx: Compute,
        lm: &Lm,
        scratch: &mut LmScratch,
        row: usize,
        sampling: ChunkSampling,
        at: &mut Position,
        codes: &mut PerPart<&mut [u16]>,
        sequence: &mut Sequence,
    ) -> Result<bool, StepError> {
        let part = Part::ALL[at.part];
        lm.code_logits(cx, scratch, row, part, &mut self.logits)?;
        check_finite(&self.logits, LOGITS[part])?;
        let position = at.part * sampling.target + at.index;
        let code = sampling.sampler.of(self.sampling[part]).sample(
            &self.logits,
            &mut self.ranks,
            sampling.chunk,
            position as u32,
        );
        codes[part][at.index] = code as u16;
        let m = &self.parts[part];
        let id = (m.first + code) as u32;
        at.index += 1;
        if at.index < sampling.target {
            sequence.set_ids(&[id])?;
            return Ok(true);
        }
        *at = Position { part: at.part + 1, index: 0 };
        match Part::ALL.get(at.part) {
            Some(&next) => sequence.set_ids(&[id, m.end as u32, self.parts[next].start as u32])?,
            None => sequence.set_ids(&[])?,
        }
        Ok(at.part < Part::ALL.len())
    }
}
