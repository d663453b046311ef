"""The 55 joints of SMPL-X, their parts, and a small rest pose of our own."""

JOINTS = 55
JAW = 22
UPPER = (3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21)
LOWER = (0, 1, 2, 4, 5, 7, 8, 10, 11)
HANDS = tuple(range(25, 55))

# Channel counts given by the joints; the face has 6 for the jaw, then one per coefficient.
HANDS_CHANNELS = 6 * len(HANDS)
UPPER_CHANNELS = 6 * len(UPPER)
LOWER_CHANNELS = 6 * len(LOWER) + 3 + 4

PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 15, 15, 15] + [
    parent
    for wrist, first in ((20, 25), (21, 40))
    for finger in range(5)
    for parent in (wrist, first + 3 * finger, first + 3 * finger + 1)
]


def _fingers(side: float) -> list[list[float]]:
    """Index, middle, pinky, ring, thumb: three bones each, in metres, along the arm of a T pose."""
    roots = ((0.095, 0.002, 0.024), (0.098, 0.004, 0.002), (0.083, -0.004, -0.038), (0.091, 0.001, -0.019))
    bones = ((0.034, 0.023), (0.036, 0.024), (0.022, 0.017), (0.032, 0.023))
    rows = [[side * root[0], root[1], root[2]] for root in roots]
    chains = [
        [row, [side * bone[0], 0.0, 0.0], [side * bone[1], 0.0, 0.0]] for row, bone in zip(rows, bones, strict=True)
    ]
    chains.append([[side * 0.027, -0.011, 0.029], [side * 0.026, -0.004, 0.022], [side * 0.022, -0.003, 0.016]])
    return [offset for chain in chains for offset in chain]


OFFSETS_M: list[list[float]] = [
    [0.0, 0.0, 0.0],
    [0.058, -0.093, -0.006],
    [-0.058, -0.093, -0.006],
    [0.0, 0.111, -0.021],
    [0.049, -0.379, 0.003],
    [-0.049, -0.379, 0.003],
    [0.0, 0.134, 0.007],
    [-0.013, -0.402, -0.031],
    [0.013, -0.402, -0.031],
    [0.0, 0.056, 0.024],
    [0.033, -0.061, 0.119],
    [-0.033, -0.061, 0.119],
    [0.0, 0.165, -0.032],
    [0.047, 0.082, -0.015],
    [-0.047, 0.082, -0.015],
    [0.0, 0.128, 0.047],
    [0.117, 0.044, -0.009],
    [-0.117, 0.044, -0.009],
    [0.253, -0.012, -0.021],
    [-0.253, -0.012, -0.021],
    [0.249, 0.009, -0.002],
    [-0.249, 0.009, -0.002],
    [0.0, -0.013, 0.012],
    [0.032, 0.048, 0.071],
    [-0.032, 0.048, 0.071],
    *_fingers(1.0),
    *_fingers(-1.0),
]

NAMES = (
    "pelvis left_hip right_hip spine1 left_knee right_knee spine2 left_ankle right_ankle spine3 left_foot right_foot "
    "neck left_collar right_collar head left_shoulder right_shoulder left_elbow right_elbow left_wrist right_wrist "
    "jaw left_eye right_eye"
).split() + [
    f"{side}_{finger}{bone}"
    for side in ("left", "right")
    for finger in ("index", "middle", "pinky", "ring", "thumb")
    for bone in (1, 2, 3)
]

assert len(PARENTS) == len(OFFSETS_M) == len(NAMES) == JOINTS
