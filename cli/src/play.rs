//! `umo play`: the frames of a take.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use umo_core::{Model, Session, SessionConfig, SessionError, Take};
use umo_core_pose::clip::Clip;

use crate::animate::Outputs;
use crate::args::{GestureClip, Play, RuleArgs};
use crate::failure::Failure;
use crate::{gestures, model, score, words};

/// Plays a take into files.
pub(crate) fn run(args: &Play) -> Result<(), Failure> {
    let take = score::open(&args.take)?;
    let model = model::load(&args.compute)?;
    let outputs = Outputs::open(&args.files, &model.config().face, false)?;
    let config = session(&model, &args.gesture_clip, &args.rules)?;
    show(&model, (&args.take, &take), outputs, &config)
}

/// Returns the configuration of a session that plays takes with the host's gestures and word rules.
pub(crate) fn session(model: &Model, clips: &[GestureClip], rules: &RuleArgs) -> Result<SessionConfig, Failure> {
    Ok(SessionConfig {
        gestures: gestures::known(clips, &model.config().skeleton)?,
        words: words::rules(rules)?,
        ..SessionConfig::new(model.config())
    })
}

/// Plays a take into `outputs`; `path` is for messages.
pub(crate) fn show(
    model: &Arc<Model>,
    (path, take): (&Path, &Take),
    outputs: Outputs,
    config: &SessionConfig,
) -> Result<(), Failure> {
    let start = Instant::now();
    let clip = frames(path, take, model, config)?;
    let (frames, took) = (clip.len(), start.elapsed().as_secs_f64());
    let seconds = frames as f64 / f64::from(take.info().frame_rate);
    let names = outputs.write(&clip, Some(take), None)?;
    println!("{names}: {frames} frames, {seconds:.2} s, played in {took:.2} s");
    Ok(())
}

/// Returns the frames of a take; errors name its file, `path`.
pub(crate) fn frames(path: &Path, take: &Take, model: &Arc<Model>, config: &SessionConfig) -> Result<Clip, Failure> {
    if take.has_words() && take.info().rules != config.words.fingerprint() {
        eprintln!("note: other word rules than the take's: its words may be gestured otherwise (--language, --rules)");
    }
    let wrong = |problem| Failure::Input(format!("{}: {problem}", path.display()));
    let session = Session::of_take(model, take, config).map_err(wrong)?;
    let mut clip = model.config().clip();
    let failed = |error: SessionError| Failure::environment(error);
    while !session.is_done().map_err(failed)? {
        session.push_take().map_err(failed)?;
        session.pull_frames(usize::MAX, |frame| clip.push(frame.pose, frame.face)).map_err(failed)?;
    }
    Ok(clip)
}
