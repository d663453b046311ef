//! A character and its motion for the viewer page.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use umo_core::{JOINTS, Mapping};
use umo_core_pose::clip::Clip;
use umo_core_rig::glb::accessor::floats;
use umo_core_rig::glb::document::Document;
use umo_core_rig::glb::{Follower, Given, Glb, nodes};

use super::{Character, is_character, mapping, motion, read};
use crate::failure::Failure;

/// Upper bound on a file embedded in a page; browsers load it as base64, which is a third longer.
const MAX_BYTES: usize = 256 << 20;

/// Extension that the page does not support, although a file may require it.
const UNREAD: &str = "KHR_texture_basisu";

/// A character with an animation, and the node of each of the 55 joints.
pub(crate) struct Worn {
    /// A `.glb` file whose first animation is the motion.
    pub(crate) file: Vec<u8>,
    pub(crate) nodes: [Option<usize>; JOINTS],
    /// Length of the animation.
    pub(crate) seconds: f64,
    /// For a streamed motion, the first animation channel whose values come with the frames.
    pub(crate) streamed: Option<usize>,
    /// The mapping, if the page computes those values from the frames.
    pub(crate) given: Option<Given>,
}

/// A character that can wear a motion, with the mapping of its bones.
pub(crate) struct Wearer {
    path: PathBuf,
    character: Character,
    given: Given,
    mapping: Mapping,
}

impl Wearer {
    /// Reads a `.glb`, `.gltf` or `.vrm` file and an optional mapping file.
    ///
    /// # Errors
    /// If the file is not a character or the page cannot show it; the message names the file.
    pub(crate) fn read(path: &Path, mapping: Option<&Path>) -> Result<Self, Failure> {
        let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
        let given = mapping.map(mapping::read).transpose()?.unwrap_or_default();
        if !is_character(path) {
            let is_bvh = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("bvh"));
            let why = if is_bvh { "a .bvh file has bones and no body: " } else { "" };
            return Err(wrong(format!("{why}expected a character, .glb, .gltf or .vrm")));
        }
        Self::of(path, read(path)?, given)
    }

    /// Reads a character from the bytes of a `.glb` or `.vrm` file.
    ///
    /// # Errors
    /// See [`read`](Self::read).
    #[cfg(feature = "serve")]
    pub(crate) fn dropped(file: Vec<u8>) -> Result<Self, Failure> {
        Self::of(Path::new("the character"), file, Given::default())
    }

    fn of(path: &Path, file: Vec<u8>, given: Given) -> Result<Self, Failure> {
        let wrong = |problem: String| Failure::input(format!("{}: {problem}", path.display()));
        let character = Character::read(file).map_err(wrong)?;
        let (mapping, _) = character.mapping(&given).map_err(wrong)?;
        let help = "`umo retarget --print-mapping` prints what was found";
        let checked = super::check(character.rig(), &mapping, false, help);
        checked.map_err(|problem| wrong(format!("no recognised humanoid skeleton: {problem}")))?;
        shown(character.bytes()).map_err(wrong)?;
        Ok(Self { path: path.to_owned(), character, given, mapping })
    }

    fn wrong(&self, problem: impl std::fmt::Display) -> Failure {
        Failure::input(format!("{}: {problem}", self.path.display()))
    }

    /// Retargets a motion to the character, as `umo retarget` does.
    ///
    /// # Errors
    /// If the character cannot be moved.
    pub(crate) fn wear(self, clip: &Clip) -> Result<Worn, Failure> {
        Ok(self.put_on(clip)?.0)
    }

    /// Prepares the character for a stream: it holds the single frame `rest` until frames come.
    ///
    /// # Errors
    /// See [`wear`](Self::wear).
    pub(crate) fn follow(self, rest: &Clip) -> Result<(Worn, Follower), Failure> {
        let (worn, follower) = self.put_on(rest)?;
        let streamed = Some(self.character.placed(follower.retarget()).count());
        Ok((Worn { streamed, given: Some(self.given), ..worn }, follower))
    }

    fn put_on(&self, clip: &Clip) -> Result<(Worn, Follower), Failure> {
        let Self { character, given, mapping, .. } = self;
        let floor = character.floor(mapping);
        let follower = Follower::new(character, mapping, given, (&clip.skeleton, &clip.face), floor);
        let follower = follower.map_err(|problem| self.wrong(problem))?;
        let (retarget, faces) = (follower.retarget(), follower.faces());
        let notes = super::of_rig(character.rig(), mapping).into_iter().chain(faces.notes(&clip.face, mapping));
        notes.for_each(|note| eprintln!("note: {}: {note}", self.path.display()));
        let motion = motion(retarget, clip)?;
        let file = character.animated(retarget, &motion, faces, clip).map_err(|problem| self.wrong(problem))?;
        let seconds = clip.len().saturating_sub(1) as f64 / f64::from(clip.frame_rate);
        Ok((Worn { file, nodes: nodes(mapping), seconds, streamed: None, given: None }, follower))
    }

    /// Returns the character with its own animation, such as one written by `umo retarget`.
    ///
    /// # Errors
    /// If the file has no animation.
    pub(crate) fn own_motion(self) -> Result<Worn, Failure> {
        let seconds = length(self.character.bytes()).map_err(|problem| self.wrong(problem))?;
        Ok(Worn {
            nodes: nodes(&self.mapping),
            seconds,
            streamed: None,
            given: None,
            file: self.character.into_bytes(),
        })
    }
}

/// Refuses files that the page cannot show.
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
        return Err("it has bones and no body: it lacks a mesh to show".to_owned());
    }
    match demands.extensions_required.iter().any(|required| required == UNREAD) {
        true => Err(format!(
            "its textures are compressed in a way that the page does not read, {UNREAD}: \
             export it without, or write PNG by `npx @gltf-transform/cli ktxdecompress in.glb out.glb`"
        )),
        false => Ok(()),
    }
}

/// Returns the length of a file's first animation, seconds.
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
