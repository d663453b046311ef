"""Distance of the lips from the ARKit channels: a common measure for the performer, its tests and the metrics."""

import numpy as np

from umo_train.skeleton import ARKIT

# Channels before the 52 coefficients: the jaw's 6D.
JAW = 6
# mouthClose brings the lips together over an open jaw; lip raising parts them; rolling and pressing seal them.
_WEIGHTS = {
    "jawOpen": 1.0,
    "mouthClose": -1.0,
    "mouthLowerDownLeft": 0.1,
    "mouthLowerDownRight": 0.1,
    "mouthUpperUpLeft": 0.1,
    "mouthUpperUpRight": 0.1,
    "mouthFunnel": 0.05,
    "mouthRollLower": -0.05,
    "mouthRollUpper": -0.05,
    "mouthPressLeft": -0.03,
    "mouthPressRight": -0.03,
}
OPENING = np.array([_WEIGHTS.get(name, 0.0) for name in ARKIT])
# Below this the lips touch.
CLOSED = 0.03


def lip_opening(face: np.ndarray) -> np.ndarray:
    """Face channels `[..., 58]` to the opening `[...]`: 0 lips together, about 1 wide open."""
    return np.clip(face[..., JAW:] @ OPENING.astype(face.dtype), 0.0, None)
