//! `umo play`: the frames of a take.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use umo_core::{Gestures, Model, Session, SessionConfig, SessionError, Take, WordRules};
use umo_core_pose::clip::Clip;

use crate::animate::Outputs;
use crate::args::Play;
use crate::failure::Failure;
use crate::{gestures, model, words};

/// Plays a take into files.
pub(crate) fn run(args: &Play) -> Result<(), Failure> {
    let wrong = |problem: String| Failure::Input(format!("{}: {problem}", args.take.display()));
    let bytes = umo_core_base::file::read(&args.take).map_err(|error| wrong(error.to_string()))?;
    let take = Take::new(&bytes).map_err(|error| wrong(error.to_string()))?;
    let model = model::load(&args.compute)?;
    let outputs = Outputs::open(&args.files, &model.config().face, false)?;
    let gestures = gestures::known(&args.gesture_clip, &model.config().skeleton)?;
    show(&model, (&args.take, &take), outputs, (gestures, words::rules(&args.rules)?))
}

/// The frames of a take; `path` is for messages.
pub(crate) fn clip(
    model: &Arc<Model>,
    (path, take): (&Path, &Take),
    (gestures, words): (Gestures, WordRules),
) -> Result<Clip, Failure> {
    let config = SessionConfig { gestures, words, ..SessionConfig::new(model.config()) };
    let wrong = |problem| Failure::Input(format!("{}: {problem}", path.display()));
    let session = Session::of_take(model, take, &config).map_err(wrong)?;
    let mut clip = model.config().clip();
    let failed = |error: SessionError| Failure::environment(error);
    while !session.is_done().map_err(failed)? {
        session.push_take().map_err(failed)?;
        session.pull_frames(usize::MAX, |frame| clip.push(frame.pose, frame.face)).map_err(failed)?;
    }
    Ok(clip)
}

/// Plays a take into `outputs`.
pub(crate) fn show(
    model: &Arc<Model>,
    (path, take): (&Path, &Take),
    outputs: Outputs,
    (gestures, words): (Gestures, WordRules),
) -> Result<(), Failure> {
    if take.has_words() && take.info().rules != words.fingerprint() {
        eprintln!("note: other word rules than the take's: its words may be gestured otherwise (--language, --rules)");
    }
    let start = Instant::now();
    let clip = clip(model, (path, take), (gestures, words))?;
    let (frames, took) = (clip.len(), start.elapsed().as_secs_f64());
    let seconds = frames as f64 / f64::from(take.info().frame_rate);
    let names = outputs.write(&clip, Some(take), None)?;
    println!("{names}: {frames} frames, {seconds:.2} s, played in {took:.2} s");
    Ok(())
}
