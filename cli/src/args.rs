//! The command line.

mod bench;
mod models;

use std::path::PathBuf;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::{Args as ClapArgs, Parser, Subcommand, ValueEnum};
use umo_core::{GestureOptions, GestureParts, Layer, Precision, Priority, Side};
use umo_figure::Figure;

pub use bench::{Bench, Doctor, Neighbour};
pub use models::{
    Convert, FloatArg, Inspect, LayoutArg, MakeRandom, NewRows, Quantize, Size, Stage, StorageArg, WeightsArg,
};

/// Speech in, a moving body out: face, hands, upper and lower body at 30 frames a second.
#[derive(Debug, Parser)]
#[command(name = "umo", version, about, max_term_width = 100)]
pub struct Args {
    /// Command.
    #[command(subcommand)]
    pub command: Command,
}

/// Commands of the program.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Animate a speech recording
    Animate(Animate),
    /// Animate many recordings: a folder, or a manifest
    Batch(Batch),
    /// Animate an action from text that the model or the table of gestures knows
    Text(Text),
    /// List the gestures that `animate --gesture` and `text` know
    Gestures,
    /// Run one stage of a model alone, tensors in and tensors out
    Stage(Stage),
    /// Print the contents of a model or a character, and what a character lacks
    Inspect(Inspect),
    /// Convert published weights to a model
    Convert(Convert),
    /// Quantize a model
    Quantize(Quantize),
    /// Write a model of random weights, for tests and benchmarks
    MakeRandom(MakeRandom),
    /// Write an HTML viewer of the avatar with its speech, or serve it live
    View(Page),
    /// Move an avatar in another program while somebody speaks: VRM avatars over the VMC protocol
    Live(Live),
    /// Animate for many clients at once: a WebSocket server, speech in, frames or packets out
    #[cfg(feature = "serve")]
    Serve(Serve),
    /// Write a figure as an avatar for other programs: .glb or .vrm
    Figure(FigureArgs),
    /// Retarget an animation to another character's skeleton and face
    Retarget(Retarget),
    /// Measure a model on this machine: time to the first frame, frames per second, avatars at once
    Bench(Bench),
    /// Test this machine: processor, kernels, the model's motion, speed; exits with 1 if a test fails
    Doctor(Doctor),
    /// Draw the figure as a PNG picture: frames of an animation, or each of its 52 shapes
    Draw(Draw),
}

/// Outputs and settings that `animate` and `text` share.
#[derive(Debug, ClapArgs)]
pub struct Output {
    /// File to write; may be given several times
    #[arg(short, long = "output", value_name = "FILE", required = true)]
    pub output: Vec<PathBuf>,
    /// Format of all outputs: npz, bvh, glb, vrma, csv or jsonl [default: by extension]
    #[arg(long, value_name = "FORMAT")]
    pub format: Option<String>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
    /// Print the time of each stage
    #[arg(long)]
    pub timings: bool,
    /// Figure that wears the motion in .glb files
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
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

/// Settings of an animation.
#[derive(Debug, ClapArgs)]
pub struct GenerateArgs {
    /// Model file [default: the embedded one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Keyframes per chunk: fewer lower the latency, more lower the cost
    #[arg(long, value_name = "N")]
    pub target: Option<usize>,
    /// Frames held back for smooth seams between chunks
    #[arg(long, value_name = "FRAMES")]
    pub lookahead: Option<usize>,
    /// Keyframes of speech after a chunk that the model hears [default: as many as it can for a recording,
    /// 0 live]
    #[arg(long, value_name = "KEYFRAMES")]
    pub horizon: Option<usize>,
    /// Strength of the prompt, 1 to 3, in models of layout `frames` [default: 2.5 for a text alone, else 1]
    #[arg(long, value_name = "STRENGTH")]
    pub guidance: Option<f32>,
    /// Low-pass of the body's motion: standard deviation in frames, 0 to 1.5; 0 for none
    #[arg(long, value_name = "FRAMES")]
    pub smoothing: Option<f32>,
    /// Gain of the layers over the model's motion, 0 to 1: one number for all, or LAYER=GAIN for one
    /// of gaze, idle, asymmetry, nods, mood and feet
    #[arg(long, value_name = "GAIN", value_delimiter = ',', value_parser = life_gain)]
    pub life: Vec<(Option<Layer>, f32)>,
    /// Random seed: the same seed gives the same motion
    #[arg(long, value_name = "NUMBER", default_value_t = 0)]
    pub seed: u64,
    /// Take the likeliest code instead of sampling
    #[arg(long, conflicts_with = "seed")]
    pub greedy: bool,
    /// Sampling temperature, 0 to 100: lower is calmer, 0 takes the likeliest code [default: the model's,
    /// at most 0.7 for a text alone]
    #[arg(long, value_name = "NUMBER", conflicts_with = "greedy", value_parser = temperature)]
    pub temperature: Option<f32>,
    /// Begin in this pose: SMPL-X motion whose last keyframes become the history
    #[arg(long, value_name = "FILE.npz")]
    pub start_pose: Option<PathBuf>,
    /// Play a gesture over the motion: its name, the time of its stroke in seconds (`wave@2.5`;
    /// without a time as soon as possible), then after commas left, right or both, speed=0.5 to 2,
    /// strength=0 to 1, and to=X:Y:Z, a point in metres; may be given several times
    #[arg(long, value_name = "NAME[@SECONDS][,OPTION]", value_parser = gesture)]
    pub gesture: Vec<GestureArg>,
    /// Add a gesture for --gesture: NAME=FILE with an animation (glb, gltf, bvh, npz, jsonl), then after
    /// commas the time of its stroke and the parts that it moves (default: all): head, trunk, left-arm,
    /// right-arm (`salute=salute.glb,0.6,right-arm`)
    #[arg(long, value_name = "NAME=FILE[,SECONDS][,PART]", value_parser = gesture_clip)]
    pub gesture_clip: Vec<GestureClip>,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
}

/// A sampling temperature.
fn temperature(text: &str) -> Result<f32, String> {
    text.parse().ok().filter(|value| (0.0..=100.0).contains(value)).ok_or_else(|| "expected 0 to 100".to_owned())
}

/// Gain of all layers, or of one.
fn life_gain(text: &str) -> Result<(Option<Layer>, f32), String> {
    let (layer, gain) = match text.split_once('=') {
        Some((name, gain)) => {
            let known = || Layer::ALL.map(Layer::name).join(", ");
            let layer = Layer::ALL.into_iter().find(|layer| layer.name() == name);
            (Some(layer.ok_or_else(|| format!("no layer is called {name}; there are {}", known()))?), gain)
        }
        None => (None, text),
    };
    match gain.parse() {
        Ok(gain) if (0.0..=1.0).contains(&gain) => Ok((layer, gain)),
        _ => Err("expected a gain of 0 to 1, or LAYER=GAIN".to_owned()),
    }
}

/// A gesture to play.
#[derive(Clone, Debug, PartialEq)]
pub struct GestureArg {
    /// Its name.
    pub name: String,
    /// Options.
    pub options: GestureOptions,
}

fn gesture(text: &str) -> Result<GestureArg, String> {
    let mut words = text.split(',');
    let what = words.next().unwrap_or_default();
    let (name, at) = what.split_once('@').map_or((what, None), |(name, at)| (name, Some(at)));
    let mut options = GestureOptions::default();
    let number = |text: &str| text.parse::<f32>().map_err(|_| format!("`{text}` is no number"));
    if let Some(at) = at {
        options.at = Some(at.parse().map_err(|_| format!("`{at}` is no number of seconds"))?);
    }
    for word in words {
        match word.split_once('=') {
            None if word == "left" => options.side = Side::Left,
            None if word == "right" => options.side = Side::Right,
            None if word == "both" => options.side = Side::Both,
            Some(("speed", value)) => options.speed = number(value)?,
            Some(("strength", value)) => options.strength = number(value)?,
            Some(("to", value)) => {
                let place = value.split(':').map(number).collect::<Result<Vec<_>, _>>()?;
                options.target = Some(place.try_into().map_err(|_| format!("`{value}` is no place X:Y:Z"))?);
            }
            _ => return Err(format!("`{word}`: expected left, right, both, speed=, strength= or to=X:Y:Z")),
        }
    }
    Ok(GestureArg { name: name.to_owned(), options })
}

/// A gesture from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct GestureClip {
    /// Its name.
    pub name: String,
    /// Its frames.
    pub file: PathBuf,
    /// Time of its stroke in seconds; `None` for its middle.
    pub stroke: Option<f32>,
    /// The parts that it moves.
    pub parts: GestureParts,
}

fn gesture_clip(text: &str) -> Result<GestureClip, String> {
    let (name, rest) = text.split_once('=').ok_or("expected NAME=FILE")?;
    let mut words = rest.split(',');
    let file = PathBuf::from(words.next().unwrap_or_default());
    let (mut stroke, mut parts) = (None, None);
    for word in words {
        let part = match word {
            "head" => GestureParts::HEAD,
            "trunk" => GestureParts::TRUNK,
            "left-arm" => GestureParts::LEFT_ARM,
            "right-arm" => GestureParts::RIGHT_ARM,
            _ => {
                let problem = || format!("`{word}`: expected seconds, head, trunk, left-arm or right-arm");
                stroke = Some(word.parse().map_err(|_| problem())?);
                continue;
            }
        };
        parts = Some(parts.map_or(part, |parts: GestureParts| parts.union(part)));
    }
    Ok(GestureClip { name: name.to_owned(), file, stroke, parts: parts.unwrap_or(GestureParts::ALL) })
}

/// Settings of the computation.
#[derive(Debug, ClapArgs)]
pub struct Compute {
    /// Precision of the products [default: stored; `stage`: f32]
    #[arg(long, value_enum)]
    pub precision: Option<PrecisionArg>,
    /// Instruction set: scalar, avx2, avx512vnni … [default: the best of this processor]
    #[arg(long, value_name = "NAME")]
    pub isa: Option<String>,
    /// Threads [default: one per core]
    #[arg(long, value_name = "T")]
    pub threads: Option<usize>,
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

/// Animate a speech recording.
#[derive(Debug, ClapArgs)]
pub struct Animate {
    /// Recording of any common format, rate, length and level, with 1 to 8 channels
    pub speech: PathBuf,
    /// Prompt, for models that take one: a style, an emotion, an action
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    /// Read what is usable of a damaged recording: the part before a cut; silence for samples that are
    /// not numbers
    #[arg(long)]
    pub repair: bool,
    /// Tokenise the whole recording at once, as the paper does offline, and print the difference from
    /// the stream
    #[arg(long)]
    pub whole_file_units: bool,
    /// Move strokes of arms, trunk and head onto the accents of the voice; the frames then differ from
    /// those of a stream
    #[arg(long)]
    pub retime: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub output: Output,
}

/// Animate many recordings.
#[derive(Debug, ClapArgs)]
pub struct Batch {
    /// Folder of recordings, or a manifest (.csv with a header row, or .jsonl) with file and optionally
    /// output, seed, prompt, mood, start_pose, speaker; paths are relative to its folder
    pub input: PathBuf,
    /// Output folder [default: the input's]
    #[arg(short, long, value_name = "FOLDER")]
    pub output: Option<PathBuf>,
    /// Formats of lines without an output: npz, bvh, glb, vrma, csv or jsonl
    #[arg(long, value_name = "FORMAT", value_delimiter = ',', default_value = "glb")]
    pub format: Vec<String>,
    /// Lines computed together: more read the weights less often and need more memory
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = jobs)]
    pub jobs: usize,
    /// Only every n-th line, from the i-th on (i/n): for n machines
    #[arg(long, value_name = "I/N", value_parser = shard)]
    pub shard: Option<(usize, usize)>,
    /// File of results, JSON lines with hashes [default: results.jsonl in the output folder]. Lines with
    /// the same contents and settings are skipped
    #[arg(long, value_name = "FILE.jsonl")]
    pub results: Option<PathBuf>,
    /// Compute every line again
    #[arg(long)]
    pub again: bool,
    /// Read what is usable of damaged recordings
    #[arg(long)]
    pub repair: bool,
    /// Move strokes of arms, trunk and head onto the accents of the voice; the frames then differ from
    /// those of a stream
    #[arg(long)]
    pub retime: bool,
    /// Figure that wears the motion in .glb files
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
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

/// Write or serve a viewer.
#[derive(Debug, ClapArgs)]
pub struct Page {
    /// Recording, or a finished .glb, .npz or .jsonl, also a character from `umo retarget`; with --live or
    /// --web a recording, or nothing for the microphone alone
    #[arg(required_unless_present_any = ["live", "web"])]
    pub input: Option<PathBuf>,
    /// Page to write [default: beside the input]
    #[arg(short, long, value_name = "FILE.html", conflicts_with_all = ["live", "web"])]
    pub output: Option<PathBuf>,
    /// Speech of a finished animation
    #[arg(long, value_name = "FILE", conflicts_with_all = ["live", "web"])]
    pub audio: Option<PathBuf>,
    /// Character that wears the motion, .glb, .gltf or .vrm, in place of the figure
    #[arg(long, value_name = "FILE", conflicts_with = "figure")]
    pub onto: Option<PathBuf>,
    /// Mapping of the character's bones, for names that are not recognised: TOML or JSON
    #[arg(long, value_name = "FILE")]
    pub mapping: Option<PathBuf>,
    /// Serve the page to browsers of this machine, and stream the recording or their microphone
    /// through the engine
    #[arg(long, group = "stream")]
    pub live: bool,
    /// Write the page of --live as a folder for any web server: the model runs in the browser
    #[arg(long, value_name = "FOLDER", group = "stream")]
    pub web: Option<PathBuf>,
    /// Folder of the npm package `umo-web`, for --web [default: node_modules/umo-web or bindings/web]
    #[arg(long, value_name = "FOLDER", requires = "web")]
    pub package: Option<PathBuf>,
    /// Port to serve at [default: any free one]
    #[arg(long, value_name = "N", requires = "live")]
    pub port: Option<u16>,
    /// Timing of the mouth: with the sound, if the model has a mouth network, or with the body [default:
    /// live for the microphone, delayed for a recording]
    #[arg(long, value_name = "WHEN", requires = "stream")]
    pub voice: Option<VoiceArg>,
    /// Do not open a browser
    #[arg(long)]
    pub no_open: bool,
    /// Read what is usable of a damaged recording
    #[arg(long)]
    pub repair: bool,
    /// Figure that wears the motion on the page
    #[arg(long, value_name = "NAME", default_value = Figure::default().name(), value_parser = figure_parser())]
    pub figure: Figure,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
}

/// Move an avatar in another program.
#[derive(Debug, ClapArgs)]
#[command(group(clap::ArgGroup::new("receivers").required(true).multiple(true).args(["vmc", "livelink"])))]
pub struct Live {
    /// Recording, spoken in real time; `-` or nothing for standard input: 16-bit little-endian mono
    /// samples without a header
    pub input: Option<PathBuf>,
    /// Address of a program that listens for the VMC protocol
    #[arg(long, value_name = "HOST:PORT")]
    pub vmc: Option<String>,
    /// Address at which Unreal, or another program, listens for the Live Link Face app: face and head, for
    /// models with an ARKit face
    #[arg(long, value_name = "HOST:PORT")]
    pub livelink: Option<String>,
    /// Subject name in Live Link
    #[arg(long, value_name = "NAME", default_value = "umo", requires = "livelink")]
    pub subject: String,
    /// Send `mouthClose` to Live Link as 0, and `jawOpen` less by as much: for a MetaHuman whose lips close too far
    #[arg(long, requires = "livelink")]
    pub no_mouth_close: bool,
    /// Sample rate of standard input in Hz [default: 16000]
    #[arg(long, value_name = "HERTZ")]
    pub rate: Option<usize>,
    /// Poses per second
    #[arg(long, value_name = "N", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=240))]
    pub fps: u16,
    /// Height of the avatar's hips above the floor in metres [default: the model's]
    #[arg(long, value_name = "METRES")]
    pub hips: Option<f32>,
    /// Timing of the mouth: with the sound, if the model has a mouth network, or with the body [default:
    /// live if the model can]
    #[arg(long, value_name = "WHEN")]
    pub voice: Option<VoiceArg>,
    /// Prompt, for models that take one: a style, an emotion
    #[arg(long, value_name = "TEXT")]
    pub prompt: Option<String>,
    /// Read what is usable of a damaged recording
    #[arg(long)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
}

/// Serve avatars over WebSocket.
///
/// Clients connect to ws://ADDRESS/v1/session, say hello in JSON, send 16-bit samples, and get frames or
/// packets. /healthz says whether new clients may come, /metrics has numbers for Prometheus. SIGTERM ends
/// it gracefully. For TLS, put a proxy in front.
#[cfg(feature = "serve")]
#[derive(Debug, ClapArgs)]
pub struct Serve {
    /// Address to listen at; 0.0.0.0:PORT accepts other machines and needs --tokens or --open
    #[arg(long, value_name = "HOST:PORT", default_value = "127.0.0.1:8765")]
    pub listen: String,
    /// Model file [default: the embedded one]
    #[arg(long, value_name = "FILE")]
    pub model: Option<PathBuf>,
    /// Most sessions at once; `umo bench --sessions N` measures how many this machine can take
    #[arg(long, value_name = "N", default_value_t = 32)]
    pub sessions: usize,
    /// Most sessions of one token, or of one address without tokens [default: --sessions]
    #[arg(long, value_name = "N")]
    pub per_client: Option<usize>,
    /// Most sessions in a batch
    #[arg(long, value_name = "N", default_value_t = 8)]
    pub batch: usize,
    /// Priority of the threads that compute
    #[arg(long, value_enum, default_value_t = PriorityArg::Normal)]
    pub priority: PriorityArg,
    /// Batching window: longest wait of a chunk for others
    #[arg(long, value_name = "MS", default_value_t = 0)]
    pub gather: u32,
    /// File of tokens, a line each: a name for the client, and its token of 16 characters or more
    #[arg(long, value_name = "FILE")]
    pub tokens: Option<PathBuf>,
    /// Accept clients without a token
    #[arg(long, conflicts_with = "tokens")]
    pub open: bool,
    /// Origin of web pages that may connect beside the server's own (`https://avatar.example.com`); may be
    /// given several times
    #[arg(long, value_name = "ORIGIN")]
    pub origin: Vec<String>,
    /// Take clients' addresses from a proxy's X-Forwarded-For
    #[arg(long)]
    pub behind_proxy: bool,
    /// Audio computed ahead of real time, so that a client that sends a recording at once does not delay
    /// others; 0 for no limit
    #[arg(long, value_name = "SECONDS", default_value_t = 2.0, value_parser = seconds)]
    pub ahead: f64,
    /// Audio of a session queued here before its client has to wait
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = seconds)]
    pub buffer: f64,
    /// Timeout of a client's hello
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = seconds)]
    pub hello_within: f64,
    /// Timeout of a session without audio and commands
    #[arg(long, value_name = "SECONDS", default_value_t = 300.0, value_parser = seconds)]
    pub idle: f64,
    /// Time between pings; a client silent for twice as long is disconnected
    #[arg(long, value_name = "SECONDS", default_value_t = 20.0, value_parser = seconds)]
    pub heartbeat: f64,
    /// Timeout of a client that reads a message
    #[arg(long, value_name = "SECONDS", default_value_t = 5.0, value_parser = seconds)]
    pub stall: f64,
    /// Time for running sessions to finish after SIGTERM
    #[arg(long, value_name = "SECONDS", default_value_t = 30.0, value_parser = seconds)]
    pub drain: f64,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub compute: Compute,
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

/// A timeout of a server.
#[cfg(feature = "serve")]
fn seconds(text: &str) -> Result<f64, String> {
    let seconds = text.parse().ok().filter(|seconds| (0.0..=86_400.0).contains(seconds));
    seconds.ok_or_else(|| "expected 0 to 86400 seconds".to_owned())
}

/// Timing of the mouth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum VoiceArg {
    /// With the sound; the body follows
    Live,
    /// With the body
    Delayed,
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
    /// File to write, in the character's format
    #[arg(short, long, value_name = "FILE", required_unless_present_any = ["print_mapping", "sheet"])]
    pub output: Option<PathBuf>,
    /// Picture to write of the motion on the figure and on the character
    #[arg(long, value_name = "FILE.png")]
    pub sheet: Option<PathBuf>,
    /// Mapping of bones and shapes, for names that are not recognised: TOML or JSON
    #[arg(long, value_name = "FILE")]
    pub mapping: Option<PathBuf>,
    /// Print the mapping that was found, and what is missing
    #[arg(long)]
    pub print_mapping: bool,
    /// Read what is usable of a damaged recording
    #[arg(long)]
    pub repair: bool,
    #[command(flatten)]
    #[expect(missing_docs, reason = "clap would print a doc comment as help")]
    pub generate: GenerateArgs,
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
