//! Reading animations written by `umo`: one module per format.
//!
//! | module | file |
//! | --- | --- |
//! | `npz` | NumPy arrays, also from other SMPL-X tools |
//! | `glb` | glTF 2.0, `.glb` or `.gltf` |
//! | `bvh` | skeleton motion |
//! | `jsonl` | the whole animation, one frame a line |

use std::path::Path;

use umo_core::{ARKIT_NAMES, Face, FaceKind, JOINT_NAMES, JOINTS};
use umo_core_pose::clip::Clip;
use umo_figure::Figure;

use crate::export::Format;
use crate::failure::Failure;

mod bvh;
mod glb;
mod jsonl;
pub(crate) mod npz;

/// Upper bound on the frames read: an hour at 240 frames a second.
pub(crate) const MAX_FRAMES: usize = 3600 * 240;

/// Reads the motion of a file written by `umo`: `.npz`, `.glb` (or `.gltf`), `.bvh` or `.jsonl`, by its
/// extension. The result has at least one frame, 55 joints with parents first, and only finite numbers.
///
/// A `.npz` file has no skeleton: the motion gets the default model's. A `.bvh` file has no face.
///
/// # Errors
/// A description of the problem, with the file's name.
pub fn read(path: &Path) -> Result<Clip, Failure> {
    let mut members = members(path)?;
    if members.len() > 1 {
        let names: Vec<_> = members.iter().map(|member| member.name.as_str()).collect();
        let problem = format!("it has {} members, {}: expected the motion of one", names.len(), names.join(", "));
        return Err(Failure::input(format!("{}: {problem}", path.display())));
    }
    Ok(members.swap_remove(0).clip)
}

/// A member of a file's conversation.
pub(crate) struct Member {
    /// Empty if it is alone, as the place is the origin.
    pub(crate) name: String,
    pub(crate) position: [f32; 3],
    /// Direction about y, radians: 0 is +Z, a quarter turn +X.
    pub(crate) facing: f32,
    /// The figure it wears, if the file says so.
    pub(crate) figure: Option<Figure>,
    pub(crate) clip: Clip,
}

impl Member {
    fn alone(clip: Clip) -> Self {
        Self { name: String::new(), position: [0.0; 3], facing: 0.0, figure: None, clip }
    }
}

/// Reads the motion of a file as [`read`] does, of every member of a conversation; returns at least one.
pub(crate) fn members(path: &Path) -> Result<Vec<Member>, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let is_gltf = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("gltf"));
    let format = if is_gltf { Format::Glb } else { Format::from_extension(path)? };
    let bytes = || umo_core_base::file::read(path).map_err(|error| wrong(error.to_string()));
    let members = match format {
        Format::Npz => {
            let (clip, notes) = npz::read(path).map_err(wrong)?;
            notes.iter().for_each(|note| eprintln!("note: {}: {note}", path.display()));
            vec![Member::alone(clip)]
        }
        Format::Glb => {
            let bytes = umo_core_rig::glb::read(path).map_err(|error| wrong(error.to_string()))?;
            glb::read(&bytes).map_err(wrong)?
        }
        Format::Bvh => vec![Member::alone(bvh::read(&bytes()?).map_err(wrong)?)],
        Format::Jsonl => vec![Member::alone(jsonl::read(&bytes()?).map_err(wrong)?)],
        Format::Vrma => {
            return Err(wrong("a .vrma file cannot be read back: expected npz, glb, bvh or jsonl".to_owned()));
        }
        Format::Csv => return Err(wrong("a csv file has a face only: expected npz, glb, bvh or jsonl".to_owned())),
    };
    for Member { clip, .. } in &members {
        clip.check().map_err(|problem| wrong(problem.to_owned()))?;
    }
    Ok(members)
}

/// Returns a face with these channels: ARKit's if all of them are ARKit blendshapes.
fn face(names: Vec<String>) -> Face {
    let arkit = !names.is_empty() && names.iter().all(|name| ARKIT_NAMES.contains(&name.as_str()));
    Face { kind: if arkit { FaceKind::Arkit } else { FaceKind::SmplxExpression }, names }
}

/// Returns the index of each of the 55 joints among `names`.
fn joints<'a>(names: impl Iterator<Item = Option<&'a str>>) -> Result<[usize; JOINTS], String> {
    let names: Vec<_> = names.collect();
    let mut places = [0; JOINTS];
    for (place, joint) in places.iter_mut().zip(JOINT_NAMES) {
        let found = names.iter().position(|name| *name == Some(joint));
        *place = found.ok_or_else(|| format!("not an animation written by umo: it has no joint `{joint}`"))?;
    }
    Ok(places)
}

/// Returns the parents of the 55 joints; `places` holds their indices in the file, and `parents` the
/// parents of all the file's joints.
fn parents(places: &[usize; JOINTS], parents: &[Option<usize>]) -> Result<Vec<i32>, String> {
    let number = |joint: usize| i32::try_from(joint).expect("there are 55 joints");
    let parent = |(joint, &place): (usize, &usize)| match parents[place] {
        _ if joint == 0 => Ok(-1),
        Some(parent) => places.iter().position(|&place| place == parent).map(number).ok_or(joint),
        None => Err(joint),
    };
    let found = places.iter().enumerate().map(parent).collect::<Result<Vec<_>, _>>();
    found.map_err(|joint| format!("joint `{}` does not hang on another of the 55", JOINT_NAMES[joint]))
}

#[cfg(test)]
mod tests;
