//! Bodies with the names, sizes, axes and rest poses of other programs.

use umo_core::{Bone, JOINT_NAMES, JOINTS, Quat, Rig, Skeleton};
use umo_core_pose::rotation::{IDENTITY, axis_angle_to_quat, inverse, product, rotate};

pub(crate) type Vector = [f32; 3];

const PARENTS: [i32; JOINTS] = [
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15, 20, 25, 26, 20, 28, 29, 20,
    31, 32, 20, 34, 35, 20, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
];

/// Offsets from the parent, centimetres: middle, then the left side, which the right one mirrors.
const OFFSETS: [(usize, Vector); 31] = [
    (0, [0.0, 0.0, 0.0]),
    (1, [8.5, -8.5, 0.0]),
    (3, [0.0, 11.0, -1.5]),
    (4, [1.0, -40.0, 0.5]),
    (6, [0.0, 13.0, 0.0]),
    (7, [0.0, -41.0, -3.0]),
    (9, [0.0, 6.0, 2.0]),
    (10, [2.0, -6.0, 12.0]),
    (12, [0.0, 20.0, -3.5]),
    (13, [6.0, 11.0, -2.0]),
    (15, [0.0, 9.0, 3.0]),
    (16, [11.5, 3.5, -1.0]),
    (18, [26.5, -1.0, -1.5]),
    (20, [25.0, 0.5, 0.0]),
    (22, [0.0, -0.5, 2.0]),
    (23, [3.2, 6.5, 7.0]),
    (25, [9.2, 0.0, 2.6]),
    (26, [3.8, 0.0, 0.0]),
    (27, [2.4, 0.0, 0.0]),
    (28, [9.5, 0.3, 0.4]),
    (29, [4.2, 0.0, 0.0]),
    (30, [2.7, 0.0, 0.0]),
    (31, [8.1, -0.4, -3.6]),
    (32, [3.0, 0.0, 0.0]),
    (33, [1.8, 0.0, 0.0]),
    (34, [8.9, 0.0, -1.7]),
    (35, [3.9, 0.0, 0.0]),
    (36, [2.5, 0.0, 0.0]),
    (37, [2.6, -1.2, 2.8]),
    (38, [2.9, -0.6, 2.6]),
    (39, [2.2, -0.4, 1.8]),
];

/// The same joint on the other side.
pub(crate) fn mirrored(joint: usize) -> usize {
    let name = JOINT_NAMES[joint];
    let other = match name.strip_prefix("left_") {
        Some(rest) => format!("right_{rest}"),
        None => name.replacen("right_", "left_", 1),
    };
    JOINT_NAMES.iter().position(|&known| known == other).unwrap()
}

/// A person of 1.7 m in a T-pose.
pub(crate) fn source() -> Skeleton {
    let mut offsets_m = vec![[0.0; 3]; JOINTS];
    for (joint, cm) in OFFSETS {
        let m = cm.map(|x| x / 100.0);
        offsets_m[joint] = m;
        offsets_m[mirrored(joint)] = if mirrored(joint) == joint { m } else { [-m[0], m[1], m[2]] };
    }
    Skeleton { parents: PARENTS.to_vec(), offsets_m }
}

/// Joint positions of the source in a T-pose on the floor, metres.
pub(crate) fn standing(skeleton: &Skeleton) -> Vec<Vector> {
    let mut places: Vec<Vector> = Vec::new();
    for (joint, offset) in skeleton.offsets_m.iter().enumerate() {
        let from = usize::try_from(PARENTS[joint]).map_or([0.0; 3], |parent| places[parent]);
        places.push(std::array::from_fn(|i| from[i] + offset[i]));
    }
    let lowest = places.iter().map(|place| place[1]).fold(0.0, f32::min);
    places.iter().map(|place| [place[0], place[1] - lowest + 0.02, place[2]]).collect()
}

/// One bone of a rig under construction.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// Position in the body's axes (X left, Y up, Z forward), metres.
    pub(crate) place: Vector,
    /// The joint, if the bone is one.
    pub(crate) joint: Option<usize>,
}

/// A body before it is rotated, scaled and given bone axes.
#[derive(Clone, Debug)]
pub(crate) struct Body(pub(crate) Vec<Piece>);

/// Names of joints in a convention, and its numbers of bones if they differ.
pub(crate) struct Naming {
    pub(crate) label: &'static str,
    /// Names above the hips.
    pub(crate) above: &'static [&'static str],
    /// Hips, spine, neck, head, jaw.
    pub(crate) hips: &'static str,
    pub(crate) spine: &'static [&'static str],
    pub(crate) neck: &'static [&'static str],
    pub(crate) head: &'static str,
    pub(crate) jaw: &'static str,
    /// Name of an eye; `{}` is the side.
    pub(crate) eye: &'static str,
    pub(crate) arm: [&'static str; 4],
    pub(crate) leg: [&'static str; 4],
    /// Index, middle, little, ring, thumb; `{}` is the side, `#` the number of the bone.
    pub(crate) fingers: [&'static str; 5],
    /// Numbers of a finger's three bones.
    pub(crate) numbers: [&'static str; 3],
    /// Numbers of a thumb's bones, if they differ.
    pub(crate) thumbs: Option<[&'static str; 3]>,
    pub(crate) sides: [&'static str; 2],
}

impl Naming {
    /// A body with the source's proportions times `stretch[joint]` for each bone. Arms are `droop`
    /// radians below a T-pose.
    pub(crate) fn body(&self, stretch: &dyn Fn(usize) -> f32, droop: f32) -> Body {
        let mut skeleton = source();
        for (joint, offset) in skeleton.offsets_m.iter_mut().enumerate() {
            *offset = offset.map(|x| x * stretch(joint));
        }
        for (side, shoulder) in [(1.0, 16), (-1.0, 17)] {
            let turn = axis_angle_to_quat([0.0, 0.0, -side * droop]);
            for joint in (0..JOINTS).filter(|&joint| joint != shoulder && hangs_on(joint, shoulder)) {
                skeleton.offsets_m[joint] = rotate(turn, skeleton.offsets_m[joint]);
            }
        }
        let at = standing(&skeleton);
        let mut body = Body(Vec::new());
        for name in self.above {
            body.add(name, body.0.len().checked_sub(1), [0.0; 3], None);
        }
        let hips = body.add(self.hips, body.0.len().checked_sub(1), at[0], Some(0));
        let chest = body.chain(self.spine, hips, at[0], at[9]);
        let neck = body.chain(self.neck, chest, at[9], at[12]);
        let mut head = None;
        if !self.head.is_empty() {
            let bone = body.add(self.head, Some(neck), at[15], Some(15));
            body.add_if(self.jaw, bone, at[22], 22);
            head = Some(bone);
        }
        for (side, text) in self.sides.iter().enumerate() {
            let name = |pattern: &str| pattern.replace("{}", text);
            if let Some(head) = head {
                body.add_if(&name(self.eye), head, at[23 + side], 23 + side);
            }
            let mut above = hips;
            for (joint, pattern) in [1, 4, 7, 10].into_iter().zip(self.leg) {
                above = body.add_if(&name(pattern), above, at[joint + side], joint + side).unwrap_or(above);
            }
            let mut above = chest;
            for (joint, pattern) in [13, 16, 18, 20].into_iter().zip(self.arm) {
                above = body.add_if(&name(pattern), above, at[joint + side], joint + side).unwrap_or(above);
            }
            for (finger, pattern) in self.fingers.iter().enumerate().filter(|(_, pattern)| !pattern.is_empty()) {
                let mut above = above;
                let numbers = self.thumbs.filter(|_| finger == 4).unwrap_or(self.numbers);
                for (bone, number) in numbers.iter().enumerate() {
                    let joint = 25 + 15 * side + 3 * finger + bone;
                    above = body.add(&name(pattern).replace('#', number), Some(above), at[joint], Some(joint));
                }
            }
        }
        body
    }
}

/// Whether a joint is `above` or a descendant of it.
pub(crate) fn hangs_on(joint: usize, above: usize) -> bool {
    std::iter::successors(Some(joint), |&joint| usize::try_from(PARENTS[joint]).ok()).any(|joint| joint == above)
}

impl Body {
    fn add(&mut self, name: &str, parent: Option<usize>, place: Vector, joint: Option<usize>) -> usize {
        self.0.push(Piece { name: name.to_owned(), parent, place, joint });
        self.0.len() - 1
    }

    fn add_if(&mut self, name: &str, parent: usize, place: Vector, joint: usize) -> Option<usize> {
        (!name.is_empty()).then(|| self.add(name, Some(parent), place, Some(joint)))
    }

    /// Adds a chain of evenly spaced bones; the last is at `to`.
    fn chain(&mut self, names: &[&str], mut above: usize, from: Vector, to: Vector) -> usize {
        for (k, name) in names.iter().enumerate() {
            let share = (k + 1) as f32 / names.len() as f32;
            let place = std::array::from_fn(|i| from[i] + share * (to[i] - from[i]));
            above = self.add(name, Some(above), place, None);
        }
        above
    }

    /// The rig: the body rotated by `world` and scaled by `unit`, the root bone scaled by `scale` (so
    /// that the bones below are `unit / scale` long), and each bone's axes rotated by
    /// `axes`.
    pub(crate) fn rig(&self, world: Quat, unit: f32, scale: f32, axes: &dyn Fn(usize) -> Quat) -> Rig {
        let place = |bone: usize| rotate(world, self.0[bone].place.map(|x| x * unit));
        let turned = |bone: usize| {
            if self.0[bone].joint.is_none() && self.0[bone].parent.is_none() { world } else { axes(bone) }
        };
        let bones = (0..self.0.len()).map(|at| {
            let piece = &self.0[at];
            let (from, above, size) = match piece.parent {
                Some(parent) => (place(parent), turned(parent), scale),
                None => ([0.0; 3], IDENTITY, 1.0),
            };
            let apart = std::array::from_fn(|i| (place(at)[i] - from[i]) / size);
            let mut bone = Bone::new(piece.name.clone(), piece.parent, rotate(inverse(above), apart));
            bone.rotation = product(inverse(above), turned(at));
            bone.scale = if piece.parent.is_none() { [scale; 3] } else { [1.0; 3] };
            bone
        });
        Rig::new(bones.collect()).unwrap()
    }

    /// Direction of a bone at rest, in the body's axes: to its first child, or else the direction of its
    /// parent.
    pub(crate) fn points(&self, bone: usize) -> Vector {
        let child = self.0.iter().position(|piece| piece.parent == Some(bone) && piece.place != self.0[bone].place);
        let (from, to) = match (child, self.0[bone].parent) {
            (Some(child), _) => (bone, child),
            (None, Some(parent)) => (parent, bone),
            (None, None) => return [0.0, 1.0, 0.0],
        };
        let way: Vector = std::array::from_fn(|i| self.0[to].place[i] - self.0[from].place[i]);
        let length = way.iter().map(|x| x * x).sum::<f32>().sqrt();
        if length > 1e-4 { way.map(|x| x / length) } else { [0.0, 1.0, 0.0] }
    }

    /// The bone of a joint.
    pub(crate) fn bone(&self, joint: usize) -> Option<usize> {
        self.0.iter().position(|piece| piece.joint == Some(joint))
    }
}

const LR: [&str; 2] = ["l", "r"];
const LEFT_RIGHT: [&str; 2] = ["Left", "Right"];
const DOT: [&str; 2] = ["L", "R"];
const PLAIN: [&str; 3] = ["1", "2", "3"];
const ZERO: [&str; 3] = ["01", "02", "03"];

pub(crate) const MIXAMO: Naming = Naming {
    label: "Mixamo",
    above: &["Armature"],
    hips: "mixamorig:Hips",
    spine: &["mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2"],
    neck: &["mixamorig:Neck"],
    head: "mixamorig:Head",
    jaw: "",
    eye: "mixamorig:{}Eye",
    arm: ["mixamorig:{}Shoulder", "mixamorig:{}Arm", "mixamorig:{}ForeArm", "mixamorig:{}Hand"],
    leg: ["mixamorig:{}UpLeg", "mixamorig:{}Leg", "mixamorig:{}Foot", "mixamorig:{}ToeBase"],
    fingers: [
        "mixamorig:{}HandIndex#",
        "mixamorig:{}HandMiddle#",
        "mixamorig:{}HandPinky#",
        "mixamorig:{}HandRing#",
        "mixamorig:{}HandThumb#",
    ],
    numbers: PLAIN,
    thumbs: None,
    sides: LEFT_RIGHT,
};

pub(crate) const UNREAL: Naming = Naming {
    label: "Unreal mannequin",
    above: &["root"],
    hips: "pelvis",
    spine: &["spine_01", "spine_02", "spine_03", "spine_04", "spine_05"],
    neck: &["neck_01", "neck_02"],
    head: "head",
    jaw: "",
    eye: "",
    arm: ["clavicle_{}", "upperarm_{}", "lowerarm_{}", "hand_{}"],
    leg: ["thigh_{}", "calf_{}", "foot_{}", "ball_{}"],
    fingers: ["index_#_{}", "middle_#_{}", "pinky_#_{}", "ring_#_{}", "thumb_#_{}"],
    numbers: ZERO,
    thumbs: None,
    sides: LR,
};

pub(crate) const MAKEHUMAN: Naming = Naming {
    label: "MakeHuman",
    above: &[],
    hips: "root",
    spine: &["spine05", "spine04", "spine03", "spine02", "spine01"],
    neck: &["neck01", "neck02", "neck03"],
    head: "head",
    jaw: "jaw",
    eye: "eye.{}",
    arm: ["clavicle.{}", "upperarm01.{}", "lowerarm01.{}", "wrist.{}"],
    leg: ["upperleg01.{}", "lowerleg01.{}", "foot.{}", "toe1-1.{}"],
    fingers: ["finger2-#.{}", "finger3-#.{}", "finger5-#.{}", "finger4-#.{}", "finger1-#.{}"],
    numbers: PLAIN,
    thumbs: None,
    sides: DOT,
};

pub(crate) const RIGIFY: Naming = Naming {
    label: "Rigify",
    above: &["metarig"],
    hips: "DEF-spine",
    spine: &["DEF-spine.001", "DEF-spine.002", "DEF-spine.003"],
    neck: &["DEF-spine.004", "DEF-spine.005"],
    head: "DEF-spine.006",
    jaw: "DEF-jaw",
    eye: "DEF-eye.{}",
    arm: ["DEF-shoulder.{}", "DEF-upper_arm.{}", "DEF-forearm.{}", "DEF-hand.{}"],
    leg: ["DEF-thigh.{}", "DEF-shin.{}", "DEF-foot.{}", "DEF-toe.{}"],
    fingers: ["DEF-f_index.#.{}", "DEF-f_middle.#.{}", "DEF-f_pinky.#.{}", "DEF-f_ring.#.{}", "DEF-thumb.#.{}"],
    numbers: ZERO,
    thumbs: None,
    sides: DOT,
};

pub(crate) const UNITY: Naming = Naming {
    label: "Unity humanoid",
    above: &[],
    hips: "Hips",
    spine: &["Spine", "Chest"],
    neck: &[],
    head: "Head",
    jaw: "Jaw",
    eye: "{}Eye",
    arm: ["{}Shoulder", "{}UpperArm", "{}LowerArm", "{}Hand"],
    leg: ["{}UpperLeg", "{}LowerLeg", "{}Foot", "{}Toes"],
    fingers: ["{}Index#", "{}Middle#", "{}Little#", "{}Ring#", "{}Thumb#"],
    numbers: ["Proximal", "Intermediate", "Distal"],
    thumbs: None,
    sides: LEFT_RIGHT,
};

pub(crate) const VROID: Naming = Naming {
    label: "Unity humanoid",
    above: &["Root"],
    hips: "J_Bip_C_Hips",
    spine: &["J_Bip_C_Spine", "J_Bip_C_Chest", "J_Bip_C_UpperChest"],
    neck: &["J_Bip_C_Neck"],
    head: "J_Bip_C_Head",
    jaw: "",
    eye: "J_Adj_{}_FaceEye",
    arm: ["J_Bip_{}_Shoulder", "J_Bip_{}_UpperArm", "J_Bip_{}_LowerArm", "J_Bip_{}_Hand"],
    leg: ["J_Bip_{}_UpperLeg", "J_Bip_{}_LowerLeg", "J_Bip_{}_Foot", "J_Bip_{}_ToeBase"],
    fingers: ["J_Bip_{}_Index#", "J_Bip_{}_Middle#", "J_Bip_{}_Little#", "J_Bip_{}_Ring#", "J_Bip_{}_Thumb#"],
    numbers: PLAIN,
    thumbs: None,
    sides: DOT,
};

pub(crate) const BIPED: Naming = Naming {
    label: "Biped",
    above: &["Bip01"],
    hips: "Bip01 Pelvis",
    spine: &["Bip01 Spine", "Bip01 Spine1", "Bip01 Spine2"],
    neck: &["Bip01 Neck"],
    head: "Bip01 Head",
    jaw: "",
    eye: "",
    arm: ["Bip01 {} Clavicle", "Bip01 {} UpperArm", "Bip01 {} Forearm", "Bip01 {} Hand"],
    leg: ["Bip01 {} Thigh", "Bip01 {} Calf", "Bip01 {} Foot", "Bip01 {} Toe0"],
    fingers: ["Bip01 {} Finger1#", "Bip01 {} Finger2#", "Bip01 {} Finger4#", "Bip01 {} Finger3#", "Bip01 {} Finger0#"],
    numbers: ["", "1", "2"],
    thumbs: None,
    sides: DOT,
};

/// The old names of `.bvh` files: one spine bone, no fingers, no toes.
pub(crate) const POSER: Naming = Naming {
    label: "joint names",
    above: &[],
    hips: "Hips",
    spine: &["Chest"],
    neck: &["Neck"],
    head: "Head",
    jaw: "",
    eye: "",
    arm: ["{}Collar", "{}Shoulder", "{}Elbow", "{}Wrist"],
    leg: ["{}Hip", "{}Knee", "{}Ankle", ""],
    fingers: [""; 5],
    numbers: PLAIN,
    thumbs: None,
    sides: LEFT_RIGHT,
};

/// Ready Player Me: Mixamo's names without the prefix.
pub(crate) const READY_PLAYER_ME: Naming = Naming {
    above: &["Armature"],
    hips: "Hips",
    spine: &["Spine", "Spine1", "Spine2"],
    neck: &["Neck"],
    head: "Head",
    eye: "{}Eye",
    arm: ["{}Shoulder", "{}Arm", "{}ForeArm", "{}Hand"],
    leg: ["{}UpLeg", "{}Leg", "{}Foot", "{}ToeBase"],
    fingers: ["{}HandIndex#", "{}HandMiddle#", "{}HandPinky#", "{}HandRing#", "{}HandThumb#"],
    ..MIXAMO
};

/// `HumanIK`'s export of characters.
pub(crate) const HUMAN_IK: Naming = Naming {
    above: &["Character1_Reference"],
    hips: "Character1_Hips",
    spine: &["Character1_Spine", "Character1_Spine1", "Character1_Spine2"],
    neck: &["Character1_Neck"],
    head: "Character1_Head",
    eye: "",
    arm: ["Character1_{}Shoulder", "Character1_{}Arm", "Character1_{}ForeArm", "Character1_{}Hand"],
    leg: ["Character1_{}UpLeg", "Character1_{}Leg", "Character1_{}Foot", "Character1_{}ToeBase"],
    fingers: [
        "Character1_{}HandIndex#",
        "Character1_{}HandMiddle#",
        "Character1_{}HandPinky#",
        "Character1_{}HandRing#",
        "Character1_{}HandThumb#",
    ],
    ..MIXAMO
};

/// Unreal's first mannequin: three spine bones, one neck bone.
pub(crate) const UNREAL_4: Naming =
    Naming { spine: &["spine_01", "spine_02", "spine_03"], neck: &["neck_01"], ..UNREAL };

pub(crate) const GODOT: Naming = Naming {
    label: "Godot humanoid",
    above: &["Root"],
    spine: &["Spine", "Chest", "UpperChest"],
    neck: &["Neck"],
    thumbs: Some(["Metacarpal", "Proximal", "Distal"]),
    ..UNITY
};

/// Common hand-written names in Blender.
pub(crate) const BLENDER: Naming = Naming {
    label: "Blender",
    above: &["root"],
    hips: "hips",
    spine: &["spine", "chest"],
    neck: &["neck"],
    head: "head",
    jaw: "jaw",
    eye: "eye.{}",
    arm: ["shoulder.{}", "upper_arm.{}", "forearm.{}", "hand.{}"],
    leg: ["thigh.{}", "shin.{}", "foot.{}", "toe.{}"],
    fingers: ["f_index.#.{}", "f_middle.#.{}", "f_pinky.#.{}", "f_ring.#.{}", "thumb.#.{}"],
    ..RIGIFY
};

/// Biped of Valve's games.
pub(crate) const SOURCE: Naming = Naming {
    above: &[],
    hips: "ValveBiped.Bip01_Pelvis",
    spine: &["ValveBiped.Bip01_Spine", "ValveBiped.Bip01_Spine1", "ValveBiped.Bip01_Spine2", "ValveBiped.Bip01_Spine4"],
    neck: &["ValveBiped.Bip01_Neck1"],
    head: "ValveBiped.Bip01_Head1",
    arm: [
        "ValveBiped.Bip01_{}_Clavicle",
        "ValveBiped.Bip01_{}_UpperArm",
        "ValveBiped.Bip01_{}_Forearm",
        "ValveBiped.Bip01_{}_Hand",
    ],
    leg: [
        "ValveBiped.Bip01_{}_Thigh",
        "ValveBiped.Bip01_{}_Calf",
        "ValveBiped.Bip01_{}_Foot",
        "ValveBiped.Bip01_{}_Toe0",
    ],
    fingers: [
        "ValveBiped.Bip01_{}_Finger1#",
        "ValveBiped.Bip01_{}_Finger2#",
        "ValveBiped.Bip01_{}_Finger4#",
        "ValveBiped.Bip01_{}_Finger3#",
        "ValveBiped.Bip01_{}_Finger0#",
    ],
    ..BIPED
};

pub(crate) const CHARACTER_CREATOR: Naming = Naming {
    label: "Character Creator",
    above: &["CC_Base_BoneRoot"],
    hips: "CC_Base_Hip",
    spine: &["CC_Base_Waist", "CC_Base_Spine01", "CC_Base_Spine02"],
    neck: &["CC_Base_NeckTwist01", "CC_Base_NeckTwist02"],
    head: "CC_Base_Head",
    jaw: "CC_Base_JawRoot",
    eye: "CC_Base_{}_Eye",
    arm: ["CC_Base_{}_Clavicle", "CC_Base_{}_Upperarm", "CC_Base_{}_Forearm", "CC_Base_{}_Hand"],
    leg: ["CC_Base_{}_Thigh", "CC_Base_{}_Calf", "CC_Base_{}_Foot", "CC_Base_{}_ToeBase"],
    fingers: ["CC_Base_{}_Index#", "CC_Base_{}_Mid#", "CC_Base_{}_Pinky#", "CC_Base_{}_Ring#", "CC_Base_{}_Thumb#"],
    numbers: PLAIN,
    thumbs: None,
    sides: DOT,
};

pub(crate) const DAZ: Naming = Naming {
    label: "Daz Genesis",
    above: &["Genesis8Female"],
    hips: "hip",
    spine: &["abdomenLower", "abdomenUpper", "chestLower", "chestUpper"],
    neck: &["neckLower", "neckUpper"],
    head: "head",
    jaw: "lowerJaw",
    eye: "{}Eye",
    arm: ["{}Collar", "{}ShldrBend", "{}ForearmBend", "{}Hand"],
    leg: ["{}ThighBend", "{}Shin", "{}Foot", "{}Toe"],
    fingers: ["{}Index#", "{}Mid#", "{}Pinky#", "{}Ring#", "{}Thumb#"],
    numbers: PLAIN,
    thumbs: None,
    sides: LR,
};

pub(crate) const DAZ_9: Naming = Naming {
    label: "Daz Genesis 9",
    above: &["Genesis9"],
    hips: "hip",
    spine: &["spine1", "spine2", "spine3", "spine4"],
    neck: &["neck1", "neck2"],
    head: "head",
    jaw: "lowerjaw",
    eye: "{}_eye",
    arm: ["{}_shoulder", "{}_upperarm", "{}_forearm", "{}_hand"],
    leg: ["{}_thigh", "{}_shin", "{}_foot", "{}_toes"],
    fingers: ["{}_index#", "{}_mid#", "{}_pinky#", "{}_ring#", "{}_thumb#"],
    numbers: PLAIN,
    thumbs: None,
    sides: LR,
};

pub(crate) const ADVANCED_SKELETON: Naming = Naming {
    label: "AdvancedSkeleton",
    above: &["Group", "DeformationSystem"],
    hips: "Root_M",
    spine: &["Spine1_M", "Spine2_M", "Chest_M"],
    neck: &["Neck_M"],
    head: "Head_M",
    jaw: "Jaw_M",
    eye: "Eye_{}",
    arm: ["Scapula_{}", "Shoulder_{}", "Elbow_{}", "Wrist_{}"],
    leg: ["Hip_{}", "Knee_{}", "Ankle_{}", "Toes_{}"],
    fingers: ["IndexFinger#_{}", "MiddleFinger#_{}", "PinkyFinger#_{}", "RingFinger#_{}", "ThumbFinger#_{}"],
    numbers: PLAIN,
    thumbs: None,
    sides: DOT,
};

pub(crate) const CATS: Naming = Naming {
    label: "VRChat",
    above: &["Armature"],
    hips: "Hips",
    spine: &["Spine", "Chest"],
    neck: &["Neck"],
    head: "Head",
    jaw: "",
    eye: "Eye_{}",
    arm: ["{} shoulder", "{} arm", "{} elbow", "{} wrist"],
    leg: ["{} leg", "{} knee", "{} ankle", "{} toe"],
    fingers: ["IndexFinger#_{}", "MiddleFinger#_{}", "LittleFinger#_{}", "RingFinger#_{}", "Thumb#_{}"],
    numbers: PLAIN,
    thumbs: Some(["0", "1", "2"]),
    sides: LEFT_RIGHT,
};

pub(crate) const MMD: Naming = Naming {
    label: "MikuMikuDance",
    above: &["全ての親", "センター"],
    hips: "グルーブ",
    spine: &["上半身", "上半身2"],
    neck: &["首"],
    head: "頭",
    jaw: "",
    eye: "{}目",
    arm: ["{}肩", "{}腕", "{}ひじ", "{}手首"],
    leg: ["{}足", "{}ひざ", "{}足首", "{}つま先"],
    fingers: ["{}人指#", "{}中指#", "{}小指#", "{}薬指#", "{}親指#"],
    numbers: ["１", "２", "３"],
    thumbs: Some(["０", "１", "２"]),
    sides: ["左", "右"],
};

/// Fifteen parts, no fingers.
pub(crate) const ROBLOX: Naming = Naming {
    label: "Roblox",
    above: &["HumanoidRootNode"],
    hips: "LowerTorso",
    spine: &["UpperTorso"],
    neck: &[],
    head: "Head",
    jaw: "",
    eye: "",
    arm: ["", "{}UpperArm", "{}LowerArm", "{}Hand"],
    leg: ["{}UpperLeg", "{}LowerLeg", "{}Foot", ""],
    fingers: [""; 5],
    numbers: PLAIN,
    thumbs: None,
    sides: LEFT_RIGHT,
};

pub(crate) const SMPL_X: Naming = Naming {
    label: "SMPL-X",
    above: &["root"],
    hips: "pelvis",
    spine: &["spine1", "spine2", "spine3"],
    neck: &["neck"],
    head: "head",
    jaw: "jaw",
    eye: "{}_eye_smplhf",
    arm: ["{}_collar", "{}_shoulder", "{}_elbow", "{}_wrist"],
    leg: ["{}_hip", "{}_knee", "{}_ankle", "{}_foot"],
    fingers: ["{}_index#", "{}_middle#", "{}_pinky#", "{}_ring#", "{}_thumb#"],
    numbers: PLAIN,
    thumbs: None,
    sides: ["left", "right"],
};

pub(crate) const ALL: [&Naming; 22] = [
    &MIXAMO,
    &READY_PLAYER_ME,
    &HUMAN_IK,
    &UNREAL,
    &UNREAL_4,
    &MAKEHUMAN,
    &RIGIFY,
    &BLENDER,
    &UNITY,
    &VROID,
    &GODOT,
    &BIPED,
    &SOURCE,
    &POSER,
    &CHARACTER_CREATOR,
    &DAZ,
    &DAZ_9,
    &ADVANCED_SKELETON,
    &CATS,
    &MMD,
    &ROBLOX,
    &SMPL_X,
];
