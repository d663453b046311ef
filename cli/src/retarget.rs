//! `umo retarget`: transfers an animation to another character's skeleton and face.
//!
//! | module | part |
//! | --- | --- |
//! | `character` | a character in a `.glb` file, and writing the animation into it |
//! | `draco` | decompression of Draco meshes |
//! | `body` | the character's surfaces |
//! | `bvh` | a skeleton in a `.bvh` file, and the animation on it |
//! | `mapping` | mapping files |
//! | `inspect` | report of found and missing bones and shapes |
//! | `sheet` | a picture of the motion on figure and character |
//! | `wear` | a character and its motion for the viewer page |

use std::path::Path;

use umo_core::{ARKIT_NAMES, Face, FaceKind, Floor, Mapping, Quat, Retarget, Rig, Skeleton, Volume};
use umo_core_pose::clip::Clip;
use umo_core_pose::rotation::IDENTITY;
use umo_core_rig::glb::{Faces, Given};
use umo_core_rig::retarget::{other_bodies, undecorated};
use umo_gltf::keys::Bound;

use crate::failure::Failure;
use crate::speech::Speech;
use crate::words::Script;
use crate::{animate, args, atomic_file, import, model};
use character::Character;
pub(crate) use inspect::{inspect, is_inspected};
pub(crate) use wear::{Wearer, Worn};

mod body;
mod bvh;
mod character;
mod draco;
mod inspect;
mod mapping;
mod sheet;
mod wear;

#[cfg(test)]
mod tests;

/// Advice for a mesh without a skeleton.
const RIGGERS: &str = "give it one first, as Mixamo's auto-rigger or Blender's Rigify do";

/// Note for VRM files: at each `vrm.update()`, three-vrm poses the bones from its own normalized rig.
const VRM_NOTE: &str = "note: in three-vrm, `vrm.update()` overwrites this animation with a T-pose unless \
    `vrm.humanoid.autoUpdateHumanBones` is false; `umo animate -o motion.vrma` makes one that plays on any VRM";

/// The target of the motion.
enum Target {
    Character(Box<Character>),
    Skeleton(bvh::Target),
}

/// A rig's motion, as both kinds of files write it.
pub(crate) struct Motion {
    pub(crate) frame_rate: f32,
    /// Rotations relative to the parents, `[frames]` of `[bones]`.
    pub(crate) rotations: Vec<Vec<Quat>>,
    /// Position of the hips' bone in its parent's frame, in the rig's unit, `[frames]`.
    pub(crate) hips: Vec<[f32; 3]>,
    /// Error that a file with few keys may have; in characters' files.
    pub(crate) bound: Option<Bound>,
}

/// Retargets an animation to another character.
pub(crate) fn run(args: &args::Retarget) -> Result<(), Failure> {
    let wrong = |problem: String| Failure::input(format!("{}: {problem}", args.onto.display()));
    let bytes = read(&args.onto)?;
    let target = Target::read(&args.onto, bytes).map_err(wrong)?;
    let given = args.mapping.as_deref().map(mapping::read).transpose()?.unwrap_or_default();
    let (mapping, convention) = target.mapping(&given).map_err(|problem| match &args.mapping {
        Some(path) => Failure::input(format!("{}: {problem}", path.display())),
        None => wrong(problem),
    })?;
    let checked = target.check(&mapping, "--print-mapping prints what was found").map_err(wrong);
    if args.print_mapping {
        let arkit = arkit();
        let faces = target.faces(&mapping, &arkit, &given).map_err(wrong)?;
        print(target.rig(), &mapping, &convention, &faces, &arkit);
        if let Some((volume, gain)) = target.volume(&mapping, &given).map_err(wrong)? {
            print_body(&volume, gain, &given);
        }
    }
    checked?;
    let Some(input) = args.input.as_ref().filter(|_| !args.output.is_empty() || args.sheet.is_some()) else {
        return Ok(());
    };
    if args.reduce.is_some() && matches!(target, Target::Skeleton(_)) {
        return Err(Failure::input(
            "--reduce: a .bvh skeleton moves in every frame; characters, .glb or .vrm, take fewer keys",
        ));
    }
    args.output.iter().try_for_each(|output| target.check_output(output))?;
    let outputs = args.output.iter().map(|path| atomic_file::create(path)).collect::<Result<Vec<_>, _>>()?;
    let sheet = args.sheet.as_deref().map(|sheet| target.check_sheet(sheet).map(|()| atomic_file::create(sheet)));
    let mut sheet = sheet.transpose()?.transpose()?;
    let mut outputs = args.output.iter().zip(outputs);
    for (number, clip) in clips(input, args)?.iter().enumerate() {
        let faces = target.faces(&mapping, &clip.face, &given).map_err(wrong)?;
        let mut retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).map_err(wrong)?;
        faces.release_bones(&clip.face, &mapping, &mut retarget);
        let volume = target.give_volume(&mut retarget, &mapping, &given).map_err(wrong)?;
        let motion = Motion { bound: args.reduce, ..motion(&retarget, clip)? };
        if let Some((path, out)) = outputs.next() {
            let bytes = target.animated(&retarget, &motion, &faces, clip).map_err(wrong)?;
            atomic_file::commit(out, |out| std::io::Write::write_all(out, &bytes))?;
            tell(path, clip, &mapping, &convention, &faces, number == 0);
            let notes = target.notes(&mapping, &faces, &clip.face);
            notes.iter().filter(|_| number == 0).for_each(|note| eprintln!("note: {note}"));
        }
        if let (Target::Character(character), Some(path), Some(out)) = (&target, &args.sheet, sheet.take()) {
            let volume = volume.as_ref();
            let picture = sheet::draw(character, &mapping, &retarget, &motion, &faces, clip, volume).map_err(wrong)?;
            atomic_file::commit(out, |out| picture.write(out))?;
            println!("{}: the motion on the figure and on the character", path.display());
        }
    }
    if args.output.iter().any(|path| path.extension().is_some_and(|own| own.eq_ignore_ascii_case("vrm"))) {
        eprintln!("{VRM_NOTE}");
    }
    Ok(())
}

/// Reads a character's file as one `.glb`, or another file unchanged.
fn read(path: &Path) -> Result<Vec<u8>, Failure> {
    let bytes = match is_character(path) {
        true => umo_core_rig::glb::read(path).and_then(|file| draco::decompressed(file).map_err(std::io::Error::other)),
        false => umo_core_base::file::read(path),
    };
    bytes.map_err(|problem| Failure::input(format!("{}: {problem}", path.display())))
}

/// Whether a file name has the extension of a character.
pub(crate) fn is_character(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    ["glb", "gltf", "vrm"].iter().any(|known| extension.eq_ignore_ascii_case(known))
}

/// Returns the animation of a recording, or reads a finished one: of a conversation, each member's.
fn clips(input: &Path, args: &args::Retarget) -> Result<Vec<Clip>, Failure> {
    if !umo_audio_file::has_extension(input) {
        args.words.refuse_with("an animation: it has its gestures already")?;
        let members = import::members(input)?;
        check_outputs(input, &members.iter().map(|member| member.name.as_str()).collect::<Vec<_>>(), args)?;
        return Ok(members.into_iter().map(|member| member.clip).collect());
    }
    check_outputs(input, &[""], args)?;
    let speech = Speech::open(input, args.repair)?;
    let generator =
        animate::Generator::new(&args.generate, &args.compute, model::open(args.compute.model.as_deref())?)?;
    let mut animation = generator.animation("audio_to_motion", None)?;
    let script = Script::begin(&args.words, &speech, &mut animation)?;
    let frames = generator.hear(&mut animation, &speech)?;
    Ok(vec![generator.clip(&mut animation, frames, script, |_| ())?])
}

/// Refuses outputs that are not one for each member, and a sheet of several.
fn check_outputs(input: &Path, names: &[&str], args: &args::Retarget) -> Result<(), Failure> {
    let (outputs, members) = (args.output.len(), format!("{} members, {}", names.len(), names.join(", ")));
    let problem = match names.len() {
        1 if outputs <= 1 => return Ok(()),
        1 => format!("one motion, but {outputs} outputs"),
        _ if args.sheet.is_some() => format!("{members}: --sheet draws one"),
        count if count == outputs => return Ok(()),
        _ => format!("{members}, but {outputs} outputs: expected -o for each"),
    };
    Err(Failure::input(format!("{}: {problem}", input.display())))
}

fn prepare(source: &Skeleton, rig: &Rig, mapping: &Mapping, floor: Floor) -> Result<Retarget, String> {
    Retarget::new(source, rig, mapping, floor).map_err(|error| error.to_string())
}

/// Retargets every frame to the rig.
fn motion(retarget: &Retarget, clip: &Clip) -> Result<Motion, Failure> {
    let mut scratch = retarget.scratch();
    scratch.set_step(1.0 / clip.frame_rate);
    let (mut rotations, mut hips) = (Vec::with_capacity(clip.len()), Vec::with_capacity(clip.len()));
    for frame in 0..clip.len() {
        let mut row = vec![IDENTITY; retarget.bones()];
        hips.push(retarget.apply(&mut scratch, &clip.pose(frame), &mut row)?);
        rotations.push(row);
    }
    Ok(Motion { frame_rate: clip.frame_rate, rotations, hips, bound: None })
}

impl Target {
    fn read(path: &Path, bytes: Vec<u8>) -> Result<Self, String> {
        match path.extension() {
            _ if is_character(path) => Ok(Self::Character(Box::new(Character::read(bytes)?))),
            Some(extension) if extension.eq_ignore_ascii_case("bvh") => Ok(Self::Skeleton(bvh::Target::read(bytes)?)),
            _ => Err("expected a character, .glb, .gltf or .vrm, or a skeleton, .bvh".to_owned()),
        }
    }

    fn rig(&self) -> &Rig {
        match self {
            Self::Character(character) => character.rig(),
            Self::Skeleton(target) => target.rig(),
        }
    }

    fn check(&self, mapping: &Mapping, help: &str) -> Result<(), String> {
        check(self.rig(), mapping, matches!(self, Self::Skeleton(_)), help)
    }

    fn floor(&self, mapping: &Mapping) -> Floor {
        match self {
            Self::Character(character) => character.floor(mapping),
            Self::Skeleton(_) => Floor::AtZero,
        }
    }

    /// Maps joints to bones by the file's own table or by bone names, overridden by the mapping file; also
    /// returns the name of the naming convention.
    fn mapping(&self, given: &Given) -> Result<(Mapping, String), String> {
        match self {
            Self::Character(character) => character.mapping(given),
            Self::Skeleton(target) => given.over(target.rig(), None),
        }
    }

    /// Returns the body's volume and its gain, as the mapping file says.
    fn volume(&self, mapping: &Mapping, given: &Given) -> Result<Option<(Volume, f32)>, String> {
        match self {
            Self::Character(character) => character.volume(mapping, given),
            Self::Skeleton(target) => given.volume(Volume::of_people(target.rig(), mapping)),
        }
    }

    /// Gives the rig that volume, and returns it; `None` if the gain is 0.
    fn give_volume(&self, retarget: &mut Retarget, mapping: &Mapping, given: &Given) -> Result<Option<Volume>, String> {
        let Some((volume, gain)) = self.volume(mapping, given)?.filter(|(_, gain)| *gain > 0.0) else {
            return Ok(None);
        };
        retarget.set_volume(self.rig(), mapping, &volume, gain).map_err(|error| error.to_string())?;
        Ok(Some(volume))
    }

    fn faces(&self, mapping: &Mapping, face: &Face, given: &Given) -> Result<Faces, String> {
        match self {
            Self::Character(character) => Faces::find(character, mapping, face, given),
            Self::Skeleton(_) => Ok(Faces::default()),
        }
    }

    /// Returns notes about parts that do not move and about bones found by adjusted names.
    fn notes(&self, mapping: &Mapping, faces: &Faces, face: &Face) -> Vec<String> {
        let mut notes = of_rig(self.rig(), mapping);
        if let Self::Character(_) = self {
            notes.extend(faces.notes(face, mapping));
        }
        notes
    }

    /// Checks that the output's extension fits the target.
    fn check_output(&self, output: &Path) -> Result<(), Failure> {
        let wrong = |problem: &str| Err(Failure::input(format!("{}: {problem}", output.display())));
        let is = |known: &str| output.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(known));
        match self {
            Self::Character(character) if is("vrm") && !character.is_vrm() => {
                wrong("the character is not a VRM file, so the output cannot be one: name it .glb")
            }
            Self::Character(_) if is("glb") || is("vrm") => Ok(()),
            Self::Character(_) => wrong("expected .glb, or .vrm if the character is a VRM file"),
            Self::Skeleton(_) if is("bvh") => Ok(()),
            Self::Skeleton(_) => wrong("expected .bvh, as the skeleton"),
        }
    }

    /// Refuses sheets of skeletons without a body, and formats other than PNG.
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

/// Returns ARKit's face.
fn arkit() -> Face {
    Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() }
}

/// Refuses a mapping without a body; `help` names an alternative to a mapping file. If the file has meshes
/// without a skin and no bone was found, it has no skeleton that a mapping could name.
fn check(rig: &Rig, mapping: &Mapping, is_bare: bool, help: &str) -> Result<(), String> {
    mapping.check(rig).map_err(|problem| {
        let has_skeleton = is_bare || rig.bones().iter().any(|bone| bone.deforms);
        match has_skeleton || mapping.entries().iter().any(|(_, bones)| !bones.is_empty()) {
            true => format!("{problem}; --mapping FILE says which is which, {help}"),
            false => format!("it has no skeleton that moves a mesh, and no shapes: {RIGGERS}"),
        }
    })
}

/// Returns notes on how bones were found.
fn of_rig(rig: &Rig, mapping: &Mapping) -> Vec<String> {
    let mut notes = Vec::new();
    let first = mapping.entries().into_iter().find_map(|(_, bones)| bones.first().copied());
    if let Some((bone, read)) = first.and_then(|bone| Some((bone, undecorated(rig, bone)?))) {
        let name = &rig.bones()[bone].name;
        notes.push(format!("bone names are read without their common prefix and suffix: `{name}` as `{read}`"));
    }
    let name = |bone: usize| format!("`{}`", rig.bones()[bone].name);
    let others: Vec<_> = other_bodies(rig, mapping).into_iter().map(name).collect();
    if let Some(hips) = mapping.bone(0).filter(|_| !others.is_empty()) {
        let (count, moved, others) = (others.len() + 1, name(hips), others.join(", "));
        notes.push(format!("{count} characters: {moved} moves (bone {hips}); below {others} stays still"));
    }
    notes
}

/// Prints every joint with its bones, and every shape that moves with its source.
fn print(rig: &Rig, mapping: &Mapping, convention: &str, faces: &Faces, face: &Face) {
    println!("{convention}");
    for (joint, bones) in mapping.entries() {
        let names: Vec<_> = bones.iter().map(|&bone| rig.bones()[bone].name.as_str()).collect();
        println!("  {joint:<16} {}", if names.is_empty() { "-".to_owned() } else { names.join(", ") });
    }
    faces.list(face).iter().for_each(|line| println!("{line}"));
}

/// Prints the body of a mapping file: the gain, and the factor of each part with the size that results.
fn print_body(volume: &Volume, gain: f32, given: &Given) {
    println!("[body]\ngain = {gain}");
    for (part, [wide, deep]) in volume.sizes() {
        println!("{part} = {} # {wide:.3} by {deep:.3}", given.girth(part));
    }
}

/// Prints one line about the result, and notes on missing bones and shapes if asked.
fn tell(output: &Path, clip: &Clip, mapping: &Mapping, convention: &str, faces: &Faces, notes: bool) {
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
    if !notes {
        return;
    }
    if !missing.is_empty() {
        eprintln!("note: no bones for {}", missing.join(", "));
    }
    if clip.face.kind != FaceKind::Arkit && faces.shapes() > 0 {
        eprintln!("note: the animation's face has no ARKit channels: shapes stay as they are");
    } else if faces.moved() == 0 && faces.shapes() > 0 {
        eprintln!("note: no known name among the character's {} shapes", faces.shapes());
    }
}
