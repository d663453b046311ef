//! Bodies with volume: the default model's motion and gestures on characters of several builds, measured on their
//! meshes. Signed distances of the vertices of hands and forearms from the closed surfaces of trunk and head are
//! exact: parity of crossings, and the nearest triangle.

use std::path::Path;
use std::sync::LazyLock;

use umo_core::{
    Animation, AvatarConfig, Bone, Compute, Floor, GestureOptions, Gestures, JOINT_NAMES, JOINTS, Layer, LayerGains,
    Mapping, Model, ModelFile, Pose, Precision, Retarget, RetargetScratch, Rig, Skeleton, SurfacePoint, Team, Volume,
};
use umo_core_pose::rotation::{IDENTITY, inverse, product, rotate};
use umo_kernels::Isa;

type Vector = [f32; 3];
/// Place and rotation of each bone.
type World = Vec<(Vector, [f32; 4])>;

/// Seconds at which gestures begin that bring hands near the body or each other.
const GESTURES: [(&str, f64); 8] = [
    ("me", 8.0),
    ("think", 10.5),
    ("clap", 14.0),
    ("heart", 17.0),
    ("remember", 20.0),
    ("phone", 23.0),
    ("eat", 26.0),
    ("write", 29.0),
];
const SECONDS: usize = 32;
const FRAME_RATE: f32 = 30.0;

fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn less(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] - b[i])
}

fn times(a: Vector, by: f32) -> Vector {
    a.map(|x| x * by)
}

fn dot(a: Vector, b: Vector) -> f32 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(a: Vector) -> f32 {
    dot(a, a).sqrt()
}

/// The model's motion on `assets/hello.wav`, then gestures in silence; the same on every processor.
static MOTION: LazyLock<(Skeleton, Vec<Pose>)> = LazyLock::new(motion);

fn motion() -> (Skeleton, Vec<Pose>) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let file = ModelFile::open(&root.join("models/umo-people/model.safetensors")).unwrap();
    let model = Model::load(&file, Precision::Stored, Isa::detect().portable()).unwrap();
    let team = Team::new(1).unwrap();
    let cx = Compute { isa: model.isa(), team: &team };
    let rate = model.config().audio.sample_rate;
    let mut speech: Vec<f32> = hound::WavReader::open(root.join("assets/hello.wav"))
        .unwrap()
        .samples::<i16>()
        .map(|sample| f32::from(sample.unwrap()) / 32_768.0)
        .collect();
    speech.resize(SECONDS * rate, 0.0);
    let config = AvatarConfig::new(model.config());
    // Hands that are busy: without rests.
    let gains = LayerGains::ON.with(Layer::Body, 0.0).with(Layer::Idle, 0.0);
    let mut animation = Animation::with_layers(&model, &config, gains, Gestures::new()).unwrap();
    for (name, at) in GESTURES {
        animation.play_gesture(name, &GestureOptions::default().at(at)).unwrap();
    }
    animation.push_audio(&speech).unwrap();
    animation.finish(SECONDS * model.config().frame_rate);
    let mut poses = Vec::new();
    while animation.step(&model, cx, &mut |frame| poses.push(*frame.pose)).unwrap() {}
    (model.config().skeleton.clone(), poses)
}

/// A part of a character's surface.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Part {
    Body,
    Head,
    Arm(usize),
    Hand(usize),
    Leg,
}

/// A closed surface, each vertex with its bone.
struct Mesh {
    part: Part,
    vertices: Vec<(usize, Vector)>,
    triangles: Vec<[usize; 3]>,
}

/// Differences of a character from the figure.
#[derive(Clone, Copy)]
struct Build {
    name: &'static str,
    /// Lengths of trunk, arms, legs, head.
    lengths: [f32; 4],
    /// Girth: of the trunk's width, of its depth, more of the belly ahead, of limbs, of head.
    girths: [f32; 5],
    fingers: usize,
    /// Corners of a cross-section; 4 is a box.
    sides: usize,
}

const BUILDS: [Build; 6] = [
    Build { name: "people's", lengths: [1.0; 4], girths: [1.0, 1.0, 0.0, 1.0, 1.0], fingers: 5, sides: 24 },
    Build { name: "bulky", lengths: [1.0, 0.95, 0.9, 1.0], girths: [1.5, 1.5, 0.7, 1.4, 1.1], fingers: 5, sides: 24 },
    Build { name: "thin", lengths: [1.0, 1.05, 1.1, 1.0], girths: [0.75, 0.7, 0.0, 0.65, 0.9], fingers: 5, sides: 24 },
    Build {
        name: "child",
        lengths: [0.62, 0.55, 0.5, 0.85],
        girths: [0.7, 0.72, 0.25, 0.6, 0.85],
        fingers: 5,
        sides: 24,
    },
    Build {
        name: "big head",
        lengths: [0.8, 0.75, 0.6, 1.7],
        girths: [0.8, 0.8, 0.1, 0.8, 1.8],
        fingers: 4,
        sides: 24,
    },
    Build { name: "robot", lengths: [1.0, 1.0, 1.0, 1.0], girths: [1.25, 1.3, 0.0, 1.1, 1.1], fingers: 0, sides: 4 },
];

/// Half width, depth ahead and behind of a trunk of the figure's size at heights above the hips, metres.
const TRUNK: [[f32; 4]; 13] = [
    [-0.08, 0.10, 0.07, 0.08],
    [-0.06, 0.165, 0.10, 0.11],
    [0.0, 0.17, 0.11, 0.115],
    [0.05, 0.165, 0.115, 0.11],
    [0.1, 0.152, 0.112, 0.1],
    [0.17, 0.145, 0.11, 0.095],
    [0.24, 0.15, 0.11, 0.1],
    [0.3, 0.16, 0.115, 0.105],
    [0.36, 0.165, 0.12, 0.11],
    [0.42, 0.175, 0.12, 0.11],
    [0.48, 0.185, 0.105, 0.105],
    [0.53, 0.15, 0.08, 0.095],
    [0.57, 0.08, 0.06, 0.08],
];

struct Character {
    build: Build,
    rig: Rig,
    mapping: Mapping,
    meshes: Vec<Mesh>,
}

impl Character {
    fn new(skeleton: &Skeleton, build: Build) -> Self {
        let kept = |joint: usize| {
            let finger = joint.checked_sub(25).map(|at| at % 15 / 3);
            // Index, middle, little, ring, thumb: four have no ring.
            finger.is_none_or(|finger| build.fingers == 5 || build.fingers == 4 && finger != 3)
        };
        let stretch = |joint: usize| match joint {
            1 | 2 | 4 | 5 | 7 | 8 | 10 | 11 => build.lengths[2],
            15 | 22..=24 => build.lengths[3].min(1.0),
            18..=21 => build.lengths[1],
            joint if joint >= 25 => build.lengths[1],
            13 | 14 | 16 | 17 => build.girths[0].min(1.4),
            _ => build.lengths[0],
        };
        let joints: Vec<usize> = (0..JOINTS).filter(|&joint| kept(joint)).collect();
        let place = |joint: usize| joints.iter().position(|&at| at == joint);
        let bones = joints.iter().map(|&joint| {
            let parent = usize::try_from(skeleton.parents[joint]).ok().and_then(place);
            Bone::new(JOINT_NAMES[joint], parent, times(skeleton.offsets_m[joint], stretch(joint)))
        });
        let rig = Rig::new(bones.collect()).unwrap();
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let mut made = Self { build, rig, mapping, meshes: Vec::new() };
        made.grow();
        made
    }

    fn bone(&self, joint: usize) -> usize {
        self.mapping
            .bone(joint)
            .or_else(|| match joint {
                3 => self.mapping.spine().first().copied(),
                6 => self.mapping.spine().get(1).copied(),
                9 => self.mapping.spine().last().copied(),
                12 => self.mapping.neck().first().copied(),
                _ => None,
            })
            .unwrap()
    }

    fn place(&self, joint: usize) -> Vector {
        self.rig.place(self.bone(joint))
    }

    /// Adds a closed surface through rings: bone, middle, and radii along two directions, the first also the other way.
    fn tube(&mut self, part: Part, sides: usize, rings: &[(usize, Vector, [Vector; 2], f32)]) {
        let sides = sides.min(self.build.sides);
        let mut vertices = Vec::new();
        for (bone, middle, [wide, deep], behind) in rings {
            for side in 0..sides {
                let turn = (side as f32 + 0.5) / sides as f32 * std::f32::consts::TAU;
                // A box has its corners where the ellipse's tangents meet.
                let grow = if sides == 4 { std::f32::consts::SQRT_2 } else { 1.0 };
                let (x, z) = (grow * turn.sin(), grow * turn.cos());
                let z = if z < 0.0 { z * behind } else { z };
                vertices.push((*bone, add(*middle, add(times(*wide, x), times(*deep, z)))));
            }
        }
        let mut triangles = Vec::new();
        for ring in 0..rings.len() - 1 {
            for side in 0..sides {
                let [a, b] = [side, (side + 1) % sides].map(|side| ring * sides + side);
                triangles.extend([[a, b, a + sides], [b, b + sides, a + sides]]);
            }
        }
        for (ring, turn) in [(0, true), (rings.len() - 1, false)] {
            let (bone, middle, ..) = rings[ring];
            vertices.push((bone, middle));
            let centre = vertices.len() - 1;
            for side in 0..sides {
                let [a, b] = [side, (side + 1) % sides].map(|side| ring * sides + side);
                triangles.push(if turn { [b, a, centre] } else { [a, b, centre] });
            }
        }
        self.meshes.push(Mesh { part, vertices, triangles });
    }

    /// A limb from one place to another, with rings along it: bone, share, radius; flat by a factor along the second.
    fn limb(&mut self, part: Part, from: Vector, to: Vector, flat: f32, rings: &[(usize, f32, f32)]) {
        let way = less(to, from);
        let side = cross(way, [0.0, 1.0, 0.0]);
        let side = if length(side) < 0.3 * length(way) { [1.0, 0.0, 0.0] } else { times(side, 1.0 / length(side)) };
        let up = cross(side, times(way, 1.0 / length(way)));
        let rings: Vec<_> = rings
            .iter()
            .map(|&(bone, share, radius)| {
                (bone, add(from, times(way, share)), [times(side, radius), times(up, radius * flat)], 1.0)
            })
            .collect();
        self.tube(part, LIMB, &rings);
    }

    fn grow(&mut self) {
        let Build { lengths, girths: [wide, deep, belly, limbs, head], fingers, .. } = self.build;
        let middle = |a: Vector, b: Vector| times(add(a, b), 0.5);
        let hips = middle(self.place(1), self.place(2));
        let shoulders = middle(self.place(16), self.place(17));
        let size = (shoulders[1] - hips[1]) / 0.53;
        let bones = [0, 3, 6, 9].map(|joint| (self.bone(joint), self.place(joint)[1]));
        let rings: Vec<_> = TRUNK
            .iter()
            .map(|&[height, side, ahead, behind]| {
                let y = hips[1] + height * size;
                let bone = bones.iter().rfind(|(_, low)| *low <= y + 0.02).unwrap_or(&bones[0]).0;
                let bulge = 1.0 + belly * (1.0 - ((height - 0.15) / 0.25).powi(2)).max(0.0);
                let [side, ahead, behind] = [side * wide, ahead * deep * bulge, behind * deep];
                let z = hips[2] + (shoulders[2] - hips[2]) * height / 0.53;
                (bone, [hips[0], y, z], [[side, 0.0, 0.0], [0.0, 0.0, ahead]], behind / ahead)
            })
            .collect();
        self.tube(Part::Body, 24, &rings);
        let (skull, bone) = (self.place(15), self.bone(15));
        let height = 0.235 * lengths[3];
        let rings: Vec<_> = (0..=10_u8)
            .map(|ring| {
                let t = f32::from(ring) / 10.0;
                let out = (1.0 - (2.0 * t - 1.0).powi(2)).sqrt().max(0.25) * head;
                let at = add(skull, [0.0, (t - 0.2) * height, 0.01]);
                (bone, at, [[0.083 * out, 0.0, 0.0], [0.0, 0.0, 0.1 * out]], 1.0)
            })
            .collect();
        self.tube(Part::Head, 24, &rings);
        for side in 0..2 {
            let at = |joint: usize| joint + side;
            let [shoulder, elbow, wrist] = [at(16), at(18), at(20)].map(|joint| (self.bone(joint), self.place(joint)));
            let girth = limbs * size.max(0.7);
            let upper = [0.15, 0.5, 0.95].map(|share| (shoulder.0, share, (0.055 - 0.012 * share) * girth));
            self.limb(Part::Arm(side), shoulder.1, elbow.1, 1.0, &upper);
            let fore = [0.05, 0.3, 0.6, 0.95].map(|share| (elbow.0, share, (0.042 - 0.015 * share) * girth));
            self.limb(Part::Hand(side), elbow.1, wrist.1, 1.0, &fore);
            let hip = (self.bone(at(1)), self.place(at(1)), self.place(at(4)));
            let thigh = [0.1, 0.5, 1.0].map(|share| (hip.0, share, (0.085 - 0.03 * share) * girth));
            self.limb(Part::Leg, hip.1, hip.2, 1.0, &thigh);
            let scale = lengths[1];
            let palm = [0.0, 0.35, 0.7, 1.0].map(|share| (wrist.0, share, (0.03 + 0.012 * share) * scale));
            let first = 25 + 15 * side;
            let sign = if side == 0 { 1.0 } else { -1.0 };
            let knuckles = add(wrist.1, [sign * (if fingers > 0 { 0.09 } else { 0.17 }) * scale, 0.0, 0.0]);
            self.limb(Part::Hand(side), wrist.1, knuckles, 0.35, &palm);
            for finger in (0..5).filter(|&finger| fingers == 5 || fingers == 4 && finger != 3) {
                let joints = [0, 1, 2].map(|step| first + 3 * finger + step);
                let [a, b, c] = joints.map(|joint| self.place(joint));
                let tip = add(c, times(less(c, b), 0.9));
                for ((from, to), joint) in [(a, b), (b, c), (c, tip)].into_iter().zip(joints) {
                    let bone = self.bone(joint);
                    let rings = [0.0, 0.5, 1.0].map(|share| (bone, share, 0.0085 * scale * (1.0 - 0.2 * share)));
                    self.limb(Part::Hand(side), from, to, 1.0, &rings);
                }
            }
        }
    }

    /// Points spread over the meshes, as a reader of files makes them.
    fn points(&self) -> Vec<SurfacePoint> {
        let mut points = Vec::new();
        for mesh in &self.meshes {
            for corners in &mesh.triangles {
                let [a, b, c] = corners.map(|corner| mesh.vertices[corner]);
                let area = 0.5 * length(cross(less(b.1, a.1), less(c.1, a.1)));
                #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most 400")]
                let count = (area / 2e-5).ceil().min(400.0) as usize;
                for at in 0..count {
                    let (u, v) = ((0.5 + 0.7549 * at as f32).fract(), (0.5 + 0.5698 * at as f32).fract());
                    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
                    let place = add(times(a.1, 1.0 - u - v), add(times(b.1, u), times(c.1, v)));
                    let bone = if u > 0.5 {
                        b.0
                    } else if v > 0.5 {
                        c.0
                    } else {
                        a.0
                    };
                    points.push(SurfacePoint { bone, place, area: area / count as f32 });
                }
            }
        }
        points
    }

    /// The rig, with its volume or without.
    fn retarget(&self, skeleton: &Skeleton, gain: f32) -> Retarget {
        let mut retarget = Retarget::new(skeleton, &self.rig, &self.mapping, Floor::AtRest).unwrap();
        let volume = Volume::measure(&self.rig, &self.mapping, &self.points()).unwrap();
        retarget.set_volume(&self.rig, &self.mapping, &volume, gain).unwrap();
        retarget
    }

    /// Places and rotations of the bones in the world.
    fn posed(&self, retarget: &Retarget, poses: &[Pose]) -> Vec<World> {
        self.posed_in(retarget, &mut retarget.scratch(), poses)
    }

    fn posed_in(&self, retarget: &Retarget, scratch: &mut RetargetScratch, poses: &[Pose]) -> Vec<World> {
        let mut rotations = vec![IDENTITY; self.rig.len()];
        let mut frames = Vec::new();
        for pose in poses {
            let hips = retarget.apply(scratch, pose, &mut rotations).unwrap();
            let mut world = World::new();
            for (at, bone) in self.rig.bones().iter().enumerate() {
                let above = bone.parent.map_or(([0.0; 3], IDENTITY), |parent| world[parent]);
                let local = if at == retarget.hips() { hips } else { bone.translation };
                world.push((add(above.0, rotate(above.1, local)), product(above.1, rotations[at])));
            }
            frames.push(world);
        }
        frames
    }

    fn vertices(&self, mesh: &Mesh, world: &[(Vector, [f32; 4])]) -> Vec<Vector> {
        let turned = |&(bone, place): &(usize, Vector)| {
            let turn = product(world[bone].1, inverse(self.rig.rotation(bone)));
            add(world[bone].0, rotate(turn, less(place, self.rig.place(bone))))
        };
        mesh.vertices.iter().map(turned).collect()
    }
}

/// Squared distance of a point from a triangle.
fn from_triangle(p: Vector, [a, b, c]: [Vector; 3]) -> f32 {
    let (ab, ac, ap) = (less(b, a), less(c, a), less(p, a));
    let square = |v: Vector| dot(v, v);
    let segment = |a: Vector, b: Vector| {
        let way = less(b, a);
        let t = (dot(less(p, a), way) / square(way).max(1e-20)).clamp(0.0, 1.0);
        square(less(p, add(a, times(way, t))))
    };
    let normal = cross(ab, ac);
    let whole = square(normal);
    if whole > 1e-20 {
        let v = dot(cross(ap, ac), normal) / whole;
        let w = dot(cross(ab, ap), normal) / whole;
        if v >= 0.0 && w >= 0.0 && v + w <= 1.0 {
            return dot(ap, normal).powi(2) / whole;
        }
    }
    segment(a, b).min(segment(b, c)).min(segment(c, a))
}

/// A posed surface: its triangles, each with the middle and the radius of a sphere around it.
struct Solid {
    places: Vec<Vector>,
    triangles: Vec<([Vector; 3], Vector, f32)>,
    bounds: [Vector; 2],
}

impl Solid {
    fn new(places: Vec<Vector>, triangles: &[[usize; 3]]) -> Self {
        let bound = |of: fn(f32, f32) -> f32, from: f32| -> Vector {
            places.iter().fold([from; 3], |bound, place| std::array::from_fn(|i| of(bound[i], place[i])))
        };
        let bounds = [bound(f32::min, f32::MAX), bound(f32::max, f32::MIN)];
        let triangle = |corners: &[usize; 3]| {
            let corners = corners.map(|corner| places[corner]);
            let middle = times(corners.iter().fold([0.0; 3], |sum, &corner| add(sum, corner)), 1.0 / 3.0);
            let radius = corners.iter().map(|&corner| length(less(corner, middle))).fold(0.0, f32::max);
            (corners, middle, radius)
        };
        Self { triangles: triangles.iter().map(triangle).collect(), places, bounds }
    }

    /// Signed distance of a point, negative inside; at most [`FAR`].
    fn signed(&self, p: Vector) -> f32 {
        let [low, high] = self.bounds;
        if (0..3).any(|i| p[i] < low[i] - FAR || p[i] > high[i] + FAR) {
            return FAR;
        }
        let (mut inside, mut nearest) = (false, FAR);
        for (corners, middle, radius) in &self.triangles {
            let apart = less(p, *middle);
            let far = radius + nearest;
            if dot(apart, apart) < far * far {
                nearest = nearest.min(from_triangle(p, *corners).sqrt());
            }
            // A ray upwards crosses the triangle.
            if apart[0].abs() > *radius || apart[2].abs() > *radius {
                continue;
            }
            let [a, b, c] = corners.map(|corner| less(corner, p));
            let side = |a: Vector, b: Vector| a[0] * b[2] - a[2] * b[0];
            let shares = [side(b, c), side(c, a), side(a, b)];
            let whole: f32 = shares.iter().sum();
            let is_hit = shares.iter().all(|&share| share > 0.0) || shares.iter().all(|&share| share < 0.0);
            inside ^= is_hit && (a[1] * shares[0] + b[1] * shares[1] + c[1] * shares[2]) / whole > 0.0;
        }
        if inside { -nearest } else { nearest }
    }
}

/// Measurements of one frame.
#[derive(Clone, Copy, Debug)]
struct Measured {
    /// Least signed distance of each forearm and hand from trunk, and from head.
    gaps: [[f32; 2]; 2],
    /// The same of the hand alone.
    touch: [[f32; 2]; 2],
    /// Least distance of the hands' vertices.
    hands: f32,
}

/// Corners of a limb's cross-section.
const LIMB: usize = 6;
const FAR: f32 = 0.06;

fn measure(character: &Character, world: &[(Vector, [f32; 4])]) -> Measured {
    let posed = |part: Part| {
        let of = character.meshes.iter().filter(move |mesh| mesh.part == part);
        of.map(|mesh| Solid::new(character.vertices(mesh, world), &mesh.triangles)).collect::<Vec<_>>()
    };
    let solids = [posed(Part::Body), posed(Part::Head)];
    let hands =
        [0, 1].map(|side| posed(Part::Hand(side)).into_iter().flat_map(|solid| solid.places).collect::<Vec<_>>());
    // The forearm's four rings come first.
    let first = 4 * LIMB.min(character.build.sides) + 2;
    let least = |from: fn(usize) -> usize, to: fn(usize, usize) -> usize| -> [[f32; 2]; 2] {
        std::array::from_fn(|side| {
            std::array::from_fn(|solid| {
                let of = |p: &Vector| solids[solid].iter().map(|solid| solid.signed(*p)).fold(FAR, f32::min);
                let points = &hands[side][from(first)..to(first, hands[side].len())];
                points.iter().map(of).fold(FAR, f32::min)
            })
        })
    };
    let (fore, touch) = (least(|_| 0, |first, _| first), least(|first| first, |_, all| all));
    let gaps = std::array::from_fn(|side| std::array::from_fn(|solid| f32::min(fore[side][solid], touch[side][solid])));
    let mut nearest = FAR * FAR;
    for a in &hands[0][first..] {
        for b in &hands[1][first..] {
            let apart = less(*a, *b);
            nearest = nearest.min(dot(apart, apart));
        }
    }
    Measured { gaps, touch, hands: nearest.sqrt() }
}

/// Root mean square of the third difference of a wrist's places about the hips, metres a second cubed.
fn jerk(places: &[Vector]) -> f32 {
    let third = |w: &[Vector]| -> Vector { std::array::from_fn(|i| w[3][i] - 3.0 * w[2][i] + 3.0 * w[1][i] - w[0][i]) };
    let sum: f32 = places.windows(4).map(|w| dot(third(w), third(w))).sum();
    (sum / places.len() as f32).sqrt() * FRAME_RATE.powi(3)
}

/// Largest speeds of a wrist in each second, metres a second.
fn peaks(places: &[Vector]) -> Vec<f32> {
    let speeds: Vec<f32> = places.windows(2).map(|w| length(less(w[1], w[0])) * FRAME_RATE).collect();
    speeds.chunks(30).map(|second| second.iter().copied().fold(0.0, f32::max)).collect()
}

/// Frames of a motion from one that is measured to the next.
const EVERY: usize = 4;

/// Demands on a build: least share of kept contacts, most jerk of the wrists and most speed of strokes relative to
/// before, most frames with an arm more than 1 cm inside.
struct Bar {
    contacts: f32,
    jerk: f32,
    peak: f32,
    inside: f32,
}

const BARS: [Bar; BUILDS.len()] = [
    Bar { contacts: 0.95, jerk: 1.1, peak: 0.1, inside: 0.005 },
    Bar { contacts: 0.85, jerk: 1.2, peak: 0.65, inside: 0.005 },
    Bar { contacts: 0.6, jerk: 1.1, peak: 0.3, inside: 0.005 },
    Bar { contacts: 0.95, jerk: 1.15, peak: 0.3, inside: 0.005 },
    Bar { contacts: 0.95, jerk: 1.25, peak: 0.15, inside: 0.005 },
    Bar { contacts: 0.45, jerk: 1.4, peak: 0.25, inside: 0.03 },
];

/// Share of the frames with a hand or a forearm deeper than a limit.
fn inside(measured: &[Measured], limit: f32) -> f32 {
    let is_inside = |m: &&Measured| m.gaps.as_flattened().iter().any(|&gap| gap < -limit);
    measured.iter().filter(is_inside).count() as f32 / measured.len() as f32
}

/// Contacts of the figure's hands with trunk, head and each other, within 1 cm, and how many of them a character
/// keeps within 1.5 cm, hands to each other 2 cm.
fn contacts(figure: &[Measured], measured: &[Measured]) -> [usize; 2] {
    let mut counts = [0; 2];
    for (own, here) in figure.iter().zip(measured) {
        let body = own
            .touch
            .as_flattened()
            .iter()
            .zip(here.touch.as_flattened())
            .map(|(own, here)| (*own, here.abs() - 0.015));
        for (own, here) in body.chain([(own.hands, here.hands - 0.02)]).filter(|(own, _)| *own < 0.01) {
            counts[0] += 1;
            counts[1] += usize::from(here < 0.0 && own < 0.01);
        }
    }
    counts
}

#[test]
fn arms_keep_out_of_bodies_and_contacts_are_kept() {
    let (skeleton, poses) = &*MOTION;
    let own = Character::new(skeleton, BUILDS[0]);
    let measured = |character: &Character, frames: &[World]| -> Vec<Measured> {
        frames.iter().step_by(EVERY).map(|world| measure(character, world)).collect()
    };
    let figure = measured(&own, &own.posed(&own.retarget(skeleton, 0.0), poses));
    for (build, bar) in BUILDS.into_iter().zip(BARS) {
        let character = Character::new(skeleton, build);
        let [before, after] = [0.0, 1.0].map(|gain| {
            let frames = character.posed(&character.retarget(skeleton, gain), poses);
            (measured(&character, &frames), frames)
        });
        let wrist = |frames: &[World], side: usize| -> Vec<Vector> {
            let (wrist, hips) = (character.bone(20 + side), character.bone(0));
            frames.iter().map(|world| less(world[wrist].0, world[hips].0)).collect()
        };
        let jerks = [0, 1].map(|side| jerk(&wrist(&after.1, side)) / jerk(&wrist(&before.1, side)));
        let changes = |side: usize| {
            let (a, b) = (peaks(&wrist(&before.1, side)), peaks(&wrist(&after.1, side)));
            a.into_iter().zip(b).filter(|(a, _)| *a > 0.5).map(|(a, b)| (b / a - 1.0).abs()).collect::<Vec<_>>()
        };
        let most = [0, 1].into_iter().flat_map(changes).fold(0.0, f32::max);
        let [all, kept] = contacts(&figure, &after.0);
        let percent = |measured: &[Measured], limit: f32| 100.0 * inside(measured, limit);
        println!(
            "{:<9} > 1 cm {:4.1} % before, {:3.1} % after; > 3 cm {:4.1} %, {:3.1} %; contacts {}, {kept} of {all}; jerk \
             {jerks:.2?}; peaks within {:.0} %",
            build.name,
            percent(&before.0, 0.01),
            percent(&after.0, 0.01),
            percent(&before.0, 0.03),
            percent(&after.0, 0.03),
            contacts(&figure, &before.0)[1],
            100.0 * most,
        );
        assert!(inside(&after.0, 0.01) <= bar.inside, "{}: {}", build.name, inside(&after.0, 0.01));
        assert!(inside(&after.0, 0.03) == 0.0, "{}", build.name);
        assert!(all >= 20 && kept as f32 >= bar.contacts * all as f32, "{}: {kept} of {all}", build.name);
        assert!(jerks.iter().all(|&jerk| jerk <= bar.jerk), "{}: {jerks:?}", build.name);
        assert!(most <= bar.peak, "{}: {most}", build.name);
    }
}

/// A gain of 0 gives the bits of a rig without a volume; the same frames in the same order give the same bits; after a
/// jump, a motion begins as with new scratch memory.
#[test]
fn frames_depend_on_those_before_in_the_same_motion_alone() {
    let (skeleton, poses) = &*MOTION;
    let character = Character::new(skeleton, BUILDS[1]);
    let bits = |retarget: &Retarget, poses: &[Pose]| -> Vec<Vec<[f32; 4]>> {
        let mut scratch = retarget.scratch();
        let mut frame = |pose: &Pose| {
            let mut rotations = vec![IDENTITY; character.rig.len()];
            retarget.apply(&mut scratch, pose, &mut rotations).unwrap();
            rotations
        };
        poses.iter().map(&mut frame).collect()
    };
    let plain = Retarget::new(skeleton, &character.rig, &character.mapping, Floor::AtRest).unwrap();
    assert_eq!(bits(&character.retarget(skeleton, 0.0), poses), bits(&plain, poses));
    let full = character.retarget(skeleton, 1.0);
    let whole = bits(&full, poses);
    assert_eq!(whole, bits(&full, poses));
    assert_ne!(whole, bits(&plain, poses));
    // Arms stretched out to the sides are far from any pose of the motion.
    let jump = [Pose::REST].iter().chain(&poses[430..]).copied().collect::<Vec<_>>();
    assert_eq!(bits(&full, &jump)[1..], bits(&full, &poses[430..]));
    assert_ne!(bits(&full, &poses[430..])[..5], whole[430..435]);
}

/// Corrections take nearly the same time at 60 frames a second as at 30, if the scratch memory knows the rate. Pushes
/// still come with each frame.
#[test]
fn corrections_take_nearly_the_same_time_at_any_frame_rate() {
    let (skeleton, poses) = &*MOTION;
    let character = Character::new(skeleton, BUILDS[1]);
    let retarget = character.retarget(skeleton, 1.0);
    let wrists = |times: usize, seconds: Option<f32>| -> Vec<Vector> {
        let mut scratch = retarget.scratch();
        if let Some(seconds) = seconds {
            scratch.set_step(seconds);
        }
        let repeated: Vec<Pose> = poses.iter().flat_map(|pose| std::iter::repeat_n(*pose, times)).collect();
        let frames = character.posed_in(&retarget, &mut scratch, &repeated);
        let last = frames.iter().skip(times - 1).step_by(times);
        last.map(|world| world[character.bone(20)].0).collect()
    };
    let want = wrists(1, None);
    assert_eq!(wrists(1, Some(1.0 / 30.0)), want);
    let off = |places: &[Vector]| -> f32 {
        want.iter().zip(places).map(|(a, b)| length(less(*a, *b))).sum::<f32>() / want.len() as f32
    };
    let [told, not] = [Some(1.0 / 60.0), None].map(|seconds| off(&wrists(2, seconds)));
    println!("60 frames a second: {:.2} mm from 30, {:.2} mm if not told", 1e3 * told, 1e3 * not);
    assert!(told < 3e-3 && told < 0.75 * not, "{told} {not}");
}
