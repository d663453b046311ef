//! A loaded model: immutable, shared by every session.

#[cfg(feature = "files")]
use std::path::Path;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{self, filled};
use umo_core_base::team::Team;
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::part::PerPart;
use umo_core_pose::pose::Pose;
use umo_kernels::Isa;

use crate::audio::Tokenizer;
use crate::calibration::Calibration;
use crate::config::Config;
use crate::layout::Networks;
use crate::linear::{Compute, Precision};
use crate::lm::text::TextTokenizer;
use crate::lm::{Lengths, Lm};
use crate::motion::MotionDecoder;
use crate::mouth::Mouth;
use crate::weights::{Loader, ModelFile};

/// All networks of a model, packed for one instruction set at one precision.
#[derive(Debug)]
pub struct Model {
    pub(crate) config: Config,
    pub(crate) isa: Isa,
    pub(crate) tokenizer: Tokenizer,
    pub(crate) lm: Lm,
    /// Networks between the language model and the motion decoders.
    pub(crate) layout: Networks,
    pub(crate) motion: MotionDecoder,
    pub(crate) mouth: Option<Mouth>,
    text: Option<TextTokenizer>,
    /// Identifies the model at its precision.
    pub(crate) fingerprint: u64,
}

impl Model {
    /// Loads a model file at its stored precision for this processor: [`ModelFile::open`] and [`Self::load`] in one
    /// call.
    ///
    /// # Errors
    /// As in [`ModelFile::open`] and [`Self::load`].
    #[cfg(feature = "files")]
    pub fn open(path: &Path) -> Result<Self, LoadError> {
        Self::load(&ModelFile::open(path)?, Precision::Stored, Isa::detect())
    }

    /// Loads and packs every tensor that the config requires.
    ///
    /// # Errors
    /// [`LoadError`] naming the tensor or key, or [`LoadError::Memory`] if out of memory.
    pub fn load(file: &ModelFile, precision: Precision, isa: Isa) -> Result<Self, LoadError> {
        memory::catch(|| Self::load_all(file, precision, || Loader::new(file, precision, isa)))?
    }

    /// Loads a model in f32, and records the inputs of products in `calibration`.
    ///
    /// # Errors
    /// As in [`Self::load`].
    #[doc(hidden)]
    pub fn load_recording(file: &ModelFile, isa: Isa, calibration: &Calibration) -> Result<Self, LoadError> {
        let loader = || Loader::new(file, Precision::F32, isa).recording(calibration);
        memory::catch(|| Self::load_all(file, Precision::F32, loader))?
    }

    fn load_all<'a>(
        file: &'a ModelFile,
        precision: Precision,
        loader: impl FnOnce() -> Loader<'a>,
    ) -> Result<Self, LoadError> {
        // For the config's text, and the layers' own structures.
        memory::require(memory::SPARE);
        let loader = loader();
        Ok(Self {
            fingerprint: file.fingerprint(precision.name()),
            config: file.config().clone(),
            isa: loader.isa(),
            tokenizer: Tokenizer::load(&loader)?,
            lm: Lm::load(&loader, Lengths::of(file.config()))?,
            layout: Networks::load(&loader)?,
            motion: MotionDecoder::load(&loader)?,
            mouth: Mouth::load(&loader)?,
            text: {
                // It makes many small allocations.
                memory::require(memory::SPARE);
                TextTokenizer::load(file)?
            },
        })
    }

    /// The pose that the rest codes decode to, away from a clip's ends.
    #[doc(hidden)]
    pub fn rest(&self) -> Result<OwnedFrame, StepError> {
        let motion = &self.motion;
        let team = Team::new(1).map_err(|_| StepError::Missing("thread"))?;
        let frames = 2 * motion.reach() + 1;
        let decoded = motion.decode_rest(Compute { isa: self.isa, team: &team }, frames)?;
        let (middle, assembly) = (frames / 2, motion.assembly());
        let channels = PerPart::from_fn(|part| {
            let width = motion.channels(part);
            &decoded.channels[part][middle * width..(middle + 1) * width]
        });
        let mut face = filled(0.0, assembly.face_values());
        assembly.face(channels.face, &mut face);
        let mut pose = Pose { rotations: assembly.rotations(channels), translation: decoded.translation[middle] };
        assembly.turn_eyes(&face, &mut pose.rotations);
        (pose.translation[0], pose.translation[2]) = (0.0, 0.0);
        Ok(OwnedFrame::new(pose, &face))
    }

    /// Identifies the model at its precision.
    #[doc(hidden)]
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    /// The model's config.
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Instruction set that it was packed for.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The audio tokenizer.
    #[doc(hidden)]
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// Networks between the language model and the motion decoders.
    #[doc(hidden)]
    pub fn layout(&self) -> &Networks {
        &self.layout
    }

    /// The motion codecs.
    #[doc(hidden)]
    pub fn motion(&self) -> &MotionDecoder {
        &self.motion
    }

    /// The live mouth, if the model has one.
    #[doc(hidden)]
    pub fn mouth(&self) -> Option<&Mouth> {
        self.mouth.as_ref()
    }

    /// The text tokenizer, if the model has one.
    pub fn text(&self) -> Option<&TextTokenizer> {
        self.text.as_ref()
    }
}
