//! Characters and skeletons as other programs write them: `tests/characters` has a figure of boxes
//! with Mixamo's bones and a face, and variants of it.

use std::path::{Path, PathBuf};

use umo_core_rig::glb::container;

use super::*;
use crate::bvh::Bvh;

fn path(name: &str) -> PathBuf {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/characters")).join(name)
}

/// Returns a file's JSON and buffer.
fn parts(name: &str) -> (Value, Vec<u8>) {
    let bytes = std::fs::read(path(name)).unwrap();
    let file = Glb::split(&bytes).unwrap();
    (serde_json::from_str(file.json).unwrap(), file.bin.to_vec())
}

fn whole(json: &Value, bin: &[u8]) -> Vec<u8> {
    container(json.to_string().into_bytes(), bin, &[]).unwrap()
}

/// Retargets a clip to a character; returns the number of moving shapes, the notes, and the resulting file.
fn retargeted(bytes: &[u8], clip: &Clip) -> (usize, Vec<String>, Moved) {
    let target = Target::read("a.glb".as_ref(), bytes.to_vec()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    let faces = target.faces(&mapping, &clip.face, &Given::default()).unwrap();
    (faces.moved(), target.notes(&mapping, &faces, &clip.face), moved_by(bytes, clip, &Given::default()))
}

fn clip() -> Clip {
    sample::clip(FaceKind::Arkit, 4, 2)
}

fn has(notes: &[String], text: &str) -> bool {
    notes.iter().any(|note| note.contains(text))
}

#[test]
fn a_gltf_beside_its_files_moves_as_the_glb_of_the_same() {
    let clip = clip();
    let folder = tempfile::tempdir().unwrap();
    let (mut json, bin) = parts("character.glb");
    json["buffers"][0]["uri"] = json!("character.bin");
    let file = folder.path().join("character.gltf");
    std::fs::write(&file, json.to_string()).unwrap();
    let missing = read(&file).unwrap_err().to_string();
    assert!(missing.contains("character.gltf") && missing.contains("`character.bin`"), "{missing}");
    std::fs::write(folder.path().join("character.bin"), bin).unwrap();
    let (shapes, notes, found) = retargeted(&read(&file).unwrap(), &clip);
    let (wanted_shapes, wanted_notes, wanted) = retargeted(&std::fs::read(path("character.glb")).unwrap(), &clip);
    assert_eq!((shapes, notes), (wanted_shapes, wanted_notes));
    gltf::Gltf::from_slice(&found.bytes).unwrap();
    assert_eq!(shapes, 12);
    for (node, of) in found.document.nodes.iter().enumerate() {
        for (path, kind) in [("rotation", "VEC4"), ("translation", "VEC3"), ("weights", "SCALAR")] {
            assert_eq!(found.values(node, path, kind), wanted.values(node, path, kind), "{:?} {path}", of.name);
        }
    }
    assert!(Wearer::read(&file, None).is_ok());
}

#[test]
fn a_character_that_meshopt_compressed_moves_as_the_plain_one() {
    let clip = clip();
    same_motion("meshopt.glb", &clip);
}

#[test]
fn a_character_that_draco_compressed_moves_as_the_plain_one() {
    let bytes = read(&path("draco.glb")).unwrap();
    same_motion("draco.glb", &clip());
    // Its surface matches the plain one's, corner by corner.
    let corners = |bytes: &[u8]| -> Vec<[f32; 3]> {
        let file = gltf::Gltf::from_slice(bytes).unwrap();
        let bin = Glb::split(bytes).unwrap().bin;
        let meshes = file.document.meshes().flat_map(|mesh| mesh.primitives().collect::<Vec<_>>());
        let of = |part: gltf::Primitive<'_>| -> Vec<[f32; 3]> {
            let reader = part.reader(|_| Some(bin));
            let places: Vec<_> = reader.read_positions().unwrap().collect();
            reader.read_indices().unwrap().into_u32().map(|at| places[at as usize]).collect()
        };
        meshes.flat_map(of).collect()
    };
    let sorted = |bytes: &[u8]| {
        // Draco may reorder the triangles.
        let sum = |three: &[[f32; 3]]| three.iter().flatten().sum::<f32>();
        let mut triangles: Vec<_> = corners(bytes).chunks(3).map(sum).collect();
        triangles.sort_by(f32::total_cmp);
        triangles
    };
    let [found, wanted] = [&bytes, &std::fs::read(path("character.glb")).unwrap()].map(|bytes| sorted(bytes));
    assert_eq!(found.len(), wanted.len());
    assert!(found.iter().zip(&wanted).all(|(a, b)| (a - b).abs() < 0.01), "triangles are elsewhere");
    // An accessor's announced bounds are correct, which validators check.
    let json: Value = serde_json::from_str(Glb::split(&bytes).unwrap().json).unwrap();
    let announced = &json["accessors"][1]["max"];
    let places: Vec<[f32; 3]> = corners(&bytes);
    let most = |axis: usize| places[..756].iter().map(|place| place[axis]).fold(f32::MIN, f32::max);
    for axis in 0..3 {
        assert!((announced[axis].as_f64().unwrap() - f64::from(most(axis))).abs() < 1e-7, "{announced}");
    }
    // No changed byte causes a panic.
    let plain = std::fs::read(path("draco.glb")).unwrap();
    for at in (0..plain.len()).step_by(11) {
        let mut changed = plain.clone();
        changed[at] ^= 1 << (at % 8);
        let _ = draco::decompressed(changed);
    }
}

/// Asserts that a variant of the character moves like the plain one.
fn same_motion(name: &str, clip: &Clip) {
    let (shapes, notes, found) = retargeted(&read(&path(name)).unwrap(), clip);
    let (wanted_shapes, wanted_notes, wanted) = retargeted(&read(&path("character.glb")).unwrap(), clip);
    assert_eq!((shapes, notes), (wanted_shapes, wanted_notes));
    assert!(!found.json.to_string().contains("compression"));
    gltf::Gltf::from_slice_without_validation(&found.bytes).unwrap();
    for node in 0..found.document.nodes.len() {
        let name = found.document.nodes[node].name.clone().unwrap();
        if !name.starts_with("mixamorig") {
            continue;
        }
        let other = wanted.node(&name);
        for frame in 0..clip.len() {
            let apart = less(found.place(node, frame), wanted.place(other, frame));
            assert!(apart.iter().all(|x| x.abs() < 1e-3), "{name}: {apart:?}");
        }
    }
}

#[test]
fn shapes_of_a_second_part_and_names_said_twice_are_found() {
    let clip = clip();
    let (shapes, notes, moved) = retargeted(&std::fs::read(path("targets_on_second_primitive.glb")).unwrap(), &clip);
    assert_eq!((shapes, notes.as_slice()), (12, &[][..]));
    assert!(moved.values(moved.node("Face"), "weights", "SCALAR").unwrap().iter().any(|&weight| weight > 0.05));
    let (json, bin) = parts("character.glb");
    let face = json["meshes"].as_array().unwrap().iter().position(|mesh| mesh["name"] == "Face").unwrap();
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut json = json.clone();
        change(&mut json["meshes"][face]);
        retargeted(&whole(&json, &bin), &clip)
    };
    let twice = |mesh: &mut Value| {
        let names = mesh["extras"]["targetNames"].as_array_mut().unwrap();
        names.extend(names.clone());
    };
    let (shapes, notes, _) = changed(&twice);
    assert_eq!((shapes, notes.as_slice()), (12, &[][..]));
    let (shapes, notes, _) = changed(&|mesh| mesh["extras"]["targetNames"].as_array_mut().unwrap().push("more".into()));
    assert!(shapes == 2 && has(&notes, "`Face` stays still: 11 names for its 10 shapes"), "{notes:?}");
    let (shapes, notes, _) = changed(&|mesh| mesh["extras"] = json!({}));
    assert!(shapes == 2 && has(&notes, "`Face` stays still: 0 names for its 10 shapes"), "{notes:?}");
    let uneven = |mesh: &mut Value| {
        let mut part = mesh["primitives"][0].clone();
        part["targets"].as_array_mut().unwrap().pop();
        mesh["primitives"].as_array_mut().unwrap().push(part);
    };
    let (shapes, notes, _) = changed(&uneven);
    assert!(shapes == 2 && has(&notes, "`Face` stays still: its parts have 10 and 9 shapes"), "{notes:?}");
}

#[test]
fn a_mouth_that_says_little_is_said() {
    let clip = clip();
    let named = |names: &[&str]| {
        let (mut json, bin) = parts("character.glb");
        for mesh in json["meshes"].as_array_mut().unwrap() {
            let Some(list) = mesh["extras"]["targetNames"].as_array_mut() else { continue };
            list.iter_mut().enumerate().for_each(|(at, name)| *name = names.get(at).copied().unwrap_or("other").into());
        }
        let (_, notes, moved) = retargeted(&whole(&json, &bin), &clip);
        (notes, moved)
    };
    let (notes, _) = named(&["frown"]);
    assert!(notes.len() == 1 && has(&notes, "its mouth cannot move"), "{notes:?}");
    let (notes, _) = named(&["viseme_sil", "viseme_aa"]);
    assert!(notes.len() == 1 && has(&notes, "its mouth moves by viseme_aa only"), "{notes:?}");
    assert!(named(&["aa", "ih", "ou", "ee", "oh"]).0.is_empty());
    // A single mouth shape is driven at full strength, not at the third that the vowels would give it.
    let (notes, moved) = named(&["mouthOpen"]);
    assert!(notes.len() == 1 && has(&notes, "its mouth moves by mouthOpen only"), "{notes:?}");
    let weights = moved.values(moved.node("Face"), "weights", "SCALAR").unwrap();
    let channel = |frame: usize, name: &str| clip.face(frame)[clip.face.names.iter().position(|n| n == name).unwrap()];
    for frame in 0..clip.len() {
        let open = (channel(frame, "jawOpen") - channel(frame, "mouthClose")).max(0.0);
        assert!((weights[10 * frame] - (open / 0.7).min(1.0)).abs() < 1e-6);
    }
}

/// Returns a second copy of the character beside the first: nodes, and skins that follow them.
fn doubled() -> (Value, Vec<u8>, usize) {
    let (mut json, bin) = parts("character.glb");
    let count = json["nodes"].as_array().unwrap().len();
    let skins = json["skins"].as_array().unwrap().len();
    let mut copies = json["nodes"].clone();
    for node in copies.as_array_mut().unwrap() {
        for child in node.get_mut("children").and_then(Value::as_array_mut).into_iter().flatten() {
            *child = (child.as_u64().unwrap() + count as u64).into();
        }
        if let Some(skin) = node.get_mut("skin") {
            *skin = (skin.as_u64().unwrap() + skins as u64).into();
        }
        if node["name"] == "mixamorig:Neck" {
            // Only the second copy has such a bone.
            node["name"] = "mixamorig:Neck1".into();
        }
    }
    json["nodes"].as_array_mut().unwrap().extend(copies.as_array().unwrap().clone());
    let mut again = json["skins"].clone();
    for joint in again.as_array_mut().unwrap().iter_mut().flat_map(|skin| skin["joints"].as_array_mut().unwrap()) {
        *joint = (joint.as_u64().unwrap() + count as u64).into();
    }
    json["skins"].as_array_mut().unwrap().extend(again.as_array().unwrap().clone());
    let roots = json["scenes"][0]["nodes"].as_array().unwrap().clone();
    let more = roots.iter().map(|root| Value::from(root.as_u64().unwrap() + count as u64));
    json["scenes"][0]["nodes"].as_array_mut().unwrap().extend(more);
    (json, bin, count)
}

#[test]
fn mappings_with_a_byte_order_mark_are_read() {
    for (text, json) in [("[bones]\njaw = \"\"\n", false), ("{\"bones\": {\"jaw\": \"\"}}", true)] {
        assert_eq!(mapping::parse(&format!("\u{feff}{text}"), json), mapping::parse(text, json));
        assert!(mapping::parse(text, json).is_ok());
    }
}

#[test]
fn of_two_characters_one_moves_and_it_is_said_which() {
    let clip = clip();
    let (json, bin, count) = doubled();
    let (shapes, notes, moved) = retargeted(&whole(&json, &bin), &clip);
    assert!(shapes == 12 && notes.len() == 1 && has(&notes, "2 characters: `mixamorig:Hips` moves"), "{notes:?}");
    let channels = &moved.document.animations[0].channels;
    assert!(channels.len() > 15 && channels.iter().all(|channel| channel.target.node.unwrap() < count));
}

/// Height of the soles of thick shoes, metres.
const DEEP: f32 = -0.06;

#[test]
fn soles_that_reach_below_the_floor_stand_on_it() {
    let mut clip = clip();
    clip.rotations.iter_mut().for_each(|frame| *frame = [IDENTITY; JOINTS]);
    let (json, bin) = parts("character.glb");
    let view = |at: usize| usize::try_from(json["bufferViews"][at]["byteOffset"].as_u64().unwrap_or(0)).unwrap();
    let body = json["meshes"].as_array().unwrap().iter().find(|mesh| mesh["name"] == "Body").unwrap();
    let index = |value: &Value| usize::try_from(value.as_u64().unwrap()).unwrap();
    let accessor = &json["accessors"][index(&body["primitives"][0]["attributes"]["POSITION"])];
    let start = view(index(&accessor["bufferView"])) + accessor.get("byteOffset").map_or(0, index);
    let mut deep = bin.clone();
    // The boxes' lowest corners are moved some centimetres down, like thick-soled shoes.
    let height = |bin: &[u8], at: usize| f32::from_le_bytes(bin[start + 12 * at + 4..][..4].try_into().unwrap());
    let corners = 0..index(&accessor["count"]);
    let lowest = corners.clone().map(|at| height(&bin, at)).fold(f32::MAX, f32::min);
    for at in corners.filter(|&at| height(&bin, at) < lowest + 0.01) {
        deep[start + 12 * at + 4..][..4].copy_from_slice(&DEEP.to_le_bytes());
    }
    let at = |bytes: &[u8]| {
        let (_, _, moved) = retargeted(bytes, &clip);
        moved.place(moved.node("mixamorig:LeftFoot"), 1)[1]
    };
    let lifted = at(&whole(&json, &deep)) - at(&whole(&json, &bin));
    // The original boxes also reach below the floor.
    assert!(lowest < 0.0 && (lifted - (lowest - DEEP)).abs() < 1e-3, "lifted by {lifted} m, the lowest was {lowest}");
}

#[test]
fn a_file_without_a_skeleton_is_not_told_of_mappings() {
    let (mut json, bin) = parts("character.glb");
    json["nodes"] = json!([{ "name": "Body", "mesh": 0 }]);
    json["scenes"][0]["nodes"] = json!([0]);
    json.as_object_mut().unwrap().remove("skins");
    let target = Target::read("a.glb".as_ref(), whole(&json, &bin)).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    let problem = target.check(&mapping, "help").unwrap_err();
    assert!(problem.contains("no skeleton") && !problem.contains("--mapping"), "{problem}");
    // A mapping may name the bones of a skeleton without meshes.
    let bare = "HIERARCHY ROOT x { OFFSET 0 0 0 CHANNELS 0 } MOTION Frames: 0 Frame Time: 1";
    let target = Target::read("a.bvh".as_ref(), bare.into()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    assert!(target.check(&mapping, "help").unwrap_err().contains("--mapping"));
}

#[test]
fn places_and_roots_of_bvh_files_are_written_as_those_have_them() {
    let clip = crate::import::read(&path("motion.npz")).unwrap();
    let on = |name: &str| {
        let target = Target::read(name.as_ref(), std::fs::read(path(name)).unwrap()).unwrap();
        let (mapping, _) = target.mapping(&Given::default()).unwrap();
        let retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).unwrap();
        let motion = motion(&retarget, &clip).unwrap();
        let bytes = target.animated(&retarget, &motion, &Faces::default(), &clip).unwrap();
        Bvh::parse(std::str::from_utf8(&bytes).unwrap()).unwrap()
    };
    let bvh = on("positions_replace.bvh");
    let mut values = bvh.motion.iter();
    for joint in &bvh.joints {
        let of_joint: Vec<f64> = values.by_ref().take(joint.channels.len()).copied().collect();
        if joint.parent.is_some() {
            let near =
                of_joint.iter().zip(joint.offset).all(|(value, offset)| (value - f64::from(offset)).abs() < 1e-3);
            assert!(near, "{}: {of_joint:?} for {:?}", joint.name, joint.offset);
        }
    }
    let height = on("root_replaces.bvh").motion[1];
    assert!((height - 93.6).abs() < 0.5, "{height} cm");
}

#[test]
fn inspecting_a_character_says_what_is_there_and_what_is_missing() {
    let report = |bytes: Vec<u8>| {
        let target = Target::read("a.glb".as_ref(), bytes).unwrap();
        inspect::report(&target).unwrap().join("\n")
    };
    let text = report(std::fs::read(path("character.glb")).unwrap());
    for wanted in [
        "licence    not given in the file",
        "height     1.",
        "rest pose  T-pose, upper arms",
        "by Mixamo names, for",
        "missing, and at rest unless --mapping FILE names them: jaw, left_eye, right_eye, left_index1",
        "shapes     12 in all, 12 move",
        "shapes     10 of ARKit's 52; missing: ",
        "shapes     0 of Oculus' 15",
    ] {
        assert!(text.contains(wanted), "{wanted}:\n{text}");
    }
    let (mut json, bin) = parts("character.glb");
    json["asset"]["copyright"] = "2026 somebody, CC BY 4.0".into();
    for node in json["nodes"].as_array_mut().unwrap() {
        let name = node["name"].as_str().unwrap().replace("mixamorig:", "Hero_") + ".001";
        node["name"] = name.into();
    }
    let text = report(whole(&json, &bin));
    assert!(text.contains("licence    2026 somebody, CC BY 4.0"), "{text}");
    assert!(
        text.contains(
            "note       bone names are read without their common prefix and suffix: `Hero_Hips.001` as `hips`"
        ),
        "{text}"
    );
    let text = report(vrm(1).bytes());
    assert!(text.contains("VRM expressions with shapes: "), "{text}");
    let missing = inspect::inspect(&path("none.glb")).unwrap_err().to_string();
    assert!(missing.contains("none.glb"), "{missing}");
}
