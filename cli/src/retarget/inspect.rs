//! `umo inspect CHARACTER`: reports what a character has, what it lacks, and how to fix it.

use std::path::Path;

use umo_core::{Mapping, Rig, VISEME_NAMES};
use umo_core_rig::glb::{Faces, Given};

use super::body::Body;
use super::{Character, Target, arkit, is_character, read};
use crate::failure::Failure;

/// Upper bounds on the slope of the upper arms below horizontal in a T-pose and an A-pose, degrees.
const LEVEL: f32 = 20.0;
const SLOPING: f32 = 70.0;

/// Whether a file name has the extension of a character or a skeleton.
pub(crate) fn is_inspected(path: &Path) -> bool {
    is_character(path) || path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh"))
}

/// Prints a report on a file.
pub(crate) fn inspect(path: &Path) -> Result<(), Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let target = Target::read(path, read(path)?).map_err(wrong)?;
    report(&target).map_err(wrong)?.iter().for_each(|line| println!("{line}"));
    Ok(())
}

/// Returns the report's lines, each with a field and its value.
pub(super) fn report(target: &Target) -> Result<Vec<String>, String> {
    let (given, face) = (Given::default(), arkit());
    let (mapping, convention) = target.mapping(&given)?;
    let faces = target.faces(&mapping, &face, &given)?;
    let mut lines = Vec::new();
    let mut add = |field: &str, value: String| lines.push(format!("{field:<10} {value}"));
    if let Target::Character(character) = target {
        let rights = character.rights();
        rights.iter().for_each(|(field, value)| add(field, value.clone()));
        if !rights.iter().any(|(field, _)| *field == "licence") {
            add("licence", "not given in the file".to_owned());
        }
        add("height", height(character, &mapping));
    }
    add("rest pose", rest_pose(target, &mapping));
    add("bones", bones(&mapping, &convention));
    let missing = mapping.entries().into_iter().filter(|(_, bones)| bones.is_empty()).map(|(joint, _)| joint);
    let missing: Vec<_> = missing.collect();
    if !missing.is_empty() {
        add("", format!("missing, and at rest unless --mapping FILE names them: {}", missing.join(", ")));
    }
    if let Target::Character(character) = target {
        shapes(character, &faces).into_iter().for_each(|value| add("shapes", value));
    }
    let checked = target.check(&mapping, "`umo retarget --print-mapping` prints what was found");
    let notes = target.notes(&mapping, &faces, &face);
    checked.err().into_iter().chain(notes).for_each(|note| add("note", note));
    Ok(lines)
}

/// Returns the height of the surfaces, or of the bones if there are no surfaces.
fn height(character: &Character, mapping: &Mapping) -> String {
    let surface = Body::read(character, false).map(|body| body.extent(character));
    match surface {
        Ok(Some([low, high])) => format!("{:.2} m", high - low),
        Ok(None) => "unknown: its mesh has no surface".to_owned(),
        Err(problem) => {
            let bones = [0, 7, 8, 10, 11, 15].into_iter().filter_map(|joint| mapping.bone(joint));
            let heights = bones.map(|bone| character.rig().place(bone)[1]);
            let (low, high) = heights.fold((f32::MAX, f32::MIN), |(low, high), y| (low.min(y), high.max(y)));
            format!("{:.2} m from foot to head by its bones: {problem}", (high - low).max(0.0))
        }
    }
}

/// Returns the pose of the arms at rest, and its source.
fn rest_pose(target: &Target, mapping: &Mapping) -> String {
    let held = arms(target.rig(), mapping).map_or("unknown: no arms".to_owned(), |below| {
        let kind = match below {
            below if below < LEVEL => "T-pose",
            below if below < SLOPING => "A-pose",
            _ => "arms hang",
        };
        // Avoids -0.
        format!("{kind}, upper arms {:.0}° below the level", below.round() + 0.0)
    });
    match target {
        Target::Character(character) if !character.bound().is_empty() => {
            format!("{held}; by the skin: the nodes hold another pose")
        }
        _ => held,
    }
}

/// Returns the angle of the upper arms below horizontal, degrees; the steeper one of both.
fn arms(rig: &Rig, mapping: &Mapping) -> Option<f32> {
    let place = |joint: usize| mapping.bone(joint).map(|bone| rig.place(bone));
    let [low, high] = [place(0)?, place(15)?];
    let less = |a: [f32; 3], b: [f32; 3]| -> [f32; 3] { std::array::from_fn(|axis| a[axis] - b[axis]) };
    let dot = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    let up = less(high, low);
    let below = [(16, 18), (17, 19)].into_iter().filter_map(|(from, to)| {
        let arm = less(place(to)?, place(from)?);
        let sine = -dot(arm, up) / (dot(arm, arm) * dot(up, up)).sqrt();
        sine.is_finite().then(|| sine.clamp(-1.0, 1.0).asin().to_degrees())
    });
    below.reduce(f32::max)
}

fn bones(mapping: &Mapping, convention: &str) -> String {
    let entries = mapping.entries();
    let found: usize = entries.iter().map(|(_, bones)| bones.len()).sum();
    let joints = entries.iter().filter(|(_, bones)| !bones.is_empty()).count();
    format!("{found} by {convention}, for {joints} of {} joints", entries.len())
}

/// Returns a line per known set of shapes: how many the character has, and which are missing.
fn shapes(character: &Character, faces: &Faces) -> Vec<String> {
    let face = arkit();
    let plain = |name: &str| name.chars().filter(|c| c.is_alphanumeric()).collect::<String>().to_lowercase();
    let names: Vec<String> = faces.names().map(plain).collect();
    let driven = faces.driven(&face);
    let others: Vec<&str> = face.names.iter().map(String::as_str).filter(|name| !driven.contains(name)).collect();
    let (visemes, lacking): (Vec<&str>, Vec<&str>) = VISEME_NAMES.iter().partition(|name| {
        let short = matches!(**name, "ih" | "oh" | "ou").then(|| &name[..1]);
        [Some(**name), short].into_iter().flatten().any(|name| {
            let ends = ["viseme", "vrcv"].map(|mark| format!("{mark}{}", name.to_lowercase()));
            names.iter().any(|known| ends.iter().any(|end| known.ends_with(end)))
        })
    });
    let said = |have: usize, all: usize, of: &str, missing: &[&str]| match (have, missing.len()) {
        (0, _) | (_, 0) => format!("{have} of {of} {all}"),
        _ => format!("{have} of {of} {all}; missing: {}", missing.join(", ")),
    };
    let mut lines = vec![format!("{} in all, {} move", faces.shapes(), faces.moved())];
    lines.push(said(driven.len(), face.names.len(), "ARKit's", &others));
    lines.push(said(visemes.len(), VISEME_NAMES.len(), "Oculus'", &lacking));
    if character.is_vrm() {
        let expressions = umo_core_rig::glb::expressions(character.document());
        let names: Vec<_> = expressions.iter().map(|expression| expression.name.as_str()).collect();
        lines.push(format!("{} VRM expressions with shapes: {}", names.len(), names.join(", ")));
    }
    lines
}
