//! Free text to ids, using the SentencePiece model in the file (SPEC 2.2, 2.3).
//!
//! Implements only the part of SentencePiece that a T5 vocabulary needs: unigram models with their own
//! character table. The available libraries replace the table by their own Unicode normalisation, and treat
//! words such as `</s>` in a text as markers. The ids must match the training of the language model, so the
//! table is read instead.

mod normalizer;
mod proto;
mod unigram;

use normalizer::Normalizer;
use proto::Proto;
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory;
use unigram::Unigram;

use super::layout::MAX_PROMPT_TOKENS;
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
    /// Loads the tokenizer of a model, if it has one.
    ///
    /// # Errors
    /// [`LoadError`] if the tensor is not a SentencePiece model.
    #[doc(hidden)]
    pub fn load(file: &ModelFile) -> Result<Option<Self>, LoadError> {
        if !file.has(TOKENIZER) {
            return Ok(None);
        }
        // The pieces: each is an entry in maps, with its own strings.
        memory::require(8 * file.raw(TOKENIZER)?.len());
        Self::from_bytes(file.raw(TOKENIZER)?, file.config().vocab.size).map(Some)
    }

    /// Creates a tokenizer from the bytes of a SentencePiece unigram model, for a vocabulary of `limit` ids.
    ///
    /// # Errors
    /// [`LoadError`] if the bytes are not such a model.
    #[doc(hidden)]
    pub fn from_bytes(bytes: &[u8], limit: usize) -> Result<Self, LoadError> {
        let wrong =
            |problem: String| LoadError::tensor(TOKENIZER, format!("expected a SentencePiece model: {problem}"));
        let proto = Proto::parse(bytes).map_err(|problem| wrong(problem.to_owned()))?;
        let normalizer = Normalizer::new(&proto).map_err(|problem| wrong(problem.to_owned()))?;
        Ok(Self { normalizer, unigram: Unigram::new(&proto).map_err(wrong)?, limit })
    }

    /// Tokenizes a text of any length, without an end marker.
    #[doc(hidden)]
    pub fn split(&self, text: &str) -> Vec<u32> {
        self.unigram.split(&self.normalizer.normalize(text))
    }

    /// Tokenizes a prompt, without an end marker.
    ///
    /// # Errors
    /// [`StepError`] if the text has more than [`MAX_PROMPT_TOKENS`] tokens, or one outside the vocabulary.
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
