//! `umo animate`, and the code it shares with `umo text`: runs an animation to its end and collects a clip.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use umo_core::{
    Animation, AvatarConfig, Compute, Config, Face, Layer, LayerGains, Model, ModelFile, Precision, Sampler,
    SessionConfig, StepError, Take, Team,
};
use umo_core_base::file::AtomicFile;
use umo_core_model::lm::depth::is_guidable;
use umo_core_model::weights::Loader;
use umo_core_pose::clip::Clip;
use umo_gltf::keys::Keying;

use crate::args::{self, Animate, Files, GenerateArgs, Output};
use crate::export::{self, ExportError, FigureCache, Format};
use crate::failure::Failure;
use crate::speech::Speech;
use crate::strokes::Strokes;
use crate::words::Script;
use crate::{atomic_file, gestures, model, progress, score, start_pose};

/// Animates a recording.
pub(crate) fn run(args: &Animate) -> Result<(), Failure> {
    if let Some(take) = &args.edit.take {
        return score::animate(args, take);
    }
    let speech = Speech::open(&args.speech, args.repair)?;
    let job = Job::new(&args.output)?;
    if args.retime && job.generator.records {
        return Err(Failure::input("--retime does not go with a take: packets cannot say a retimed motion"));
    }
    let generator = &job.generator;
    let frames = speech.frames(generator.model.config().frame_rate)?;
    let mut animation = generator.animation("audio_to_motion", args.prompt.as_deref())?;
    if args.whole_file_units {
        let samples = speech.mono(generator.model.config().audio.sample_rate)?;
        let (units, silence) = generator.model.tokenizer().whole_file(generator.compute(), &samples)?;
        animation.avatar_mut().use_whole_file_units(units, silence);
    }
    if args.retime {
        animation.retime(&generator.model)?;
    }
    let script = Script::begin(&args.words, &speech, &mut animation)?;
    generator.hear(&mut animation, &speech)?;
    let done = job.finish(&mut animation, frames, script);
    if let Some((compared, differed)) = animation.avatar().unit_disagreement() {
        let share = 100.0 * differed as f64 / compared.max(1) as f64;
        eprintln!(
            "note: {differed} of {compared} audio units ({share:.1} %) differ between the whole file and its stream"
        );
    }
    done
}

/// A loaded model and the threads that run it.
pub(crate) struct Generator<'a> {
    args: &'a GenerateArgs,
    precision: Precision,
    file: ModelFile,
    pub(crate) model: Arc<Model>,
    load_time: Duration,
    team: Team,
    /// Whether animations record a take.
    pub(crate) records: bool,
}

impl<'a> Generator<'a> {
    /// Loads the model of `file`.
    pub(crate) fn new(args: &'a GenerateArgs, compute: &args::Compute, file: ModelFile) -> Result<Self, Failure> {
        let (isa, precision) = (model::isa(compute)?, compute.precision(Precision::Stored));
        let start = Instant::now();
        Ok(Self {
            args,
            precision,
            model: Arc::new(Model::load(&file, precision, isa)?),
            load_time: start.elapsed(),
            file,
            team: model::team(compute)?,
            records: false,
        })
    }

    /// Returns the instruction set and team for the products.
    pub(crate) fn compute(&self) -> Compute<'_> {
        Compute { isa: self.model.isa(), team: &self.team }
    }

    /// Attaches a recording to an animation as its audio; returns the recording's length in frames.
    pub(crate) fn hear(&self, animation: &mut Animation, speech: &Speech) -> Result<usize, Failure> {
        let config = self.model.config();
        let frames = speech.frames(config.frame_rate)?;
        animation.hear(Box::new(speech.samples(config.audio.sample_rate)?), frames);
        Ok(frames)
    }

    /// Returns the avatar configuration given by the arguments.
    pub(crate) fn avatar(&self) -> AvatarConfig {
        // The whole recording is available, so a longer horizon costs nothing.
        avatar(self.args, self.model.config(), self.model.config().audio.ahead)
    }

    /// Returns an animation configured by the arguments.
    pub(crate) fn animation(&self, template: &str, text: Option<&str>) -> Result<Animation, Failure> {
        self.animation_with(&self.team, template, text, self.args.seed, self.args.start_pose.as_deref())
    }

    /// Like [`Self::animation`], with an explicit seed, start pose and team for the preparation.
    pub(crate) fn animation_with(
        &self,
        team: &Team,
        template: &str,
        text: Option<&str>,
        seed: u64,
        start_pose: Option<&Path>,
    ) -> Result<Animation, Failure> {
        let config = self.model.config();
        let ids = text.map(|text| prompt(&self.model, text)).transpose()?.unwrap_or_default();
        let template = named(config, template, text.is_some())?;
        let gestures = gestures::known(&self.args.gesture_clip, &config.skeleton)?;
        let mut avatar = AvatarConfig { template, text: ids, ..self.avatar() };
        if !self.args.greedy {
            avatar.sampler.seed = seed;
        }
        if avatar.template == TEXT && text.is_some() && is_guidable(config) {
            avatar.guidance = self.args.guidance.unwrap_or(TEXT_GUIDANCE);
            if self.args.temperature.is_none() && !self.args.greedy {
                let of_text = &mut avatar.sampler.sampling.temperature;
                *of_text = of_text.min(TEXT_TEMPERATURE);
            }
        }
        let mut animation = Animation::with_layers(&self.model, &avatar, layers(self.args), gestures.clone())?;
        if let Some(path) = start_pose {
            let loader = Loader::new(&self.file, self.precision, self.model.isa());
            let cx = Compute { isa: self.model.isa(), team };
            start_pose::begin(cx, &loader, path, &mut animation)?;
        }
        if self.records {
            animation.record(&self.model)?;
        }
        for gesture in &self.args.gesture {
            gestures::play(&mut animation, &gestures, &gesture.name, &gesture.options)?;
        }
        Ok(animation)
    }

    /// Runs an animation to its end with the words of `script`; calls `look` after each chunk.
    pub(crate) fn clip(
        &self,
        animation: &mut Animation,
        frames: usize,
        mut script: Script,
        mut look: impl FnMut(&Animation),
    ) -> Result<Clip, Failure> {
        let mut clip = self.model.config().clip();
        let bar = progress::frames(frames);
        script.give(|text, start, end| animation.hint_words(text, start, end))?;
        while animation.step(&self.model, self.compute(), &mut |frame| clip.push(frame.pose, frame.face))? {
            bar.set_position(clip.len().max(animation.waiting()) as u64);
            look(animation);
            script.give(|text, start, end| animation.hint_words(text, start, end))?;
        }
        bar.finish_and_clear();
        if clip.len() != frames {
            return Err(StepError::Order("internal: the animation ended early").into());
        }
        Ok(clip)
    }
}

/// Template for text without audio.
pub(crate) const TEXT: &str = "text_to_motion";
/// Guidance for text without audio, and the upper bound on its sampling temperature (docs/motion.md).
const TEXT_GUIDANCE: f32 = 2.5;
const TEXT_TEMPERATURE: f32 = 0.7;

/// Returns the speech-to-motion avatar configuration; `horizon` applies if the arguments do not set one.
pub(crate) fn avatar(args: &GenerateArgs, config: &Config, horizon: usize) -> AvatarConfig {
    let defaults = SessionConfig::new(config).avatar;
    let mut sampler = if args.greedy { Sampler::GREEDY } else { Sampler { seed: args.seed, ..defaults.sampler } };
    sampler.sampling.temperature = args.temperature.unwrap_or(sampler.sampling.temperature);
    sampler.activity = args.activity.unwrap_or(defaults.sampler.activity);
    sampler.expression = args.expression.unwrap_or(defaults.sampler.expression);
    AvatarConfig {
        target: args.target.unwrap_or(defaults.target),
        lookahead: args.lookahead.unwrap_or(defaults.lookahead),
        horizon: args.horizon.unwrap_or(horizon),
        guidance: args.guidance.unwrap_or(defaults.guidance),
        smoothing: args.smoothing.unwrap_or(defaults.smoothing),
        sampler,
        ..defaults
    }
}

/// Returns the initial gain of each layer.
pub(crate) fn layers(args: &GenerateArgs) -> LayerGains {
    let mut gains = LayerGains::ON;
    for &(layer, gain) in &args.layers {
        for &layer in layer.as_ref().map_or(&Layer::ALL[..], std::slice::from_ref) {
            gains = gains.with(layer, gain);
        }
    }
    gains
}

/// Extension and name of a take's format.
pub(crate) const TAKE: &str = "umo";

/// Whether a file is a take by its extension.
pub(crate) fn is_take(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(TAKE))
}

/// The open files of a motion.
pub(crate) struct Outputs<'a> {
    args: &'a Files,
    motions: Vec<export::Output>,
    takes: Vec<AtomicFile>,
}

impl<'a> Outputs<'a> {
    /// Checks the formats for a face, and, if `is_keyed`, for keys; and opens the files.
    pub(crate) fn open(args: &'a Files, face: &Face, is_keyed: bool) -> Result<Self, Failure> {
        let format = args.format.as_deref();
        let is_take =
            |path: &&PathBuf| format.map_or_else(|| is_take(path), |format| format.eq_ignore_ascii_case(TAKE));
        let (takes, motions): (Vec<_>, Vec<_>) = args.output.iter().partition(is_take);
        let format = format.filter(|_| takes.is_empty()).map(Format::parse).transpose()?;
        let of = |path: &PathBuf| format.map_or_else(|| Format::from_extension(path), Ok);
        let formats = motions.iter().map(|path| of(path)).collect::<Result<Vec<_>, _>>()?;
        formats.iter().try_for_each(|format| format.check_face(face))?;
        if let Some(&format) = formats.iter().find(|format| is_keyed && !format.is_keyed()) {
            return Err(ExportError::NoKeys(format).into());
        }
        let motions = motions.iter().zip(formats).map(|(path, format)| export::Output::create(path, format));
        Ok(Self {
            args,
            motions: motions.collect::<Result<_, _>>()?,
            takes: takes.into_iter().map(|path| atomic_file::create(path)).collect::<Result<_, _>>()?,
        })
    }

    /// Writes every file, motions with the keys and markers of `keying`; returns their names.
    pub(crate) fn write(self, clip: &Clip, take: Option<&Take>, keying: Option<&Keying>) -> Result<String, Failure> {
        let mut figure = FigureCache::from(self.args.figure);
        for motion in self.motions {
            motion.write_as(clip, &mut figure, keying).map_err(Failure::environment)?;
        }
        for file in self.takes {
            let take = take.ok_or_else(|| Failure::environment("internal: nothing was recorded"))?;
            atomic_file::commit(file, |out| out.write_all(take.bytes()))?;
        }
        let names: Vec<_> = self.args.output.iter().map(|path| path.display().to_string()).collect();
        Ok(names.join(", "))
    }
}

/// A loaded model and its open outputs.
pub(crate) struct Job<'a> {
    args: &'a Output,
    pub(crate) generator: Generator<'a>,
    outputs: Outputs<'a>,
}

impl<'a> Job<'a> {
    /// Checks the arguments, opens the outputs and loads the model, all before the work starts.
    pub(crate) fn new(args: &'a Output) -> Result<Self, Failure> {
        let file: ModelFile = model::open(args.compute.model.as_deref())?;
        let outputs = Outputs::open(&args.files, &file.config().face, args.reduce.is_some())?;
        let mut generator = Generator::new(&args.generate, &args.compute, file)?;
        generator.records = !outputs.takes.is_empty();
        Ok(Self { args, generator, outputs })
    }

    /// Runs the animation to its end with the words of `script`, and writes every output.
    pub(crate) fn finish(self, animation: &mut Animation, frames: usize, script: Script) -> Result<(), Failure> {
        let config = self.generator.model.config();
        let start = Instant::now();
        let mut strokes = Strokes::new(config);
        let mut markers = Vec::new();
        if self.args.reduce.is_some() {
            animation.keep_record(config);
            markers.extend(script.markers());
        }
        let clip = self.generator.clip(animation, frames, script, |animation| {
            if let (Some(strokes), Some(chunk)) = (&mut strokes, animation.chunk()) {
                strokes.hear(chunk.first_frame, chunk.keyframes);
            }
        })?;
        markers.extend(strokes.into_iter().flat_map(Strokes::markers));
        markers.retain(|marker| marker.seconds < frames as f64 / config.frame_rate as f64);
        markers.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let keying = self.args.reduce.map(|bound| Keying { bound, markers });
        let (seconds, took) = (frames as f64 / config.frame_rate as f64, start.elapsed().as_secs_f64());
        let names = self.outputs.write(&clip, animation.take().as_ref(), keying.as_ref())?;
        println!("{names}: {frames} frames, {seconds:.2} s, made in {took:.2} s");
        if self.args.timings {
            print_times(self.generator.load_time, animation, config);
        }
        Ok(())
    }
}

/// Prints the model's load time and the time of each stage, in total and per chunk, in milliseconds.
fn print_times(load: Duration, animation: &Animation, config: &Config) {
    let times = animation.stage_times();
    let chunks = animation.avatar().chunks(config).unwrap_or(0).max(1);
    println!("{:<10} {:>12} {:>12}", "stage", "ms in all", "ms a chunk");
    println!("{:<10} {:>12.1} {:>12}", "load", 1e3 * load.as_secs_f64(), "-");
    for (stage, time) in [
        ("tokenizer", times.tokenizer),
        ("encoder", times.encoder),
        ("decoder", times.decoder),
        ("depth", times.depth),
        ("interp", times.interp),
        ("motion", times.motion),
    ]
    .into_iter()
    .filter(|&(stage, _)| stage != "depth" || config.is_frames())
    {
        let ms = 1e3 * time.as_secs_f64();
        println!("{stage:<10} {ms:>12.1} {:>12.2}", ms / chunks as f64);
    }
}

/// Encodes a text as the model's tokens; prints a note if the model was not trained with it.
pub(crate) fn prompt(model: &Model, text: &str) -> Result<Vec<u32>, Failure> {
    let tokenizer =
        model.text().ok_or_else(|| Failure::input("this model takes no text: it has no `text.tokenizer`"))?;
    if let Some(prompts) = model.config().unknown_prompt(text) {
        eprintln!("note: the model was not trained with the prompt `{text}`, so the result is chance: {prompts}");
    }
    Ok(tokenizer.encode(text)?)
}

/// Returns the template `name`; with a text, the first of `name` and `name_with_text` that accepts one.
pub(crate) fn named(config: &Config, name: &str, text: bool) -> Result<String, Failure> {
    if !text {
        return Ok(name.to_owned());
    }
    let has_text = |name: &str| umo_core_model::lm::layout::Template::new(config, name).is_ok_and(|t| t.has_text());
    let candidates = [name.to_owned(), format!("{name}_with_text")];
    candidates
        .into_iter()
        .find(|name| has_text(name))
        .ok_or_else(|| Failure::input(format!("this model takes no text: its template `{name}` has no slot for it")))
}
