//! Arguments of `umo bench` and `umo doctor`.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};

use super::{Compute, EngineArgs, TUNING};

/// Measure a model on this machine.
#[derive(Debug, ClapArgs)]
pub struct Bench {
    /// Keyframes predicted at a time
    #[arg(long, value_name = "N", help_heading = TUNING, hide_short_help = true)]
    pub target: Option<usize>,
    /// Chunks to time, one after the other
    #[arg(long, value_name = "C", default_value_t = 100)]
    pub chunks: usize,
    /// First frames to time
    #[arg(long, value_name = "R", default_value_t = 20, help_heading = TUNING, hide_short_help = true)]
    pub starts: usize,
    /// Avatars that speak at once, in real time
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub sessions: usize,
    /// Seconds that they speak; 0 skips this part
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Hold bodies while chunks begin later than this, in milliseconds
    #[arg(long, value_name = "MS", help_heading = TUNING, hide_short_help = true)]
    pub late_limit: Option<f64>,
    /// Measure energy instead: joules a second of avatar, a row per setting
    #[arg(long)]
    pub energy: bool,
    /// The same model in int4, for a row of its own
    #[arg(long, value_name = "FILE", requires = "energy", help_heading = TUNING, hide_short_help = true)]
    pub int4: Option<PathBuf>,
    /// Measure one such row, and print it as JSON
    #[arg(long, hide = true, value_enum, value_name = "ROW")]
    pub energy_row: Option<EnergyRow>,
    /// Folder of the system's files
    #[arg(long, hide = true, value_name = "DIR", default_value = "/sys")]
    pub sys: PathBuf,
    /// Print one line of JSON instead of tables
    #[arg(long)]
    pub json: bool,
    /// Measure beside a program that computes on every core and one that wakes up 10,000 times a second
    #[arg(long)]
    pub busy: bool,
    /// Run as such a program until standard input ends
    #[arg(long, hide = true, value_enum, value_name = "KIND")]
    pub neighbour: Option<Neighbour>,
    /// Draw the chunks' times, a histogram and a timeline
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub engine: EngineArgs,
}

/// Work of the avatars of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum EnergyRow {
    /// Speak
    Speak,
    /// Speak with bodies that are held
    Held,
    /// Have a mouth alone
    Mouth,
}

impl EnergyRow {
    /// The value of the option.
    pub fn name(self) -> &'static str {
        match self {
            Self::Speak => "speak",
            Self::Held => "held",
            Self::Mouth => "mouth",
        }
    }
}

/// Load by another program during a measurement.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Neighbour {
    /// Computes all the time
    Spin,
    /// Wakes up again and again
    Wake,
}

/// Test this machine; exits with 1 if a test fails. The text is meant for a report: it names no host, user or path.
#[derive(Debug, ClapArgs)]
pub struct Doctor {
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}
