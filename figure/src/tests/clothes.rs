//! Skin under clothes stays hidden, fingers do not touch, and every figure has its name.

use super::*;
use umo_core_pose::rotation::{IDENTITY, Quat, product};
use umo_core_pose::skeleton::{JOINT_NAMES, JOINTS, Skeleton};
use vector::{dot, scale};

/// Vertices of one hand's skin.
pub(super) fn hand(mesh: &Mesh, side: &str) -> Vec<usize> {
    let finger = skin::number(&format!("{side}_middle2"));
    let pieces = palette::pieces(mesh);
    let mut sizes: HashMap<usize, usize> = HashMap::new();
    for vertex in (0..mesh.head).filter(|&vertex| mesh.joints[vertex][0] == finger) {
        *sizes.entry(pieces[vertex]).or_default() += 1;
    }
    // Nails are smaller.
    let (piece, _) = sizes.into_iter().max_by_key(|one| one.1).unwrap();
    (0..mesh.head).filter(|&vertex| pieces[vertex] == piece).collect()
}

/// Skin behind the openings of sleeves and collar, which no pose may expose.
fn hidden(mesh: &Mesh, rest: &Rest) -> Vec<usize> {
    let mut all = Vec::new();
    for side in ["left", "right"] {
        let (wrist, elbow) = (rest.side(side, "wrist"), rest.side(side, "elbow"));
        let bone = sub(elbow, wrist);
        let floor = body::CUFF + 1.05 * body::OPENING;
        let is_behind = |&v: &usize| dot(sub(mesh.positions[v], wrist), bone) > floor * dot(bone, bone);
        all.extend(hand(mesh, side).into_iter().filter(is_behind));
    }
    let (neck, s) = (rest.at("neck"), rest.size);
    let normal = vector::unit([0.0, 0.958, 0.287]);
    let is_below = |&v: &usize| {
        let from = sub(mesh.positions[v], [neck[0], neck[1] - 0.010 * s, neck[2] + 0.02 * s]);
        dot(from, normal) < -0.004 * s
    };
    all.extend((mesh.head..mesh.positions.len()).filter(is_below));
    all
}

/// A deterministic pseudo-random generator.
struct Draw(u64);

impl Draw {
    /// Between -1 and 1.
    fn next(&mut self) -> f32 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    }
}

/// Rotation limits of joints about X, Y and Z in gestures, in degrees.
const LIMITS: [(&str, V); 8] = [
    ("spine1", [10.0, 10.0, 8.0]),
    ("spine3", [10.0, 10.0, 8.0]),
    ("neck", [18.0, 28.0, 14.0]),
    ("head", [18.0, 28.0, 14.0]),
    ("collar", [8.0, 10.0, 14.0]),
    ("shoulder", [50.0, 60.0, 75.0]),
    ("elbow", [70.0, 110.0, 20.0]),
    ("wrist", [60.0, 35.0, 65.0]),
];

fn pose(draw: &mut Draw) -> [Quat; JOINTS] {
    let mut rotations = [IDENTITY; JOINTS];
    for (joint, name) in JOINT_NAMES.iter().enumerate() {
        let plain = name.strip_prefix("left_").or(name.strip_prefix("right_")).unwrap_or(name);
        let Some((_, limits)) = LIMITS.iter().find(|known| known.0 == plain) else { continue };
        for (axis, limit) in limits.iter().enumerate() {
            let half = 0.5 * (draw.next() * limit).to_radians();
            let mut turn = [0.0, 0.0, 0.0, half.cos()];
            turn[axis] = half.sin();
            rotations[joint] = product(rotations[joint], turn);
        }
    }
    rotations
}

/// Depth map of the cloth, seen from one direction.
struct Depth {
    right: V,
    up: V,
    towards: V,
    /// `[SIZE, SIZE]`
    nearest: Vec<f32>,
}

/// Size of a pixel of the depth map, in metres.
const PIXEL: f32 = 0.003;
/// Pixels along each side, with the skeleton's origin in the middle.
const SIZE: i32 = 900;

#[expect(clippy::cast_sign_loss, reason = "a person fits the picture")]
fn place([x, y]: [i32; 2]) -> usize {
    ((y + SIZE / 2) * SIZE + x + SIZE / 2) as usize
}

#[expect(clippy::cast_possible_truncation, reason = "places of a picture of a person")]
impl Depth {
    fn from(direction: usize) -> Self {
        let (sin, cos) = (std::f32::consts::TAU * direction as f32 / 8.0).sin_cos();
        // Half of the directions are from above, half from below.
        let rise = if direction.is_multiple_of(2) { 0.45_f32 } else { -0.45 };
        let towards = [sin * rise.cos(), rise.sin(), cos * rise.cos()];
        let right = vector::unit(vector::cross([0.0, 1.0, 0.0], towards));
        Self { right, up: vector::cross(towards, right), towards, nearest: vec![f32::MIN; (SIZE * SIZE) as usize] }
    }

    fn seen(&self, p: V) -> V {
        [dot(p, self.right) / PIXEL, dot(p, self.up) / PIXEL, dot(p, self.towards)]
    }

    fn fill(&mut self, triangle: [V; 3]) {
        let [a, b, c] = triangle.map(|p| self.seen(p));
        let area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
        if area.abs() < 1e-6 {
            return;
        }
        let range = |axis: usize| {
            let all = [a[axis], b[axis], c[axis]];
            let (low, high) =
                (all.iter().copied().fold(f32::MAX, f32::min), all.iter().copied().fold(f32::MIN, f32::max));
            low.ceil() as i32..=high.floor() as i32
        };
        for x in range(0) {
            for y in range(1) {
                let (px, py) = (x as f32, y as f32);
                let part = |p: V, q: V| ((q[0] - p[0]) * (py - p[1]) - (q[1] - p[1]) * (px - p[0])) / area;
                let parts = [part(b, c), part(c, a), part(a, b)];
                if parts.iter().all(|&share| share >= 0.0) {
                    let depth = parts[0] * a[2] + parts[1] * b[2] + parts[2] * c[2];
                    let nearest = &mut self.nearest[place([x, y])];
                    *nearest = nearest.max(depth);
                }
            }
        }
    }

    /// Distance of a point in front of all cloth, in metres; `None` if there is cloth in front of it.
    fn out(&self, p: V) -> Option<f32> {
        let seen = self.seen(p);
        let (x, y) = (seen[0].round() as i32, seen[1].round() as i32);
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [x + dx, y + dy]));
        let nearest = around.map(|at| self.nearest[place(at)]).fold(f32::MIN, f32::max);
        (seen[2] > nearest + 1e-3).then(|| seen[2] - nearest)
    }
}

/// In poses beyond the range of gestures, seen from eight directions, no hidden skin is in front of all cloth.
fn check_poses(count: usize, seed: u64) {
    let skeleton = sample::skeleton();
    let rest = Rest::new(&skeleton).unwrap();
    for (figure, mesh) in Figure::ALL.iter().zip(ALL.iter()) {
        let skin = hidden(mesh, &rest);
        assert!(skin.len() > 150, "{}", skin.len());
        let cloth = cloth_near(mesh, &rest);
        let mut draw = Draw(seed);
        let mut depths: [Depth; 8] = std::array::from_fn(Depth::from);
        for number in 0..count {
            let posed = mesh.posed(&skeleton, &pose(&mut draw), [0.0; 3], &[]);
            for (direction, depth) in depths.iter_mut().enumerate() {
                depth.nearest.fill(f32::MIN);
                cloth.iter().for_each(|corners| depth.fill(corners.map(|v| posed.positions[v])));
                for &vertex in &skin {
                    let out = depth.out(posed.positions[vertex]);
                    assert!(
                        out.is_none(),
                        "{}: vertex {vertex} at {:?} shows by {out:?} m in pose {number} from direction {direction}",
                        figure.name(),
                        mesh.positions[vertex]
                    );
                }
            }
        }
    }
}

#[test]
fn no_pose_brings_skin_through_clothes() {
    check_poses(6, 7);
}

/// 500 poses of each figure.
#[test]
#[ignore = "takes a minute or more; for changes of clothes and weights"]
fn none_of_2000_poses_brings_skin_through_clothes() {
    check_poses(500, 11);
}

/// Triangles of the cloth of trunk and arms, which hides skin.
fn cloth_near(mesh: &Mesh, rest: &Rest) -> Vec<[usize; 3]> {
    let skin: HashSet<usize> = ["left", "right"].iter().flat_map(|side| hand(mesh, side)).collect();
    let near = |v: usize| mesh.positions[v][1] > rest.at("neck")[1] - 0.62 * rest.size;
    let (triangles, _) = mesh.indices.as_chunks::<3>();
    let body = triangles.iter().map(|corners| corners.map(|v| v as usize)).filter(|corners| corners[0] < mesh.head);
    body.filter(|corners| !skin.contains(&corners[0]) && near(corners[0])).collect()
}

#[test]
fn fingers_at_rest_are_apart_from_each_other() {
    let skeleton: Skeleton = sample::skeleton();
    let rest = Rest::new(&skeleton).unwrap();
    for mesh in ALL.iter() {
        let hand = hand(mesh, "left");
        for finger in ["index", "middle", "ring", "pinky"] {
            for other in body::FINGERS.iter().filter(|&&other| other != finger) {
                let (a, b) = (rest.side("left", &format!("{other}2")), rest.finger_tip("left", other));
                let tips = hand.iter().filter(|&&v| mesh.joints[v][0] >= skin::number(&format!("left_{finger}2")));
                let own = tips.filter(|&&v| mesh.joints[v][0] <= skin::number(&format!("left_{finger}3")));
                for &vertex in own {
                    let (along, from) = (sub(b, a), sub(mesh.positions[vertex], a));
                    let t = (dot(from, along) / dot(along, along)).clamp(0.0, 1.0);
                    let off = vector::length(sub(from, scale(along, t)));
                    assert!(off > 0.004, "{finger} is {off} m from the middle of {other}");
                }
            }
        }
    }
}

#[test]
fn figures_are_known_by_their_names_and_look_different() {
    for figure in Figure::ALL {
        assert_eq!(figure.name().parse(), Ok(figure));
        assert!(!figure.summary().is_empty());
    }
    let error = "nobody".parse::<Figure>().unwrap_err().to_string();
    assert!(Figure::ALL.iter().all(|figure| error.contains(figure.name())), "{error}");
    for (number, mesh) in ALL.iter().enumerate() {
        for other in &ALL[number + 1..] {
            assert_ne!(mesh.colors, other.colors);
            assert_ne!(mesh.positions, other.positions);
        }
    }
}

/// A standing pose with arms at the sides and relaxed hands, and the rest pose.
fn rest_poses() -> [[Quat; JOINTS]; 2] {
    let mut standing = [IDENTITY; JOINTS];
    for (joint, name) in JOINT_NAMES.iter().enumerate() {
        let Some((side, plain)) = name.split_once('_') else { continue };
        let sign = if side == "left" { 1.0 } else { -1.0 };
        let finger = body::FINGERS.iter().any(|finger| plain.starts_with(finger) && *finger != "thumb");
        let degrees = match plain {
            "shoulder" => -70.0,
            "elbow" => -8.0,
            _ if finger && plain.ends_with(['1', '2', '3']) => -18.0,
            _ => continue,
        };
        standing[joint] = umo_core_pose::rotation::axis_angle_to_quat([0.0, 0.0, sign * f32::to_radians(degrees)]);
    }
    [[IDENTITY; JOINTS], standing]
}

/// At rest, no finger penetrates another one or the body by more than 5 mm.
#[test]
fn fingers_at_rest_pass_through_nothing() {
    let skeleton = sample::skeleton();
    let rest = Rest::new(&skeleton).unwrap();
    for (mesh, rotations) in ALL.iter().flat_map(|mesh| rest_poses().map(|pose| (mesh, pose))) {
        let posed = mesh.posed(&skeleton, &rotations, [0.0; 3], &[]);
        let moves = mesh.moves(&skeleton, &rotations, [0.0; 3]);
        let moved = |joint: &str, p: V| {
            let (matrix, shift) = &moves[usize::from(skin::number(joint))];
            vector::add(crate::posed::turned(matrix, p), *shift)
        };
        let cloth: HashSet<usize> = cloth_below(mesh, &rest);
        let mut checked = 0;
        for side in ["left", "right"] {
            let bone = |finger: &str, k: usize| {
                let joint = format!("{side}_{finger}{k}");
                let end = match k {
                    3 => rest.finger_tip(side, finger),
                    _ => rest.side(side, &format!("{finger}{}", k + 1)),
                };
                [moved(&joint, rest.at(&joint)), moved(&joint, end)]
            };
            let bones: Vec<_> = body::FINGERS.iter().map(|finger| [2, 3].map(|k| bone(finger, k))).collect();
            for vertex in hand(mesh, side) {
                let p = posed.positions[vertex];
                let own = body::FINGERS.iter().position(|finger| {
                    [2, 3].map(|k| skin::number(&format!("{side}_{finger}{k}"))).contains(&mesh.joints[vertex][0])
                });
                let Some(own) = own else { continue };
                checked += 1;
                for (other, [a, b]) in bones.iter().enumerate().flat_map(|(i, both)| both.map(|one| (i, one))) {
                    let (along, from) = (sub(b, a), sub(p, a));
                    let t = (dot(from, along) / dot(along, along)).clamp(0.0, 1.0);
                    let within = 0.009 - vector::length(sub(from, scale(along, t)));
                    assert!(other == own || within < 0.005, "finger {own} is {within} m within finger {other}");
                }
                let near = cloth.iter().map(|&v| (distance(posed.positions[v], p), v));
                let (far, near) = near.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
                let within = dot(sub(posed.positions[near], p), posed.normals[near]);
                assert!(far > 0.06 || within < 0.005, "finger {own} is {within} m within the body");
            }
        }
        assert!(checked > 200, "{checked}");
    }
}

/// Vertices of the cloth of trunk and legs.
fn cloth_below(mesh: &Mesh, rest: &Rest) -> HashSet<usize> {
    let spine = [skin::number("pelvis"), skin::number("spine1"), skin::number("spine2")];
    let legs = ["left", "right"].map(|side| skin::number(&format!("{side}_hip")));
    let of = |v: &usize| spine.contains(&mesh.joints[*v][0]) || legs.contains(&mesh.joints[*v][0]);
    let low = rest.at("neck")[1];
    (0..mesh.head).filter(of).filter(|&v| mesh.positions[v][1] < low).collect()
}
