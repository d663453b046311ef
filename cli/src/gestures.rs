//! `umo gestures`, and gestures of the command line: built-in ones, ones from files, and their errors.

use std::path::Path;

use umo_core::{Animation, Gesture, GestureOptions, Gestures, JOINTS, Quat, SessionError, Skeleton};
use umo_core_base::memory;
use umo_core_rig::glb::clip;

use crate::args::GestureClip;
use crate::failure::Failure;
use crate::import;
use crate::retarget::is_character;

/// Lists the gestures, with their other names.
pub(crate) fn run() -> Result<(), Failure> {
    let gestures = Gestures::new();
    for name in gestures.names() {
        let others: Vec<&str> = gestures.other_names(name).collect();
        println!("{name:<12} {}", others.join(", "));
    }
    Ok(())
}

/// Returns the built-in gestures and those loaded from files, for a model's skeleton.
pub(crate) fn known(clips: &[GestureClip], skeleton: &Skeleton) -> Result<Gestures, Failure> {
    let mut gestures = Gestures::new();
    for GestureClip { name, file, stroke, parts } in clips {
        let (rate, frames) = frames(file, skeleton).map_err(|failure| match failure {
            // Not every cause names the file.
            Failure::Input(problem) if !problem.contains(&*file.to_string_lossy()) => {
                Failure::Input(format!("--gesture-clip {name}={}: {problem}", file.display()))
            }
            other => other,
        })?;
        let middle = 0.5 * frames.len().saturating_sub(1) as f32 / rate;
        gestures.add(Gesture::new(name, rate, &frames, stroke.unwrap_or(middle), *parts)?)?;
    }
    Ok(gestures)
}

/// Returns the frame rate and the rotations of the 55 joints, from an animation written by umo or from any
/// character that umo can retarget to.
fn frames(file: &Path, skeleton: &Skeleton) -> Result<(f32, Vec<[Quat; JOINTS]>), Failure> {
    let is = |known: &str| file.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(known));
    let own = if is("vrm") { None } else { Some(import::read(file)) };
    match own {
        Some(Ok(clip)) => Ok((clip.frame_rate, clip.rotations)),
        Some(Err(failure)) if !is_character(file) => Err(failure),
        _ => {
            let wrong = |problem: String| Failure::Input(format!("{}: {problem}", file.display()));
            let bytes = umo_core_rig::glb::read(file).map_err(|error| wrong(error.to_string()))?;
            let frames = memory::catch(|| clip::read(&bytes, None, skeleton)).map_err(Failure::input)?;
            Ok((clip::RATE, frames.map_err(wrong)?))
        }
    }
}

/// Plays one of `gestures` over an animation that has them.
pub(crate) fn play(
    animation: &mut Animation,
    gestures: &Gestures,
    name: &str,
    options: &GestureOptions,
) -> Result<(), Failure> {
    animation.play_gesture(name, options).map_err(|error| match error {
        SessionError::UnknownGesture => {
            Failure::Input(format!("--gesture {name}: unknown gesture; known: {}", list(gestures)))
        }
        error => Failure::input(format!("--gesture {name}: {error}")),
    })
}

/// Returns the names, separated by commas.
pub(crate) fn list(gestures: &Gestures) -> String {
    gestures.names().collect::<Vec<_>>().join(", ")
}
