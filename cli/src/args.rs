//! The command line.

mod bench;
mod converse;
mod engine;
mod generate;
mod live;
mod models;
#[cfg(feature = "serve")]
mod serve;
mod words;

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, StyledStr, TypedValueParser};
use clap::error::{ContextKind, ContextValue};
use clap::{Args as ClapArgs, CommandFactory, Parser, Subcommand, ValueEnum};
use umo_figure::Figure;
use umo_gltf::keys::Bound;

pub use bench::{Bench, Doctor, EnergyRow, Neighbour};
pub use converse::Converse;
pub use engine::{Compute, EngineArgs, PrecisionArg, PriorityArg};
pub use generate::{GenerateArgs, GestureArg, GestureClip};
pub use live::{Live, Page, Shown, VoiceArg};
pub use models::{
    Convert, FloatArg, Inspect, LayoutArg, NewRows, Quantize, Random, Size, Stage, StorageArg, WeightsArg,
};
#[cfg(feature = "serve")]
pub use serve::Serve;
pub use words::{RuleArgs, WordArgs, Words};

/// Heading of options that few need; `-h` omits them.
const TUNING: &str = "Tuning";
/// Heading of options that change takes; `-h` omits them.
const EDITING: &str = "Editing a take";
/// Heading of options for tests; `-h` omits them.
const TESTING: &str = "Testing";

/// Speech in, a moving body out: face, hands, upper and lower body at 30 frames a second.
#[derive(Debug, Parser)]
#[command(name = "umo", version, about, max_term_width = 100)]
pub struct Args {
    /// Command.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands of the program. [`command`] lists the hidden ones below the others.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Animate a speech recording
    Animate(Animate),
    /// Animate a conversation: avatars that see and hear each other
    Converse(Converse),
    /// Write a page that shows an avatar speak, and open it
    View(Page),
    /// Move an avatar while somebody speaks, on a page or in another program
    Live(Live),
    /// Animate for many clients at once: a WebSocket server, speech in, frames or packets out
    #[cfg(feature = "serve")]
    Serve(Serve),
    /// Animate many recordings: a folder, or a manifest
    Batch(Batch),
    /// Retarget an animation to another character's skeleton and face
    Retarget(Retarget),
    /// Animate an action from text that the model or the table of gestures knows
    Text(Text),
    /// Test this machine: processor, kernels, the model's motion, speed
    Doctor(Doctor),
    /// Play a take: its frames again, without the recording
    #[command(hide = true)]
    Play(Play),
    /// Print what a take does, as text to change it by
    #[command(hide = true)]
    Score(Score),
    /// Convert, quantize, examine and test model files
    #[command(subcommand, hide = true)]
    Model(ModelCommand),
    /// Measure a model on this machine: first frame, frames per second, avatars at once
    #[command(hide = true)]
    Bench(Bench),
    /// Print what a character has and lacks: bones, shapes, rest pose, licence
    #[command(hide = true)]
    Inspect(InspectCharacter),
    /// Write a figure as an avatar for other programs: .glb or .vrm
    #[command(hide = true)]
    Figure(FigureArgs),
    /// Draw the figure as a PNG picture: frames of an animation, or each of its 52 shapes
    #[command(hide = true)]
    Draw(Draw),
    /// List the gestures that `animate --gesture` and `text` know
    #[command(hide = true)]
    Gestures,
    /// Print the gestures that a text would get by its words, and why
    #[command(hide = true)]
    Words(Words),
}

/// Commands for model files.
#[derive(Debug, Subcommand)]
pub enum ModelCommand {
    /// Print the contents of a model
    Inspect(Inspect),
    /// Convert published weights to a model
    Convert(Convert),
    /// Quantize a model
    Quantize(Quantize),
    /// Write a model of random weights, for tests and benchmarks
    Random(Random),
    /// Run one stage of a model alone, tensors in and tensors out
    Stage(Stage),
}

/// Builds the command line; its help lists the hidden commands below the others.
pub fn command() -> clap::Command {
    let command = Args::command();
    let (header, literal) = (command.get_styles().get_header(), command.get_styles().get_literal());
    let mut more = format!("{header}More commands:{header:#}");
    for hidden in command.get_subcommands().filter(|command| command.is_hide_set()) {
        let about = hidden.get_about().map(StyledStr::to_string).unwrap_or_default();
        more += &format!("\n  {literal}{:<8}{literal:#}  {about}", hidden.get_name());
    }
    command.after_help(more)
}

/// Adds a suggestion to the error about an unknown command or option that is the name of a command elsewhere.
pub fn suggest(mut error: clap::Error) -> clap::Error {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.clone()),
        _ => None,
    };
    if let Some(name) = text(ContextKind::InvalidSubcommand) {
        if let Some(path) = nested(&name) {
            error.insert(ContextKind::SuggestedSubcommand, ContextValue::Strings(vec![path]));
        }
    } else if let Some(option) = text(ContextKind::InvalidArg)
        && let Some(name) = option.strip_prefix("--").filter(|name| Args::command().find_subcommand(name).is_some())
    {
        error.remove(ContextKind::SuggestedArg);
        error.remove(ContextKind::Usage);
        let tip = StyledStr::from(format!("a command exists: `umo {name}`"));
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip]));
    }
    error
}

/// Returns the path of the command below another one whose name `name` is, or ends in: `make-random` is `model random`.
fn nested(name: &str) -> Option<String> {
    Args::command().get_subcommands().find_map(|above| {
        let below = above.get_subcommands().find(|below| name.ends_with(below.get_name()))?;
        Some(format!("{} {}", above.get_name(), below.get_name()))
    })
}

/// Outputs and settings that `animate` and `text` share.
#[derive(Debug, ClapArgs)]
pub struct Output {
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub files: Files,
    /// Write .glb, .vrma, .bvh and .csv with few keys, rotations off by at most this; and markers
    ///
    /// Lines between keys hold every frame: rotations within DEGREES (0.01 to 45), shapes within a hundredth for
    /// each degree, the root within a centimetre. Markers name strokes and, with --words, words. A .bvh has every frame.
    #[arg(long, value_name = "DEGREES", value_parser = bound)]
    pub reduce: Option<Bound>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
    /// Print the time of each stage
    #[arg(long, help_heading = TESTING, hide_short_help = true)]
    pub timings: bool,
}

/// Files of a motion.
#[derive(Debug, ClapArgs)]
pub struct Files {
    /// File to write: .npz, .bvh, .glb, .vrma, .csv, .jsonl, or .umo for a take; may be repeated
    #[arg(short, long = "output", value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
    /// Figure that wears the motion in .glb files
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
    /// Format of all outputs: npz, bvh, glb, vrma, csv, jsonl or umo [default: by extension]
    #[arg(long, value_name = "FORMAT", help_heading = TUNING, hide_short_help = true)]
    pub format: Option<String>,
}

fn bound(text: &str) -> Result<Bound, String> {
    text.parse().ok().and_then(Bound::new).ok_or_else(|| "expected 0.01 to 45 degrees".to_owned())
}

/// Names and looks of the figures.
fn figure_parser() -> impl TypedValueParser<Value = Figure> {
    let names = Figure::ALL.map(|figure| PossibleValue::new(figure.name()).help(figure.summary()));
    PossibleValuesParser::new(names).try_map(|name| name.parse::<Figure>())
}

/// Write a figure in T-pose, with ARKit's 52 shapes, the 15 visemes of the Oculus set and, in .vrm files, VRM's expressions.
#[derive(Debug, ClapArgs)]
pub struct FigureArgs {
    /// Name of the figure
    #[arg(value_name = "NAME", value_parser = figure_parser())]
    pub figure: Figure,
    /// File to write: glTF 2.0 with the bone names of Mixamo (.glb), or VRM 1.0 (.vrm)
    #[arg(short, long, value_name = "FILE")]
    pub output: PathBuf,
}

/// Animate a speech recording.
#[derive(Debug, ClapArgs)]
pub struct Animate {
    /// Recording of any common format, rate, length and level, with 1 to 8 channels
    pub speech: PathBuf,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub output: Output,
    /// Prompt, for models that take one: a style, an emotion, an action
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub words: WordArgs,
    /// Move strokes of arms, trunk and head onto the accents of the voice
    ///
    /// The frames then differ from those of a stream.
    #[arg(long, conflicts_with = "reduce")]
    pub retime: bool,
    /// Read the usable parts of a damaged recording
    ///
    /// The part before a cut; silence for samples that are not numbers.
    #[arg(long)]
    pub repair: bool,
    /// Tokenise the whole recording at once, as the paper does offline, and print the difference from the stream
    #[arg(long, help_heading = TESTING, hide_short_help = true)]
    pub whole_file_units: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub edit: EditArgs,
}

/// Changes of a take.
#[derive(Debug, ClapArgs)]
pub struct EditArgs {
    /// Change this take of the recording: as --score says, or in --span
    #[arg(long, value_name = "FILE.umo", requires = "changes", conflicts_with_all = EDIT_REFUSES, help_heading = EDITING, hide_short_help = true)]
    pub take: Option<PathBuf>,
    /// The take's score, as `umo score` prints it, with changes; other frames keep their bits
    #[arg(long, value_name = "FILE.toml", requires = "take", group = "changes", help_heading = EDITING, hide_short_help = true)]
    pub score: Option<PathBuf>,
    /// Draw this part of the take anew, seconds
    #[arg(long, value_name = "FROM..TO", requires = "take", group = "changes", value_parser = span, help_heading = EDITING, hide_short_help = true)]
    pub span: Option<std::ops::Range<f64>>,
    /// Write N different draws: y-1.umo, y-2.umo and so on
    #[arg(long, value_name = "N", requires = "take", value_parser = clap::value_parser!(u64).range(2..=100), help_heading = EDITING, hide_short_help = true)]
    pub variants: Option<u64>,
}

/// Options that a take has settled.
const EDIT_REFUSES: [&str; 19] = [
    "seed",
    "layers",
    "activity",
    "expression",
    "gesture",
    "start_pose",
    "target",
    "lookahead",
    "horizon",
    "guidance",
    "smoothing",
    "temperature",
    "greedy",
    "prompt",
    "words",
    "retime",
    "reduce",
    "timings",
    "whole_file_units",
];

/// `4..6`: seconds.
fn span(text: &str) -> Result<std::ops::Range<f64>, String> {
    let span = text.split_once("..").and_then(|(from, to)| Some(from.parse::<f64>().ok()?..to.parse::<f64>().ok()?));
    let span = span.filter(|span| span.start >= 0.0 && span.end > span.start && span.end.is_finite());
    span.ok_or_else(|| "expected two times in seconds, as in 4..6".to_owned())
}

/// Print what a take does, as text that `umo animate --take --score` makes another take from.
#[derive(Debug, ClapArgs)]
pub struct Score {
    /// Take: .umo, as `umo animate` writes it
    pub take: PathBuf,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// Play a take.
#[derive(Debug, ClapArgs)]
pub struct Play {
    /// Take: .umo, as `umo animate` writes it
    pub take: PathBuf,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub files: Files,
    /// Add a gesture of the take's host, as for `umo animate`
    #[arg(long, value_name = "NAME=FILE[,SECONDS][,PART]", value_parser = generate::gesture_clip, help_heading = TUNING, hide_short_help = true)]
    pub gesture_clip: Vec<GestureClip>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub rules: RuleArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// Animate many recordings.
#[derive(Debug, ClapArgs)]
pub struct Batch {
    /// Folder of recordings, or a manifest
    ///
    /// A manifest (.csv with a header row, or .jsonl) has file and optionally output, seed, prompt, mood, start_pose,
    /// speaker, words, scene, place; paths are relative to its folder. Lines with the same scene are one conversation.
    pub input: PathBuf,
    /// Output folder [default: the input's]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Formats of lines without an output: npz, bvh, glb, vrma, csv, jsonl, or umo for takes
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', default_value = "glb")]
    pub format: Vec<String>,
    /// Write few keys and markers, as `umo animate --reduce` does: 0.01 to 45
    #[arg(long, value_name = "DEGREES", value_parser = bound, conflicts_with = "retime")]
    pub reduce: Option<Bound>,
    /// Only every n-th line, from the i-th on (i/n): for n machines
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(usize, usize)>,
    /// File of results, JSON lines with hashes [default: results.jsonl in the output folder]
    ///
    /// Lines with the same contents and settings are skipped.
    #[arg(long, value_name = "FILE.jsonl")]
    pub results: Option<PathBuf>,
    /// Compute every line again
    #[arg(long)]
    pub again: bool,
    /// Move strokes of arms, trunk and head onto the accents of the voice
    ///
    /// The frames then differ from those of a stream.
    #[arg(long)]
    pub retime: bool,
    /// Read the usable parts of damaged recordings
    #[arg(long)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub rules: RuleArgs,
    /// Figure that wears the motion in .glb files
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
    /// Lines computed together: more read the weights less often and need more memory
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = jobs, help_heading = TUNING, hide_short_help = true)]
    pub jobs: usize,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

impl Batch {
    /// The file of results.
    pub(crate) fn results_path(&self) -> PathBuf {
        let name = match self.shard {
            Some((index, count)) => format!("results-{index}-of-{count}.jsonl"),
            None => "results.jsonl".to_owned(),
        };
        let folder = self.output.clone().unwrap_or_else(|| match self.input.is_dir() {
            true => self.input.clone(),
            false => self.input.parent().unwrap_or(std::path::Path::new("")).to_owned(),
        });
        self.results.clone().unwrap_or_else(|| folder.join(name))
    }
}

/// Number of lines at once.
fn jobs(text: &str) -> Result<usize, String> {
    text.parse()
        .ok()
        .filter(|jobs| (1..=umo_core::MAX_BATCH).contains(jobs))
        .ok_or_else(|| "expected 1 to 64".to_owned())
}

/// `2/8`: the second of eight.
fn shard(text: &str) -> Result<(usize, usize), String> {
    let numbers = text.split_once('/').and_then(|(index, count)| Some((index.parse().ok()?, count.parse().ok()?)));
    numbers
        .filter(|&(index, count)| (1..=count).contains(&index))
        .ok_or_else(|| "expected I/N, as 1/4 to 4/4".to_owned())
}

/// Animate an action from text.
#[derive(Debug, ClapArgs)]
pub struct Text {
    /// The action, in words
    pub text: String,
    /// Length of the animation
    #[arg(long, value_name = "S", default_value_t = 4.0)]
    pub seconds: f64,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub output: Output,
}

/// Retarget an animation to another character.
#[derive(Debug, ClapArgs)]
pub struct Retarget {
    /// Recording of speech, or an animation: .npz, .glb, .gltf, .bvh or .jsonl
    #[arg(required_unless_present = "print_mapping")]
    pub input: Option<PathBuf>,
    /// The character: .glb, .gltf or .vrm, or a skeleton, .bvh
    #[arg(long, value_name = "FILE")]
    pub onto: PathBuf,
    /// File to write, in the character's format; one for each member of a conversation
    #[arg(short, long, value_name = "FILE", required_unless_present_any = ["print_mapping", "sheet"])]
    pub output: Vec<PathBuf>,
    /// Picture to write of the motion on the figure and on the character
    #[arg(long, value_name = "FILE.png")]
    pub sheet: Option<PathBuf>,
    /// Mapping of bones and shapes, for names that are not recognised: TOML or JSON
    #[arg(long, value_name = "FILE")]
    pub mapping: Option<PathBuf>,
    /// Print the mapping that was found, and what is missing
    #[arg(long)]
    pub print_mapping: bool,
    /// Write few keys, rotations off by at most this: 0.01 to 45
    #[arg(long, value_name = "DEGREES", value_parser = bound)]
    pub reduce: Option<Bound>,
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
    pub compute: Compute,
}

/// Print what a character has and lacks.
#[derive(Debug, ClapArgs)]
pub struct InspectCharacter {
    /// The character: .glb, .gltf or .vrm, or a skeleton, .bvh
    pub character: PathBuf,
}

/// Draw the figure as a PNG picture: frames of an animation, or each of its 52 shapes.
#[derive(Debug, ClapArgs)]
pub struct Draw {
    /// Animation as `animate -o FILE.jsonl` writes it [default: draw each shape under its name]
    pub animation: Option<PathBuf>,
    /// Picture to write
    #[arg(short, long, value_name = "FILE.png")]
    pub output: PathBuf,
    /// Time of a frame; may be given several times, frames are drawn side by side
    #[arg(long, value_name = "SECONDS", requires = "animation")]
    pub at: Vec<f32>,
    /// View
    #[arg(long, value_enum, default_value_t = View::Front, requires = "animation")]
    pub view: View,
    /// Figure to draw
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
    /// Width of one frame, pixels
    #[arg(long, default_value_t = 360, value_name = "PIXELS", value_parser = pixels)]
    pub width: usize,
    /// Height of the picture, pixels
    #[arg(long, default_value_t = 480, value_name = "PIXELS", value_parser = pixels)]
    pub height: usize,
}

/// Views of the figure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum View {
    /// The whole figure from the front
    Front,
    /// The whole figure, a little from its left
    ThreeQuarter,
    /// The whole figure from its left
    Side,
    /// The whole figure from behind
    Back,
    /// Head and chest
    Bust,
    /// The face alone
    Face,
}

fn pixels(text: &str) -> Result<usize, String> {
    let pixels: usize = text.parse().map_err(|cause| format!("{cause}"))?;
    if (16..=4096).contains(&pixels) { Ok(pixels) } else { Err("expected 16 to 4096".to_owned()) }
}
