//! Bone names of each convention, normalised as by [`super::key`].

use super::Convention;

/// No such bone.
const NONE: [&str; 3] = [""; 3];

/// All known conventions.
pub(in super::super) const CONVENTIONS: [Convention; 17] = [
    UMO,
    MIXAMO,
    HUMANOID,
    GODOT,
    UNREAL,
    MAKEHUMAN,
    RIGIFY,
    BLENDER,
    BIPED,
    POSER,
    CHARACTER_CREATOR,
    DAZ,
    DAZ_9,
    ADVANCED_SKELETON,
    CATS,
    MMD,
    ROBLOX,
];

/// SMPL-X, and umo's own files.
const UMO: Convention = Convention {
    name: "SMPL-X",
    hips: "pelvis",
    spine: "spine1 spine2 spine3",
    neck: "neck",
    head: "head",
    jaw: "jaw",
    eye: "eye eyesmplhf",
    arm: ["collar", "shoulder", "elbow", "wrist"],
    leg: ["hip", "knee", "ankle", "foot"],
    fingers: [
        ["index1", "index2", "index3"],
        ["middle1", "middle2", "middle3"],
        ["pinky1", "pinky2", "pinky3"],
        ["ring1", "ring2", "ring3"],
        ["thumb1", "thumb2", "thumb3"],
    ],
};

/// Mixamo, `HumanIK`, Ready Player Me, the CMU rig of MakeHuman, many `.bvh` files.
const MIXAMO: Convention = Convention {
    name: "Mixamo",
    hips: "hips",
    spine: "lowerback spine spine1 spine2 spine3 spine4",
    neck: "neck neck1 neck2",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["shoulder", "arm", "forearm", "hand"],
    leg: ["upleg", "leg", "foot", "toebase"],
    fingers: [
        ["handindex1", "handindex2", "handindex3"],
        ["handmiddle1", "handmiddle2", "handmiddle3"],
        ["handpinky1", "handpinky2", "handpinky3"],
        ["handring1", "handring2", "handring3"],
        ["handthumb1", "handthumb2", "handthumb3"],
    ],
};

/// The bones of Unity's humanoid and of VRM, and `VRoid`'s names for them.
const HUMANOID: Convention = Convention {
    name: "Unity humanoid",
    hips: "hips",
    spine: "spine chest upperchest",
    neck: "neck",
    head: "head",
    jaw: "jaw",
    eye: "eye adjfaceeye",
    arm: ["shoulder", "upperarm", "lowerarm", "hand"],
    leg: ["upperleg", "lowerleg", "foot", "toes toebase toe"],
    fingers: [
        ["indexproximal index1", "indexintermediate index2", "indexdistal index3"],
        ["middleproximal middle1", "middleintermediate middle2", "middledistal middle3"],
        ["littleproximal little1", "littleintermediate little2", "littledistal little3"],
        ["ringproximal ring1", "ringintermediate ring2", "ringdistal ring3"],
        ["thumbproximal thumb1", "thumbintermediate thumb2", "thumbdistal thumb3"],
    ],
};

/// Godot's humanoid profile: VRM 1.0's names, with thumbs that begin at the metacarpal.
const GODOT: Convention = Convention {
    name: "Godot humanoid",
    fingers: [
        HUMANOID.fingers[0],
        HUMANOID.fingers[1],
        HUMANOID.fingers[2],
        HUMANOID.fingers[3],
        ["thumbmetacarpal", "thumbproximal", "thumbdistal"],
    ],
    ..HUMANOID
};

/// The mannequins of Unreal 4 and 5, `MetaHuman`, MakeHuman's rig for game engines.
const UNREAL: Convention = Convention {
    name: "Unreal mannequin",
    hips: "pelvis",
    spine: "spine01 spine02 spine03 spine04 spine05",
    neck: "neck01 neck02",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["clavicle", "upperarm", "lowerarm", "hand"],
    leg: ["thigh", "calf", "foot", "ball"],
    fingers: [
        ["index01", "index02", "index03"],
        ["middle01", "middle02", "middle03"],
        ["pinky01", "pinky02", "pinky03"],
        ["ring01", "ring02", "ring03"],
        ["thumb01", "thumb02", "thumb03"],
    ],
};

/// MakeHuman's default rig. Its limbs have two bones each; the first is used.
const MAKEHUMAN: Convention = Convention {
    name: "MakeHuman",
    hips: "root hips",
    spine: "spine05 spine04 spine03 spine02 spine01",
    neck: "neck01 neck02 neck03",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["clavicle", "upperarm01", "lowerarm01", "wrist"],
    leg: ["upperleg01", "lowerleg01", "foot", "toe11"],
    fingers: [
        ["finger21", "finger22", "finger23"],
        ["finger31", "finger32", "finger33"],
        ["finger51", "finger52", "finger53"],
        ["finger41", "finger42", "finger43"],
        ["finger11", "finger12", "finger13"],
    ],
};

/// The deforming bones of Blender's Rigify.
const RIGIFY: Convention = Convention {
    name: "Rigify",
    hips: "spine",
    spine: "spine001 spine002 spine003",
    neck: "spine004 spine005",
    head: "spine006",
    jaw: "jaw jawmaster",
    eye: "eye",
    arm: ["shoulder", "upperarm", "forearm", "hand"],
    leg: ["thigh", "shin", "foot", "toe"],
    fingers: [
        ["findex01", "findex02", "findex03"],
        ["fmiddle01", "fmiddle02", "fmiddle03"],
        ["fpinky01", "fpinky02", "fpinky03"],
        ["fring01", "fring02", "fring03"],
        ["thumb01", "thumb02", "thumb03"],
    ],
};

/// Common names in Blender, including older Rigify.
const BLENDER: Convention = Convention {
    name: "Blender",
    hips: "hips pelvis hip",
    spine: "spine spine001 spine002 chest chest001 upperchest",
    neck: "neck neck001",
    ..RIGIFY_HEAD
};

/// [`RIGIFY`] with a bone named `head`.
const RIGIFY_HEAD: Convention = Convention { head: "head", ..RIGIFY };

/// 3ds Max's Biped, and that of Valve's games; fingers are numbered from the thumb.
const BIPED: Convention = Convention {
    name: "Biped",
    hips: "pelvis",
    spine: "spine spine1 spine2 spine3 spine4",
    neck: "neck neck1 neck2",
    head: "head head1",
    jaw: "jaw",
    eye: "eye",
    arm: ["clavicle", "upperarm", "forearm", "hand"],
    leg: ["thigh", "calf", "foot", "toe0"],
    fingers: [
        ["finger1", "finger11", "finger12"],
        ["finger2", "finger21", "finger22"],
        ["finger4", "finger41", "finger42"],
        ["finger3", "finger31", "finger32"],
        ["finger0", "finger01", "finger02"],
    ],
};

/// Old `.bvh` files, which name joints as SMPL-X does except for hips and toes.
const POSER: Convention = Convention {
    name: "joint names",
    hips: "hips",
    spine: "abdomen spine chest chest1 chest2 chest3 chest4",
    neck: "neck",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["collar", "shoulder", "elbow", "wrist"],
    leg: ["hip", "knee", "ankle", "toe"],
    fingers: [NONE; 5],
};

/// Reallusion's Character Creator.
const CHARACTER_CREATOR: Convention = Convention {
    name: "Character Creator",
    hips: "hip",
    spine: "waist spine01 spine02",
    neck: "necktwist01 necktwist02",
    head: "head",
    jaw: "jawroot",
    eye: "eye",
    arm: ["clavicle", "upperarm", "forearm", "hand"],
    leg: ["thigh", "calf", "foot", "toebase"],
    fingers: [
        ["index1", "index2", "index3"],
        ["mid1", "mid2", "mid3"],
        ["pinky1", "pinky2", "pinky3"],
        ["ring1", "ring2", "ring3"],
        ["thumb1", "thumb2", "thumb3"],
    ],
};

/// Daz's Genesis.
const DAZ: Convention = Convention {
    name: "Daz Genesis",
    hips: "hip",
    spine: "abdomenlower abdomenupper chestlower chestupper",
    neck: "necklower neckupper",
    head: "head",
    jaw: "lowerjaw",
    eye: "eye",
    arm: ["collar", "shldrbend", "forearmbend", "hand"],
    leg: ["thighbend", "shin", "foot", "toe"],
    ..CHARACTER_CREATOR
};

/// Daz's Genesis 9.
const DAZ_9: Convention = Convention {
    name: "Daz Genesis 9",
    hips: "hip",
    spine: "spine1 spine2 spine3 spine4",
    neck: "neck1 neck2",
    head: "head",
    jaw: "lowerjaw",
    eye: "eye",
    arm: ["shoulder", "upperarm", "forearm", "hand"],
    leg: ["thigh", "shin", "foot", "toes"],
    ..CHARACTER_CREATOR
};

/// Maya's `AdvancedSkeleton`.
const ADVANCED_SKELETON: Convention = Convention {
    name: "AdvancedSkeleton",
    hips: "root",
    spine: "spine1 spine2 spine3 spine4 chest",
    neck: "neck",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["scapula", "shoulder", "elbow", "wrist"],
    leg: ["hip", "knee", "ankle", "toes"],
    fingers: [
        ["indexfinger1", "indexfinger2", "indexfinger3"],
        ["middlefinger1", "middlefinger2", "middlefinger3"],
        ["pinkyfinger1", "pinkyfinger2", "pinkyfinger3"],
        ["ringfinger1", "ringfinger2", "ringfinger3"],
        ["thumbfinger1", "thumbfinger2", "thumbfinger3"],
    ],
};

/// Names that the Blender plugin Cats gives the bones of `VRChat` avatars.
const CATS: Convention = Convention {
    name: "VRChat",
    hips: "hips",
    spine: "spine chest upperchest",
    neck: "neck",
    head: "head",
    jaw: "jaw",
    eye: "eye",
    arm: ["shoulder", "arm", "elbow", "wrist"],
    leg: ["leg", "knee", "ankle", "toe"],
    fingers: [
        ["indexfinger1", "indexfinger2", "indexfinger3"],
        ["middlefinger1", "middlefinger2", "middlefinger3"],
        ["littlefinger1", "littlefinger2", "littlefinger3"],
        ["ringfinger1", "ringfinger2", "ringfinger3"],
        ["thumb0", "thumb1", "thumb2"],
    ],
};

/// `MikuMikuDance`: upper and lower body share a parent bone. If the legs have a second set of bones for the mesh,
/// marked D, that set is used.
const MMD: Convention = Convention {
    name: "MikuMikuDance",
    hips: "腰 グルーブ センター",
    spine: "上半身 上半身2 上半身3",
    neck: "首",
    head: "頭",
    jaw: "",
    eye: "目",
    arm: ["肩", "腕", "ひじ", "手首"],
    leg: ["足d 足", "ひざd ひざ", "足首d 足首", "足先ex つま先"],
    fingers: [
        ["人指1", "人指2", "人指3"],
        ["中指1", "中指2", "中指3"],
        ["小指1", "小指2", "小指3"],
        ["薬指1", "薬指2", "薬指3"],
        ["親指0", "親指1", "親指2"],
    ],
};

/// Roblox's R15: fifteen parts, no fingers.
const ROBLOX: Convention = Convention {
    name: "Roblox",
    hips: "lowertorso",
    spine: "uppertorso",
    neck: "neck",
    head: "head",
    jaw: "",
    eye: "",
    arm: ["", "upperarm", "lowerarm", "hand"],
    leg: ["upperleg", "lowerleg", "foot", ""],
    fingers: [NONE; 5],
};
