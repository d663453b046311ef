//! Generation of a chunk's codes: the decoder's forced block structure, several rows per pass (paper section
//! 3.1; SPEC 2.5).

use std::sync::Arc;

use umo_core_base::error::{LoadError, StepError, check_finite};
use umo_core_base::memory::filled;
use umo_core_pose::part::{Part, PerPart};
use umo_kernels::gemm::Epilogue;
use umo_kernels::{Mat, MatMut};

use super::decoder::Sequence;
use super::sampler::{Rank, Sampler};
use super::{Lm, LmScratch, head_name, head_scale};
use crate::config::{Config, Modality, Sampling};
use crate::linear::{Compute, Linear};
use crate::weights::Loader;

/// Name of each part's decoder output in errors.
const LOGITS: PerPart<&str> =
    PerPart { face: "face logits", hands: "hands logits", upper: "upper body logits", lower: "lower body logits" };

/// Output heads for the codes of each part: the rows of the language model's head that can be sampled.
#[derive(Debug)]
pub struct Heads {
    parts: PerPart<Linear>,
    /// Factor applied to hidden states before the head: `d_model^-0.5` if the head is tied to the embedding.
    scale: f32,
    d_model: usize,
}

impl Heads {
    /// Loads the heads.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor.
    pub fn load(loader: &Loader) -> Result<Self, LoadError> {
        let config = loader.file().config();
        let (d_model, vocab) = (config.lm.d_model, config.vocab.size);
        if !config.lm.tie_word_embeddings {
            loader.check_values(head_name(config), vocab, d_model)?;
        }
        let head = |part| {
            let m = &config.vocab[part];
            loader.exact().linear_rows(head_name(config), vocab, m.first..m.first + m.codes, d_model)
        };
        Ok(Self { parts: PerPart::try_from_fn(head)?, scale: head_scale(config), d_model })
    }

    /// Computes the logits of `part`'s codes for row `row` of the last [`Lm::decode`], into `logits [codes]`.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    pub fn logits(
        &self,
        cx: Compute,
        scratch: &mut LmScratch,
        row: usize,
        part: Part,
        logits: &mut [f32],
    ) -> Result<(), StepError> {
        let head = &self.parts[part];
        let state = Mat::new(&scratch.normed[row * self.d_model..], 1, self.d_model)?;
        let y = MatMut::new(logits, 1, head.outputs())?;
        head.forward(cx, &mut scratch.quant, state, Epilogue::STORE, y)?;
        if self.scale != 1.0 {
            logits.iter_mut().for_each(|v| *v *= self.scale);
        }
        Ok(())
    }
}

/// Output heads, marker ids and scratch memory for generating chunks.
#[derive(Debug)]
pub struct Generator {
    heads: Arc<Heads>,
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
    pub fn new(config: &Config, heads: Arc<Heads>) -> Self {
        Self {
            heads,
            start: config.vocab.decoder_start as u32,
            parts: PerPart::from_fn(|part| config.vocab[part]),
            sampling: config.part_sampling(),
            logits: filled(0.0, config.part_codes()).into(),
            ranks: filled(Rank::default(), config.part_codes()).into(),
        }
    }

    /// Generates `codes [target, parts]` from encoder states.
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
        codes: &mut [u16],
    ) -> Result<(), StepError> {
        lm.attend_to(cx, scratch, states, sequence)?;
        let mut at = self.begin(sequence)?;
        loop {
            lm.decode(cx, scratch, std::slice::from_mut(sequence))?;
            let row = sequence.ids().len() - 1;
            if !self.write(cx, scratch, row, sampling, &mut at, codes, sequence)? {
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

    /// Samples a code from row `row` of the last pass, which is the last row of this sequence, and writes it to
    /// `codes [target, parts]`. Sets the ids
    /// of the next pass of `sequence`: the code, and the markers forced after it. Returns whether there is a
    /// next pass; after the last, the sequence has no ids.
    ///
    /// # Errors
    /// [`StepError`] if a length disagrees.
    #[expect(clippy::cast_possible_truncation, reason = "codes and ids fit their types by the config's checks")]
    #[expect(
        clippy::too_many_arguments,
        reason = "the model's scratch, its row, the sampling, the position, the output"
    )]
    pub fn write(
        &mut self,
        cx: Compute,
        scratch: &mut LmScratch,
        row: usize,
        sampling: ChunkSampling,
        at: &mut Position,
        codes: &mut [u16],
        sequence: &mut Sequence,
    ) -> Result<bool, StepError> {
        let part = Part::ALL[at.part];
        self.heads.logits(cx, scratch, row, part, &mut self.logits)?;
        check_finite(&self.logits, LOGITS[part])?;
        let position = at.part * sampling.target + at.index;
        let code = sampling.sampler.of(self.sampling[part]).sample(
            &self.logits,
            &mut self.ranks,
            sampling.chunk,
            position as u32,
        );
        codes[at.index * Part::ALL.len() + at.part] = code as u16;
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
