//! Characters built in code: a skinned triangle with three shapes, a texture and an animation.

use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};
use umo_core::{FaceKind, JOINT_NAMES, JOINTS, Quat};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, inverse, product, rotate};

use super::Vector;
use umo_figure::sample;

/// A PNG of one pixel.
#[rustfmt::skip]
const PNG: [u8; 69] = [
    0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48, 0x44, 0x52, 0x00, 0x00, 0x00, 0x01,
    0x00, 0x00, 0x00, 0x01, 0x08, 0x02, 0x00, 0x00, 0x00, 0x90, 0x77, 0x53, 0xde, 0x00, 0x00, 0x00, 0x0c, 0x49, 0x44, 0x41,
    0x54, 0x78, 0xda, 0x63, 0x38, 0xd0, 0x50, 0x00, 0x00, 0x03, 0xb4, 0x01, 0xb1, 0x7a, 0x64, 0xa8, 0x51, 0x00, 0x00, 0x00,
    0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82,
];

/// A file's contents, which tests may change.
#[derive(Clone)]
pub(super) struct Made {
    pub(super) json: Value,
    pub(super) bin: Vec<u8>,
    names: Vec<String>,
}

impl Made {
    /// Returns the name of a joint's node.
    pub(super) fn name(&self, joint: usize) -> String {
        self.names[joint].clone()
    }

    /// Returns the node with a name.
    pub(super) fn index(&self, name: &str) -> usize {
        let mut nodes = self.json["nodes"].as_array().unwrap().iter();
        nodes.position(|node| node["name"] == name).unwrap()
    }

    /// Returns a node's translation relative to its parent.
    pub(super) fn translation(&self, node: usize) -> [f64; 3] {
        serde_json::from_value(self.json["nodes"][node]["translation"].clone()).unwrap()
    }

    /// Adds inverse bind matrices of the nodes' current pose, for a mesh in a space that `frame` maps to the scene.
    pub(super) fn bind(&mut self, frame: DMat4) {
        let nodes = self.json["nodes"].as_array().unwrap();
        let mut global = vec![DMat4::IDENTITY; nodes.len()];
        // Files built here have parents first.
        for (at, node) in nodes.iter().enumerate() {
            global[at] *= local(node);
            for child in node["children"].as_array().into_iter().flatten() {
                global[usize::try_from(child.as_u64().unwrap()).unwrap()] = global[at];
            }
        }
        let joints: Vec<usize> = serde_json::from_value(self.json["skins"][0]["joints"].clone()).unwrap();
        let matrices = joints.iter().map(|&joint| (global[joint].inverse() * frame).as_mat4().to_cols_array());
        let bytes: Vec<u8> = matrices.flatten().flat_map(f32::to_le_bytes).collect();
        let list = |json: &mut Value, name: &str, value: Value| {
            let list = json[name].as_array_mut().unwrap();
            list.push(value);
            list.len() - 1
        };
        let view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        let view = list(&mut self.json, "bufferViews", view);
        let accessor = json!({ "bufferView": view, "componentType": 5126, "count": joints.len(), "type": "MAT4" });
        self.json["skins"][0]["inverseBindMatrices"] = list(&mut self.json, "accessors", accessor).into();
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = self.bin.len().into();
    }

    /// Rotates every joint and moves the first one, like some moment of an animation.
    pub(super) fn pose(&mut self, turn: f64, step: [f64; 3]) {
        let joints: Vec<usize> = serde_json::from_value(self.json["skins"][0]["joints"].clone()).unwrap();
        for &joint in &joints {
            let node = &mut self.json["nodes"][joint];
            let angles = [1.0, 0.7, 0.4].map(|share| turn * (share * joint as f64).sin());
            let (_, rotation, mut place) = local(node).to_scale_rotation_translation();
            if joint == joints[0] {
                place += DVec3::from_array(step);
            }
            let rotation = rotation * DQuat::from_scaled_axis(DVec3::from_array(angles));
            node["rotation"] = json!(rotation.to_array());
            node["translation"] = json!(place.to_array());
        }
    }

    /// Returns the `.glb` file.
    pub(super) fn bytes(&self) -> Vec<u8> {
        let mut text = serde_json::to_vec(&self.json).unwrap();
        text.resize(text.len().next_multiple_of(4), b' ');
        let mut out = b"glTF".to_vec();
        let chunks: &[(&[u8; 4], &[u8])] = match self.bin.is_empty() {
            true => &[(b"JSON", &text)],
            false => &[(b"JSON", &text), (b"BIN\0", &self.bin)],
        };
        let total: usize = 12 + chunks.iter().map(|(_, chunk)| 8 + chunk.len()).sum::<usize>();
        out.extend(2_u32.to_le_bytes());
        out.extend(u32::try_from(total).unwrap().to_le_bytes());
        for (kind, chunk) in chunks {
            out.extend(u32::try_from(chunk.len()).unwrap().to_le_bytes());
            out.extend(*kind);
            out.extend(*chunk);
        }
        out
    }
}

/// Returns a node's local transform.
fn local(node: &Value) -> DMat4 {
    let read = |name: &str, other: &[f64]| serde_json::from_value(node[name].clone()).unwrap_or(other.to_vec());
    let vector = |name: &str, other: &[f64]| DVec3::from_slice(&read(name, other));
    let rotation = DQuat::from_slice(&read("rotation", &[0.0, 0.0, 0.0, 1.0]));
    DMat4::from_scale_rotation_translation(vector("scale", &[1.0; 3]), rotation, vector("translation", &[0.0; 3]))
}

/// A buffer under construction: each piece has a view and an accessor.
#[derive(Default)]
struct Buffer {
    bin: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
}

impl Buffer {
    fn view(&mut self, bytes: &[u8], target: Option<u32>) -> usize {
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if let Some(target) = target {
            view["target"] = target.into();
        }
        self.bin.extend(bytes);
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(view);
        self.views.len() - 1
    }

    fn floats(&mut self, values: &[f32], kind: &str, vertices: bool) -> usize {
        let width = match kind {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            _ => 4,
        };
        let bytes: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let view = self.view(&bytes, vertices.then_some(34962));
        let bound = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
            (0..width).map(|i| values.iter().skip(i).step_by(width).copied().reduce(pick).unwrap()).collect()
        };
        self.accessors.push(json!({
            "bufferView": view, "componentType": 5126, "count": values.len() / width, "type": kind,
            "min": bound(f32::min), "max": bound(f32::max),
        }));
        self.accessors.len() - 1
    }

    fn joints(&mut self, joints: &[u8]) -> usize {
        let view = self.view(joints, Some(34962));
        self.accessors
            .push(json!({ "bufferView": view, "componentType": 5121, "count": joints.len() / 4, "type": "VEC4" }));
        self.accessors.len() - 1
    }
}

/// Construction parameters of a body.
struct BodySpec {
    names: Vec<String>,
    shapes: [&'static str; 3],
    /// Facing direction of the body.
    world: Quat,
    /// Units per metre, below a first node that scales them back.
    unit: f32,
    /// Angle of the arms below a T-pose.
    droop: f32,
    /// Rotation of the bones' axes.
    twist: f32,
}

impl BodySpec {
    fn made(self) -> Made {
        let skeleton = sample::clip(FaceKind::Arkit, 1, 0).skeleton;
        let parent = |joint: usize| usize::try_from(skeleton.parents[joint]).ok();
        let mut places: Vec<Vector> = Vec::new();
        for joint in 0..JOINTS {
            let below = |above: usize| std::iter::successors(Some(joint), |&j| parent(j)).skip(1).any(|j| j == above);
            let side = if below(16) {
                -1.0
            } else if below(17) {
                1.0
            } else {
                0.0
            };
            let turned = rotate(axis_angle_to_quat([0.0, 0.0, side * self.droop]), skeleton.offsets_m[joint]);
            let step = rotate(self.world, turned);
            let from = parent(joint).map_or([0.0, 1.3, 0.0], |parent| places[parent]);
            places.push(std::array::from_fn(|i| from[i] + step[i]));
        }
        let turned = |joint: usize| {
            let [a, b] = [joint as f32, 0.7 * joint as f32].map(f32::sin);
            axis_angle_to_quat([self.twist * a, self.twist * b, 0.5 * self.twist])
        };
        let mut nodes = vec![json!({ "name": "Armature", "scale": vec![1.0 / self.unit; 3], "children": [1] })];
        for joint in 0..JOINTS {
            let (from, above) = parent(joint).map_or(([0.0; 3], IDENTITY), |parent| (places[parent], turned(parent)));
            let apart = std::array::from_fn(|i| (places[joint][i] - from[i]) * self.unit);
            let mut node = json!({
                "name": self.names[joint],
                "translation": rotate(inverse(above), apart),
                "rotation": product(inverse(above), turned(joint)),
            });
            let below: Vec<_> =
                (0..JOINTS).filter(|&child| parent(child) == Some(joint)).map(|child| child + 1).collect();
            if !below.is_empty() {
                node["children"] = below.into();
            }
            nodes.push(node);
        }
        nodes.push(json!({ "name": "Face", "mesh": 0, "skin": 0, "extras": { "odd": 1.5e-3 } }));
        let mut buffer = Buffer::default();
        let json = file(&mut buffer, nodes, &self.shapes);
        Made { json, bin: buffer.bin, names: self.names }
    }
}

/// Returns the file's JSON around the nodes.
fn file(buffer: &mut Buffer, nodes: Vec<Value>, shapes: &[&str; 3]) -> Value {
    let triangle = [0.0, 1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 1.1, 0.0];
    let moved = [0.0, 0.0, 0.01, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let positions = buffer.floats(&triangle, "VEC3", true);
    let texture = buffer.floats(&[0.0, 0.0, 1.0, 0.0, 0.0, 1.0], "VEC2", true);
    let weights = buffer.floats(&[1.0, 0.0, 0.0, 0.0].repeat(3), "VEC4", true);
    let joints = buffer.joints(&[15, 0, 0, 0].repeat(3));
    let targets: Vec<_> = (0..3).map(|_| json!({ "POSITION": buffer.floats(&moved, "VEC3", true) })).collect();
    let times = buffer.floats(&[0.0, 1.0], "SCALAR", false);
    let places = buffer.floats(&[0.0, 0.0, 0.0, 0.0, 0.1, 0.0], "VEC3", false);
    let image = buffer.view(&PNG, None);
    let last = nodes.len() - 1;
    json!({
        "asset": { "version": "2.0", "generator": "by hand" },
        "scene": 0,
        "scenes": [{ "nodes": [0, last] }],
        "nodes": nodes,
        "meshes": [{
            "name": "Face", "weights": [0.25, 0.0, 0.0], "extras": { "targetNames": shapes },
            "primitives": [{
                "attributes": { "POSITION": positions, "TEXCOORD_0": texture, "WEIGHTS_0": weights, "JOINTS_0": joints },
                "material": 0, "targets": targets,
            }],
        }],
        "skins": [{ "joints": (1..=JOINTS).collect::<Vec<_>>() }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } }, "doubleSided": true }],
        "textures": [{ "source": 0 }],
        "images": [{ "bufferView": image, "mimeType": "image/png" }],
        "animations": [{
            "name": "speech",
            "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
            "samplers": [{ "input": times, "output": places }],
        }],
        "accessors": buffer.accessors,
        "bufferViews": buffer.views,
        "buffers": [{ "name": "all", "byteLength": buffer.bin.len() }],
    })
}

/// Builds a character with Mixamo's names in centimetres, hanging arms and rotated bone axes, and ARKit's shapes.
pub(super) fn mixamo() -> Made {
    let limb = |text: &str| match text {
        "hip" => "UpLeg".to_owned(),
        "knee" => "Leg".to_owned(),
        "ankle" => "Foot".to_owned(),
        "foot" => "ToeBase".to_owned(),
        "collar" => "Shoulder".to_owned(),
        "shoulder" => "Arm".to_owned(),
        "elbow" => "ForeArm".to_owned(),
        "wrist" => "Hand".to_owned(),
        "eye" => "Eye".to_owned(),
        finger => format!("Hand{}{}", finger[..1].to_uppercase(), &finger[1..]),
    };
    let name = |joint: &str| match (joint, joint.split_once('_')) {
        ("pelvis", _) => "Hips".to_owned(),
        ("spine1", _) => "Spine".to_owned(),
        ("spine2", _) => "Spine1".to_owned(),
        ("spine3", _) => "Spine2".to_owned(),
        (_, Some(("left", part))) => format!("Left{}", limb(part)),
        (_, Some((_, part))) => format!("Right{}", limb(part)),
        (joint, None) => format!("{}{}", joint[..1].to_uppercase(), &joint[1..]),
    };
    let names = JOINT_NAMES.map(|joint| format!("mixamorig:{}", name(joint))).to_vec();
    let shapes = ["Other", "jawOpen", "eyeBlink_L"];
    BodySpec { names, shapes, world: IDENTITY, unit: 100.0, droop: 0.8, twist: 1.0 }.made()
}

/// Builds a VRM file with meaningless node names: bones and expressions are in its tables. Version 0 faces backwards.
pub(super) fn vrm(version: u8) -> Made {
    let names = (0..JOINTS).map(|joint| if joint == 22 { "jaw".to_owned() } else { format!("b{joint}") }).collect();
    let world = if version == 0 { [0.0, 1.0, 0.0, 0.0] } else { IDENTITY };
    let mut made = BodySpec { names, shapes: ["Other", "S1", "S2"], world, unit: 1.0, droop: 0.0, twist: 0.0 }.made();
    let bones = vrm_bones(version);
    let face = made.index("Face");
    let (name, extension) = if version == 0 {
        let bones: Vec<_> = bones.iter().map(|(name, node)| json!({ "bone": name, "node": node })).collect();
        let bind = |shape: usize, weight: f32| json!([{ "mesh": 0, "index": shape, "weight": weight }]);
        let groups = json!([
            { "name": "A", "presetName": "a", "binds": bind(1, 100.0) },
            { "name": "BLINK", "presetName": "unknown", "binds": bind(2, 50.0) },
        ]);
        ("VRM", json!({ "humanoid": { "humanBones": bones }, "blendShapeMaster": { "blendShapeGroups": groups } }))
    } else {
        let bones: Value = bones.iter().map(|(name, node)| (name.clone(), json!({ "node": node }))).collect();
        let bind = |shape: usize, weight: f32| json!({ "morphTargetBinds": [{ "node": face, "index": shape, "weight": weight }] });
        let expressions = json!({ "preset": { "aa": bind(1, 1.0), "blink": bind(2, 0.5) } });
        ("VRMC_vrm", json!({ "specVersion": "1.0", "humanoid": { "humanBones": bones }, "expressions": expressions }))
    };
    made.json["extensionsUsed"] = json!([name]);
    made.json["extensions"] = json!({ name: extension });
    made
}

/// Returns VRM's name for each joint's node.
fn vrm_bones(version: u8) -> Vec<(String, usize)> {
    let thumb =
        if version == 0 { ["Proximal", "Intermediate", "Distal"] } else { ["Metacarpal", "Proximal", "Distal"] };
    let part = |text: &str| match text {
        "hip" => "UpperLeg".to_owned(),
        "knee" => "LowerLeg".to_owned(),
        "ankle" => "Foot".to_owned(),
        "foot" => "Toes".to_owned(),
        "collar" => "Shoulder".to_owned(),
        "shoulder" => "UpperArm".to_owned(),
        "elbow" => "LowerArm".to_owned(),
        "wrist" => "Hand".to_owned(),
        "eye" => "Eye".to_owned(),
        finger => {
            let (name, number) = finger.split_at(finger.len() - 1);
            let number: usize = number.parse().unwrap();
            let bones = if name == "thumb" { thumb } else { ["Proximal", "Intermediate", "Distal"] };
            let name = if name == "pinky" { "little" } else { name };
            format!("{}{}{}", name[..1].to_uppercase(), &name[1..], bones[number - 1])
        }
    };
    let name = |joint: &str| match (joint, joint.split_once('_')) {
        ("pelvis", _) => "hips".to_owned(),
        ("spine1", _) => "spine".to_owned(),
        ("spine2", _) => "chest".to_owned(),
        ("spine3", _) => "upperChest".to_owned(),
        (joint, None) => joint.to_owned(),
        (_, Some((side, text))) => format!("{side}{}", part(text)),
    };
    JOINT_NAMES.iter().enumerate().map(|(joint, text)| (name(text), joint + 1)).collect()
}
