//! Arguments of the commands that make, change and examine models.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};
use umo_core_model::weights::writer::Storage;

use super::Compute;

/// Run one stage alone.
#[derive(Debug, ClapArgs)]
pub struct Stage {
    /// Stage: hubert, mel, encoder, decoder, generate, depth, interp, motion or mouth
    #[arg(value_name = "STAGE")]
    pub stage: String,
    /// Input tensors, a safetensors file
    #[arg(long = "in", value_name = "FILE")]
    pub input: PathBuf,
    /// Output tensors, a safetensors file
    #[arg(long = "out", value_name = "FILE")]
    pub output: PathBuf,
    /// Keyframes to generate
    #[arg(long, value_name = "N")]
    pub target: Option<usize>,
    /// Random seed
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// Take the likeliest code instead of sampling
    #[arg(long, conflicts_with = "seed")]
    pub greedy: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// Print the contents of a model.
#[derive(Debug, ClapArgs)]
pub struct Inspect {
    /// Model file [default: the embedded one]
    pub model: Option<PathBuf>,
    /// Print every tensor with its type, shape and size
    #[arg(long)]
    pub tensors: bool,
    /// Print the config as stored
    #[arg(long)]
    pub config: bool,
    /// Check the file against its checksum, and print nothing else
    #[arg(long, conflicts_with_all = ["tensors", "config"])]
    pub verify: bool,
}

/// Convert published weights to a model.
///
/// Sources are safetensors files, or folders of safetensors files that belong together; each may be
/// given several times.
#[derive(Debug, ClapArgs)]
pub struct Convert {
    /// Dimensions of the model, JSON; `umo model inspect --config` prints one to start from
    #[arg(long, value_name = "FILE.json")]
    pub config: PathBuf,
    /// Hugging Face's HuBERT
    #[arg(long, value_name = "FILE", required = true)]
    pub hubert: Vec<PathBuf>,
    /// Rows of the k-means over HuBERT's features
    #[arg(long, value_name = "FILE")]
    pub centroids: PathBuf,
    /// T5 1.1 or Flan-T5 from Hugging Face, or the T5 of Language of Motion
    #[arg(long, value_name = "FILE", required = true)]
    pub t5: Vec<PathBuf>,
    /// Motion codecs of EMAGE (a file each) or Language of Motion; codecs of a list of parts by its names
    #[arg(long, value_name = "FILE", required = true)]
    pub vq: Vec<PathBuf>,
    /// Depth network and keyframe tables of layout `frames`, made by training/
    #[arg(long, value_name = "FILE")]
    pub depth: Vec<PathBuf>,
    /// Interpolation network, made by training/
    #[arg(long, value_name = "FILE")]
    pub interp: PathBuf,
    /// SentencePiece model of the text vocabulary
    #[arg(long, value_name = "FILE.model")]
    pub tokenizer: Option<PathBuf>,
    /// Experts per feed-forward layer [default: the config's]
    #[arg(long, value_name = "E")]
    pub experts: Option<usize>,
    /// Experts per row [default: the config's]
    #[arg(long, value_name = "K")]
    pub top_k: Option<usize>,
    /// Initial values of vocabulary rows that the T5 lacks [default: refuse]
    #[arg(long, value_enum)]
    pub new_rows: Option<NewRows>,
    /// Type of weights and tables; routers and codebooks stay F32
    #[arg(long, value_enum, default_value_t = FloatArg::Bf16)]
    pub dtype: FloatArg,
    /// Seed of the routers
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// Initial values of new vocabulary rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum NewRows {
    /// Mean of the existing rows
    Mean,
}

/// A float type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum FloatArg {
    /// bfloat16
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

/// Quantize a model.
#[derive(Debug, ClapArgs)]
pub struct Quantize {
    /// Model file with float weights
    pub input: PathBuf,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Type of the weights of products; tables, norms, routers and codebooks stay as they are
    #[arg(long, value_enum)]
    pub weights: WeightsArg,
    /// Tensors that stay as they are, such as `*.moe.experts.*.wo.*`; may be given several times
    #[arg(long, value_name = "GLOB")]
    pub keep: Vec<String>,
    /// Type of tensors, GLOB=TYPE: f32, bf16, int8 or int4; the last match counts, before any --keep
    #[arg(long, value_name = "GLOB=TYPE")]
    pub set: Vec<String>,
    /// Rotate the residual streams to spread outlier channels, without changing the function: for trained
    /// models of layout `frames`, or of layout `parts` with an untied head
    #[arg(long)]
    pub rotate: bool,
    /// Calibration recording of speech: weights are rounded for the inputs that it gives; may be given
    /// several times. A quarter of an hour of several voices is enough
    #[arg(long, value_name = "SPEECH")]
    pub calibrate: Vec<PathBuf>,
}

/// Types of the weights of products.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum WeightsArg {
    /// Int8 steps with a scale per row
    Int8,
    /// As int8, with int4 in groups of 32 for the decoder's experts; --set for more
    Int4,
    /// bfloat16
    Bf16,
}

/// Write a model of random weights.
#[derive(Debug, ClapArgs)]
pub struct Random {
    /// Dimensions: `base` is the paper's, `small` the default model's
    #[arg(long, value_enum, default_value_t = Size::Small)]
    pub size: Size,
    /// Layout of the decoder's positions
    #[arg(long, value_enum, default_value_t = LayoutArg::Parts)]
    pub layout: LayoutArg,
    /// File to write
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
    /// Type of the weights
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
    /// The smallest valid model, for tests
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

/// Types of the weights.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum StorageArg {
    /// 32-bit floats
    F32,
    /// bfloat16
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
