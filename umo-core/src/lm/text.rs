//! Free text to ids, by the SentencePiece model in the file (SPEC 2.2, 2.3).

use kitoken::Kitoken;

use super::layout::MAX_PROMPT_TOKENS;
use crate::error::{LoadError, StepError};
use crate::weights::ModelFile;

/// Name of the tensor that holds a SentencePiece model.
pub const TOKENIZER: &str = "text.tokenizer";

/// A text tokenizer.
pub struct TextTokenizer {
    pieces: Kitoken,
    /// Ids from here on are not in the vocabulary.
    limit: usize,
}

impl std::fmt::Debug for TextTokenizer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("TextTokenizer").field("limit", &self.limit).finish_non_exhaustive()
    }
}

impl TextTokenizer {
    /// The tokenizer of a model, where it has one.
    ///
    /// # Errors
    /// [`LoadError`] where the tensor is no SentencePiece model.
    pub fn load(file: &ModelFile) -> Result<Option<Self>, LoadError> {
        if !file.has(TOKENIZER) {
            return Ok(None);
        }
        Self::from_bytes(file.raw(TOKENIZER)?, file.config().vocab.size).map(Some)
    }

    /// A tokenizer from the bytes of a SentencePiece model, for a vocabulary of `limit` ids.
    ///
    /// # Errors
    /// [`LoadError`] where the bytes are no SentencePiece model.
    pub fn from_bytes(bytes: &[u8], limit: usize) -> Result<Self, LoadError> {
        let pieces = Kitoken::from_sentencepiece_slice(bytes)
            .map_err(|error| LoadError::tensor(TOKENIZER, format!("expected a SentencePiece model: {error}")))?;
        Ok(Self { pieces, limit })
    }

    /// The ids of a text, without an end marker.
    ///
    /// # Errors
    /// [`StepError`] where the text has more than [`MAX_PROMPT_TOKENS`] tokens, or one outside the vocabulary.
    pub fn encode(&self, text: &str) -> Result<Vec<u32>, StepError> {
        let ids = self.pieces.encode(text, true).map_err(|_| StepError::Missing("pieces for this text"))?;
        if ids.len() > MAX_PROMPT_TOKENS {
            return Err(StepError::TooLong { what: "prompt tokens", got: ids.len(), limit: MAX_PROMPT_TOKENS });
        }
        match ids.iter().find(|&&id| id as usize >= self.limit) {
            Some(&id) => Err(StepError::OutOfRange { what: "token id", got: id as usize, limit: self.limit }),
            None => Ok(ids),
        }
    }
}
