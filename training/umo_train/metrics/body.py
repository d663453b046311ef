"""Body language measures: head motion, length of gestures, smoothness of wrists, rests."""

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import find_peaks
from scipy.spatial.transform import Rotation

from umo_train.metrics.item import Motion
from umo_train.metrics.motion import joint_places
from umo_train.skeleton import JOINT, matrices, rotations
from umo_train.speech.utterance import FRAME_RATE

WRISTS = (JOINT["left_wrist"], JOINT["right_wrist"])
# Standard deviation of the smoothing of wrists before their speed is taken, frames.
SMOOTH = 1.0
# Speeds above which a wrist gestures and below which it is still, m/s; gestures closer than this form one phrase,
# frames.
GESTURE_M_S, STILL_M_S, JOINED = 0.25, 0.04, 9


def head_deviation(motion: Motion) -> np.ndarray:
    """Standard deviation of the head's yaw, pitch and roll against the chest, about its mean, degrees `[3]`."""
    local = rotations(motion)
    turns = Rotation.from_matrix(local[:, JOINT["neck"]] @ local[:, JOINT["head"]])
    return (turns.mean().inv() * turns).as_euler("YXZ", degrees=True).std(0)


def wrist_speed(motion: Motion) -> np.ndarray:
    """Speed of the faster wrist in the pelvis' frame, m/s `[T]`."""
    at = joint_places(motion, walking=False)[:, WRISTS]
    pelvis = matrices(np.asarray(motion["lower"][:, :6], np.float64))
    at = gaussian_filter1d(np.einsum("tji,twj->twi", pelvis, at), SMOOTH, axis=0)
    return np.linalg.norm(np.gradient(at, 1 / FRAME_RATE, axis=0), axis=-1).max(1)


def phrases(speed: np.ndarray) -> np.ndarray:
    """Lengths of gesture phrases in seconds `[count]`: times with a gesturing wrist, including short rests."""
    near = uniform_filter1d((speed > GESTURE_M_S).astype(float), JOINED, mode="constant") > 1e-9
    edges = np.flatnonzero(np.diff(np.concatenate([[False], near, [False]]).astype(int))).reshape(-1, 2)
    return np.diff(edges)[:, 0] / FRAME_RATE


def wrist_jerk(motion: Motion) -> np.ndarray:
    """Third derivative of the wrists' positions relative to the pelvis, of the rougher one, m/s^3 `[T - 3]`."""
    at = joint_places(motion, walking=False)[:, WRISTS]
    return np.linalg.norm(np.diff(at, 3, axis=0) * FRAME_RATE**3, axis=-1).max(1)


def weight_shifts(motion: Motion) -> int:
    """Number of weight shifts of the pelvis from leg to leg, by at least 2 cm."""
    aside = gaussian_filter1d(joint_places(motion)[:, 0, 0], 5)
    return sum(len(find_peaks(sign * aside, prominence=0.02)[0]) for sign in (1, -1))


def body(motions: Sequence[Motion]) -> dict[str, float | None]:
    """All measures over several motions."""
    speeds = [wrist_speed(motion) for motion in motions]
    lengths = np.concatenate([phrases(speed) for speed in speeds])
    jerks = np.concatenate([wrist_jerk(motion) for motion in motions])
    yaw, pitch, roll = np.mean([head_deviation(motion) for motion in motions], 0)
    minutes = sum(map(len, speeds)) / FRAME_RATE / 60
    return {
        "head_yaw": float(yaw),
        "head_pitch": float(pitch),
        "head_roll": float(roll),
        "phrase_median": float(np.median(lengths)) if len(lengths) else None,
        "phrases_per_minute": len(lengths) / minutes,
        "hands_still": float((np.concatenate(speeds) < STILL_M_S).mean()),
        "wrist_jerk_median": float(np.median(jerks)),
        "wrist_jerk_95": float(np.percentile(jerks, 95)),
        "weight_shifts_per_minute": sum(map(weight_shifts, motions)) / minutes,
    }
