"""Visual importance of errors in each channel."""

import numpy as np

from umo_train.skeleton import CHANNELS, CONTACT, JOINT, JOINTS_OF, SHAPE, VELOCITY

# The face's 52 channels by importance: needed for speech reading, visible, and hardly visible.
_MOUTH = (
    "jawOpen mouthClose mouthFunnel mouthPucker mouthRollLower mouthRollUpper mouthPressLeft mouthPressRight "
    "mouthLowerDownLeft mouthLowerDownRight mouthUpperUpLeft mouthUpperUpRight mouthStretchLeft mouthStretchRight "
    "mouthShrugLower mouthShrugUpper"
).split()
_EYES = "eyeBlinkLeft eyeBlinkRight".split()
# Joints whose errors move a whole limb.
_LONG = {"spine1": 2.0, "spine2": 2.0, "spine3": 2.0, "left_shoulder": 2.0, "right_shoulder": 2.0, "pelvis": 2.0}


def weights(part: str, channels: int) -> np.ndarray:
    """`[channels]`: multipliers of a channel's squared error in units of its own range."""
    out = np.ones(channels, np.float32)
    # Expression coefficients, none of which belongs to the mouth alone, have equal weights.
    if part == "face" and channels == CHANNELS["face"]:
        out[:6] = 2.0
        out[6:] = 0.3
        out[[6 + SHAPE[name] for name in _MOUTH]] = 2.0
        out[6 + SHAPE["jawOpen"]] = out[6 + SHAPE["mouthClose"]] = 5.0
        out[[6 + SHAPE[name] for name in _EYES]] = 0.6
    for at, joint in enumerate(JOINTS_OF[part]):
        for name, weight in _LONG.items():
            if joint == JOINT[name]:
                out[6 * at : 6 * at + 6] = weight
    if part == "lower":
        out[VELOCITY] = 0.5
        out[CONTACT] = 0.3
    return out


# Minimum standard deviation for normalising a channel: smaller differences are not visible.
LEAST_SCALE = {"face": 0.02, "hands": 0.03, "upper": 0.02, "lower": 0.01}
