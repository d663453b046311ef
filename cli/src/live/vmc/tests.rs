//! Datagrams are decoded by the library's own decoder.

use std::collections::BTreeMap;

use umo_core_pose::rotation::IDENTITY;

use super::*;

fn config() -> Config {
    crate::model::open(None).expect("the default model").config().clone()
}

/// Returns the numbers of all messages, by address and first string.
fn read(packets: &[Vec<u8>]) -> BTreeMap<(String, String), Vec<f32>> {
    let mut said = BTreeMap::new();
    for bytes in packets {
        assert!(bytes.len() <= MAX_BYTES);
        let (rest, packet) = rosc::decoder::decode_udp(bytes).expect("OSC");
        assert!(rest.is_empty());
        let OscPacket::Bundle(bundle) = packet else { panic!("a bundle") };
        for content in bundle.content {
            let OscPacket::Message(message) = content else { panic!("a message") };
            let mut name = String::new();
            let mut numbers = Vec::new();
            for argument in message.args {
                match argument {
                    OscType::String(text) => name = text,
                    OscType::Float(value) => numbers.push(value),
                    OscType::Int(value) => numbers.push(value as f32),
                    other => panic!("{other:?}"),
                }
            }
            assert!(said.insert((message.addr, name), numbers).is_none(), "nothing is said twice");
        }
    }
    said
}

fn get(said: &BTreeMap<(String, String), Vec<f32>>, address: &str, name: &str) -> Vec<f32> {
    said.get(&(address.to_owned(), name.to_owned())).cloned().unwrap_or_else(|| panic!("no {address} {name}"))
}

#[test]
fn a_pose_is_sent_in_unitys_axes() {
    let config = config();
    let mut pose = Pose { translation: [0.1, 0.9, 0.2], ..Pose::REST };
    // The left shoulder rotates down about Z, which is forward.
    let half = 0.5_f32.sqrt();
    pose.rotations[13] = [0.0, 0.0, -half, half];
    let face = vec![0.0; config.face.names.len()];
    let said = read(&Sender::new(&config, None).expect("a sender").packets(&pose, &face, 1.5).expect("packets"));
    assert_eq!(get(&said, "/VMC/Ext/OK", ""), [1.0, 3.0, 0.0, 1.0]);
    assert_eq!(get(&said, "/VMC/Ext/T", ""), [1.5]);
    assert_eq!(get(&said, "/VMC/Ext/Bone/Pos", "Hips")[..3], [-0.1, 0.9, 0.2]);
    assert_eq!(get(&said, "/VMC/Ext/Bone/Pos", "LeftShoulder")[3..], [0.0, -0.0, half, half]);
    // The body's left is at Unity's negative X.
    assert!(get(&said, "/VMC/Ext/Bone/Pos", "LeftUpperArm")[0] < 0.0);
    let bones = said.keys().filter(|(address, _)| address == "/VMC/Ext/Bone/Pos").count();
    assert_eq!(bones, JOINTS);
    assert!(said.contains_key(&("/VMC/Ext/Blend/Apply".to_owned(), String::new())));
}

/// The line from one of Unity's bones to another in Unity's world, as an avatar shows it whose bones have no rotation in its
/// rest pose.
fn line(said: &BTreeMap<(String, String), Vec<f32>>, chain: &[&str]) -> [f32; 3] {
    let mut turned = IDENTITY;
    let mut last = [0.0; 3];
    for name in chain {
        let numbers = get(said, "/VMC/Ext/Bone/Pos", name);
        last = rotate(turned, [numbers[0], numbers[1], numbers[2]]);
        turned = product(turned, [numbers[3], numbers[4], numbers[5], numbers[6]]);
    }
    last
}

#[test]
fn an_avatar_in_its_t_pose_gets_the_models_limbs() {
    let config = config();
    let face = vec![0.0; config.face.names.len()];
    let sender = Sender::new(&config, None).expect("a sender");
    let said = read(&sender.packets(&Pose::REST, &face, 0.0).expect("packets"));
    let arm = ["Hips", "Spine", "Chest", "UpperChest", "LeftShoulder", "LeftUpperArm", "LeftLowerArm"];
    let leg = ["Hips", "RightUpperLeg", "RightLowerLeg", "RightFoot"];
    for (chain, joint) in [(&arm[..], 18), (&leg[..], 8)] {
        let [x, y, z] = config.skeleton.offsets_m[joint];
        let shown = line(&said, chain);
        let off = [shown[0] + x, shown[1] - y, shown[2] - z].map(f32::abs);
        assert!(off.into_iter().all(|off| off < 1e-6), "{chain:?}: {shown:?}");
    }
    // In the avatar's own rest pose the arm is parallel to an axis.
    let [x, y, z] = <[f32; 3]>::try_from(&get(&said, "/VMC/Ext/Bone/Pos", "LeftLowerArm")[..3]).expect("a position");
    assert!(x < -0.2 && y.abs() < 1e-6 && z.abs() < 1e-6, "{x} {y} {z}");
}

#[test]
fn hips_are_at_the_roots_offset_and_translation() {
    let mut config = config();
    config.skeleton.offsets_m[0] = [0.0, -0.35, 0.01];
    let face = vec![0.0; config.face.names.len()];
    let pose = Pose { translation: [0.1, 1.3, 0.2], ..Pose::REST };
    let said = read(&Sender::new(&config, None).expect("a sender").packets(&pose, &face, 0.0).expect("packets"));
    let hips = get(&said, "/VMC/Ext/Bone/Pos", "Hips");
    let expected = [-0.1, 0.95, 0.21, 0.0, 0.0, 0.0, 1.0];
    assert!(hips.iter().zip(expected).all(|(at, expected)| (at - expected).abs() < 1e-6), "{hips:?}");
}

#[test]
fn faces_are_sent_as_shapes_and_as_vowels() {
    let config = config();
    let mut face = vec![0.0; config.face.names.len()];
    let shape = |name: &str| config.face.names.iter().position(|known| known == name).expect("a shape");
    face[shape("jawOpen")] = 0.6;
    face[shape("eyeBlinkLeft")] = 1.0;
    face[shape("browInnerUp")] = 1.5;
    let said = read(&Sender::new(&config, None).expect("a sender").packets(&Pose::REST, &face, 0.0).expect("packets"));
    let value = |name: &str| get(&said, "/VMC/Ext/Blend/Val", name)[0];
    assert_eq!(value("jawOpen"), 0.6);
    assert_eq!(value("browInnerUp"), 1.0, "values are 0 to 1");
    assert!(value("A") > 0.3);
    assert!(value("Blink_L") > 0.9);
    assert!(value("Blink_R") < 0.1);
}

#[test]
fn a_smaller_avatar_stands_on_its_feet() {
    let config = config();
    let face = vec![0.0; config.face.names.len()];
    let pose = Pose { translation: [0.0, 0.975, 0.0], ..Pose::REST };
    let hips = |height| {
        let sender = Sender::new(&config, height).expect("a sender");
        get(&read(&sender.packets(&pose, &face, 0.0).expect("packets")), "/VMC/Ext/Bone/Pos", "Hips")[1]
    };
    assert_eq!(hips(None), 0.975);
    assert!((hips(Some(0.6)) - 0.6).abs() < 0.02);
    for height in [0.0, -1.0, f32::NAN, 1e9] {
        assert!(Sender::new(&config, Some(height)).is_err());
    }
}
