//! Settings of the computation and of an engine: one field here is an option of every command that has one.

use std::path::PathBuf;
use std::time::Duration;

use clap::{Args as ClapArgs, ValueEnum};
use umo_core::{CoreKinds, EngineConfig, MAX_BATCH, Precision, Priority, Threads};

use super::{TESTING, TUNING};

/// Settings of the computation.
#[derive(Debug, ClapArgs)]
pub struct Compute {
    /// Model file [default: the embedded one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Threads [default: one per core]
    #[arg(long, value_name = "T", help_heading = TUNING, hide_short_help = true)]
    pub threads: Option<usize>,
    /// Precision of the products [default: stored; `model stage`: f32]
    #[arg(long, value_enum, help_heading = TESTING, hide_short_help = true)]
    pub precision: Option<PrecisionArg>,
    /// Instruction set: scalar, avx2, avx512vnni … [default: the best of this processor]
    #[arg(long, value_name = "NAME", help_heading = TESTING, hide_short_help = true)]
    pub isa: Option<String>,
    /// The same bits on every processor, from the same sound
    #[arg(long, help_heading = TUNING, hide_short_help = true)]
    pub portable: bool,
}

/// Settings of an engine: those of `live`, `serve` and `bench`.
#[derive(Debug, ClapArgs)]
pub struct EngineArgs {
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
    /// Most sessions in a batch
    #[arg(long, value_name = "N", default_value_t = EngineConfig::default().max_batch, value_parser = batch, help_heading = TUNING, hide_short_help = true)]
    pub batch: usize,
    /// Batching window: longest wait of a chunk for others
    #[arg(long, value_name = "MS", default_value_t = 0, help_heading = TUNING, hide_short_help = true)]
    pub batch_window: u32,
    /// Priority of the threads that compute
    #[arg(long, value_enum, default_value_t = PriorityArg::Normal, help_heading = TUNING, hide_short_help = true)]
    pub priority: PriorityArg,
    /// Kinds of cores of the threads, on a machine that has several
    #[arg(long, value_enum, default_value_t = CoresArg::Auto, help_heading = TUNING, hide_short_help = true)]
    pub cores: CoresArg,
}

impl EngineArgs {
    /// The settings, for an engine with this many threads.
    pub fn config(&self, threads: usize) -> EngineConfig {
        EngineConfig {
            threads: Threads::Own(threads),
            max_batch: self.batch,
            batch_window: Duration::from_millis(self.batch_window.into()),
            priority: self.priority.into(),
            core_kinds: self.cores.into(),
            ..EngineConfig::default()
        }
    }
}

fn batch(text: &str) -> Result<usize, String> {
    let sessions = text.parse().ok().filter(|sessions| (1..=MAX_BATCH).contains(sessions));
    sessions.ok_or_else(|| format!("expected 1 to {MAX_BATCH}"))
}

/// Precision of the products.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PrecisionArg {
    /// As the weights are stored
    Stored,
    /// Weights as stored, computed in f32
    F32,
    /// Weights rounded to bfloat16
    Bf16,
    /// Weights and activations in int8
    Int8,
}

impl Compute {
    /// The given precision, or `default`.
    pub fn precision(&self, default: Precision) -> Precision {
        self.precision.map_or(default, Precision::from)
    }
}

impl From<PrecisionArg> for Precision {
    fn from(arg: PrecisionArg) -> Self {
        match arg {
            PrecisionArg::Stored => Self::Stored,
            PrecisionArg::F32 => Self::F32,
            PrecisionArg::Bf16 => Self::Bf16,
            PrecisionArg::Int8 => Self::Int8,
        }
    }
}

/// Priority of an engine's threads.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum PriorityArg {
    /// The priority of this program
    Normal,
    /// Above other programs; Linux refuses it to most users
    High,
    /// Below other programs
    Low,
}

impl From<PriorityArg> for Priority {
    fn from(priority: PriorityArg) -> Self {
        match priority {
            PriorityArg::Normal => Self::Normal,
            PriorityArg::High => Self::High,
            PriorityArg::Low => Self::Low,
        }
    }
}

/// Kinds of cores of an engine's threads.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum CoresArg {
    /// A crowd on fast ones, a lone avatar on a slow one while that has room
    Auto,
    /// Wherever the system puts them
    System,
    /// The fastest kind alone
    Performance,
    /// The slowest kind that is not low-power, alone
    Efficiency,
}

impl CoresArg {
    /// The value of the option.
    pub fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::System => "system",
            Self::Performance => "performance",
            Self::Efficiency => "efficiency",
        }
    }
}

impl From<CoresArg> for CoreKinds {
    fn from(cores: CoresArg) -> Self {
        match cores {
            CoresArg::Auto => Self::Auto,
            CoresArg::System => Self::System,
            CoresArg::Performance => Self::Performance,
            CoresArg::Efficiency => Self::Efficiency,
        }
    }
}
