//! Characters built in code, animated, and read back.

mod character;
mod files;
mod kinds;

use glam::{DMat4, DQuat, DVec3};
use proptest::prelude::*;
use serde_json::{Value, json};
use umo_core::{FaceKind, JOINT_NAMES, JOINTS};
use umo_core_pose::rotation::{product, rotate};
use umo_core_pose::skeleton::joint_places;

use super::*;
use character::{Made, mixamo, vrm};
use umo_core_rig::glb::Glb;
use umo_core_rig::glb::accessor::floats;
use umo_core_rig::glb::document::Document;
use umo_core_rig::glb::splice::Members;
use umo_figure::sample;

pub(super) type Vector = [f32; 3];

/// Tolerance of directions, radians.
const TOLERANCE: f64 = 1e-4;

pub(super) fn angle_between(a: Vector, b: Vector) -> f64 {
    let (a, b) = (a.map(f64::from), b.map(f64::from));
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let length = |v: [f64; 3]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
    length(cross).atan2(a.iter().zip(b).map(|(a, b)| a * b).sum())
}

pub(super) fn less(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

/// Retargets a clip to a character and reads the resulting file.
fn moved(made: &Made, clip: &Clip) -> Moved {
    moved_by(&made.bytes(), clip, &Given::default())
}

/// Without the body's volume, which bends arms.
fn moved_by(bytes: &[u8], clip: &Clip, given: &Given) -> Moved {
    moved_within(bytes, clip, given, None)
}

fn moved_within(bytes: &[u8], clip: &Clip, given: &Given, bound: Option<Bound>) -> Moved {
    moved_as(bytes, clip, given, bound, false)
}

fn moved_with(bytes: &[u8], clip: &Clip, given: &Given, volume: bool) -> Moved {
    moved_as(bytes, clip, given, None, volume)
}

fn moved_as(bytes: &[u8], clip: &Clip, given: &Given, bound: Option<Bound>, volume: bool) -> Moved {
    let target = Target::read("a.glb".as_ref(), bytes.to_vec()).unwrap();
    let (mapping, _) = target.mapping(given).unwrap();
    let faces = target.faces(&mapping, &clip.face, given).unwrap();
    let mut retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).unwrap();
    faces.release_bones(&clip.face, &mapping, &mut retarget);
    if volume {
        target.give_volume(&mut retarget, &mapping, given).unwrap();
    }
    let motion = Motion { bound, ..motion(&retarget, clip).unwrap() };
    Moved::read(target.animated(&retarget, &motion, &faces, clip).unwrap())
}

/// A resulting file.
struct Moved {
    bytes: Vec<u8>,
    document: Document,
    json: Value,
}

impl Moved {
    fn read(bytes: Vec<u8>) -> Self {
        let json: Value = serde_json::from_str(Glb::split(&bytes).unwrap().json).unwrap();
        let document = Document::parse(Glb::split(&bytes).unwrap().json).unwrap();
        Self { bytes, document, json }
    }

    fn node(&self, name: &str) -> usize {
        self.document.nodes.iter().position(|node| node.name.as_deref() == Some(name)).unwrap()
    }

    /// Returns the values of a node in the first animation.
    fn values(&self, node: usize, path: &str, kind: &str) -> Option<Vec<f32>> {
        let animation = self.document.animations.first()?;
        let channel = animation.channels.iter().find(|c| c.target.node == Some(node) && c.target.path == path)?;
        let output = animation.samplers[channel.sampler].output;
        Some(floats(&self.document, Glb::split(&self.bytes).unwrap().bin, output, kind).unwrap())
    }

    /// Returns a node's world position in a frame; ignores all scales except the first.
    fn place(&self, node: usize, frame: usize) -> Vector {
        self.world(node, frame).0
    }

    fn world(&self, node: usize, frame: usize) -> (Vector, Quat, f32) {
        let parents = self.document.parents().unwrap();
        let (from, turned, size) = parents[node].map_or(([0.0; 3], IDENTITY, 1.0), |parent| self.world(parent, frame));
        let of = &self.document.nodes[node];
        // A track with a single key is constant.
        fn at<T: Copy>(values: &[T], frame: usize) -> T {
            values[frame.min(values.len() - 1)]
        }
        let narrow = |v: f64| format!("{v}").parse::<f32>().unwrap();
        let mut place = of.translation.unwrap_or([0.0; 3]).map(narrow);
        if let Some(values) = self.values(node, "translation", "VEC3") {
            place = at(values.as_chunks().0, frame);
        }
        let mut rotation = of.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]).map(narrow);
        if let Some(values) = self.values(node, "rotation", "VEC4") {
            rotation = at(values.as_chunks().0, frame);
        }
        let step = rotate(turned, place.map(|x| x * size));
        let scale = of.scale.map_or(1.0, |scale| narrow(scale[0]));
        (std::array::from_fn(|i| from[i] + step[i]), product(turned, rotation), size * scale)
    }
}

fn limbs() -> [(&'static str, &'static str); 8] {
    [
        ("left_shoulder", "left_elbow"),
        ("left_elbow", "left_wrist"),
        ("right_shoulder", "right_elbow"),
        ("right_elbow", "right_wrist"),
        ("left_hip", "left_knee"),
        ("left_knee", "left_ankle"),
        ("right_hip", "right_knee"),
        ("right_knee", "right_ankle"),
    ]
}

fn joint(name: &str) -> usize {
    JOINT_NAMES.iter().position(|&known| known == name).unwrap()
}

/// Asserts that limbs point in the clip's directions; `ahead` rotates the clip's axes to the character's.
fn check_limbs(moved: &Moved, made: &Made, clip: &Clip, ahead: Quat) {
    check_limbs_turned(moved, made, clip, ahead, &limbs());
}

fn check_limbs_turned(moved: &Moved, made: &Made, clip: &Clip, ahead: Quat, limbs: &[(&str, &str)]) {
    for frame in 0..clip.len() {
        let want = joint_places(&clip.skeleton, &clip.pose(frame));
        for (from, to) in limbs {
            let place = |name: &str| moved.place(moved.node(&made.name(joint(name))), frame);
            let wanted = rotate(ahead, less(want[joint(to)], want[joint(from)]));
            let angle = angle_between(less(place(to), place(from)), wanted);
            assert!(angle < TOLERANCE, "{from} to {to}: {angle} rad");
        }
    }
}

/// Like [`check_limbs`], without the limb that ends in `joint`.
fn check_limbs_but(moved: &Moved, made: &Made, clip: &Clip, joint: &str) {
    let limbs: Vec<_> = limbs().into_iter().filter(|(_, to)| *to != joint).collect();
    check_limbs_turned(moved, made, clip, IDENTITY, &limbs);
}

#[test]
fn a_mixamo_character_in_centimetres_moves_as_the_clip_does() {
    let clip = sample::clip(FaceKind::Arkit, 4, 1);
    let made = mixamo();
    let moved = moved(&made, &clip);
    check_limbs(&moved, &made, &clip, IDENTITY);
    // ARKit shapes follow their channels; other shapes keep their weights.
    let node = moved.node("Face");
    let weights = moved.values(node, "weights", "SCALAR").unwrap();
    let jaw = clip.face.names.iter().position(|name| name == "jawOpen").unwrap();
    for frame in 0..clip.len() {
        assert_eq!(weights[3 * frame..][..3], [0.25, clip.face(frame)[jaw], clip.face(frame)[0]]);
    }
}

/// The hips of a character in centimetres are off by centimetres.
#[test]
fn few_keys_hold_the_motion_within_their_bound() {
    let (mut clip, degrees) = (sample::clip(FaceKind::Arkit, 60, 1), 2.0_f32);
    let channels = clip.face.names.len();
    for frame in 0..clip.len() {
        let wave = |speed: f32| (speed * frame as f32).sin() * 0.3;
        let (sin, cos) = (0.5 * wave(0.11)).sin_cos();
        clip.rotations[frame] = [[0.0, sin, 0.0, cos]; JOINTS];
        clip.translation[frame] = [wave(0.05), 0.0, wave(0.04)];
        clip.face_values[frame * channels..][..channels].fill(wave(0.03).abs());
    }
    let bytes = mixamo().bytes();
    let (all, few) = (
        moved_by(&bytes, &clip, &Given::default()),
        moved_within(&bytes, &clip, &Given::default(), Bound::new(degrees)),
    );
    let bin = |moved: &Moved| Glb::split(&moved.bytes).unwrap().bin.to_vec();
    let animation = &few.document.animations[0];
    let mut found = [0; 3];
    for channel in &animation.channels {
        let (node, path) = (channel.target.node.unwrap(), &*channel.target.path);
        let (number, kind, width, most) = match path {
            "rotation" => (0, "VEC4", 4, degrees.to_radians() / 2.0),
            "translation" => (1, "VEC3", 3, degrees),
            _ => (2, "SCALAR", 3, 0.01 * degrees),
        };
        let (dense, kept) = (all.values(node, path, kind).unwrap(), few.values(node, path, kind).unwrap());
        let times = floats(&few.document, &bin(&few), animation.samplers[channel.sampler].input, "SCALAR").unwrap();
        if times == [0.0] {
            continue;
        }
        assert_eq!((times.len(), times[0], times[times.len() - 1]), (kept.len() / width, 0.0, 59.0 / 30.0), "{path}");
        found[number] += times.len();
        for (frame, want) in dense.chunks_exact(width).enumerate() {
            let next = times.partition_point(|&time| time * 30.0 < frame as f32 - 1e-3).max(1);
            let share = (frame as f32 / 30.0 - times[next - 1]) / (times[next] - times[next - 1]);
            let key = |at: usize| &kept[at * width..][..width];
            let at = |i: usize| key(next - 1)[i] + share * (key(next)[i] - key(next - 1)[i]);
            // Of rotations the chord, which is as near as the arc between keys that are near.
            let off = |sign: f32| (0..width).map(|i| (at(i) - sign * want[i]).powi(2)).sum::<f32>().sqrt();
            let off = if number == 0 { off(1.0).min(off(-1.0)) } else { off(1.0) };
            assert!(off < 1.8 * most, "{path} at {frame}: {off} of {most}");
        }
    }
    assert!(found.iter().all(|&keys| keys > 0) && found[1] < 60 && found[2] < 30, "{found:?}");
}

#[test]
fn vrm_files_of_both_versions_move_by_their_own_tables() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    for version in [0, 1] {
        let made = vrm(version);
        let moved = moved(&made, &clip);
        // VRM 0.x characters face -Z.
        let half = if version == 0 { [0.0, 1.0, 0.0, 0.0] } else { IDENTITY };
        check_limbs(&moved, &made, &clip, half);
        let weights = moved.values(moved.node("Face"), "weights", "SCALAR").unwrap();
        let map = umo_core::FaceMap::new(&clip.face, &["aa", "blink"]);
        for frame in 0..clip.len() {
            let mut want = [0.0; 2];
            map.apply(clip.face(frame), &mut want);
            let got = &weights[3 * frame..][..3];
            let near = |a: f32, b: f32| (a - b).abs() < 1e-6;
            assert!(near(got[0], 0.25) && near(got[1], want[0]) && near(got[2], 0.5 * want[1]), "{got:?} {want:?}");
        }
    }
}

#[test]
fn a_face_without_bones_moves_by_its_shapes_alone() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    let mut made = mixamo();
    let face = made.index("Face");
    let mut node = made.json["nodes"][face].clone();
    node.as_object_mut().unwrap().remove("skin");
    // The node's transform as a matrix, which some programs write.
    node["matrix"] = json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 1, 0, 1]);
    made.json["nodes"] = json!([node]);
    made.json["scenes"] = json!([{ "nodes": [0] }]);
    made.json["skins"] = json!([]);
    made.json["animations"] = json!([]);
    made.json["meshes"][0]["extras"]["targetNames"] = json!(["BROW-Down.L", "mouthOpen", "mouthSmile"]);
    let moved = moved(&made, &clip);
    let channels = &moved.document.animations[0].channels;
    assert_eq!(channels.iter().map(|channel| channel.target.path.as_str()).collect::<Vec<_>>(), ["weights"]);
    let weights = moved.values(0, "weights", "SCALAR").unwrap();
    let of =
        |frame: usize, name: &str| clip.face(frame)[clip.face.names.iter().position(|known| known == name).unwrap()];
    for frame in 0..clip.len() {
        let open = (of(frame, "jawOpen") - of(frame, "mouthClose")).max(0.0) / 0.7;
        let open = open.min(1.0);
        let smile = 0.5 * (of(frame, "mouthSmileLeft") + of(frame, "mouthSmileRight"));
        let wanted = [of(frame, "browDownLeft"), open, smile];
        assert!(weights[3 * frame..][..3].iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-6), "frame {frame}");
    }
    // A file with neither bones nor shapes is refused as a character.
    made.json["meshes"][0]["primitives"][0].as_object_mut().unwrap().remove("targets");
    let target = Target::read("a.glb".as_ref(), made.bytes()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    assert!(mapping.check(target.rig()).is_err());
}

#[test]
fn a_sheet_shows_the_character_as_it_moves() {
    let clip = sample::clip(FaceKind::Arkit, 13, 1);
    let mut made = mixamo();
    made.bind(DMat4::IDENTITY);
    // A body-sized triangle on the head.
    let place = usize::try_from(made.json["bufferViews"][0]["byteOffset"].as_u64().unwrap()).unwrap();
    let corners: [f32; 9] = [-0.5, 0.2, 0.2, 0.5, 0.2, 0.2, 0.0, 1.7, 0.2];
    corners
        .iter()
        .enumerate()
        .for_each(|(at, corner)| made.bin[place + 4 * at..][..4].copy_from_slice(&corner.to_le_bytes()));
    let target = Target::read("a.glb".as_ref(), made.bytes()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    let faces = target.faces(&mapping, &clip.face, &Given::default()).unwrap();
    let retarget = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)).unwrap();
    let motion = motion(&retarget, &clip).unwrap();
    let Target::Character(character) = &target else { panic!("a character") };
    let picture = sheet::draw(character, &mapping, &retarget, &motion, &faces, &clip, None).unwrap();
    let mut bytes = Vec::new();
    picture.write(&mut bytes).unwrap();
    let mut reader = png::Decoder::new(std::io::Cursor::new(&bytes)).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    let [width, height] = [info.width, info.height].map(|side| side as usize);
    assert_eq!([width, height], [1320, 880]);
    // Every cell has a drawing, and the character's drawings differ.
    let cell = |column: usize, rows: std::ops::Range<usize>| {
        let row = |y: usize| &pixels[3 * (y * width + 220 * column)..][..3 * 220];
        rows.flat_map(row).copied().collect::<Vec<u8>>()
    };
    let empty: Vec<u8> = pixels[..3].to_vec();
    for column in 0..6 {
        for rows in [0..330, 330..660, 660..880] {
            let drawn = cell(column, rows).as_chunks::<3>().0.iter().filter(|pixel| pixel[..] != empty[..]).count();
            assert!(drawn > 1000, "column {column}: {drawn} pixels");
        }
    }
    assert_ne!(cell(0, 330..660), cell(3, 330..660));
}

/// Returns frames for a mesh built in the scene's space, in the armature's, and in one with Z up.
fn frames() -> [(&'static str, DMat4); 3] {
    let turned = DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    [
        ("scene", DMat4::IDENTITY),
        ("armature", DMat4::from_scale(DVec3::splat(0.01))),
        ("z up", DMat4::from_quat(turned)),
    ]
}

#[test]
fn a_character_exported_in_mid_animation_moves_from_its_bind_pose() {
    let clip = sample::clip(FaceKind::Arkit, 3, 5);
    let mut made = mixamo();
    // Undriven bones take the bind pose too.
    for node in made.json["nodes"].as_array_mut().unwrap() {
        let name = node["name"].as_str().unwrap().replace("LeftHand", "Odd");
        node["name"] = name.into();
    }
    for (space, frame) in frames() {
        let mut bound = made.clone();
        bound.bind(frame);
        if space == "z up" {
            let face = bound.index("Face");
            bound.json["nodes"][face]["rotation"] = json!(DQuat::from_mat4(&frame).to_array());
        }
        let want = moved(&bound, &clip);
        check_limbs_but(&want, &bound, &clip, "left_wrist");
        // A changed pose of all joints, and a distant root alone.
        for (turn, step) in [(0.5, [430.0, -20.0, 100.0]), (0.0, [430.0, 0.0, 0.0])] {
            let mut posed = bound.clone();
            posed.pose(turn, step);
            let found = moved(&posed, &clip);
            for (node, frame) in (1..=JOINTS).flat_map(|node| (0..clip.len()).map(move |frame| (node, frame))) {
                let [(place, rotation, _), (wanted, turned, _)] = [&found, &want].map(|file| file.world(node, frame));
                let apart = less(place, wanted).iter().fold(0.0_f32, |most, v| most.max(v.abs()));
                assert!(apart < 1e-4, "{space}, {turn}: node {node} is {apart} m away");
                let dot: f32 = rotation.iter().zip(turned).map(|(a, b)| a * b).sum();
                assert!(dot.abs() > 1.0 - 1e-5, "{space}, {turn}: node {node} is turned");
            }
        }
    }
}

#[test]
fn a_character_whose_nodes_are_in_the_bind_pose_stays_where_it_was_placed() {
    let clip = sample::clip(FaceKind::Arkit, 2, 6);
    let mut placed = mixamo();
    placed.bind(DMat4::IDENTITY);
    let want = moved(&mixamo(), &clip);
    for step in [[0.0; 3], [0.0, 0.4, 0.0]] {
        // The character as a whole at another position in the scene.
        placed.json["nodes"][0]["translation"] = json!(step);
        let found = moved(&placed, &clip);
        let channels = |file: &Moved| file.document.animations[0].channels.len();
        assert_eq!(channels(&found), channels(&want));
        let lifted = less(found.place(20, 1), want.place(20, 1));
        assert!(lifted.iter().zip(step).all(|(&a, b)| (f64::from(a) - b).abs() < 1e-4), "{lifted:?}");
    }
}

#[test]
fn only_a_vrm_character_is_written_as_vrm() {
    let check = |made: Made, output: &str| {
        let target = Target::read("a.glb".as_ref(), made.bytes()).unwrap();
        target.check_output(output.as_ref())
    };
    check(vrm(0), "out.vrm").unwrap();
    check(vrm(1), "out.VRM").unwrap();
    check(vrm(1), "out.glb").unwrap();
    check(mixamo(), "out.glb").unwrap();
    assert!(check(mixamo(), "out.vrm").unwrap_err().to_string().contains("name it .glb"));
    assert!(check(mixamo(), "out.bvh").unwrap_err().to_string().contains("expected .glb"));
}

#[test]
fn all_else_in_the_file_stays_as_it_was() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    for made in [mixamo(), vrm(0), vrm(1)] {
        let moved = moved(&made, &clip);
        let before = Moved::read(made.bytes());
        let (old, new) = (Glb::split(&before.bytes).unwrap(), Glb::split(&moved.bytes).unwrap());
        assert_eq!(new.bin[..old.bin.len()], *old.bin, "the buffer begins as it was");
        assert_eq!(new.more, old.more);
        let (old, new) = (Members::parse(old.json).unwrap(), Members::parse(new.json).unwrap());
        for (name, value) in &old.0 {
            let now = &new.0.iter().find(|(known, _)| known == name).unwrap().1;
            match name.as_str() {
                // The new animation comes first; other new elements come last.
                "accessors" | "bufferViews" | "animations" => {
                    let (old, mut new) = (old.list(name).unwrap(), new.list(name).unwrap());
                    let added = new.len() - old.len();
                    assert!(added > 0, "{name}");
                    new.rotate_left(if name == "animations" { added } else { 0 });
                    assert!(old.iter().zip(&new).all(|(old, new)| old.get() == new.get()), "{name}");
                }
                "buffers" => assert_eq!(before.json["buffers"][0]["name"], moved.json["buffers"][0]["name"]),
                _ => assert_eq!(value.get(), now.get(), "{name}"),
            }
        }
    }
}

/// Validates results with the Khronos validator if `scripts/test/validate-glb` has installed it. Not on Windows: under
/// Wine, Linux's validator would get Windows paths.
#[cfg(not(windows))]
#[test]
fn the_validator_finds_nothing_wrong() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    if !root.join("target/gltf-validator/node_modules").is_dir() {
        println!("SKIPPED: scripts/test/validate-glb was never run");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let clip = sample::clip(FaceKind::Arkit, 4, 1);
    let mut command = std::process::Command::new(root.join("scripts/test/validate-glb"));
    // Not VRM 0.x, because the validator rejects its extension's name.
    let mut posed = mixamo();
    posed.bind(DMat4::IDENTITY);
    posed.pose(0.3, [430.0, 0.0, 0.0]);
    for (name, made) in [("mixamo", mixamo()), ("posed", posed), ("vrm1", vrm(1))] {
        for (kind, bytes) in [("before", made.bytes()), ("after", moved(&made, &clip).bytes)] {
            let path = folder.path().join(format!("{name}-{kind}.glb"));
            std::fs::write(&path, bytes).unwrap();
            command.arg(path);
        }
    }
    let ended = command.output().unwrap();
    assert!(ended.status.success(), "{}", String::from_utf8_lossy(&ended.stdout));
}

#[test]
fn matrices_of_nodes_that_move_become_what_animations_need() {
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    let mut made = mixamo();
    let at = made.index("mixamorig:LeftArm");
    let [x, y, z] = made.translation(at);
    made.json["nodes"][at] = {
        let mut node = made.json["nodes"][at].clone();
        let members = node.as_object_mut().unwrap();
        members.remove("translation");
        members.remove("rotation");
        // A quarter turn about Z.
        let matrix = [0.0, 1.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0];
        members.insert("matrix".to_owned(), json!(matrix));
        node
    };
    let moved = moved(&made, &clip);
    assert!(moved.document.nodes[at].matrix.is_none());
    check_limbs(&moved, &made, &clip, IDENTITY);
}

#[test]
fn a_mapping_file_goes_before_names() {
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    let mut made = mixamo();
    let at = made.index("mixamorig:LeftArm");
    made.json["nodes"][at]["name"] = "Wing".into();
    let target = Target::read("a.glb".as_ref(), made.bytes()).unwrap();
    let (mapping, _) = target.mapping(&Given::default()).unwrap();
    assert!(mapping.check(target.rig()).is_err());
    for (text, is_json) in [
        (
            "[bones]\nleft_shoulder = \"Wing\"\njaw = \"\"\n[face]\nmouthFunnel = { Other = 0.5 }\nmouthPucker = \"Other\"",
            false,
        ),
        (
            r#"{"bones": {"left_shoulder": ["Wing"]}, "face": {"mouthFunnel": {"Other": 0.5}, "mouthPucker": ["Other"]}}"#,
            true,
        ),
    ] {
        let given = mapping::parse(text, is_json).unwrap();
        let moved = moved_by(&made.bytes(), &clip, &given);
        let weights = moved.values(moved.node("Face"), "weights", "SCALAR").unwrap();
        let value = |name: &str| clip.face(1)[clip.face.names.iter().position(|known| known == name).unwrap()];
        let want = (0.5 * value("mouthFunnel") + value("mouthPucker")).min(1.0);
        assert!((weights[3] - want).abs() < 1e-6);
    }
    let refused = |text: &str| match mapping::parse(text, false) {
        Err(problem) => problem,
        Ok(given) => match target.mapping(&given) {
            Err(problem) => problem,
            Ok((mapping, _)) => target.faces(&mapping, &clip.face, &given).unwrap_err(),
        },
    };
    assert!(refused("[bone]").contains("bone"));
    assert!(refused("[bones]\nleft_wing = \"Wing\"").contains("`left_wing` is not a joint"));
    assert!(refused("[bones]\nhead = \"Hed\"").contains("`mixamorig:Head`"));
    assert!(refused("[face]\njawOpen = \"Jaw\"").contains("Other"));
    assert!(refused("[face]\nchewing = \"Other\"").contains("not a face channel"));
}

#[test]
fn a_jaw_that_a_shape_opens_is_not_turned_as_well() {
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    let mut made = vrm(1);
    let moved_jaw = |made: &Made| moved(made, &clip).values(made.index("jaw"), "rotation", "VEC4").is_some();
    assert!(!moved_jaw(&made));
    made.json["extensions"]["VRMC_vrm"]["expressions"] = Value::Null;
    assert!(moved_jaw(&made));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Corrupt files are accepted or refused, without a panic.
    #[test]
    fn corrupt_files_do_not_panic(at in 0.0_f64..1.0, byte in any::<u8>(), cut in any::<bool>()) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a place in a small file")]
        fn spoil(bytes: &mut Vec<u8>, at: f64, byte: u8, cut: bool) {
            let place = (at * bytes.len() as f64) as usize;
            bytes[place] = byte;
            if cut { bytes.truncate(place) }
        }
        let clip = sample::clip(FaceKind::Arkit, 1, 1);
        for made in [mixamo(), vrm(0)] {
            let mut bytes = made.bytes();
            spoil(&mut bytes, at, byte, cut);
            let Ok(target) = Target::read("a.glb".as_ref(), bytes) else { continue };
            let Ok((mapping, _)) = target.mapping(&Given::default()) else { continue };
            let Ok(faces) = target.faces(&mapping, &clip.face, &Given::default()) else { continue };
            let Ok(retarget) = prepare(&clip.skeleton, target.rig(), &mapping, target.floor(&mapping)) else { continue };
            let motion = motion(&retarget, &clip).unwrap();
            let _ = target.animated(&retarget, &motion, &faces, &clip);
        }
    }
}

#[test]
fn files_that_cannot_be_moved_are_refused_with_a_reason() {
    let refused = |change: &dyn Fn(&mut Value)| {
        let mut made = mixamo();
        change(&mut made.json);
        match Target::read("a.glb".as_ref(), made.bytes()) {
            Err(problem) => problem,
            Ok(target) => {
                let (mapping, _) = target.mapping(&Given::default()).unwrap();
                prepare(&sample::clip(FaceKind::Arkit, 1, 1).skeleton, target.rig(), &mapping, target.floor(&mapping))
                    .unwrap_err()
            }
        }
    };
    assert!(refused(&|json| json["nodes"][2]["children"] = json!([0])).contains("ancestor"));
    assert!(refused(&|json| json["nodes"][2]["children"] = json!([2])).contains("two parents"));
    assert!(refused(&|json| json["nodes"][2]["children"] = json!([9999])).contains("no node 9999"));
    assert!(refused(&|json| json["nodes"][0]["scale"] = json!([1, 2, 1])).contains("scaled unevenly"));
    assert!(refused(&|json| json["nodes"][1]["translation"] = json!([1e300, 0, 0])).contains("not finite"));
    assert!(refused(&|json| json["nodes"][1]["matrix"] = json!(vec![0; 16])).contains("scaled unevenly"));
    assert!(refused(&|json| json["skins"][0]["joints"] = json!([9999])).contains("no node 9999"));
    assert!(refused(&|json| json["buffers"][0]["uri"] = json!("a.bin")).contains("another file"));
    assert!(refused(&|json| json["buffers"][0]["byteLength"] = json!(u64::MAX)).contains("cut short"));
    assert!(refused(&|json| json["nodes"] = json!([])).contains("there is no node"));
    let missing = Target::read("a.txt".as_ref(), Vec::new()).err().unwrap();
    assert!(missing.contains(".glb"));
    // A file without skins, meshes and buffers still has nodes to move.
    let mut bare = mixamo();
    bare.json = json!({ "asset": { "version": "2.0" }, "nodes": bare.json["nodes"] });
    for node in bare.json["nodes"].as_array_mut().unwrap() {
        node.as_object_mut().unwrap().retain(|name, _| name != "mesh" && name != "skin");
    }
    bare.bin.clear();
    let clip = sample::clip(FaceKind::Arkit, 2, 1);
    check_limbs(&moved(&bare, &clip), &bare, &clip, IDENTITY);
}

#[test]
fn every_joint_has_a_name_in_the_made_rigs() {
    for made in [mixamo(), vrm(0), vrm(1)] {
        let names: std::collections::HashSet<_> = (0..JOINTS).map(|joint| made.name(joint)).collect();
        assert_eq!(names.len(), JOINTS);
    }
}

/// Arms folded in front of a person are out of a wide body.
#[test]
fn a_mapping_file_sizes_the_body() {
    let made = mixamo();
    let mut clip = sample::clip(FaceKind::Arkit, 1, 1);
    clip.rotations[0] = [IDENTITY; JOINTS];
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        clip.rotations[0][16 + side] = umo_core_pose::rotation::axis_angle_to_quat([0.0, 0.0, -1.2 * sign]);
        clip.rotations[0][18 + side] = umo_core_pose::rotation::axis_angle_to_quat([0.0, -1.9 * sign, 0.0]);
    }
    let ahead = |text: &str| {
        let given = mapping::parse(text, false).unwrap();
        let moved = moved_with(&made.bytes(), &clip, &given, true);
        moved.place(moved.node(&made.name(joint("left_wrist"))), 0)[2]
    };
    let plain = moved(&made, &clip);
    let plain = plain.place(plain.node(&made.name(joint("left_wrist"))), 0)[2];
    let (none, wide) =
        (ahead("[body]\nbelly = 1.6"), ahead("[body]\ngain = 1\nbelly = 1.6\nchest = 1.6\npelvis = 1.6"));
    assert_eq!(none, plain);

    assert!(wide > plain + 0.05, "{wide} {plain}");
    let target = Target::read("a.glb".as_ref(), made.bytes()).unwrap();
    let (found, _) = target.mapping(&Given::default()).unwrap();
    let mut retarget = prepare(&clip.skeleton, target.rig(), &found, target.floor(&found)).unwrap();
    for (text, problem) in [("[body]\ntail = 2", "tail"), ("[body]\ngain = 2", "gain"), ("[body]\nbelly = -1", "belly")]
    {
        let given = mapping::parse(text, false).unwrap();
        let error = target.give_volume(&mut retarget, &found, &given).unwrap_err();
        assert!(error.contains(problem), "{text}: {error}");
    }
}

#[test]
fn a_page_has_what_the_command_writes() {
    let (made, clip) = (mixamo(), sample::clip(FaceKind::Arkit, 4, 1));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("mixamo.GLB");
    std::fs::write(&path, made.bytes()).unwrap();
    let worn = Wearer::read(&path, None).unwrap().wear(&clip).unwrap();
    let whole = moved_with(&made.bytes(), &clip, &Given::default(), true);
    assert!(worn.file == whole.bytes, "the files differ");
    assert!((worn.seconds - 3.0 / f64::from(clip.frame_rate)).abs() < 1e-9);
    for (joint, name) in JOINT_NAMES.iter().enumerate().filter(|(_, name)| **name != "jaw") {
        assert_eq!(worn.nodes[joint], Some(made.index(&made.name(joint))), "{name}");
    }
    // A stream's frames give the same values, in the channels' order.
    let mut still = sample::clip(FaceKind::Arkit, 1, 1);
    still.rotations[0] = [IDENTITY; JOINTS];
    let (streamed, follower) = Wearer::read(&path, None).unwrap().follow(&still).unwrap();
    let waiting = Moved::read(streamed.file);
    let (mut room, mut values) = (follower.scratch(), Vec::new());
    for frame in 0..clip.len() {
        values.clear();
        follower.add(&mut room, &clip.pose(frame), clip.face(frame), &mut values).unwrap();
        let mut rest = &values[..];
        for channel in &waiting.document.animations[0].channels[streamed.streamed.unwrap()..] {
            let (node, path) = (channel.target.node.unwrap(), channel.target.path.as_str());
            let kind = match path {
                "rotation" => "VEC4",
                "translation" => "VEC3",
                _ => "SCALAR",
            };
            let wanted = whole.values(node, path, kind).unwrap();
            let width = wanted.len() / clip.len();
            let (own, more) = rest.split_at(width);
            rest = more;
            let wanted = &wanted[width * frame..][..width];
            let sign = if path == "rotation" && own.iter().zip(wanted).map(|(a, b)| a * b).sum::<f32>() < 0.0 {
                -1.0
            } else {
                1.0
            };
            assert!(own.iter().zip(wanted).all(|(a, b)| (sign * a - b).abs() < 1e-6), "node {node}, {path}");
        }
        assert!(rest.is_empty());
    }
    std::fs::write(&path, &worn.file).unwrap();
    let again = Wearer::read(&path, None).unwrap().own_motion().unwrap();
    assert!(again.file == worn.file && again.nodes == worn.nodes);
    assert!((again.seconds - worn.seconds).abs() < 1e-6);
}
