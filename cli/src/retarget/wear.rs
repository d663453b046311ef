//! A character and its motion for a page.

use std::path::Path;

use serde::Deserialize;
use umo_core::glb::Glb;
use umo_core::glb::accessor::floats;
use umo_core::glb::document::Document;
use umo_core::motion::clip::Clip;
use umo_core::motion::skeleton::JOINTS;
use umo_core::retarget::Mapping;

use super::mapping::Given;
use super::{Character, Target, motion, prepare, read};
use crate::failure::Failure;

/// Largest file that a page holds: browsers open it as text, a third longer.
const MAX_BYTES: usize = 256 << 20;

/// What a file may demand of who shows it, and the page does not read.
const UNREAD: [(&str, &str); 3] = [
    ("KHR_draco_mesh_compression", "meshes are"),
    ("EXT_meshopt_compression", "meshes are"),
    ("KHR_texture_basisu", "textures are"),
];

/// A character with an animation, and the node of each of the 55 joints.
pub(crate) struct Worn {
    /// A `.glb` file; its first animation is the motion.
    pub(crate) file: Vec<u8>,
    pub(crate) nodes: [Option<usize>; JOINTS],
    /// Length of the animation.
    pub(crate) seconds: f64,
}

/// Puts a motion on the character of a `.glb` or `.vrm` file, as `umo retarget` does.
///
/// # Errors
/// A file that is no character, or that a page cannot show; in words, with its name.
pub(crate) fn wear(onto: &Path, mapping: Option<&Path>, clip: &Clip) -> Result<Worn, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", onto.display()));
    let (target, mapped) = character(onto, mapping)?;
    let given = given(mapping)?;
    let faces = target.faces(&clip.face, &given).map_err(wrong)?;
    let mut retarget = prepare(&clip.skeleton, target.rig(), &mapped, target.floor()).map_err(wrong)?;
    faces.release_bones(&clip.face, &mapped, &mut retarget);
    let motion = motion(&retarget, clip)?;
    let file = target.animated(&retarget, &motion, &faces, clip).map_err(wrong)?;
    let frames = clip.len().saturating_sub(1);
    finished(file, &mapped, frames as f64 / f64::from(clip.frame_rate)).map_err(wrong)
}

/// A character's file that has an animation already, such as `umo retarget` writes.
///
/// # Errors
/// A file that is no character, that has no animation, or that a page cannot show; in words, with
/// its name.
pub(crate) fn worn(path: &Path, mapping: Option<&Path>) -> Result<Worn, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let (target, mapped) = character(path, mapping)?;
    let Target::Character(character) = target else { return Err(wrong("it is no character".to_owned())) };
    let file = character.into_bytes();
    let seconds = length(&file).map_err(wrong)?;
    finished(file, &mapped, seconds).map_err(wrong)
}

fn given(mapping: Option<&Path>) -> Result<Given, Failure> {
    Ok(mapping.map(Given::read).transpose()?.unwrap_or_default())
}

/// The character of a file, and which bone of it is what.
fn character(path: &Path, mapping: Option<&Path>) -> Result<(Target, Mapping), Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    match extension.to_str() {
        Some("glb" | "vrm") => {}
        Some("gltf") => return Err(wrong("expected .glb: pack the .gltf and its files into one".to_owned())),
        Some("bvh") => return Err(wrong("a .bvh file has bones and no body: expected .glb or .vrm".to_owned())),
        _ => return Err(wrong("expected a character, .glb or .vrm".to_owned())),
    }
    let target = Target::read(path, read(path)?).map_err(wrong)?;
    let (mapped, _) = target.mapping(&given(mapping)?).map_err(wrong)?;
    mapped.check(target.rig()).map_err(|problem| {
        let help = "--mapping FILE says which is which, `umo retarget --print-mapping` what was found";
        wrong(format!("it is no character with a body that is known: {problem}; {help}"))
    })?;
    Ok((target, mapped))
}

fn finished(file: Vec<u8>, mapping: &Mapping, seconds: f64) -> Result<Worn, String> {
    shown(&file)?;
    Ok(Worn { file, nodes: nodes(mapping), seconds })
}

/// Refuses what the page cannot show.
fn shown(file: &[u8]) -> Result<(), String> {
    #[derive(Default, Deserialize)]
    #[serde(rename_all = "camelCase", default)]
    struct Demands {
        extensions_required: Vec<String>,
        meshes: Vec<serde::de::IgnoredAny>,
    }
    if file.len() > MAX_BYTES {
        return Err(format!("it is too large for a page: at most {} MiB", MAX_BYTES >> 20));
    }
    let demands: Demands = serde_json::from_str(Glb::split(file)?.json).map_err(|error| error.to_string())?;
    if demands.meshes.is_empty() {
        return Err("it has bones and no body: there is no mesh to show".to_owned());
    }
    match UNREAD.iter().find(|(name, _)| demands.extensions_required.iter().any(|required| required == name)) {
        Some((name, what)) => Err(format!("its {what} compressed in a way that the page does not read, {name}: export it without")),
        None => Ok(()),
    }
}

/// The bone of each joint; of a spine or a neck of other counts, the one as far along.
fn nodes(mapping: &Mapping) -> [Option<usize>; JOINTS] {
    let along = |chain: &[usize], part: usize, parts: usize| {
        let last = chain.len().checked_sub(1)?;
        Some(chain[(part * chain.len()).div_ceil(parts).saturating_sub(1).min(last)])
    };
    std::array::from_fn(|joint| {
        mapping.bone(joint).or_else(|| match joint {
            3 => along(mapping.spine(), 1, 3),
            6 => along(mapping.spine(), 2, 3),
            9 => along(mapping.spine(), 3, 3),
            12 => along(mapping.neck(), 1, 1),
            _ => None,
        })
    })
}

/// Seconds of a file's first animation.
fn length(file: &[u8]) -> Result<f64, String> {
    let glb = Glb::split(file)?;
    let document = Document::parse(glb.json)?;
    let still = "it has no animation: `umo view speech.wav --onto` it moves it";
    let animation = document.animations.first().ok_or(still)?;
    let mut end = 0.0_f32;
    for sampler in &animation.samplers {
        let times = floats(&document, glb.bin, sampler.input, "SCALAR")?;
        end = times.last().copied().map_or(end, |last| end.max(last));
    }
    if end > 0.0 { Ok(f64::from(end)) } else { Err(still.to_owned()) }
}
