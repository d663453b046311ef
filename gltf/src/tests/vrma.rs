use super::*;
use gltf::animation::util::ReadOutputs;
use serde_json::Value;
use std::collections::HashMap;

/// A file as JSON, with the values of each node's channels.
struct File {
    nodes: Vec<Value>,
    extension: Value,
    rotations: HashMap<usize, Vec<[f32; 4]>>,
    places: HashMap<usize, Vec<Point>>,
}

impl File {
    fn of(clip: &Clip) -> Self {
        let mut bytes = Vec::new();
        crate::vrma::write(clip, &mut bytes).unwrap();
        let gltf = gltf::Gltf::from_slice(&bytes).unwrap();
        let bin = gltf.blob.clone().unwrap();
        let (mut rotations, mut places) = (HashMap::new(), HashMap::new());
        for channel in gltf.animations().next().unwrap().channels() {
            let node = channel.target().node().index();
            match channel.reader(|_| Some(&bin)).read_outputs().unwrap() {
                ReadOutputs::Rotations(q) => assert!(rotations.insert(node, q.into_f32().collect()).is_none()),
                ReadOutputs::Translations(t) => {
                    assert!(places.insert(node, t.map(|place| place.map(f64::from)).collect()).is_none());
                }
                _ => panic!("neither scales nor weights"),
            }
        }
        let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let text: Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
        assert_eq!(text["extensionsUsed"], serde_json::json!(["VRMC_vrm_animation"]));
        let nodes = text["nodes"].as_array().unwrap().clone();
        Self { nodes, extension: text["extensions"]["VRMC_vrm_animation"].clone(), rotations, places }
    }

    /// Numbers of a node; `None` if it has none.
    fn numbers<const N: usize>(&self, node: usize, key: &str) -> Option<[f64; N]> {
        let values = self.nodes[node][key].as_array()?;
        Some(std::array::from_fn(|i| values[i].as_f64().unwrap()))
    }

    fn bone(&self, name: &str) -> usize {
        let node = &self.extension["humanoid"]["humanBones"][name]["node"];
        number(node).unwrap_or_else(|| panic!("no bone {name}"))
    }

    /// Position and rotation of every bone, in a frame or at rest.
    fn placed(&self, frame: Option<usize>) -> HashMap<usize, (Point, [f64; 4])> {
        let mut placed = HashMap::new();
        let mut open = vec![(self.bone("hips"), [0.0; 3], [0.0, 0.0, 0.0, 1.0])];
        while let Some((node, from, turned)) = open.pop() {
            let mut offset = self.numbers(node, "translation").unwrap_or_default();
            let mut turn = self.numbers(node, "rotation").unwrap_or([0.0, 0.0, 0.0, 1.0]);
            if let Some(frame) = frame {
                offset = self.places.get(&node).map_or(offset, |places| places[frame]);
                turn = self.rotations.get(&node).map_or(turn, |turns| turns[frame].map(f64::from));
            }
            let step = rotate(turned, offset);
            let here = std::array::from_fn(|axis| from[axis] + step[axis]);
            let turned = multiply(turned, turn);
            placed.insert(node, (here, turned));
            let children = self.nodes[node]["children"].as_array().cloned().unwrap_or_default();
            open.extend(children.iter().map(|child| (number(child).unwrap(), here, turned)));
        }
        placed
    }

    /// Weights of an expression over time.
    fn weights(&self, group: &str, name: &str) -> Option<Vec<f64>> {
        let node = number(&self.extension["expressions"][group][name]["node"])?;
        Some(self.places[&node].iter().map(|place| place[0]).collect())
    }
}

/// A JSON integer.
fn number(value: &Value) -> Option<usize> {
    usize::try_from(value.as_u64()?).ok()
}

/// VRM's names of some joints.
const NAMES: [(usize, &str); 9] = [
    (0, "hips"),
    (15, "head"),
    (20, "leftHand"),
    (21, "rightHand"),
    (10, "leftToes"),
    (27, "leftIndexDistal"),
    (37, "leftThumbMetacarpal"),
    (53, "rightThumbProximal"),
    (45, "rightMiddleDistal"),
];

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn every_joint_that_is_no_eye_is_where_the_quaternions_put_it(clip in any_clip(FaceKind::SmplxExpression, 2)) {
        let file = File::of(&clip);
        for frame in 0..2 {
            let (placed, want) = (file.placed(Some(frame)), positions(&clip, frame));
            for (joint, name) in NAMES {
                prop_assert!(distance(placed[&file.bone(name)].0, want[joint]) < 1e-5, "{}", name);
            }
        }
    }
}

#[test]
fn rest_is_the_t_pose_with_the_soles_on_the_floor() {
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    let file = File::of(&clip);
    let placed = file.placed(None);
    let place = |name: &str| placed[&file.bone(name)].0;
    for (from, to, axis) in [
        ("leftUpperArm", "leftLowerArm", [1.0, 0.0, 0.0]),
        ("leftLowerArm", "leftHand", [1.0, 0.0, 0.0]),
        ("leftHand", "leftMiddleProximal", [1.0, 0.0, 0.0]),
        ("rightUpperArm", "rightHand", [-1.0, 0.0, 0.0]),
        ("leftUpperLeg", "leftFoot", [0.0, -1.0, 0.0]),
        ("rightUpperLeg", "rightLowerLeg", [0.0, -1.0, 0.0]),
    ] {
        let (from, to) = (place(from), place(to));
        let length = distance(from, to);
        let along: f64 = (0..3).map(|i| (to[i] - from[i]) * axis[i]).sum();
        assert!(along > length - 1e-6, "{from:?} to {to:?}");
    }
    assert!((0.0..0.05).contains(&place("leftToes")[1]), "{:?}", place("leftToes"));
}

/// Checks a bone's world rotation since the T-pose, as a VRM reader computes it.
#[test]
fn a_reader_sees_how_far_each_bone_turned_since_the_t_pose() {
    let mut clip = sample::clip(FaceKind::Arkit, 1, 1);
    clip.rotations = vec![[[0.0, 0.0, 0.0, 1.0]; JOINTS]];
    let file = File::of(&clip);
    let (rest, shown) = (file.placed(None), file.placed(Some(0)));
    let turned = |name: &str| {
        let node = file.bone(name);
        let [x, y, z, w] = rest[&node].1;
        let q = multiply(shown[&node].1, [-x, -y, -z, w]);
        2.0 * q[3].abs().min(1.0).acos()
    };
    // Our rest pose is within a few degrees of a T-pose, and the head is not rotated.
    assert!(turned("head") < 1e-3 && turned("leftFoot") < 1e-3);
    assert!((1e-3..0.2).contains(&turned("leftUpperArm")), "{}", turned("leftUpperArm"));
}

#[test]
fn the_face_is_said_once() {
    let mut clip = sample::clip(FaceKind::Arkit, 3, 1);
    clip.face_values.fill(0.0);
    let channel = |name: &str| clip.face.names.iter().position(|known| known == name).unwrap();
    let (jaw, brow, blink) = (channel("jawOpen"), channel("browInnerUp"), channel("eyeBlinkLeft"));
    let channels = clip.face.names.len();
    clip.face_values[channels + jaw] = 0.7;
    clip.face_values[channels + brow] = 0.5;
    clip.face_values[2 * channels + blink] = 1.0;
    let file = File::of(&clip);
    let near = |got: Option<Vec<f64>>, want: [f64; 3]| {
        let got = got.unwrap();
        assert!(got.iter().zip(want).all(|(got, want)| (got - want).abs() < 1e-6), "{got:?}");
    };
    near(file.weights("preset", "aa"), [0.0, 1.0, 0.0]);
    near(file.weights("preset", "blinkLeft"), [0.0, 0.0, 1.0]);
    near(file.weights("preset", "blinkRight"), [0.0; 3]);
    near(file.weights("custom", "browInnerUp"), [0.0, 0.5, 0.0]);
    for name in ["jawOpen", "mouthFunnel", "eyeBlinkLeft", "eyeLookUpLeft", "tongueOut"] {
        assert_eq!(file.weights("custom", name), None, "{name}");
    }
    let bones = file.extension["humanoid"]["humanBones"].as_object().unwrap();
    assert_eq!(bones.len(), JOINTS - 3);
    for name in ["leftEye", "rightEye", "jaw"] {
        assert!(!bones.contains_key(name));
    }
}

#[test]
fn the_gaze_is_the_middle_of_both_eyes() {
    let mut clip = sample::clip(FaceKind::Arkit, 1, 1);
    let turn = |angle: f32| [0.0, (0.5 * angle).sin(), 0.0, (0.5 * angle).cos()];
    (clip.rotations[0][23], clip.rotations[0][24]) = (turn(0.3), turn(0.1).map(|x| -x));
    let file = File::of(&clip);
    let node = number(&file.extension["lookAt"]["node"]).unwrap();
    let got = file.rotations[&node][0];
    assert!(got.iter().zip(turn(0.2)).all(|(a, b)| (a - b).abs() < 1e-6), "{got:?}");
    let from_head = file.extension["lookAt"]["offsetFromHeadBone"][0].as_f64().unwrap();
    assert!(from_head.abs() < 1e-6, "between the eyes: {from_head}");
}

#[test]
fn a_face_of_coefficients_leaves_the_mouth_to_the_jaw() {
    let file = File::of(&sample::clip(FaceKind::SmplxExpression, 2, 1));
    assert!(file.extension.get("expressions").is_none());
    assert!(file.rotations.contains_key(&file.bone("jaw")));
}
