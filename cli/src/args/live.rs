//! Arguments of the commands that show an avatar: `umo view` and `umo live`.

use std::path::PathBuf;

use clap::{ArgGroup, Args as ClapArgs, ValueEnum};
use umo_figure::Figure;

use super::{Compute, EngineArgs, GenerateArgs, TUNING, WordArgs, figure_parser};
use crate::failure::Failure;

/// Heading of the options for a page.
const PAGE: &str = "Page";
/// Heading of the options for other programs.
const PROGRAMS: &str = "Other programs";

/// The avatar on a page.
#[derive(Debug, ClapArgs)]
pub struct Shown {
    /// Character that wears the motion, .glb, .gltf or .vrm, in place of the figure
    #[arg(long, value_name = "FILE", conflicts_with = "figure", help_heading = PAGE)]
    pub onto: Option<PathBuf>,
    /// Mapping of the character's bones: TOML or JSON
    ///
    /// For names that are not recognised.
    #[arg(long, value_name = "FILE", help_heading = PAGE)]
    pub mapping: Option<PathBuf>,
    /// Figure that wears the motion [default: alex, or those that the members of a conversation wear]
    #[arg(long, value_name = "NAME", value_parser = figure_parser(), help_heading = PAGE)]
    pub figure: Option<Figure>,
    /// Do not open a browser
    #[arg(long, help_heading = PAGE)]
    pub no_open: bool,
}

impl Shown {
    /// Refuses a mapping without a character.
    pub(crate) fn check(&self) -> Result<(), Failure> {
        match self.mapping.is_some() && self.onto.is_none() {
            true => Err(Failure::input("--mapping goes with a character: --onto")),
            false => Ok(()),
        }
    }
}

/// Write a page that shows an avatar speak.
#[derive(Debug, ClapArgs)]
pub struct Page {
    /// Recording, a finished .glb, .npz or .jsonl, or a take, .umo
    ///
    /// Also a character from `umo retarget`. With --web a recording, or nothing for the microphone alone.
    #[arg(required_unless_present_any = ["web", "judge"])]
    pub input: Option<PathBuf>,
    /// More takes of the same recording, to stand beside the first
    #[arg(value_name = "TAKES", conflicts_with_all = ["web", "judge"])]
    pub more: Vec<PathBuf>,
    /// Page, or with --live the take to keep [default: beside the input]
    #[arg(short, long, value_name = "FILE", conflicts_with = "web")]
    pub output: Option<PathBuf>,
    /// Speech of an animation or a take
    ///
    /// Of a conversation, one for each member, or one with a channel for each.
    #[arg(long, value_name = "FILE", conflicts_with = "web")]
    pub audio: Vec<PathBuf>,
    /// Write a page that asks a person which of two recordings goes with a motion, and counts
    ///
    /// Two recordings or more, of 8 s or more each. ANIMATION=RECORDING shows a finished or captured motion.
    #[arg(long, value_name = "FILE", num_args = 1.., requires = "output", conflicts_with_all = ["input", "web", "audio", "onto", "mapping"])]
    pub judge: Vec<PathBuf>,
    /// Serve the page of takes: it saves a score, draws it, keeps a take
    ///
    /// To browsers of this machine. -o names the take that is kept, STEM-kept.umo by default.
    #[arg(long, conflicts_with_all = ["web", "judge"])]
    pub live: bool,
    /// Write the page of `umo live` as a folder for any web server: the model runs in the browser
    #[arg(long, value_name = "FOLDER")]
    pub web: Option<PathBuf>,
    /// Folder of the npm package `umo-web`, for --web [default: node_modules/umo-web or bindings/web]
    #[arg(long, value_name = "FOLDER", requires = "web", help_heading = TUNING, hide_short_help = true)]
    pub package: Option<PathBuf>,
    /// Timing of the mouth with --web [default: live for the microphone, delayed for a recording]
    ///
    /// With the sound, if the model has a mouth network, or with the body.
    #[arg(long, value_name = "WHEN", requires = "web", help_heading = TUNING, hide_short_help = true)]
    pub voice: Option<VoiceArg>,
    /// Read the usable parts of a damaged recording
    #[arg(long, hide_short_help = true)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub shown: Shown,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub words: WordArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// Move an avatar while somebody speaks.
///
/// Serves a page to browsers of this machine that animates a microphone or a recording. With --vmc or --livelink it
/// sends poses to other programs instead, from a recording or from standard input: 16-bit little-endian mono samples
/// without a header.
#[derive(Debug, ClapArgs)]
#[command(group(ArgGroup::new("receivers").multiple(true).args(["vmc", "livelink"])
    .conflicts_with_all(["port", "no_open", "onto", "mapping", "figure"])))]
#[command(mut_arg("language", |arg| arg.hide_short_help(true)), mut_arg("repair", |arg| arg.hide_short_help(true)))]
pub struct Live {
    /// Recording, spoken in real time [default: the page's microphone, or standard input, `-`]
    pub input: Option<PathBuf>,
    /// Timing of the mouth: with the sound, or with the body
    ///
    /// `live` needs a model with a mouth network. It is then the default, except for a recording on the page.
    #[arg(long, value_name = "WHEN")]
    pub voice: Option<VoiceArg>,
    /// Prompt, for models that take one: a style, an emotion
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    /// Read the usable parts of a damaged recording
    #[arg(long)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub words: WordArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub engine: EngineArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub shown: Shown,
    /// Port to serve at [default: any free one]
    #[arg(long, value_name = "N", help_heading = PAGE)]
    pub port: Option<u16>,
    /// Address of a program that listens for the VMC protocol
    #[arg(long, value_name = "HOST:PORT", help_heading = PROGRAMS)]
    pub vmc: Option<String>,
    /// Address of Unreal, or of another receiver of Live Link Face
    ///
    /// Face and head, for models with an ARKit face.
    #[arg(long, value_name = "HOST:PORT", help_heading = PROGRAMS)]
    pub livelink: Option<String>,
    /// Sample rate of standard input in Hz [default: 16000]
    #[arg(long, value_name = "HERTZ", requires = "receivers", help_heading = PROGRAMS)]
    pub rate: Option<usize>,
    /// Poses per second
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=240), requires = "receivers", help_heading = PROGRAMS, hide_short_help = true)]
    pub fps: u16,
    /// Height of the avatar's hips above the floor in metres [default: the model's]
    #[arg(long, value_name = "METRES", requires = "receivers", help_heading = PROGRAMS, hide_short_help = true)]
    pub hips: Option<f32>,
    /// Subject name in Live Link
    #[arg(long, value_name = "NAME", default_value = "umo", requires = "livelink", help_heading = PROGRAMS, hide_short_help = true)]
    pub subject: String,
    /// Send `mouthClose` to Live Link as 0, and `jawOpen` less by as much
    ///
    /// For a MetaHuman whose lips close too far.
    #[arg(long, requires = "livelink", help_heading = PROGRAMS, hide_short_help = true)]
    pub no_mouth_close: bool,
}

impl Live {
    /// Whether poses go to other programs, and not to a page.
    pub(crate) const fn has_receivers(&self) -> bool {
        self.vmc.is_some() || self.livelink.is_some()
    }
}

/// Timing of the mouth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VoiceArg {
    /// With the sound; the body follows
    Live,
    /// With the body
    Delayed,
}
