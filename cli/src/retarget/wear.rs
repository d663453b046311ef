//! A character and its motion for a page.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use umo_core::error::StepError;
use umo_core::glb::Glb;
use umo_core::glb::accessor::floats;
use umo_core::glb::document::Document;
use umo_core::motion::clip::Clip;
use umo_core::motion::pose::Pose;
use umo_core::motion::rotation::{IDENTITY, Quat};
use umo_core::motion::skeleton::JOINTS;
use umo_core::retarget::{Mapping, Retarget, Scratch};

use super::faces::Faces;
use super::mapping::Given;
use super::{Character, is_character, motion, prepare, read};
use crate::failure::Failure;

/// Largest file that a page holds: browsers open it as text, a third longer.
const MAX_BYTES: usize = 256 << 20;

/// What a file may demand of who shows it, and the page does not read.
const UNREAD: &str = "KHR_texture_basisu";

/// A character with an animation, and the node of each of the 55 joints.
pub(crate) struct Worn {
    /// A `.glb` file; its first animation is the motion.
    pub(crate) file: Vec<u8>,
    pub(crate) nodes: [Option<usize>; JOINTS],
    /// Length of the animation.
    pub(crate) seconds: f64,
    /// Of one that follows a stream, the first channel of the animation whose values come with the frames.
    pub(crate) streamed: Option<usize>,
    /// How those values are made of a frame, where the page itself does that.
    pub(crate) follower: Option<serde_json::Value>,
}

/// What turns a stream's frames into values of a character's channels. Any number of threads may use it at once.
pub(crate) struct Follower {
    retarget: Retarget,
    faces: Faces,
}

/// Room for one frame.
pub(crate) struct FollowScratch {
    scratch: Scratch,
    rotations: Vec<Quat>,
}

impl Follower {
    /// Room for one thread.
    pub(crate) fn scratch(&self) -> FollowScratch {
        FollowScratch { scratch: self.retarget.scratch(), rotations: vec![IDENTITY; self.retarget.bones()] }
    }

    /// All that makes those values, for a page that has no program beside it: `page/wearer.js` takes the same steps.
    pub(crate) fn description(&self) -> serde_json::Value {
        serde_json::json!({ "retarget": self.retarget, "faces": self.faces.description() })
    }

    /// Adds a frame's values, channel by channel as the character's animation has them.
    ///
    /// # Errors
    /// A scratch of another character.
    pub(crate) fn add(
        &self,
        room: &mut FollowScratch,
        pose: &Pose,
        face: &[f32],
        values: &mut Vec<f32>,
    ) -> Result<(), StepError> {
        let hips = self.retarget.apply(&mut room.scratch, pose, &mut room.rotations)?;
        let driven = (0..self.retarget.bones()).filter(|&bone| self.retarget.is_driven(bone));
        values.extend(driven.flat_map(|bone| room.rotations[bone]));
        if self.retarget.is_driven(self.retarget.hips()) {
            values.extend(hips);
        }
        values.extend(self.faces.tracks().iter().flat_map(|track| track.weights(face)));
        Ok(())
    }
}

/// Who is to wear a motion: a character that was read, and which bone of it is what.
pub(crate) struct Wearer {
    path: PathBuf,
    character: Character,
    given: Given,
    mapping: Mapping,
}

impl Wearer {
    /// Reads a `.glb`, `.gltf` or `.vrm` file, and a mapping file that goes with it.
    ///
    /// # Errors
    /// A file that is no character, or that a page cannot show; in words, with its name.
    pub(crate) fn read(path: &Path, mapping: Option<&Path>) -> Result<Self, Failure> {
        let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
        let given = mapping.map(Given::read).transpose()?.unwrap_or_default();
        if !is_character(path) {
            let is_bvh = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh"));
            let why = if is_bvh { "a .bvh file has bones and no body: " } else { "" };
            return Err(wrong(format!("{why}expected a character, .glb, .gltf or .vrm")));
        }
        let character = Character::read(read(path)?).map_err(wrong)?;
        let (mapping, _) = character.mapping(&given).map_err(wrong)?;
        let help = "`umo retarget --print-mapping` what was found";
        let checked = super::check(character.rig(), &mapping, false, help);
        checked.map_err(|problem| wrong(format!("it is no character with a body that is known: {problem}")))?;
        shown(character.bytes()).map_err(wrong)?;
        Ok(Self { path: path.to_owned(), character, given, mapping })
    }

    fn wrong(&self, problem: impl std::fmt::Display) -> Failure {
        Failure::input(format!("{}: {problem}", self.path.display()))
    }

    /// Puts a motion on the character, as `umo retarget` does.
    ///
    /// # Errors
    /// What of the character cannot be moved.
    pub(crate) fn wear(self, clip: &Clip) -> Result<Worn, Failure> {
        Ok(self.put_on(clip)?.0)
    }

    /// Makes the character ready for a stream: it stands as `rest`, which is one frame, until frames come.
    ///
    /// # Errors
    /// As [`wear`](Self::wear).
    pub(crate) fn follow(self, rest: &Clip) -> Result<(Worn, Follower), Failure> {
        let (worn, follower) = self.put_on(rest)?;
        let streamed = Some(self.character.held(&follower.retarget));
        Ok((Worn { streamed, ..worn }, follower))
    }

    fn put_on(&self, clip: &Clip) -> Result<(Worn, Follower), Failure> {
        let Self { character, given, mapping, .. } = self;
        let faces = Faces::find(character, mapping, &clip.face, given).map_err(|problem| self.wrong(problem))?;
        let notes = super::of_rig(character.rig(), mapping).into_iter().chain(faces.notes(&clip.face, mapping));
        notes.for_each(|note| eprintln!("note: {}: {note}", self.path.display()));
        let retarget = prepare(&clip.skeleton, character.rig(), mapping, character.floor(mapping));
        let mut retarget = retarget.map_err(|problem| self.wrong(problem))?;
        faces.release_bones(&clip.face, mapping, &mut retarget);
        let motion = motion(&retarget, clip)?;
        let file = character.animated(&retarget, &motion, &faces, clip).map_err(|problem| self.wrong(problem))?;
        let seconds = clip.len().saturating_sub(1) as f64 / f64::from(clip.frame_rate);
        Ok((
            Worn { file, nodes: nodes(mapping), seconds, streamed: None, follower: None },
            Follower { retarget, faces },
        ))
    }

    /// The character with the animation that its file has, such as `umo retarget` writes.
    ///
    /// # Errors
    /// A file that has none.
    pub(crate) fn own_motion(self) -> Result<Worn, Failure> {
        let seconds = length(self.character.bytes()).map_err(|problem| self.wrong(problem))?;
        Ok(Worn {
            nodes: nodes(&self.mapping),
            seconds,
            streamed: None,
            follower: None,
            file: self.character.into_bytes(),
        })
    }
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
    match demands.extensions_required.iter().any(|required| required == UNREAD) {
        true => Err(format!(
            "its textures are compressed in a way that the page does not read, {UNREAD}: \
             export it without, or write PNG by `npx @gltf-transform/cli ktxdecompress in.glb out.glb`"
        )),
        false => Ok(()),
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
