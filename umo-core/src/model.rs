//! A loaded model: immutable, shared by every session.

use umo_kernels::Isa;

use crate::audio::Tokenizer;
use crate::config::Config;
use crate::error::LoadError;
use crate::interp::Interp;
use crate::linear::Precision;
use crate::lm::text::TextTokenizer;
use crate::lm::{Lengths, Lm};
use crate::memory;
use crate::motion::MotionDecoder;
use crate::weights::{Loader, ModelFile};

/// Every network of a model, packed for one processor at one precision.
#[derive(Debug)]
pub struct Model {
    pub(crate) config: Config,
    pub(crate) isa: Isa,
    pub(crate) tokenizer: Tokenizer,
    pub(crate) lm: Lm,
    pub(crate) interp: Interp,
    pub(crate) motion: MotionDecoder,
    text: Option<TextTokenizer>,
    /// Tells it from other models, and from itself at other precisions.
    pub(crate) fingerprint: u64,
}

impl Model {
    /// Loads and packs every tensor that the config asks for.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor or key, or where there is too little memory.
    pub fn load(file: &ModelFile, precision: Precision, isa: Isa) -> Result<Self, LoadError> {
        memory::catch(|| Self::load_all(file, precision, isa))?
    }

    fn load_all(file: &ModelFile, precision: Precision, isa: Isa) -> Result<Self, LoadError> {
        // The config's text, and the layers' own structures.
        memory::require(memory::SPARE);
        let loader = Loader::new(file, precision, isa);
        Ok(Self {
            fingerprint: file.fingerprint(precision.name()),
            config: file.config().clone(),
            isa,
            tokenizer: Tokenizer::load(&loader)?,
            lm: Lm::load(&loader, Lengths::of(file.config()))?,
            interp: Interp::load(&loader)?,
            motion: MotionDecoder::load(&loader)?,
            text: TextTokenizer::load(file)?,
        })
    }

    /// Every dimension.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// The back-end that it was packed for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The audio tokenizer.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// The motion codecs.
    pub fn motion(&self) -> &MotionDecoder {
        &self.motion
    }

    /// The text tokenizer, where the model has one.
    pub fn text(&self) -> Option<&TextTokenizer> {
        self.text.as_ref()
    }
}
