//! `umo text`: animates a description, by the model or by the table of gestures.

use umo_core::{Animation, Config, GestureOptions, Gestures};
use umo_core_model::lm::layout::Template;

use crate::animate::{Job, TEXT};
use crate::args::Text;
use crate::failure::Failure;
use crate::gestures;
use crate::words::Script;

/// Upper bound on the length: an hour.
const MAX_SECONDS: f64 = 3600.0;
/// Seconds of the model's own motion before a gesture begins.
const BEFORE: f64 = 0.3;

/// Animates a description.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against MAX_SECONDS")]
pub(crate) fn run(args: &Text) -> Result<(), Failure> {
    if !(args.seconds > 0.0 && args.seconds <= MAX_SECONDS) {
        return Err(Failure::input(format!("--seconds {}: expected more than 0, at most {MAX_SECONDS}", args.seconds)));
    }
    let job = Job::new(&args.output)?;
    let config = job.generator.model.config();
    let frames = (args.seconds * config.frame_rate as f64).floor().max(1.0) as usize;
    let gestures = Gestures::new();
    let mut animation = match action(config, job.generator.model.text().is_some(), &gestures, &args.text)? {
        Action::Prompt => job.generator.animation(TEXT, Some(&args.text))?,
        Action::Gesture(name) => {
            eprintln!("note: the gesture `{name}`; the model has no prompt for it");
            let mut animation = quiet(&job, frames)?;
            // In a short animation the lead is shorter, so that the whole gesture fits.
            let least = gestures.stroke(name).unwrap_or_default();
            let options = GestureOptions::default().at(least + BEFORE.min(0.25 * args.seconds));
            gestures::play(&mut animation, &gestures, name, &options)?;
            animation
        }
    };
    animation.finish(frames);
    job.finish(&mut animation, frames, Script::default())
}

/// The source of the motion for a text.
#[derive(Debug, PartialEq, Eq)]
enum Action<'a> {
    /// The model.
    Prompt,
    /// The table of gestures, by this name.
    Gesture(&'a str),
}

/// Returns the source of the motion for a text: the model's own prompts come first, then the gestures.
fn action<'a>(config: &Config, has_text: bool, gestures: &'a Gestures, text: &str) -> Result<Action<'a>, Failure> {
    let takes_text = has_text && Template::new(config, TEXT).is_ok_and(|template| template.has_text());
    let strange = config.unknown_prompt(text);
    if takes_text && strange.is_none() {
        return Ok(Action::Prompt);
    }
    if let Some(name) = gestures.in_text(text) {
        return Ok(Action::Gesture(name));
    }
    let prompts = strange.filter(|_| takes_text).unwrap_or_else(|| "the model takes no text".to_owned());
    let gestures = gestures::list(gestures);
    Err(Failure::Input(format!("unknown action `{text}`: {prompts}; the gestures are {gestures}")))
}

/// Returns the model's animation of silence.
fn quiet(job: &Job, frames: usize) -> Result<Animation, Failure> {
    let config = job.generator.model.config();
    let name = if config.templates.contains_key("audio_to_motion") { "audio_to_motion" } else { TEXT };
    let mut animation = job.generator.animation(name, None)?;
    let rate = config.audio.sample_rate;
    animation.push_audio(&vec![0.0; (frames * rate).div_ceil(config.frame_rate)])?;
    Ok(animation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prompts_come_before_gestures_and_what_nobody_knows_is_refused() {
        let gestures = Gestures::new();
        let mut config = crate::random::tiny();
        let act = |config: &Config, text: &str| action(config, true, &gestures, text);
        assert_eq!(act(&config, "a backflip"), Ok(Action::Prompt));
        config.prompts = Some(vec![String::new(), "calm".to_owned(), "waves".to_owned()]);
        assert_eq!(act(&config, " Calm"), Ok(Action::Prompt));
        assert_eq!(act(&config, "waves"), Ok(Action::Prompt));
        assert_eq!(act(&config, "a person waves"), Ok(Action::Gesture("wave")));
        let Err(Failure::Input(line)) = act(&config, "a backflip") else { panic!("it is refused") };
        for word in ["backflip", "calm, waves", "thumbs_up"] {
            assert!(line.contains(word), "{line}");
        }
        let Err(Failure::Input(line)) = action(&config, false, &gestures, "calm") else { panic!("it is refused") };
        assert!(line.contains("takes no text"), "{line}");
    }
}
