//! `umo text`: a description to an animation.

use crate::animate::Job;
use crate::args::Text;
use crate::failure::Failure;

/// Longest animation: an hour.
const MAX_SECONDS: f64 = 3600.0;

/// Animates a description.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against MAX_SECONDS")]
pub(crate) fn run(args: &Text) -> Result<(), Failure> {
    if !(args.seconds > 0.0 && args.seconds <= MAX_SECONDS) {
        return Err(Failure::input(format!("--seconds {}: expected more than 0, at most {MAX_SECONDS}", args.seconds)));
    }
    let job = Job::new(&args.output)?;
    let frames = (args.seconds * job.maker.model.config().frame_rate as f64).floor().max(1.0) as usize;
    let mut animation = job.maker.animation("text_to_motion", Some(&args.text))?;
    animation.finish(frames);
    job.finish(&mut animation, frames)
}
