//! What VRM avatars call their bones and expressions, and how high they stand.

use umo_core::motion::rotation::{IDENTITY, Quat, normalized};
use umo_core::motion::skeleton::JOINTS;

/// From the pelvis to the ball of the left foot.
const LEG: [usize; 4] = [1, 4, 7, 10];
/// The ball of a foot that stands is so far above the floor, metres.
const SOLE: f32 = 0.02;

/// Limbs that VRM's T-pose has along an axis: a joint, the one at the bone's end, and where that is.
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

/// Expressions that every VRM avatar has, as VRM 1.0 and VRM 0.x (and VMC) call them.
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

/// A joint's bone in VRM 1.0: Unity's name, but that the thumb begins at the metacarpal.
pub fn bone(joint: usize) -> String {
    let name =
        UNITY_BONES[joint].replace("ThumbProximal", "ThumbMetacarpal").replace("ThumbIntermediate", "ThumbProximal");
    name[..1].to_lowercase() + &name[1..]
}

/// How high the root of a skeleton is that stands upright, metres above the floor.
pub fn standing_height(offsets: &[[f32; 3]]) -> f32 {
    SOLE - LEG.iter().map(|&joint| offsets[joint][1]).sum::<f32>()
}

/// What turns each joint from the rest pose to VRM's T-pose, in the world's frame. `[55]`
pub(crate) fn t_pose(offsets: &[[f32; 3]]) -> [Quat; JOINTS] {
    let mut world = [IDENTITY; JOINTS];
    for (joint, end, axis) in LIMBS {
        world[joint] = shortest(offsets[end], axis);
    }
    world
}

/// The shortest turn of a bone to a unit vector, which is not its opposite.
fn shortest([x, y, z]: [f32; 3], [a, b, c]: [f32; 3]) -> Quat {
    let length = (x * x + y * y + z * z).sqrt();
    let dot = x * a + y * b + z * c;
    normalized([y * c - z * b, z * a - x * c, x * b - y * a, length + dot])
}
