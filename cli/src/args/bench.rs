//! Arguments of `umo bench` and `umo doctor`.

use std::path::PathBuf;

use clap::{Args as ClapArgs, ValueEnum};

use super::{Compute, PriorityArg};

/// Measure a model on this machine.
#[derive(Debug, ClapArgs)]
pub struct Bench {
    /// Model file; the one in the program where not given
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Keyframes predicted at a time
    #[arg(long, value_name = "N")]
    pub target: Option<usize>,
    /// Chunks whose times are taken, one after the other
    #[arg(long, value_name = "C", default_value_t = 100)]
    pub chunks: usize,
    /// First frames whose times are taken
    #[arg(long, value_name = "R", default_value_t = 20)]
    pub starts: usize,
    /// Avatars that speak at once, in real time
    #[arg(long, value_name = "S", default_value_t = 1)]
    pub sessions: usize,
    /// Seconds that they speak; 0 leaves this part out
    #[arg(long, value_name = "S", default_value_t = 10.0)]
    pub seconds: f64,
    /// Hold bodies while chunks begin so many milliseconds late
    #[arg(long, value_name = "MS")]
    pub late_limit: Option<f64>,
    /// Longest wait of a chunk for others, to be computed together
    #[arg(long, value_name = "MS", default_value_t = 0)]
    pub gather: u32,
    /// One line of JSON in place of the tables
    #[arg(long)]
    pub json: bool,
    /// Priority of the threads that compute
    #[arg(long, value_enum, default_value_t = PriorityArg::Normal)]
    pub priority: PriorityArg,
    /// With another program that computes on every core, and one that wakes up 10,000 times a second
    #[arg(long)]
    pub busy: bool,
    /// Be such a program until standard input ends
    #[arg(long, hide = true, value_enum, value_name = "KIND")]
    pub neighbour: Option<Neighbour>,
    /// Draw the chunks' times, a histogram and a timeline
    #[arg(long, value_name = "FILE.svg")]
    pub plot: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// What another program does while a model is measured.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub enum Neighbour {
    /// Computes all the time
    Spin,
    /// Wakes up again and again
    Wake,
}

/// Test this machine: the text is meant to be pasted into a report, and names no host, no user and no path.
#[derive(Debug, ClapArgs)]
pub struct Doctor {
    /// Model file; the one in the program where not given
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}
