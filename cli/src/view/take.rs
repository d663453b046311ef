//! The page of takes: one with its score to edit, or several of one recording beside each other.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use serde::Serialize;
use serde_json::Value;
use umo_core::{Attention, Compute, Layer, LipShape, Model, Mood, Place, SessionConfig, Take, Team};
use umo_core_pose::clip::Clip;

use super::scene::{self, Audio, RoomMember, Scene};
use crate::args::Page;
use crate::failure::Failure;
use crate::score::{self, Line};
use crate::speech::Speech;
use crate::{model, play};

/// Extension of a take.
const EXTENSION: &str = "umo";
/// Maximum number of takes side by side.
const MOST: usize = 8;
/// Distance from one take to the next, metres.
const APART: f32 = 0.95;

/// The takes of a page.
#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Takes {
    /// Name of the first one's file without its extension.
    pub(super) stem: String,
    /// Name of the recording, if it is known.
    pub(super) audio: Option<String>,
    /// Name of the file that a kept take is written to; `None` if no program serves the page.
    pub(super) kept: Option<String>,
    /// Score of the take, if there is one alone.
    pub(super) score: Option<Score>,
    #[serde(skip)]
    pub(super) files: Vec<Take>,
}

/// The score of a take, and the names that an edit can choose from.
#[derive(Serialize)]
pub(super) struct Score {
    seconds: f64,
    events: Vec<Value>,
    /// Whether the model knows the phases of hands.
    hands: bool,
    gestures: Vec<String>,
    moods: Vec<&'static str>,
    attentions: Vec<String>,
    layers: Vec<&'static str>,
    lips: Vec<&'static str>,
}

/// Takes that were opened, and what plays them.
pub(super) struct Opened {
    pub(super) paths: Vec<PathBuf>,
    pub(super) takes: Vec<Take>,
    pub(super) model: Arc<Model>,
    pub(super) session: SessionConfig,
    pub(super) team: Team,
}

/// Whether the file is a take.
pub(super) fn is_take(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(EXTENSION))
}

/// Refuses arguments that do not go with the kind of the input.
pub(super) fn check(args: &Page) -> Result<(), Failure> {
    let Some(first) = &args.input else { return Ok(()) };
    if let Some(other) = args.more.iter().find(|_| !is_take(first)).or_else(|| args.more.iter().find(|it| !is_take(it)))
    {
        return Err(Failure::input(format!("{}: only takes, .umo, stand side by side", other.display())));
    }
    if !is_take(first) {
        return match args.live {
            true => {
                Err(Failure::input("--live goes with takes, .umo: `umo live` animates a recording as it is spoken"))
            }
            false => Ok(()),
        };
    }
    args.words.refuse_with("a take: it has its words already")?;
    if args.more.len() >= MOST {
        return Err(Failure::input(format!("{} takes: at most {MOST} stand side by side", args.more.len() + 1)));
    }
    if args.audio.len() > 1 {
        return Err(Failure::input("takes of one recording have one --audio"));
    }
    match &args.shown.onto {
        Some(_) if args.live || !args.more.is_empty() => {
            Err(Failure::input("--onto goes with one take that is not drawn anew: leave out --live and other takes"))
        }
        _ => Ok(()),
    }
}

impl Opened {
    /// Reads the takes that the arguments name.
    pub(super) fn new(args: &Page) -> Result<Self, Failure> {
        let paths: Vec<_> = args.input.iter().chain(&args.more).cloned().collect();
        let takes = paths.iter().map(|path| score::open(path)).collect::<Result<Vec<_>, _>>()?;
        let heard = |take: &Take| (take.info().audio, take.info().samples, take.info().frames);
        if let Some(other) = takes.iter().position(|take| heard(take) != heard(&takes[0])) {
            let (other, first) = (paths[other].display(), paths[0].display());
            return Err(Failure::input(format!(
                "{other}: of another recording than {first}: they cannot stand side by side"
            )));
        }
        let model = model::load(&args.compute)?;
        let session = play::session(&model, &args.generate.gesture_clip, &args.words.rules)?;
        Ok(Self { paths, takes, model, session, team: model::team(&args.compute)? })
    }

    /// Instruction set and team for the products.
    pub(super) fn compute(&self) -> Compute<'_> {
        Compute { isa: self.model.isa(), team: &self.team }
    }

    /// Returns the frames of a take.
    pub(super) fn clip(&self, number: usize) -> Result<Clip, Failure> {
        play::frames(&self.paths[number], &self.takes[number], &self.model, &self.session)
    }

    /// Returns the page's contents; `kept` is the file that a served page keeps a take in.
    pub(super) fn scene(&self, args: &Page, kept: Option<&Path>) -> Result<Scene, Failure> {
        let info = self.takes[0].info();
        scene::check_length(&self.paths[0], f64::from(info.frames) / f64::from(info.frame_rate))?;
        let figure = args.shown.figure.unwrap_or_default();
        let mut scene = match self.takes.len() {
            1 => Scene::worn_by(&self.paths[0], self.clip(0)?, scene::wearer(&args.shown)?, figure)?,
            _ => Scene::of_room(&self.paths[0], self.room()?, &[figure])?,
        };
        scene.title = self.paths.iter().map(|path| name(path)).collect::<Vec<_>>().join(", ");
        scene.set_model(self.model.config(), self.takes[0].avatar());
        if let Some(audio) = args.audio.first() {
            scene.audio = Some(Audio::new(&Speech::open(audio, args.repair)?)?);
        }
        scene.takes = Some(Takes {
            stem: stem(&self.paths[0]),
            audio: args.audio.first().map(|path| name(path)),
            kept: kept.map(name),
            score: if self.takes.len() == 1 { Some(self.score()?) } else { None },
            files: self.takes.clone(),
        });
        Ok(scene)
    }

    /// Returns the takes in a row, from left to right.
    fn room(&self) -> Result<Vec<RoomMember>, Failure> {
        let middle = 0.5 * (self.takes.len() - 1) as f32;
        let member = |number: usize| {
            let place = Place { position: [APART * (number as f32 - middle), 0.0, 0.0], ..Place::default() };
            let audio = Audio { sample_rate: 8000, samples: Vec::new() };
            let is_name = self.paths.iter().filter(|path| stem(path) == stem(&self.paths[number])).count() == 1;
            let path = &self.paths[number];
            let name = if is_name { stem(path) } else { path.display().to_string() };
            Ok(RoomMember { name, place, figure: 0, clip: self.clip(number)?, audio })
        };
        (0..self.takes.len()).map(member).collect()
    }

    /// Score of a single take.
    fn score(&self) -> Result<Score, Failure> {
        let take = &self.takes[0];
        let lines = score::lines(take, &self.model, self.compute(), &self.paths[0])?;
        Ok(Score {
            seconds: score::seconds(take),
            events: lines.iter().map(event).collect::<Result<_, _>>()?,
            hands: take.phases(&self.model).is_some(),
            gestures: self.session.gestures.names().map(str::to_owned).collect(),
            moods: Mood::ALL.map(Mood::name).to_vec(),
            attentions: Attention::ALL.map(|attention| format!("{attention:?}").to_lowercase()).to_vec(),
            layers: Layer::ALL.map(Layer::name).to_vec(),
            lips: LipShape::ALL.map(LipShape::name).to_vec(),
        })
    }
}

fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

fn stem(path: &Path) -> String {
    path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// The event of a line as the page has it, by the keys of its text.
fn event(line: &Line) -> Result<Value, Failure> {
    let event: BTreeMap<String, Value> =
        toml::from_str(&format!("event = {}", line.text())).map_err(Failure::environment)?;
    event.into_values().next().ok_or_else(|| Failure::environment("internal: a line without an event"))
}
