//! Scores of a batch: a line follows its score, also when it is made anew.

use std::path::Path;

use umo_core::{Compute, Gestures, SessionConfig, Take, Team, WordRules};
use umo_core_pose::clip::Clip;

use super::manifest::Line;
use crate::animate::Generator;
use crate::args::Batch;
use crate::failure::Failure;
use crate::score::{self, Drawer, Own, Score};
use crate::speech::Speech;
use crate::{gestures, play};

/// A take as its score wants it.
pub(super) struct Scored {
    pub(super) take: Take,
    pub(super) clip: Clip,
    /// The score's text, if it changed.
    pub(super) text: Option<String>,
    /// Outcome of each change.
    pub(super) report: Vec<String>,
}

/// Applies the score beside a line's take, if there is one, to the take that was made for it.
pub(super) fn apply(
    args: &Batch,
    generator: &Generator,
    rules: &WordRules,
    line: &Line,
    made: &Take,
) -> Result<Option<Scored>, Failure> {
    let (Some(path), Some(score)) = (line.take(), line.score()) else { return Ok(None) };
    let (model, team) = (&generator.model, Team::new(1).map_err(Failure::environment)?);
    let cx = Compute { isa: model.isa(), team: &team };
    let gestures = gestures::known(&args.generate.gesture_clip, &model.config().skeleton)?;
    let mut score = Score::open(&score)?;
    let mut scored = (None, Vec::new());
    if let Some(before) = before(path)?.filter(|before| before.bytes() != made.bytes()) {
        let (lines, report) = carried(generator, cx, &gestures, path, (&before, made), &score)?;
        let text = score::text(&lines, score::seconds(made));
        score = Score::parse(&score.path, &text)?;
        scored = (Some(text), report);
    }
    let speech = Speech::open(&line.file, args.repair)?;
    let drawer = Drawer { model, cx, path, speech: &speech };
    let take = drawer.draw(made, Some(&score), None, 0, &gestures)?;
    let config = SessionConfig { gestures, words: rules.clone(), ..SessionConfig::new(model.config()) };
    let clip = play::frames(path, &take, model, &config)?;
    let (text, report) = scored;
    Ok(Some(Scored { take, clip, text, report }))
}

/// The take that was there before, without the changes of its score.
fn before(path: &Path) -> Result<Option<Take>, Failure> {
    Ok(if path.exists() { Some(score::open(path)?.unedited()) } else { None })
}

/// The lines of a score on a motion that was made anew.
fn carried(
    generator: &Generator,
    cx: Compute,
    gestures: &Gestures,
    path: &Path,
    (before, made): (&Take, &Take),
    score: &Score,
) -> Result<(Vec<score::Line>, Vec<String>), Failure> {
    let model = &generator.model;
    let mut changed: Vec<_> = score.lines.iter().map(|(_, line)| line.clone()).collect();
    let (new, mut notes) = (score::lines(made, model, cx, path)?, Vec::new());
    let old = if before.info().model == model.fingerprint() {
        score::lines(before, model, cx, path)?
    } else {
        changed.retain(|line| !matches!(line.kind, score::Kind::Hands(..)));
        notes.push("hands: dropped: another model made the old take, so that its own are not known".to_owned());
        score::requests(before)
    };
    let check = |lines: &[score::Line]| score::check(made, model, &new, lines, gestures);
    let (old, new) =
        (Own { lines: &old, seconds: score::seconds(before) }, Own { lines: &new, seconds: score::seconds(made) });
    let step = model.config().keyframe_stride as f64 / model.config().frame_rate as f64;
    let (lines, report) = score::carry(old, &changed, (new, step), check);
    notes.extend(report);
    Ok((lines, notes))
}
