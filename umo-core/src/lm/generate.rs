//! A chunk's codes: the decoder's forced block structure, several rows per pass (paper section 3.1; SPEC 2.5).

use umo_kernels::Mat;

use super::decoder::{DecoderCache, Sequence};
use super::sampler::Sampler;
use super::{Lm, LmScratch};
use crate::config::{Config, Modality};
use crate::error::StepError;
use crate::linear::Compute;
use crate::part::{Part, PerPart};

/// What generating a chunk needs beside the model: the ids of markers, and scratch.
#[derive(Debug)]
pub struct Generator {
    start: u32,
    parts: PerPart<Modality>,
    /// `[codes]`.
    logits: Box<[f32]>,
    /// `[codes]`.
    order: Box<[u16]>,
}

impl Generator {
    /// For models of this config.
    #[expect(clippy::cast_possible_truncation, reason = "ids are below the vocabulary's size, at most 2^22")]
    pub fn new(config: &Config) -> Self {
        Self {
            start: config.vocab.decoder_start as u32,
            parts: PerPart::from_fn(|part| config.vocab[part]),
            logits: vec![0.0; config.vq.codes].into(),
            order: vec![0; config.vq.codes].into(),
        }
    }

    /// Writes `codes`, the same number for every part, from encoder states.
    ///
    /// Markers are never sampled: `start(face)` joins the first pass, `end(face) start(hands)` the pass of the last face
    /// code, so that `4N` codes take `4N` passes over the weights.
    ///
    /// # Errors
    /// [`StepError`] where there are more codes than the cache has room for.
    #[expect(clippy::cast_possible_truncation, reason = "codes and ids fit their types by the config's checks")]
    #[expect(clippy::too_many_arguments, reason = "the model, its scratch, its input, its cache, the draw, the output")]
    pub fn generate(
        &mut self,
        cx: Compute,
        lm: &Lm,
        scratch: &mut LmScratch,
        states: Mat<f32>,
        cache: &mut DecoderCache,
        (sampler, chunk): (Sampler, u64),
        mut codes: PerPart<&mut [u16]>,
    ) -> Result<(), StepError> {
        lm.attend_to(cx, scratch, states, cache)?;
        let mut pending = Pending { ids: [self.start, 0, 0], len: 1 };
        let mut position = 0;
        for part in Part::ALL {
            let m = self.parts[part];
            pending.push(m.start as u32);
            for code in codes[part].iter_mut() {
                lm.decode(cx, scratch, &mut [Sequence { ids: pending.ids(), cache: &mut *cache }])?;
                lm.code_logits(cx, scratch, pending.len - 1, part, &mut self.logits)?;
                let sampled = sampler.sample(&self.logits, &mut self.order, chunk, position);
                *code = sampled as u16;
                position += 1;
                pending = Pending { ids: [(m.first + sampled) as u32, 0, 0], len: 1 };
            }
            pending.push(m.end as u32);
        }
        Ok(())
    }
}

/// Ids that the next pass takes: a code, and the markers that are forced after it.
struct Pending {
    ids: [u32; 3],
    len: usize,
}

impl Pending {
    fn push(&mut self, id: u32) {
        self.ids[self.len] = id;
        self.len += 1;
    }

    fn ids(&self) -> &[u32] {
        &self.ids[..self.len]
    }
}
