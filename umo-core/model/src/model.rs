//! A loaded model: immutable, shared by every session.

#[cfg(feature = "files")]
use std::path::Path;

use umo_core_base::error::{LoadError, StepError};
use umo_core_base::memory::{self, filled};
use umo_core_base::team::Team;
use umo_core_pose::frame::OwnedFrame;
use umo_core_pose::part::PerPart;
use umo_core_pose::pose::{Assembly, Pose};
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

/// The networks of a model, packed for one instruction set at one precision: all of them, or the live mouth alone.
#[derive(Debug)]
pub struct Model {
    pub(crate) config: Config,
    pub(crate) isa: Isa,
    /// `None` in a model of the mouth alone.
    body: Option<Box<Body>>,
    assembly: Assembly,
    /// The rest pose of a model of the mouth alone; others compute it.
    rest: Option<OwnedFrame>,
    pub(crate) mouth: Option<Mouth>,
    text: Option<TextTokenizer>,
    /// Identifies the model at its precision.
    pub(crate) fingerprint: u64,
}

/// Networks from speech to motion.
#[derive(Debug)]
pub(crate) struct Body {
    pub(crate) tokenizer: Tokenizer,
    pub(crate) lm: Lm,
    /// Networks between the language model and the motion decoders.
    pub(crate) layout: Networks,
    pub(crate) motion: MotionDecoder,
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

    /// Loads the live mouth alone, at its stored precision: no language model, tokenizer or motion decoder, and a fraction of
    /// the memory. Sessions of such a model have [`Voice::Mouth`](https://docs.rs/umo-core/latest/umo_core/enum.Voice.html):
    /// the mouth speaks over the model's rest pose.
    ///
    /// # Errors
    /// As in [`Self::load`], and [`LoadError::Argument`] if the model has no live mouth.
    pub fn load_mouth(file: &ModelFile, isa: Isa) -> Result<Self, LoadError> {
        memory::catch(|| {
            memory::require(memory::SPARE);
            let precision = Precision::Stored;
            let loader = Loader::new(file, precision, isa);
            let config = file.config().clone();
            let mouth = Mouth::load(&loader)?
                .ok_or_else(|| LoadError::argument("parts", "the model has no live mouth: load all of it"))?;
            // The decoders give the rest pose, and are dropped.
            let motion = MotionDecoder::load(&loader)?;
            let rest =
                decode_rest(&motion, loader.isa()).map_err(|error| LoadError::config("rest", error.to_string()))?;
            Ok(Self {
                fingerprint: file.fingerprint(precision.name()),
                isa: loader.isa(),
                body: None,
                assembly: Assembly::new(&config.face),
                rest: Some(rest),
                mouth: Some(mouth),
                text: None,
                config,
            })
        })?
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
            body: Some(Box::new(Body {
                tokenizer: Tokenizer::load(&loader)?,
                lm: Lm::load(&loader, Lengths::of(file.config()))?,
                layout: Networks::load(&loader)?,
                motion: MotionDecoder::load(&loader)?,
            })),
            assembly: Assembly::new(&file.config().face),
            rest: None,
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
        match &self.rest {
            Some(rest) => Ok(rest.clone()),
            None => decode_rest(self.motion(), self.isa),
        }
    }

    /// Whether it is of the mouth alone.
    pub fn is_mouth_alone(&self) -> bool {
        self.body.is_none()
    }

    /// Checks that it has the networks of an avatar's body.
    #[doc(hidden)]
    pub fn check_body(&self) -> Result<(), LoadError> {
        match self.body {
            Some(_) => Ok(()),
            None => {
                let problem =
                    "the mouth alone was loaded, and speaks in sessions whose voice is the mouth; load all parts";
                Err(LoadError::argument("parts", problem))
            }
        }
    }

    /// The networks of the body, of which every avatar and batch is made after [`Self::check_body`].
    pub(crate) fn body(&self) -> &Body {
        self.body.as_deref().expect("the networks of the body were checked to be loaded")
    }

    /// Conversion of channels to poses.
    #[doc(hidden)]
    pub fn assembly(&self) -> &Assembly {
        &self.assembly
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
        &self.body().tokenizer
    }

    /// Networks between the language model and the motion decoders.
    #[doc(hidden)]
    pub fn layout(&self) -> &Networks {
        &self.body().layout
    }

    /// The motion codecs.
    #[doc(hidden)]
    pub fn motion(&self) -> &MotionDecoder {
        &self.body().motion
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

/// The pose that the rest codes decode to, away from a clip's ends.
fn decode_rest(motion: &MotionDecoder, isa: Isa) -> Result<OwnedFrame, StepError> {
    let team = Team::new(1).map_err(|_| StepError::Missing("thread"))?;
    let frames = 2 * motion.reach() + 1;
    let decoded = motion.decode_rest(Compute { isa, team: &team }, frames)?;
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
