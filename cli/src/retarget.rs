//! `umo retarget`: an animation brought to another character's skeleton and face.
//!
//! | module | part |
//! | --- | --- |
//! | `character` | a character in a `.glb` file, and the animation in it |
//! | `splice` | JSON changed in some places, and as it was in all others |
//! | `bvh` | a skeleton in a `.bvh` file, and the animation on it |
//! | `mapping` | mapping files |
//! | `sheet` | a picture of the motion on figure and character |
//! | `wear` | a character and its motion for a page |

use std::path::Path;

use umo_core::config::{Face, FaceKind, Skeleton};
use umo_core::glb::{Faces, Given};
use umo_core::motion::clip::Clip;
use umo_core::motion::rotation::{IDENTITY, Quat};
use umo_core::motion::skeleton::ARKIT_NAMES;
use umo_core::retarget::{Floor, Mapping, Retarget, Rig};

use crate::args;
use crate::failure::Failure;
use crate::{animate, atomic_file, import, model};
use character::Character;
pub(crate) use wear::{Wearer, Worn};

mod bvh;
mod character;
mod mapping;
mod sheet;
mod splice;
mod wear;

#[cfg(test)]
mod tests;

/// Largest file of a character.
const MAX_BYTES: u64 = 2 << 30;

/// Three-vrm poses a VRM's bones anew from its own normalized rig at each `vrm.update()`.
const VRM_NOTE: &str = "note: in three-vrm, `vrm.update()` overwrites this animation with a T-pose unless \
    `vrm.humanoid.autoUpdateHumanBones` is false; `umo animate -o motion.vrma` makes one that plays on any VRM";

/// What is moved.
enum Target {
    Character(Character),
    Skeleton(bvh::Target),
}

/// A rig's motion: what both kinds of files write.
pub(crate) struct Motion {
    pub(crate) frame_rate: f32,
    /// `[frames]` of `[bones]`, relative to their parents.
    pub(crate) rotations: Vec<Vec<Quat>>,
    /// Place of the hips' bone in its parent's frame, the rig's unit. `[frames]`
    pub(crate) hips: Vec<[f32; 3]>,
}

/// Brings an animation to another character.
pub(crate) fn run(args: &args::Retarget) -> Result<(), Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", args.onto.display()));
    let bytes = read(&args.onto)?;
    let target = Target::read(&args.onto, bytes).map_err(wrong)?;
    let given = args.mapping.as_deref().map(mapping::read).transpose()?.unwrap_or_default();
    let (mapping, convention) = target.mapping(&given).map_err(|problem| match &args.mapping {
        Some(path) => Failure::input(format!("{}: {problem}", path.display())),
        None => wrong(problem),
    })?;
    let checked = mapping.check(target.rig()).map_err(|problem| {
        wrong(format!("{problem}; --mapping FILE says which is which, --print-mapping what was found"))
    });
    if args.print_mapping {
        let arkit = Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() };
        let faces = target.faces(&arkit, &given).map_err(wrong)?;
        print(target.rig(), &mapping, &convention, &faces, &arkit);
    }
    checked?;
    let Some(input) = args.input.as_ref().filter(|_| args.output.is_some() || args.sheet.is_some()) else {
        return Ok(());
    };
    if let Some(output) = &args.output {
        target.check_output(output)?;
    }
    let out = args.output.as_deref().map(atomic_file::create).transpose()?;
    let sheet = args.sheet.as_deref().map(|sheet| target.check_sheet(sheet).map(|()| atomic_file::create(sheet)));
    let sheet = sheet.transpose()?.transpose()?;
    let clip = clip(input, args)?;
    let faces = target.faces(&clip.face, &given).map_err(wrong)?;
    let mut retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor()).map_err(wrong)?;
    faces.release_bones(&clip.face, &mapping, &mut retarget);
    let motion = motion(&retarget, &clip)?;
    if let (Some(path), Some(out)) = (&args.output, out) {
        let bytes = target.animated(&retarget, &motion, &faces, &clip).map_err(wrong)?;
        atomic_file::commit(out, |out| std::io::Write::write_all(out, &bytes))?;
        tell(path, &clip, &mapping, &convention, &faces);
        if path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("vrm")) {
            eprintln!("{VRM_NOTE}");
        }
    }
    if let (Target::Character(character), Some(path), Some(out)) = (&target, &args.sheet, sheet) {
        let picture = sheet::draw(character, &mapping, &retarget, &motion, &faces, &clip).map_err(wrong)?;
        atomic_file::commit(out, |out| picture.write(out))?;
        println!("{}: the motion on the figure and on the character", path.display());
    }
    Ok(())
}

fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
    let size = std::fs::metadata(path).map_err(|error| wrong(error.to_string()))?.len();
    if size > MAX_BYTES {
        return Err(wrong(format!("it is larger than {} GiB", MAX_BYTES >> 30)));
    }
    umo_core::file::read(path).map_err(|error| wrong(error.to_string()))
}

/// Extensions of recordings.
const RECORDINGS: [&str; 9] = ["wav", "flac", "mp3", "ogg", "oga", "opus", "m4a", "mp4", "aac"];

/// The animation of a recording, or one that was made before.
fn clip(input: &Path, args: &args::Retarget) -> Result<Clip, Failure> {
    let extension = input.extension().unwrap_or_default();
    if !RECORDINGS.iter().any(|recording| extension.eq_ignore_ascii_case(recording)) {
        return import::read(input);
    }
    let wav = animate::speech(input, args.repair)?;
    let maker = animate::Maker::new(&args.generate, model::open(args.generate.model.as_deref())?)?;
    let (samples, frames) = maker.hear(input, &wav)?;
    let mut animation = maker.animation("audio_to_motion", None)?;
    animation.push_audio(&samples)?;
    animation.finish(frames);
    maker.clip(&mut animation, frames, |_| ())
}

fn prepare(source: &Skeleton, rig: &Rig, mapping: &Mapping, floor: Floor) -> Result<Retarget, String> {
    Retarget::new(source, rig, mapping, floor).map_err(|error| error.to_string())
}

/// Every frame on the rig.
fn motion(retarget: &Retarget, clip: &Clip) -> Result<Motion, Failure> {
    let mut scratch = retarget.scratch();
    let (mut rotations, mut hips) = (Vec::with_capacity(clip.len()), Vec::with_capacity(clip.len()));
    for frame in 0..clip.len() {
        let mut row = vec![IDENTITY; retarget.bones()];
        hips.push(retarget.apply(&mut scratch, &clip.pose(frame), &mut row)?);
        rotations.push(row);
    }
    Ok(Motion { frame_rate: clip.frame_rate, rotations, hips })
}

impl Target {
    fn read(path: &Path, bytes: Vec<u8>) -> Result<Self, String> {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("glb" | "vrm") => Ok(Self::Character(Character::read(bytes)?)),
            Some("bvh") => Ok(Self::Skeleton(bvh::Target::read(bytes)?)),
            _ => Err("expected a character, .glb or .vrm, or a skeleton, .bvh".to_owned()),
        }
    }

    fn rig(&self) -> &Rig {
        match self {
            Self::Character(character) => character.rig(),
            Self::Skeleton(target) => target.rig(),
        }
    }

    fn floor(&self) -> Floor {
        match self {
            Self::Character(_) => Floor::AtRest,
            Self::Skeleton(_) => Floor::AtZero,
        }
    }

    /// What is what, by the file's own table or by names, and what the mapping file says over that;
    /// and who names so.
    fn mapping(&self, given: &Given) -> Result<(Mapping, String), String> {
        match self {
            Self::Character(character) => character.mapping(given),
            Self::Skeleton(target) => given.over(target.rig(), None),
        }
    }

    fn faces(&self, face: &Face, given: &Given) -> Result<Faces, String> {
        match self {
            Self::Character(character) => Faces::find(character.document(), face, given),
            Self::Skeleton(_) => Ok(Faces::default()),
        }
    }

    /// A file holds what its name says.
    fn check_output(&self, output: &Path) -> Result<(), Failure> {
        let wrong = |problem: &str| Err(Failure::input(format!("{}: {problem}", output.display())));
        let is = |known: &str| output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(known));
        match self {
            Self::Character(character) if is("vrm") && !character.is_vrm() => {
                wrong("the character is no VRM file, so the output is none: name it .glb")
            }
            Self::Character(_) if is("glb") || is("vrm") => Ok(()),
            Self::Character(_) => wrong("expected .glb, or .vrm where the character is one"),
            Self::Skeleton(_) if is("bvh") => Ok(()),
            Self::Skeleton(_) => wrong("expected .bvh, as the skeleton"),
        }
    }

    /// Only a body can be drawn, and only as PNG.
    fn check_sheet(&self, sheet: &Path) -> Result<(), Failure> {
        let is_png = sheet.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"));
        match self {
            Self::Skeleton(_) => Err(Failure::input("--sheet draws a character, .glb or .vrm: a skeleton has no body")),
            Self::Character(_) if !is_png => Err(Failure::input(format!("{}: expected .png", sheet.display()))),
            Self::Character(_) => Ok(()),
        }
    }

    fn animated(&self, retarget: &Retarget, motion: &Motion, faces: &Faces, clip: &Clip) -> Result<Vec<u8>, String> {
        match self {
            Self::Character(character) => character.animated(retarget, motion, faces, clip),
            Self::Skeleton(target) => target.animated(retarget, motion),
        }
    }
}

/// Every joint with its bones, every shape that moves with what moves it.
fn print(rig: &Rig, mapping: &Mapping, convention: &str, faces: &Faces, face: &Face) {
    println!("{convention}");
    for (joint, bones) in mapping.entries() {
        let names: Vec<_> = bones.iter().map(|&bone| rig.bones()[bone].name.as_str()).collect();
        println!("  {joint:<16} {}", if names.is_empty() { "-".to_owned() } else { names.join(", ") });
    }
    faces.list(face).iter().for_each(|line| println!("{line}"));
}

/// One line of what was done, and notes of what could not be.
fn tell(output: &Path, clip: &Clip, mapping: &Mapping, convention: &str, faces: &Faces) {
    let entries = mapping.entries();
    let missing: Vec<_> = entries.iter().filter(|(_, bones)| bones.is_empty()).map(|(joint, _)| *joint).collect();
    let bones: usize = entries.iter().map(|(_, bones)| bones.len()).sum();
    let seconds = clip.len() as f64 / f64::from(clip.frame_rate);
    println!(
        "{}: {} frames, {seconds:.2} s; {bones} bones by {convention}, {} shapes",
        output.display(),
        clip.len(),
        faces.moved()
    );
    if !missing.is_empty() {
        eprintln!("note: no bones for {}", missing.join(", "));
    }
    if clip.face.kind != FaceKind::Arkit && faces.shapes() > 0 {
        eprintln!("note: the animation's face has no ARKit channels: shapes stay as they are");
    } else if faces.moved() == 0 && faces.shapes() > 0 {
        eprintln!("note: none of the character's {} shapes has a name that is known", faces.shapes());
    }
}
