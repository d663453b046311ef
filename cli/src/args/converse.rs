//! Arguments of `umo converse`.

use std::path::PathBuf;

use clap::Args as ClapArgs;
use umo_figure::Figure;

use super::{Compute, GenerateArgs, RuleArgs, figure_parser};

/// Animate a conversation: avatars that see and hear each other.
///
/// The recordings begin at the same time; shorter ones are silent afterwards.
#[derive(Debug, ClapArgs)]
pub struct Converse {
    /// Recording of each avatar; with the persons 2 to 32 members
    #[arg(required_unless_present = "channels", value_name = "SPEECH")]
    pub speech: Vec<PathBuf>,
    /// Recording with a channel for each member, whose voices may be heard in each other's channels
    #[arg(long, value_name = "FILE", conflicts_with = "speech")]
    pub channels: Option<PathBuf>,
    /// Recording of a person, who is heard and looked at but has no avatar; with --channels the number of the channel
    ///
    /// May be repeated. Recordings of persons come after those of the avatars.
    #[arg(long, value_name = "FILE|CHANNEL")]
    pub person: Vec<PathBuf>,
    /// File to write: a .glb or .html of all members, or a file for each avatar; may be repeated
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
    /// Prompt of all avatars, or of each one in turn, for models that take one
    #[arg(long, value_name = "TEXT")]
    pub prompt: Vec<String>,
    /// Words of each avatar's recording in turn, as of `umo animate`; - for one without
    #[arg(long, value_name = "FILE")]
    pub words: Vec<PathBuf>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub rules: RuleArgs,
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
