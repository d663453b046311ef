//! VRM's names of bones and expressions, and the standing height of an avatar.

use umo_core_pose::rotation::{IDENTITY, Quat, normalized};
use umo_core_pose::skeleton::JOINTS;

/// Joints from the pelvis to the ball of the left foot.
const LEG: [usize; 4] = [1, 4, 7, 10];
/// Height of the ball of a standing foot above the floor, in metres.
const SOLE: f32 = 0.02;

/// Limbs that are parallel to an axis in VRM's T-pose: a joint, the joint at the bone's end, and the direction.
const LIMBS: [(usize, usize, [f32; 3]); 10] = [
    (1, 4, [0.0, -1.0, 0.0]),
    (4, 7, [0.0, -1.0, 0.0]),
    (2, 5, [0.0, -1.0, 0.0]),
    (5, 8, [0.0, -1.0, 0.0]),
    (16, 18, [1.0, 0.0, 0.0]),
    (18, 20, [1.0, 0.0, 0.0]),
    (20, 28, [1.0, 0.0, 0.0]),
    (17, 19, [-1.0, 0.0, 0.0]),
    (19, 21, [-1.0, 0.0, 0.0]),
    (21, 43, [-1.0, 0.0, 0.0]),
];

/// Expressions that every VRM avatar has, by their names in VRM 1.0 and in VRM 0.x (and VMC).
pub const EXPRESSIONS: [(&str, &str); 7] = [
    ("aa", "A"),
    ("ih", "I"),
    ("ou", "U"),
    ("ee", "E"),
    ("oh", "O"),
    ("blinkLeft", "Blink_L"),
    ("blinkRight", "Blink_R"),
];

/// Bones of Unity's humanoid, in SMPL-X order.
pub const UNITY_BONES: [&str; JOINTS] = [
    "Hips",
    "LeftUpperLeg",
    "RightUpperLeg",
    "Spine",
    "LeftLowerLeg",
    "RightLowerLeg",
    "Chest",
    "LeftFoot",
    "RightFoot",
    "UpperChest",
    "LeftToes",
    "RightToes",
    "Neck",
    "LeftShoulder",
    "RightShoulder",
    "Head",
    "LeftUpperArm",
    "RightUpperArm",
    "LeftLowerArm",
    "RightLowerArm",
    "LeftHand",
    "RightHand",
    "Jaw",
    "LeftEye",
    "RightEye",
    "LeftIndexProximal",
    "LeftIndexIntermediate",
    "LeftIndexDistal",
    "LeftMiddleProximal",
    "LeftMiddleIntermediate",
    "LeftMiddleDistal",
    "LeftLittleProximal",
    "LeftLittleIntermediate",
    "LeftLittleDistal",
    "LeftRingProximal",
    "LeftRingIntermediate",
    "LeftRingDistal",
    "LeftThumbProximal",
    "LeftThumbIntermediate",
    "LeftThumbDistal",
    "RightIndexProximal",
    "RightIndexIntermediate",
    "RightIndexDistal",
    "RightMiddleProximal",
    "RightMiddleIntermediate",
    "RightMiddleDistal",
    "RightLittleProximal",
    "RightLittleIntermediate",
    "RightLittleDistal",
    "RightRingProximal",
    "RightRingIntermediate",
    "RightRingDistal",
    "RightThumbProximal",
    "RightThumbIntermediate",
    "RightThumbDistal",
];

/// Name of a joint's bone in VRM 1.0: Unity's name, except that the thumb begins at the metacarpal.
pub fn bone(joint: usize) -> String {
    let name =
        UNITY_BONES[joint].replace("ThumbProximal", "ThumbMetacarpal").replace("ThumbIntermediate", "ThumbProximal");
    name[..1].to_lowercase() + &name[1..]
}

/// Height of the root of an upright skeleton above the floor, in metres.
pub fn standing_height(offsets: &[[f32; 3]]) -> f32 {
    SOLE - LEG.iter().map(|&joint| offsets[joint][1]).sum::<f32>()
}

/// World rotation of each joint from the rest pose to VRM's T-pose. `[55]`
pub fn t_pose(offsets: &[[f32; 3]]) -> [Quat; JOINTS] {
    let mut world = [IDENTITY; JOINTS];
    for (joint, end, axis) in LIMBS {
        world[joint] = shortest(offsets[end], axis);
    }
    world
}

/// Shortest rotation of a bone to a unit vector, which must not be its opposite.
fn shortest([x, y, z]: [f32; 3], [a, b, c]: [f32; 3]) -> Quat {
    let length = (x * x + y * y + z * z).sqrt();
    let dot = x * a + y * b + z * c;
    normalized([y * c - z * b, z * a - x * c, x * b - y * a, length + dot])
}
