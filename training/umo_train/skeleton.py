"""The 55 joints of SMPL-X, their parts, and the default model's own rest pose."""

import numpy as np

PARTS = ("face", "hands", "upper", "lower")

JOINT_NAMES = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot "
    "neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
    "jaw left_eye right_eye "
    + " ".join(
        f"{side}_{finger}{bone}"
        for side in ("left", "right")
        for finger in ("index", "middle", "pinky", "ring", "thumb")
        for bone in (1, 2, 3)
    )
).split()
JOINTS = len(JOINT_NAMES)
JOINT = {name: index for index, name in enumerate(JOINT_NAMES)}

PARENTS = (
    -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15,
    20, 25, 26, 20, 28, 29, 20, 31, 32, 20, 34, 35, 20, 37, 38,
    21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50, 21, 52, 53,
)  # fmt: skip

# Joints of each part, in the order of its channels.
JOINTS_OF = {
    "face": (JOINT["jaw"],),
    "hands": tuple(range(JOINT["left_index1"], JOINTS)),
    "upper": (3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21),
    "lower": (0, 1, 2, 4, 5, 7, 8, 10, 11),
}

# In Apple's order, as in ARFaceAnchor.BlendShapeLocation, from eyes to tongue.
ARKIT = (
    "eyeBlinkLeft eyeLookDownLeft eyeLookInLeft eyeLookOutLeft eyeLookUpLeft eyeSquintLeft eyeWideLeft "
    "eyeBlinkRight eyeLookDownRight eyeLookInRight eyeLookOutRight eyeLookUpRight eyeSquintRight eyeWideRight "
    "jawForward jawLeft jawRight jawOpen mouthClose mouthFunnel mouthPucker mouthLeft mouthRight "
    "mouthSmileLeft mouthSmileRight mouthFrownLeft mouthFrownRight mouthDimpleLeft mouthDimpleRight "
    "mouthStretchLeft mouthStretchRight mouthRollLower mouthRollUpper mouthShrugLower mouthShrugUpper "
    "mouthPressLeft mouthPressRight mouthLowerDownLeft mouthLowerDownRight mouthUpperUpLeft mouthUpperUpRight "
    "browDownLeft browDownRight browInnerUp browOuterUpLeft browOuterUpRight cheekPuff "
    "cheekSquintLeft cheekSquintRight noseSneerLeft noseSneerRight tongueOut"
).split()
SHAPE = {name: index for index, name in enumerate(ARKIT)}

# Channels after the rotations: face coefficients; root velocity (3, m/s) and foot contact (4) of the lower body.
EXTRA_CHANNELS = {"face": len(ARKIT), "hands": 0, "upper": 0, "lower": 7}
CHANNELS = {part: 6 * len(JOINTS_OF[part]) + EXTRA_CHANNELS[part] for part in PARTS}
VELOCITY = slice(54, 57)
CONTACT = slice(57, 61)
# Joints of the foot contact channels, in order.
CONTACT_JOINTS = (JOINT["left_ankle"], JOINT["left_foot"], JOINT["right_ankle"], JOINT["right_foot"])


def _hand(side: float) -> list[list[float]]:
    """Index, middle, pinky, ring and thumb, three bones each, in metres from the wrist of a T-pose."""
    knuckles = ((0.092, 0.0, 0.026), (0.095, 0.003, 0.004), (0.081, -0.004, -0.036), (0.089, 0.0, -0.017))
    bones = ((0.038, 0.024), (0.042, 0.027), (0.030, 0.018), (0.039, 0.025))
    chains = [[k, (b[0], 0.0, 0.0), (b[1], 0.0, 0.0)] for k, b in zip(knuckles, bones, strict=True)]
    chains.append([(0.026, -0.012, 0.028), (0.029, -0.006, 0.026), (0.022, -0.004, 0.018)])
    return [[side * x, y, z] for chain in chains for x, y, z in chain]


# A person of 1.72 m in a T-pose: Y up, facing +Z, the left hand towards +X. Metres from the parent joint.
OFFSETS_M = np.array(
    [
        [0.0, 0.0, 0.0],
        [0.085, -0.085, 0.0],
        [-0.085, -0.085, 0.0],
        [0.0, 0.11, -0.015],
        [0.01, -0.40, 0.005],
        [-0.01, -0.40, 0.005],
        [0.0, 0.13, 0.0],
        [0.0, -0.41, -0.03],
        [0.0, -0.41, -0.03],
        [0.0, 0.06, 0.02],
        [0.02, -0.06, 0.12],
        [-0.02, -0.06, 0.12],
        [0.0, 0.20, -0.035],
        [0.06, 0.11, -0.02],
        [-0.06, 0.11, -0.02],
        [0.0, 0.09, 0.03],
        [0.115, 0.035, -0.01],
        [-0.115, 0.035, -0.01],
        [0.265, -0.01, -0.015],
        [-0.265, -0.01, -0.015],
        [0.25, 0.005, 0.0],
        [-0.25, 0.005, 0.0],
        [0.0, -0.005, 0.02],
        [0.032, 0.065, 0.07],
        [-0.032, 0.065, 0.07],
        *_hand(1.0),
        *_hand(-1.0),
    ]
)
# The pelvis' height with straight legs and the soles on the floor (a foot joint is 0.02 m above it).
STANDING_HEIGHT_M = 0.975


def rotation_6d(matrices: np.ndarray) -> np.ndarray:
    """Rotation matrices `[..., 3, 3]` to their first two rows `[..., 6]` (Zhou et al. 2019, PyTorch3D's order)."""
    return matrices[..., :2, :].reshape(*matrices.shape[:-2], 6)


def matrices(six: np.ndarray) -> np.ndarray:
    """`[..., 6]` to rotation matrices `[..., 3, 3]` by Gram-Schmidt."""
    first = six[..., :3] / np.linalg.norm(six[..., :3], axis=-1, keepdims=True)
    second = six[..., 3:] - (first * six[..., 3:]).sum(-1, keepdims=True) * first
    second = second / np.linalg.norm(second, axis=-1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], -2)


def rotations(motion: dict[str, np.ndarray]) -> np.ndarray:
    """Channels of the four parts, `[T, C]` each, to all joints' parent-relative matrices `[T, 55, 3, 3]`."""
    out = np.tile(np.eye(3), (len(motion["face"]), JOINTS, 1, 1))
    for part, joints in JOINTS_OF.items():
        six = motion[part][:, : 6 * len(joints)].reshape(-1, len(joints), 6)
        out[:, joints] = matrices(six.astype(np.float64))
    return out


def places(local: np.ndarray, translation: np.ndarray, offsets: np.ndarray = OFFSETS_M) -> np.ndarray:
    """Forward kinematics: `[T, 55, 3, 3]` and the pelvis' position `[T, 3]` to all joints' `[T, 55, 3]`, m."""
    world, at = np.empty_like(local), np.empty((*local.shape[:2], 3))
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            world[:, joint], at[:, joint] = local[:, joint], translation + offsets[joint]
        else:
            world[:, joint] = world[:, parent] @ local[:, joint]
            at[:, joint] = at[:, parent] + world[:, parent] @ offsets[joint]
    return at
