//! Bodies of every convention and of many builds: arms keep out of trunk and head, hands touch where a person's do, and
//! nothing jumps. The trunk is stiff, so that depths are exact by formula; `tests/volume.rs` measures meshes that bend.

use super::conventions::{Exported, RIGS};
use super::rigs::{Body, SMPL_X, Vector, source, standing};
use super::{less, moved};
use umo_core::{Floor, JOINTS, Mapping, Pose, Retarget, Rig, SurfacePoint, Volume};
use umo_core_pose::rotation::{axis_angle_to_quat, inverse, product, rotate};

/// Differences of a character from a person.
struct Build {
    name: &'static str,
    /// Lengths of trunk, arms, legs.
    lengths: [f32; 3],
    /// Girth: width and depth of the trunk, more of the belly ahead, limbs, head.
    girths: [f32; 5],
    /// Fingers of a hand; 0 for a fist, a hoof or a claw.
    fingers: usize,
    /// The trunk is a box.
    is_box: bool,
    /// Attached parts.
    extra: Extra,
}

#[derive(Clone, Copy, PartialEq)]
enum Extra {
    None,
    /// A cone from the waist to the knees.
    Skirt,
    /// Behind the back, down to the hips, on the head's bone.
    Hair,
    /// Soles 12 cm below the ankles' height at rest, under raised heels.
    Heels,
}

const BASE: Build = Build {
    name: "people's",
    lengths: [1.0; 3],
    girths: [1.0, 1.0, 0.0, 1.0, 1.0],
    fingers: 5,
    is_box: false,
    extra: Extra::None,
};

const BUILDS: [Build; 11] = [
    BASE,
    Build { name: "bulky", lengths: [1.0, 0.95, 0.9], girths: [1.4, 1.4, 0.6, 1.3, 1.1], ..BASE },
    Build { name: "thin", lengths: [1.0, 1.05, 1.1], girths: [0.75, 0.7, 0.0, 0.65, 0.9], ..BASE },
    Build { name: "child", lengths: [0.62, 0.55, 0.5], girths: [0.7, 0.72, 0.2, 0.6, 0.85], ..BASE },
    Build { name: "big-headed", lengths: [0.8, 0.8, 0.6], girths: [0.8, 0.8, 0.1, 0.8, 1.7], ..BASE },
    Build { name: "robot", girths: [1.2, 1.2, 0.0, 1.1, 1.1], fingers: 0, is_box: true, ..BASE },
    Build { name: "four-fingered", girths: [1.1, 1.1, 0.2, 1.0, 1.3], fingers: 4, ..BASE },
    Build { name: "in a skirt", girths: [0.9, 0.9, 0.0, 0.9, 1.0], extra: Extra::Skirt, ..BASE },
    Build { name: "long-haired", girths: [0.9, 0.95, 0.1, 0.9, 1.0], extra: Extra::Hair, ..BASE },
    Build { name: "on heels", lengths: [1.0, 1.0, 1.1], extra: Extra::Heels, ..BASE },
    Build { name: "hoofed", lengths: [1.1, 0.9, 0.8], girths: [1.25, 1.3, 0.3, 1.2, 1.1], fingers: 0, ..BASE },
];

/// Height above the line of the hips in trunk lengths, half width, depth ahead and behind in metres of a person's size.
const TRUNK: [[f32; 4]; 7] = [
    [-0.15, 0.16, 0.10, 0.11],
    [0.0, 0.17, 0.11, 0.115],
    [0.3, 0.145, 0.11, 0.095],
    [0.6, 0.16, 0.118, 0.108],
    [0.9, 0.18, 0.11, 0.105],
    [1.0, 0.15, 0.08, 0.095],
    [1.08, 0.08, 0.06, 0.08],
];
/// Length of a person's trunk, metres.
const PERSON: f32 = 0.53;

fn add(a: Vector, b: Vector) -> Vector {
    std::array::from_fn(|i| a[i] + b[i])
}

fn times(a: Vector, by: f32) -> Vector {
    a.map(|x| x * by)
}

fn length(a: Vector) -> f32 {
    a.iter().map(|x| x * x).sum::<f32>().sqrt()
}

/// A character in the body's axes, metres: X left, Y up, Z ahead.
struct Character<'a> {
    build: &'a Build,
    exported: &'a Exported,
    body: Body,
    rig: Rig,
    mapping: Mapping,
    /// Middle of the hips, and from there to the shoulders.
    base: Vector,
    trunk: f32,
    fingers: Vec<usize>,
}

impl<'a> Character<'a> {
    fn new(exported: &'a Exported, build: &'a Build) -> Self {
        let own = |joint: usize| match joint {
            1 | 2 | 4 | 5 | 7 | 8 | 10 | 11 => build.lengths[2],
            18..=21 | 25.. => build.lengths[1],
            13 | 14 | 16 | 17 => build.girths[0].clamp(0.75, 1.35),
            _ => build.lengths[0],
        };
        Self::of(exported, build, exported.body_of(&own))
    }

    fn of(exported: &'a Exported, build: &'a Build, mut body: Body) -> Self {
        // Index, middle, little, ring, thumb: four have no ring.
        let kept = |finger: usize| build.fingers == 5 || build.fingers == 4 && finger != 3;
        let has = |joint: usize| joint < 25 || kept((joint - 25) % 15 / 3);
        let gone = |body: &Body| {
            let is_leaf = |at: usize| body.0.iter().all(|piece| piece.parent != Some(at));
            (0..body.0.len()).find(|&at| body.0[at].joint.is_some_and(|joint| !has(joint)) && is_leaf(at))
        };
        while let Some(at) = gone(&body) {
            body.0.remove(at);
            let moved = body.0.iter_mut().filter_map(|piece| piece.parent.as_mut());
            moved.filter(|parent| **parent > at).for_each(|parent| *parent -= 1);
        }
        let rig = exported.rig(&body);
        let (mapping, _) = Mapping::guess(&rig).unwrap();
        let fingers = (25..JOINTS).filter(|&joint| body.bone(joint).is_some()).collect();
        let place = |joint: usize| body.0[body.bone(joint).unwrap()].place;
        let middle = |left: usize, right: usize| times(add(place(left), place(right)), 0.5);
        let base = middle(1, 2);
        let trunk = middle(16, 17)[1] - base[1];
        Self { build, exported, body, rig, mapping, base, trunk, fingers }
    }

    fn place(&self, joint: usize) -> Vector {
        self.body.0[self.body.bone(joint).unwrap()].place
    }

    /// Half sizes of the trunk at a height above its base: left, ahead, behind.
    fn section(&self, height: f32) -> [f32; 3] {
        let share = (height / self.trunk).clamp(TRUNK[0][0], TRUNK[6][0]);
        let at = TRUNK.windows(2).find(|pair| share <= pair[1][0]).unwrap();
        let part = (share - at[0][0]) / (at[1][0] - at[0][0]);
        let [wide, deep, belly, ..] = self.build.girths;
        let bulge = 1.0 + belly * (1.0 - ((share - 0.3) / 0.4).powi(2)).max(0.0);
        let sizes: [f32; 3] = std::array::from_fn(|i| at[0][i + 1] + part * (at[1][i + 1] - at[0][i + 1]));
        [sizes[0] * wide, sizes[1] * deep * bulge, sizes[2] * deep].map(|x| x * self.trunk / PERSON)
    }

    /// Number of times that a point of the trunk's axes is as far out as the surface.
    fn outside(&self, at: Vector) -> f32 {
        let [side, ahead, behind] = self.section(at[1]);
        let (x, z) = (at[0] / side, at[2] / if at[2] > 0.0 { ahead } else { behind });
        if self.build.is_box { x.abs().max(z.abs()) } else { x.hypot(z) }
    }

    /// Centre and half sizes of the head.
    fn head(&self) -> (Vector, Vector) {
        let size = self.build.girths[4];
        (add(self.place(15), [0.0, 0.09 * size, 0.015]), times([0.083, 0.12, 0.1], size))
    }

    /// Distance of a point from trunk and head along the ray from their axes, negative inside; the body is at rest.
    fn gaps(&self, at: Vector) -> [f32; 2] {
        let inside = less(at, self.base);
        let share = inside[1] / self.trunk;
        let out = inside[0].hypot(inside[2]);
        let trunk = if (-0.1..1.0).contains(&share) { out * (1.0 - 1.0 / self.outside(inside).max(1e-3)) } else { 1.0 };
        let (centre, half) = self.head();
        let from = less(at, centre);
        let head = length(std::array::from_fn(|i| from[i] / half[i])).max(1e-3);
        [trunk, length(from) * (1.0 - 1.0 / head)]
    }

    fn radii(&self) -> [f32; 2] {
        let size = self.build.girths[3] * (self.trunk / PERSON).max(0.7);
        [0.032 * size, if self.build.fingers > 0 { 0.009 * size } else { 0.025 * size }]
    }

    /// Points spread over its surface, in the rig's world.
    fn points(&self) -> Vec<SurfacePoint> {
        let world = self.exported.world();
        let mut points = Vec::new();
        let mut put = |bone: usize, at: Vector| {
            let place = rotate(world, times(at, self.exported.unit));
            points.push(SurfacePoint { bone, place, area: 1.0 });
        };
        let bone = |joint: usize| self.body.bone(joint).unwrap();
        let hips = bone(0);
        let spine = |y: f32| {
            let is_below = |bone: &usize| self.body.0[*bone].place[1] <= y + 0.02;
            self.mapping.spine().iter().copied().rfind(is_below).unwrap_or(hips)
        };
        let around = |turn: u16| (std::f32::consts::TAU * f32::from(turn) / 64.0).sin_cos();
        for ring in 0..60_u8 {
            let height = (-0.14 + 1.2 * f32::from(ring) / 59.0) * self.trunk;
            for (sine, cosine) in (0..64).map(around) {
                let by = 1.0 / self.outside([sine, height, cosine]);
                let at = add(self.base, [sine * by, height, cosine * by]);
                put(spine(at[1]), at);
            }
        }
        let (centre, half) = self.head();
        for ring in 1..24_u8 {
            let (out, up) = (std::f32::consts::PI * f32::from(ring) / 24.0).sin_cos();
            for (sine, cosine) in (0..64).map(around) {
                put(bone(15), add(centre, [sine * out * half[0], up * half[1], cosine * out * half[2]]));
            }
        }
        let [fore, hand] = self.radii();
        let mut limb = |bone: usize, from: Vector, to: Vector, radius: f32| {
            let way = less(to, from);
            let level = [way[2], 0.0, -way[0]];
            let across = if length(level) > 0.1 * length(way) { level } else { [1.0, 0.0, 0.0] };
            let across = times(across, radius / length(across));
            let other = super::conventions::cross(times(way, 1.0 / length(way)), across);
            for along in 0..12_u8 {
                for (sine, cosine) in (0..64).step_by(8).map(around) {
                    let at = add(from, times(way, (f32::from(along) + 0.5) / 12.0));
                    put(bone, add(at, add(times(across, sine), times(other, cosine))));
                }
            }
        };
        for side in 0..2 {
            let [shoulder, elbow, wrist] = [16, 18, 20].map(|joint| self.place(joint + side));
            limb(bone(16 + side), shoulder, elbow, 1.3 * fore);
            limb(bone(18 + side), elbow, wrist, fore);
            limb(bone(20 + side), wrist, add(wrist, times(self.along(side), 0.09)), hand.max(0.6 * fore));
            limb(bone(1 + side), self.place(1 + side), self.place(4 + side), 2.4 * fore);
        }
        for &joint in self.fingers.iter().filter(|&&joint| (joint - 25) % 3 < 2) {
            limb(bone(joint), self.place(joint), self.place(joint + 1), hand);
        }
        match self.build.extra {
            Extra::Skirt => {
                for (drop, (sine, cosine)) in (0..30_u8).flat_map(|drop| (0..64).map(move |turn| (drop, around(turn))))
                {
                    let down = f32::from(drop) / 30.0;
                    let at =
                        [sine * (0.17 + 0.3 * down), (0.1 - 0.6 * down) * self.trunk, cosine * (0.13 + 0.3 * down)];
                    put(hips, add(self.base, at));
                }
            }
            Extra::Hair => {
                for drop in 0..60_u8 {
                    for across in 0..20_u8 {
                        let (x, y) = (0.012 * f32::from(across) - 0.12, -0.01 * f32::from(drop));
                        put(bone(15), add(centre, [x, y, -0.12 - 0.001 * f32::from(drop)]));
                    }
                }
            }
            Extra::Heels => {
                for side in 0..2 {
                    let ankle = self.place(7 + side);
                    (0..40_u8).for_each(|at| put(bone(7 + side), add(ankle, [0.0, -0.12, 0.005 * f32::from(at)])));
                }
            }
            Extra::None => {}
        }
        points
    }

    /// Direction of a forearm at rest.
    fn along(&self, side: usize) -> Vector {
        let way = less(self.place(20 + side), self.place(18 + side));
        times(way, self.build.lengths[1] / length(way))
    }

    fn retarget(&self, gain: f32) -> Retarget {
        let mut retarget = Retarget::new(&source(), &self.rig, &self.mapping, Floor::AtRest).unwrap();
        let volume = Volume::measure(&self.rig, &self.mapping, &self.points()).unwrap();
        retarget.set_volume(&self.rig, &self.mapping, &volume, gain).unwrap();
        retarget
    }

    /// Gaps of both hands and forearms in a pose, as if the trunk were at rest, and the places of the wrists there.
    fn measure(&self, retarget: &Retarget, pose: &Pose) -> Measured {
        let world = inverse(self.exported.world());
        let (places, turns) = moved(retarget, &self.rig, pose);
        let hips = self.mapping.bone(0).unwrap();
        let own = |at: Vector| times(rotate(world, at), 1.0 / self.exported.unit);
        // The pelvis' rotation, in the body's axes.
        let turned = |bone: usize| product(turns[bone], inverse(self.rig.rotation(bone)));
        let back = inverse(turned(hips));
        let rest = |at: Vector| own(add(self.rig.place(hips), rotate(back, less(at, places[hips]))));
        let place = |joint: usize| rest(places[self.body.bone(joint).unwrap()]);
        let [fore, hand] = self.radii();
        let least = |points: &[(Vector, f32)]| -> [f32; 2] {
            let gaps = points.iter().map(|&(at, radius)| self.gaps(at).map(|gap| gap - radius));
            gaps.fold([1.0; 2], |least, gaps| std::array::from_fn(|i| f32::min(least[i], gaps[i])))
        };
        let mut measured =
            Measured { gaps: [[1.0; 2]; 2], touch: [[1.0; 2]; 2], wrists: [[0.0; 3]; 2], is_finite: true };
        for side in 0..2 {
            let (elbow, wrist) = (place(18 + side), place(20 + side));
            let way = less(wrist, elbow);
            let forearm: Vec<_> = (1..10_u8).map(|at| (add(elbow, times(way, f32::from(at) / 10.0)), fore)).collect();
            let mut points = Vec::new();
            if self.fingers.is_empty() {
                let turn = product(world, product(turned(self.body.bone(20 + side).unwrap()), inverse(world)));
                let turn = product(product(world, product(back, inverse(world))), turn);
                let along = rotate(turn, self.along(side));
                points.extend([0.03, 0.06, 0.09, 0.12, 0.15].map(|far| (add(wrist, times(along, far)), hand)));
            }
            for &joint in self.fingers.iter().filter(|&&joint| (joint - 25) / 15 == side) {
                let at = place(joint);
                points.push((at, hand));
                if (joint - 25) % 3 == 2 {
                    points.push((add(at, times(less(at, place(joint - 1)), 0.9)), hand));
                }
            }
            measured.touch[side] = least(&points);
            let gaps = least(&forearm);
            measured.gaps[side] = std::array::from_fn(|i| f32::min(gaps[i], measured.touch[side][i]));
            measured.wrists[side] = wrist;
        }
        measured.is_finite = places.as_flattened().iter().chain(turns.as_flattened()).all(|x| x.is_finite());
        measured
    }
}

struct Measured {
    /// Least distance of each side's forearm and hand from trunk and head.
    gaps: [[f32; 2]; 2],
    /// The same of the hand alone.
    touch: [[f32; 2]; 2],
    wrists: [Vector; 2],
    is_finite: bool,
}

/// Hands go over belly, chest, face and sides while the hips sway; `t` from 0 to 1.
fn pose(t: f32) -> Pose {
    let wave = |speed: f32, phase: f32| (speed * std::f32::consts::TAU * t + phase).sin();
    let mut pose = Pose { translation: standing(&source())[0], ..Pose::REST };
    pose.rotations[0] = axis_angle_to_quat([0.05 * wave(1.0, 0.3), 0.25 * wave(1.0, 0.0), 0.04 * wave(2.0, 1.0)]);
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        let down = axis_angle_to_quat([0.0, 0.0, -sign * (0.85 + 0.5 * wave(2.0, 1.0 + sign))]);
        let twist = axis_angle_to_quat([0.45 + 0.45 * wave(3.0, sign), 0.0, 0.0]);
        pose.rotations[16 + side] = product(down, twist);
        pose.rotations[18 + side] = axis_angle_to_quat([0.0, -sign * (1.6 + 0.6 * wave(1.0, 0.5 * sign)), 0.0]);
        pose.rotations[20 + side] = axis_angle_to_quat([0.0, 0.0, 0.2 * sign * wave(2.0, 0.0)]);
    }
    pose
}

/// Frames of the motion, and frames from one that is measured to the next.
const FRAMES: usize = 240;
const EVERY: usize = 2;

#[test]
fn arms_keep_out_of_bodies_of_every_convention_and_build() {
    let poses: Vec<Pose> = (0..FRAMES).map(|frame| pose(frame as f32 / FRAMES as f32)).collect();
    let figure = Character::of(&RIGS[RIGS.len() - 1], &BASE, SMPL_X.body(&|_| 1.0, 0.0));
    let measured = |character: &Character, gain: f32| -> Vec<Measured> {
        let retarget = character.retarget(gain);
        poses.iter().map(|pose| character.measure(&retarget, pose)).collect()
    };
    let own = measured(&figure, 0.0);
    for (at, exported) in RIGS.iter().enumerate() {
        // Every build is on two conventions, or more.
        let build = &BUILDS[at % BUILDS.len()];
        let character = Character::new(exported, build);
        let [before, after] = [0.0, 1.0].map(|gain| measured(&character, gain));
        let size = character.trunk / figure.trunk;
        let inside = |frames: &[Measured], limit: f32| {
            let is_inside = |m: &&Measured| m.gaps.as_flattened().iter().any(|&gap| gap < -limit * size);
            frames.iter().step_by(EVERY).filter(is_inside).count() as f32 / (FRAMES / EVERY) as f32
        };
        let touching = |frames: &[Measured]| {
            let pairs = own.iter().zip(frames).step_by(EVERY).flat_map(|(own, here)| {
                own.touch.as_flattened().iter().zip(here.touch.as_flattened()).collect::<Vec<_>>()
            });
            let contacts = pairs.filter(|(own, _)| (-0.02..0.01).contains(*own));
            contacts.fold([0, 0], |[all, kept], (_, here)| [all + 1, kept + usize::from(here.abs() < 0.025 * size)])
        };
        // A jump is as large in an eighth of the time.
        let steps = |every: usize| {
            let wrists = after.iter().step_by(every).map(|m| m.wrists).collect::<Vec<_>>();
            let steps = wrists.windows(2).flat_map(|w| [0, 1].map(|side| length(less(w[1][side], w[0][side]))));
            steps.fold(0.0, f32::max)
        };
        let ([all, kept], [_, held]) = (touching(&after), touching(&before));
        let shares = [0.01, 0.03].map(|limit| [inside(&before, limit), inside(&after, limit)]);
        println!(
            "{:<18} {:<14} > 1 cm {:.3} to {:.3}, > 3 cm {:.3} to {:.3}; contacts {held}, {kept} of {all}; steps {:.4} {:.4}",
            exported.program,
            build.name,
            shares[0][0],
            shares[0][1],
            shares[1][0],
            shares[1][1],
            steps(8),
            steps(1),
        );
        let what = format!("{}, {}", exported.program, build.name);
        assert!(before.iter().chain(&after).all(|m| m.is_finite), "{what}");
        // Corners of boxes are between the radii of a cross-section.
        let most = if build.is_box { 0.05 } else { 0.03 };
        assert!(shares[0][1] <= most && shares[1][1] == 0.0, "{what}: {shares:?}");
        assert!(steps(1) < 0.3 * steps(8), "{what}: a jump of {} m", steps(1));
        // The tips of fingers that are not there touch nothing.
        let least = if character.fingers.is_empty() { 0.0 } else { 0.4 };
        assert!(all > 20 && kept as f32 >= least * all as f32, "{what}: {kept} of {all}");
    }
}
