//! `umo batch`: animates many recordings with one model, computed together. Finished lines are recognised by content.
//!
//! ```text
//! manifest ─► reader: decode, resample ─► group of --jobs lines ─► writer: files, hashes ─► results
//! ```
//! | module | part |
//! |---|---|
//! | `manifest` | the lines to process: a folder, CSV, JSON lines |
//! | `scenes` | lines that are one conversation |
//! | `results` | finished lines, with hashes |
//! | `scores` | changes of takes, kept when a line is made anew |

mod hash;
mod manifest;
mod results;
mod scenes;
mod scores;

use std::collections::HashMap;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::{Duration, Instant};

use umo_core::{Animation, Event, Model, ModelFile, Take, Team, WordRules};
use umo_core_pose::clip::Clip;
use umo_core_stream::animation::Group;
use umo_gltf::keys::{Keying, Marker, MarkerKind};

use crate::animate::{self, Generator, is_take};
use crate::args::Batch;
use crate::export::{self, ExportError, Format};
use crate::failure::Failure;
use crate::speech::Speech;
use crate::strokes::Strokes;
use crate::words::{self, Script};
use crate::{atomic_file, model, progress, score};
use manifest::Line;
use results::{Done, Results};
use scores::Scored;

/// Animates every line and reports the number of failures.
pub(crate) fn run(args: &Batch) -> Result<(), Failure> {
    let start = Instant::now();
    let lines = manifest::read(args)?;
    let lines: Vec<Line> = match args.shard {
        Some((index, count)) => of_shard(lines, index - 1, count),
        None => lines,
    };
    let rules = words::rules(&args.rules)?;
    let file: ModelFile = model::open(args.compute.model.as_deref())?;
    for path in lines.iter().flat_map(|line| &line.outputs).filter(|path| !is_take(path)) {
        let format = Format::from_extension(path)?;
        format.check_face(&file.config().face)?;
        if args.reduce.is_some() && !format.is_keyed() {
            return Err(ExportError::NoKeys(format).into());
        }
    }
    let mut generator = Generator::new(&args.generate, &args.compute, file)?;
    generator.records = args.reduce.is_some() || lines.iter().any(|line| line.take().is_some());
    let mut results = Results::open(args.results_path())?;
    let (before, settings) = (results.known(), settings(args, &generator, &rules));
    let mut bar = progress::lines(lines.len());
    let (mut failed, mut kept, mut frames) = (0, 0, 0);
    std::thread::scope(|scope| -> Result<(), Failure> {
        // A full group of lines is kept ready, so that no slot in the group stays empty.
        let (read, ready) = sync_channel(args.jobs);
        let (made, to_write) = sync_channel(args.jobs);
        let (say, said) = sync_channel(args.jobs);
        let (before, also_say, scenes_say) = (&before, say.clone(), say.clone());
        let (generator, lines, settings) = (&generator, &lines, Settings { text: &settings, rules: &rules });
        scope.spawn(move || read_lines(args, generator, lines, settings, before, &read, &also_say));
        scope.spawn(move || write_lines(args, generator, settings.rules, &to_write, &say));
        let computing = scope.spawn(move || {
            compute(args, generator, &ready, &made)?;
            scenes::compute(args, generator, lines, settings, before, (&made, &scenes_say));
            Ok(())
        });
        // Ends when the reader, the writer and the group are done.
        for done in said {
            match &done.error {
                Some(error) => {
                    failed += 1;
                    bar.suspend(|| eprintln!("error: {}: {error}", done.file));
                }
                None if done.is_kept => kept += 1,
                None => frames += done.frames,
            }
            if !done.edits.is_empty() {
                bar.suspend(|| done.notes().for_each(|note| eprintln!("note: {note}")));
            }
            results.add(done)?;
            bar.advance();
        }
        computing.join().unwrap_or_else(|_| Err(Failure::environment("internal: the computation panicked")))
    })?;
    bar.finish();
    results.finish(&lines)?;
    let (took, rate) = (start.elapsed().as_secs_f64(), generator.model.config().frame_rate);
    println!(
        "{}: {} made, {kept} kept, {failed} failed; {frames} frames, {:.1} s of motion in {took:.1} s",
        args.results_path().display(),
        lines.len() - kept - failed,
        frames as f64 / rate as f64
    );
    match failed {
        0 => Ok(()),
        _ => Err(Failure::Input(format!("{failed} of {} lines failed, the rest is done", lines.len()))),
    }
}

/// Returns the lines of one of `count` shards: every n-th, and a conversation with its first line.
fn of_shard(lines: Vec<Line>, index: usize, count: usize) -> Vec<Line> {
    let mut homes = HashMap::new();
    for line in lines.iter().rev() {
        homes.insert(line.scene.clone(), line.number);
    }
    let home = |line: &Line| if line.scene.is_some() { homes[&line.scene] } else { line.number };
    lines.into_iter().filter(|line| home(line) % count == index).collect()
}

/// Everything outside the lines that their frames and files depend on.
#[derive(Clone, Copy)]
struct Settings<'a> {
    text: &'a str,
    rules: &'a WordRules,
}

/// Returns every setting outside the line that its frames and files depend on.
fn settings(args: &Batch, generator: &Generator, rules: &WordRules) -> String {
    let config = generator.avatar();
    format!(
        "{} {:016x} {} {:?} {} {} {} {} {} {:?} {:?} {:?} {:?} {} {:?} {} {} {:?}",
        env!("CARGO_PKG_VERSION"),
        generator.model.fingerprint(),
        generator.model.isa().name(),
        config.sampler,
        config.target,
        config.lookahead,
        config.horizon,
        config.guidance,
        config.smoothing,
        animate::layers(&args.generate),
        args.generate.gesture,
        args.generate.gesture_clip,
        args.generate.start_pose,
        args.figure.name(),
        args.repair,
        args.retime,
        rules.fingerprint(),
        args.reduce
    )
}

/// A line that is ready to be computed.
struct Ready {
    line: Line,
    key: String,
    animation: Animation,
    frames: usize,
    script: Script,
}

/// The outcome of a computed line: its clip and its take, if one is wanted; or the error.
struct Made {
    line: Line,
    key: String,
    motion: Result<(Clip, Option<Take>), Failure>,
    took: Duration,
}

/// Prepares every line that is not done and belongs to no conversation.
fn read_lines(
    args: &Batch,
    generator: &Generator,
    lines: &[Line],
    settings: Settings,
    before: &HashMap<String, Done>,
    ready: &SyncSender<Ready>,
    say: &SyncSender<Done>,
) {
    for line in lines.iter().filter(|line| line.scene.is_none()) {
        let wrong = |key: &str, failure: &Failure| say.send(Done::failed(line, key, failure)).is_ok();
        let key = match line.key(settings.text) {
            Ok(key) => key,
            Err(failure) if wrong("", &failure) => continue,
            Err(_) => return,
        };
        if let Some(done) = before.get(&key)
            && !args.again
            && done.is_there(line)
        {
            if say.send(done.kept(line)).is_err() {
                return;
            }
            continue;
        }
        let sent = match prepare(args, generator, settings.rules, line) {
            Ok((animation, frames, script)) => {
                ready.send(Ready { line: line.clone(), key, animation, frames, script }).is_ok()
            }
            Err(failure) => wrong(&key, &failure),
        };
        if !sent {
            return;
        }
    }
}

/// Returns the animation of a line with its audio attached, its length in frames, and its words.
fn prepare(
    args: &Batch,
    generator: &Generator,
    rules: &WordRules,
    line: &Line,
) -> Result<(Animation, usize, Script), Failure> {
    let speech = Speech::open(&line.file, args.repair)?;
    let team = Team::new(1).map_err(Failure::environment)?;
    let start_pose = line.start_pose.as_deref().or(args.generate.start_pose.as_deref());
    let (seed, prompt) = (line.seed.unwrap_or(args.generate.seed), line.prompt.as_deref());
    let mut animation = generator.animation_with(&team, "audio_to_motion", prompt, seed, start_pose)?;
    if let Some((mood, strength)) = line.mood {
        animation.set_mood(mood, strength).map_err(Failure::input)?;
    }
    if args.retime {
        animation.retime(&generator.model)?;
    }
    let mut script = Script::default();
    if let Some(path) = &line.words {
        script = Script::read(path, rules, speech.seconds(), |rate| speech.mono(rate))?;
        animation.set_word_rules(rules.clone())?;
    }
    let frames = generator.hear(&mut animation, &speech)?;
    Ok((animation, frames, script))
}

/// A line in the group.
struct Place {
    line: Line,
    key: String,
    clip: Clip,
    frames: usize,
    script: Script,
    start: Instant,
}

/// Computes lines together, as a full group while enough lines remain.
fn compute(
    args: &Batch,
    generator: &Generator,
    ready: &Receiver<Ready>,
    made: &SyncSender<Made>,
) -> Result<(), Failure> {
    let (model, cx) = (&generator.model, generator.compute());
    let mut group = Group::new(model, args.jobs);
    let mut places: Vec<Place> = Vec::new();
    let mut is_over = false;
    let leave = |group: &mut Group, places: &mut Vec<Place>, index: usize, failure: Option<Failure>| {
        let take = group.take(index);
        group.remove(index);
        let Place { line, key, clip, frames, start, .. } = places.swap_remove(index);
        let is_whole = clip.len() == frames;
        let motion = match failure {
            Some(failure) => Err(failure),
            None if is_whole => Ok((clip, take)),
            None => Err(Failure::environment("internal: the animation ended early")),
        };
        made.send(Made { line, key, motion, took: start.elapsed() }).map_err(|_| Failure::environment("no writer"))
    };
    loop {
        while !group.is_full() && !is_over {
            match ready.recv() {
                Ok(Ready { line, key, animation, frames, script }) => {
                    group.add(animation);
                    let clip = model.config().clip();
                    places.push(Place { line, key, clip, frames, script, start: Instant::now() });
                }
                Err(_) => is_over = true,
            }
        }
        if group.is_empty() {
            return Ok(());
        }
        for index in (0..group.len()).rev() {
            let given = places[index].script.give(|text, start, end| group.hint_words(index, text, start, end));
            if let Err(failure) = given {
                leave(&mut group, &mut places, index, Some(failure))?;
            }
        }
        let stepped = group.step(model, cx, &mut |index, frame| places[index].clip.push(frame.pose, frame.face));
        match stepped {
            // In reverse order, so that the remaining indices stay valid.
            Ok(failed) => {
                for (index, error) in failed.into_iter().rev() {
                    leave(&mut group, &mut places, index, Some(error.into()))?;
                }
            }
            Err(error) => {
                for index in (0..group.len()).rev() {
                    leave(&mut group, &mut places, index, Some(error.into()))?;
                }
            }
        }
        for index in (0..group.len()).rev() {
            if group.is_done(model, index) {
                // A take has them all, as that of `umo animate`.
                let given = places[index].script.give(|text, start, end| group.hint_words(index, text, start, end));
                leave(&mut group, &mut places, index, given.err())?;
            }
        }
    }
}

/// Writes the files of every computed line.
fn write_lines(args: &Batch, generator: &Generator, rules: &WordRules, made: &Receiver<Made>, say: &SyncSender<Done>) {
    let (model, rate) = (&generator.model, generator.model.config().frame_rate);
    let mut figure = export::FigureCache::from(args.figure);
    for Made { line, key, motion, took } in made {
        let written = motion.and_then(|(clip, take)| {
            let scored = take.as_ref().map(|take| scores::apply(args, generator, rules, &line, take)).transpose()?;
            let Some(Scored { take, clip, text, report }) = scored.flatten() else {
                write(args, model, &line.outputs, (&clip, take.as_ref()), &mut figure)?;
                return Done::made(&line, &key, (clip.len(), rate), took, Vec::new());
            };
            write(args, model, &line.outputs, (&clip, Some(&take)), &mut figure)?;
            if let (Some(path), Some(text)) = (line.score(), text) {
                atomic_file::commit(atomic_file::create(&path)?, |out| out.write_all(text.as_bytes()))?;
            }
            Done::made(&line, &key, (clip.len(), rate), took, report)
        });
        let done = written.unwrap_or_else(|failure| Done::failed(&line, &key, &failure));
        if say.send(done).is_err() {
            return;
        }
    }
}

/// Keys and markers of a line's files, if there are to be few.
fn keying(args: &Batch, model: &Model, take: Option<&Take>) -> Option<Keying> {
    let (bound, take) = args.reduce.zip(take)?;
    let word = |(_, event): (u64, Event)| match event {
        Event::Words { text, start, .. } => {
            Some(Marker { seconds: start, kind: MarkerKind::Word, name: text.trim().to_owned() })
        }
        _ => None,
    };
    let mut markers: Vec<Marker> = take.events().filter_map(word).collect();
    markers.extend(Strokes::of(model.config(), &take.phases(model).unwrap_or_default()));
    markers.retain(|marker| marker.seconds < score::seconds(take));
    markers.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
    Some(Keying { bound, markers })
}

fn write(
    args: &Batch,
    model: &Model,
    outputs: &[PathBuf],
    (clip, take): (&Clip, Option<&Take>),
    figure: &mut export::FigureCache,
) -> Result<(), Failure> {
    let keying = keying(args, model, take);
    for path in outputs {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        std::fs::create_dir_all(folder)
            .map_err(|cause| Failure::environment(format!("cannot make `{}`: {cause}", folder.display())))?;
        if is_take(path) {
            let take = take.ok_or_else(|| Failure::environment("internal: nothing was recorded"))?;
            atomic_file::commit(atomic_file::create(path)?, |out| out.write_all(take.bytes()))?;
            continue;
        }
        let output = export::Output::create(path, Format::from_extension(path)?)?;
        output.write_as(clip, figure, keying.as_ref()).map_err(Failure::environment)?;
    }
    Ok(())
}
