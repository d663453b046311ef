//! Rigs of common conventions, each with its names, hierarchy, bone axes, rest pose, unit and up
//! axis: a performance on each matches ours.

use super::rigs::*;
use super::{angle_between, less, moved};
use umo_core::{Floor, JOINTS, Mapping, Pose, Quat, Retarget, Rig};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, inverse, product, rotate};
use umo_core_pose::skeleton::joint_places;

/// A rig as a program exports it.
pub(super) struct Exported {
    pub(super) program: &'static str,
    naming: &'static Naming,
    /// Units per metre.
    pub(super) unit: f32,
    /// Scale of the root bone.
    scale: f32,
    up: Up,
    /// The axis along a bone; `None` if bones have no axes of their own.
    along: Option<Vector>,
    /// Angle of the arms below a T-pose, and of the feet outward relative to ours, radians.
    droop: f32,
    spread: f32,
    /// Lengths of thighs, shins and feet, relative to ours.
    legs: [f32; 3],
    /// Additional bones: name, and parent.
    more: &'static [(&'static str, &'static str)],
}

#[derive(Clone, Copy, PartialEq)]
enum Up {
    Y,
    Z,
    /// Y up, facing backwards.
    Back,
}

const X: Option<Vector> = Some([1.0, 0.0, 0.0]);
const Y: Option<Vector> = Some([0.0, 1.0, 0.0]);

const BASE: Exported = Exported {
    program: "",
    naming: &MIXAMO,
    unit: 1.0,
    scale: 1.0,
    up: Up::Y,
    along: None,
    droop: 0.0,
    spread: 0.0,
    legs: [1.0; 3],
    more: &[],
};

#[rustfmt::skip]
pub(super) const RIGS: [Exported; 22] = [
    Exported { program: "Mixamo", unit: 100.0, scale: 0.01, along: Y, legs: [1.08, 0.95, 1.0],
        more: &[("mixamorig:HeadTop_End", "mixamorig:Head"), ("mixamorig:LeftToe_End", "mixamorig:LeftToeBase")], ..BASE },
    Exported { program: "Ready Player Me", naming: &READY_PLAYER_ME, along: Y, droop: 0.05, legs: [0.95, 1.02, 0.9],
        more: &[("HeadTop_End", "Head"), ("LeftToe_End", "LeftToeBase")], ..BASE },
    Exported { program: "HumanIK", naming: &HUMAN_IK, unit: 100.0, along: X,
        more: &[("Character1_LeftForeArmRoll", "Character1_LeftForeArm")], ..BASE },
    Exported { program: "Unreal 4", naming: &UNREAL_4, unit: 100.0, up: Up::Z, along: X, droop: 0.9, spread: 0.06, legs: [1.05, 1.0, 1.1],
        more: &[("upperarm_twist_01_l", "upperarm_l"), ("thigh_twist_01_l", "thigh_l"), ("ik_foot_root", "root"), ("ik_foot_l", "ik_foot_root")], ..BASE },
    Exported { program: "MetaHuman", naming: &UNREAL, unit: 100.0, up: Up::Z, along: X, droop: 0.75, spread: 0.1, legs: [1.0, 1.06, 0.95],
        more: &[("index_metacarpal_l", "hand_l"), ("upperarm_correctiveRoot_l", "upperarm_l"), ("FACIAL_C_FacialRoot", "head"), ("FACIAL_C_Jaw", "FACIAL_C_FacialRoot")], ..BASE },
    Exported { program: "MakeHuman", naming: &MAKEHUMAN, along: Y, droop: 0.6, spread: 0.08, legs: [0.97, 1.03, 1.0],
        more: &[("levator02.L", "head"), ("tongue00", "jaw")], ..BASE },
    Exported { program: "Rigify", naming: &RIGIFY, along: Y, droop: 0.7, legs: [1.1, 0.9, 1.2],
        more: &[("DEF-thigh.L.001", "DEF-thigh.L"), ("ORG-hand.L", "metarig"), ("DEF-breast.L", "DEF-spine.003")], ..BASE },
    Exported { program: "Blender by hand", naming: &BLENDER, up: Up::Z, along: Y, droop: 0.5, legs: [1.2, 1.1, 0.9], ..BASE },
    Exported { program: "Unity", naming: &UNITY, legs: [1.0, 0.9, 1.0], ..BASE },
    Exported { program: "VRoid", naming: &VROID, up: Up::Back, legs: [1.12, 1.2, 0.8],
        more: &[("J_Sec_Hair1_01", "J_Bip_C_Head"), ("J_Sec_L_Bust1", "J_Bip_C_UpperChest")], ..BASE },
    Exported { program: "Godot", naming: &GODOT, along: Y, legs: [1.0, 1.1, 1.0], ..BASE },
    Exported { program: "3ds Max Biped", naming: &BIPED, unit: 100.0, up: Up::Z, along: X, legs: [0.9, 1.0, 1.0],
        more: &[("Bip01 Footsteps", "Bip01"), ("Bip01 HeadNub", "Bip01 Head")], ..BASE },
    Exported { program: "Source", naming: &SOURCE, unit: 39.37, up: Up::Z, along: X, droop: 0.3, legs: [1.0, 0.95, 1.0],
        more: &[("ValveBiped.forward", "ValveBiped.Bip01_Head1")], ..BASE },
    Exported { program: ".bvh", naming: &POSER, unit: 100.0, legs: [1.1, 1.1, 1.0], ..BASE },
    Exported { program: "Character Creator", naming: &CHARACTER_CREATOR, unit: 100.0, scale: 0.01, along: Y, droop: 0.85, spread: 0.05, legs: [1.04, 1.02, 1.0],
        more: &[("CC_Base_L_UpperarmTwist01", "CC_Base_L_Upperarm"), ("CC_Base_L_CalfTwist01", "CC_Base_L_Calf"), ("CC_Base_L_Breast", "CC_Base_Spine02")], ..BASE },
    Exported { program: "Daz Genesis 8", naming: &DAZ, unit: 100.0, along: X, droop: 0.8, spread: 0.1, legs: [1.1, 1.05, 0.9],
        more: &[("pelvis", "hip"), ("lThighTwist", "lThighBend"), ("lForearmTwist", "lForearmBend")], ..BASE },
    Exported { program: "Daz Genesis 9", naming: &DAZ_9, unit: 100.0, along: X, droop: 0.7, spread: 0.06, legs: [1.0, 1.08, 1.0],
        more: &[("pelvis", "hip"), ("l_thightwist1", "l_thigh"), ("l_metatarsal", "l_foot")], ..BASE },
    Exported { program: "AdvancedSkeleton", naming: &ADVANCED_SKELETON, unit: 100.0, along: X, legs: [0.95, 0.9, 1.0],
        more: &[("HipPart1_L", "Hip_L"), ("IndexFinger4_L", "IndexFinger3_L"), ("Cup_L", "Wrist_L")], ..BASE },
    Exported { program: "VRChat", naming: &CATS, along: Y, droop: 0.4, legs: [1.15, 1.05, 0.85],
        more: &[("Hair", "Head"), ("Skirt_F", "Hips")], ..BASE },
    Exported { program: "MikuMikuDance", naming: &MMD, unit: 12.5, up: Up::Back, droop: 0.65, legs: [1.1, 1.15, 0.9],
        more: &[("左足ＩＫ", "全ての親"), ("左腕捩", "左腕"), ("下半身", "グルーブ")], ..BASE },
    Exported { program: "Roblox", naming: &ROBLOX, unit: 3.5, legs: [0.8, 0.8, 1.0], ..BASE },
    Exported { program: "SMPL-X", naming: &SMPL_X, ..BASE },
];

impl Exported {
    fn body(&self) -> Body {
        self.body_of(&|_| 1.0)
    }

    /// The body with other proportions: factors of the lengths of the program's bones.
    pub(super) fn body_of(&self, own: &dyn Fn(usize) -> f32) -> Body {
        let programs = |joint: usize| match joint {
            4 | 5 => self.legs[0],
            7 | 8 => self.legs[1],
            10 | 11 => self.legs[2],
            // Hips a little wider, arms a little shorter.
            1 | 2 => 1.1,
            18..=21 => 0.93,
            _ => 1.0,
        };
        let mut body = self.naming.body(&|joint| programs(joint) * own(joint), self.droop);
        for (side, hip) in [(1.0, 1), (-1.0, 2)] {
            let at = body.0[body.bone(hip).unwrap()].place;
            let turn = axis_angle_to_quat([0.0, 0.0, side * self.spread]);
            for joint in (0..JOINTS).filter(|&joint| joint != hip && hangs_on(joint, hip)) {
                let Some(bone) = body.bone(joint) else { continue };
                let away = rotate(turn, less(body.0[bone].place, at));
                body.0[bone].place = std::array::from_fn(|i| at[i] + away[i]);
            }
        }
        for (name, above) in self.more {
            let parent = body.0.iter().position(|piece| piece.name == *above).unwrap();
            let place = body.0[parent].place;
            body.0.push(Piece { name: (*name).to_owned(), parent: Some(parent), place, joint: None });
        }
        body
    }

    /// Rotation from our axes to the rig's.
    pub(super) fn world(&self) -> Quat {
        match self.up {
            Up::Y => IDENTITY,
            Up::Z => axis_angle_to_quat([std::f32::consts::FRAC_PI_2, 0.0, 0.0]),
            Up::Back => [0.0, 1.0, 0.0, 0.0],
        }
    }

    pub(super) fn rig(&self, body: &Body) -> Rig {
        let world = self.world();
        body.rig(world, self.unit, self.scale, &|bone| match self.along {
            Some(along) => product(world, turn(along, body.points(bone))),
            None => IDENTITY,
        })
    }
}

/// The shortest rotation from one unit vector to another.
fn turn(from: Vector, to: Vector) -> Quat {
    let cross = cross(from, to);
    let dot: f32 = from.iter().zip(to).map(|(a, b)| a * b).sum();
    let size = cross.iter().map(|x| x * x).sum::<f32>().sqrt();
    if size < 1e-6 {
        return if dot > 0.0 { IDENTITY } else { axis_angle_to_quat([0.0, 0.0, std::f32::consts::PI]) };
    }
    axis_angle_to_quat(cross.map(|x| x / size * size.atan2(dot)))
}

pub(super) fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn length(v: Vector) -> f32 {
    v.iter().map(|x| x * x).sum::<f32>().sqrt()
}

const FRAMES: usize = 90;

/// A frame of a performance on our skeleton, and which feet are planted: the body sways, turns and
/// crouches over planted feet; then the left foot takes a step, heel first, and is planted again;
/// arms and fingers gesture.
fn performance(frame: usize) -> (Pose, [bool; 2]) {
    let skeleton = source();
    let rest = standing(&skeleton);
    let t = frame as f32 / FRAMES as f32;
    let wave = |speed: f32, phase: f32| (speed * std::f32::consts::TAU * t + phase).sin();
    let mut pose = Pose::REST;
    pose.rotations[0] = axis_angle_to_quat([0.05 * wave(2.0, 0.3), 0.25 * wave(1.0, 0.0), 0.05 * wave(1.0, 1.0)]);
    pose.translation = rest[0];
    pose.translation[0] += 0.05 * wave(1.0, 0.5);
    pose.translation[1] -= 0.06 + 0.03 * wave(3.0, 0.0);
    pose.translation[2] += 0.04 * wave(2.0, 2.0);
    for (side, sign) in [(0, 1.0), (1, -1.0)] {
        pose.rotations[16 + side] = axis_angle_to_quat([0.3 * wave(2.0, sign), 0.4 * wave(1.0, sign), sign * -0.8]);
        pose.rotations[18 + side] = axis_angle_to_quat([0.0, sign * -(0.7 + 0.5 * wave(3.0, sign)), 0.0]);
        pose.rotations[20 + side] = axis_angle_to_quat([0.2 * wave(4.0, sign), 0.1, 0.3 * wave(2.0, sign)]);
        for joint in (25..40).step_by(3) {
            pose.rotations[joint + 15 * side] = axis_angle_to_quat([0.0, 0.0, sign * -(0.3 + 0.2 * wave(5.0, 0.0))]);
        }
    }
    pose.rotations[15] = axis_angle_to_quat([0.1 * wave(3.0, 0.0), 0.2 * wave(1.0, 0.0), 0.0]);
    // The step: up and forward, in the middle third.
    let step = ((t - 0.4) / 0.3).clamp(0.0, 1.0);
    let stands = [step <= 0.0 || step >= 1.0, true];
    let lift = 0.10 * (std::f32::consts::PI * step).sin();
    for side in 0..2 {
        let (ahead, up) = if side == 0 { (0.15 * step, lift) } else { (0.0, 0.0) };
        let pitch = if side == 0 { 4.0 * lift * (1.0 - step) } else { 0.0 };
        let foot = axis_angle_to_quat([pitch, 0.0, 0.0]);
        let ankle = rest[7 + side];
        plant(&mut pose, side, [ankle[0], ankle[1] + up, ankle[2] + ahead], foot);
    }
    (pose, stands)
}

/// Bends one of our legs so that the ankle is at a position, and rotates the foot.
fn plant(pose: &mut Pose, side: usize, ankle: Vector, foot: Quat) {
    let skeleton = source();
    let [hip, knee, end] = [1, 4, 7].map(|joint| joint + side);
    let pelvis = pose.rotations[0];
    let from = joint_places(&skeleton, pose)[hip];
    let [thigh, shin] = [knee, end].map(|joint| skeleton.offsets_m[joint]);
    let (a, b) = (length(thigh), length(shin));
    let way = less(ankle, from);
    let far = length(way).min(0.9999 * (a + b));
    let to = way.map(|x| x / length(way));
    let along = (a * a - b * b + far * far) / (2.0 * far);
    let out = (a * a - along * along).max(0.0).sqrt();
    let side = cross(to, [1.0, 0.0, 0.0]);
    let ahead = side.map(|x| x / length(side));
    let knee_at: Vector = std::array::from_fn(|i| along * to[i] + out * ahead[i]);
    let end_at: Vector = std::array::from_fn(|i| far * to[i] - knee_at[i]);
    let upper = turn(thigh.map(|x| x / a), knee_at.map(|x| x / length(knee_at)));
    let lower = turn(shin.map(|x| x / b), end_at.map(|x| x / length(end_at)));
    pose.rotations[hip] = product(inverse(pelvis), upper);
    pose.rotations[knee] = product(inverse(upper), lower);
    pose.rotations[end] = product(inverse(lower), foot);
}

#[test]
fn the_performance_stands_on_its_feet() {
    let rest = standing(&source());
    for frame in 0..FRAMES {
        let (pose, stands) = performance(frame);
        let places = joint_places(&source(), &pose);
        for side in (0..2).filter(|&side| stands[side]) {
            let up = places[7 + side][1] - rest[7 + side][1];
            assert!(up.abs() < 1e-3, "frame {frame}: {up}");
        }
    }
}

#[test]
fn every_programs_rigs_are_found_stand_and_gesture_as_ours_do() {
    let skeleton = source();
    let rest = standing(&skeleton);
    for exported in &RIGS {
        let program = exported.program;
        let body = exported.body();
        let rig = exported.rig(&body);
        let (mapping, label) = Mapping::guess(&rig).unwrap_or_else(|error| panic!("{program}: {error}"));
        assert_eq!(label, exported.naming.label, "{program}");
        for (bone, piece) in body.0.iter().enumerate() {
            if let Some(joint) = piece.joint {
                assert_eq!(mapping.bone(joint), Some(bone), "{program}: {}", piece.name);
            }
        }
        let retarget = Retarget::new(&skeleton, &rig, &mapping, Floor::AtRest).unwrap();
        let (world, size) = (exported.world(), retarget.scale());
        let own = |v: Vector| rotate(inverse(world), v);
        // One centimetre at human size.
        let cm = 0.01 * size;
        let mut first = None;
        for frame in 0..FRAMES {
            let (pose, _) = performance(frame);
            let (places, _) = moved(&retarget, &rig, &pose);
            let ours = joint_places(&skeleton, &pose);
            let at = |joint: usize| body.bone(joint).map(|bone| own(places[bone]));
            let at_rest = |joint: usize| own(rig.place(body.bone(joint).unwrap()));
            for side in 0..2 {
                // The lower of ankle and ball is as high as ours.
                let points: Vec<_> =
                    [7, 10].map(|joint| joint + side).into_iter().filter(|&j| at(j).is_some()).collect();
                let height = |joint: &usize| at(*joint).unwrap()[1] - at_rest(*joint)[1];
                let height = points.iter().map(height).fold(f32::MAX, f32::min);
                let wanted = points.iter().map(|&j| size * (ours[j][1] - rest[j][1])).fold(f32::MAX, f32::min);
                let off = (height - wanted).abs() / cm;
                assert!(off < 1.0, "{program}, frame {frame}: a foot is {off} cm too high or low");
            }
            // Planted feet are, and moving feet go, where ours do relative to their first position.
            let feet = [7, 8].map(|joint| (at(joint).unwrap(), ours[joint]));
            let before = *first.get_or_insert(feet);
            for (side, (now, then)) in feet.into_iter().zip(before).enumerate() {
                let (went, wanted) = (less(now.0, then.0), less(now.1, then.1).map(|x| x * size));
                // While the heel is up, the ball is planted.
                if pose_is_flat(&pose, side) {
                    let off = length(less(went, wanted)) / cm;
                    assert!(off < 1.0, "{program}, frame {frame}: foot {side} stands {off} cm from where it should");
                }
            }
            // Arms and hands point in our directions.
            for (from, to) in [(16, 18), (17, 19), (18, 20), (19, 21), (20, 28), (21, 43), (28, 29), (43, 44)] {
                let Some((a, b)) = at(from).zip(at(to)) else { continue };
                let angle = angle_between(less(b, a), less(ours[to], ours[from]));
                assert!(angle < 2e-3, "{program}, frame {frame}: joint {from} to {to} is {angle} rad off");
            }
            for (index, pinky) in [(25, 31), (40, 46)] {
                let Some((a, b)) = at(index).zip(at(pinky)) else { continue };
                let angle = angle_between(less(b, a), less(ours[pinky], ours[index]));
                assert!(angle < 0.02, "{program}, frame {frame}: a palm is {angle} rad off");
            }
        }
    }
}

/// Whether a foot's sole is level.
fn pose_is_flat(pose: &Pose, side: usize) -> bool {
    let chain = [0, 1, 4, 7].map(|joint| if joint == 0 { 0 } else { joint + side });
    let foot = chain.iter().fold(IDENTITY, |q, &joint| product(q, pose.rotations[joint]));
    rotate(foot, [0.0, 1.0, 0.0])[1] > 0.99999
}

#[test]
fn names_that_a_program_numbered_are_known() {
    for naming in [&MIXAMO, &CHARACTER_CREATOR, &BIPED, &CATS] {
        let mut body = naming.body(&|_| 1.0, 0.0);
        for (at, piece) in body.0.iter_mut().enumerate() {
            piece.name = format!("{}_{:02}", piece.name, at + 3);
        }
        let rig = body.rig(IDENTITY, 1.0, 1.0, &|_| IDENTITY);
        let (mapping, label) = Mapping::guess(&rig).unwrap();
        assert_eq!(label, naming.label);
        let found = (0..JOINTS).filter(|&joint| mapping.bone(joint).is_some()).count();
        assert_eq!(found, body.0.iter().filter(|piece| piece.joint.is_some()).count(), "{label}");
    }
}
