//! Scores: what a take does, as text that can be changed (docs/scores.md).
//!
//! | module | contents |
//! |---|---|
//! | `line` | an event of a score, and its line of text |
//! | `file` | a score out of TOML |
//! | `hands` | phases of hands: keyframes to spans and back |
//! | `change` | from a changed score to an edit of its take |
//! | `carry` | changes of a score on a motion that was made anew |

mod carry;
mod change;
mod file;
mod hands;
mod line;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use umo_core::{Compute, Event, Model, Take};
use umo_core_base::file::read;

use crate::animate::Outputs;
use crate::args::{Animate, Score as Args};
use crate::failure::Failure;
use crate::speech::Speech;
use crate::{model, play};
pub(crate) use carry::{Own, carry};
pub(crate) use line::{Kind, Line, text};

/// Speed of a wrist at a stroke of strength 1, m/s: twice that of people's median stroke.
const FULL_SPEED: f32 = 1.6;

/// Prints a take's score.
pub(crate) fn run(args: &Args) -> Result<(), Failure> {
    let take = open(&args.take)?;
    let model = model::load(&args.compute)?;
    let team = model::team(&args.compute)?;
    let lines = lines(&take, &model, Compute { isa: model.isa(), team: &team }, &args.take)?;
    print!("{}", text(&lines, seconds(&take)));
    Ok(())
}

/// Reads a take.
pub(crate) fn open(path: &Path) -> Result<Take, Failure> {
    let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
    Take::new(&read(path).map_err(|error| wrong(error.to_string()))?).map_err(|error| wrong(error.to_string()))
}

/// Length of a take.
pub(crate) fn seconds(take: &Take) -> f64 {
    f64::from(take.info().frames) / f64::from(take.info().frame_rate)
}

/// Returns the lines of a take's score, in order.
pub(crate) fn lines(take: &Take, model: &Model, cx: Compute, path: &Path) -> Result<Vec<Line>, Failure> {
    let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
    if take.info().model != model.fingerprint() {
        return Err(wrong(umo_core::TakeError::Model.to_string()));
    }
    let mut lines = hands::lines(take, model, cx).map_err(|error| wrong(error.to_string()))?;
    lines.extend(requests(take));
    lines.sort_by(Line::order);
    Ok(lines)
}

/// Requests of a take.
pub(crate) fn requests(take: &Take) -> Vec<Line> {
    let rate = f64::from(take.info().frame_rate);
    let mut lines = vec![Line::at(0.0, Kind::Expression(take.avatar().sampler.expression))];
    lines.extend(take.events().filter_map(|(frame, event)| Line::of(frame as f64 / rate, &event)));
    lines
}

/// Checks that a take, whose own lines are `own`, can do what the lines of a score say.
pub(crate) fn check(
    take: &Take,
    model: &Model,
    own: &[Line],
    lines: &[Line],
    gestures: &umo_core::Gestures,
) -> Result<(), String> {
    let score = Score { path: PathBuf::new(), lines: lines.iter().map(|line| (0, line.clone())).collect() };
    match change::edit(take, model, own, &score, gestures) {
        Ok(_) => Ok(()),
        Err(failure) => Err(failure.to_string().trim_start_matches(":0: ").to_owned()),
    }
}

/// Makes a take anew as its score says, and writes it and what it shows.
pub(crate) fn animate(args: &Animate, path: &Path) -> Result<(), Failure> {
    let take = open(path)?;
    let speech = Speech::open(&args.speech, args.repair)?;
    let model = model::load(&args.output.compute)?;
    let team = model::team(&args.output.compute)?;
    let cx = Compute { isa: model.isa(), team: &team };
    let drawer = Drawer { model: &model, cx, path, speech: &speech };
    let score = args.edit.score.as_deref().map(file::open).transpose()?;
    let config = play::session(&model, &args.output.generate.gesture_clip, &args.words.rules)?;
    let outputs = |number: Option<u64>| -> Vec<PathBuf> {
        args.output.files.output.iter().map(|path| numbered(path, number)).collect()
    };
    let variants = args.edit.variants.unwrap_or(1);
    for variant in 0..variants {
        let files = crate::args::Files {
            output: outputs((variants > 1).then_some(variant + 1)),
            figure: args.output.files.figure,
            format: args.output.files.format.clone(),
        };
        let outputs = Outputs::open(&files, &model.config().face, false)?;
        let edited = drawer.draw(&take, score.as_ref(), args.edit.span.clone(), variant, &config.gestures)?;
        play::show(&model, (path, &edited), outputs, &config)?;
    }
    Ok(())
}

/// `take.umo` and 2 to `take-2.umo`.
fn numbered(path: &Path, number: Option<u64>) -> PathBuf {
    let Some(number) = number else { return path.to_owned() };
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().map(|it| format!(".{}", it.to_string_lossy())).unwrap_or_default();
    path.with_file_name(format!("{stem}-{number}{extension}"))
}

/// A model and a recording to draw takes with.
pub(crate) struct Drawer<'a> {
    pub(crate) model: &'a Arc<Model>,
    pub(crate) cx: Compute<'a>,
    /// The take's file, for messages.
    pub(crate) path: &'a Path,
    pub(crate) speech: &'a Speech,
}

impl Drawer<'_> {
    /// Returns the take of a changed score; the part in `span`, seconds, is drawn anew in any case.
    pub(crate) fn draw(
        &self,
        take: &Take,
        score: Option<&Score>,
        span: Option<std::ops::Range<f64>>,
        variant: u64,
        gestures: &umo_core::Gestures,
    ) -> Result<Take, Failure> {
        let Self { model, cx, path, speech } = *self;
        let wrong = |problem: String| Failure::Input(format!("{}: {problem}", path.display()));
        let own = lines(take, model, cx, path)?;
        let mut edit = match score {
            Some(score) => change::edit(take, model, &own, score, gestures)?,
            None => change::nothing(take, model),
        };
        edit.variant = variant;
        edit.anew.extend(span.map(|span| hands::keyframes(take, model, &span)));
        let samples = speech.mono(model.config().audio.sample_rate)?;
        take.edited(model, cx, &samples, &edit).map_err(|error| wrong(error.to_string()))
    }
}

/// A score as it was read.
#[derive(Debug)]
pub(crate) struct Score {
    /// Its file, for messages.
    pub(crate) path: PathBuf,
    /// Each with the number of its line of text.
    pub(crate) lines: Vec<(usize, Line)>,
}

impl Score {
    /// Reads a score's file.
    pub(crate) fn open(path: &Path) -> Result<Self, Failure> {
        file::open(path)
    }

    /// Reads a score; `path` is for messages.
    pub(crate) fn parse(path: &Path, text: &str) -> Result<Self, Failure> {
        file::parse(path, text)
    }

    fn wrong(&self, line: usize, problem: impl std::fmt::Display) -> Failure {
        Failure::Input(format!("{}:{line}: {problem}", self.path.display()))
    }
}

/// Whether an event is part of a score: the others are how codes were drawn.
fn is_shown(event: &Event) -> bool {
    !matches!(event, Event::Prompt(_) | Event::Sampler(_))
}
