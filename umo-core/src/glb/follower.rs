//! A character that follows poses as they come.

use serde::Deserialize;

use super::{Character, Faces, Given};
use crate::config::{Face, FaceKind, Skeleton};
use crate::error::StepError;
use crate::motion::pose::Pose;
use crate::motion::rotation::{IDENTITY, Quat};
use crate::retarget::{Floor, Mapping, Retarget, Scratch};

/// Turns poses into values of a character's nodes. Any number of threads may use it at once.
#[derive(Debug)]
pub struct Follower {
    retarget: Retarget,
    faces: Faces,
}

/// Room for one frame.
#[derive(Debug)]
pub struct FollowScratch {
    scratch: Scratch,
    rotations: Vec<Quat>,
}

/// The source of the poses, and a mapping, as JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Source {
    skeleton: Skeleton,
    face: Face,
    #[serde(default)]
    given: Given,
}

impl Follower {
    /// For a character whose bones are `mapping`'s, and poses of a skeleton and a face.
    ///
    /// # Errors
    /// What of the character cannot be moved; a shape or a channel of `given` that is not there.
    pub fn new(
        character: &Character,
        mapping: &Mapping,
        given: &Given,
        (skeleton, face): (&Skeleton, &Face),
        floor: Floor,
    ) -> Result<Self, String> {
        let faces = Faces::find(character, mapping, face, given)?;
        let retarget = Retarget::new(skeleton, character.rig(), mapping, floor);
        let mut retarget = retarget.map_err(|error| error.to_string())?;
        faces.release_bones(face, mapping, &mut retarget);
        Ok(Self { retarget, faces })
    }

    /// For a `.glb` file, and the rest in JSON: `{ "skeleton": { "parents", "offsets_m" }, "face":
    /// { "kind", "names" }, "given": { "bones", "face" } }`, as a model's config and a mapping file
    /// have them. The second result describes the values that [`add`](Self::add) writes, as JSON:
    ///
    /// | key | value |
    /// | --- | --- |
    /// | `convention` | the convention of the bones' names |
    /// | `bones` | for each joint, `spine` and `neck` its nodes; empty where it has none |
    /// | `nodes` | the node of each of the 55 joints, or null |
    /// | `held` | node, path and value of what the bind pose has elsewhere than the file |
    /// | `driven` | the nodes that turn |
    /// | `hips` | the node that moves, or null |
    /// | `tracks` | of each node whose shapes move: `node`, the count of its shapes, those that channels `moved` |
    /// | `expressions` | the VRM expressions that move |
    /// | `still` | the face channels that move no shape |
    /// | `speaks` | whether some shape opens the mouth |
    /// | `channels` | the number of face channels |
    ///
    /// # Errors
    /// A file that is no character; as [`new`](Self::new); JSON of another form.
    pub fn read(file: &[u8], source: &str) -> Result<(Self, serde_json::Value), String> {
        let Source { skeleton, face, given } = serde_json::from_str(source).map_err(|error| error.to_string())?;
        let character = Character::read(file)?;
        let (mapping, convention) = character.mapping(&given)?;
        mapping.check(character.rig()).map_err(|error| error.to_string())?;
        let follower = Self::new(&character, &mapping, &given, (&skeleton, &face), Floor::AtRest)?;
        let Self { retarget, faces } = &follower;
        let track = |track: &super::faces::Track<'_>| serde_json::json!({ "node": track.node(), "count": track.len(), "moved": track.moved() });
        let rest = vec![0.0; face.names.len()];
        let still = face.names.iter().filter(|name| !faces.drives(&face, name));
        let description = serde_json::json!({
            "convention": convention,
            "bones": mapping.entries().into_iter().collect::<std::collections::BTreeMap<_, _>>(),
            "nodes": mapping.nodes().as_slice(),
            "held": character.placed(retarget).collect::<Vec<_>>(),
            "driven": follower.driven().collect::<Vec<_>>(),
            "hips": follower.hips(),
            "tracks": faces.tracks().iter().map(track).collect::<Vec<_>>(),
            "expressions": faces.expressions(&rest).map(|(name, _)| name).collect::<Vec<_>>(),
            "still": if face.kind == FaceKind::Arkit { still.collect() } else { Vec::new() },
            "speaks": faces.opens_mouth(&face),
            "channels": face.names.len(),
        });
        Ok((follower, description))
    }

    /// The motion of the bones.
    pub fn retarget(&self) -> &Retarget {
        &self.retarget
    }

    /// The shapes that move.
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// The nodes that turn, in order.
    fn driven(&self) -> impl Iterator<Item = usize> {
        (0..self.retarget.bones()).filter(|&bone| self.retarget.is_driven(bone))
    }

    /// The node that moves; none of a head without a body.
    fn hips(&self) -> Option<usize> {
        Some(self.retarget.hips()).filter(|&hips| self.retarget.is_driven(hips))
    }

    /// Room for one thread.
    pub fn scratch(&self) -> FollowScratch {
        FollowScratch { scratch: self.retarget.scratch(), rotations: vec![IDENTITY; self.retarget.bones()] }
    }

    /// Adds a frame's values: rotations of the nodes that turn, the place of the hips, the weights
    /// of each node's shapes.
    ///
    /// # Errors
    /// A scratch of another character.
    pub fn add(
        &self,
        room: &mut FollowScratch,
        pose: &Pose,
        face: &[f32],
        values: &mut Vec<f32>,
    ) -> Result<(), StepError> {
        let hips = self.retarget.apply(&mut room.scratch, pose, &mut room.rotations)?;
        values.extend(self.driven().flat_map(|bone| room.rotations[bone]));
        values.extend(self.hips().map(|_| hips).into_iter().flatten());
        values.extend(self.faces.tracks().iter().flat_map(|track| track.weights(face)));
        Ok(())
    }
}
