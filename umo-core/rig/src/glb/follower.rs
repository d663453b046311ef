//! A character that follows a stream of poses.

use serde::Deserialize;
use umo_core_base::error::StepError;
use umo_core_pose::face::{Face, FaceKind};
use umo_core_pose::pose::Pose;
use umo_core_pose::rotation::{IDENTITY, Quat};
use umo_core_pose::skeleton::{JOINTS, Skeleton};

use super::{Character, Faces, Given};
use crate::retarget::{Floor, Mapping, Retarget, Scratch};

/// Converts poses to values of a character's nodes. Threads can share it.
#[derive(Debug)]
pub struct Follower {
    retarget: Retarget,
    faces: Faces,
}

/// Scratch memory for one frame.
#[derive(Debug)]
pub struct FollowScratch {
    scratch: Scratch,
    rotations: Vec<Quat>,
}

impl FollowScratch {
    /// Sets the time from the last pose to the next, as [`Scratch::set_step`].
    pub fn set_step(&mut self, seconds: f32) {
        self.scratch.set_step(seconds);
    }
}

/// The source of the poses, and a mapping, in JSON.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Source {
    skeleton: Skeleton,
    face: Face,
    #[serde(default)]
    given: Given,
}

impl Follower {
    /// Creates a follower for a character with this mapping, and poses of this skeleton and face.
    ///
    /// # Errors
    /// The character's skeleton is rejected, or a shape or channel of `given` does not exist.
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
        if let Some((volume, gain)) = character.volume(mapping, given)? {
            let set = retarget.set_volume(character.rig(), mapping, &volume, gain);
            set.map_err(|error| error.to_string())?;
        }
        Ok(Self { retarget, faces })
    }

    /// Creates a follower for a `.glb` file. The rest is JSON: `{ "skeleton": { "parents", "offsets_m" }, "face": {
    /// "kind", "names" }, "given": { "bones", "face" } }`, in the format of a model's config and of a mapping file.
    /// The second result describes the values that [`add`](Self::add) writes, as JSON:
    ///
    /// | key | value |
    /// | --- | --- |
    /// | `convention` | naming convention of the bones |
    /// | `bones` | nodes of each joint, `spine` and `neck`; empty if it has none |
    /// | `nodes` | node of each of the 55 joints, or null |
    /// | `held` | node, path and value of the bind pose where it differs from the file |
    /// | `driven` | nodes that rotate |
    /// | `hips` | node that is translated, or null |
    /// | `tracks` | for each node whose shapes move: `node`, number of its shapes, those that channels `moved` |
    /// | `expressions` | VRM expressions that move |
    /// | `still` | face channels that move no shape |
    /// | `speaks` | whether any shape opens the mouth |
    /// | `channels` | number of face channels |
    ///
    /// # Errors
    /// The file is not a character, the JSON is invalid, or as for [`new`](Self::new).
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
            "nodes": nodes(&mapping).as_slice(),
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

    /// Retargeting of the bones.
    pub fn retarget(&self) -> &Retarget {
        &self.retarget
    }

    /// Shapes that move.
    pub fn faces(&self) -> &Faces {
        &self.faces
    }

    /// Nodes that rotate, in ascending order.
    fn driven(&self) -> impl Iterator<Item = usize> {
        (0..self.retarget.bones()).filter(|&bone| self.retarget.is_driven(bone))
    }

    /// The node that is translated; `None` for a head without a body.
    fn hips(&self) -> Option<usize> {
        Some(self.retarget.hips()).filter(|&hips| self.retarget.is_driven(hips))
    }

    /// Returns scratch memory of one avatar.
    pub fn scratch(&self) -> FollowScratch {
        FollowScratch { scratch: self.retarget.scratch(), rotations: vec![IDENTITY; self.retarget.bones()] }
    }

    /// Appends a frame's values: rotations of the driven nodes, translation of the hips, weights of each node's
    /// shapes.
    ///
    /// # Errors
    /// The scratch memory is another character's.
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

/// Returns the node of each joint. If a spine or neck has another number of bones, the bone at the same fraction of
/// the chain.
pub fn nodes(mapping: &Mapping) -> [Option<usize>; JOINTS] {
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

#[cfg(test)]
mod tests {
    use umo_core_pose::skeleton::ARKIT_NAMES;

    use super::*;

    /// Bones of a standing figure in a T-pose, as `(name, parent, place)`.
    const BONES: [(&str, Option<usize>, [f32; 3]); 15] = [
        ("Hips", None, [0.0, 1.0, 0.0]),
        ("Spine", Some(0), [0.0, 0.2, 0.0]),
        ("Head", Some(1), [0.0, 0.4, 0.0]),
        ("LeftArm", Some(1), [0.2, 0.3, 0.0]),
        ("LeftForeArm", Some(3), [0.3, 0.0, 0.0]),
        ("LeftHand", Some(4), [0.25, 0.0, 0.0]),
        ("RightArm", Some(1), [-0.2, 0.3, 0.0]),
        ("RightForeArm", Some(6), [-0.3, 0.0, 0.0]),
        ("RightHand", Some(7), [-0.25, 0.0, 0.0]),
        ("LeftUpLeg", Some(0), [0.1, -0.05, 0.0]),
        ("LeftLeg", Some(9), [0.0, -0.45, 0.0]),
        ("LeftFoot", Some(10), [0.0, -0.42, 0.0]),
        ("RightUpLeg", Some(0), [-0.1, -0.05, 0.0]),
        ("RightLeg", Some(12), [0.0, -0.45, 0.0]),
        ("RightFoot", Some(13), [0.0, -0.42, 0.0]),
    ];

    /// A `.glb` file with these bones, and a mesh with these shapes.
    fn file(shapes: &[&str]) -> Vec<u8> {
        let child = |parent: usize| (0..BONES.len()).filter(move |&at| BONES[at].1 == Some(parent));
        let mut nodes: Vec<_> = (0..BONES.len())
            .map(|at| serde_json::json!({ "name": BONES[at].0, "translation": BONES[at].2, "children": child(at).collect::<Vec<_>>() }))
            .collect();
        nodes.push(serde_json::json!({ "name": "Face", "mesh": 0 }));
        let targets = vec![serde_json::json!({}); shapes.len()];
        let mesh = serde_json::json!({ "primitives": [{ "targets": targets }], "extras": { "targetNames": shapes } });
        let mut json = serde_json::json!({ "nodes": nodes, "meshes": [mesh] }).to_string().into_bytes();
        json.resize(json.len().next_multiple_of(4), b' ');
        let word = |length: usize| u32::try_from(length).unwrap().to_le_bytes();
        [b"glTF", &word(2), &word(20 + json.len()), &word(json.len()), b"JSON", &json[..]].concat()
    }

    fn source(given: &str) -> String {
        let skeleton = Skeleton {
            parents: vec![
                -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26, 20,
                28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
            ],
            offsets_m: (0..JOINTS)
                .map(|joint| match joint {
                    1 | 2 => [if joint == 1 { 0.09 } else { -0.09 }, -0.08, 0.0],
                    4 | 5 | 7 | 8 => [0.0, -0.4, 0.0],
                    10 | 11 => [0.0, -0.06, 0.13],
                    _ if [14, 17, 19, 21].contains(&joint) || joint >= 40 => [-0.15, 0.0, 0.0],
                    _ if [13, 16, 18, 20].contains(&joint) || joint >= 25 => [0.15, 0.0, 0.0],
                    _ => [0.0, 0.13, 0.0],
                })
                .collect(),
        };
        let face = Face { kind: FaceKind::Arkit, names: ARKIT_NAMES.map(str::to_owned).to_vec() };
        let given: serde_json::Value = serde_json::from_str(given).unwrap();
        serde_json::json!({ "skeleton": skeleton, "face": face, "given": given }).to_string()
    }

    #[test]
    fn a_file_is_described_and_followed() {
        let (follower, said) = Follower::read(&file(&["jawOpen", "smile"]), &source("{}")).unwrap();
        assert_eq!(said["driven"].as_array().unwrap().len(), 15);
        assert_eq!((&said["hips"], &said["speaks"]), (&0.into(), &true.into()));
        assert_eq!(said["bones"]["left_elbow"], serde_json::json!([4]));
        assert_eq!(said["bones"]["left_index1"], serde_json::json!([]));
        assert_eq!(said["nodes"][3], 1);
        assert_eq!(said["tracks"], serde_json::json!([{ "node": 15, "count": 2, "moved": [0] }]));
        assert_eq!(said["still"].as_array().unwrap().len(), ARKIT_NAMES.len() - 1);
        let mut values = Vec::new();
        let mut face = [0.0; ARKIT_NAMES.len()];
        face[ARKIT_NAMES.iter().position(|&name| name == "jawOpen").unwrap()] = 0.5;
        follower.add(&mut follower.scratch(), &Pose::REST, &face, &mut values).unwrap();
        assert_eq!(values.len(), 4 * 15 + 3 + 2);
        // A source at rest leaves a character in a T-pose unchanged, on its own floor.
        for rotation in values[..60].as_chunks::<4>().0 {
            assert!((rotation[3].abs() - 1.0).abs() < 1e-4, "{rotation:?}");
        }
        assert_eq!(values[63..], [0.5, 0.0]);
        // The hips rise by the source's displacement, scaled by leg length.
        let mut higher = Vec::new();
        let pose = Pose { translation: [0.0, 0.1, 0.0], ..Pose::REST };
        follower.add(&mut follower.scratch(), &pose, &face, &mut higher).unwrap();
        let rise = higher[61] - values[61];
        assert!((rise - 0.1 * follower.retarget().scale()).abs() < 1e-4, "{rise}");
    }

    #[test]
    fn bones_and_shapes_are_given_by_name_or_number() {
        let given = r#"{ "bones": { "left_elbow": 5, "left_wrist": "" }, "face": { "mouthPucker": "smile" } }"#;
        let (_, said) = Follower::read(&file(&["jawOpen", "smile"]), &source(given)).unwrap();
        assert_eq!(
            (&said["bones"]["left_elbow"], &said["bones"]["left_wrist"]),
            (&serde_json::json!([5]), &serde_json::json!([]))
        );
        assert_eq!(said["tracks"][0]["moved"], serde_json::json!([0, 1]));
        for (given, problem) in [
            (r#"{ "bones": { "left_elbow": 99 } }"#, "node 99"),
            (r#"{ "bones": { "tail": 3 } }"#, "tail"),
            (r#"{ "face": { "jawOpen": "none" } }"#, "none"),
        ] {
            let error = Follower::read(&file(&["smile"]), &source(given)).unwrap_err();
            assert!(error.contains(problem), "{given}: {error}");
        }
        assert!(Follower::read(b"glTF", &source("{}")).is_err());
        assert!(Follower::read(&file(&[]), "{}").unwrap_err().contains("skeleton"));
    }
}
