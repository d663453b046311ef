//! Runs a single stage, tensors in and tensors out, to compare a ported checkpoint with its source framework (SPEC
//! 3.1).

mod frames;
mod tensors;

use std::fmt;
use std::sync::Arc;

use umo_kernels::Mat;

pub use tensors::{Inputs, Output, Values, serialize};
use umo_core_base::error::{LoadError, StepError};
use umo_core_base::team::Team;
use umo_core_model::audio::Tokenizer;
use umo_core_model::config::AudioKind;
use umo_core_model::interp::Interp;
use umo_core_model::linear::Compute;
use umo_core_model::lm::decoder::Sequence;
use umo_core_model::lm::generate::{ChunkSampling, Generator, Heads};
use umo_core_model::lm::sampler::Sampler;
use umo_core_model::lm::{Lengths, Lm, LmScratch, full_head};
use umo_core_model::motion::{Decoded, MotionDecoder};
use umo_core_model::mouth::{Mouth, MouthFrame, MouthStream};
use umo_core_model::weights::Loader;
use umo_core_pose::part::{Part, PerPart};
use umo_core_pose::skeleton::JOINTS;

/// Stages, named as in SPEC 3.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// HuBERT: samples to features and units.
    Hubert,
    /// Mel features: samples to features and units.
    Mel,
    /// Encoder: ids to hidden states.
    Encoder,
    /// Decoder under teacher forcing: ids to logits.
    Decoder,
    /// Encoder and decoder: ids to codes.
    Generate,
    /// Depth network under teacher forcing: states and codes to logits.
    Depth,
    /// Interpolation network: codes with masks to codes.
    Interp,
    /// Motion decoders: codes to poses.
    Motion,
    /// Live mouth: samples to face channels.
    Mouth,
}

impl Stage {
    /// All stages.
    pub const ALL: [Self; 9] = [
        Self::Hubert,
        Self::Mel,
        Self::Encoder,
        Self::Decoder,
        Self::Generate,
        Self::Depth,
        Self::Interp,
        Self::Motion,
        Self::Mouth,
    ];

    /// Name on the command line.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Hubert => "hubert",
            Self::Mel => "mel",
            Self::Encoder => "encoder",
            Self::Decoder => "decoder",
            Self::Generate => "generate",
            Self::Depth => "depth",
            Self::Interp => "interp",
            Self::Motion => "motion",
            Self::Mouth => "mouth",
        }
    }

    /// The stage with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == name)
    }
}

/// Settings of `generate`.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Codes per part; defaults to the model's.
    pub target: Option<usize>,
    /// Sampling of codes.
    pub sampler: Sampler,
}

/// Error from running a stage.
#[derive(Debug)]
pub enum StageError {
    /// The model cannot be loaded.
    Load(LoadError),
    /// The stage failed on its input.
    Step(StepError),
    /// An input tensor is missing or has another type or shape.
    Input {
        /// Name of the tensor.
        name: String,
        /// Value found and value expected.
        problem: String,
    },
}

impl fmt::Display for StageError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Load(error) => error.fmt(f),
            Self::Step(error) => error.fmt(f),
            Self::Input { name, problem } => write!(f, "input tensor `{name}`: {problem}"),
        }
    }
}

impl std::error::Error for StageError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            // Their texts are already this error's text, so the source is what caused them.
            Self::Load(error) => error.source(),
            Self::Step(error) => error.source(),
            Self::Input { .. } => None,
        }
    }
}

impl From<LoadError> for StageError {
    fn from(error: LoadError) -> Self {
        Self::Load(error)
    }
}

impl From<StepError> for StageError {
    fn from(error: StepError) -> Self {
        Self::Step(error)
    }
}

impl From<umo_kernels::ShapeError> for StageError {
    fn from(error: umo_kernels::ShapeError) -> Self {
        Self::Step(error.into())
    }
}

/// Runs `stage` on `inputs` and returns its outputs.
///
/// # Errors
/// [`StageError`] naming the faulty tensor, key or input.
pub fn run(
    stage: Stage,
    loader: &Loader,
    team: &Team,
    inputs: &Inputs,
    options: Options,
) -> Result<Vec<Output>, StageError> {
    let cx = Compute { isa: loader.isa(), team };
    if loader.file().config().is_frames()
        && let Some(outputs) = frames::run(stage, cx, loader, inputs, options)
    {
        return outputs;
    }
    match stage {
        Stage::Depth => Err(LoadError::config("layout", "this model has no depth network: its layout is parts").into()),
        Stage::Hubert => audio(cx, loader, inputs, AudioKind::Hubert),
        Stage::Mel => audio(cx, loader, inputs, AudioKind::Mel),
        Stage::Encoder => encoder(cx, loader, inputs),
        Stage::Decoder => decoder(cx, loader, inputs),
        Stage::Generate => generate(cx, loader, inputs, options),
        Stage::Interp => interp(cx, loader, inputs),
        Stage::Motion => motion(cx, loader, inputs),
        Stage::Mouth => mouth(loader, inputs),
    }
}

fn audio(cx: Compute, loader: &Loader, inputs: &Inputs, kind: AudioKind) -> Result<Vec<Output>, StageError> {
    if loader.file().config().audio.kind != kind {
        return Err(LoadError::config("audio.kind", "this model has the other kind of audio tokenizer").into());
    }
    let samples = inputs.floats("audio")?;
    let (features, units) = Tokenizer::load(loader)?.features(cx, &samples)?;
    let width = features.len() / units.len();
    let units: Vec<i64> = units.into_iter().map(i64::from).collect();
    Ok(vec![Output::floats("features", &[units.len(), width], features), Output::integers("units", units)])
}

/// Encoder states of `input_ids`; loads the model for them and for `decoder` decoder tokens.
fn encode(
    cx: Compute,
    loader: &Loader,
    inputs: &Inputs,
    decoder: usize,
) -> Result<(Lm, LmScratch, Vec<f32>, Lengths), StageError> {
    let config = loader.file().config();
    let ids = inputs.ids("input_ids")?;
    let lengths = Lengths { encoder: ids.len().max(1), decoder };
    let lm = Lm::load(loader, lengths)?;
    let mut scratch = LmScratch::new(config, ids.len().max(decoder));
    let mut hidden = vec![0.0; ids.len() * lm.d_model()];
    lm.encode(cx, &mut scratch, &ids, &[ids.len()], &mut hidden)?;
    Ok((lm, scratch, hidden, lengths))
}

fn encoder(cx: Compute, loader: &Loader, inputs: &Inputs) -> Result<Vec<Output>, StageError> {
    let (lm, _, hidden, lengths) = encode(cx, loader, inputs, 1)?;
    Ok(vec![Output::floats("hidden", &[lengths.encoder, lm.d_model()], hidden)])
}

fn decoder(cx: Compute, loader: &Loader, inputs: &Inputs) -> Result<Vec<Output>, StageError> {
    let config = loader.file().config();
    let decoder_ids = inputs.ids("decoder_input_ids")?;
    let rows = decoder_ids.len();
    let (lm, mut scratch, hidden, lengths) = encode(cx, loader, inputs, rows.max(1))?;
    let mut sequence = Sequence::new(config, lengths, lm.cross_storage());
    let states = Mat::new(&hidden, lengths.encoder, lm.d_model())?;
    lm.attend_to(cx, &mut scratch, states, &mut sequence)?;
    sequence.set_ids(&decoder_ids)?;
    lm.decode(cx, &mut scratch, std::slice::from_mut(&mut sequence))?;
    let logits = lm.all_logits(cx, &mut scratch, &full_head(loader)?, rows)?;
    Ok(vec![Output::floats("logits", &[rows, config.vocab.size], logits)])
}

fn generate(cx: Compute, loader: &Loader, inputs: &Inputs, options: Options) -> Result<Vec<Output>, StageError> {
    let config = loader.file().config();
    let target = options.target.unwrap_or(config.target);
    if !(1..=config.max_target).contains(&target) {
        let limit = config.max_target + 1;
        return Err(StepError::OutOfRange { what: "target", got: target, limit }.into());
    }
    let (lm, mut scratch, hidden, lengths) = encode(cx, loader, inputs, Lengths::of(config).decoder)?;
    let mut sequence = Sequence::new(config, lengths, lm.cross_storage());
    let states = Mat::new(&hidden, lengths.encoder, lm.d_model())?;
    let mut codes = vec![0; target * Part::ALL.len()];
    let sampling = ChunkSampling { sampler: options.sampler, chunk: 0, target };
    let mut generator = Generator::new(config, Arc::new(Heads::load(loader)?));
    generator.generate(cx, &lm, &mut scratch, states, &mut sequence, sampling, &mut codes)?;
    let of = |part: Part| codes.iter().skip(part as usize).step_by(Part::ALL.len()).copied().collect::<Vec<u16>>();
    Ok(Part::ALL.into_iter().map(|part| Output::codes(part, &of(part))).collect())
}

/// Codes of every part, which may differ in length.
fn codes(inputs: &Inputs) -> Result<PerPart<Vec<u16>>, StageError> {
    PerPart::try_from_fn(|part| inputs.codes(part))
}

fn interp(cx: Compute, loader: &Loader, inputs: &Inputs) -> Result<Vec<Output>, StageError> {
    let interp = Interp::load(loader)?;
    let mut codes = codes(inputs)?;
    let frames = codes.face.len();
    let mut scratch = interp.scratch(frames);
    let PerPart { face, hands, upper, lower } = &mut codes;
    interp.fill(cx, &mut scratch, PerPart { face, hands, upper, lower })?;
    let logits = |part: Part| {
        let values = scratch.logits(part)[..frames * interp.mask()].to_vec();
        Output::floats(&format!("logits.{}", part.name()), &[frames, interp.mask()], values)
    };
    let outputs = Part::ALL.into_iter().flat_map(|part| [logits(part), Output::codes(part, &codes[part])]);
    Ok(outputs.collect())
}

fn motion(cx: Compute, loader: &Loader, inputs: &Inputs) -> Result<Vec<Output>, StageError> {
    let decoder = MotionDecoder::load(loader)?;
    let codes = codes(inputs)?;
    let decoded = decoder.decode(cx, PerPart::from_fn(|part| codes[part].as_slice()))?;
    Ok(poses(&decoder, &decoded))
}

/// Output tensors of decoded motion.
fn poses(decoder: &MotionDecoder, decoded: &Decoded) -> Vec<Output> {
    let frames = decoded.translation.len();
    let channels = |part: Part| {
        let values = decoded.channels[part].clone();
        Output::floats(&format!("channels.{}", part.name()), &[frames, decoder.channels(part)], values)
    };
    let mut outputs: Vec<Output> = Part::ALL.into_iter().map(channels).collect();
    let rotations = decoded.rotations.iter().flatten().flatten().copied().collect();
    outputs.push(Output::floats("rotations", &[frames, JOINTS, 3], rotations));
    outputs.push(Output::floats("translation", &[frames, 3], decoded.translation.as_flattened().to_vec()));
    outputs
}

fn mouth(loader: &Loader, inputs: &Inputs) -> Result<Vec<Output>, StageError> {
    let mouth = Mouth::load(loader)?.ok_or(StepError::Missing("live mouth"))?;
    let samples = inputs.floats("audio")?;
    let mut stream = MouthStream::new(&mouth);
    let (mut channels, mut voiced, mut later) = (Vec::new(), Vec::new(), Vec::new());
    let mut take = |frame: MouthFrame| {
        channels.extend_from_slice(frame.channels);
        voiced.push(frame.voiced);
        later.extend_from_slice(frame.later);
    };
    stream.push(&mouth, loader.isa(), &samples, &mut take)?;
    let config = loader.file().config();
    let (frames, width) = (samples.len() * config.frame_rate / config.audio.sample_rate, mouth.channels().len());
    // Silence until the last frame of the sound has passed both heads.
    let silent = (mouth.behind().unwrap_or(0) + 1) * config.audio.sample_rate / config.frame_rate;
    stream.push(&mouth, loader.isa(), &vec![0.0; mouth.latency_samples() + silent], &mut take)?;
    channels.truncate(frames * width);
    voiced.truncate(frames);
    let mut outputs =
        vec![Output::floats("channels", &[frames, width], channels), Output::floats("voiced", &[frames], voiced)];
    if mouth.behind().is_some() {
        later.truncate(frames * width);
        outputs.push(Output::floats("later", &[frames, width], later));
    }
    Ok(outputs)
}
