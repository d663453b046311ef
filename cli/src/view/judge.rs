//! `umo view --judge`: a page that plays a motion with its own speech and with another's, and counts how often a person
//! finds its own. The takes are cut into pieces of equal length.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use umo_core_pose::clip::Clip;

use super::is_animation;
use super::scene::{Audio, JudgeInfo, JudgeTake, MAX_RATE, Scene, check_length};
use crate::animate::Generator;
use crate::args::Page;
use crate::failure::Failure;
use crate::speech::Speech;
use crate::words::Script;
use crate::{import, model};

/// Length of a piece.
const SECONDS: usize = 8;

/// A recording, and the animation that it belongs to if it is not to be animated.
struct Take {
    motion: Option<PathBuf>,
    path: PathBuf,
    speech: Speech,
}

/// Returns the contents of the page.
pub(super) fn scene(args: &Page) -> Result<Scene, Failure> {
    let takes = args.judge.iter().map(|given| Take::open(given, args.repair)).collect::<Result<Vec<_>, _>>()?;
    check(&takes)?;
    let needs_model = takes.iter().any(|take| take.motion.is_none());
    let load = || Generator::new(&args.generate, &args.compute, model::open(args.compute.model.as_deref())?);
    let generator = needs_model.then(load).transpose()?;
    let clips = takes.iter().map(|take| take.clip(generator.as_ref())).collect::<Result<Vec<_>, _>>()?;
    let (info, clip) = cut(&takes, &clips)?;
    let rate = takes.iter().map(|take| take.speech.sample_rate()).max().unwrap_or_default().min(MAX_RATE);
    let mut samples = Vec::new();
    for (take, part) in takes.iter().zip(&info.takes) {
        let mut mono = take.speech.mono(rate)?;
        mono.resize(part.pieces * SECONDS * rate, 0.0);
        samples.append(&mut mono);
    }
    let mut scene = Scene::new(Path::new("Find the speech"), clip, args.shown.figure.unwrap_or_default())?;
    scene.audio = Some(Audio::of(rate, &samples));
    scene.judge = Some(info);
    if let Some(generator) = generator {
        scene.set_model(generator.model.config(), &generator.avatar());
    }
    Ok(scene)
}

impl Take {
    /// Reads what the user named: `RECORDING` or `ANIMATION=RECORDING`.
    fn open(given: &Path, repair: bool) -> Result<Self, Failure> {
        let pair = given.to_str().and_then(|text| text.split_once('='));
        let pair = pair.map(|(motion, speech)| (Path::new(motion), Path::new(speech)));
        let (motion, path) = match pair.filter(|(motion, _)| is_animation(motion)) {
            Some((motion, speech)) => (Some(motion), speech),
            None if is_animation(given) => {
                let name = given.display();
                return Err(Failure::input(format!("{name}: an animation needs its speech: {name}=SPEECH.wav")));
            }
            None => (None, given),
        };
        let speech = Speech::open(path, repair)?;
        check_pieces(path, speech.seconds())?;
        Ok(Self { motion: motion.map(Path::to_owned), path: path.to_owned(), speech })
    }

    /// Reads or makes the motion.
    fn clip(&self, generator: Option<&Generator>) -> Result<Clip, Failure> {
        match (&self.motion, generator) {
            (Some(path), _) => {
                let clip = import::read(path)?;
                check_pieces(path, clip.len() as f64 / f64::from(clip.frame_rate))?;
                Ok(clip)
            }
            (None, Some(generator)) => {
                let mut animation = generator.animation("audio_to_motion", None)?;
                let frames = generator.hear(&mut animation, &self.speech)?;
                generator.clip(&mut animation, frames, Script::default(), |_| ())
            }
            (None, None) => Err(Failure::environment("internal: a recording without a model")),
        }
    }
}

/// Refuses takes that would not make a test.
fn check(takes: &[Take]) -> Result<(), Failure> {
    if takes.len() < 2 {
        return Err(Failure::input(format!(
            "--judge needs the speech of others: give two recordings or more, of {SECONDS} s or more each"
        )));
    }
    let mut seen = HashSet::new();
    if let Some(again) = takes.iter().find(|take| !seen.insert(&take.path)) {
        let problem = "it is given twice: every motion needs the speech of others to be held against";
        return Err(Failure::input(format!("{}: {problem}", again.path.display())));
    }
    check_length(Path::new("--judge"), takes.iter().map(|take| take.speech.seconds()).sum())
}

/// Refuses a take that is too short for one piece.
fn check_pieces(path: &Path, seconds: f64) -> Result<(), Failure> {
    if seconds >= SECONDS as f64 {
        return Ok(());
    }
    let problem = format!("{seconds:.1} s are too short: --judge shows pieces of {SECONDS} s; join recordings");
    Err(Failure::input(format!("{}: {problem}", path.display())))
}

/// Cuts the motions into pieces, and joins these.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lengths that were checked")]
fn cut(takes: &[Take], clips: &[Clip]) -> Result<(JudgeInfo, Clip), Failure> {
    let first = &clips[0];
    let rate = f64::from(first.frame_rate);
    let frames = (SECONDS as f64 * rate) as usize;
    let mut joined = Clip::new(first.frame_rate, first.skeleton.clone(), first.face.clone());
    let mut parts = Vec::new();
    for (take, clip) in takes.iter().zip(clips) {
        let name = take.path.display().to_string();
        if clip.frame_rate != first.frame_rate || clip.face != first.face {
            let problem = "its motion has another frame rate or other face channels than the first's: give it a page \
                of its own";
            return Err(Failure::input(format!("{name}: {problem}")));
        }
        let seconds = take.speech.seconds().min(clip.len() as f64 / rate);
        let pieces = (seconds / SECONDS as f64) as usize;
        for piece in 0..pieces {
            let start = ((piece * SECONDS) as f64 * rate).round() as usize;
            (start..start + frames).for_each(|frame| joined.push(&clip.pose(frame), clip.face(frame)));
        }
        parts.push(JudgeTake { name, pieces });
    }
    Ok((JudgeInfo { seconds: SECONDS, frames, takes: parts }, joined))
}
