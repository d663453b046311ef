//! Arguments of `umo converse`.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use umo_figure::Figure;

use super::{Compute, GenerateArgs, figure_parser};

/// Animate a conversation: avatars that see and hear each other.
///
/// The recordings begin at the same time; shorter ones are silent afterwards.
#[derive(Debug, ClapArgs)]
pub struct Converse {
    /// Recording of each member, 2 to 32
    #[arg(required_unless_present = "channels", value_name = "SPEECH")]
    pub speech: Vec<PathBuf>,
    /// Recording with a channel for each member, whose voices may be heard in each other's channels
    #[arg(long, value_name = "FILE", conflicts_with = "speech")]
    pub channels: Option<PathBuf>,
    /// File to write: a .glb or .html of all members, or a file for each one; may be repeated
    #[arg(short, long = "output", value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
    /// Places of the members, or a file with them [default: a half circle, 1.2 m apart]
    ///
    /// For each member X,Z,DEGREES: metres to the left and ahead as seen by who faces 0 degrees, and the direction that it
    /// faces, 90 for to the left. With spaces or lines between members: `-0.6,0,90 0.6,0,-90`.
    #[arg(long, value_name = "PLACES", allow_hyphen_values = true)]
    pub places: Option<String>,
    /// Figures that the members wear in turn
    #[arg(long, value_name = "NAME", value_delimiter = ',', default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Vec<Figure>,
    /// Read the usable parts of damaged recordings
    #[arg(long)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}
