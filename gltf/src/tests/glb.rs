use super::*;
use gltf::animation::util::ReadOutputs;
use gltf::{Gltf, Node};
use std::collections::HashMap;
use std::io;
use std::sync::{Mutex, PoisonError};

use crate::glb::{BuiltFigure, Member, write_room};

/// Bytes that `write` writes on the default figure, which is built once for each skeleton and face.
pub(super) fn built(clip: &Clip, write: impl FnOnce(&BuiltFigure, &mut Vec<u8>) -> io::Result<()>) -> Vec<u8> {
    static BUILT: Mutex<Vec<BuiltFigure>> = Mutex::new(Vec::new());
    let mut built = BUILT.lock().unwrap_or_else(PoisonError::into_inner);
    if !built.iter().any(|figure| figure.fits(clip)) {
        built.push(BuiltFigure::new(Figure::default(), clip).unwrap());
    }
    let mut bytes = Vec::new();
    write(built.iter().find(|figure| figure.fits(clip)).unwrap(), &mut bytes).unwrap();
    bytes
}

/// A file as parsed by the `gltf` crate.
pub(super) struct File {
    pub(super) gltf: Gltf,
    pub(super) bin: Vec<u8>,
}

impl File {
    /// On the default figure.
    pub(super) fn of(clip: &Clip) -> Self {
        Self::parsed(&built(clip, |figure, bytes| figure.write(clip, bytes)))
    }

    fn worn(clip: &Clip, figure: Option<Figure>) -> Self {
        let mut bytes = Vec::new();
        crate::glb::write(clip, figure, &mut bytes).unwrap();
        Self::parsed(&bytes)
    }

    pub(super) fn parsed(bytes: &[u8]) -> Self {
        let mut gltf = Gltf::from_slice(bytes).unwrap();
        let bin = gltf.blob.take().unwrap();
        Self { gltf, bin }
    }

    pub(super) fn node(&self, name: &str) -> Node<'_> {
        self.gltf.nodes().find(|node| node.name() == Some(name)).unwrap()
    }

    /// Rotations, translations and shape weights over time, by node.
    fn tracks(&self) -> HashMap<usize, Track> {
        let animation = self.gltf.animations().next().unwrap();
        let mut tracks: HashMap<usize, Track> = HashMap::new();
        for channel in animation.channels() {
            let reader = channel.reader(|_| Some(&self.bin));
            let track = tracks.entry(channel.target().node().index()).or_default();
            track.times = reader.read_inputs().unwrap().collect();
            match reader.read_outputs().unwrap() {
                ReadOutputs::Rotations(q) => track.rotations = q.into_f32().collect(),
                ReadOutputs::Translations(t) => track.translations = t.collect(),
                ReadOutputs::MorphTargetWeights(w) => track.weights = w.into_f32().collect(),
                ReadOutputs::Scales(_) => panic!("nothing is scaled"),
            }
        }
        tracks
    }

    /// Positions of all named nodes in a frame.
    fn positions(&self, frame: usize) -> HashMap<String, Point> {
        let mut found = HashMap::new();
        let tracks = self.tracks();
        for root in self.gltf.default_scene().unwrap().nodes() {
            let start = ([0.0; 3], [0.0, 0.0, 0.0, 1.0]);
            place(&root, start, frame, &tracks, &mut found);
        }
        found
    }

    fn morph_targets(&self) -> Vec<Vec<[f32; 3]>> {
        let mesh = self.node("face").mesh().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(&self.bin));
        let targets = reader.read_morph_targets();
        targets.map(|(moved, ..)| moved.unwrap().collect()).collect()
    }
}

#[derive(Default)]
struct Track {
    times: Vec<f32>,
    rotations: Vec<[f32; 4]>,
    translations: Vec<[f32; 3]>,
    weights: Vec<f32>,
}

fn place(
    node: &Node<'_>,
    (from, turned): (Point, [f64; 4]),
    frame: usize,
    tracks: &HashMap<usize, Track>,
    found: &mut HashMap<String, Point>,
) {
    let (mut offset, mut q, _) = node.transform().decomposed();
    if let Some(track) = tracks.get(&node.index()) {
        offset = track.translations.get(frame).copied().unwrap_or(offset);
        q = track.rotations.get(frame).copied().unwrap_or(q);
    }
    let step = rotate(turned, offset.map(f64::from));
    let here = std::array::from_fn(|i| from[i] + step[i]);
    let turned = multiply(turned, q.map(f64::from));
    found.insert(node.name().unwrap().to_owned(), here);
    for child in node.children() {
        place(&child, (here, turned), frame, tracks, found);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]
    #[test]
    fn glb_puts_every_joint_where_the_quaternions_do(clip in any_clip(FaceKind::Arkit, 2)) {
        let file = File::of(&clip);
        for frame in 0..2 {
            let found = file.positions(frame);
            for (name, want) in JOINT_NAMES.iter().zip(positions(&clip, frame)) {
                prop_assert!(distance(found[*name], want) < 1e-5, "{}", name);
            }
        }
    }
}

#[test]
fn glb_animates_joints_and_face_at_the_frame_times() {
    for kind in KINDS {
        let clip = sample::clip(kind, 9, 1);
        let file = File::of(&clip);
        let tracks = file.tracks();
        assert_eq!(tracks.len(), JOINTS + helpers(&clip).len() + 1);
        let times: Vec<f32> = (0..9).map(|f| f as f32 / 30.0).collect();
        assert!(tracks.values().all(|track| track.times == times));
        let face = &tracks[&file.node("face").index()];
        assert_eq!(face.weights, clip.face_values);
    }
}

#[test]
fn glb_keeps_quaternions_on_one_side_and_of_unit_length() {
    let mut clip = sample::clip(FaceKind::Arkit, 8, 1);
    for rotations in clip.rotations.iter_mut().step_by(2) {
        rotations[3] = rotations[3].map(|x| x * -0.9999);
    }
    let file = File::of(&clip);
    let joint = &file.tracks()[&file.node("spine1").index()].rotations;
    let dot = |a: &[f32; 4], b: &[f32; 4]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    assert!(joint.iter().all(|q| (dot(q, q) - 1.0).abs() < 1e-6));
    assert!(joint.windows(2).all(|pair| dot(&pair[0], &pair[1]) > 0.5));
}

#[test]
fn glb_names_a_shape_for_every_face_channel() {
    for kind in KINDS {
        let clip = sample::clip(kind, 1, 1);
        let file = File::of(&clip);
        let mesh = file.node("face").mesh().unwrap();
        let extras = mesh.extras().as_ref().unwrap().get().to_owned();
        let extras: serde_json::Value = serde_json::from_str(&extras).unwrap();
        let names: Vec<String> = serde_json::from_value(extras["targetNames"].clone()).unwrap();
        assert_eq!(names, clip.face.names);
        let targets = file.morph_targets();
        assert_eq!(targets.len(), names.len());
        for (name, moved) in names.iter().zip(&targets) {
            let furthest = moved.iter().map(|&d| distance(d.map(f64::from), [0.0; 3]));
            let furthest = furthest.fold(0.0, f64::max);
            assert!((0.001..0.06).contains(&furthest), "{name} moves {furthest} m");
        }
        if kind == FaceKind::Arkit {
            let alike = |a: usize| targets[..a].contains(&targets[a]);
            assert!(!(0..names.len()).any(alike), "no two shapes are the same");
        }
    }
}

#[test]
fn glb_shapes_move_what_their_names_say() {
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let file = File::of(&clip);
    let mesh = file.node("face").mesh().unwrap();
    let primitive = mesh.primitives().next().unwrap();
    let rest: Vec<[f32; 3]> = primitive.reader(|_| Some(&file.bin)).read_positions().unwrap().collect();
    let targets = file.morph_targets();
    let target = |name: &str| &targets[clip.face.names.iter().position(|n| n == name).unwrap()];
    let mean = |name: &str, of: fn(&[f32; 3], &[f32; 3]) -> f32| -> f32 {
        rest.iter().zip(target(name)).map(|(at, moved)| of(at, moved)).sum()
    };
    assert!(mean("jawOpen", |_, moved| moved[1]) < -0.1);
    assert!(mean("browInnerUp", |_, moved| moved[1]) > 0.01);
    assert!(mean("jawLeft", |_, moved| moved[0]) > 0.01);
    assert!(mean("jawRight", |_, moved| moved[0]) < -0.01);
    // Sided shapes stay on their side: the body's left is +X.
    let wrong = |at: &[f32; 3], moved: &[f32; 3]| if at[0] < -0.02 { moved[1].abs() } else { 0.0 };
    let right = |at: &[f32; 3], moved: &[f32; 3]| if at[0] > 0.02 { moved[1].abs() } else { 0.0 };
    for name in ["eyeBlinkLeft", "mouthSmileLeft", "browDownLeft"] {
        assert!(mean(name, wrong) < 0.05 * mean(name, right), "{name}");
    }
    for name in ["eyeBlinkRight", "mouthSmileRight", "browDownRight"] {
        assert!(mean(name, right) < 0.05 * mean(name, wrong), "{name}");
    }
    // The open jaw parts the lips: of two coincident vertices, one moves down.
    let parted =
        |a: usize, b: usize| rest[a] == rest[b] && (target("jawOpen")[a][1] - target("jawOpen")[b][1]).abs() > 0.01;
    assert!((0..rest.len()).any(|a| (0..a).any(|b| parted(a, b))));
}

fn helpers(clip: &Clip) -> Vec<umo_figure::Helper> {
    Figure::default().mesh(&clip.skeleton).unwrap().helpers
}

/// Compares with a reader that knows helper joints only as nodes.
#[test]
fn glb_moves_the_cloth_as_the_figure_does() {
    let clip = sample::clip(FaceKind::Arkit, 3, 1);
    let mesh = Figure::default().mesh(&clip.skeleton).unwrap();
    let file = File::of(&clip);
    let frame = 2;
    let (tracks, places) = (file.tracks(), file.positions(frame));
    let mut turned = HashMap::new();
    for root in file.gltf.default_scene().unwrap().nodes() {
        turn(&root, [0.0, 0.0, 0.0, 1.0], frame, &tracks, &mut turned);
    }
    let rest: Vec<Point> = {
        let skin = file.node("body").skin().unwrap();
        let matrices = skin.reader(|_| Some(&file.bin)).read_inverse_bind_matrices().unwrap();
        matrices.map(|m| [0, 1, 2].map(|i: usize| f64::from(-m[3][i]))).collect()
    };
    let names: Vec<String> = file.node("body").skin().unwrap().joints().map(|j| j.name().unwrap().to_owned()).collect();
    let posed = mesh.posed(&clip.skeleton, &clip.rotations[frame], clip.translation[frame], &[]);
    for vertex in (0..mesh.head).step_by(7) {
        let p = mesh.positions[vertex].map(f64::from);
        let mut sum = [0.0; 3];
        for (&joint, &weight) in mesh.joints[vertex].iter().zip(&mesh.weights[vertex]) {
            let joint = usize::from(joint);
            let step = rotate(turned[&names[joint]], std::array::from_fn(|i| p[i] - rest[joint][i]));
            let moved: Point = std::array::from_fn(|i| places[&names[joint]][i] + step[i]);
            sum = std::array::from_fn(|i| sum[i] + f64::from(weight) * moved[i]);
        }
        assert!(distance(sum, posed.positions[vertex].map(f64::from)) < 1e-4, "vertex {vertex}");
    }
}

fn turn(
    node: &Node<'_>,
    above: [f64; 4],
    frame: usize,
    tracks: &HashMap<usize, Track>,
    found: &mut HashMap<String, [f64; 4]>,
) {
    let own = tracks.get(&node.index()).and_then(|track| track.rotations.get(frame).copied());
    let turned = multiply(above, own.unwrap_or([0.0, 0.0, 0.0, 1.0]).map(f64::from));
    found.insert(node.name().unwrap().to_owned(), turned);
    node.children().for_each(|child| turn(&child, turned, frame, tracks, found));
}

#[test]
fn glb_skin_leaves_the_rest_pose_as_it_is() {
    let clip = sample::clip(FaceKind::SmplxExpression, 1, 1);
    let file = File::of(&clip);
    let skin = file.node("body").skin().unwrap();
    let joints: Vec<_> = skin.joints().map(|j| j.name().unwrap().to_owned()).collect();
    let all = JOINT_NAMES.map(str::to_owned).into_iter().chain(helpers(&clip).into_iter().map(|one| one.name));
    let all: Vec<_> = all.collect();
    assert_eq!(joints, all);
    let inverse = skin.reader(|_| Some(&file.bin)).read_inverse_bind_matrices();
    let mut rest: Vec<[f32; 3]> = Vec::new();
    for (joint, matrix) in inverse.unwrap().take(JOINTS).enumerate() {
        let from = clip.parent(joint).map_or([0.0; 3], |parent| rest[parent]);
        let offset = clip.skeleton.offsets_m[joint];
        rest.push(std::array::from_fn(|i| from[i] + offset[i]));
        assert!((0..3).all(|i| (matrix[3][i] + rest[joint][i]).abs() < 1e-6));
    }
    for name in ["body", "face"] {
        for primitive in file.node(name).mesh().unwrap().primitives() {
            let reader = primitive.reader(|_| Some(&file.bin));
            let weights = reader.read_weights(0).unwrap().into_f32();
            let joints = reader.read_joints(0).unwrap().into_u16();
            for (weights, joints) in weights.zip(joints) {
                assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6);
                assert!(joints.iter().all(|&joint| usize::from(joint) < all.len()));
            }
        }
    }
}

#[test]
fn glb_bends_the_jaw_where_no_shape_opens_it() {
    for (kind, bends) in [(FaceKind::SmplxExpression, true), (FaceKind::Arkit, false)] {
        let file = File::of(&sample::clip(kind, 1, 1));
        let mesh = file.node("face").mesh().unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|_| Some(&file.bin));
        let mut joints = reader.read_joints(0).unwrap().into_u16();
        assert_eq!(joints.any(|joint| JOINT_NAMES.get(usize::from(joint[0])) == Some(&"jaw")), bends);
    }
}

#[test]
fn glb_holds_a_face_without_channels_and_bones_without_length() {
    let mut clip = sample::clip(FaceKind::SmplxExpression, 1, 1);
    clip.face.names.clear();
    clip.face_values.clear();
    clip.skeleton.offsets_m.fill([0.0; 3]);
    let file = File::of(&clip);
    assert_eq!(file.tracks().len(), JOINTS + helpers(&clip).len());
    assert!(file.morph_targets().is_empty());
}

/// The motion is that of the file with a figure, and a skin references the bones, so that readers recognise them.
#[test]
fn glb_without_a_figure_holds_the_same_motion_of_the_bones_alone() {
    for kind in KINDS {
        let clip = sample::clip(kind, 4, 1);
        let (bare, worn) = (File::worn(&clip, None), File::of(&clip));
        assert_eq!(bare.gltf.meshes().count() + bare.gltf.images().count() + bare.gltf.materials().count(), 0);
        assert_eq!(bare.gltf.nodes().map(|node| node.name().unwrap().to_owned()).collect::<Vec<_>>(), JOINT_NAMES);
        let skin = bare.gltf.skins().next().unwrap();
        assert_eq!(skin.joints().count(), JOINTS);
        let (tracks, wanted) = (bare.tracks(), worn.tracks());
        for joint in 0..JOINTS {
            assert_eq!(tracks[&joint].rotations, wanted[&joint].rotations);
            assert_eq!(tracks[&joint].times, wanted[&joint].times);
        }
        assert_eq!(tracks[&0].translations, wanted[&0].translations);
        assert_eq!(tracks.len(), JOINTS);
    }
}

#[test]
fn every_figure_has_a_file_of_its_own() {
    let clip = sample::clip(FaceKind::Arkit, 1, 1);
    let files: Vec<Vec<u8>> = Figure::ALL.map(|figure| File::worn(&clip, Some(figure)).bin).into();
    assert!((1..files.len()).all(|i| !files[..i].contains(&files[i])));
}

/// Attributes that are not read are not stored, and those that a normal map needs are.
#[test]
fn glb_has_tangents_and_places_where_there_is_a_normal_map_and_nowhere_else() {
    for figure in Figure::ALL {
        let clip = sample::clip(FaceKind::Arkit, 1, 1);
        let mesh = figure.mesh(&clip.skeleton).unwrap();
        let file = File::worn(&clip, Some(figure));
        let (mut corners, mut vertices, mut mapped) = (0, 0, 0);
        for primitive in file.gltf.meshes().flat_map(|mesh| mesh.primitives()) {
            let reader = primitive.reader(|_| Some(&file.bin));
            let count = reader.read_positions().unwrap().count();
            vertices += count;
            let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
            corners += indices.len();
            assert!(indices.iter().all(|&i| (i as usize) < count));
            let map = primitive.material().normal_texture();
            assert_eq!(map.is_some(), reader.read_tangents().is_some());
            assert_eq!(map.is_some(), reader.read_tex_coords(1).is_some());
            assert!(map.is_none() || primitive.morph_targets().len() == 0);
            let Some(map) = map else { continue };
            mapped += 1;
            assert_eq!((map.tex_coord(), map.scale()), (1, 1.0));
            assert_eq!(map.texture().sampler().wrap_s(), gltf::texture::WrappingMode::Repeat);
            let (tangents, normals) = (reader.read_tangents().unwrap(), reader.read_normals().unwrap());
            assert_eq!((tangents.len(), reader.read_tex_coords(1).unwrap().into_f32().count()), (count, count));
            for ([x, y, z, w], [a, b, c]) in tangents.zip(normals) {
                assert!((x * x + y * y + z * z - 1.0).abs() < 1e-4 && w.abs() == 1.0);
                assert!((x * a + y * b + z * c).abs() < 1e-4);
            }
        }
        assert_eq!((corners, vertices), (mesh.indices.len(), mesh.positions.len()));
        assert_eq!(mapped, if figure == Figure::Alex || figure == Figure::Dina { 3 } else { 4 });
        assert!(file.bin.len() < 3_900_000, "{figure:?}: {} bytes", file.bin.len());
    }
}

#[test]
fn a_built_figure_serves_every_clip_of_its_skeleton_and_face() {
    let first = sample::clip(FaceKind::Arkit, 3, 40);
    let figure = BuiltFigure::new(Figure::default(), &first).unwrap();
    for clip in [&first, &sample::clip(FaceKind::Arkit, 5, 10)] {
        let [mut again, mut alone] = [Vec::new(), Vec::new()];
        figure.write(clip, &mut again).unwrap();
        crate::glb::write(clip, Some(Figure::default()), &mut alone).unwrap();
        assert!(figure.fits(clip) && again == alone);
    }
    let mut taller = first.clone();
    taller.skeleton.offsets_m[12][1] += 0.01;
    for other in [taller, sample::clip(FaceKind::SmplxExpression, 3, 40)] {
        let error = figure.write(&other, &mut Vec::new()).unwrap_err();
        assert_eq!(error.kind(), std::io::ErrorKind::InvalidInput);
    }
}

/// Members of a room with a figure each.
fn room<'a>(clips: &'a [Clip], figures: &'a [BuiltFigure]) -> Vec<Member<'a>> {
    let member = |(at, (clip, figure)): (usize, (&'a Clip, &'a BuiltFigure))| Member {
        name: ["ada", "bob", "cy"][at],
        clip,
        figure: Some(figure),
        position: [at as f32, 0.0, 0.25],
        facing: -0.7 * at as f32,
    };
    clips.iter().zip(figures.iter().cycle()).enumerate().map(member).collect()
}

fn written(members: &[Member<'_>]) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_room(members, &mut bytes).unwrap();
    bytes
}

#[test]
fn a_room_puts_every_member_at_its_place_under_its_name() {
    let clips = [10, 20, 30].map(|seed| sample::clip(FaceKind::Arkit, 4, seed));
    let figures = [Figure::default()].map(|figure| BuiltFigure::new(figure, &clips[0]).unwrap());
    let members = room(&clips, &figures);
    let file = File::parsed(&written(&members));
    let names: Vec<&str> = file.gltf.nodes().map(|node| node.name().unwrap()).collect();
    assert!((1..names.len()).all(|i| !names[..i].contains(&names[i])), "{names:?}");
    let (found, tracks) = (file.positions(3), file.tracks());
    for (at, member) in members.iter().enumerate() {
        let prefix = if at == 0 { String::new() } else { format!("{}-", member.name) };
        let (sine, cosine) = f64::from(member.facing).sin_cos();
        for (joint, [x, y, z]) in JOINT_NAMES.iter().zip(positions(member.clip, 3)) {
            let turned = [x * cosine + z * sine, y, z * cosine - x * sine];
            let wanted = std::array::from_fn(|axis| turned[axis] + f64::from(member.position[axis]));
            assert!(distance(found[&format!("{prefix}{joint}")], wanted) < 1e-5, "{prefix}{joint}");
        }
        let worn = file.node(member.name).extras().as_ref().map(|extras| extras.get());
        assert_eq!(worn, Some(r#"{"figure":"alex"}"#));
        let face = file.node(&format!("{prefix}face"));
        assert_eq!(tracks[&face.index()].weights, member.clip.face_values);
        let skin = face.skin().unwrap();
        assert!(skin.joints().all(|joint| joint.name().unwrap().starts_with(&prefix)));
        // A skinned node below another is drawn elsewhere by some readers.
        let roots: Vec<usize> = file.gltf.default_scene().unwrap().nodes().map(|node| node.index()).collect();
        assert!(roots.contains(&face.index()) && roots.contains(&file.node(member.name).index()));
    }
    assert_eq!(file.gltf.animations().count(), 1);
}

#[test]
fn members_of_a_room_share_their_figures() {
    let clips = [10, 20, 30].map(|seed| sample::clip(FaceKind::Arkit, 2, seed));
    let figures = [Figure::Alex, Figure::Bea].map(|figure| BuiltFigure::new(figure, &clips[0]).unwrap());
    let counts = |members: &[Member<'_>]| {
        let file = File::parsed(&written(members));
        [file.gltf.meshes().count(), file.gltf.images().count(), file.gltf.skins().count(), file.bin.len()]
    };
    let members = room(&clips, &figures);
    let ([one, pair, all], single) = ([1, 2, 3].map(|most| counts(&members[..most])), written(&members[..1]));
    assert_eq!(single, written(&[Member { position: [3.0; 3], name: "eve", ..members[0] }]));
    let mut alone = Vec::new();
    figures[0].write(&clips[0], &mut alone).unwrap();
    assert!(single == alone, "a single member is written as ever");
    assert_eq!((one[0], pair[0], all[0]), (2, 4, 4));
    assert_eq!((pair[1], all[2]), (all[1], 3));
    assert!(all[3] - pair[3] < 40_000, "{} bytes for two frames", all[3] - pair[3]);
}

#[test]
fn rooms_that_do_not_fit_together_are_refused() {
    let clips = [4, 5].map(|frames| sample::clip(FaceKind::Arkit, frames, 1));
    let figures = [BuiltFigure::new(Figure::default(), &clips[0]).unwrap()];
    let refused = |members: &[Member<'_>]| write_room(members, &mut Vec::new()).unwrap_err().to_string();
    assert!(refused(&[]).contains("needs a member"));
    assert!(refused(&room(&clips, &figures)).contains("length"));
    let other = sample::clip(FaceKind::SmplxExpression, 4, 1);
    assert!(refused(&[Member { clip: &other, ..room(&clips, &figures)[0] }]).contains("another skeleton"));
}
