//! Free text to ids, by the SentencePiece model in the file (SPEC 2.2, 2.3).
//!
//! Only what a T5 vocabulary needs of SentencePiece is here: unigram models with their own table of
//! characters. The libraries at hand put a Unicode normalisation of their own in the table's place,
//! and take words such as `</s>` in a text for markers; the ids must be those that the language
//! model was trained with, so the table is read instead.

mod normalizer;
mod proto;
mod unigram;

use normalizer::Normalizer;
use proto::Proto;
use unigram::Unigram;

use super::layout::MAX_PROMPT_TOKENS;
use crate::error::{LoadError, StepError};
use crate::memory;
use crate::weights::ModelFile;

/// Name of the tensor that holds a SentencePiece model.
pub const TOKENIZER: &str = "text.tokenizer";

/// A text tokenizer.
#[derive(Debug)]
pub struct TextTokenizer {
    normalizer: Normalizer,
    unigram: Unigram,
    /// Ids from here on are not in the vocabulary.
    limit: usize,
}

impl TextTokenizer {
    /// The tokenizer of a model, where it has one.
    ///
    /// # Errors
    /// [`LoadError`] if the tensor is no SentencePiece model.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
    pub fn load(file: &ModelFile) -> Result<Option<Self>, LoadError> {
        if !file.has(TOKENIZER) {
            return Ok(None);
        }
        // Its pieces, each in maps and strings of its own.
        memory::require(8 * file.raw(TOKENIZER)?.len());
        Self::from_bytes(file.raw(TOKENIZER)?, file.config().vocab.size).map(Some)
    }

    /// A tokenizer from the bytes of a SentencePiece unigram model, for a vocabulary of `limit`
    /// ids.
    ///
    /// # Errors
    /// [`LoadError`] if the bytes are no such model.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
    pub fn from_bytes(bytes: &[u8], limit: usize) -> Result<Self, LoadError> {
        let wrong =
            |problem: String| LoadError::tensor(TOKENIZER, format!("expected a SentencePiece model: {problem}"));
        let proto = Proto::parse(bytes).map_err(|problem| wrong(problem.to_owned()))?;
        let normalizer = Normalizer::new(&proto).map_err(|problem| wrong(problem.to_owned()))?;
        Ok(Self { normalizer, unigram: Unigram::new(&proto).map_err(wrong)?, limit })
    }

    /// The ids of a text of any length, without an end marker.
    #[cfg_attr(not(feature = "internals"), doc(hidden))]
    pub fn split(&self, text: &str) -> Vec<u32> {
        self.unigram.split(&self.normalizer.normalize(text))
    }

    /// The ids of a text that becomes a prompt, without an end marker.
    ///
    /// # Errors
    /// [`StepError`] if the text has more than [`MAX_PROMPT_TOKENS`] tokens, or one outside the
    /// vocabulary.
    pub fn encode(&self, text: &str) -> Result<Vec<u32>, StepError> {
        let ids = self.split(text);
        if ids.len() > MAX_PROMPT_TOKENS {
            return Err(StepError::TooLong { what: "prompt tokens", got: ids.len(), limit: MAX_PROMPT_TOKENS });
        }
        match ids.iter().find(|&&id| id as usize >= self.limit) {
            Some(&id) => Err(StepError::OutOfRange { what: "token id", got: id as usize, limit: self.limit }),
            None => Ok(ids),
        }
    }
}
