//! Arguments of the commands that make, change and examine models.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};
use umo_core::weights::writer::Storage;

use super::Compute;

/// Run one stage alone.
#[derive(Debug, ClapArgs)]
pub struct Stage {
    /// Which: hubert, mel, encoder, decoder, generate, depth, interp, motion or mouth
    #[arg(value_name = "STAGE")]
    pub stage: String,
    /// Model file; the one in the program where not given
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Input tensors, a safetensors file
    #[arg(long = "in", value_name = "FILE")]
    pub input: PathBuf,
    /// Output tensors, a safetensors file
    #[arg(long = "out", value_name = "FILE")]
    pub output: PathBuf,
    /// Keyframes to generate
    #[arg(long, value_name = "N")]
    pub target: Option<usize>,
    /// Seed of the draws
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// Always the likeliest code instead of a draw
    #[arg(long, conflicts_with = "seed")]
    pub greedy: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// Say what a model or a character holds.
#[derive(Debug, ClapArgs)]
pub struct Inspect {
    /// Model file, the one in the program where not given; or a character, .glb, .gltf or .vrm, or a
    /// skeleton, .bvh: what was found of it, what is missing
    pub model: Option<PathBuf>,
    /// Every tensor with its type, shape and size
    #[arg(long)]
    pub tensors: bool,
    /// The config as the file has it
    #[arg(long)]
    pub config: bool,
    /// Compare the file with its checksum, and say nothing else
    #[arg(long, conflicts_with_all = ["tensors", "config"])]
    pub verify: bool,
}

/// Write a model of weights that others publish.
///
/// Sources are safetensors files, or folders whose safetensors files belong together; each may be
/// given several times.
#[derive(Debug, ClapArgs)]
pub struct Convert {
    /// Every dimension of the model, JSON; `umo inspect --config` prints one to begin with
    #[arg(long, value_name = "FILE.json")]
    pub config: PathBuf,
    /// Hugging Face's HuBERT
    #[arg(long, value_name = "FILE", required = true)]
    pub hubert: Vec<PathBuf>,
    /// Rows of the k-means over HuBERT's features
    #[arg(long, value_name = "FILE")]
    pub centroids: PathBuf,
    /// Hugging Face's T5 1.1 or Flan-T5, or the one that Language of Motion trained
    #[arg(long, value_name = "FILE", required = true)]
    pub t5: Vec<PathBuf>,
    /// Motion codecs of EMAGE, one a file, or of Language of Motion; those of a list of parts by its
    /// names
    #[arg(long, value_name = "FILE", required = true)]
    pub vq: Vec<PathBuf>,
    /// Depth network and tables of keyframes of layout `frames`, which training/ makes
    #[arg(long, value_name = "FILE")]
    pub depth: Vec<PathBuf>,
    /// Interpolation network, which training/ makes
    #[arg(long, value_name = "FILE")]
    pub interp: PathBuf,
    /// SentencePiece model of the text vocabulary
    #[arg(long, value_name = "FILE.model")]
    pub tokenizer: Option<PathBuf>,
    /// Experts that each feed-forward becomes; the config's number where not given
    #[arg(long, value_name = "E")]
    pub experts: Option<usize>,
    /// Experts that a row is sent to; the config's number where not given
    #[arg(long, value_name = "K")]
    pub top_k: Option<usize>,
    /// How rows of the vocabulary start that the T5 lacks; refused where not given
    #[arg(long, value_enum)]
    pub new_rows: Option<NewRows>,
    /// How weights and tables are stored; what decides codes and experts stays F32
    #[arg(long, value_enum, default_value_t = FloatArg::Bf16)]
    pub dtype: FloatArg,
    /// Seed of the routers
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// How new rows of the vocabulary start.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NewRows {
    /// At the mean of the rows that there are
    Mean,
}

/// A type of floats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FloatArg {
    /// Brain floats
    Bf16,
    /// 32-bit floats
    F32,
    /// 16-bit floats
    F16,
}

impl From<FloatArg> for Storage {
    fn from(arg: FloatArg) -> Self {
        match arg {
            FloatArg::Bf16 => Self::Bf16,
            FloatArg::F32 => Self::F32,
            FloatArg::F16 => Self::F16,
        }
    }
}

/// Write a model with smaller weights.
#[derive(Debug, ClapArgs)]
pub struct Quantize {
    /// Model file with float weights
    pub input: PathBuf,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// How the weights of products are stored; tables, norms, the router and what decides codes
    /// stay as they are
    #[arg(long, value_enum)]
    pub weights: WeightsArg,
    /// Tensors that stay as they are, as `*.moe.experts.*.wo.*`; may be given several times
    #[arg(long, value_name = "GLOB")]
    pub keep: Vec<String>,
    /// Type of certain tensors: f32, bf16, int8 or int4; the last that matches counts, before any --keep
    #[arg(long, value_name = "GLOB=TYPE")]
    pub set: Vec<String>,
    /// Rotate the residual streams so that outlier channels are spread over all others, with the same
    /// function: for trained models of layout `frames`, or of layout `parts` with a head of their own
    #[arg(long)]
    pub rotate: bool,
    /// Recording of speech that the float model animates first, to round weights to what they are multiplied
    /// with; may be given several times. A quarter of an hour of several voices is enough
    #[arg(long, value_name = "SPEECH")]
    pub calibrate: Vec<PathBuf>,
}

/// How the weights of products are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WeightsArg {
    /// Int8 steps with a scale per row
    Int8,
    /// As int8, and int4 codes in groups of 32 for the decoder's experts; --set names more
    Int4,
    /// Brain floats
    Bf16,
}

/// Write a model of random weights.
#[derive(Debug, ClapArgs)]
pub struct MakeRandom {
    /// Dimensions: `base` is the paper's, `small` the default model's
    #[arg(long, value_enum, default_value_t = Size::Small)]
    pub size: Size,
    /// What one position of the decoder stands for
    #[arg(long, value_enum, default_value_t = LayoutArg::Parts)]
    pub layout: LayoutArg,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// How weights are stored
    #[arg(long, value_enum, default_value_t = StorageArg::Bf16)]
    pub store: StorageArg,
    /// Seed of the weights
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
}

/// Dimensions of a random model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Size {
    /// Flan-T5-Base with four experts, HuBERT-base, SMPL-X expression
    Base,
    /// A few million parameters, mel features, ARKit face
    Small,
    /// The least that is a model, for tests
    Tiny,
}

/// Layout of a random model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum LayoutArg {
    /// The paper's: a code of one of four parts
    Parts,
    /// A keyframe of more parts with several levels, whose codes a depth network writes
    Frames,
}

/// How weights are stored.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum StorageArg {
    /// 32-bit floats
    F32,
    /// Brain floats
    Bf16,
    /// Int8 steps with a scale per row, for the products
    Int8,
    /// Int4 codes with a scale per row and a multiplier per 32 values, for the products
    Int4,
}

impl From<StorageArg> for Storage {
    fn from(arg: StorageArg) -> Self {
        match arg {
            StorageArg::F32 => Self::F32,
            StorageArg::Bf16 => Self::Bf16,
            StorageArg::Int8 => Self::Int8,
            StorageArg::Int4 => Self::Int4,
        }
    }
}
