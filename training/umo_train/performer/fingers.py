"""Hand shapes."""

import numpy as np

from umo_train.performer.arms import mirrored
from umo_train.performer.rotation import about, euler

# Curl of index, middle, pinky, ring and thumb (0 straight, 1 closed), spread of the fingers, and opposition of the
# thumb.
SHAPES = {
    "relaxed": (0.26, 0.32, 0.42, 0.38, 0.25, 0.1, 0.35),
    "open": (0.06, 0.08, 0.12, 0.1, 0.05, 0.75, 0.0),
    "flat": (0.05, 0.05, 0.07, 0.06, 0.1, 0.05, 0.15),
    "point": (0.03, 0.85, 0.95, 0.92, 0.6, 0.0, 0.75),
    "fist": (0.95, 0.97, 1.0, 0.98, 0.65, 0.0, 0.8),
    "pinch": (0.52, 0.42, 0.3, 0.34, 0.4, 0.3, 0.95),
    "two": (0.03, 0.05, 0.95, 0.9, 0.65, 0.4, 0.8),
    "three": (0.04, 0.05, 0.95, 0.1, 0.65, 0.5, 0.8),
}
WIDTH = 7
# Angles of a full curl at each of a finger's three joints, in radians.
_CURL = np.radians((72.0, 95.0, 60.0))
_SPREAD = np.radians((9.0, 1.0, -13.0, -5.0))


def pose(states: np.ndarray) -> np.ndarray:
    """`[2, T, 7]` of left and right hand to local rotations `[2, T, 15, 3, 3]`: index, middle, pinky, ring, thumb."""
    curls = states[..., :4, None] * _CURL
    out = np.empty((*states.shape[:2], 15, 3, 3))
    bend = about("z", -curls)
    bend[..., 0, :, :] = about("y", -states[..., 5, None] * _SPREAD) @ bend[..., 0, :, :]
    out[..., :12, :, :] = bend.reshape(*states.shape[:2], 12, 3, 3)
    curl, against = states[..., 4], states[..., 6]
    zero = np.zeros_like(curl)
    out[..., 12, :, :] = euler(np.stack([0.75 * against, 0.25 * curl + 0.15 * against, zero], -1))
    out[..., 13, :, :] = euler(np.stack([0.2 * curl, 0.75 * curl, zero], -1))
    out[..., 14, :, :] = euler(np.stack([0.15 * curl, 0.9 * curl, zero], -1))
    out[1] = mirrored(out[1])
    return out
