"""Arms: from the wrist's position and the hand's orientation to joint rotations.

Both arms are solved as left arms; the right one's inputs and results are mirrored in the sagittal plane.
"""

import numpy as np

from umo_train.performer.rotation import about, frame, two_bones
from umo_train.skeleton import JOINT, OFFSETS_M

# An arm's state per frame: wrist (outward, up, forward of the midpoint between the shoulders, m), elbow swivel
# (outward), forearm twist (palm in 0, down positive), wrist bend towards the palm and towards the thumb, then the
# hand's `fingers`.
WRIST, SWIVEL, TWIST, BEND, TILT, FINGERS = slice(0, 3), 3, 4, 5, 6, slice(7, 14)
STATE = 14
MIRROR = np.array([-1.0, 1.0, 1.0])
_FLIP = np.outer(MIRROR, MIRROR)
# From the chest joint to the midpoint between the shoulders.
SHOULDER_CENTRE = np.array([0.0, 0.145, -0.03])
_COLLAR = OFFSETS_M[JOINT["left_collar"]]
_SHOULDER, _ELBOW, _HAND = (OFFSETS_M[JOINT["left_" + name]] for name in ("shoulder", "elbow", "wrist"))
UPPER_M, FORE_M = float(np.linalg.norm(_ELBOW)), float(np.linalg.norm(_HAND))
# In the T-pose the elbow bends forward, about -Y.
_REST_UPPER = frame(_ELBOW, np.array([0.0, -1.0, 0.0]))
_REST_FORE = frame(_HAND, np.array([0.0, -1.0, 0.0]))


def mirrored(rotations: np.ndarray) -> np.ndarray:
    """The rotation mirrored."""
    return rotations * _FLIP


def solve(
    states: np.ndarray, chest: np.ndarray, collars: np.ndarray, yaw: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """States `[2, T, STATE]`, the chest's world rotation, both collars' local ones `[2, T, 3, 3]` and the heading of
    the wrists' frame, to local rotations of shoulder, elbow and wrist, each `[2, T, 3, 3]`, left first."""
    bodies = np.stack([chest, mirrored(chest)])
    collars = np.stack([collars[0], mirrored(collars[1])])
    bones = bodies @ collars
    turn = about("y", np.stack([yaw, -yaw]))
    shoulder = bodies @ (_COLLAR - SHOULDER_CENTRE) + bones @ _SHOULDER
    reach = (turn @ states[..., WRIST, None])[..., 0] - shoulder
    swivel = states[..., SWIVEL]
    pole = np.stack([0.62 + swivel, np.full_like(swivel, -0.75), np.full_like(swivel, -0.7)], -1)
    first, second, hinge = two_bones(reach, (turn @ pole[..., None])[..., 0], UPPER_M, FORE_M)
    upper = frame(first, hinge) @ _REST_UPPER.T
    fore = frame(second, hinge) @ _REST_FORE.T
    # Half of a forearm's twist is applied at the elbow's bone, half at the wrist.
    half = about("x", 0.5 * states[..., TWIST])
    elbow = np.swapaxes(upper, -1, -2) @ fore @ half
    wrist = half @ about("z", -states[..., BEND]) @ about("y", -states[..., TILT])
    local = (np.swapaxes(bones, -1, -2) @ upper, elbow, wrist)
    for part in local:
        part[1] = mirrored(part[1])
    return local
