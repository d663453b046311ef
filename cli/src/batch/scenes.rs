//! The conversations of a batch: lines with the same `scene`, animated together.

use std::collections::HashMap;
use std::sync::mpsc::SyncSender;
use std::time::Instant;

use umo_core::{Place, WordRules};
use umo_core_pose::clip::Clip;

use super::manifest::{Line, scenes};
use super::results::Done;
use super::{Made, Settings};
use crate::animate::Generator;
use crate::args::Batch;
use crate::converse::place::half_circle;
use crate::converse::{self, Member, Voice};
use crate::failure::Failure;
use crate::model;
use crate::speech::Speech;

/// Animates every conversation that is not done, one after the other.
pub(super) fn compute(
    args: &Batch,
    generator: &Generator,
    lines: &[Line],
    settings: Settings,
    before: &HashMap<String, Done>,
    (made, say): (&SyncSender<Made>, &SyncSender<Done>),
) {
    for scene in scenes(lines) {
        let start = Instant::now();
        let wrong = |key: &str, line: &Line, failure: &Failure| say.send(Done::failed(line, key, failure)).is_ok();
        let keys = match keys(&scene, settings.text) {
            Ok(keys) => keys,
            Err(failure) if scene.iter().all(|line| wrong("", line, &failure)) => continue,
            Err(_) => return,
        };
        let kept: Option<Vec<Done>> = scene
            .iter()
            .zip(&keys)
            .map(|(line, key)| Some(before.get(key).filter(|done| !args.again && done.is_there(line))?.kept(line)))
            .collect();
        let sent = match kept {
            Some(kept) => kept.into_iter().all(|done| say.send(done).is_ok()),
            None => match animate(args, generator, &scene, settings.rules) {
                Ok(clips) => scene.iter().zip(&keys).zip(clips).all(|((line, key), clip)| {
                    let line = (*line).clone();
                    made.send(Made { line, key: key.clone(), motion: Ok((clip, None)), took: start.elapsed() }).is_ok()
                }),
                Err(failure) => scene.iter().zip(&keys).all(|(line, key)| wrong(key, line, &failure)),
            },
        };
        if !sent {
            return;
        }
    }
}

/// Keys of the lines: every member's frames depend on all.
fn keys(scene: &[&Line], settings: &str) -> Result<Vec<String>, Failure> {
    let own = scene.iter().map(|line| line.key(&format!("{settings} {:?}", line.place)));
    let all = own.collect::<Result<Vec<_>, _>>()?.join(" ");
    scene.iter().enumerate().map(|(index, line)| line.key(&format!("{index} {all}"))).collect()
}

fn animate(args: &Batch, generator: &Generator, scene: &[&Line], rules: &WordRules) -> Result<Vec<Clip>, Failure> {
    let places = half_circle(scene.len());
    let member = |(line, (index, place))| member(args, line, index, place, rules);
    let mut members: Vec<Member> =
        scene.iter().copied().zip(places.into_iter().enumerate()).map(member).collect::<Result<_, _>>()?;
    converse::perform(&generator.model, model::threads(&args.compute)?, &args.generate, &mut members, |_| ())
}

fn member(args: &Batch, line: &Line, index: usize, place: Place, rules: &WordRules) -> Result<Member, Failure> {
    let voice = Voice::Recording(Box::new(Speech::open(&line.file, args.repair)?));
    let script = line.words.as_deref().map(|path| voice.script(path, rules)).transpose()?;
    let seed = line.seed.unwrap_or(args.generate.seed.wrapping_add(index as u64));
    let member = Member::new(voice, line.place.unwrap_or(place), seed);
    let words = script.map(|script| (script, rules.clone()));
    Ok(Member { prompt: line.prompt.clone(), mood: line.mood, words, ..member })
}
