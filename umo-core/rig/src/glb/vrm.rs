//! The bone table of VRM files, 1.0 and 0.x.

use serde::Deserialize;
use serde_json::Value;

use super::document::Document;
use crate::retarget::{Mapping, RetargetError};

/// VRM's names of the joints that have a single bone; sided names are given without the side. Thumbs are named
/// differently in the two versions.
const BODY: [(&str, &str); 3] = [("hips", "pelvis"), ("head", "head"), ("jaw", "jaw")];
const SIDED: [(&str, &str); 9] = [
    ("Shoulder", "collar"),
    ("UpperArm", "shoulder"),
    ("LowerArm", "elbow"),
    ("Hand", "wrist"),
    ("UpperLeg", "hip"),
    ("LowerLeg", "knee"),
    ("Foot", "ankle"),
    ("Toes", "foot"),
    ("Eye", "eye"),
];
const FINGERS: [(&str, &str); 5] =
    [("Index", "index"), ("Middle", "middle"), ("Little", "pinky"), ("Ring", "ring"), ("Thumb", "thumb")];
const BONES: [&str; 3] = ["Proximal", "Intermediate", "Distal"];
const THUMB_OF_1: [&str; 3] = ["Metacarpal", "Proximal", "Distal"];

/// Whether a file is a VRM file of either version.
pub(super) fn is_vrm(document: &Document) -> bool {
    ["VRMC_vrm", "VRM"].iter().any(|name| extension(document, name).is_some())
}

/// Returns the mapping of the file's bone table, and its version; `None` if it is not a VRM file.
///
/// # Errors
/// The table violates the VRM specification.
pub(super) fn bones(document: &Document) -> Result<Option<(Mapping, &'static str)>, String> {
    let (table, version) = match (extension(document, "VRMC_vrm"), extension(document, "VRM")) {
        (Some(vrm), _) => (table_of_1(vrm)?, "VRM 1.0"),
        (None, Some(vrm)) => (table_of_0(vrm)?, "VRM 0.x"),
        (None, None) => return Ok(None),
    };
    if let Some((name, node)) = table.iter().find(|(_, node)| *node >= document.nodes.len()) {
        return Err(format!("{version}: bone `{name}`: there is no node {node}"));
    }
    let thumbs = if version == "VRM 1.0" { THUMB_OF_1 } else { BONES };
    let mapping = mapping(&table, thumbs).map_err(|error| error.to_string())?;
    Ok(Some((mapping, version)))
}

/// Converts a table of VRM's names and their nodes to a mapping.
fn mapping(table: &[(String, usize)], thumbs: [&str; 3]) -> Result<Mapping, RetargetError> {
    let find = |name: &&str| table.iter().find(|(known, _)| known == name).map(|(_, node)| *node);
    let mut mapping = Mapping::default();
    let mut put = |joint: &str, names: &[&str]| {
        let found: Vec<_> = names.iter().filter_map(find).collect();
        if found.is_empty() { Ok(()) } else { mapping.put(joint, &found) }
    };
    put("spine", &["spine", "chest", "upperChest"])?;
    put("neck", &["neck"])?;
    for (name, joint) in BODY {
        put(joint, &[name])?;
    }
    for side in ["left", "right"] {
        for (name, joint) in SIDED {
            put(&format!("{side}_{joint}"), &[format!("{side}{name}").as_str()])?;
        }
        for (finger, joint) in FINGERS {
            let bones = if finger == "Thumb" { thumbs } else { BONES };
            for (number, bone) in (1..).zip(bones) {
                put(&format!("{side}_{joint}{number}"), &[format!("{side}{finger}{bone}").as_str()])?;
            }
        }
    }
    Ok(mapping)
}

fn extension<'a>(document: &'a Document, name: &str) -> Option<&'a Value> {
    document.extensions.get(name)
}

/// `humanBones: { "hips": { "node": 1 }, … }`
fn table_of_1(vrm: &Value) -> Result<Vec<(String, usize)>, String> {
    #[derive(Deserialize)]
    struct Bone {
        node: usize,
    }
    let bones = vrm.pointer("/humanoid/humanBones").and_then(Value::as_object);
    let bones = bones.ok_or("VRM 1.0: it has no `humanoid.humanBones`")?;
    let bone = |(name, bone): (&String, &Value)| match Bone::deserialize(bone) {
        Ok(bone) => Ok((name.clone(), bone.node)),
        Err(error) => Err(format!("VRM 1.0: bone `{name}`: {error}")),
    };
    bones.iter().map(bone).collect()
}

/// `humanBones: [ { "bone": "hips", "node": 1 }, … ]`
fn table_of_0(vrm: &Value) -> Result<Vec<(String, usize)>, String> {
    #[derive(Deserialize)]
    struct Bone {
        bone: String,
        node: usize,
    }
    let bones = vrm.pointer("/humanoid/humanBones").and_then(Value::as_array);
    let bones = bones.ok_or("VRM 0.x: it has no `humanoid.humanBones`")?;
    let bone = |bone: &Value| match Bone::deserialize(bone) {
        Ok(bone) => Ok((bone.bone, bone.node)),
        Err(error) => Err(format!("VRM 0.x: a bone: {error}")),
    };
    bones.iter().map(bone).collect()
}
