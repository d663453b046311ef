//! Figures as avatars: bones, T-pose, floor, shapes, expressions, licence.

use std::collections::HashMap;

use gltf::{Gltf, Node};
use serde_json::Value;
use umo_core_pose::skeleton::ARKIT_NAMES;

use super::*;
use crate::avatar::{Kind, write};

struct Avatar {
    gltf: Gltf,
    json: Value,
}

impl Avatar {
    fn of(figure: Figure, kind: Kind) -> Self {
        let mut bytes = Vec::new();
        write(figure, &sample::clip(FaceKind::Arkit, 1, 1).skeleton, kind, &mut bytes).unwrap();
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        Self { gltf: Gltf::from_slice(&bytes).unwrap(), json: serde_json::from_slice(&bytes[20..20 + length]).unwrap() }
    }

    fn node(&self, name: &str) -> Node<'_> {
        self.gltf.nodes().find(|node| node.name() == Some(name)).unwrap_or_else(|| panic!("no {name}"))
    }

    /// Position of each node, in metres.
    fn places(&self) -> HashMap<String, [f32; 3]> {
        fn add(node: &Node<'_>, from: [f32; 3], places: &mut HashMap<String, [f32; 3]>) {
            let (moved, turn, scale) = node.transform().decomposed();
            assert_eq!((turn, scale), ([0.0, 0.0, 0.0, 1.0], [1.0; 3]), "{:?}", node.name());
            let place = std::array::from_fn(|axis| from[axis] + moved[axis]);
            places.insert(node.name().unwrap().to_owned(), place);
            node.children().for_each(|child| add(&child, place, places));
        }
        let mut places = HashMap::new();
        let scene = self.gltf.default_scene().unwrap();
        // Skinned meshes are roots, as the validator requires.
        assert_eq!((scene.name(), scene.nodes().count()), (Some("Armature"), 3));
        scene.nodes().for_each(|root| add(&root, [0.0; 3], &mut places));
        places
    }

    fn shapes(&self) -> Vec<String> {
        let names = &self.json["meshes"][1]["extras"]["targetNames"];
        names.as_array().unwrap().iter().map(|name| name.as_str().unwrap().to_owned()).collect()
    }

    /// Displacements of the face's vertices by a shape, in metres.
    fn moved(&self, name: &str) -> Vec<[f32; 3]> {
        let at = self.shapes().iter().position(|shape| shape == name).unwrap_or_else(|| panic!("no {name}"));
        let bin = self.gltf.blob.as_ref().unwrap();
        let primitive = self.node("face").mesh().unwrap().primitives().next().unwrap();
        let targets = primitive.reader(|_| Some(bin)).read_morph_targets();
        targets.map(|(positions, ..)| positions.unwrap().collect()).nth(at).unwrap()
    }
}

#[test]
fn avatars_stand_in_t_pose_on_the_floor_with_the_bones_that_programs_know() {
    for figure in Figure::ALL {
        let avatar = Avatar::of(figure, Kind::Glb);
        let places = avatar.places();
        // Arms along X, legs along Y, feet forwards.
        for [from, to] in [["LeftArm", "LeftForeArm"], ["LeftForeArm", "LeftHand"], ["LeftHand", "LeftHandMiddle1"]] {
            let arm: [f32; 3] = std::array::from_fn(|axis| places[to][axis] - places[from][axis]);
            assert!(arm[0] > 0.05 && arm[1].abs() < 1e-5 && arm[2].abs() < 1e-5, "{from}: {arm:?}");
        }
        for [from, to] in [["RightUpLeg", "RightLeg"], ["RightLeg", "RightFoot"]] {
            let leg: [f32; 3] = std::array::from_fn(|axis| places[to][axis] - places[from][axis]);
            assert!(leg[1] < -0.2 && leg[0].abs() < 1e-5 && leg[2].abs() < 1e-5, "{from}: {leg:?}");
        }
        assert!(places["LeftToeBase"][2] > places["LeftFoot"][2] + 0.03 && places["Head"][1] > 1.3);
        assert_eq!((places["Hips"][0], places["Hips"][2]), (0.0, 0.0));
        for name in ["LeftHandThumb3", "RightHandPinky1", "RightHandRing2", "Spine2", "LeftShoulder", "RightEye"] {
            assert!(places.contains_key(name), "{name}");
        }
        // The soles touch the floor, and every vertex has bone weights.
        let bin = avatar.gltf.blob.as_ref().unwrap();
        let mut lowest = f32::INFINITY;
        for primitive in avatar.gltf.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>()) {
            let reader = primitive.reader(|_| Some(bin));
            lowest = reader.read_positions().unwrap().map(|place| place[1]).fold(lowest, f32::min);
            let joints = reader.read_joints(0).unwrap().into_u16().flatten().max();
            assert!(joints.unwrap() < 55, "no helper joints");
            let sums = reader.read_weights(0).unwrap().into_f32().map(|weights| weights.iter().sum::<f32>());
            assert!(sums.into_iter().all(|sum| (sum - 1.0).abs() < 1e-3));
        }
        assert!(lowest.abs() < 1e-6, "{}: {lowest} m", figure.name());
        assert_eq!(avatar.json["asset"]["copyright"], "The umo authors; MIT OR Apache-2.0");
    }
}

#[test]
fn faces_have_arkits_shapes_and_the_visemes() {
    let avatar = Avatar::of(Figure::default(), Kind::Glb);
    let shapes = avatar.shapes();
    assert_eq!(shapes.len(), 67);
    assert!(shapes.iter().take(52).eq(ARKIT_NAMES), "{shapes:?}");
    let visemes: Vec<_> = shapes[52..].iter().map(|name| name.strip_prefix("viseme_").unwrap()).collect();
    assert_eq!(visemes, ["sil", "PP", "FF", "TH", "DD", "kk", "CH", "SS", "nn", "RR", "aa", "E", "I", "O", "U"]);
    let largest = |name: &str| avatar.moved(name).into_iter().flatten().fold(0.0_f32, |most, by| most.max(by.abs()));
    assert_eq!(largest("viseme_sil"), 0.0);
    for name in &shapes[53..] {
        assert!((0.001..0.05).contains(&largest(name)), "{name}: {} m", largest(name));
    }
    // The vowel is its share of the open jaw, at vertices that nothing else moves.
    let (open, vowel) = (avatar.moved("jawOpen"), avatar.moved("viseme_aa"));
    let near = open.iter().zip(&vowel).filter(|(open, _)| open[1] < -0.002);
    assert!(near.clone().count() > 50);
    assert!(near.filter(|(open, vowel)| (vowel[1] - 0.6 * open[1]).abs() < 1e-5).count() > 20);
}

/// The eyeballs look by shapes: hosts that only animate shapes do not rotate joints.
#[test]
fn eyes_look_by_shapes_alone() {
    let avatar = Avatar::of(Figure::default(), Kind::Vrm);
    let bin = avatar.gltf.blob.as_ref().unwrap();
    let primitive = avatar.node("face").mesh().unwrap().primitives().next().unwrap();
    let joints: Vec<_> = primitive.reader(|_| Some(bin)).read_joints(0).unwrap().into_u16().collect();
    let places: Vec<_> = primitive.reader(|_| Some(bin)).read_positions().unwrap().collect();
    // The foremost vertex of an eyeball is on its pupil.
    let pupil = |eye: u16, name: &str| -> [f32; 3] {
        let moved = avatar.moved(name);
        let of_eye = (0..joints.len()).filter(|&at| joints[at][0] == eye);
        let at = of_eye.max_by(|&a, &b| places[a][2].total_cmp(&places[b][2])).unwrap();
        moved[at]
    };
    for (eye, side, sign) in [(23, "Left", 1.0), (24, "Right", -1.0)] {
        assert!(sign * pupil(eye, &format!("eyeLookOut{side}"))[0] > 0.004, "{:?}", pupil(eye, "eyeLookOutLeft"));
        assert!(sign * pupil(eye, &format!("eyeLookIn{side}"))[0] < -0.004);
        assert!(pupil(eye, &format!("eyeLookUp{side}"))[1] > 0.003);
        assert!(pupil(eye, &format!("eyeLookDown{side}"))[1] < -0.003);
        assert_eq!(pupil(eye, &format!("eyeBlink{side}")), [0.0; 3]);
    }
}

#[test]
fn vrm_files_have_bones_expressions_gaze_and_licence() {
    let avatar = Avatar::of(Figure::Bea, Kind::Vrm);
    let vrm = &avatar.json["extensions"]["VRMC_vrm"];
    assert!(avatar.json["extensionsUsed"].as_array().unwrap().contains(&"VRMC_vrm".into()));
    let meta = &vrm["meta"];
    assert_eq!((&meta["name"], &meta["licenseUrl"]), (&"Bea".into(), &"https://vrm.dev/licenses/1.0/".into()));
    assert_eq!(meta["authors"][0], "The umo authors");
    let bones = vrm["humanoid"]["humanBones"].as_object().unwrap();
    assert_eq!(bones.len(), 54);
    for (name, bone) in bones {
        let node = avatar.gltf.nodes().nth(usize::try_from(bone["node"].as_u64().unwrap()).unwrap()).unwrap();
        assert_eq!(node.name(), Some(name.as_str()));
    }
    let shapes = avatar.shapes();
    let face = avatar.node("face").index();
    let parts = |expression: &Value| -> Vec<(String, f64)> {
        let binds = expression["morphTargetBinds"].as_array().unwrap().iter();
        binds
            .map(|bind| {
                assert_eq!(bind["node"], face);
                let index = usize::try_from(bind["index"].as_u64().unwrap()).unwrap();
                (shapes[index].clone(), bind["weight"].as_f64().unwrap())
            })
            .collect()
    };
    let presets = vrm["expressions"]["preset"].as_object().unwrap();
    let mut names: Vec<_> = presets.keys().map(String::as_str).collect();
    names.sort_unstable();
    // All of VRM 1.0.
    let all = "aa angry blink blinkLeft blinkRight ee happy ih lookDown lookLeft lookRight lookUp neutral oh ou relaxed sad surprised";
    assert_eq!(names.join(" "), all);
    assert_eq!(parts(&presets["ee"]), [("viseme_E".to_owned(), 1.0)]);
    assert_eq!(parts(&presets["blinkLeft"]), [("eyeBlinkLeft".to_owned(), 1.0)]);
    let left = parts(&presets["lookLeft"]).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    assert_eq!(left, ["eyeLookOutLeft", "eyeLookInRight"]);
    for name in ["happy", "angry", "sad", "relaxed", "surprised"] {
        assert!(parts(&presets[name]).len() >= 6, "{name}");
    }
    let custom = vrm["expressions"]["custom"].as_object().unwrap();
    assert!(custom.len() == 52 && custom.iter().all(|(name, one)| parts(one) == [(name.clone(), 1.0)]));
    assert_eq!(vrm["lookAt"]["type"], "expression");
}
