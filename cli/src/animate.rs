//! `umo animate` and what it shares with `umo text`: an animation run to its end into a clip.

use std::time::{Duration, Instant};

use umo_core::animation::Animation;
use umo_core::audio::resample;
use umo_core::avatar::AvatarConfig;
use umo_core::lm::sampler::Sampler;
use umo_core::model::Model;
use umo_core::motion::clip::Clip;
use umo_core::weights::Loader;
use umo_core::{Compute, Config, ModelFile, Precision, StepError, Team};

use crate::args::{Animate, Output};
use crate::export::{self, Format};
use crate::failure::Failure;
use crate::{model, progress, start_pose, wav};

/// Animates a recording.
pub(crate) fn run(args: &Animate) -> Result<(), Failure> {
    let wav = wav::read(&args.speech).map_err(Failure::input)?;
    for note in &wav.notes {
        let damage = format!("{}: {note}", args.speech.display());
        if !args.repair {
            return Err(Failure::Input(format!("{damage} (--repair takes what can be used)")));
        }
        eprintln!("warning: {damage}");
    }
    let job = Job::new(&args.output)?;
    let config = job.model.config();
    let frames = wav.frames() * config.frame_rate / wav.sample_rate as usize;
    if frames == 0 {
        let problem =
            format!("{}: {:.1} ms of audio is less than one frame", args.speech.display(), 1e3 * wav.seconds());
        return Err(Failure::Input(problem));
    }
    let samples = resample::to_rate(&wav.mono(), wav.sample_rate as usize, config.audio.sample_rate)?;
    let mut animation = job.animation("audio_to_motion", args.prompt.as_deref())?;
    if args.whole_file_units {
        let cx = Compute { isa: job.model.isa(), team: &job.team };
        let (units, silence) = job.model.tokenizer().whole_file(cx, &samples)?;
        animation.avatar_mut().use_whole_file_units(units, silence);
    }
    animation.push_audio(&samples)?;
    animation.finish(frames);
    let done = job.finish(&mut animation, frames);
    if let Some((compared, differed)) = animation.avatar().unit_disagreement() {
        let share = 100.0 * differed as f64 / compared.max(1) as f64;
        eprintln!(
            "note: {differed} of {compared} audio units ({share:.1} %) differ between the whole file and its stream"
        );
    }
    done
}

/// A loaded model, open outputs, and threads.
pub(crate) struct Job<'a> {
    args: &'a Output,
    file: ModelFile,
    pub(crate) model: Model,
    load_time: Duration,
    team: Team,
    outputs: Vec<export::Output>,
}

impl<'a> Job<'a> {
    /// Checks everything that can be checked before the work starts.
    pub(crate) fn new(args: &'a Output) -> Result<Self, Failure> {
        let format = args.format.as_deref().map(Format::parse).transpose()?;
        let formats = args.output.iter().map(|path| format.map_or_else(|| Format::from_extension(path), Ok));
        let formats = formats.collect::<Result<Vec<_>, _>>()?;
        let file: ModelFile = model::open(args.model.as_deref())?;
        for format in &formats {
            format.check_face(&file.config().face)?;
        }
        let outputs = args.output.iter().zip(formats).map(|(path, format)| export::Output::create(path, format));
        let outputs = outputs.collect::<Result<_, _>>()?;
        let isa = model::isa(&args.compute)?;
        let start = Instant::now();
        Ok(Self {
            args,
            model: Model::load(&file, args.compute.precision(Precision::Stored), isa)?,
            load_time: start.elapsed(),
            file,
            team: model::team(&args.compute)?,
            outputs,
        })
    }

    /// An animation as the arguments want it.
    pub(crate) fn animation(&self, template: &str, text: Option<&str>) -> Result<Animation, Failure> {
        let config = self.model.config();
        let ids = text.map(|text| prompt(&self.model, text)).transpose()?.unwrap_or_default();
        let template = named(config, template, text.is_some())?;
        let defaults = AvatarConfig::new(config);
        let sampler =
            if self.args.greedy { Sampler::GREEDY } else { Sampler { seed: self.args.seed, ..defaults.sampler } };
        let mut animation = Animation::new(
            &self.model,
            &AvatarConfig {
                target: self.args.target.unwrap_or(defaults.target),
                lookahead: self.args.lookahead.unwrap_or(defaults.lookahead),
                sampler,
                template,
                text: ids,
            },
        )?;
        if let Some(path) = &self.args.start_pose {
            let cx = Compute { isa: self.model.isa(), team: &self.team };
            let precision = self.args.compute.precision(Precision::Stored);
            let loader = Loader::new(&self.file, precision, self.model.isa());
            let codes = start_pose::codes(cx, &loader, path)?;
            animation.avatar_mut().set_history(start_pose::as_slices(&codes))?;
        }
        Ok(animation)
    }

    /// Runs the animation to its end and writes every output.
    pub(crate) fn finish(self, animation: &mut Animation, frames: usize) -> Result<(), Failure> {
        let config = self.model.config();
        let cx = Compute { isa: self.model.isa(), team: &self.team };
        let mut clip = Clip::new(config);
        let (bar, start) = (progress::frames(frames), Instant::now());
        while animation.step(&self.model, cx, &mut |frame| clip.push(frame.pose, frame.face))? {
            bar.set_position(clip.len() as u64);
        }
        bar.finish_and_clear();
        if clip.len() != frames {
            return Err(StepError::Order("internal: the animation ended early").into());
        }
        let (seconds, took) = (frames as f64 / config.frame_rate as f64, start.elapsed().as_secs_f64());
        for output in self.outputs {
            output.write(&clip).map_err(Failure::machine)?;
        }
        let names: Vec<_> = self.args.output.iter().map(|path| path.display().to_string()).collect();
        println!("{}: {frames} frames, {seconds:.2} s, made in {took:.2} s", names.join(", "));
        if self.args.timings {
            print_times(self.load_time, animation, config);
        }
        Ok(())
    }
}

/// Milliseconds that the model took to load, and each stage, in all and per chunk.
fn print_times(load: Duration, animation: &Animation, config: &Config) {
    let times = animation.stage_times();
    let chunks = animation.avatar().chunks(config).unwrap_or(0).max(1);
    println!("{:<10} {:>12} {:>12}", "stage", "ms in all", "ms a chunk");
    println!("{:<10} {:>12.1} {:>12}", "load", 1e3 * load.as_secs_f64(), "-");
    for (stage, time) in [
        ("tokenizer", times.tokenizer),
        ("encoder", times.encoder),
        ("decoder", times.decoder),
        ("interp", times.interp),
        ("motion", times.motion),
    ] {
        let ms = 1e3 * time.as_secs_f64();
        println!("{stage:<10} {ms:>12.1} {:>12.2}", ms / chunks as f64);
    }
}

/// The ids of a prompt.
fn prompt(model: &Model, text: &str) -> Result<Vec<u32>, Failure> {
    let tokenizer =
        model.text().ok_or_else(|| Failure::input("this model takes no text: it has no `text.tokenizer`"))?;
    Ok(tokenizer.encode(text)?)
}

/// The template `name`, or with a text the variant of it that has room for one.
fn named(config: &Config, name: &str, text: bool) -> Result<String, Failure> {
    if !text {
        return Ok(name.to_owned());
    }
    let has_text = |name: &str| umo_core::lm::layout::Template::new(config, name).is_ok_and(|t| t.has_text());
    let candidates = [name.to_owned(), format!("{name}_with_text")];
    candidates
        .into_iter()
        .find(|name| has_text(name))
        .ok_or_else(|| Failure::input(format!("this model takes no text: its template `{name}` has no place for one")))
}
