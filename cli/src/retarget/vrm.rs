//! Bones and expressions as VRM files list them, 1.0 and 0.x.

use serde::Deserialize;
use serde_json::{Map, Value};
use umo_core::retarget::{Mapping, RetargetError};

use crate::glb::document::Document;

/// VRM's names for the joints that are one bone each; `{}` is the side. Thumbs are named differently in the two versions.
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

/// An expression, and the shapes that it is made of.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Expression {
    pub(super) name: String,
    /// Node with the mesh, shape, and how much of it at 1.
    pub(super) shapes: Vec<(usize, usize, f32)>,
}

/// The file's table of bones, and its version; none where it is no VRM file.
///
/// # Errors
/// A table that is not as VRM has it.
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

/// VRM's names in a table, and their nodes, as joints and their bones.
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

/// The file's expressions; what of them is not as VRM has it is left out.
pub(super) fn expressions(document: &Document) -> Vec<Expression> {
    let mut found = match (extension(document, "VRMC_vrm"), extension(document, "VRM")) {
        (Some(vrm), _) => expressions_of_1(vrm),
        (None, Some(vrm)) => expressions_of_0(vrm, document),
        (None, None) => Vec::new(),
    };
    let shapes = |node: usize| document.nodes.get(node).and_then(|node| document.meshes.get(node.mesh?));
    for expression in &mut found {
        let is_there = |&(node, shape, share): &(usize, usize, f32)| {
            shapes(node).is_some_and(|mesh| shape < mesh.shapes()) && share.is_finite()
        };
        expression.shapes.retain(is_there);
    }
    found.retain(|expression| !expression.shapes.is_empty());
    found
}

fn expressions_of_1(vrm: &Value) -> Vec<Expression> {
    #[derive(Deserialize)]
    struct Bind {
        node: usize,
        index: usize,
        weight: f32,
    }
    let lists = ["/expressions/preset", "/expressions/custom"].into_iter();
    let all = lists.filter_map(|list| vrm.pointer(list)?.as_object()).flat_map(Map::iter);
    let expression = |(name, value): (&String, &Value)| {
        let binds = Vec::<Bind>::deserialize(value.get("morphTargetBinds")?).ok()?;
        let shapes = binds.iter().map(|bind| (bind.node, bind.index, bind.weight)).collect();
        Some(Expression { name: name.clone(), shapes })
    };
    all.filter_map(expression).collect()
}

fn expressions_of_0(vrm: &Value, document: &Document) -> Vec<Expression> {
    #[derive(Deserialize)]
    struct Bind {
        mesh: usize,
        index: usize,
        weight: f32,
    }
    #[derive(Default, Deserialize)]
    #[serde(rename_all = "camelCase", default)]
    struct Group {
        name: String,
        preset_name: String,
        binds: Vec<Value>,
    }
    let groups = vrm.pointer("/blendShapeMaster/blendShapeGroups").and_then(Value::as_array);
    let expression = |group: &Value| {
        let group = Group::deserialize(group).ok()?;
        let known = !group.preset_name.is_empty() && group.preset_name != "unknown";
        let binds = group.binds.iter().filter_map(|bind| Bind::deserialize(bind).ok());
        let nodes =
            |mesh: usize| (0..document.nodes.len()).filter(move |&node| document.nodes[node].mesh == Some(mesh));
        let shapes = binds.flat_map(|bind| nodes(bind.mesh).map(move |node| (node, bind.index, bind.weight / 100.0)));
        Some(Expression { name: if known { group.preset_name } else { group.name }, shapes: shapes.collect() })
    };
    groups.into_iter().flatten().filter_map(expression).collect()
}
